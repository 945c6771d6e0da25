"""Raster files in and out: heights read here, results written by `write`, pictures by `preview`.

A file is opened by the one driver that its first bytes name, after its declared sizes were held
against limits. Sidecar files (``.aux.xml``, ``.ovr``, ``.msk``, world files) are never read.
"""

import math
import operator
import os
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from adret import geodesy
from adret._gdal import GDAL_OPTIONS, PathLike, sniff_driver
from adret.cogs import write
from adret.errors import InputError, RasterError
from adret.previews import preview

if TYPE_CHECKING:
    from affine import Affine
    from pyproj import CRS

__all__ = [
    "GDAL_OPTIONS",
    "HeightGrid",
    "HeightHeader",
    "ReadLimits",
    "check_numbers",
    "open_header",
    "open_heights",
    "preview",
    "sniff_driver",
    "write",
]


T = TypeVar("T")
_NUMBER_BYTES = b"0123456789+-.,eE \t\r\nnaNAifIF"
_GRID_KEYS = (b"ncols", b"nrows", b"xll", b"yll", b"cellsize", b"dx", b"dy", b"nodata_value")


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadLimits:
    """Sizes that a file may declare before anything of it is decoded.

    Attributes
    ----------
    max_pixels : int
        Cells to read.
    max_side : int
        Rows or columns of the file.
    max_block_bytes : int
        Bytes of one decoded tile or strip.
    """

    max_pixels: int = 1_000_000_000
    max_side: int = 200_000
    max_block_bytes: int = 1 << 30


@dataclass(frozen=True, slots=True)
class HeightGrid:
    """What a file holds: heights in metres (NaN = nodata), north-up, and where they lie."""

    heights: NDArray[np.floating[Any]]
    crs: "CRS | None"
    transform: "Affine | None"
    cell_size: tuple[float, float]
    vertical_unit: str


@dataclass(frozen=True, slots=True)
class HeightHeader:
    """What a file says about its heights before any of them is read."""

    shape: tuple[int, int]
    crs: "CRS | None"
    transform: "Affine | None"
    cell_size: tuple[float, float]
    vertical_unit: str
    item_size: int


def check_numbers(path: PathLike, field: str = "path") -> None:
    """Refuse an ASCII grid with words among its heights, which GDAL would read as zeros.

    Raises
    ------
    RasterError
        Naming `field` and the start of the first such line.
    """
    with open(path, "rb") as file:
        header = True
        for line in iter(lambda: file.readline(1 << 20), b""):
            header = header and line.lower().lstrip().startswith(_GRID_KEYS)
            if not header and line.translate(None, _NUMBER_BYTES):
                start = line.strip()[:40].decode("ascii", "replace")
                raise RasterError(field, "an ASCII grid of numbers", start)


def open_heights(
    path: PathLike,
    band: int = 1,
    window: tuple[Any, Any] | None = None,
    *,
    vertical_unit: str | None = None,
    cell_size: tuple[float, float] | None = None,
    limits: ReadLimits | None = None,
) -> HeightGrid:
    """Read heights [m] and their place from a GeoTIFF, an Arc/Info ASCII grid or a PNG.

    Parameters
    ----------
    path : path-like
        A file on disk.
    band : int
        Band number, from 1.
    window : (rows, columns), optional
        Slices or (start, stop) pairs, rows counted from the north.
    vertical_unit : str, optional
        Unit of the heights; default is the band's own, then the CRS's vertical axis, then metres.
    cell_size : (float, float), optional
        Ground size of a cell [m]; default from CRS and geotransform.
    limits : ReadLimits, optional
        Sizes checked before decoding.

    Returns
    -------
    HeightGrid
        Heights float32 or float64 as precision asks, NaN where the file is masked.

    Raises
    ------
    RasterError
        If the file cannot be used; the message names what is wrong with it.
    """
    settings = (band, vertical_unit, cell_size, limits or ReadLimits())
    return _opened(path, lambda source: _read(source, window, *settings))


