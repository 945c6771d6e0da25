"""The child that opens what a stranger sent: it has limits, no environment and one file.

It checks what the header declares, reads the heights with the library's own reader and writes them
again as a tiled GeoTIFF. Nothing else in the service ever reads an uploaded file.
"""

import contextlib
import ctypes
import json
import math
import os
import resource
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
import rasterio.enums
from rasterio.errors import RasterioError

from adret import rasters
from adret.errors import InputError, RasterError
from adret.screen import DepthBuffer
from adret.terrain import Terrain
from adret_service.arrays import array_kind, check_archive, read_array
from adret_service.depths import decode_depth, read_depth_dataset
from adret_service.storage import HEIGHTS, UPLOAD

__all__ = ["child", "read_dataset", "send_drivers"]

KEPT_DRIVERS = {"GTiff", "COG", "PNG", "AAIGrid", "MEM"}
PR_SET_NO_NEW_PRIVS = 38
BLOCK = 512  # cells a side of a tile of the copy


def send_drivers(answer: int) -> None:
    """Write the names of all drivers of this GDAL build to a descriptor, as JSON."""
    with rasterio.Env() as environment:
        os.write(answer, json.dumps(sorted(environment.drivers())).encode())


def child(answer: int, folder: str, limits: dict[str, Any], options: dict[str, Any]) -> None:
    """Decode ``folder/upload`` into ``folder/heights.tif``; write what was found or refused.

    Parameters
    ----------
    answer : int
        Descriptor that gets one JSON object: {"info": ...} or {"refused": {status, field, limit,
        value}}.
    folder : str
        Private folder of this upload.
    limits : dict
        memory [bytes], seconds, file_bytes, max_pixels, max_dim, max_bands, max_block_bytes,
        max_ratio, ratio_floor_bytes, drivers (all names of this build).
    options : dict
        band, cell_size, vertical_unit, as `Terrain.open` takes them; camera of a depth buffer;
        georeference of an array.
    """
    confine(folder, limits)
    try:
        result = {"info": decode(limits, options)}
    except InputError as error:
        result = {"refused": refusal(error)}
    except MemoryError:
        limit = f"decodable within {limits['memory']} bytes of memory"
        result = refused(413, "file", limit, "more is needed")
    except RasterioError as error:
        said = str(error).replace(str(Path(folder) / UPLOAD), "the file")
        result = refused(400, "file", "a readable raster", " ".join(said.split()))
    except OSError as error:
        status = 507 if error.errno in (28, 122) else 400
        result = refused(status, "file", "readable, and its copy writable", error.strerror)
    with os.fdopen(answer, "w", encoding="utf-8") as stream:
        json.dump(result, stream)


def confine(folder: str, limits: dict[str, Any]) -> None:
    """Give up what decoding does not need, before a byte of the file is looked at."""
    os.environ.clear()
    os.environ["GDAL_SKIP"] = ",".join(n for n in limits["drivers"] if n not in KEPT_DRIVERS)
    os.environ["OGR_SKIP"] = os.environ["GDAL_SKIP"]
    os.environ["GDAL_NUM_THREADS"] = "1"
    os.chdir(folder)
    with contextlib.suppress(OSError, AttributeError):  # Linux only
        ctypes.CDLL(None).prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0)
    for what, soft in (
        (resource.RLIMIT_AS, limits["memory"]),
        (resource.RLIMIT_CPU, math.ceil(limits["seconds"])),
        (resource.RLIMIT_FSIZE, limits["file_bytes"]),
        (resource.RLIMIT_NOFILE, 64),
        (resource.RLIMIT_CORE, 0),
    ):
        hard = resource.getrlimit(what)[1]
        bound = soft if hard == resource.RLIM_INFINITY else min(soft, hard)
        resource.setrlimit(what, (bound, bound))


def decode(limits: dict[str, Any], options: dict[str, Any]) -> dict[str, Any]:
    """Check, read and write again; the folder of the upload is the current one."""
    kind = array_kind(Path(UPLOAD))
    if options["camera"] is not None:
        check_depth(kind, limits)
        return decode_depth(Path(UPLOAD), Path(HEIGHTS), options["camera"], limits)
    if kind is not None:
        grid, dtype = read_array(Path(UPLOAD), kind, options, limits)
        return kept(grid, {"driver": kind.upper(), "dtype": dtype}, options)
    if options["georeference"] is not None:
        limit = "left out: only .npy and .npz files need one"
        raise RasterError("georeference", limit, options["georeference"])
    source = check_header(limits)
    cell_size = None if options["cell_size"] is None else tuple(options["cell_size"])
    grid = rasters.open_heights(
        UPLOAD,
        options["band"],
        vertical_unit=options["vertical_unit"],
        cell_size=cell_size,
        limits=rasters.ReadLimits(
            max_pixels=limits["max_pixels"],
            max_side=limits["max_dim"],
            max_block_bytes=limits["max_block_bytes"],
        ),
    )
    return kept(grid, source, options)


def check_depth(kind: str | None, limits: dict[str, Any]) -> None:
    """Refuse a depth buffer whose header alone condemns it."""
    with open(UPLOAD, "rb") as file:
        start = file.read(4)
    if kind == "npz":
        check_archive(Path(UPLOAD), limits)
    elif start.startswith((b"II", b"MM", b"\x89PNG")):
        check_header(limits)


