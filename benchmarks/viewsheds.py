"""Viewsheds: run time, growth with size, and agreement with other tools.

``python benchmarks/viewsheds.py`` prints tables and writes results/viewsheds.json, with machine,
versions and commit. Times are CPU time of all threads, the least of several repeats of our own, one
run of the others; of GRASS without starting it and converting files. GDAL's viewshed
is called in the library that rasterio brings, GRASS's `r.viewshed` where GRASS is installed. Real
rasters come from $ADRET_DATA or ../shared/data; without them only the example DEM is measured.

Two viewsheds are compared outside a band of one cell: cells whose eight neighbours all have the
same verdict here. ``sees more`` is the share of the compared cells that only the other tool sees.
"""

import argparse
import ctypes
import json
import os
import resource
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import present
import rasterio
from numpy.typing import NDArray

import adret

REPOSITORY = Path(__file__).resolve().parents[1]
EXAMPLE = REPOSITORY / "examples" / "data" / "alpine_aletsch_dhm200_lv95_200m.tif"
DEMS = (
    "alpine_bigtujunga_srtm1_utm11_30m",
    "lidar_slovenia_tm1_1m",
    "urban_toulouse_mnh_utm31_05m",
)
SIZES = (500, 1000, 2000, 4000)

Mask = NDArray[np.bool_]
Entry = dict[str, Any]


def cpu_seconds(who: int = resource.RUSAGE_SELF) -> float:
    """CPU time [s] of this process, or of its ended children."""
    usage = resource.getrusage(who)
    return usage.ru_utime + usage.ru_stime


def gdal(dem: Path, x: float, y: float, eye: float, target: float) -> tuple[Mask, float]:
    """GDAL's viewshed as `gdal_viewshed` runs it: mode "edge", flat earth."""
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
            band, b"GTiff", out.encode(), None, *places, 2, 0.0, None, None, 1, None
        )
        spent = cpu_seconds() - start
        library.GDALClose(made)
        library.GDALClose(source)
        with rasterio.open(out) as result:
            return np.asarray(result.read(1) == 255), spent


def grass(dem: Path, x: float, y: float, eye: float, target: float) -> tuple[Mask, float]:
    """GRASS `r.viewshed`: flat earth, in memory."""
    program = shutil.which("grass") or "grass"
    with tempfile.TemporaryDirectory() as folder:
        project = f"{folder}/project"

        def run(*command: str, create: bool = False) -> None:
            start = ["-c", str(dem), project] if create else [f"{project}/PERMANENT"]
            subprocess.run(
                [program, *start, "--exec", *command], check=True, capture_output=True, text=True
            )

        run("r.external", f"input={dem}", "output=dem", "-o", create=True)
        run("g.region", "raster=dem")
        options = [f"coordinates={x},{y}", f"observer_elevation={eye}"]
        options += [f"target_elevation={target}", "memory=4000"]
        before = cpu_seconds(resource.RUSAGE_CHILDREN)
        run("g.version")
        between = cpu_seconds(resource.RUSAGE_CHILDREN)
        run("r.viewshed", "-b", "input=dem", "output=seen", *options)
        spent = cpu_seconds(resource.RUSAGE_CHILDREN) - between - (between - before)
        run("r.out.gdal", "input=seen", f"output={folder}/seen.tif", "type=Byte", "-f")
        with rasterio.open(f"{folder}/seen.tif") as result:
            return np.asarray(result.read(1) == 1), spent


def missing(name: str) -> str | None:
    """Why a tool cannot run here, or None."""
    if name == "gdal":
        libraries = (Path(rasterio.__file__).parents[1] / "rasterio.libs").glob("libgdal*")
        return None if list(libraries) else "rasterio brings no GDAL library of its own"
    return None if shutil.which("grass") else "GRASS is not installed"


def inner(mask: Mask) -> Mask:
    """Cells whose eight neighbours have their own verdict."""
    padded = np.pad(mask, 1, mode="edge")
    same = np.ones_like(mask)
    rows, columns = mask.shape
    for i in range(3):
        for j in range(3):
            same &= padded[i : i + rows, j : j + columns] == mask
    return same