def open_header(
    path: PathLike,
    band: int = 1,
    *,
    vertical_unit: str | None = None,
    cell_size: tuple[float, float] | None = None,
) -> HeightHeader:
    """Read what `open_heights` says about a file's place and unit, and none of its heights.

    Raises
    ------
    RasterError
        If the file cannot be used; the message names what is wrong with it.
    """

    def header(source: Any) -> HeightHeader:
        shape, crs, transform, _ = _checked(source, band, cell_size, ReadLimits())
        unit, _ = _vertical(source, band, crs, vertical_unit)
        size = cell_size
        if size is None:
            assert transform is not None
            size = geodesy.cell_size(crs, transform, shape)
        item = np.dtype(source.dtypes[band - 1]).itemsize
        return HeightHeader(shape, crs, transform, size, unit, item)

    return _opened(path, header)


def _opened(path: PathLike, read: Callable[[Any], T]) -> T:
    """What `read` makes of the open file."""
    import rasterio
    from rasterio.errors import NotGeoreferencedWarning, RasterioError

    absolute, driver = sniff_driver(path)
    if driver == "AAIGrid":
        check_numbers(absolute)
    try:
        with warnings.catch_warnings(), rasterio.Env(**GDAL_OPTIONS):
            # Said by our own error, with what to do about it.
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            with rasterio.open(absolute, driver=driver) as source:
                return read(source)
    except RasterioError as error:
        reason = " ".join(str(error).replace(absolute, os.fspath(path)).split())
        raise RasterError("path", f"a readable {driver} file ({reason})", os.fspath(path)) from None


def _checked(
    source: Any, band: int, cell_size: tuple[float, float] | None, limits: ReadLimits
) -> tuple[tuple[int, int], "CRS | None", "Affine | None", bool]:
    """Shape and place of a file that may be read, and if it is south-up."""
    if not isinstance(band, int | np.integer) or isinstance(band, bool):
        raise InputError("band", "a whole number", band)
    if not 1 <= band <= source.count:
        raise RasterError("band", f"between 1 and {source.count}", band)
    shape = (int(source.height), int(source.width))
    _check_sizes(source, band, str(source.dtypes[band - 1]), shape, limits)
    return shape, *_georeference(source, shape, cell_size)


def _read(
    source: Any,
    window: tuple[Any, Any] | None,
    band: int,
    vertical_unit: str | None,
    cell_size: tuple[float, float] | None,
    limits: ReadLimits,
) -> HeightGrid:
    from rasterio.windows import Window

    shape, crs, transform, south_up = _checked(source, band, cell_size, limits)
    rows, columns = read_window(window, shape)
    count = (rows[1] - rows[0]) * (columns[1] - columns[0])
    if count > limits.max_pixels:
        raise RasterError("size", f"at most {limits.max_pixels} cells (read a window)", count)
    unit, factor = _vertical(source, band, crs, vertical_unit)

    stored = (shape[0] - rows[1], shape[0] - rows[0]) if south_up else rows
    area = Window.from_slices(stored, columns)
    values = source.read(band, window=area, masked=True)
    scale = float(source.scales[band - 1]) * factor
    offset = float(source.offsets[band - 1]) * factor
    heights = _to_heights(values, scale, offset)
    if south_up:
        heights = np.ascontiguousarray(heights[::-1])
    if transform is not None:
        transform = geodesy.shifted(transform, columns[0], rows[0])
    if cell_size is None:
        assert transform is not None
        cell_size = geodesy.cell_size(crs, transform, heights.shape)
    return HeightGrid(heights, crs, transform, cell_size, unit)


def _check_sizes(
    source: Any, band: int, dtype: str, shape: tuple[int, int], limits: ReadLimits
) -> None:
    if min(shape) < 1 or max(shape) > limits.max_side:
        raise RasterError(
            "size", f"1 to {limits.max_side} rows and columns", f"{shape[0]} x {shape[1]}"
        )
    if dtype.startswith("complex"):
        raise RasterError("dtype", "real numbers", dtype)
    block_rows, block_columns = source.block_shapes[band - 1]
    block = block_rows * block_columns * np.dtype(dtype).itemsize
    if block > limits.max_block_bytes:
        raise RasterError(
            "block", f"at most {limits.max_block_bytes} bytes a tile or strip (re-tile it)", block
        )


