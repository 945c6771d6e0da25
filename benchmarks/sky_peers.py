"""Other tools' sky view and cast shadows, each in a process of its own: CPU time and the raster.

Run by `sky.py` as ``python sky_peers.py NAME dem.tif out.npz AZIMUTHS SUNS`` with the suns as
``azimuth,elevation;...`` in degrees. Writes `cpu_seconds` (user and system, of the tool alone),
`version`, and either `views` (names of what `sky` holds, rasters) or `shade` (suns, rows, columns;
True in cast shadow). Slow tools do fewer azimuths, which `azimuths` tells, or only the first suns.
"""

import importlib.metadata
import importlib.util
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
from numpy.typing import NDArray
from peers import cpu_seconds

Result = dict[str, Any]
Suns = list[tuple[float, float]]
CHILDREN = resource.RUSAGE_CHILDREN


def read(path: str | Path) -> NDArray[np.float32]:
    with rasterio.open(path) as file:
        return file.read(1, masked=True).astype(np.float32).filled(np.nan)


def cells(dem: Path) -> tuple[NDArray[np.float32], float]:
    """Heights and cell size [m]."""
    with rasterio.open(dem) as file:
        return file.read(1).astype(np.float32), float(file.res[0])


def whitebox_sky(dem: Path, count: int, _: Suns) -> Result:
    import whitebox_workflows

    environment = whitebox_workflows.WbEnvironment()
    raster = environment.read_raster(str(dem))
    start = cpu_seconds()
    # Its azimuths are a whole number of degrees apart or so; the eye stands on the ground.
    found = environment.sky_view_factor(raster, az_fraction=360.0 / count, observer_hgt_offset=0.0)
    spent = cpu_seconds() - start
    with tempfile.TemporaryDirectory() as folder:
        environment.write_raster(found, f"{folder}/sky.tif")
        sky = read(f"{folder}/sky.tif")
    version = importlib.metadata.version("whitebox-workflows")
    return {"cpu_seconds": spent, "version": version, "sky": [sky], "views": ["its own"]}


def whitebox_shade(dem: Path, _: int, suns: Suns) -> Result:
    import whitebox_workflows

    environment = whitebox_workflows.WbEnvironment()
    raster = environment.read_raster(str(dem))
    shade, spent = [], 0.0
    with tempfile.TemporaryDirectory() as folder:
        for azimuth, elevation in suns:
            start = cpu_seconds()
            horizon = environment.horizon_angle(raster, azimuth=azimuth)
            spent += cpu_seconds() - start
            environment.write_raster(horizon, f"{folder}/h.tif")
            shade.append(read(f"{folder}/h.tif") >= elevation)
    version = importlib.metadata.version("whitebox-workflows")
    return {"cpu_seconds": spent, "version": version, "shade": shade}


def rvt_sky(radius: int) -> Callable[[Path, int, Suns], Result]:
    def run(dem: Path, count: int, _: Suns) -> Result:
        import rvt.vis

        heights, size = cells(dem)
        start = cpu_seconds()
        found = rvt.vis.sky_view_factor(heights, size, svf_n_dir=count, svf_r_max=radius)
        spent = cpu_seconds() - start
        version = importlib.metadata.version("rvt-py")
        return {
            "cpu_seconds": spent,
            "version": version,
            "sky": [found["svf"]],
            "views": ["visible"],
        }

    return run


def rvt_pyramid(dem: Path, count: int, _: Suns) -> Result:
    """RVT's uniform sky: coarser heights further away."""
    import rvt.vis

    heights, size = cells(dem)
    start = cpu_seconds()
    found = rvt.vis.sky_illumination(
        heights / np.float32(size), 1, sky_model="uniform", num_directions=count
    )
    spent = cpu_seconds() - start
    version = importlib.metadata.version("rvt-py")
    return {"cpu_seconds": spent, "version": version, "sky": [found], "views": ["its own"]}


def rvt_shade(dem: Path, _: int, suns: Suns) -> Result:
    import rvt.vis

    heights, size = cells(dem)
    heights /= np.float32(size)  # it forms slopes a cell
    shade, spent = [], 0.0
    for azimuth, elevation in suns:
        start = cpu_seconds()
        found = rvt.vis.shadow_horizon(heights, 1, shadow_az=azimuth, shadow_el=elevation)
        spent += cpu_seconds() - start
        shade.append(np.asarray(found["shadow"]) == 0)
    return {
        "cpu_seconds": spent,
        "version": importlib.metadata.version("rvt-py"),
        "shade": shade,
    }


