"""How much light the bounces that are not made could still add."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Maxima", "Rest"]

PER_PI = float(np.float32(1.0 / np.pi))
Layer = NDArray[np.float32]


class Maxima(NamedTuple):
    """Largest values of a raster after a bounce; of parts of it, the largest of theirs.

    Attributes
    ----------
    sent : float
        Radiance that the bounce sends on.
    total : float
        Indirect irradiance so far.
    view : float
        V_t, the share of a cell's half space that terrain fills.
    kept : float
        Albedo times V_t.
    share : float
        Albedo.
    left_out : float
        Irradiance [at most] of the cells that the bounce left out.
    """

    sent: float
    total: float
    view: float
    kept: float
    share: float
    left_out: float

    @classmethod
    def of(
        cls, sent: Layer, total: NDArray[np.float64], view: Layer, share: Layer, left_out: float
    ) -> "Maxima":
        """Of layers (bands, rows, columns), and of one that is NaN at nodata."""
        known = np.nan_to_num(view)
        return cls(
            sent=float(sent.max()),
            total=float(total.max()),
            view=float(known.max()),
            kept=float((share * known).max()),
            share=float(share.max()),
            left_out=left_out,
        )


@dataclass(slots=True)
class Rest:
    """Bounds of the light that is not computed, in the largest norm.

    A bounce turns radiance of at most L into at most ``albedo V_t L``, so all that follows it adds
    at most ``π V_t L / (1 - c)`` to a cell, c being the largest albedo·V_t.

    Attributes
    ----------
    tolerance : float or None
    sent, total : float
        Largest radiance sent and irradiance, after the latest bounce.
    keeps : float
        c.
    unsent : float
        Radiance [at most] that is missing in what is sent.
    unseen : float
        Irradiance [at most] that is missing in the total.
    """

    tolerance: float | None
    sent: float = 0.0
    total: float = 0.0
    keeps: float = 0.0
    unsent: float = 0.0
    unseen: float = 0.0

    def needed(self, view: Layer) -> tuple[NDArray[np.bool_], Layer]:
        """Cells that the next bounce can change by more than a part of the tolerance; by how much.

        Parameters
        ----------
        view : ndarray, float32
            V_t; NaN at nodata.
        """
        bound = np.nan_to_num(view) * (np.pi * (self.sent + self.unsent))
        limit = 0.0
        if self.tolerance is not None:
            limit = 0.25 * self.tolerance * self.total * (1.0 - self.keeps) ** 2
        return np.asarray(bound > limit), bound

    def after(self, found: Maxima) -> float:
        """The residual after a bounce, as a share of the largest irradiance."""
        self.sent, self.total = found.sent, found.total
        self.keeps = min(found.kept, 1.0)
        self.unseen += max(found.left_out, np.pi * found.view * self.unsent)
        self.unsent = max(self.keeps * self.unsent, found.share * found.left_out * PER_PI)
        to_come = np.pi * found.view * (self.sent + self.unsent)
        if self.total == 0.0 or to_come + self.unseen == 0.0:
            return 0.0
        if self.keeps == 1.0:
            return np.inf
        return float((self.unseen + to_come / (1.0 - self.keeps)) / self.total)


def left_out(bound: Layer, needed: NDArray[np.bool_]) -> float:
    """Largest bound of the cells that are not needed."""
    return float(np.max(bound, where=~needed, initial=0.0))
