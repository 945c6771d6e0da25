"""Horizon maps in files: a GeoTIFF with one band an azimuth, or a Zarr store.

Angles are stored in degrees, as whole numbers with a scale and an offset (GDAL's for a GeoTIFF,
``scale_factor`` and ``add_offset`` of CF for Zarr), so that rasterio, GDAL and xarray give degrees
back. Azimuths and options go along in the metadata.
"""

import json
import math
import os
import shutil
import tempfile
from dataclasses import asdict, dataclass, fields
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from adret._gdal import GDAL_OPTIONS, PathLike, check_output
from adret._values import one_of
from adret.cogs import encoder, geotransform, write
from adret.errors import InputError, RasterError
from adret.report import RunReport

if TYPE_CHECKING:
    from adret.horizon import HorizonMap
    from adret.terrain import Terrain

__all__ = ["ANGLES", "Angles", "load", "save"]

Stored = Literal["uint16", "uint8", "float32"]
LOWEST = -90.0


@dataclass(frozen=True, slots=True)
class Angles:
    """How angles from -90 to 90 degrees are stored; all bits set are nodata.

    Attributes
    ----------
    dtype : str
    step : float or None
        Degrees from one number to the next; an angle is off by half of it at most. None for
        float32, which holds degrees themselves.
    nodata : float
    """

    dtype: Stored
    step: float | None
    nodata: float


ANGLES: dict[str, Angles] = {
    "uint16": Angles("uint16", 180.0 / 65534.0, 65535),
    "uint8": Angles("uint8", 180.0 / 254.0, 255),
    "float32": Angles("float32", None, math.nan),
}
"""Number type -> how angles are stored: steps of 0.0027, of 0.71 degrees, or none."""

OPTIONS = "ADRET_HORIZON_OPTIONS"
AZIMUTHS = "ADRET_AZIMUTHS_RAD"


def save(horizons: "HorizonMap", path: PathLike, dtype: Stored, overwrite: bool) -> None:
    """Write a horizon map; see `HorizonMap.save`."""
    one_of("dtype", dtype, tuple(ANGLES))
    angles = ANGLES[dtype]
    tags = {
        AZIMUTHS: json.dumps(horizons.azimuth.tolist()),
        OPTIONS: json.dumps(asdict(horizons.options)),
    }
    if os.fspath(path).endswith(".zarr"):
        _save_zarr(horizons, path, angles, tags, overwrite)
        return
    write(
        path,
        enumerate(_degrees(layer) for layer in horizons.elevation),
        horizons.terrain,
        names=[f"azimuth {math.degrees(a):.10g} deg" for a in horizons.azimuth],
        unit="degree",
        tags=tags,
        nodata=angles.nodata,
        dtype=dtype,
        scale=angles.step,
        offset=None if angles.step is None else LOWEST,
        resampling="nearest",
        overwrite=overwrite,
    )


def load(path: PathLike, terrain: "Terrain") -> "HorizonMap":
    """Read a horizon map; see `HorizonMap.open`."""
    from adret.horizon import HorizonMap, HorizonOptions

    read = _read_zarr if os.fspath(path).endswith(".zarr") else _read_tiff
    elevation, tags = read(path)
    if AZIMUTHS not in tags or OPTIONS not in tags:
        raise RasterError("path", "a horizon map that HorizonMap.save wrote", os.fspath(path))
    azimuth = np.array(json.loads(tags[AZIMUTHS]), dtype=np.float64)
    known = {each.name for each in fields(HorizonOptions)}
    options = HorizonOptions(**{k: v for k, v in json.loads(tags[OPTIONS]).items() if k in known})
    if elevation.shape != (azimuth.size, *terrain.shape):
        raise InputError("terrain", f"of the file's shape {elevation.shape[1:]}", terrain.shape)
    report = RunReport(
        method=options.method,
        near=options.near if options.method == "sweep" else 0,
        azimuths_swept=0,
        azimuths_skipped=0,
        cells=terrain.mask.size,
        cells_skipped=int(terrain.mask.sum()),
        bands=1,
        seconds=0.0,
    )
    return HorizonMap(elevation, azimuth, None, terrain, options, report)


