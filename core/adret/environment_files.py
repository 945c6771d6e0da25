"""Reading pictures of radiance: Radiance .hdr, OpenEXR .exr and NumPy .npy.

Files are foreign input: the declared size is checked before anything is decoded, and whatever is
wrong becomes a `RasterError` that names it.
"""

import os
import re
from collections.abc import Callable
from math import prod
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from adret.errors import RasterError

__all__ = ["read_radiance"]

MAX_PIXELS = 1 << 26
MAX_SIDE = 32_768
HEADER_LIMIT = 65_536

Picture = NDArray[np.float32]


def read_radiance(path: str | os.PathLike[str]) -> Picture:
    """Read one picture of radiance.

    Parameters
    ----------
    path : path-like
        A .hdr, .exr or .npy file; the format is told from its first bytes.

    Returns
    -------
    ndarray, shape (rows, columns, bands), float32
        Radiance in the file's unit, 1 or 3 bands.

    Raises
    ------
    RasterError
        If the file is missing, of another kind, truncated, or larger than 2^26 pixels.
    """
    file = Path(path)
    try:
        with file.open("rb") as stream:
            start = stream.read(10)
    except OSError as error:
        limit = f"a file that can be read ({error.strerror})"
        raise RasterError("environment", limit, os.fspath(path)) from None
    except ValueError:  # a NUL in the name
        raise RasterError("environment", "the path of a file", os.fspath(path)) from None
    for magic, reader in _READERS:
        if start.startswith(magic):
            return reader(file)
    raise RasterError("environment", "a .hdr, .exr or .npy file", file.name)


def _check_size(rows: int, columns: int) -> None:
    if rows < 1 or columns < 1 or max(rows, columns) > MAX_SIDE or rows * columns > MAX_PIXELS:
        limit = f"1 to {MAX_SIDE} pixels a side and at most {MAX_PIXELS} in all"
        raise RasterError("environment size", limit, f"{columns} x {rows}")


# --- Radiance RGBE ---------------------------------------------------------------------------


