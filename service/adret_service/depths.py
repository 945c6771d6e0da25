"""Depth buffers as datasets: the upload's numbers, linear, and the camera that saw them.

Sky is stored as infinity and holes as NaN, so that what is read back is what the library would
have read from the upload itself.
"""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import rasterio

from adret import rasters
from adret.errors import RasterError
from adret.screen import Camera, DepthBuffer
from adret.screen.camera_files import stored_as
from adret.screen.depth_files import read_depth

__all__ = ["decode_depth", "read_depth_dataset"]

EXR = b"\x76\x2f\x31\x01"


def decode_depth(source: Path, target: Path, camera: str, limits: dict[str, Any]) -> dict[str, Any]:
    """Read an upload with its camera and write it again as linear depth.

    Parameters
    ----------
    source, target : Path
        The upload, and the GeoTIFF to write.
    camera : str
        A JSON object, as `Camera.from_mapping` and camera files have it.
    limits : dict
        exr: whether OpenEXR is read; max_pixels, max_dim.

    Raises
    ------
    InputError
        For a camera that is none, a file of another kind or size, or depth that does not fit it.
    """
    try:
        members = json.loads(camera)
    except (ValueError, RecursionError) as error:
        raise RasterError("camera", "a JSON object", str(error)) from None
    if not isinstance(members, dict):
        raise RasterError("camera", "a JSON object", type(members).__name__)
    seen = Camera.from_mapping(members)
    if max(seen.width, seen.height) > limits["max_dim"]:
        size = f"{seen.height} x {seen.width}"
        raise RasterError("size", f"at most {limits['max_dim']} rows or columns", size)
    if seen.width * seen.height > limits["max_pixels"]:
        limit = f"at most {limits['max_pixels']} pixels"
        raise RasterError("size", limit, seen.width * seen.height)
    with source.open("rb") as stream:
        if stream.read(4) == EXR and not limits["exr"]:
            raise RasterError("file", "a .npy, .npz, .tif or 16-bit .png file", "OpenEXR")
    stored = read_depth(source)
    said = stored_as(members)
    buffer = DepthBuffer(stored, seen, **said)
    depth = np.where(buffer.sky, np.float32(np.inf), buffer.depth)
    _write(target, depth)
    step = buffer.depth_step()
    surface = ~np.isnan(buffer.depth)
    if not surface.any():
        raise RasterError("depth", "with at least one pixel that shows a surface", "sky or holes")
    kept = ("kind", "scale", "hole", "guard_band", "guard_band_px", "frame", "depth")
    return {
        "kind": "depth",
        "rows": seen.height,
        "columns": seen.width,
        "camera": {k: v for k, v in members.items() if k not in kept},
        "guard_band": list(buffer.guard_band),
        "nearest": float(np.nanmin(buffer.depth)),
        "farthest": float(np.nanmax(buffer.depth)),
        "sky_pixels": int(buffer.sky.sum()),
        "hole_pixels": int(buffer.holes.sum()),
        "source": {"kind": buffer.kind, "dtype": str(stored.dtype), "step": float(np.nanmax(step))},
    }


def read_depth_dataset(path: Path, info: dict[str, Any]) -> DepthBuffer:
    """Return the depth buffer that the child wrote."""
    with rasterio.Env(**rasters.GDAL_OPTIONS), rasterio.open(path, driver="GTiff") as source:
        depth = source.read(1)
    camera = Camera.from_mapping(info["camera"])
    return DepthBuffer(depth, camera, guard_band=tuple(info["guard_band"]))


def _write(path: Path, depth: np.ndarray[Any, np.dtype[np.float32]]) -> None:
    rows, columns = depth.shape
    profile: dict[str, Any] = {
        "driver": "GTiff",
        "height": rows,
        "width": columns,
        "count": 1,
        "dtype": "float32",
        "nodata": math.nan,
        "tiled": True,
        "blockxsize": 512,
        "blockysize": 512,
        "compress": "zstd",
        "predictor": 3,
        "transform": rasterio.Affine(1.0, 0.0, 0.0, 0.0, -1.0, rows),
    }
    with rasterio.Env(**rasters.GDAL_OPTIONS), rasterio.open(path, "w", **profile) as target:
        target.write(depth, 1)
