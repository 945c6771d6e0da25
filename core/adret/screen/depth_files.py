"""Reading depth buffers: NumPy .npy and .npz, OpenEXR, TIFF and 16-bit PNG.

Files are foreign input: the declared size is checked before anything is decoded, and whatever is
wrong becomes a `RasterError` that names it.
"""

import os
import warnings
import zipfile
from math import prod
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from adret._gdal import GDAL_OPTIONS, sniff_driver
from adret.errors import RasterError
from adret.screen.camera_files import read_json, stored_as

if TYPE_CHECKING:
    from adret.screen.camera import Camera

__all__ = ["described", "read_depth"]

MAX_SIDE = 32_768
MAX_NUMBERS = 1 << 27
EXR_CHANNELS = ("Z", "depth.Z", "Depth.Z", "depth", "Depth", "depth.V", "Depth.V", "Y", "R")


def described(path: str | os.PathLike[str]) -> "tuple[Camera, dict[str, Any]]":
    """The camera of a camera file, and how depth is stored as far as it says so."""
    from adret.screen.camera import Camera

    values = read_json(path)
    return Camera.from_mapping(values), stored_as(values)


def read_depth(path: str | os.PathLike[str]) -> NDArray[Any]:
    """Read the numbers of a depth file as they are stored.

    Parameters
    ----------
    path : path-like
        A .npy, .npz, .exr, .tif or 16-bit .png file; the format is told from its first bytes.

    Returns
    -------
    ndarray, shape (rows, columns) or (samples, rows, columns)
        Floating-point or whole numbers of the file's own type; a TIFF's masked pixels are NaN.

    Raises
    ------
    RasterError
        If the file is missing, of another kind, truncated, larger than 2^27 numbers, or has too
        few bits for depth.
    """
    file = Path(path)
    try:
        with file.open("rb") as stream:
            start = stream.read(8)
    except (OSError, ValueError) as error:
        raise RasterError("depth", "a file that can be read", str(error)) from None
    if start.startswith(b"\x93NUMPY"):
        return _read_npy(file)
    if start.startswith(b"PK\x03\x04"):
        return _read_npz(file)
    if start.startswith(b"\x76\x2f\x31\x01"):
        return _read_exr(file)
    if start.startswith((b"II*\0", b"MM\0*", b"II+\0", b"MM\0+", b"\x89PNG")):
        return _read_raster(file)
    raise RasterError("depth", "a .npy, .npz, .exr, .tif or 16-bit .png file", file.name)


def _check_size(shape: tuple[int, ...]) -> None:
    ok = len(shape) in (2, 3) and all(1 <= side <= MAX_SIDE for side in shape)
    if not ok or prod(shape) > MAX_NUMBERS:
        limit = f"([samples, ]rows, columns), 1 to {MAX_SIDE} a side, at most {MAX_NUMBERS} in all"
        raise RasterError("depth shape", limit, shape)


def _check_dtype(dtype: np.dtype[Any]) -> None:
    if dtype.hasobject or dtype.kind not in "iuf" or dtype.itemsize < 2:
        raise RasterError(
            "depth dtype", "floating-point or whole numbers of 16 bits or more", dtype
        )


# --- NumPy -----------------------------------------------------------------------------------


def _read_array(stream: IO[bytes], left: int) -> NDArray[Any]:
    """One array in .npy format of at most `left` bytes, its header checked before its data."""
    try:
        version = np.lib.format.read_magic(stream)
        old = version == (1, 0)
        header = np.lib.format.read_array_header_1_0 if old else np.lib.format.read_array_header_2_0
        shape, fortran, dtype = header(stream)
        _check_dtype(dtype)
        _check_size(shape)
        size = prod(shape) * dtype.itemsize
        if left < size:
            raise RasterError("depth", f"{size} bytes of numbers", f"{left} bytes")
        data = stream.read(size)
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        if isinstance(error, RasterError):
            raise
        raise RasterError("depth", "a readable NumPy array", str(error)) from None
    if len(data) < size:
        raise RasterError("depth", f"{size} bytes of numbers", f"{len(data)} bytes")
    array = np.frombuffer(data, dtype=dtype)
    return array.reshape(shape, order="F" if fortran else "C")


def _read_npy(file: Path) -> NDArray[Any]:
    with file.open("rb") as stream:
        return _read_array(stream, os.fstat(stream.fileno()).st_size)


def _read_npz(file: Path) -> NDArray[Any]:
    import zlib

    try:
        with zipfile.ZipFile(file) as archive:
            names = [entry.filename for entry in archive.infolist()]
            arrays = [name for name in names if name.endswith(".npy")]
            chosen = "depth.npy" if "depth.npy" in arrays else arrays[0] if arrays else ""
            if not chosen or (chosen != "depth.npy" and len(arrays) > 1):
                raise RasterError("depth", "an .npz with one array, or one named depth", names[:8])
            with archive.open(chosen) as stream:
                return _read_array(stream, archive.getinfo(chosen).file_size)
    except (OSError, ValueError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        if isinstance(error, RasterError):
            raise
        raise RasterError("depth", "a readable .npz file", str(error)) from None


# --- OpenEXR, TIFF and PNG -------------------------------------------------------------------


def _read_exr(file: Path) -> NDArray[Any]:
    import OpenEXR

    try:
        window = OpenEXR.File(str(file), header_only=True).header()["dataWindow"]
        (left, top), (right, bottom) = window
        _check_size((int(bottom) - int(top) + 1, int(right) - int(left) + 1))
        channels = OpenEXR.File(str(file), separate_channels=True).channels()
    except (OSError, RuntimeError, ValueError, TypeError, KeyError) as error:
        if isinstance(error, RasterError):
            raise
        raise RasterError("depth", "a readable OpenEXR file", str(error)) from None
    names = list(channels)
    found = [name for name in EXR_CHANNELS if name in channels]
    chosen = found[0] if found else names[0] if len(names) == 1 else ""
    if not chosen:
        raise RasterError("depth channels", "one channel, or one named Z, depth or Y", names[:8])
    pixels = np.asarray(channels[chosen].pixels)
    if pixels.ndim != 2:
        raise RasterError("depth channel", "two-dimensional, at full size", pixels.shape)
    _check_dtype(pixels.dtype)
    return pixels


def _read_raster(file: Path) -> NDArray[Any]:
    import rasterio
    from rasterio.errors import NotGeoreferencedWarning, RasterioError

    absolute, driver = sniff_driver(file, "depth")
    try:
        with warnings.catch_warnings(), rasterio.Env(**GDAL_OPTIONS):
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            with rasterio.open(absolute, driver=driver) as source:
                _check_size((source.count, source.height, source.width))
                for kind in source.dtypes:
                    _check_dtype(np.dtype(kind))
                bands = source.read()
                masks = source.read_masks() == 0
    except RasterioError as error:
        raise RasterError("depth", f"a readable {driver} file", str(error)) from None
    if driver == "PNG" and len(bands) > 1:
        raise RasterError("depth bands", "one in a PNG", len(bands))
    if masks.any():
        bands = np.where(masks, np.nan, bands.astype(np.result_type(bands, np.float32)))
    return np.asarray(bands[0] if len(bands) == 1 else bands)