def _read_hdr(file: Path) -> Picture:
    with file.open("rb") as stream:
        exposure, rows, columns = _hdr_header(stream)
        _check_size(rows, columns)
        left = os.fstat(stream.fileno()).st_size - stream.tell()
        packed = 8 <= columns <= 32_767
        least = rows * (4 + 8 * -(-columns // 127)) if packed else 4 * rows * columns
        if left < least:
            raise RasterError("environment", f"{least} bytes of pixels at least", left)
        data = stream.read(min(left, rows * columns * 8 + rows * 4))
    pixels = _unpack_scanlines(data, rows, columns)
    # A component is mantissa · 2^(exponent - 136); exponent 0 is black.
    exponent = pixels[:, :, 3].astype(np.int32) - 136
    scale = np.where(pixels[:, :, 3] == 0, 0.0, np.ldexp(1.0 / exposure, exponent))
    return np.asarray(pixels[:, :, :3] * scale[:, :, None], dtype=np.float32)


def _hdr_header(stream: BinaryIO) -> tuple[float, int, int]:
    """Exposure (pixels were multiplied by it), rows and columns."""
    exposure = 1.0
    read = 0
    while True:
        line = stream.readline(2048)
        read += len(line)
        if not line.endswith(b"\n") or read > HEADER_LIMIT:
            raise RasterError("environment", "a complete Radiance header", f"{read} bytes of it")
        text = line.decode("latin-1").strip()
        if not text:
            break
        name, _, value = text.partition("=")
        if name == "FORMAT" and value.strip() != "32-bit_rle_rgbe":
            raise RasterError("environment format", "32-bit_rle_rgbe", value.strip())
        if name == "EXPOSURE":
            try:
                exposure *= float(value)
            except ValueError:
                exposure = np.nan
            if not 1e-12 < exposure < 1e12:
                raise RasterError("environment exposure", "a positive number", value.strip())
    resolution = stream.readline(64).decode("latin-1").strip()
    match = re.fullmatch(r"-Y ([0-9]{1,9}) \+X ([0-9]{1,9})", resolution)
    if match is None:
        raise RasterError("environment resolution", "'-Y rows +X columns'", resolution)
    return exposure, int(match[1]), int(match[2])


def _unpack_scanlines(data: bytes, rows: int, columns: int) -> NDArray[np.uint8]:
    """Mantissas and exponents (rows, columns, 4) from flat or run-length coded scanlines."""
    start = bytes((2, 2, columns >> 8, columns & 255)) if 8 <= columns <= 32_767 else b""
    if not start or data[:4] != start:
        flat = rows * columns * 4
        if len(data) < flat:
            raise RasterError("environment", f"{flat} bytes of flat pixels", len(data))
        return np.frombuffer(data, dtype=np.uint8, count=flat).reshape(rows, columns, 4)
    pixels = np.empty((rows, columns, 4), dtype=np.uint8)
    at = 0
    for row in range(rows):
        if data[at : at + 4] != start:
            raise RasterError("environment", "run-length coded in every scanline", f"row {row}")
        line, at = _unpack_runs(data, at + 4, 4 * columns, row)
        pixels[row] = np.frombuffer(line, dtype=np.uint8).reshape(4, columns).T
    return pixels


def _unpack_runs(data: bytes, at: int, size: int, row: int) -> tuple[bytearray, int]:
    """Decode the four component runs of a scanline; returns them and where the next one starts."""
    line = bytearray()
    while len(line) < size:
        count = data[at] if at < len(data) else 0
        if count > 128:  # a run: one byte, count - 128 times
            line += data[at + 1 : at + 2] * (count - 128)
            at += 2
        else:  # count bytes as they are
            line += data[at + 1 : at + 1 + count]
            at += 1 + count
        if count == 0 or at > len(data) or len(line) > size:
            raise RasterError("environment", "whole run-length coded scanlines", f"row {row}")
    return line, at


# --- OpenEXR and NumPy -----------------------------------------------------------------------


def _read_exr(file: Path) -> Picture:
    import OpenEXR

    try:
        (left, top), (right, bottom) = OpenEXR.File(str(file), header_only=True).header()[
            "dataWindow"
        ]
        _check_size(int(bottom) - int(top) + 1, int(right) - int(left) + 1)
        channels = OpenEXR.File(str(file), separate_channels=True).channels()
    except (OSError, RuntimeError, ValueError, TypeError, KeyError) as error:
        if isinstance(error, RasterError):
            raise
        raise RasterError("environment", "a readable OpenEXR file", str(error)) from None
    for names in (("R", "G", "B"), ("Y",)):
        if all(name in channels for name in names):
            bands = [np.asarray(channels[name].pixels, dtype=np.float32) for name in names]
            if len({band.shape for band in bands}) == 1 and bands[0].ndim == 2:
                return np.stack(bands, axis=-1)
    raise RasterError("environment channels", "R, G, B or Y at full size", sorted(channels))


def _read_npy(file: Path) -> Picture:
    try:
        with file.open("rb") as stream:
            version = np.lib.format.read_magic(stream)
            header = (
                np.lib.format.read_array_header_1_0
                if version == (1, 0)
                else np.lib.format.read_array_header_2_0
            )
            shape, _, dtype = header(stream)
            left = os.fstat(stream.fileno()).st_size - stream.tell()
        if dtype.kind not in "iuf" or dtype.hasobject:
            raise RasterError("environment dtype", "real numbers", str(dtype))
        if not (len(shape) == 2 or (len(shape) == 3 and shape[2] in (1, 3))):
            raise RasterError("environment shape", "(rows, columns[, 1 or 3])", shape)
        _check_size(shape[0], shape[1])
        if left < prod(shape) * dtype.itemsize:
            raise RasterError("environment", f"{prod(shape)} pixel values", f"{left} bytes")
        picture = np.load(file, allow_pickle=False)
    except (OSError, ValueError) as error:
        if isinstance(error, RasterError):
            raise
        raise RasterError("environment", "a readable .npy file", str(error)) from None
    return np.asarray(picture, dtype=np.float32).reshape(shape[0], shape[1], -1)


_READERS: tuple[tuple[bytes, Callable[[Path], Picture]], ...] = (
    (b"#?RADIANCE", _read_hdr),
    (b"#?RGBE", _read_hdr),
    (b"\x76\x2f\x31\x01", _read_exr),
    (b"\x93NUMPY", _read_npy),
)
