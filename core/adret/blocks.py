"""Square blocks of a raster that show no ground, or level ground: what a sweep need not look at."""

from typing import NamedTuple

import numpy as np

from adret import skips
from adret._kernels.ground import SIDE
from adret.directions import Layer, Orientation

__all__ = ["Blocks"]


class Blocks(NamedTuple):
    """Lowest and highest heights of square blocks of `SIDE` cells.

    Attributes
    ----------
    low : ndarray, shape (block rows, block columns), float32
        Lowest height [m above the datum]; NaN where a cell is nodata.
    high : ndarray, shape (block rows, block columns), float32
        Highest height [m above the datum]; NaN where every cell is nodata.
    corner : (int, int)
        Rows and columns by which the first block begins before the raster.
    """

    low: Layer
    high: Layer
    corner: tuple[int, int] = (0, 0)

    @classmethod
    def of(cls, heights: Layer) -> "Blocks":
        """Look at every cell once; skips that are switched off find no block."""
        low, high = _reduced(np.minimum, heights), _reduced(np.fmax, heights)
        if not skips.wanted("nodata"):
            high = np.where(np.isnan(high), np.inf, high)
        if not skips.wanted("level ground"):
            low = np.where(low == high, -np.inf, low)
        return cls(low, high)

    @classmethod
    def unknown(cls, shape: tuple[int, int]) -> "Blocks":
        """Of a raster that nobody looked at."""
        rows, columns = (-(-size // SIDE) for size in shape)
        unknown = np.full((rows, columns), np.inf, np.float32)
        return cls(-unknown, unknown)

    def turned(self, orientation: Orientation, shape: tuple[int, int]) -> "Blocks":
        """The same in a sweep frame, for a raster of `shape` in that frame."""
        o = orientation
        flips = (
            slice(None, None, -1 if o.flip_rows else 1),
            slice(None, None, -1 if o.flip_columns else 1),
        )
        low, high = (np.ascontiguousarray((a.T if o.swap else a)[flips]) for a in self[:2])
        return Blocks(
            low, high, (-shape[0] % SIDE * o.flip_rows, -shape[1] % SIDE * o.flip_columns)
        )


def _reduced(ufunc: np.ufunc, heights: Layer) -> Layer:
    """One number a block: rows first, many columns at once, then the few rows that are left."""
    rows, columns = heights.shape
    whole = rows // SIDE * SIDE
    parts = ufunc.reduce(heights[:whole].reshape(-1, SIDE, columns), axis=1)
    if whole < rows:
        parts = np.concatenate([parts, ufunc.reduce(heights[whole:], axis=0, keepdims=True)])
    layer: Layer = ufunc.reduceat(parts, np.arange(0, columns, SIDE), axis=1)
    return layer
