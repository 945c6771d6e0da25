"""Viewsheds of GDAL and GRASS, and the rules by which they decide, each in a few lines of our own.

The rules are written from what the tools do, in float64, and share no code with adret. Every
difference between a tool and the exact line of sight is one between its rule and that line.
"""

import ctypes
import json
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import rasterio
from numpy.typing import NDArray

Mask = NDArray[np.bool_]
Cell = tuple[int, int]

MODES = {"diagonal": 1, "edge": 2, "max": 3, "min": 4}
"""GDAL's ways to take the height that a cell needs; `gdal_viewshed` uses "edge"."""


def cpu_seconds(who: int = resource.RUSAGE_SELF) -> float:
    """CPU time [s] of this process, or of its ended children."""
    usage = resource.getrusage(who)
    return usage.ru_utime + usage.ru_stime


def missing(name: str) -> str | None:
    """Why a tool cannot run here, or None."""
    if name == "gdal":
        libraries = (Path(rasterio.__file__).parents[1] / "rasterio.libs").glob("libgdal*")
        return None if list(libraries) else "rasterio brings no GDAL library of its own"
    return None if shutil.which("grass") else "GRASS is not installed"


# ---------------------------------------------------------------- the tools


def gdal(
    dem: Path, x: float, y: float, eye: float, target: float = 0.0, mode: str = "edge"
) -> tuple[Mask, float]:
    """GDAL's viewshed on a flat earth, in the library that rasterio brings, and its CPU time."""
    (file,) = (Path(rasterio.__file__).parents[1] / "rasterio.libs").glob("libgdal*")
    library = ctypes.CDLL(str(file))
    pointer, number, text = ctypes.c_void_p, ctypes.c_double, ctypes.c_char_p
    library.GDALOpen.restype = library.GDALGetRasterBand.restype = pointer
    library.GDALViewshedGenerate.restype = pointer
    library.GDALGetRasterBand.argtypes = [pointer, ctypes.c_int]
    library.GDALClose.argtypes = [pointer]
    library.GDALViewshedGenerate.argtypes = [
        *(pointer, text, text, pointer),
        *([number] * 9),
        *(ctypes.c_int, number, pointer, pointer, ctypes.c_int, pointer),
    ]
    library.GDALAllRegister()
    with tempfile.TemporaryDirectory() as folder:
        out = f"{folder}/seen.tif"
        source = library.GDALOpen(str(dem).encode(), 0)
        band = library.GDALGetRasterBand(source, 1)
        places = (x, y, eye, target, 255.0, 0.0, 0.0, -1.0, 0.0)
        start = cpu_seconds()
        made = library.GDALViewshedGenerate(
            band, b"GTiff", out.encode(), None, *places, MODES[mode], 0.0, None, None, 1, None
        )
        spent = cpu_seconds() - start
        library.GDALClose(made)
        library.GDALClose(source)
        with rasterio.open(out) as result:
            return np.asarray(result.read(1) == 255), spent


GRASS = """
import json, resource, subprocess, sys

def run(*command):
    subprocess.run(command, check=True, capture_output=True)

def spent():
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime

dem, folder = sys.argv[1:3]
run("r.external", f"input={dem}", "output=dem", "-o")
run("g.region", "raster=dem")
times = []
for i, (x, y, eye, target) in enumerate(json.loads(sys.argv[3])):
    options = [f"coordinates={x},{y}", f"observer_elevation={eye}", f"target_elevation={target}"]
    start = spent()
    run("r.viewshed", "-b", "input=dem", f"output=seen{i}", "memory=4000", *options)
    times.append(spent() - start)
    run("r.out.gdal", f"input=seen{i}", f"output={folder}/{i}.tif", "type=Byte", "-f")
with open(f"{folder}/times.json", "w") as file:
    json.dump(times, file)
"""


def grass(
    dem: Path, views: Sequence[tuple[float, float, float, float]]
) -> tuple[list[Mask], list[float]]:
    """GRASS `r.viewshed` on a flat earth, in memory, and its CPU time, for (x, y, eye, target)."""
    with tempfile.TemporaryDirectory() as folder:
        command = ["grass", "-c", str(dem), f"{folder}/project", "--exec", sys.executable, "-c"]
        command += [GRASS, str(dem), folder, json.dumps(views)]
        subprocess.run(command, check=True, capture_output=True, text=True)
        masks = []
        for i in range(len(views)):
            with rasterio.open(f"{folder}/{i}.tif") as result:
                masks.append(np.asarray(result.read(1) == 1))
        return masks, json.loads(Path(folder, "times.json").read_text())


