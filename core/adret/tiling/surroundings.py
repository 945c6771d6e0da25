"""Ground round a surface from a second, coarser raster: what the far field may see beyond the edge.

Between its cell centres the coarse raster is interpolated linearly along rows and columns, at the
centres of the surface's own cells, so that a sweep sees one raster. If the heights so found are off
by at most e, and a receiver is no nearer than d to them, the tangent of its horizon is off by at
most e / d: every slope of its rays is, and a maximum moves no more than what it is taken of.
"""

import os
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from adret import rasters
from adret._gdal import PathLike
from adret.errors import RasterError
from adret.grids import RasterGrid

__all__ = ["Surroundings"]

READ_ROWS = 512

Span = tuple[int, int]
Heights = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """A coarser raster in the reference system of a surface.

    Attributes
    ----------
    path : str
    band : int
    grid : RasterGrid
        Of the coarse raster.
    vertical_unit : str
    """

    path: str
    band: int
    grid: RasterGrid
    vertical_unit: str

    @classmethod
    def open(cls, path: PathLike, surface: RasterGrid, band: int = 1) -> Self:
        """Read the header.

        Raises
        ------
        RasterError
            If the file cannot be used, or is not in the surface's reference system.
        """
        header = rasters.open_header(path, band)
        if header.crs != surface.crs:
            raise RasterError("surroundings", "in the raster's reference system", os.fspath(path))
        if header.transform is None or surface.transform is None:
            raise RasterError("surroundings", "with a geotransform, as the raster", os.fspath(path))
        grid = RasterGrid(header.crs, header.transform, header.shape, header.cell_size)
        return cls(os.path.abspath(path), band, grid, header.vertical_unit)

    def fill(
        self,
        target: NDArray[np.float32],
        surface: RasterGrid,
        rows: Span,
        columns: Span,
        datum: float,
    ) -> None:
        """Fill the cells of a window that lie outside of the surface [m above the datum].

        Parameters
        ----------
        target : ndarray, float32
            The window; cells of the surface in it stay as they are.
        surface : RasterGrid
        rows, columns : (int, int)
            Of the window, counted from the surface's first cell; they may be negative.
        datum : float
        """
        n, m = surface.shape
        inner = max(columns[0], 0) - columns[0], min(columns[1], m) - columns[0]
        for start in range(rows[0], rows[1], READ_ROWS):
            stop = min(start + READ_ROWS, rows[1])
            found = np.asarray(
                self._heights(surface, (start, stop), columns) - datum, dtype=np.float32
            )
            part = target[start - rows[0] : stop - rows[0]]
            first, last = max(start, 0) - start, min(stop, n) - start
            if last > first:
                kept = part[first:last, inner[0] : inner[1]].copy()
                part[:] = found
                part[first:last, inner[0] : inner[1]] = kept
            else:
                part[:] = found

    def _heights(self, surface: RasterGrid, rows: Span, columns: Span) -> Heights:
        """Interpolated heights at the centres of the surface's cells, NaN where there are none."""
        down, f_down = self._places("f", "e", surface, rows, 0)
        across, f_across = self._places("c", "a", surface, columns, 1)
        n, m = self.grid.shape
        top, bottom = max(int(down[0]), 0), min(int(down[-1]) + 2, n)
        left, right = max(int(across[0]), 0), min(int(across[-1]) + 2, m)
        if top >= bottom or left >= right:
            return np.full((rows[1] - rows[0], columns[1] - columns[0]), np.nan)
        known = rasters.open_heights(
            self.path,
            self.band,
            ((top, bottom), (left, right)),
            vertical_unit=self.vertical_unit,
            cell_size=self.grid.cell_size,
        ).heights.astype(np.float64)
        above = _at(known, down - top, 0), _at(known, down + 1 - top, 0)
        along = _mixed(*above, f_down[:, None])
        before = _at(along, across - left, 1), _at(along, across + 1 - left, 1)
        return _mixed(*before, f_across[None, :])

    def _places(
        self, origin: str, step: str, surface: RasterGrid, span: Span, axis: int
    ) -> tuple[NDArray[np.int64], Heights]:
        """Coarse cells before the centres of a span of fine ones, and the shares of the next."""
        fine: Any = surface.transform
        coarse: Any = self.grid.transform
        centres = getattr(fine, origin) + getattr(fine, step) * (np.arange(*span) + 0.5)
        place = (centres - getattr(coarse, origin)) / getattr(coarse, step) - 0.5
        cell = np.floor(place)
        return cell.astype(np.int64), place - cell


def _at(known: Heights, index: NDArray[np.int64], axis: int) -> Heights:
    """Rows or columns by index; NaN outside."""
    inside = (index >= 0) & (index < known.shape[axis])
    found = np.take(known, np.where(inside, index, 0), axis=axis)
    if axis == 0:
        found[~inside] = np.nan
    else:
        found[:, ~inside] = np.nan
    return np.asarray(found)


def _mixed(one: Heights, other: Heights, share: Heights) -> Heights:
    """Between two; the first alone where the second's share is nothing, even if that is NaN."""
    return np.where(share == 0.0, one, one * (1.0 - share) + other * share)
