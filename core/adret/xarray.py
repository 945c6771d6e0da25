"""Heights in xarray: ``import adret.xarray`` gives every two-dimensional DataArray ``.adret``.

A DataArray whose data are a Dask array gives a lazy result of the same chunks: each chunk is an
exact tile, the bytes of the eager result. Needs ``pip install "adret[xarray]"``.
"""

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any, Unpack

import numpy as np
import xarray as xr
from affine import Affine
from numpy.typing import ArrayLike, NDArray

from adret import _heights, geodesy
from adret.azimuths import azimuth_set
from adret.errors import InputError
from adret.grids import RasterGrid, TerrainView
from adret.horizon import HorizonOptions, horizon_map
from adret.horizon_keywords import HorizonKeywords
from adret.light import direct_light
from adret.shadows import shadow
from adret.skies import Sun
from adret.sky_view import Kind, openness, sky_view_factor
from adret.slices import Sky
from adret.terrain import Terrain

__all__ = ["HeightAccessor"]

EVEN = 1e-4  # of a cell by which coordinates may lie off an even grid
Layers = NDArray[Any]
Compute = Callable[[Terrain], Layers]


@xr.register_dataarray_accessor("adret")
class HeightAccessor:
    """Horizons and light of heights [m] on an even grid.

    The last two dimensions are rows and columns; their coordinates give the grid, rows in either
    direction. The reference system is that of the coordinate ``spatial_ref`` (as rioxarray and
    odc-geo write it) or of the attribute ``crs``; without one, coordinates are metres. NaN and the
    attribute ``_FillValue`` are nodata.

    Examples
    --------
    >>> import numpy as np, xarray as xr, adret.xarray
    >>> heights = xr.DataArray(
    ...     np.zeros((4, 5), "f4"), dims=("y", "x"),
    ...     coords={"y": [35.0, 25.0, 15.0, 5.0], "x": [5.0, 15.0, 25.0, 35.0, 45.0]},
    ... )
    >>> float(heights.adret.sky_view_factor(directions=8)[1, 2])
    1.0
    """

    def __init__(self, heights: xr.DataArray) -> None:
        self._heights = heights

    def terrain(self) -> Terrain:
        """The heights as a `Terrain`; reads all of them."""
        array, grid = self._north_up()
        return Terrain(np.asarray(array), grid.cell_size, grid.crs, grid.transform)

    def horizon_map(
        self,
        directions: int = 64,
        *,
        azimuths: ArrayLike | None = None,
        **horizon: Unpack[HorizonKeywords],
    ) -> xr.DataArray:
        """Horizon elevation [radians], with a leading dimension ``azimuth``.

        Parameters
        ----------
        directions, azimuths, **horizon
            As for `adret.horizon_map`.

        Returns
        -------
        DataArray, shape (K, rows, columns), float32
        """
        towards = azimuth_set(directions, azimuths)

        def compute(terrain: Terrain) -> Layers:
            return horizon_map(terrain, azimuths=towards, **horizon).elevation

        attributes = {"long_name": "elevation of the horizon", "units": "rad"}
        return self._applied(compute, horizon, attributes, {"azimuth": towards})

    def sky_view_factor(
        self,
        kind: Kind = "visible",
        directions: int = 64,
        clip: bool = True,
        **horizon: Unpack[HorizonKeywords],
    ) -> xr.DataArray:
        """Share of the sky that each cell sees [-]; parameters as for `adret.sky_view_factor`."""

        def compute(terrain: Terrain) -> Layers:
            return sky_view_factor(terrain, kind, directions, clip, **horizon)

        return self._applied(compute, horizon, {"long_name": f"sky view ({kind})", "units": "1"})

    def openness(
        self, sign: Any = 1, directions: int = 64, **horizon: Unpack[HorizonKeywords]
    ) -> xr.DataArray:
        """Openness [degrees]; parameters as for `adret.openness`."""

        def compute(terrain: Terrain) -> Layers:
            return openness(terrain, sign, directions, **horizon)

        return self._applied(compute, horizon, {"long_name": "openness", "units": "degree"})

    def shadow(self, sun: Sun, **horizon: Unpack[HorizonKeywords]) -> xr.DataArray:
        """Share of a sun's disc that each cell sees [-]; parameters as for `adret.shadow`."""

        def compute(terrain: Terrain) -> Layers:
            return shadow(terrain, sun, **horizon).lit

        attributes = {"long_name": "share of the solar disc", "units": "1"}
        return self._applied(compute, horizon, attributes)

    def direct_light(
        self, sky: Sky, directions: int = 64, **horizon: Unpack[HorizonKeywords]
    ) -> xr.DataArray:
        """Irradiance in the sky's unit; parameters as for `adret.direct_light`.

        A sky of three bands gives a leading dimension ``band``.
        """

        def compute(terrain: Terrain) -> Layers:
            found = direct_light(terrain, sky, directions, **horizon).irradiance
            return found if found.ndim == 2 else np.ascontiguousarray(np.moveaxis(found, 2, 0))

        bands = {} if sky.bands == 1 else {"band": np.array(["red", "green", "blue"])}
        return self._applied(compute, horizon, {"long_name": "irradiance"}, bands)

    def _north_up(self) -> tuple[Any, RasterGrid]:
        """The data with row 0 in the north, nodata as NaN, and their grid."""
        heights = self._heights
        if heights.ndim != 2:
            raise InputError("heights", "two-dimensional (rows, columns)", heights.dims)
        rows, columns = (heights[name].values for name in heights.dims)
        down, across = _step("rows", rows), _step("columns", columns)
        if across < 0.0:
            raise InputError("columns", "running east", across)
        array = heights.data
        if down > 0.0:
            array, rows, down = array[::-1], rows[::-1], -down
        fill = heights.attrs.get("_FillValue", heights.encoding.get("_FillValue"))
        if fill is not None and not np.isnan(fill):
            array = np.where(array == fill, np.float64(np.nan), array)
        transform = Affine(
            across, 0.0, float(columns[0]) - across / 2.0, 0.0, down, float(rows[0]) - down / 2.0
        )
        crs = geodesy.parse_crs(self._crs())
        shape = (int(array.shape[0]), int(array.shape[1]))
        return array, RasterGrid(crs, transform, shape, geodesy.cell_size(crs, transform, shape))

    def _crs(self) -> Any:
        """What the DataArray says about its reference system; None if nothing."""
        for name in (self._heights.encoding.get("grid_mapping"), "spatial_ref"):
            if name in self._heights.coords:
                known = self._heights[name].attrs
                return known.get("crs_wkt") or known.get("spatial_ref")
        return self._heights.attrs.get("crs")

    def _applied(
        self,
        compute: Compute,
        horizon: HorizonKeywords,
        attributes: dict[str, str],
        leading: dict[str, NDArray[Any]] | None = None,
    ) -> xr.DataArray:
        """What `compute` makes of the terrain, on the grid that was given."""
        array, grid = self._north_up()
        options = HorizonOptions(**horizon)
        front = {} if leading is None else leading
        if self._heights.chunks is None:
            result: Any = compute(Terrain(array, grid.cell_size, grid.crs, grid.transform))
        else:
            count = tuple(len(values) for values in front.values())
            result = _lazy(array, grid, compute, options, count)
        rows, columns = self._heights.dims
        ascending = _step("rows", self._heights[rows].values) > 0.0
        if ascending:
            result = result[..., ::-1, :]
        kept = {
            name: coordinate
            for name, coordinate in self._heights.coords.items()
            if set(coordinate.dims) <= {rows, columns}
        }
        return xr.DataArray(
            result,
            dims=(*front, rows, columns),
            coords={**front, **kept},
            attrs=attributes,
            name=attributes["long_name"].replace(" ", "_"),
        )


