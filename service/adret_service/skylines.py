"""The horizon of one place: exact, for true azimuths, from rasters that stay in memory."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import rasterio
from pyproj import CRS, Transformer
from rasterio.windows import Window

import adret
from adret import geodesy, rasters
from adret.terrain import Terrain
from adret_service.problems import FieldError, Problem, invalid

__all__ = ["skyline"]

WHOLE = 4096  # cells a side up to which a raster is taken whole
GRAIN = 1024  # cells between two windows of a larger one
KEPT = 4  # rasters, or windows of them, in memory
AIR = 0.13  # coefficient of refraction
EARTH = (6.3e6, 6.45e6)  # mean radius [m]


@dataclass(frozen=True, slots=True)
class Place:
    """Part of a raster: its terrain, and where its first row and column are in the whole."""

    terrain: Terrain
    row: int
    column: int

    def reach(self, row: int, column: int, rows: int, columns: int) -> float | None:
        """Return how far the part goes from a cell [m] before more of the whole would come."""
        stop_row, stop_column = (
            self.row + self.terrain.shape[0],
            self.column + self.terrain.shape[1],
        )
        cut = [
            (self.row > 0, row - self.row),
            (stop_row < rows, stop_row - 1 - row),
            (self.column > 0, column - self.column),
            (stop_column < columns, stop_column - 1 - column),
        ]
        cells = [distance for is_cut, distance in cut if is_cut]
        return min(cells) * min(self.terrain.cell_size) if cells else None


def skyline(
    path: str,
    info: Mapping[str, Any],
    *,
    lat: float,
    lon: float,
    azimuths: int,
    height: float,
    curvature: bool,
) -> dict[str, Any]:
    """Return the horizon seen from a place, in degrees.

    Parameters
    ----------
    path : str
        Raster of a dataset in the store.
    info : mapping
        What the decoder found: crs, transform, rows, columns, cell_size, datum.
    lat, lon : float
        The place [degrees]; WGS 84 on the Earth, the body's own system elsewhere.
    azimuths : int
        Equally spaced directions, the first one true north.
    height : float
        Height of the eye above the surface [m].
    curvature : bool
        Take the body's curvature into account, and on the Earth refraction.

    Returns
    -------
    dict
        azimuth_deg from true north, elevation_deg (-90 where nothing lies), cell, elevation [m],
        and reach_m where only part of the raster was looked at.

    Raises
    ------
    Problem
        400 without a CRS or a geotransform, 404 outside the raster or on nodata.
    """
    if info.get("crs") is None or info.get("transform") is None:
        raise invalid(FieldError("crs", "known, to find a place by longitude and latitude", None))
    crs = crs_of(info["crs"])
    if geodesy.body_radius(crs) is None:
        error = FieldError("crs", "tied to the Earth or to another body", crs.name)
        raise invalid(error)
    transform = rasterio.Affine(*info["transform"])
    x, y = to_crs(info["crs"]).transform(lon, lat)
    column = floor((x - transform.c) / transform.a)
    row = floor((y - transform.f) / transform.e)
    if not (0 <= row < info["rows"] and 0 <= column < info["columns"]):
        error = FieldError("lat, lon", "within the raster", f"{lat}, {lon}")
        raise Problem(404, str(error), errors=[error])
    place = around(path, row, column, *frozen(info))
    terrain = place.terrain
    inner = row - place.row, column - place.column
    height_here = float(terrain.heights[inner]) + terrain.datum
    if math.isnan(height_here):
        error = FieldError("lat, lon", "where the raster has data", f"{lat}, {lon}")
        raise Problem(404, str(error), errors=[error])
    options: dict[str, Any] = {"observer_height": height}
    radius = geodesy.body_radius(crs)
    if curvature and radius is not None:
        on_earth = EARTH[0] < radius < EARTH[1]
        options |= {"radius": radius, "refraction": AIR if on_earth else 0.0}
    reach = place.reach(row, column, info["rows"], info["columns"])
    if reach is not None:
        options["max_distance"] = reach
    here = geodesy.shifted(transform, column, row)
    convergence = geodesy.grid_convergence(crs, here, (1, 1)) or 0.0
    true = np.arange(azimuths) * (360.0 / azimuths)
    elevation = adret.horizon_at(
        terrain, [inner[0]], [inner[1]], azimuths=np.radians(true - convergence), **options
    )
    return {
        "azimuth_deg": true.tolist(),
        "elevation_deg": np.degrees(elevation[:, 0].astype(np.float64)).round(4).tolist(),
        "cell": [row, column],
        "elevation": round(height_here, 3),
        "reach_m": reach,
    }


def floor(number: float) -> int:
    """Return the cell that holds a fractional position; -1 for none."""
    return math.floor(number) if math.isfinite(number) else -1


@lru_cache(maxsize=64)
def crs_of(wkt: str) -> CRS:
    """Return a reference system; reading one takes milliseconds."""
    return CRS.from_wkt(wkt)


@lru_cache(maxsize=64)
def to_crs(wkt: str) -> Transformer:
    """Return the way from degrees to a raster's coordinates."""
    crs = crs_of(wkt)
    radius = geodesy.body_radius(crs)
    on_earth = radius is not None and EARTH[0] < radius < EARTH[1]
    source = CRS.from_epsg(4326) if on_earth or crs.geodetic_crs is None else crs.geodetic_crs
    return Transformer.from_crs(source, crs, always_xy=True)


def frozen(info: Mapping[str, Any]) -> tuple[Any, ...]:
    """Return what a window is read with, as a key of the cache."""
    names = ("rows", "columns", "crs", "transform", "cell_size", "datum")
    return tuple(tuple(v) if isinstance(v := info[k], list) else v for k in names)


def around(path: str, row: int, column: int, *about: Any) -> Place:
    """Return the raster, or of a large one a window in whose middle the cell lies."""
    rows, columns = about[:2]
    top, stop_row = span(row, rows)
    left, stop_column = span(column, columns)
    return read(path, top, stop_row, left, stop_column, *about)


def span(cell: int, size: int) -> tuple[int, int]:
    """Return first and last row (or column) to read; the same ones for cells near each other."""
    if size <= WHOLE:
        return 0, size
    start = (cell - WHOLE // 2 + GRAIN // 2) // GRAIN * GRAIN
    start = min(max(start, 0), size - WHOLE)
    return start, start + WHOLE


@lru_cache(maxsize=KEPT)
def read(path: str, top: int, stop_row: int, left: int, stop_column: int, *about: Any) -> Place:
    """Read a window of a dataset's raster."""
    _, _, wkt, numbers, cell_size, datum = about
    window = Window(left, top, stop_column - left, stop_row - top)
    with rasterio.Env(**rasters.GDAL_OPTIONS), rasterio.open(path, driver="GTiff") as source:
        heights = source.read(1, window=window).astype(np.float64)
    heights += datum
    transform = geodesy.shifted(rasterio.Affine(*numbers), left, top)
    terrain = Terrain(heights, tuple(cell_size), wkt, transform, datum=datum)
    return Place(terrain, top, left)
