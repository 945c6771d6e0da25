"""Products fused with the sweep, against the horizon of the same settings: time and memory.

    python benchmarks/products.py

All take turns in one process, on one thread; times are processor seconds, the least of several
turns. The yardstick is the horizon towards every azimuth in one layer that is used again, as the
products have it; a horizon map is K layers of fresh memory besides, which may take as long again on
a machine that is short of it. Peaks are measured in processes of their own: what each rises by
above what was held with the terrain open and the kernels loaded, without its output, a thread.
Writes results/products.json and results/products.md; `--times` keeps the peaks of the former.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ["NUMBA_NUM_THREADS"] = "1"

import numpy as np
from present import about

import adret
from adret._kernels.frames import to_elevation
from adret.accuracy import near_for
from adret.horizon_options import HorizonOptions
from adret.horizon_run import HorizonRun

REPOSITORY = Path(__file__).resolve().parents[1]
RESULTS = Path(__file__).parent / "results"
DIRECTIONS = 64
MAX_ERROR_DEG = 0.02
SCENES = {
    "Big Tujunga, 30 m": ("alpine_bigtujunga_srtm1_utm11_30m.tif", None),
    "Moon, 118 m": ("moon_gld100_eqc_118m_4096.tif", ((1500, 2500), (1500, 2500))),
}
MEBIBYTE = 2**20
Product = Callable[[adret.Terrain, int], Any]


def environment() -> adret.Environment:
    """A sky of three bands with a sun, paler towards the horizon; dark ground."""
    row, column = np.mgrid[0:64, 0:128]
    up = np.cos((row + 0.5) * np.pi / 64.0)
    blue = np.stack([0.3 + 0.4 * (1.0 - up), 0.5 + 0.3 * (1.0 - up), np.ones_like(up)], axis=-1)
    picture = np.where(up[:, :, None] > 0.0, blue, 0.1)
    picture[(np.hypot(row - 20, column - 80) < 1.5)] += 500.0
    return adret.Environment(picture)


def openness(terrain: adret.Terrain, near: int) -> Any:
    return adret.openness(terrain, 1, DIRECTIONS, near=near)


def light(sky: Any) -> Product:
    return lambda terrain, near: adret.direct_light(terrain, sky, DIRECTIONS, near=near).irradiance


def horizons(terrain: adret.Terrain, near: int) -> Any:
    """Horizons towards every azimuth, in one layer [radians]."""
    elevation = np.empty(terrain.shape, np.float32)
    options = HorizonOptions(near=near)
    for _, slope in HorizonRun(terrain, adret.azimuth_set(DIRECTIONS), options).layers():
        to_elevation(slope, elevation)
    return elevation


def view(kind: Any) -> Product:
    return lambda terrain, near: adret.sky_view_factor(terrain, kind, DIRECTIONS, near=near)


YARDSTICK = "horizon, layer by layer"
PRODUCTS: dict[str, Product] = {
    YARDSTICK: horizons,
    "horizon map": lambda terrain, near: (
        adret.horizon_map(terrain, DIRECTIONS, near=near).elevation
    ),
    "sky view, visible": view("visible"),
    "sky view, horizontal": view("horizontal"),
    "sky view, normal": view("normal"),
    "openness": openness,
    "uniform light": light(adret.UniformSky()),
    "overcast light": light(adret.OvercastSky()),
    "environment of one band": light(adret.Environment(environment().radiance[:, :, :1])),
    "environment of three bands": light(environment()),
}


def folder() -> Path:
    """Folder of real rasters: $ADRET_DATA, else ../shared/data."""
    return Path(os.environ.get("ADRET_DATA", REPOSITORY.parent / "shared" / "data")) / "dem"


def opened(scene: str) -> adret.Terrain:
    name, window = SCENES[scene]
    return adret.Terrain.open(folder() / name, window=window)


def status(name: str) -> float:
    """A figure of this process's memory [MiB]."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024.0 for line in lines if line.startswith(name))


def peak(scene: str, product: str, near: int) -> float:
    """Rise of this process's peak during one run, less the output [MiB]."""
    make = PRODUCTS[product]
    make(adret.Terrain(np.random.default_rng(0).random((40, 40)), (1.0, 1.0)), near)
    terrain = opened(scene)
    Path("/proc/self/clear_refs").write_text("5")  # the peak so far is forgotten
    before = status("VmRSS")
    output = make(terrain, near)
    return float(status("VmHWM") - before - output.nbytes / MEBIBYTE)


