"""Results out: tiled, compressed cloud-optimised GeoTIFFs that say what they hold.

The same input gives the same bytes: nothing in the file hangs on the time or on the threads.
"""

import errno
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from shutil import disk_usage
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from adret._gdal import GDAL_OPTIONS, PathLike, atomic, check_output
from adret.errors import InputError

if TYPE_CHECKING:
    from adret.grids import RasterGrid
    from adret.terrain import Terrain

__all__ = ["PixelGrid", "write", "write_windows"]

BLOCK = 512
# Layers beyond this many bytes pass through a file beside the output instead of memory.
IN_MEMORY = 1 << 30
LITTLE_ROOM = 1 << 24
# Layers of up to this many bytes are stored while the next one is computed.
BESIDE = 1 << 24

Layers = NDArray[Any] | Iterable[tuple[int, NDArray[Any]]]
Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class PixelGrid:
    """Where an image's pixels lie: nowhere on Earth, one unit apart."""

    shape: tuple[int, int]
    cell_size: tuple[float, float] = (1.0, 1.0)
    crs: None = None
    transform: None = None


def write(
    path: PathLike,
    layers: Layers,
    terrain: "Terrain | PixelGrid",
    *,
    names: Sequence[str],
    unit: str,
    tags: Mapping[str, str],
    nodata: float = math.nan,
    dtype: str = "float32",
    scale: float | None = None,
    offset: float | None = None,
    overviews: bool = True,
    resampling: str = "average",
    overwrite: bool = True,
    progress: Progress | None = None,
) -> None:
    """Write layers as a cloud-optimised GeoTIFF: complete, or not at all.

    Parameters
    ----------
    path : path-like
        Where the file goes; it appears under this name only when it is whole.
    layers : ndarray or iterable
        Shape (bands, rows, columns) or (rows, columns); or pairs (index, layer) in any order, each
        used before the next is taken, so that they may share a buffer.
    terrain : Terrain or PixelGrid
        Gives CRS and geotransform. Without a transform the file gets one in metres (of an image:
        pixels) from its south-west corner.
    names : sequence of str
        Description of each band.
    unit : str
        Unit of all bands, e.g. "degree", "1".
    tags : mapping
        What goes into the file's metadata.
    nodata : float
        Stored value for NaN.
    dtype : str
        "float32", "uint8" or "uint16".
    scale, offset : float, optional
        Stored number * scale + offset = value; only for integer dtypes.
    overviews : bool
        Add halved copies down to 512 cells.
    resampling : str
        How overviews are made: "average", or "nearest" for codes.
    overwrite : bool
        Whether a file that exists may be replaced.
    progress : callable, optional
        Called as progress(done, total) after each layer.

    Raises
    ------
    RasterError
        If the place cannot be written.
    InputError
        If layers do not fit the names or the terrain.
    OSError
        If the disk is full or fails; nothing stays behind.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> from adret import Terrain
    >>> terrain = Terrain(np.zeros((4, 5)), (10, 10))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     out, layer = f"{folder}/one.tif", np.ones((4, 5), "f4")
    ...     write(out, layer, terrain, names=["one"], unit="1", tags={})
    """
    target = check_output(path, overwrite=overwrite)
    encode = encoder(dtype, scale, offset, nodata)

    def fill(dataset: Any) -> None:
        arriving = _in_order(layers, len(names), terrain.shape, progress)
        _store(arriving, lambda index, layer: dataset.write(encode(layer), index + 1))

    size = terrain.shape[0] * terrain.shape[1] * len(names) * np.dtype(dtype).itemsize
    about = (names, unit, tags, scale, offset)
    _write(target, fill, terrain, about, dtype, nodata, overviews, resampling, size <= IN_MEMORY)


