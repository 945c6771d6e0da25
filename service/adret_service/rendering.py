"""Pictures and numbers of the rasters that Adret itself wrote: tiles, previews, values at a point.

A raster that lies on the Earth is cut into the tiles of the web's Mercator grid. One that does not
(a depth buffer, a picture, the Moon) is cut along its own cells: the deepest zoom shows one cell a
pixel, each zoom above it twice as many, and x and y count tiles from the north-western corner.
"""

import contextlib
import io
import math
import warnings
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import rasterio
from morecantile import TileMatrixSet, tms
from numpy.typing import NDArray
from rasterio._err import CPLE_BaseError
from rasterio.errors import NotGeoreferencedWarning, RasterioError
from rasterio.warp import transform_bounds
from rasterio.windows import Window
from rio_tiler import reader
from rio_tiler.colormap import cmap
from rio_tiler.errors import NoOverviewWarning, PointOutsideBounds
from rio_tiler.io import Reader
from rio_tiler.models import ImageData

from adret.geodesy import body_radius, parse_crs
from adret.rasters import GDAL_OPTIONS
from adret_service.problems import FieldError, Problem, invalid

__all__ = ["MAX_ZOOM", "opened", "point", "preview", "statistics", "tile", "tile_grid"]

GRID: TileMatrixSet = tms.get("WebMercatorQuad")
MAX_ZOOM = 24
TILE = 256
SAMPLE = 1024  # cells a side that statistics look at
MAX_BANDS = 16
EARTH = (6.3e6, 6.45e6)  # mean radius [m]
BINS = 10
MEDIA = {"png": "image/png", "webp": "image/webp", "npy": "application/x-npy"}


@contextlib.contextmanager
def opened(path: str) -> Iterator[Reader]:
    """Open a raster that Adret wrote."""
    options = GDAL_OPTIONS | {"GDAL_CACHEMAX": 64, "GDAL_NUM_THREADS": "1"}
    with warnings.catch_warnings(), rasterio.Env(**options):
        warnings.simplefilter("ignore", NoOverviewWarning)
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        with rasterio.open(path, driver="GTiff") as dataset:
            yield Reader(None, dataset=dataset, tms=GRID, options={"unscale": True})


def raster(source: Reader) -> Any:
    """Return the open raster behind a reader."""
    return source.dataset


def on_earth(source: Reader) -> bool:
    """Whether the raster has a place on the Earth that can be told in degrees."""
    if source.crs is None:
        return False
    return _on_earth(source.crs.to_wkt(), tuple(source.bounds))


@lru_cache(maxsize=1024)
def _on_earth(wkt: str, bounds: tuple[float, float, float, float]) -> bool:
    radius = body_radius(parse_crs(wkt))
    if radius is None or not EARTH[0] < radius < EARTH[1]:
        return False
    try:
        degrees = transform_bounds(wkt, GRID.rasterio_geographic_crs, *bounds)
    except (RasterioError, CPLE_BaseError):
        return False
    return bool(np.isfinite(degrees).all())


def tile_grid(source: Reader) -> dict[str, Any]:
    """Say which tiles show the raster: grid, zooms, bounds, centre, and its bands."""
    dataset = raster(source)
    bands = [d or f"b{i}" for i, d in zip(dataset.indexes, dataset.descriptions, strict=True)]
    common = {"bands": bands, "unit": dataset.units[0]}
    if not on_earth(source):
        west, south, east, north = 0.0, 0.0, float(dataset.width), float(dataset.height)
        deepest = own_depth(dataset.width, dataset.height)
        return common | {
            "grid": "cells",
            "minzoom": 0,
            "maxzoom": deepest,
            "bounds": [west, south, east, north],
            "center": [east / 2.0, north / 2.0, 0],
        }
    west, south, east, north = source.get_geographic_bounds(GRID.rasterio_geographic_crs)
    return common | {
        "grid": "WebMercatorQuad",
        "minzoom": source.minzoom,
        "maxzoom": source.maxzoom,
        "bounds": [west, south, east, north],
        "center": [(west + east) / 2.0, (south + north) / 2.0, source.minzoom],
    }


