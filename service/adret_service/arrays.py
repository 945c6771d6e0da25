"""Elevation arrays as uploads: .npy and .npz files, placed by a JSON georeference.

Nothing of a file is decoded before its header was held against limits; pickles never are.
"""

import json
import math
import os
import re
import zipfile
import zlib
from math import prod
from pathlib import Path
from tokenize import TokenError
from typing import IO, Any

import numpy as np
from affine import Affine
from numpy.typing import NDArray

from adret import geodesy
from adret.errors import RasterError
from adret.rasters import HeightGrid

__all__ = ["array_kind", "check_archive", "read_array"]

NPY = b"\x93NUMPY"
ZIP = b"PK\x03\x04"
HEIGHTS = "heights.npy"
MAX_MEMBERS = 16
MAX_HEADER = 10_000
VERSIONS = ((1, 0), (2, 0), (3, 0))
# What numpy's reader of headers, which are Python literals, lets through.
UNREADABLE = (ValueError, EOFError, RecursionError, MemoryError, SyntaxError, TypeError, TokenError)
CODE = re.compile(r"[A-Za-z][A-Za-z0-9_]{1,15}:[0-9]{1,8}")
KINDS = "a GeoTIFF, an Arc/Info ASCII grid, a PNG, a .npy file or a .npz file that can be read"
MEMBERS = ("crs", "transform", "nodata")


def array_kind(path: Path) -> str | None:
    """Return "npy" or "npz" by a file's first bytes, None for anything else."""
    with path.open("rb") as stream:
        start = stream.read(6)
    return "npy" if start == NPY else "npz" if start.startswith(ZIP) else None


def read_array(
    path: Path, kind: str, options: dict[str, Any], limits: dict[str, Any]
) -> tuple[HeightGrid, str]:
    """Read heights [m] and their place; returns the stored type besides.

    Parameters
    ----------
    path : Path
        The upload.
    kind : {"npy", "npz"}
    options : dict
        georeference: a JSON object with crs (such as "EPSG:2056"), transform [a, b, c, d, e, f]
        and nodata; cell_size [m], vertical_unit, band.
    limits : dict
        max_pixels, max_dim, max_ratio, ratio_floor_bytes.

    Raises
    ------
    RasterError
        Naming the field, its limit and the value.
    """
    if options["band"] != 1:
        raise RasterError("band", "1 (an array has one)", options["band"])
    place = parsed(options["georeference"])
    if kind == "npz":
        stored = read_npz(path, limits)
    else:
        with path.open("rb") as stream:
            stored = read_npy(stream, os.path.getsize(path), limits)
    unit = options["vertical_unit"] or "m"
    wide = (
        np.float32 if stored.dtype.itemsize <= 2 or stored.dtype.name == "float32" else np.float64
    )
    heights: NDArray[Any] = stored.astype(wide)
    nodata = number(place, "nodata")
    if nodata is not None:
        heights[stored == nodata] = np.nan
    heights *= wide(geodesy.vertical_factor(unit))
    crs, transform = geodesy.parse_crs(code(place)), affine(place)
    cell_size = None if options["cell_size"] is None else tuple(options["cell_size"])
    if cell_size is None:
        if transform is None:
            raise RasterError(
                "cell_size", "given, or a georeference with a transform", "neither of them"
            )
        if crs is None and max(transform.a, -transform.e) < 0.05:
            raise RasterError("georeference.crs", "given for cells in degrees", None)
        cell_size = geodesy.cell_size(crs, transform, heights.shape)
    return HeightGrid(heights, crs, transform, cell_size, unit), str(stored.dtype)


def read_npz(path: Path, limits: dict[str, Any]) -> NDArray[Any]:
    """Read the one array of an archive, or the one named heights."""
    try:
        check_archive(path, limits)
        with zipfile.ZipFile(path) as archive:
            names = [name for name in archive.namelist() if name.endswith(".npy")]
            chosen = HEIGHTS if HEIGHTS in names else names[0] if len(names) == 1 else None
            if chosen is None:
                limit = "an .npz with one array, or one named heights"
                raise RasterError("file", limit, ", ".join(names)[:200])
            with archive.open(chosen) as stream:
                return read_npy(stream, archive.getinfo(chosen).file_size, limits)
    except (ValueError, RuntimeError, zipfile.BadZipFile, zlib.error, NotImplementedError) as error:
        if isinstance(error, RasterError):
            raise
        raise RasterError("file", "a readable .npz file", str(error)) from None