def write_windows(
    path: PathLike,
    windows: Iterable[tuple[int, tuple[int, int], tuple[int, int], NDArray[Any]]],
    terrain: "Terrain | PixelGrid | RasterGrid",
    *,
    names: Sequence[str],
    unit: str,
    tags: Mapping[str, str],
    nodata: float = math.nan,
    dtype: str = "float32",
    scale: float | None = None,
    offset: float | None = None,
    resampling: str = "average",
    overwrite: bool = True,
) -> None:
    """Write the file that `write` would, from windows that cover it, in bounded memory.

    Parameters
    ----------
    path : path-like
        Where the file goes; it appears under this name only when it is whole.
    windows : iterable
        Band from 0, rows, columns, and stored numbers of type `dtype`, shape (rows, columns).
    terrain, names, unit, tags, nodata, dtype, scale, offset, resampling, overwrite
        As for `write`.

    Raises
    ------
    RasterError, OSError
        As for `write`.
    """
    target = check_output(path, overwrite=overwrite)

    def fill(dataset: Any) -> None:
        for index, rows, columns, numbers in windows:
            dataset.write(numbers, index + 1, window=(rows, columns))

    about = (names, unit, tags, scale, offset)
    _write(target, fill, terrain, about, dtype, nodata, True, resampling, False)