def _georeference(
    source: Any, shape: tuple[int, int], cell_size: tuple[float, float] | None
) -> tuple["CRS | None", "Affine | None", bool]:
    """CRS, north-up transform of the whole raster (None without one), and if it was south-up."""
    from affine import Affine

    crs = geodesy.parse_crs(source.crs.to_wkt() if source.crs else None)
    transform: Affine = source.transform
    if transform == Affine.identity():
        if cell_size is None:
            raise RasterError(
                "cell_size", "given (the file has no geotransform)", "no geotransform"
            )
        return None, None, False
    a, b, c, d, e, f = transform[:6]
    if not all(math.isfinite(v) for v in (a, b, c, d, e, f)) or a == 0.0 or e == 0.0:
        raise RasterError("cell size", "finite and not zero", f"{a} x {e}")
    if abs(b) > 1e-9 * abs(a) or abs(d) > 1e-9 * abs(e):
        raise RasterError("transform", "without rotation or shear (warp the raster)", (a, b, d, e))
    if a < 0.0:
        raise RasterError("transform", "with columns running east (warp the raster)", (a, e))
    if crs is None and cell_size is None and max(a, abs(e)) < 0.05:
        corners = (c, c + a * shape[1], f, f + e * shape[0])
        if max(map(abs, corners[:2])) <= 360.0 and max(map(abs, corners[2:])) <= 90.0:
            raise RasterError(
                "crs", "set (the cells look like degrees), or cell_size given", "no CRS"
            )
    south_up = e > 0.0
    if south_up:
        transform = Affine(a, 0.0, c, 0.0, -e, f + e * shape[0])
    return crs, transform, south_up


def _vertical(
    source: Any, band: int, crs: "CRS | None", vertical_unit: str | None
) -> tuple[str, float]:
    unit = vertical_unit
    if unit is None:
        unit = source.units[band - 1] or geodesy.vertical_unit_of(crs) or "m"
    try:
        return unit, geodesy.vertical_factor(unit)
    except InputError as error:
        if vertical_unit is not None:
            raise
        raise RasterError(error.field, f"{error.limit} (or say it yourself)", unit) from None


def read_window(
    window: tuple[Any, Any] | None, shape: tuple[int, int]
) -> tuple[tuple[int, int], tuple[int, int]]:
    """Two (start, stop) pairs inside `shape`, from slices, pairs or None (all)."""
    if window is None:
        return (0, shape[0]), (0, shape[1])
    try:
        rows, columns = window
    except (TypeError, ValueError):
        raise InputError("window", "a pair (rows, columns)", window) from None
    return span("rows", rows, shape[0]), span("columns", columns, shape[1])


def span(field: str, given: Any, size: int) -> tuple[int, int]:
    """A (start, stop) pair with 0 <= start < stop <= size, from a slice or a pair."""
    try:
        if isinstance(given, slice):
            if given.step not in (None, 1):
                raise InputError(field, "without a step", given)
            start = 0 if given.start is None else operator.index(given.start)
            stop = size if given.stop is None else operator.index(given.stop)
        else:
            start, stop = (operator.index(v) for v in given)
    except (TypeError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(field, "a slice or a pair (start, stop) of whole numbers", given) from None
    if not 0 <= start < stop <= size:
        raise InputError(field, f"start < stop within 0 to {size}", (start, stop))
    return start, stop


def _to_heights(values: Any, scale: float, offset: float) -> NDArray[np.floating[Any]]:
    """Metres from stored numbers: float32 where it is exact, NaN where masked."""
    if not (math.isfinite(scale) and scale != 0.0 and math.isfinite(offset)):
        raise RasterError("scale", "finite and not zero, with a finite offset", (scale, offset))
    plain = scale == 1.0 and offset == 0.0
    exact = values.dtype in (np.dtype("f4"), np.dtype("i2"), np.dtype("u2")) or (
        values.dtype.itemsize == 1
    )
    heights: NDArray[np.floating[Any]] = values.data.astype(
        np.float32 if plain and exact else np.float64
    )
    mask = np.ma.getmask(values)
    if mask is not np.ma.nomask:
        heights[mask] = np.nan
    if not plain:
        heights *= scale
        heights += offset
    return heights