def check_archive(path: Path, limits: dict[str, Any]) -> None:
    """Refuse an archive by its directory alone: names, number, sizes and ratios of its members."""
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
    except (ValueError, RuntimeError, zipfile.BadZipFile, NotImplementedError) as error:
        raise RasterError("file", KINDS, str(error)) from None
    if not 1 <= len(members) <= MAX_MEMBERS:
        raise RasterError("file", f"an .npz with 1 to {MAX_MEMBERS} members", len(members))
    names = [member.filename for member in members]
    for name in names:
        if not re.fullmatch(r"[\w. -]{1,100}\.npy", name) or name.startswith("."):
            raise RasterError("file", "an .npz with members of plain names, like a.npy", name)
    if len(set(names)) < len(names):
        raise RasterError("file", "an .npz with members of different names", names[0])
    if any(member.compress_type not in (0, 8) or member.flag_bits & 1 for member in members):
        raise RasterError("file", "an .npz that is stored or deflated, not encrypted", names[0])
    size, stored = sum(m.file_size for m in members), os.path.getsize(path)
    if size > limits["ratio_floor_bytes"] and size > limits["max_ratio"] * stored:
        limit = f"at most {limits['max_ratio']:g} decoded bytes a stored byte"
        raise RasterError("size", limit, round(size / stored, 1))


def read_npy(stream: IO[bytes], size: int, limits: dict[str, Any]) -> NDArray[Any]:
    """Read one array whose header says as many numbers as there are, and not too many."""
    try:
        version = np.lib.format.read_magic(stream)
        if version not in VERSIONS:
            raise ValueError(f"format version {version}")
        old = version == (1, 0)
        header = np.lib.format.read_array_header_1_0 if old else np.lib.format.read_array_header_2_0
        shape, fortran, dtype = header(stream, max_header_size=MAX_HEADER)
    except UNREADABLE as error:
        text = " ".join(str(error).split())
        raise RasterError("file", "a NumPy array with a readable header", text) from None
    if dtype.hasobject or dtype.kind not in "iuf" or dtype.itemsize > 8:
        raise RasterError("dtype", "whole or real numbers of at most 64 bits", str(dtype)[:100])
    if len(shape) != 2 or min(shape) < 1:
        raise RasterError("shape", "(rows, columns)", str(shape)[:100])
    if max(shape) > limits["max_dim"]:
        limit = f"at most {limits['max_dim']} rows or columns"
        raise RasterError("size", limit, f"{shape[0]} x {shape[1]}")
    if prod(shape) > limits["max_pixels"]:
        raise RasterError("size", f"at most {limits['max_pixels']} cells", prod(shape))
    wanted, left = prod(shape) * dtype.itemsize, size - stream.tell()
    if wanted != left:
        raise RasterError("file", f"as long as its header says ({wanted} bytes of numbers)", left)
    data = stream.read(wanted)
    if len(data) != wanted:
        raise RasterError("file", f"as long as its header says ({wanted} bytes)", len(data))
    return np.frombuffer(data, dtype).reshape(shape, order="F" if fortran else "C")


def parsed(text: str | None) -> dict[str, Any]:
    """Return the members of a georeference."""
    if text is None:
        return {}
    try:
        members = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise RasterError("georeference", "a JSON object", str(error)) from None
    if not isinstance(members, dict):
        raise RasterError("georeference", "a JSON object", type(members).__name__)
    for name in members:
        if name not in MEMBERS:
            limit = f"left out: a georeference has {', '.join(MEMBERS)}"
            raise RasterError(f"georeference.{name[:40]}", limit, members[name])
    return members


def number(place: dict[str, Any], name: str) -> float | None:
    """Return a finite number of a georeference."""
    value = place.get(name)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not finite(value):
        raise RasterError(f"georeference.{name}", "a finite number", value)
    return float(value)


def code(place: dict[str, Any]) -> str | None:
    """Return the reference system of a georeference: a code, for a text could name files."""
    value = place.get("crs")
    if value is not None and not (isinstance(value, str) and CODE.fullmatch(value)):
        raise RasterError("georeference.crs", "a code such as EPSG:2056", value)
    return value


def affine(place: dict[str, Any]) -> Affine | None:
    """Return the geotransform of a georeference: north up, no rotation."""
    value = place.get("transform")
    if value is None:
        return None
    numbers = value if isinstance(value, list) else []
    real = all(isinstance(v, int | float) and not isinstance(v, bool) for v in numbers)
    if len(numbers) != 6 or not real or not all(map(finite, numbers)):
        raise RasterError("georeference.transform", "six finite numbers a, b, c, d, e, f", value)
    a, b, c, d, e, f = map(float, numbers)
    if b != 0.0 or d != 0.0 or a <= 0.0 or e >= 0.0:
        limit = "north up without rotation: a above 0, e below 0, b and d 0"
        raise RasterError("georeference.transform", limit, [a, b, d, e])
    return Affine(a, b, c, d, e, f)


def finite(value: float) -> bool:
    """Whether a JSON number is finite as a float."""
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False