def compared(own: Mask, other: Mask, valid: Mask) -> Entry:
    """How two verdicts agree, everywhere and outside the band."""
    clear = inner(own) & valid
    return {
        "agree": float((own == other)[valid].mean()),
        "agree_outside_band": float((own == other)[clear].mean()),
        "sees_more": float((other & ~own)[clear].mean()),
        "sees_less": float((own & ~other)[clear].mean()),
        "band": float(1.0 - clear.sum() / valid.sum()),
    }


def scenes() -> list[Path]:
    """Rasters to measure on."""
    folder = Path(os.environ.get("ADRET_DATA", REPOSITORY.parent / "shared" / "data")) / "dem"
    return [
        EXAMPLE,
        *(folder / f"{name}.tif" for name in DEMS if (folder / f"{name}.tif").exists()),
    ]


def agreement(observers: int) -> list[Entry]:
    """Every tool on every raster from some observers; and the times of all."""
    tools: dict[str, Callable[..., tuple[Mask, float]]] = {"gdal": gdal, "grass": grass}
    for name in list(tools):
        if reason := missing(name):
            print(f"  {name}: left out, {reason}")
            del tools[name]
    rows = []
    for dem in scenes():
        terrain = adret.Terrain.open(dem)
        assert terrain.transform is not None
        adret.viewshed(terrain, (0, 0), max_distance=min(terrain.cell_size) * 3)
        rng = np.random.default_rng(3)
        for eye in (1.6, 30.0):
            for row, column in rng.integers(10, np.array(terrain.shape) - 10, (observers, 2)):
                x = terrain.transform.c + terrain.transform.a * (column + 0.5)
                y = terrain.transform.f + terrain.transform.e * (row + 0.5)
                own, spent = timed(terrain, (row, column), eye)
                for name, tool in tools.items():
                    other, theirs = tool(dem, x, y, eye, 0.0)
                    entry = {
                        "dem": dem.stem,
                        "tool": name,
                        "eye": eye,
                        "observer": [int(row), int(column)],
                        "seen": float(own.mean()),
                        **compared(own, other, ~terrain.mask),
                        "own_cpu_seconds": spent,
                        "cpu_seconds": theirs,
                    }
                    rows.append(entry)
                    shares = "  ".join(
                        f"{key} {entry[key]:.3%}"
                        for key in ("seen", "agree", "agree_outside_band", "sees_more", "sees_less")
                    )
                    print(f"  {dem.stem[:20]} {name} eye {eye} m  {shares}", flush=True)
                    print(f"    {spent:.3f} s against {theirs:.3f} s", flush=True)
    return rows


def timed(terrain: adret.Terrain, place: tuple[int, int], eye: float) -> tuple[Mask, float]:
    """Our viewshed, and the least CPU time of three runs."""
    spent = []
    for _ in range(3):
        start = cpu_seconds()
        seen = adret.viewshed(terrain, place, observer_height=eye).visible
        spent.append(cpu_seconds() - start)
    return seen, min(spent)


def growth() -> list[Entry]:
    """Time of one observer in the middle, by the raster's side: fractal ground."""
    rows = []
    rng = np.random.default_rng(1)
    for side in SIZES:
        spectrum = rng.normal(size=(side, side)) + 1j * rng.normal(size=(side, side))
        frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(side), np.fft.fftfreq(side)))
        frequency[0, 0] = np.inf
        ground = np.fft.ifft2(spectrum / frequency**2.0).real
        terrain = adret.Terrain(300.0 * ground / ground.std(), (30.0, 30.0))
        timed(terrain, (side // 2, side // 2), 10.0)
        seen, spent = timed(terrain, (side // 2, side // 2), 10.0)
        entry = {"side": side, "cpu_ns_a_cell": spent / side**2 * 1e9, "seen": float(seen.mean())}
        rows.append(entry)
        print(f"  {side:5d} cells a side  {entry['cpu_ns_a_cell']:6.0f} ns a cell", flush=True)
    return rows


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--observers", type=int, default=2, help="a raster and eye height")
    chosen = parser.parse_args()
    results = {
        "about": present.about(),
        "growth": growth(),
        "agreement": agreement(chosen.observers),
    }
    folder = REPOSITORY / "benchmarks" / "results"
    folder.mkdir(exist_ok=True)
    (folder / "viewsheds.json").write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
