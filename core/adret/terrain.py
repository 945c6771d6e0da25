"""`Terrain`: heights in metres on a north-up grid, and where on which body they lie."""

from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adret import _heights, geodesy, rasters
from adret._values import real, whole
from adret.errors import InputError
from adret.geodesy import Band
from adret.grids import CELL_FORM, RasterGrid, TerrainView, checked_cell_size, checked_transform

if TYPE_CHECKING:
    import os

    from affine import Affine
    from pyproj import CRS

__all__ = ["Terrain"]


class Terrain:
    """Heights on a grid of rectangular cells: row 0 is north, column 0 is west.

    Parameters
    ----------
    heights : array_like, shape (rows, columns), real
        Heights; NaN and masked cells are nodata. The array is copied, never changed.
    cell_size : float or (float, float), optional
        Ground width and height (dx, dy) of a cell [m]; one number for square cells. May be left
        out when `crs` and `transform` say it.
    crs : optional
        Coordinate reference system: anything that `pyproj.CRS` takes.
    transform : affine.Affine, optional
        From (column, row) to CRS coordinates; north-up, without rotation.
    datum : float, optional
        Height [m] that is subtracted, in float64, before the heights become float32. Default is
        the middle of their range, rounded to whole metres: millimetres then survive any offset.
    vertical_unit : str
        Unit of the given heights and of nothing else: "m", "ft", "us-ft", "km", "cm", ...

    Attributes
    ----------
    heights : ndarray, shape (rows, columns), float32
        Metres above `datum`; C-contiguous, read-only, NaN at nodata.
    datum : float
        Metres to add to `heights`.
    cell_size : (float, float)
        Ground width and height of a cell [m].
    crs : pyproj.CRS or None
    transform : affine.Affine or None

    Raises
    ------
    InputError
        If heights are not a real two-dimensional array, hold infinity or no data at all, or if
        a cell size is not a positive number.

    Notes
    -----
    On geographic rasters (and cylindrical projections such as Web Mercator) metres a cell are
    those of the middle latitude, on the CRS's own ellipsoid. `azimuth_error` says what that costs
    at the northern and southern edge, `latitude_bands` cuts the raster so that it costs less.

    Examples
    --------
    >>> import numpy as np
    >>> terrain = Terrain(np.array([[1000.25, 1001.5], [np.nan, 1002.75]]), (10.0, 10.0))
    >>> terrain.datum, terrain.heights[0, 0]
    (1002.0, np.float32(-1.75))
    >>> terrain.mask[1, 0]
    np.True_
    """

    def __init__(
        self,
        heights: ArrayLike,
        cell_size: float | tuple[float, float] | None = None,
        crs: Any = None,
        transform: "Affine | None" = None,
        *,
        datum: float | None = None,
        vertical_unit: str = "m",
    ) -> None:
        values, masked = _heights.checked_array(heights)
        self._crs = geodesy.parse_crs(crs)
        self._transform = checked_transform(transform)
        if cell_size is None:
            if self._transform is None:
                raise InputError("cell_size", CELL_FORM, None)
            cell_size = geodesy.cell_size(self._crs, self._transform, values.shape)
        self._cell_size = checked_cell_size(cell_size)
        factor = geodesy.vertical_factor(vertical_unit)
        self._vertical_unit = vertical_unit
        self._heights, self._datum = _heights.above_datum(values, masked, factor, datum)
        rows, columns = values.shape
        self._grid = RasterGrid(self._crs, self._transform, (rows, columns), self._cell_size)
        self._origin = (0, 0)
        self._core = (slice(0, rows), slice(0, columns))
        self._view = TerrainView(self._heights, 0, 0)

    @classmethod
    def open(
        cls,
        path: "str | os.PathLike[str]",
        band: int = 1,
        window: tuple[Any, Any] | None = None,
        *,
        datum: float | None = None,
        vertical_unit: str | None = None,
        cell_size: float | tuple[float, float] | None = None,
    ) -> Self:
        """Read a GeoTIFF, an Arc/Info ASCII grid or a PNG.

        Parameters
        ----------
        path : path-like
            A file on disk. URLs and GDAL's virtual paths are refused, sidecar files are ignored.
        band : int
            Band number, from 1.
        window : (rows, columns), optional
            Slices or (start, stop) pairs; rows count from the north.
        datum : float, optional
            As for `Terrain`.
        vertical_unit : str, optional
            Unit of the stored heights; default is the band's unit, then the vertical axis of the
            CRS, then metres.
        cell_size : float or (float, float), optional
            Ground size of a cell [m], for files that do not say it.

        Returns
        -------
        Terrain
            Scale and offset of the band applied, nodata and masks as NaN, a south-up file turned
            so that row 0 is north.

        Raises
        ------
        RasterError
            If the file is missing, no raster, too large, complex, rotated, holds a pole in a
            geographic system, or lacks what is needed to know its cell size.

        Examples
        --------
        >>> terrain = Terrain.open("examples/data/alpine_aletsch_dhm200_lv95_200m.tif")
        >>> terrain.shape, terrain.crs.to_epsg(), round(terrain.cell_size[0])
        ((310, 358), 2056, 200)
        """
        if cell_size is not None:
            cell_size = checked_cell_size(cell_size)
        grid = rasters.open_heights(
            path, band, window, vertical_unit=vertical_unit, cell_size=cell_size
        )
        terrain = cls(grid.heights, grid.cell_size, grid.crs, grid.transform, datum=datum)
        terrain._vertical_unit = grid.vertical_unit
        return terrain

    @property
    def heights(self) -> NDArray[np.float32]:
        """Metres above `datum`, shape (rows, columns); read-only, NaN at nodata."""
        return self._heights

    @property
    def datum(self) -> float:
        """Metres to add to `heights`."""
        return self._datum

    @property
    def vertical_unit(self) -> str:
        """Unit in which the heights came; here they are metres."""
        return self._vertical_unit

    @property
    def cell_size(self) -> tuple[float, float]:
        """Ground width and height (dx, dy) of a cell [m]."""
        return self._cell_size

    @property
    def crs(self) -> "CRS | None":
        """Coordinate reference system, or None."""
        return self._crs

    @property
    def transform(self) -> "Affine | None":
        """From (column, row) to CRS coordinates, or None."""
        return self._transform

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        rows, columns = self._heights.shape
        return rows, columns

    @property
    def origin(self) -> tuple[int, int]:
        """Row and column of this window's first cell in the raster that it was cut from."""
        return self._origin

    @property
    def grid(self) -> RasterGrid:
        """The raster that this is, or was cut from."""
        return self._grid

    @property
    def view(self) -> TerrainView:
        """Heights that cells of this terrain see: their own, and of a tile what is round it."""
        return self._view

    @property
    def core(self) -> tuple[slice, slice]:
        """Rows and columns that were asked for, inside a window with a halo; else everything."""
        return self._core

    @cached_property
    def mask(self) -> NDArray[np.bool_]:
        """True where there is no data, shape (rows, columns); read-only."""
        mask = np.isnan(self._heights)
        mask.setflags(write=False)
        return mask

    def elevations(self) -> NDArray[np.float64]:
        """Heights plus datum [m], float64, NaN at nodata."""
        return self._heights.astype(np.float64) + self._datum

    @cached_property
    def azimuth_error(self) -> float:
        """Largest azimuth error in the raster [radians] from taking one cell size for all rows.

        Zero for projections whose scale is the same on both axes. It is the error of a direction
        on the ground at the receiver; a target at a longitude further by dL lies off the geodesic
        by another sin(latitude) dL / 2 (meridians converge), which no cell size can mend.
        """
        top = self._origin[0]
        return self._grid.azimuth_error_of(top, top + self.shape[0])

    def latitude_bands(self, max_azimuth_error: float) -> list[Band]:
        """Cut the rows so that within each band the azimuth error stays below a limit.

        Parameters
        ----------
        max_azimuth_error : float
            Limit [radians], above 0 and at most 0.5.

        Returns
        -------
        list of Band
            (start, stop, (dx, dy)) covering all rows in order; one band, with the terrain's own
            cell size, where that is good enough. A window is cut where the whole raster is cut.
        """
        limit = "above 0 and at most 0.5 rad"
        if real("max_azimuth_error", max_azimuth_error, limit, 0.0, 0.5) == 0.0:
            raise InputError("max_azimuth_error", limit, max_azimuth_error)
        top = self._origin[0]
        bands = self._grid.bands(top, top + self.shape[0], max_azimuth_error)
        return [Band(start - top, stop - top, size) for start, stop, size in bands]

    @cached_property
    def body_radius(self) -> float | None:
        """Mean radius of the body [m] from the CRS's ellipsoid; None without one."""
        return geodesy.body_radius(self._crs)

    @cached_property
    def grid_convergence_deg(self) -> float | None:
        """Azimuth of grid north at the centre [degrees clockwise from true north].

        Add it to an azimuth from grid north to get one from true north. Zero for geographic
        rasters; None without a CRS and a transform, and at a pole.
        """
        if self._crs is None or self._transform is None:
            return None
        return geodesy.grid_convergence(self._crs, self._transform, self.shape)

    def window(self, rows: Any, cols: Any, halo: int = 0) -> "Terrain":
        """Cut out rows and columns, with up to `halo` cells more on every side.

        Parameters
        ----------
        rows, cols : slice or (start, stop)
            The part asked for.
        halo : int
            Cells kept around it where the raster has them.

        Returns
        -------
        Terrain
            Same datum and cell size, shifted transform; `core` says where the part asked for
            lies in it. Its heights are a copy.

        Examples
        --------
        >>> import numpy as np
        >>> terrain = Terrain(np.arange(36.0).reshape(6, 6), (1, 1))
        >>> part = terrain.window((0, 2), (3, 5), halo=1)
        >>> part.shape, part.core
        ((3, 4), (slice(0, 2, None), slice(1, 3, None)))
        """
        halo = whole("halo", halo, "a whole number of cells, 0 or more", 0)
        row = rasters.span("rows", rows, self.shape[0])
        column = rasters.span("columns", cols, self.shape[1])
        top, left = max(row[0] - halo, 0), max(column[0] - halo, 0)
        bottom = min(row[1] + halo, self.shape[0])
        right = min(column[1] + halo, self.shape[1])

        view = TerrainView(self._heights[top:bottom, left:right].copy(), 0, 0)
        part = Terrain.of_view(
            view,
            view.heights.shape,
            (self._origin[0] + top, self._origin[1] + left),
            self._grid,
            self._datum,
            self._vertical_unit,
        )
        part._core = (
            slice(row[0] - top, row[1] - top),
            slice(column[0] - left, column[1] - left),
        )
        return part

    def tile(self, rows: Any, cols: Any, halo: int | None = None) -> "Terrain":
        """Cut out rows and columns that still see `halo` cells more on every side.

        Parameters
        ----------
        rows, cols : slice or (start, stop)
            The tile's own cells: what products of it cover.
        halo : int, optional
            Cells round it that its cells see, where the raster has them; None for all.

        Returns
        -------
        Terrain
            Same datum and cell size, shifted transform. Horizons of it, and all that is made of
            them, are the bytes that the whole has there, if `halo` is as wide as the range (see
            `HorizonOptions.halo`). Heights are views of this terrain's.

        Examples
        --------
        >>> import numpy as np, adret
        >>> z = np.zeros((1, 4)); z[0, 3] = 10.0
        >>> tile = adret.Terrain(z, (10.0, 10.0)).tile((0, 1), (1, 3))
        >>> east = adret.horizon_map(tile, azimuths=[np.pi / 2]).elevation
        >>> np.degrees(east[0, 0]).round(2)
        array([26.57, 45.  ], dtype=float32)
        """
        row = rasters.span("rows", rows, self.shape[0])
        column = rasters.span("columns", cols, self.shape[1])
        if halo is None:
            halo = max(self.shape)
        halo = whole("halo", halo, "a whole number of cells, 0 or more", 0)
        top, left = max(row[0] - halo, 0), max(column[0] - halo, 0)
        seen = np.ascontiguousarray(self._heights[top : row[1] + halo, left : column[1] + halo])
        corner = (top + self._origin[0], left + self._origin[1])
        view = TerrainView(seen, row[0] - top, column[0] - left)
        shape = (row[1] - row[0], column[1] - column[0])
        return Terrain.of_view(view, shape, corner, self._grid, self._datum, self._vertical_unit)

    @classmethod
    def of_view(
        cls,
        view: TerrainView,
        shape: tuple[int, int],
        corner: tuple[int, int],
        grid: RasterGrid,
        datum: float,
        vertical_unit: str = "m",
    ) -> "Terrain":
        """The tile of `shape` rows and columns of a raster that need never be read as a whole.

        `view` is what the tile sees, float32 metres above `datum`, NaN at nodata; it begins at row
        and column `corner` of the whole raster, which `grid` describes.
        """
        tile = object.__new__(cls)
        view.heights.setflags(write=False)
        heights = view.heights[view.top : view.top + shape[0], view.left : view.left + shape[1]]
        tile._heights = np.ascontiguousarray(heights)
        tile._heights.setflags(write=False)
        tile._view = view
        tile._datum = datum
        tile._vertical_unit = vertical_unit
        tile._grid = grid
        tile._cell_size = grid.cell_size
        tile._crs = grid.crs
        tile._origin = (corner[0] + view.top, corner[1] + view.left)
        tile._transform = None
        if grid.transform is not None:
            tile._transform = geodesy.shifted(grid.transform, tile._origin[1], tile._origin[0])
        tile._core = (slice(0, shape[0]), slice(0, shape[1]))
        return tile

    def __repr__(self) -> str:
        """Size, cell size and reference system."""
        dx, dy = self._cell_size
        name = "no CRS" if self._crs is None else self._crs.name
        return f"Terrain({self.shape[0]} x {self.shape[1]}, {dx:g} x {dy:g} m, {name})"