def surtgis_sky(dem: Path, count: int, _: Suns) -> Result:
    import surtgis

    heights, size = cells(dem)
    start = cpu_seconds()
    found = surtgis.sky_view_factor_compute(
        heights.astype(np.float64), size, count, max(heights.shape)
    )
    spent = cpu_seconds() - start
    version = importlib.metadata.version("surtgis")
    return {"cpu_seconds": spent, "version": version, "sky": [found], "views": ["its own"]}


def surtgis_shade(dem: Path, _: int, suns: Suns) -> Result:
    import surtgis

    heights, size = cells(dem)
    heights = heights.astype(np.float64)
    shade, spent = [], 0.0
    for azimuth, elevation in suns:
        start = cpu_seconds()
        found = surtgis.horizon_angle_map_compute(heights, size, azimuth, max(heights.shape))
        spent += cpu_seconds() - start
        shade.append(np.degrees(found) >= elevation)  # radians
    version = importlib.metadata.version("surtgis")
    return {"cpu_seconds": spent, "version": version, "shade": shade}


def solweig_shade(dem: Path, _: int, suns: Suns) -> Result:
    from solweig import rustalgos

    rustalgos.shadowing.disable_gpu()
    heights, size = cells(dem)
    highest = float(heights.max() - heights.min())
    shade, spent = [], 0.0
    for azimuth, elevation in suns:
        start = cpu_seconds()
        found = rustalgos.shadowing.calculate_shadows_wall_ht_25(
            azimuth, elevation, size, highest, heights, max_shadow_distance_m=1e6
        )
        spent += cpu_seconds() - start
        shade.append(np.asarray(found.bldg_sh) < 0.5)
    version = importlib.metadata.version("solweig")
    return {"cpu_seconds": spent, "version": version, "shade": shade}


def saga_sky(method: int) -> Callable[[Path, int, Suns], Result]:
    def run(dem: Path, count: int, _: Suns) -> Result:
        count //= 2  # the slowest of all
        with tempfile.TemporaryDirectory() as folder:
            command = ["saga_cmd", "--cores=2", "ta_lighting", "3", "-DEM", str(dem)]
            command += ["-VISIBLE", f"{folder}/visible.sdat", "-SVF", f"{folder}/sky.sdat"]
            command += ["-NDIRS", str(count), "-METHOD", str(method), "-RADIUS", "1000000"]
            start = cpu_seconds(CHILDREN)
            subprocess.run(command, check=True, capture_output=True)
            spent = cpu_seconds(CHILDREN) - start
            sky = [read(f"{folder}/sky.sdat")]  # "visible" is the mean of 90° - h
        return {
            "cpu_seconds": spent,
            "version": saga_version(),
            "sky": sky,
            "views": ["its own"],
            "azimuths": count,
        }

    return run


def saga_shade(dem: Path, _: int, suns: Suns) -> Result:
    shade, spent = [], 0.0
    with tempfile.TemporaryDirectory() as folder:
        for azimuth, elevation in suns:
            command = ["saga_cmd", "--cores=2", "ta_lighting", "0", "-ELEVATION", str(dem)]
            command += ["-SHADE", f"{folder}/shade.sdat", "-METHOD", "3", "-UNIT", "1"]
            command += ["-AZIMUTH", str(azimuth), "-DECLINATION", str(elevation)]
            start = cpu_seconds(CHILDREN)
            subprocess.run(command, check=True, capture_output=True)
            spent += cpu_seconds(CHILDREN) - start
            shade.append(np.isfinite(read(f"{folder}/shade.sdat")))
    return {"cpu_seconds": spent, "version": saga_version(), "shade": shade}


def saga_version() -> str:
    said = subprocess.run(["saga_cmd", "--version"], capture_output=True, text=True).stdout
    return said.split(":")[-1].strip()