def peaks(scene: str, near: int, known: dict[str, float]) -> dict[str, float]:
    """`peak` of every product that is not known yet, each in its own process."""
    found = dict(known)
    for product in PRODUCTS.keys() - known.keys():
        command = [sys.executable, __file__, "--peak", scene, product, str(near)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        found[product] = float(done.stdout.split()[-1])
    return found


def times(terrain: adret.Terrain, near: int, repeats: int) -> dict[str, list[float]]:
    """Processor seconds of every product in each of several turns."""
    small = terrain.window((0, 40), (0, 40))
    for make in PRODUCTS.values():
        make(small, near)  # kernels are compiled
    found: dict[str, list[float]] = {name: [] for name in PRODUCTS}
    for _ in range(repeats):
        for name, make in PRODUCTS.items():
            start = time.process_time()
            make(terrain, near)
            found[name].append(time.process_time() - start)
    return found


def table(results: dict[str, Any]) -> str:
    """The results as Markdown."""
    machine = results["about"]
    lines = [
        "# Products fused with the sweep, against the horizon map",
        "",
        f"{machine['processor']}, one thread, Python {machine['python']}, "
        f"Numba {machine['packages']['numba']}, commit {machine['commit'][:12]}, "
        f"{machine['time'][:10]}. {DIRECTIONS} azimuths, `near` as `max_error={MAX_ERROR_DEG}` "
        "chooses it. CPU time is the least of several turns, the ratio to that of the horizon kept "
        "in one layer; memory is what the peak rises by, without the output.",
    ]
    for scene in results["scenes"]:
        rows, columns = scene["shape"]
        lines += [
            "",
            f"## {scene['name']}, {columns} x {rows}, near {scene['near']}",
            "",
            "| product | CPU ns a cell and azimuth | against the horizon | memory, MiB |",
            "|---|---:|---:|---:|",
        ]
        for name, one in scene["products"].items():
            lines.append(
                f"| {name} | {one['cpu_ns']:.1f} | {one['ratio']:.2f} | {one['peak_mib']:.0f} |"
            )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure all and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--times", action="store_true", help="measure no memory")
    parser.add_argument("--peak", nargs=3, help="scene, product and near: print one peak")
    options = parser.parse_args()
    if options.peak:
        scene, product, near = options.peak
        print(peak(scene, product, int(near)))
        return
    known: dict[str, dict[str, float]] = {}
    if options.times:
        for scene in json.loads((RESULTS / "products.json").read_text())["scenes"]:
            known[scene["name"]] = {k: one["peak_mib"] for k, one in scene["products"].items()}
    results: dict[str, Any] = {"about": about(), "directions": DIRECTIONS, "scenes": []}
    for name in SCENES:
        if not folder().is_dir():
            print(f"{name}: left out, there is no folder {folder()}")
            continue
        terrain = opened(name)
        azimuths = adret.azimuth_set(DIRECTIONS)
        near, expected = near_for(terrain, azimuths, HorizonOptions(), MAX_ERROR_DEG)
        seconds = times(terrain, near, options.repeats)
        rises = peaks(name, near, known.get(name, {}))
        horizon = min(seconds[YARDSTICK])
        products = {
            each: {
                "cpu_ns": min(took) / (DIRECTIONS * terrain.heights.size) * 1e9,
                "ratio": min(took) / horizon,
                "cpu_seconds_all": took,
                "peak_mib": rises[each],
            }
            for each, took in seconds.items()
        }
        entry = {"name": name, "shape": terrain.shape, "near": near, "expected_deg": expected}
        results["scenes"].append({**entry, "products": products})
        for each, one in products.items():
            print(name, each, {k: one[k] for k in ("cpu_ns", "ratio", "peak_mib")}, flush=True)
    if results["scenes"]:
        (RESULTS / "products.json").write_text(json.dumps(results, indent=1) + "\n")
        (RESULTS / "products.md").write_text(table(results))


if __name__ == "__main__":
    main()
