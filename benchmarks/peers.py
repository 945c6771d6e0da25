"""Other tools' horizons, each in a process of its own: CPU time, and values where it gives them.

Run by `horizon.py` as ``python peers.py NAME dem.tif out.npz K``.  Writes `cpu_seconds` (user and
system, of the tool alone), `version`, `chosen` (which of the K azimuths from north were done: the
slow tools do every eighth, none of them an axis, for their cost is in proportion) and, where the
tool hands out horizons, `elevation_deg` (azimuths, rows, columns).  `rvt-py` wants GDAL's Python
bindings for its file reading only: ``pip install --no-deps rvt-py`` (and scipy) is enough here.
"""

import importlib.metadata
import importlib.util
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import rasterio

Result = dict[str, Any]

FEW = slice(1, None, 8)  # of the K azimuths, for tools that take minutes


def cpu_seconds(who: int = resource.RUSAGE_SELF) -> float:
    """CPU time [s] of this process, or of its ended children."""
    usage = resource.getrusage(who)
    return usage.ru_utime + usage.ru_stime


def whitebox(dem: Path, count: int) -> Result:
    """WhiteboxTools `horizon_angle`, one call an azimuth, rasters in memory."""
    import whitebox_workflows

    environment = whitebox_workflows.WbEnvironment()
    raster = environment.read_raster(str(dem))
    layers, spent = [], 0.0
    chosen = np.arange(count)[FEW]
    with tempfile.TemporaryDirectory() as folder:
        out = str(Path(folder) / "horizon.tif")
        for azimuth in chosen * 360.0 / count:
            start = cpu_seconds()
            horizon = environment.horizon_angle(raster, azimuth=float(azimuth))
            spent += cpu_seconds() - start
            environment.write_raster(horizon, out)
            with rasterio.open(out) as file:
                layers.append(file.read(1))
    return {
        "cpu_seconds": spent,
        "chosen": chosen,
        "elevation_deg": np.array(layers, dtype=np.float32),
        "version": importlib.metadata.version("whitebox-workflows"),
    }


def rvt(dem: Path, count: int, radius: int) -> Result:
    """RVT's search for the horizon, nearest cells out to `radius` cells.

    Its sky-view function adds the directions up; asked for the openness of one direction at a time
    it gives the horizon, by the same code.
    """
    import rvt.vis

    with rasterio.open(dem) as file:
        per_cell = file.read(1).astype(np.float32) / np.float32(file.res[0])
    shifts = rvt.vis.horizon_shift_vector(count, radius, 1)
    azimuths = np.mod(-np.array(list(shifts)), 360.0)  # its directions run from north to west
    layers = np.empty((count, *per_cell.shape), dtype=np.float32)
    spent = 0.0
    for azimuth, direction in zip(azimuths, list(shifts), strict=True):
        rvt.vis.horizon_shift_vector = lambda one=direction, **_: {one: shifts[one]}
        start = cpu_seconds()
        found = rvt.vis.sky_view_factor_compute(
            per_cell, radius, 1, 1, compute_svf=False, compute_opns=True
        )
        spent += cpu_seconds() - start
        layers[round(azimuth * count / 360.0) % count] = 90.0 - found["opns"]
    return {
        "cpu_seconds": spent,
        "chosen": np.arange(count),
        "elevation_deg": layers,
        "version": importlib.metadata.version("rvt-py"),
    }


def grass(dem: Path, count: int) -> Result:
    """GRASS `r.horizon`: start azimuth east, counter-clockwise, in degrees."""
    program = shutil.which("grass") or "grass"
    chosen = np.arange(count)[FEW]
    with tempfile.TemporaryDirectory() as folder:
        project = str(Path(folder) / "project")

        def run(*command: str, create: bool = False) -> str:
            new = ["-c", str(dem)] if create else []
            target = project if create else f"{project}/PERMANENT"
            done = subprocess.run(
                [program, *new, target, "--exec", *command],
                check=True,
                capture_output=True,
                text=True,
                env={**os.environ, "GRASS_OVERWRITE": "1"},
            )
            return done.stdout

        run("r.external", f"input={dem}", "output=dem", "-o", create=True)
        run("g.region", "raster=dem")
        start = cpu_seconds(resource.RUSAGE_CHILDREN)
        version = run("g.version").split()[1]
        empty = cpu_seconds(resource.RUSAGE_CHILDREN) - start
        spent, layers = 0.0, []
        for azimuth in chosen * 360.0 / count:
            start = cpu_seconds(resource.RUSAGE_CHILDREN)
            east = f"direction={(90.0 - azimuth) % 360.0}"
            run("r.horizon", "elevation=dem", east, "output=h", "-d")
            spent += cpu_seconds(resource.RUSAGE_CHILDREN) - start - empty
            name = run("g.list", "type=raster", "pattern=h*").split()[0]
            out = str(Path(folder) / "h.tif")
            run("r.out.gdal", f"input={name}", f"output={out}", "type=Float32")
            with rasterio.open(out) as file:
                layers.append(file.read(1))
            run("g.remove", "-f", "type=raster", f"name={name}")
    return {
        "cpu_seconds": spent,
        "chosen": chosen,
        "elevation_deg": np.array(layers),
        "version": version,
    }


def saga(dem: Path, count: int) -> Result:
    """SAGA's sky view factor: hands out no horizons, so its time alone."""
    chosen = np.arange(count)[FEW]  # a number of them: they go from north always
    with tempfile.TemporaryDirectory() as folder:
        command = ["saga_cmd", "--cores=2", "ta_lighting", "3", "-DEM", str(dem)]
        command += ["-VISIBLE", f"{folder}/visible.sdat", "-SVF", f"{folder}/svf.sdat"]
        command += ["-NDIRS", str(len(chosen)), "-METHOD", "0", "-RADIUS", "1000000"]
        version = subprocess.run(["saga_cmd", "--version"], capture_output=True, text=True).stdout
        start = cpu_seconds(resource.RUSAGE_CHILDREN)
        subprocess.run(command, check=True, capture_output=True)
        spent = cpu_seconds(resource.RUSAGE_CHILDREN) - start
    return {
        "cpu_seconds": spent,
        "chosen": chosen,
        "version": version.split(":")[-1].strip(),
    }


PEERS: dict[str, Callable[[Path, int], Result]] = {
    "whitebox": whitebox,
    "rvt-10": lambda dem, count: rvt(dem, count, 10),
    "rvt-100": lambda dem, count: rvt(dem, count, 100),
    "grass": grass,
    "saga": saga,
}


def missing(name: str) -> str | None:
    """Why a peer cannot run here, or None."""
    if name == "whitebox":
        found = importlib.util.find_spec("whitebox_workflows")
        return None if found else "whitebox-workflows is not installed"
    if name.startswith("rvt"):
        found = importlib.util.find_spec("rvt")
        return None if found else "rvt-py is not installed (pip install --no-deps rvt-py)"
    program = {"grass": "grass", "saga": "saga_cmd"}[name]
    return None if shutil.which(program) else f"{program} is not on the path"


if __name__ == "__main__":
    peer, dem_path, out_path, azimuth_count = sys.argv[1:]
    np.savez(out_path, **PEERS[peer](Path(dem_path), int(azimuth_count)))