def _degrees(layer: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.degrees(layer)


def _read_tiff(path: PathLike) -> tuple[NDArray[np.float32], dict[str, str]]:
    import rasterio

    from adret._gdal import sniff_driver

    absolute, driver = sniff_driver(path, "path")
    with rasterio.Env(**GDAL_OPTIONS), rasterio.open(absolute, driver=driver) as dataset:
        tags = dataset.tags()
        shape = (dataset.count, dataset.height, dataset.width)
        elevation = np.empty(shape, np.float32)
        for k in range(dataset.count):
            numbers = dataset.read(k + 1)
            angle = numbers * dataset.scales[k] + dataset.offsets[k]
            angle[numbers == dataset.nodata] = np.nan
            elevation[k] = np.radians(angle)
    return elevation, tags


def _zarr() -> Any:
    try:
        return import_module("zarr")
    except ImportError:
        raise InputError(
            "path", "a .tif where the package zarr is not installed", ".zarr"
        ) from None


def _save_zarr(
    horizons: "HorizonMap", path: PathLike, angles: Angles, tags: dict[str, str], overwrite: bool
) -> None:
    """A store with the arrays `horizon`, `azimuth`, `x` and `y`, as xarray reads it."""
    zarr = _zarr()
    target = Path(os.path.abspath(path))
    if not target.is_dir():
        check_output(target, field="path", overwrite=overwrite)
    elif not overwrite:
        raise RasterError("path", "a new file (or ask to overwrite)", os.fspath(path))
    terrain = horizons.terrain
    place = geotransform(terrain)
    rows, columns = terrain.shape
    folder = Path(tempfile.mkdtemp(prefix=".adret-", dir=target.parent))
    try:
        group = zarr.open_group(str(folder / "new"), mode="w", zarr_format=2)
        group.attrs.update(tags)
        if terrain.crs is not None:
            group.attrs["crs_wkt"] = terrain.crs.to_wkt()
        for name, values, unit in (
            ("azimuth", np.degrees(horizons.azimuth), "degree"),
            ("y", place.f + place.e * (np.arange(rows) + 0.5), "m"),
            ("x", place.c + place.a * (np.arange(columns) + 0.5), "m"),
        ):
            # xarray takes the fill value for nodata: not 0, which an axis may hold.
            axis = group.create_array(
                name, shape=values.shape, dtype=values.dtype, fill_value=math.nan
            )
            axis[:] = values
            axis.attrs.update({"_ARRAY_DIMENSIONS": [name], "units": unit})
        stored = group.create_array(
            "horizon",
            shape=horizons.elevation.shape,
            chunks=(1, min(512, rows), min(512, columns)),
            dtype=angles.dtype,
            fill_value=angles.nodata,
        )
        about: dict[str, Any] = {"_ARRAY_DIMENSIONS": ["azimuth", "y", "x"], "units": "degree"}
        if angles.step is not None:
            about |= {
                "scale_factor": angles.step,
                "add_offset": LOWEST,
                "_FillValue": angles.nodata,
            }
        stored.attrs.update(about)
        offset = None if angles.step is None else LOWEST
        encode = encoder(angles.dtype, angles.step, offset, angles.nodata)
        for k, layer in enumerate(horizons.elevation):
            stored[k] = encode(_degrees(layer))
        zarr.consolidate_metadata(group.store)
        if target.exists():
            os.replace(target, folder / "old")
        os.replace(folder / "new", target)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _read_zarr(path: PathLike) -> tuple[NDArray[np.float32], dict[str, str]]:
    zarr = _zarr()
    given = os.path.abspath(os.fspath(path))
    if not os.path.isdir(given):
        raise RasterError("path", "an existing Zarr store", os.fspath(path))
    group = zarr.open_group(given, mode="r")
    if "horizon" not in group:
        raise RasterError("path", "a horizon map that HorizonMap.save wrote", os.fspath(path))
    stored = group["horizon"]
    elevation = np.empty(stored.shape, np.float32)
    scale, offset = stored.attrs.get("scale_factor", 1.0), stored.attrs.get("add_offset", 0.0)
    nodata = stored.attrs.get("_FillValue", math.nan)
    for k in range(len(elevation)):
        numbers = np.asarray(stored[k])
        angle = numbers * scale + offset
        angle[numbers == nodata] = np.nan
        elevation[k] = np.radians(angle)
    return elevation, {k: str(v) for k, v in group.attrs.items()}
