"""Results as Zarr stores, put together from tiles shard by shard: whole, or not at all.

A store holds one array, named after the product, with the axes ``x`` and ``y`` (and ``band``), the
reference system as CF's grid mapping ``spatial_ref`` (which rioxarray and odc-geo read) and as
``_CRS`` (which GDAL reads), and CF's ``scale_factor``, ``add_offset`` and ``units``.
"""

import hashlib
import math
import os
import shutil
import tempfile
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adret.cogs import geotransform
from adret.errors import InputError
from adret.grids import RasterGrid

__all__ = ["FORMATS", "file_of", "store_digest", "write_store"]

FORMATS = {"cog": ".tif", "zarr": ".zarr", "zarr2": ".zarr"}
"""Formats of results, and how their names end."""

CHUNK = 512  # cells a side that are compressed together
SHARD = 2048  # cells a side of a file of Zarr 3

Span = tuple[int, int]
Read = Callable[[int, Span, Span], NDArray[Any]]


def file_of(product: str, form: str) -> str:
    """Name of a product's result.

    Raises
    ------
    InputError
        If the format is not known, or its package is not here.

    Examples
    --------
    >>> file_of("sky-view", "cog")
    'sky-view.tif'
    """
    if form not in FORMATS:
        raise InputError("format", f"one of {', '.join(FORMATS)}", form)
    if form != "cog":
        _zarr()
    return product + FORMATS[form]


def write_store(
    target: Path,
    read: Read,
    grid: RasterGrid,
    *,
    name: str,
    about: Mapping[str, Any],
    version: int,
) -> None:
    """Write a Zarr store from windows that are read one shard at a time.

    Parameters
    ----------
    target : Path
        Folder of the store; one that is there is replaced.
    read : callable
        read(band, rows, columns) -> stored numbers.
    grid : RasterGrid
    name : str
        Of the array.
    about : mapping
        names, unit, tags and encoding of the bands.
    version : int
        3, with shards of 2048 cells a side, or 2, which GDAL before 3.13 and QGIS read.
    """
    folder = Path(tempfile.mkdtemp(prefix=".adret-", dir=target.parent))
    try:
        folder.chmod(0o755)
        _fill(folder / "new", read, grid, name, about, version)
        if target.exists():
            os.replace(target, folder / "old")
        os.replace(folder / "new", target)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def store_digest(path: Path) -> str:
    """SHA-256 of a store's files and their names."""
    digest = hashlib.sha256()
    for file in sorted(each for each in path.rglob("*") if each.is_file()):
        digest.update(f"{file.relative_to(path)}\0{file.stat().st_size}\0".encode())
        with file.open("rb") as opened:
            digest.update(hashlib.file_digest(opened, "sha256").digest())
    return digest.hexdigest()


def _zarr() -> Any:
    try:
        return import_module("zarr")
    except ImportError:
        limit = 'cog where zarr is not installed (pip install "adret[zarr]")'
        raise InputError("format", limit, "zarr") from None


def _fill(
    path: Path, read: Read, grid: RasterGrid, name: str, about: Mapping[str, Any], version: int
) -> None:
    zarr = _zarr()
    (rows, columns), names, encoding = grid.shape, about["names"], about["encoding"]
    group = zarr.open_group(str(path), mode="w", zarr_format=version)
    group.attrs.update(about["tags"])
    place = geotransform(grid)
    geographic = grid.crs is not None and grid.crs.is_geographic
    unit = "degree" if geographic else "m"
    kinds = ("longitude", "latitude") if geographic else ("projection_x", "projection_y")
    ending = "" if geographic else "_coordinate"
    for axis, start, step, count, kind in (
        ("x", place.c, place.a, columns, kinds[0]),
        ("y", place.f, place.e, rows, kinds[1]),
    ):
        centres = start + step * (np.arange(count) + 0.5)
        words = {"units": unit, "standard_name": kind + ending}
        _array(group, axis, centres, (axis,), words, version)
    dims: tuple[str, ...] = ("y", "x")
    if len(names) > 1:
        dims = ("band", *dims)
        _array(group, "band", np.arange(1, len(names) + 1), ("band",), {}, version)
    crs: dict[str, Any] = {"GeoTransform": " ".join(f"{v!r}" for v in place.to_gdal())}
    attributes: dict[str, Any] = {
        "long_name": name if len(names) > 1 else names[0],
        "units": about["unit"],
        "grid_mapping": "spatial_ref",
    }
    if len(names) > 1:
        attributes["band_names"] = list(names)
    if grid.crs is not None:
        wkt = grid.crs.to_wkt()
        crs |= {"crs_wkt": wkt, "spatial_ref": wkt}
        attributes["_CRS"] = {"wkt": wkt}
    _array(group, "spatial_ref", np.int64(0), (), crs, version)
    nodata, dtype = encoding.get("nodata", math.nan), encoding.get("dtype", "float32")
    if encoding.get("scale") is not None:
        attributes["scale_factor"] = encoding["scale"]
        attributes["add_offset"] = encoding.get("offset") or 0.0
    if version == 3 and not math.isnan(nodata):
        attributes["_FillValue"] = int(nodata)  # version 2 says it in the array itself
    chunk = min(CHUNK, rows), min(CHUNK, columns)
    shard = tuple(
        min(SHARD // CHUNK, -(-length // own)) * own
        for length, own in zip((rows, columns), chunk, strict=True)
    )
    front = (1,) * (len(dims) - 2)
    stored = _empty(
        group,
        name,
        (len(names),) * len(front) + (rows, columns),
        dims,
        dtype,
        version,
        fill_value=nodata,
        chunks=(*front, *chunk),
        shards=(*front, *shard) if version == 3 else None,
    )
    stored.attrs.update({**stored.attrs, **attributes})
    for band in range(len(names)):
        for top in range(0, rows, shard[0]):
            for left in range(0, columns, shard[1]):
                down, across = (
                    (top, min(top + shard[0], rows)),
                    (left, min(left + shard[1], columns)),
                )
                stored[(band,) * len(front) + (slice(*down), slice(*across))] = read(
                    band, down, across
                )


def _array(
    group: Any, name: str, values: Any, dims: tuple[str, ...], words: dict[str, Any], version: int
) -> None:
    """A coordinate."""
    known = np.asarray(values)
    # xarray takes the fill value for nodata: none that an axis may hold.
    fill = math.nan if known.dtype.kind == "f" else np.iinfo(known.dtype).min
    made = _empty(group, name, known.shape, dims, known.dtype, version, fill_value=fill)
    made[...] = known
    made.attrs.update({**made.attrs, **words})


def _empty(
    group: Any,
    name: str,
    shape: tuple[int, ...],
    dims: tuple[str, ...],
    dtype: Any,
    version: int,
    **more: Any,
) -> Any:
    if version == 3:
        return group.create_array(name, shape=shape, dtype=dtype, dimension_names=dims, **more)
    made = group.create_array(name, shape=shape, dtype=dtype, **more)
    made.attrs["_ARRAY_DIMENSIONS"] = list(dims)
    return made