def _step(field: str, values: NDArray[Any]) -> float:
    """Distance of even coordinates."""
    if len(values) < 2:
        raise InputError(field, "at least 2", len(values))
    step = (float(values[-1]) - float(values[0])) / (len(values) - 1)
    even = float(values[0]) + step * np.arange(len(values))
    if step == 0.0 or not np.abs(values - even).max() <= EVEN * abs(step):
        raise InputError(field, "coordinates of an even grid", values[:3].tolist())
    return step


def _lazy(
    array: Any, grid: RasterGrid, compute: Compute, options: HorizonOptions, count: tuple[int, ...]
) -> Any:
    """A Dask array of the same chunks, each an exact tile."""
    import dask.array as da
    from dask.delayed import delayed

    datum = delayed(_datum)(_extreme(array, np.fmin), _extreme(array, np.fmax))
    rows, columns = (np.cumsum((0, *sizes)).tolist() for sizes in array.chunks)
    bands = []
    for top, bottom in pairwise(rows):
        band = []
        for left, right in pairwise(columns):
            halo = max(grid.shape)
            if options.max_distance is not None:
                halo = options.halo_of(grid, top, bottom)
            corner = max(top - halo, 0), max(left - halo, 0)
            seen = array[corner[0] : bottom + halo, corner[1] : right + halo]
            shape = (bottom - top, right - left)
            place = (top - corner[0], left - corner[1])
            tile = delayed(_tile)(seen, datum, place, shape, corner, grid, compute)
            band.append(da.from_delayed(tile, (*count, *shape), np.float32))
        bands.append(da.concatenate(band, axis=-1))
    return da.concatenate(bands, axis=-2)


def _extreme(array: Any, function: Any) -> Any:
    """The lowest or highest of all that is not NaN, lazily."""
    import dask.array as da

    return da.reduction(
        array,
        chunk=lambda block, axis, keepdims: function.reduce(block, axis=axis, keepdims=keepdims),
        aggregate=lambda block, axis, keepdims: function.reduce(
            block, axis=axis, keepdims=keepdims
        ),
        dtype=array.dtype,
    )


def _datum(low: Any, high: Any) -> float:
    low, high = float(low), float(high)
    _heights.check_range(math.inf if math.isnan(low) else low, high)
    return _heights.middle(low, high)


def _tile(
    seen: NDArray[Any],
    datum: float,
    place: tuple[int, int],
    shape: tuple[int, int],
    corner: tuple[int, int],
    grid: RasterGrid,
    compute: Compute,
) -> Layers:
    """One chunk of the result."""
    above = np.empty(seen.shape, np.float32)
    np.subtract(seen, datum, dtype=np.float64, out=above, casting="same_kind")
    return compute(Terrain.of_view(TerrainView(above, *place), shape, corner, grid, datum))
