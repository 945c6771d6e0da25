"""Sums over many layers that stay exact: float32 for a few layers at a time, float64 for all."""

import numpy as np
from numpy.typing import NDArray

from adret._kernels import horizon_integrals as kernels

__all__ = ["LayerSum"]

# Adding 32 equal terms in float32 is off by less than 1e-6 of the sum.
LAYERS_AT_A_TIME = 32


class LayerSum:
    """Sum of `count` layers of shape (bands, rows, columns), fed by kernels that add to `layer`.

    Parameters
    ----------
    shape : (int, int, int)
        Bands, rows and columns.
    count : int
        Number of layers that may be added; above 32 a float64 total is kept as well.

    Notes
    -----
    A sum in floating point hangs on its order and on where it is rounded. Layers that add nothing
    may be left out without a trace when the others say their number: `at`.
    """

    def __init__(self, shape: tuple[int, int, int], count: int) -> None:
        self.layer: NDArray[np.float32] = np.zeros(shape, dtype=np.float32)
        self._total = np.zeros(shape) if count > LAYERS_AT_A_TIME else None
        self._added = 0

    def at(self, number: int) -> None:
        """Say that what is added next is layer `number`, from 0; those in between are zero."""
        if (
            self._total is not None
            and number // LAYERS_AT_A_TIME != (self._added - 1) // LAYERS_AT_A_TIME
        ):
            self._drain(self._total)
        self._added = number

    def added(self) -> None:
        """Say that one more layer has been added to `layer`."""
        self._added += 1
        if self._total is not None and self._added % LAYERS_AT_A_TIME == 0:
            self._drain(self._total)

    def total(self) -> NDArray[np.float32] | NDArray[np.float64]:
        """Everything that was added."""
        if self._total is None:
            return self.layer
        self._drain(self._total)
        return self._total

    def _drain(self, total: NDArray[np.float64]) -> None:
        for few, out in zip(self.layer, total, strict=True):
            kernels.drain(few, out)