def _write(
    target: Path,
    fill: Callable[[Any], None],
    terrain: "Terrain | PixelGrid | RasterGrid",
    about: tuple[Sequence[str], str, Mapping[str, str], float | None, float | None],
    dtype: str,
    nodata: float,
    overviews: bool,
    resampling: str,
    in_memory: bool,
) -> None:
    """Fill a dataset, add overviews, copy it in the order that the cloud wants, and check it."""
    import rasterio
    from rasterio import shutil
    from rasterio._err import CPLE_BaseError  # copying lets it through as it is
    from rasterio.errors import RasterioError

    rows, columns = terrain.shape
    count = len(about[0])
    creation: dict[str, Any] = {
        "driver": "GTiff",
        "tiled": True,
        "blockxsize": min(BLOCK, -(-columns // 16) * 16),
        "blockysize": min(BLOCK, -(-rows // 16) * 16),
        "interleave": "band",
        "compress": "zstd",
        "zstd_level": 1,
        "predictor": 3 if dtype == "float32" else 2,
        "bigtiff": "if_safer",
        "photometric": "minisblack",  # three layers of codes are no colours
        "num_threads": "all_cpus",
    }
    profile = {
        "height": rows,
        "width": columns,
        "count": count,
        "dtype": dtype,
        "nodata": nodata,
        "crs": None if terrain.crs is None else terrain.crs.to_wkt(),
        "transform": geotransform(terrain),
    }
    try:
        with atomic(target) as unfinished, rasterio.Env(**GDAL_OPTIONS):
            middle = Path("layers") if in_memory else unfinished.parent / "layers.tif"
            options = {"driver": "MEM"} if in_memory else creation
            with rasterio.open(middle, "w+", **options, **profile) as dataset:
                describe(dataset, *about)
                fill(dataset)
                factors = _overview_factors(terrain.shape) if overviews else []
                for factor in factors:  # one by one: each is then made of the cells themselves
                    dataset.build_overviews([factor], rasterio.enums.Resampling[resampling])
                creation["copy_src_overviews"] = bool(factors)
                if in_memory:
                    _copy_by_memory(dataset, unfinished, creation)
                else:
                    shutil.copy(dataset, str(unfinished), **creation)
            _check_whole(unfinished, terrain.shape, count)
    except (RasterioError, CPLE_BaseError) as error:
        if isinstance(error, OSError) and error.errno:
            raise
        full = disk_usage(target.parent).free < LITTLE_ROOM
        code = errno.ENOSPC if full else errno.EIO
        raise OSError(code, " ".join(str(error).split()), str(target)) from error


def _copy_by_memory(dataset: Any, path: Path, creation: dict[str, Any]) -> None:
    """Compress in memory, then write: a full disk is then an error that Python sees."""
    from rasterio import shutil
    from rasterio.io import MemoryFile

    with MemoryFile(ext="tif") as memory:
        shutil.copy(dataset, memory.name, **creation)
        path.write_bytes(memory.getbuffer())


def describe(
    dataset: Any,
    names: Sequence[str],
    unit: str,
    tags: Mapping[str, str],
    scale: float | None,
    offset: float | None,
) -> None:
    """Say in an open dataset what its bands hold."""
    count = len(names)
    dataset.descriptions = tuple(names)
    dataset.units = (unit,) * count
    if scale is not None:
        dataset.scales = (scale,) * count
        dataset.offsets = (offset or 0.0,) * count
    dataset.update_tags(**tags)


def _store(
    layers: Iterable[tuple[int, NDArray[Any]]], store: Callable[[int, NDArray[Any]], None]
) -> None:
    """Store layers in the order in which they come, small ones while the next is computed."""
    with ThreadPoolExecutor(1, thread_name_prefix="adret-store") as beside:
        latest: Future[None] | None = None
        for index, layer in layers:
            if latest is not None:
                latest.result()
                latest = None
            if layer.nbytes <= BESIDE:
                latest = beside.submit(store, index, layer.copy())
            else:
                store(index, layer)
        if latest is not None:
            latest.result()


def _in_order(
    layers: Layers, count: int, shape: tuple[int, int], progress: Progress | None
) -> Iterator[tuple[int, NDArray[Any]]]:
    """Pass layers on as they come, and see that each comes once and fits."""
    if isinstance(layers, np.ndarray):
        stack = layers[np.newaxis] if layers.ndim == 2 else layers
        if len(stack) != count:
            raise InputError("layers", f"one a name ({count})", len(stack))
        layers = enumerate(stack)
    seen: set[int] = set()
    for index, layer in layers:
        if layer.shape != shape:
            raise InputError("layers", f"of the terrain's shape {shape}", layer.shape)
        if index in seen or not 0 <= index < count:
            raise InputError("layers", f"each of 0 to {count - 1} once", index)
        yield index, layer
        seen.add(index)
        if progress is not None:
            progress(len(seen), count)
    if len(seen) != count:
        raise InputError("layers", f"one a name ({count})", len(seen))


def encoder(
    dtype: str, scale: float | None, offset: float | None, nodata: float
) -> Callable[[NDArray[Any]], NDArray[Any]]:
    """The function from values to stored numbers."""
    stored = np.dtype(dtype)
    if stored.name not in ("float32", "uint8", "uint16"):
        raise InputError("dtype", "float32, uint8 or uint16", dtype)
    if stored.kind == "f":
        if scale is not None or offset is not None:
            raise InputError("scale", "left out for float32", scale)
        return lambda layer: layer.astype(stored, copy=False)
    top = np.iinfo(stored).max
    if scale is None:
        return lambda layer: layer.astype(stored, casting="same_kind", copy=False)
    step, start = np.float32(scale), np.float32(offset or 0.0)

    def encode(layer: NDArray[Any]) -> NDArray[Any]:
        number = np.subtract(layer, start, dtype=np.float32)
        number /= step
        np.rint(number, out=number)
        np.clip(number, 0.0, top, out=number)
        number[np.isnan(number)] = nodata
        return np.asarray(number.astype(stored))

    return encode


def geotransform(terrain: "Terrain | PixelGrid | RasterGrid") -> Any:
    """Where a file's cells lie: in its CRS, or in metres from the south-west corner."""
    if terrain.transform is not None:
        return terrain.transform
    from affine import Affine

    dx, dy = terrain.cell_size
    return Affine(dx, 0.0, 0.0, 0.0, -dy, dy * terrain.shape[0])


def _overview_factors(shape: tuple[int, int]) -> list[int]:
    factors = []
    factor = 1
    while max(shape) / factor > BLOCK:
        factor *= 2
        factors.append(factor)
    return factors


def _check_whole(path: Path, shape: tuple[int, int], count: int) -> None:
    """Read the last block of every band: GDAL reports a full disk late, or not at all."""
    import rasterio

    with rasterio.open(path, driver="GTiff") as dataset:
        block_rows, block_columns = dataset.block_shapes[0]
        top = (shape[0] - 1) // block_rows * block_rows
        left = (shape[1] - 1) // block_columns * block_columns
        for band in (1, count):
            dataset.read(band, window=((top, shape[0]), (left, shape[1])))
