"""Heights that are read by windows: one raster file, or many that lie on one grid."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from adret import _heights, geodesy, rasters
from adret._gdal import PathLike
from adret.errors import InputError, RasterError
from adret.grids import RasterGrid, TerrainView
from adret.terrain import Terrain
from adret.tiling.surroundings import Surroundings

if TYPE_CHECKING:
    from affine import Affine

__all__ = ["Piece", "Surface"]

GRID_TOLERANCE = 1e-3  # cells by which a file may lie off the grid of the first one
READ_ROWS = 512  # rows that are read at once to find the range of heights

Span = tuple[int, int]
Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Piece:
    """A file, and where its first cell lies on the surface."""

    path: str
    row: int
    column: int
    shape: tuple[int, int]


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """One height field from one file or from several, never read as a whole.

    Attributes
    ----------
    pieces : tuple of Piece
        Of two files that hold the same cell the earlier one counts, unless it is nodata there.
    grid : RasterGrid
        The whole surface; cells in no file are nodata.
    band : int
        Of every file, from 1.
    vertical_unit : str
        In which the heights are stored.
    item_size : int
        Largest number of bytes a stored height.
    datum : float
        Height [m] subtracted from all; that of `Terrain.open` of the same raster.
    surroundings : Surroundings or None
        Ground beyond the surface's edges, for tiles with a range.

    Examples
    --------
    >>> surface = Surface.open(["examples/data/alpine_aletsch_dhm200_lv95_200m.tif"])
    >>> surface.grid.shape, surface.datum
    ((310, 358), 2359.0)
    >>> surface.tile((0, 100), (0, 100), halo=20).view.heights.shape
    (120, 120)
    """

    pieces: tuple[Piece, ...]
    grid: RasterGrid
    band: int
    vertical_unit: str
    item_size: int
    datum: float
    surroundings: Surroundings | None = None

    @classmethod
    def open(
        cls,
        paths: Sequence[PathLike],
        band: int = 1,
        *,
        vertical_unit: str | None = None,
        cell_size: tuple[float, float] | None = None,
        datum: float | None = None,
        surroundings: PathLike | None = None,
        progress: Progress | None = None,
    ) -> Self:
        """Read the headers and, unless a datum is given, once every height, for their range.

        Raises
        ------
        RasterError
            If a file cannot be used, or does not lie on the grid of the first one.
        InputError
            If an option is out of range or all cells are nodata.
        """
        if not paths:
            raise InputError("source", "at least one file", "none")
        headers = {
            str(Path(path).absolute()): rasters.open_header(
                path, band, vertical_unit=vertical_unit, cell_size=cell_size
            )
            for path in paths
        }
        pieces, grid = _laid_out(headers, cell_size)
        first = next(iter(headers.values()))
        item = max(header.item_size for header in headers.values())
        if datum is None:
            unranged = cls(pieces, grid, band, first.vertical_unit, item, 0.0)
            datum = _heights.middle(*unranged._range(progress))
        border = None if surroundings is None else Surroundings.open(surroundings, grid)
        return cls(pieces, grid, band, first.vertical_unit, item, datum, border)

    def tile(self, rows: Span, columns: Span, halo: int | None) -> Terrain:
        """The tile that `Terrain.open(...).tile(rows, columns, halo)` would be.

        With surroundings it sees them too, as far as its halo goes, and needs one.
        """
        n, m = self.grid.shape
        if self.surroundings is not None:
            if halo is None:
                raise InputError("max_distance", "given with surroundings", None)
            down, across = (rows[0] - halo, rows[1] + halo), (columns[0] - halo, columns[1] + halo)
        else:
            reach = max(n, m) if halo is None else halo
            down = max(rows[0] - reach, 0), min(rows[1] + reach, n)
            across = max(columns[0] - reach, 0), min(columns[1] + reach, m)
        view = TerrainView(self.heights(down, across), rows[0] - down[0], columns[0] - across[0])
        shape = (rows[1] - rows[0], columns[1] - columns[0])
        corner = (down[0], across[0])
        return Terrain.of_view(view, shape, corner, self.grid, self.datum, self.vertical_unit)

    def heights(self, rows: Span, columns: Span) -> NDArray[np.float32]:
        """Metres above the datum, float32, NaN at nodata."""
        out = np.full((rows[1] - rows[0], columns[1] - columns[0]), np.nan, np.float32)
        for part, values in self._windows(rows, columns):
            target = out[part]
            empty = np.isnan(target)
            above = np.subtract(values, self.datum, dtype=np.float64)
            np.copyto(target, above, where=empty, casting="same_kind")
        if self.surroundings is not None:
            self.surroundings.fill(out, self.grid, rows, columns, self.datum)
        return out

    def _windows(
        self, rows: Span, columns: Span
    ) -> Iterator[tuple[tuple[slice, slice], NDArray[np.floating[Any]]]]:
        """What every file holds of a window: where in the window, and the stored heights [m].

        In bands of rows, so that numbers in float64 never fill a whole window.
        """
        for piece in self.pieces:
            top, bottom = _overlap(rows, piece.row, piece.shape[0])
            left, right = _overlap(columns, piece.column, piece.shape[1])
            if left >= right:
                continue
            for start in range(top, bottom, READ_ROWS):
                stop = min(start + READ_ROWS, bottom)
                found = rasters.open_heights(
                    piece.path,
                    self.band,
                    (
                        (start - piece.row, stop - piece.row),
                        (left - piece.column, right - piece.column),
                    ),
                    vertical_unit=self.vertical_unit,
                    cell_size=self.grid.cell_size,
                )
                part = (
                    slice(start - rows[0], stop - rows[0]),
                    slice(left - columns[0], right - columns[0]),
                )
                yield part, found.heights

    def _range(self, progress: Progress | None) -> tuple[float, float]:
        """Lowest and highest height [m]."""
        n, m = self.grid.shape
        low, high = math.inf, -math.inf
        total = sum(piece.shape[0] for piece in self.pieces)
        done = 0
        for _, values in self._windows((0, n), (0, m)):
            low = min(low, float(np.fmin.reduce(values, axis=None, initial=np.inf)))
            high = max(high, float(np.fmax.reduce(values, axis=None, initial=-np.inf)))
            done += len(values)
            if progress is not None:
                progress(done, total)
        _heights.check_range(low, high)
        return low, high


def _overlap(span: Span, start: int, length: int) -> Span:
    return max(span[0], start), min(span[1], start + length)


def _laid_out(
    headers: dict[str, rasters.HeightHeader], cell_size: tuple[float, float] | None
) -> tuple[tuple[Piece, ...], RasterGrid]:
    """Every file on one grid."""
    names = list(headers)
    first = headers[names[0]]
    if len(names) == 1:
        grid = RasterGrid(first.crs, first.transform, first.shape, first.cell_size)
        return (Piece(names[0], 0, 0, first.shape),), grid
    if first.transform is None:
        raise RasterError("transform", "given, to lay files side by side", names[0])
    corners = {name: _corner(name, header, first) for name, header in headers.items()}
    top = min(row for row, _ in corners.values())
    left = min(column for _, column in corners.values())
    pieces = tuple(
        Piece(name, corners[name][0] - top, corners[name][1] - left, headers[name].shape)
        for name in names
    )
    rows = max(piece.row + piece.shape[0] for piece in pieces)
    columns = max(piece.column + piece.shape[1] for piece in pieces)
    transform = _corner_transform(headers, corners, top, left)
    size = cell_size
    if size is None:
        size = geodesy.cell_size(first.crs, transform, (rows, columns))
    return pieces, RasterGrid(first.crs, transform, (rows, columns), size)


def _corner(
    name: str, header: rasters.HeightHeader, first: rasters.HeightHeader
) -> tuple[int, int]:
    """Row and column of a file's first cell, counted from that of the first file."""
    transform, origin = header.transform, first.transform
    assert origin is not None
    if transform is None:
        raise RasterError("transform", "given, to lay files side by side", name)
    if header.crs != first.crs:
        raise RasterError("crs", "that of the first file", name)
    if header.vertical_unit != first.vertical_unit:
        raise RasterError("vertical unit", f"{first.vertical_unit}, as in the first file", name)
    length = max(*header.shape, *first.shape)
    for one, other in ((transform.a, origin.a), (transform.e, origin.e)):
        if abs(one / other - 1.0) * length > GRID_TOLERANCE:
            raise RasterError("cell size", "that of the first file", name)
    place = ((transform.f - origin.f) / origin.e, (transform.c - origin.c) / origin.a)
    row, column = round(place[0]), round(place[1])
    if max(abs(place[0] - row), abs(place[1] - column)) > GRID_TOLERANCE:
        raise RasterError("transform", "on the grid of the first file", name)
    return row, column


def _corner_transform(
    headers: dict[str, rasters.HeightHeader],
    corners: dict[str, tuple[int, int]],
    top: int,
    left: int,
) -> "Affine":
    """The geotransform of the whole: edges are those of the files that reach furthest."""
    west = next(headers[name].transform for name, (_, column) in corners.items() if column == left)
    north = next(headers[name].transform for name, (row, _) in corners.items() if row == top)
    assert west is not None
    assert north is not None
    return type(west)(west.a, 0.0, west.c, 0.0, north.e, north.f)