# ---------------------------------------------------------------- their rules


def gdal_rule(z: NDArray[np.floating], place: Cell, eye: float, target: float = 0.0) -> Mask:
    """What GDAL's "edge" mode sees from an eye `eye` high: needed heights, carried ring by ring.

    The height that a cell needs is that of the plane through the eye and the two cells of the ring
    before between which the ray passes, each taken at its own height or at the one that *it*
    needs, whichever is more. The ring of the eight neighbours needs nothing.
    """
    own = z.astype(np.float64) - eye
    needed = own.copy()
    seen = np.ones(z.shape, np.bool_)
    row, column = place
    for down in (slice(row, None), slice(row, None, -1)):
        for right in (slice(column, None), slice(column, None, -1)):
            for turned in (False, True):
                h, carried, out = (
                    (a[down, right].T if turned else a[down, right]) for a in (own, needed, seen)
                )
                for n in range(2, h.shape[1]):
                    y = np.arange(min(n, h.shape[0]))
                    beside = np.where(y > 0, carried[y - 1, n - 1], 0.0)
                    need = (beside * y + carried[y, n - 1] * (n - y)) / (n - 1)
                    if n < h.shape[0]:
                        need = np.append(need, carried[n - 1, n - 1] * n / (n - 1))
                    upto = len(need)
                    out[:upto, n] = h[:upto, n] + target >= need
                    carried[:upto, n] = np.maximum(h[:upto, n], need)
    return seen


def grass_rule(
    z: NDArray[np.floating],
    place: Cell,
    targets: Iterable[Cell],
    eye: float,
    cell_size: tuple[float, float] = (1.0, 1.0),
) -> list[bool]:
    """Whether GRASS sees these targets from an eye `eye` high.

    A cell hides with the polyline from one of its corners over its centre to another one; the
    polylines make up the diamonds |x| + |y| = 1, 2, ... round the observer. A corner is as
    high as the mean of its four cells, or, where one of them is nodata, as the centre. Between
    corner and centre the elevation angle is linear in the azimuth, both of a grid of squares. A
    line that meets a diamond exactly in a corner passes between the two cells.
    """
    return [_grass_sees(z, place, target, eye, cell_size) for target in targets]


def _grass_sees(
    z: NDArray[np.floating], place: Cell, target: Cell, eye: float, cell_size: tuple[float, float]
) -> bool:
    across, down = target[1] - place[1], target[0] - place[0]
    n, m = abs(across), abs(down)
    diamonds = np.arange(1, n + m)
    x = diamonds * n / (n + m)
    column = np.rint(x).astype(int)
    row = diamonds - column
    further = np.where(x > column, 1, -1)  # towards which corner
    column_beside, row_beside = column + further, row - further

    def height(r: NDArray[np.int64], c: NDArray[np.int64]) -> NDArray[np.float64]:
        r = place[0] + (r if down >= 0 else -r)
        c = place[1] + (c if across >= 0 else -c)
        inside = (r >= 0) & (r < z.shape[0]) & (c >= 0) & (c < z.shape[1])
        return np.where(inside, z[r * inside, c * inside], np.nan)

    centre = height(row, column)
    corner = centre + height(row_beside, column)
    corner = 0.25 * (corner + height(row, column_beside) + height(row_beside, column_beside))
    corner = np.where(np.isnan(corner), centre, corner)
    between = np.abs(x - column) < 0.5
    if not between.any():
        return True
    column_corner, row_corner = column + 0.5 * further, row - 0.5 * further
    width, length = cell_size
    to_centre = np.arctan((centre - eye) / np.hypot(column * width, row * length))
    to_corner = np.arctan((corner - eye) / np.hypot(column_corner * width, row_corner * length))
    start = np.arctan2(row, column)
    with np.errstate(invalid="ignore"):
        share = (np.arctan2(m, n) - start) / (np.arctan2(row_corner, column_corner) - start)
    share = np.where(x == column, 0.0, share)
    elevation = (to_centre + (to_corner - to_centre) * share)[between]
    top = np.arctan((z[target] - eye) / np.hypot(n * width, m * length))
    return bool(np.nanmax(elevation, initial=-np.inf) <= top)
