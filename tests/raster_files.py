"""Small rasters on disk for the tests."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from affine import Affine
from rasterio.errors import NotGeoreferencedWarning

NORTH_UP = Affine(10.0, 0.0, 500_000.0, 0.0, -10.0, 5_000_000.0)


def save(
    path: Path,
    heights: Any,
    *,
    crs: str | None = "EPSG:32633",
    transform: Affine | None = NORTH_UP,
    driver: str = "GTiff",
    unit: str | None = None,
    scale: float = 1.0,
    offset: float = 0.0,
    **profile: Any,
) -> Path:
    """Write bands (rows, columns) or (bands, rows, columns) with rasterio and return the path."""
    array = np.asarray(heights)
    stack = array[np.newaxis] if array.ndim == 2 else array
    count, rows, columns = stack.shape
    if transform is not None:
        profile["transform"] = transform
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        with rasterio.open(
            path,
            "w",
            driver=driver,
            height=rows,
            width=columns,
            count=count,
            dtype=stack.dtype,
            crs=crs,
            **profile,
        ) as target:
            target.write(stack)
            if unit is not None:
                target.units = (unit,) * count
            if (scale, offset) != (1.0, 0.0):
                target.scales = (scale,) * count
                target.offsets = (offset,) * count
    return path


def crop(
    source: Path,
    path: Path,
    rows: int,
    columns: int,
    *,
    corner: tuple[int, int] = (0, 0),
    void: tuple[int, int, int, int] | None = None,
    shift: float = 0.0,
) -> Path:
    """Write a window of a raster, with a void (rows, columns from, to), `shift` cells aside."""
    with rasterio.open(source) as dataset:
        top, left = corner
        window = (
            (top, min(top + rows, dataset.height)),
            (left, min(left + columns, dataset.width)),
        )
        values = dataset.read(1, window=window)
        profile = dataset.profile
    nodata = profile["nodata"]
    if void is not None:
        values[void[0] : void[1], void[2] : void[3]] = nodata
    origin = profile["transform"] @ Affine.translation(left + shift, top)
    return save(path, values, crs=profile["crs"], transform=origin, nodata=nodata)