def grass_shade(dem: Path, _: int, suns: Suns) -> Result:
    """`r.sunmask` of the first sun; a call that does nothing is subtracted."""
    suns = suns[:1]
    program = shutil.which("grass") or "grass"
    shade, spent = [], 0.0
    with tempfile.TemporaryDirectory() as folder:
        project = f"{folder}/project"

        def run(*command: str, create: bool = False) -> str:
            where = ["-c", str(dem), project] if create else [f"{project}/PERMANENT"]
            done = subprocess.run(
                [program, *where, "--exec", *command], check=True, capture_output=True, text=True
            )
            return done.stdout

        run("r.external", f"input={dem}", "output=dem", "-o", create=True)
        run("g.region", "raster=dem")
        start = cpu_seconds(CHILDREN)
        version = run("g.version").split()[1]
        empty = cpu_seconds(CHILDREN) - start
        for azimuth, elevation in suns:
            start = cpu_seconds(CHILDREN)
            sun = (f"altitude={elevation}", f"azimuth={azimuth}")
            run("r.sunmask", "-z", "elevation=dem", "output=s", *sun, "--overwrite")
            spent += cpu_seconds(CHILDREN) - start - empty
            run("r.out.gdal", "input=s", f"output={folder}/s.tif", "type=Byte", "nodata=255", "-f")
            shade.append(read(f"{folder}/s.tif") == 1)
            Path(f"{folder}/s.tif").unlink()
    return {"cpu_seconds": spent, "version": version, "shade": shade}


def embree_shade(dem: Path, _: int, suns: Suns) -> Result:
    """A ray a cell from a centimetre above it, over two triangles a square."""
    from ray_casting import Scene

    import adret

    scene = Scene(adret.Terrain.open(dem), "two")
    feet = scene.points + np.array([0.0, 0.0, 0.01])
    shade, spent = [], scene.build_seconds
    for azimuth, elevation in suns:
        a, e = np.radians([azimuth, elevation])
        way = np.array([np.sin(a) * np.cos(e), np.cos(a) * np.cos(e), np.sin(e)])
        start = cpu_seconds()
        hit = scene._occluded(feet, feet + 1e6 * way)
        spent += cpu_seconds() - start
        shade.append(hit.reshape(scene.shape))
    version = importlib.metadata.version("embreex")
    return {"cpu_seconds": spent, "version": version, "shade": shade}


SKY: dict[str, tuple[str, Callable[[Path, int, Suns], Result]]] = {
    "WhiteboxTools sky_view_factor": ("whitebox_workflows", whitebox_sky),
    "RVT, radius 10 cells": ("rvt", rvt_sky(10)),
    "RVT, radius 100 cells": ("rvt", rvt_sky(100)),
    "RVT sky_illumination, pyramid": ("rvt", rvt_pyramid),
    "SurtGIS": ("surtgis", surtgis_sky),
    "SAGA": ("saga_cmd", saga_sky(0)),
    "SAGA, multi scale": ("saga_cmd", saga_sky(1)),
}
SHADE: dict[str, tuple[str, Callable[[Path, int, Suns], Result]]] = {
    "WhiteboxTools horizon_angle": ("whitebox_workflows", whitebox_shade),
    "RVT shadow_horizon": ("rvt", rvt_shade),
    "SurtGIS horizon": ("surtgis", surtgis_shade),
    "SOLWEIG": ("solweig", solweig_shade),
    "GRASS r.sunmask": ("grass", grass_shade),
    "SAGA hillshade": ("saga_cmd", saga_shade),
    "Embree's rays": ("embreex", embree_shade),
}
PACKAGES = {"whitebox_workflows": "whitebox-workflows", "rvt": "rvt-py"}


def missing(needs: str) -> str | None:
    """Why what a peer needs is not here, or None."""
    if needs in ("saga_cmd", "grass"):
        return None if shutil.which(needs) else f"{needs} is not on the path"
    found = importlib.util.find_spec(needs)
    return None if found else f"{PACKAGES.get(needs, needs)} is not installed"


if __name__ == "__main__":
    peer, dem_path, out_path, azimuth_count, sun_list = sys.argv[1:]
    chosen = [(float(a), float(e)) for a, e in (s.split(",") for s in sun_list.split(";"))]
    _, work = (SKY | SHADE)[peer]
    np.savez(out_path, **work(Path(dem_path), int(azimuth_count), chosen))