def kept(
    grid: rasters.HeightGrid, source: dict[str, Any], options: dict[str, Any]
) -> dict[str, Any]:
    """Write what was read; returns what a dataset says of itself."""
    terrain = Terrain(grid.heights, grid.cell_size, grid.crs, grid.transform)
    write(terrain)
    low, high = np.nanmin(terrain.heights), np.nanmax(terrain.heights)
    return {
        "kind": "terrain",
        "rows": terrain.shape[0],
        "columns": terrain.shape[1],
        "cell_size": list(terrain.cell_size),
        "crs": None if terrain.crs is None else terrain.crs.to_wkt(),
        "crs_name": None if terrain.crs is None else terrain.crs.name,
        "epsg": None if terrain.crs is None else terrain.crs.to_epsg(),
        "transform": None if terrain.transform is None else list(terrain.transform[:6]),
        "datum": terrain.datum,
        "lowest": float(low) + terrain.datum,
        "highest": float(high) + terrain.datum,
        "nodata_cells": int(terrain.mask.sum()),
        "source": source | {"vertical_unit": grid.vertical_unit, "band": options["band"]},
    }


def check_header(limits: dict[str, Any]) -> dict[str, Any]:
    """Refuse what the header alone condemns; returns driver and stored type."""
    path, driver = rasters.sniff_driver(UPLOAD, "file")
    with rasterio.Env(**rasters.GDAL_OPTIONS), rasterio.open(path, driver=driver) as source:
        count, kind = source.count, source.dtypes[0]
        rows, columns = source.height, source.width
        block = math.prod(source.block_shapes[0]) * np.dtype(kind).itemsize
    if count > limits["max_bands"]:
        raise RasterError("bands", f"at most {limits['max_bands']}", count)
    if max(rows, columns) > limits["max_dim"]:
        raise RasterError(
            "size", f"at most {limits['max_dim']} rows or columns", f"{rows} x {columns}"
        )
    if rows * columns > limits["max_pixels"]:
        raise RasterError("size", f"at most {limits['max_pixels']} cells", rows * columns)
    if block > limits["max_block_bytes"]:
        limit = f"at most {limits['max_block_bytes']} bytes a tile or strip (re-tile it)"
        raise RasterError("block", limit, block)
    decoded = rows * columns * np.dtype(kind).itemsize
    ratio = decoded / os.path.getsize(UPLOAD)
    if decoded > limits["ratio_floor_bytes"] and ratio > limits["max_ratio"]:
        limit = f"at most {limits['max_ratio']:g} decoded bytes a stored byte"
        raise RasterError("size", limit, round(ratio, 1))
    if driver == "AAIGrid":
        rasters.check_numbers(UPLOAD, "file")
    return {"driver": driver, "dtype": kind}


def write(terrain: Terrain) -> None:
    """Write heights above the datum as float32, the datum as the band's offset, and halved copies.

    The copies are what map tiles of a large raster are made from.
    """
    rows, columns = terrain.shape
    dx, dy = terrain.cell_size
    profile: dict[str, Any] = {
        "driver": "GTiff",
        "height": rows,
        "width": columns,
        "count": 1,
        "dtype": "float32",
        "nodata": math.nan,
        "tiled": True,
        "blockxsize": BLOCK,
        "blockysize": BLOCK,
        "compress": "zstd",
        "predictor": 3,
        "bigtiff": "if_safer",
        "transform": terrain.transform or rasterio.Affine(dx, 0.0, 0.0, 0.0, -dy, 0.0),
    }
    with rasterio.Env(**rasters.GDAL_OPTIONS), rasterio.open(HEIGHTS, "w", **profile) as target:
        if terrain.crs is not None:
            target.crs = rasterio.CRS.from_wkt(terrain.crs.to_wkt())
        target.offsets = (terrain.datum,)
        target.units = ("m",)
        target.write(terrain.heights, 1)
        factors = [2**k for k in range(1, math.ceil(math.log2(max(rows, columns) / BLOCK)) + 1)]
        if factors:
            target.build_overviews(factors, rasterio.enums.Resampling.average)


def read_dataset(path: Path, info: dict[str, Any]) -> Terrain | DepthBuffer:
    """Return the terrain or the depth buffer that the child wrote, equal to what it had read.

    Parameters
    ----------
    path : Path
        The raster in the store.
    info : dict
        What the child sent: a GeoTIFF cannot carry every reference system exactly, this does.
    """
    if info.get("kind") == "depth":
        return read_depth_dataset(path, info)
    with rasterio.Env(**rasters.GDAL_OPTIONS), rasterio.open(path, driver="GTiff") as source:
        heights = source.read(1).astype(np.float64)
    heights += info["datum"]
    return Terrain(
        heights,
        tuple(info["cell_size"]),
        info["crs"],
        None if info["transform"] is None else rasterio.Affine(*info["transform"]),
        datum=info["datum"],
    )


def refusal(error: InputError) -> dict[str, Any]:
    """Turn the reader's refusal into status, field, limit and value."""
    field = "file" if error.field == "path" else error.field
    if error.field == "file" and "GeoTIFF" in error.limit:
        with open(UPLOAD, "rb") as file:
            return entry(415, field, error.limit, f"a file that starts with {file.read(16)!r}")
    status = 413 if field in ("size", "block", "bands") else 400
    value = error.value if isinstance(error.value, int | float | None) else str(error.value)
    return entry(status, field, error.limit, value)


def refused(status: int, field: str, limit: str, value: Any) -> dict[str, Any]:
    """Wrap a refusal."""
    return {"refused": entry(status, field, limit, value)}


def entry(status: int, field: str, limit: str, value: Any) -> dict[str, Any]:
    """One refusal as JSON."""
    return {"status": status, "field": field, "limit": limit, "value": value}