def tile(
    source: Reader,
    z: int,
    x: int,
    y: int,
    *,
    form: str,
    bands: list[int],
    rescale: list[list[float]],
    colormap: str | None,
    side: int,
) -> tuple[bytes, str] | None:
    """Return one tile and its media type; None if all of it is nodata.

    Parameters
    ----------
    source : Reader
    z, x, y : int
        Tile of the grid that `tile_grid` names.
    form : {"png", "webp", "npy"}
        npy holds float32 numbers of shape (bands, side, side), NaN where there is no data.
    bands : list of int
        Band numbers from 1; empty for the first.
    rescale : list of [low, high]
        Values that become black and white: one pair, or one a band; empty for the 2nd and 98th
        percentile of the whole raster.
    colormap : str, optional
        Name of a colour map.
    side : int
        Pixels.

    Raises
    ------
    Problem
        404 outside the raster, 400 for what cannot be shown.
    """
    chosen = chosen_bands(source, bands, form)
    if max(x, y) >= 2**z:
        raise invalid(FieldError("x, y", f"from 0 to {2**z - 1} at zoom {z}", [x, y]))
    if on_earth(source):
        if not source.tile_exists(x, y, z):
            raise outside("z, x, y", source, [z, x, y])
        resampling = resampling_of(source)
        image = source.tile(
            x,
            y,
            z,
            tilesize=side,
            indexes=chosen,
            resampling_method=resampling,
            reproject_method=resampling,
        )
    else:
        image = own_tile(source, z, x, y, chosen, side)
    if not seen(image).any():
        return None
    return encoded(source, image, chosen, form, rescale, colormap)


def preview(
    source: Reader,
    *,
    form: str,
    bands: list[int],
    rescale: list[list[float]],
    colormap: str | None,
    side: int,
) -> tuple[bytes, str]:
    """Return a picture of the whole raster in its own cells, at most `side` pixels a side."""
    chosen = chosen_bands(source, bands, form)
    image = source.preview(
        indexes=chosen, max_size=side, resampling_method=resampling_of(source), dst_crs=None
    )
    return encoded(source, image, chosen, form, rescale, colormap)


def point(source: Reader, lon: float, lat: float, *, bands: list[int]) -> dict[str, Any]:
    """Return the values of the cell at a place on the Earth; None where there is no data."""
    if not on_earth(source):
        raise unplaced()
    chosen = chosen_bands(source, bands, "npy") if bands else list(raster(source).indexes)
    try:
        found = source.point(lon, lat, indexes=chosen)
    except PointOutsideBounds:
        raise outside("lon, lat", source, [lon, lat]) from None
    numbers = np.ma.filled(found.array.astype(np.float64), np.nan).tolist()
    return {
        "coordinates": [lon, lat],
        "values": [number if math.isfinite(number) else None for number in numbers],
        "band_names": [f"b{i}" for i in chosen],
        "band_descriptions": [raster(source).descriptions[i - 1] or f"b{i}" for i in chosen],
        "unit": raster(source).units[chosen[0] - 1],
    }


def statistics(source: Reader, *, bands: list[int]) -> dict[str, Any]:
    """Return minimum, maximum, mean, deviation, percentiles and histogram of each band.

    They are those of a sample of at most 1024 x 1024 evenly spaced cells, or means of cells.
    """
    count = min(raster(source).count, MAX_BANDS)
    chosen = chosen_bands(source, bands, "npy") if bands else list(range(1, count + 1))
    image = source.preview(indexes=chosen, max_size=SAMPLE)
    known = seen(image)
    return {
        f"b{index}": band_statistics(image.array.data[k], known[k])
        | {"description": raster(source).descriptions[index - 1] or f"b{index}"}
        for k, index in enumerate(chosen)
    }


def band_statistics(layer: NDArray[Any], known: NDArray[np.bool_]) -> dict[str, Any]:
    """Statistics of the cells that hold a finite number; None where there is none."""
    values = layer[known].astype(np.float64)
    body: dict[str, Any] = {
        "count": int(values.size),
        "valid_percent": round(100.0 * values.size / known.size, 2),
    }
    names = ("min", "max", "mean", "std", "percentile_2", "percentile_98")
    if not values.size:
        return body | dict.fromkeys(names) | {"histogram": None}
    low, high = np.percentile(values, (2.0, 98.0))
    numbers = (values.min(), values.max(), values.mean(), values.std(), low, high)
    counts, edges = np.histogram(values, BINS)
    return (
        body
        | dict(zip(names, map(float, numbers), strict=True))
        | {"histogram": [counts.tolist(), edges.tolist()]}
    )


def own_depth(columns: int, rows: int) -> int:
    """Return the zoom at which a raster's own grid shows one cell a pixel."""
    return max(0, math.ceil(math.log2(max(columns, rows) / TILE)))


def own_tile(source: Reader, z: int, x: int, y: int, bands: list[int], side: int) -> ImageData:
    """Cut a tile along the raster's own cells; what lies outside is nodata."""
    dataset = raster(source)
    deepest = own_depth(dataset.width, dataset.height)
    span = TILE * 2.0 ** (deepest - z)  # cells a tile
    left, top = x * span, y * span
    if left >= dataset.width or top >= dataset.height:
        raise outside("z, x, y", source, [z, x, y])
    right, bottom = min(left + span, dataset.width), min(top + span, dataset.height)
    columns = max(1, round(side * (right - left) / span))
    rows = max(1, round(side * (bottom - top) / span))
    image = reader.read(
        dataset,
        window=Window(left, top, right - left, bottom - top),
        width=columns,
        height=rows,
        indexes=bands,
        resampling_method=resampling_of(source),
        unscale=True,
    )
    shape = len(bands), side, side
    whole = np.ma.MaskedArray(np.zeros(shape, image.array.dtype), np.ones(shape, bool))
    whole[:, :rows, :columns] = image.array
    return ImageData(whole)


