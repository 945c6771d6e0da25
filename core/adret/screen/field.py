"""What every method over a depth buffer gets: arrays ready for kernels."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Field"]


class Field(NamedTuple):
    """Depths and normals in view space, contiguous, checked.

    View space is (right, up, back), right-handed, the eye at the origin. The point of pixel
    (row, column) at depth z is, with (ax, bx, ay, by) = `rays`,

    - perspective: (z (ax column + bx), z (ay row + by), -z),
    - orthographic: (ax column + bx, ay row + by, -z).

    Between pixel centres the surface is bilinear: 1/z in perspective (so that planes stay planes),
    z in orthographic projection.

    Attributes
    ----------
    depth : ndarray, shape (rows, columns), float32
        Depth along the viewing axis [view units] at pixel centres; NaN at sky and holes.
    normal : ndarray, shape (3, rows, columns), float32
        Unit normals (right, up, back) that face the eye; NaN where the depth is.
    rays : ndarray, shape (4,), float64
        ax, bx, ay, by; ax > 0 > ay.
    perspective : bool
    frame : (int, int, int, int)
        row0, row1, column0, column1: the receivers. What lies outside, the guard band, occludes
        only. Estimates have the shape (row1 - row0, column1 - column0).
    origin : (int, int)
        Row and column of this field's corner in the whole buffer; noise counts from there.
    second : ndarray, shape (rows, columns) or (0, 0), float32
        Depth of a second layer behind the first, NaN where there is none.
    """

    depth: NDArray[np.float32]
    normal: NDArray[np.float32]
    rays: NDArray[np.float64]
    perspective: bool
    frame: tuple[int, int, int, int]
    origin: tuple[int, int] = (0, 0)
    second: NDArray[np.float32] = np.zeros((0, 0), dtype=np.float32)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the frame: the shape of every estimate."""
        row0, row1, column0, column1 = self.frame
        return row1 - row0, column1 - column0
