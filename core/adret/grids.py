"""The raster that a terrain is, or was cut from: where its rows lie and how large its cells are."""

import math
from dataclasses import dataclass
from functools import cached_property
from numbers import Real
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from adret import geodesy
from adret._values import real
from adret.errors import InputError
from adret.geodesy import Band

if TYPE_CHECKING:
    from affine import Affine
    from pyproj import CRS

__all__ = [
    "CELL_FORM",
    "Frames",
    "RasterGrid",
    "TerrainView",
    "checked_cell_size",
    "checked_transform",
]

CELL_LIMITS = (1e-6, 1e7)
CELL_FORM = "metres: a number or a pair (dx, dy)"


@dataclass(frozen=True, eq=False)
class RasterGrid:
    """Place and cell sizes of a whole raster, shared by all windows and tiles that are cut from it.

    Everything that hangs on the latitude is asked here, in rows of the whole raster: a part of it
    is then treated exactly as the whole is.

    Attributes
    ----------
    crs : pyproj.CRS or None
    transform : affine.Affine or None
        North-up.
    shape : (int, int)
        Rows and columns.
    cell_size : (float, float)
        Ground width and height of a cell [m], at the middle row.
    """

    crs: "CRS | None"
    transform: "Affine | None"
    shape: tuple[int, int]
    cell_size: tuple[float, float]

    @cached_property
    def azimuth_error(self) -> float:
        """Largest azimuth error in the raster [radians] from one cell size for all rows."""
        return self.azimuth_error_of(0, self.shape[0])

    def azimuth_error_of(self, start: int, stop: int) -> float:
        """As `azimuth_error`, in rows start..stop."""
        if self._rows is None:
            return 0.0
        return self._rows.azimuth_error(self.cell_size, start, stop)

    def bands(self, start: int, stop: int, limit: float) -> list[Band]:
        """Bands of rows start..stop whose azimuth error stays below `limit` [radians]."""
        if self._rows is None or self.azimuth_error <= limit:
            return [Band(start, stop, self.cell_size)]
        return self._rows.bands(start, stop, limit)

    @cached_property
    def _rows(self) -> geodesy.RowWiseGrid | None:
        return geodesy.row_wise_grid(self.crs, self.transform, self.shape)


class Frames(Protocol):
    """Turned copies of a whole raster, kept outside of memory."""

    def heights(self) -> NDArray[np.float32]:
        """The whole raster [m above the datum], north-up."""

    def frame(self, orientation: Any, near: int) -> NDArray[np.float32]:
        """The padded heights of a sweep frame."""

    def drop(self) -> None:
        """Let go of the memory of what was touched."""

    def upside_down(self) -> "Frames":
        """The same of the raster turned upside down."""


class TerrainView(NamedTuple):
    """What a terrain sees.

    Attributes
    ----------
    heights : ndarray, shape (rows, columns), float32
        Metres above the datum.
    top, left : int
        Row and column of `heights` at which the terrain begins.
    frames : Frames or None
        Of a tile that sees the whole of a raster larger than memory.
    """

    heights: NDArray[np.float32]
    top: int
    left: int
    frames: Frames | None = None


def checked_cell_size(cell_size: Any) -> tuple[float, float]:
    """A pair of metres as numbers in range; one number stands for a square."""
    try:
        if isinstance(cell_size, str | bytes):
            raise TypeError("text")
        dx, dy = (cell_size, cell_size) if isinstance(cell_size, Real) else cell_size
    except (TypeError, ValueError):
        raise InputError("cell_size", CELL_FORM, cell_size) from None
    low, high = CELL_LIMITS
    limit = f"between {low:g} and {high:g} m"
    return real("cell_size", dx, limit, low, high), real("cell_size", dy, limit, low, high)


def checked_transform(transform: Any) -> "Affine | None":
    """A north-up geotransform, or None."""
    if transform is None:
        return None
    from affine import Affine

    try:
        affine = Affine(*tuple(transform)[:6])
    except (TypeError, ValueError):
        raise InputError("transform", "an affine.Affine", transform) from None
    a, b, _, d, e, _ = affine[:6]
    if not all(math.isfinite(v) for v in affine[:6]) or not (a > 0.0 > e and b == 0.0 == d):
        raise InputError("transform", "north-up, without rotation", tuple(affine[:6]))
    return affine
