"""How much an occluder counts by its distance."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adret._kernels.screen import falloffs as kernels
from adret.errors import InputError

__all__ = ["Falloff", "FalloffName", "make_falloff"]

FalloffName = Literal["none", "hard", "quadratic", "timonen"]
CODES = {
    "none": kernels.NONE,
    "hard": kernels.HARD,
    "quadratic": kernels.QUADRATIC,
    "timonen": kernels.TIMONEN,
}
TABLE_SIZE = 16_385
FAR = 1e30
"""What stands for an infinite distance when a callable is asked."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Falloff:
    """Weight W(d) of an occluder at distance d, between 0 and 1; 0 from `radius` on.

    Attributes
    ----------
    name : str
        "none" 1, "hard" 1, "quadratic" 1 - (d/R)², "timonen" r/(r + d²), or "callable". Each is cut
        off at the radius, so "hard" is "none" by another name; both are 1 when R is infinite, and
        so is "quadratic".
    radius : float
        R [view units], may be infinite.
    scale : float
        r of "timonen" [view units squared]; of a callable: the distance in the middle of its table
        [view units].
    function : callable or None
        What was given, for "callable".
    table : ndarray, float64
        A callable's values over u = d/(d + scale) from 0 to 1; empty for the others.

    Examples
    --------
    >>> make_falloff("quadratic", 2.0).weight([0.0, 1.0, 3.0])
    array([1.  , 0.75, 0.  ])
    """

    name: str
    radius: float
    scale: float
    function: Callable[[Any], Any] | None
    table: NDArray[np.float64]

    @property
    def code(self) -> int:
        """Number by which kernels know it."""
        if math.isinf(self.radius) and self.name in ("hard", "quadratic"):
            return kernels.NONE
        return CODES.get(self.name, kernels.TABLE)

    @property
    def numbers(self) -> tuple[int, float, float, NDArray[np.float64]]:
        """What `_kernels.screen.falloffs.weight` takes before d: code, radius, scale, table."""
        return self.code, self.radius, self.scale, self.table

    def weight(self, d: ArrayLike) -> NDArray[np.float64]:
        """Weights at distances d [view units], float64; a callable is asked itself."""
        distance = np.asarray(d, dtype=np.float64)
        if self.function is not None:
            values = np.asarray(self.function(np.minimum(distance, FAR)), dtype=np.float64)
        elif self.code == kernels.QUADRATIC:
            values = 1.0 - (distance / self.radius) ** 2
        elif self.code == kernels.TIMONEN:
            values = self.scale / (self.scale + distance**2)
        else:
            values = np.ones_like(distance)
        return np.where(distance < self.radius, values, 0.0)

    def tabulated(self, size: int = TABLE_SIZE) -> NDArray[np.float64]:
        """W over u = d/(d + scale), u = 0 to 1 in `size` equal steps, 0 from the radius on."""
        return self.weight(_distances(self.scale, size))


def make_falloff(falloff: object, radius: float = math.inf, falloff_scale: float = 1.0) -> Falloff:
    """The falloff of a name or of a callable.

    Parameters
    ----------
    falloff : str or callable
        One of "none", "hard", "quadratic", "timonen", or d -> W that takes an array of distances
        [view units] and returns weights between 0 and 1.
    radius : float
        R [view units], above 0; may be infinite.
    falloff_scale : float
        r of "timonen" [view units squared].

    Returns
    -------
    Falloff

    Raises
    ------
    InputError
        If the name is unknown, a number out of range, or a callable returns anything but numbers
        between 0 and 1.

    References
    ----------
    "quadratic": L. Bavoil and M. Sainz, "Image-Space Horizon-Based Ambient Occlusion", ShaderX7,
    2009. "timonen": V. Timonen, "Screen-Space Far-Field Ambient Obscurance", 2013.

    Examples
    --------
    >>> import numpy as np
    >>> make_falloff(lambda d: np.exp(-d)).weight(1.0).round(4)
    np.float64(0.3679)
    """
    if not (isinstance(radius, int | float) and radius > 0.0):
        raise InputError("radius", "a number above 0", radius)
    if not (isinstance(falloff_scale, int | float) and 0.0 < falloff_scale < math.inf):
        raise InputError("falloff_scale", "a number above 0", falloff_scale)
    scale = float(falloff_scale)
    empty = np.zeros(0)
    if isinstance(falloff, str) and falloff in CODES:
        return Falloff(name=falloff, radius=float(radius), scale=scale, function=None, table=empty)
    if not callable(falloff):
        raise InputError("falloff", f"one of {', '.join(CODES)} or a callable", falloff)
    middle = float(radius) if math.isfinite(radius) else scale
    return Falloff(
        name="callable",
        radius=float(radius),
        scale=middle,
        function=falloff,
        table=_asked(falloff, _distances(middle, TABLE_SIZE)),
    )


def _distances(scale: float, size: int) -> NDArray[np.float64]:
    """Distances d of u = d/(d + scale) in equal steps from 0 to 1, at most `FAR`."""
    u = np.linspace(0.0, 1.0, size)
    with np.errstate(divide="ignore"):
        return np.minimum(scale * u / (1.0 - u), FAR)


def _asked(function: Callable[[Any], Any], d: NDArray[np.float64]) -> NDArray[np.float64]:
    try:
        values = np.broadcast_to(np.asarray(function(d), dtype=np.float64), d.shape)
    except Exception as error:
        raise InputError("falloff", "a callable of an array of distances", repr(error)) from error
    wrong = ~((values >= 0.0) & (values <= 1.0))
    if wrong.any():
        first = int(np.argmax(wrong))
        raise InputError("falloff", f"between 0 and 1 (at d = {d[first]:g})", float(values[first]))
    return np.ascontiguousarray(values)