def resampling_of(source: Reader) -> Literal["nearest", "bilinear"]:
    """Return how cells become pixels: codes as they are, measured values by bilinear weights."""
    plain = raster(source).scales[0] == 1.0 and raster(source).offsets[0] == 0.0
    whole = np.dtype(raster(source).dtypes[0]).kind in "iu"
    return "nearest" if whole and plain else "bilinear"


def chosen_bands(source: Reader, bands: list[int], form: str) -> list[int]:
    """Return the bands to show, the first if none is named."""
    count = raster(source).count
    wrong = [band for band in bands if not 1 <= band <= count]
    if wrong:
        raise invalid(FieldError("bidx", f"between 1 and {count}", wrong[0]))
    if form != "npy" and len(bands) not in (0, 1, 3):
        raise invalid(FieldError("bidx", "one band, or three for red, green and blue", bands))
    return bands or [1]


def seen(image: ImageData) -> NDArray[np.bool_]:
    """Where the image has a finite number, by band."""
    known: NDArray[np.bool_] = ~np.ma.getmaskarray(image.array) & np.isfinite(image.array.data)
    return known


def encoded(
    source: Reader,
    image: ImageData,
    bands: list[int],
    form: str,
    rescale: list[list[float]],
    colormap: str | None,
) -> tuple[bytes, str]:
    """Turn numbers into a file."""
    if len(rescale) not in (0, 1, len(bands)):
        raise invalid(FieldError("rescale", "one pair, or one a band", len(rescale)))
    if colormap is not None and len(bands) != 1:
        raise invalid(FieldError("colormap_name", "left out with several bands", colormap))
    known = seen(image)
    if form == "npy":
        numbers = np.where(known, image.array.data, np.nan).astype(np.float32)
        for k, (low, high) in enumerate(spread(rescale, len(bands))):
            numbers[k] = (numbers[k] - low) / (high - low)
        memory = io.BytesIO()
        np.save(memory, numbers)
        return memory.getvalue(), MEDIA[form]
    ranges = spread(rescale, len(bands)) or default_ranges(source, bands)
    grey = np.zeros(image.array.shape, np.uint8)
    for k, (low, high) in enumerate(ranges):
        part = np.where(known[k], (image.array.data[k] - low) / (high - low), 0.0)
        grey[k] = np.rint(255.0 * np.clip(part, 0.0, 1.0))
    hidden = ~known.all(axis=0)
    shown = ImageData(np.ma.MaskedArray(grey, np.broadcast_to(hidden, grey.shape)))
    options: dict[str, Any] = {"lossless": True} if form == "webp" else {"zlevel": 3}
    colours = None if colormap is None else colour_map(colormap)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        return shown.render(img_format=form.upper(), colormap=colours, **options), MEDIA[form]


def spread(rescale: list[list[float]], count: int) -> list[list[float]]:
    """Return a pair for each band, or none if none was given."""
    return rescale * count if len(rescale) == 1 else rescale


def colour_map(name: str) -> Any:
    """Return the colours of a map; Problem 400 if there is none of that name."""
    if name not in cmap.list():
        raise invalid(FieldError("colormap_name", "like viridis, terrain or rdylbu_r", name))
    return cmap.get(name)


def default_ranges(source: Reader, bands: list[int]) -> list[list[float]]:
    """Return for each band the values that become black and white.

    Codes go from the least to the largest, measured values from the 2nd to the 98th percentile.
    """
    name = Path(raster(source).name).as_posix()
    return [list(_range(name, band, resampling_of(source))) for band in bands]


@lru_cache(maxsize=4096)
def _range(path: str, band: int, resampling: str) -> tuple[float, float]:
    with opened(path) as source:
        found = statistics(source, bands=[band])[f"b{band}"]
    names = ("min", "max") if resampling == "nearest" else ("percentile_2", "percentile_98")
    low, high = (0.0 if found[name] is None else float(found[name]) for name in names)
    return (low, high) if low < high else (low - 0.5, high + 0.5)


def outside(field: str, source: Reader, value: Any) -> Problem:
    """Build the 404 for a place where the raster is not."""
    bounds = [round(edge, 6) for edge in tile_grid(source)["bounds"]]
    error = FieldError(field, f"within west, south, east, north of {bounds}", str(value))
    return Problem(404, str(error), errors=[error])


def unplaced() -> Problem:
    """Build the 400 for a raster that has no place on the Earth."""
    return invalid(
        FieldError("crs", "one of the Earth, to find a place by longitude and latitude", None)
    )
