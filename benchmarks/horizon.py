"""Horizon maps: run time against error, growth with size, and other tools in the same run.

``make bench`` runs it.  Writes results/horizon.json (with machine, versions and commit), a table in
results/horizon.md and a plot in results/horizon.png.  Real rasters come from $ADRET_DATA or
../shared/data; without them only the example DEM is measured.  Times are CPU time of all threads,
the least of several repeats, after a warm-up that compiles.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

THREADS = str(min(2, os.cpu_count() or 1))
os.environ.setdefault("NUMBA_NUM_THREADS", THREADS)

import numpy as np  # noqa: E402
import peers  # noqa: E402
import present  # noqa: E402
import rasterio  # noqa: E402
from affine import Affine  # noqa: E402
from numpy.typing import NDArray  # noqa: E402
from pyramid import levels_of, pyramid_slopes  # noqa: E402

import adret  # noqa: E402
from adret.horizon import NEAR_DEFAULT  # noqa: E402

REPOSITORY = Path(__file__).resolve().parents[1]
EXAMPLE = REPOSITORY / "examples" / "data" / "alpine_aletsch_dhm200_lv95_200m.tif"
DIRECTIONS = 32
CELLS = 2500
NEARS = (0, 4, 8, 16, 24, 32, 64)
SIZES = (512, 1024, 2048, 4096)
RVT_MARGIN = 100  # RVT mirrors the raster at its edge: cells nearer to it are not compared

Entry = dict[str, Any]


def data_dir() -> Path | None:
    """Folder of real rasters: $ADRET_DATA, else ../shared/data, else None."""
    folder = Path(os.environ.get("ADRET_DATA", REPOSITORY.parent / "shared" / "data"))
    return folder if (folder / "dem").is_dir() else None


def errors(found: NDArray[np.float32], truth: NDArray[np.float32]) -> Entry:
    """Error figures [degrees] where terrain lies in the direction; both in degrees."""
    there = truth > -89.99
    off = (found.astype(np.float64) - truth)[there]
    size = np.abs(off)
    return {
        "mean_deg": float(size.mean()),
        "p99_deg": float(np.quantile(size, 0.99)),
        "max_deg": float(size.max()),
        "bias_deg": float(off.mean()),
        "samples": int(size.size),
    }


def timed(
    terrain: adret.Terrain, azimuths: NDArray[np.float64], repeats: int, **options: Any
) -> tuple[Entry, NDArray[np.float32]]:
    """Least CPU and wall time of `horizon_map`, and its elevations."""
    adret.horizon_map(terrain, azimuths=azimuths[:2], **options)
    cpu, wall = [], []
    for _ in range(repeats):
        start = time.process_time(), time.perf_counter()
        elevation = adret.horizon_map(terrain, azimuths=azimuths, **options).elevation
        cpu.append(time.process_time() - start[0])
        wall.append(time.perf_counter() - start[1])
    entry = {
        "cpu_ns": min(cpu) / elevation.size * 1e9,
        "wall_ns": min(wall) / elevation.size * 1e9,
        "cpu_ns_all": [c / elevation.size * 1e9 for c in cpu],
        "azimuths": len(azimuths),
    }
    return entry, elevation


def own_methods(
    terrain: adret.Terrain, rows: NDArray[np.int64], columns: NDArray[np.int64], repeats: int
) -> tuple[list[Entry], NDArray[np.float32]]:
    """Time and error of every method, and the truth in degrees at the sampled cells."""
    azimuths = adret.azimuth_set(DIRECTIONS)
    truth = np.degrees(adret.horizon_at(terrain, rows, columns, azimuths=azimuths))
    runs: list[tuple[str, Entry]] = [
        *((f"sweep near={near}", {"method": "sweep", "near": near}) for near in NEARS),
        ("hull (P1 as published)", {"method": "hull"}),
        ("march", {"method": "march"}),
    ]
    found = []
    for name, options in runs:
        slow = options["method"] != "sweep"
        entry, elevation = timed(terrain, azimuths, 1 if slow else repeats, **options)
        entry |= errors(np.degrees(elevation[:, rows, columns]), truth)
        found.append({"name": name, **options, **entry})
        show(found[-1])
    found.append(over_pyramid(terrain, azimuths[1::8], rows, columns, truth[1::8]))
    entry, _ = timed(terrain, azimuths[1::8], 1, method="exact")
    zero = {"mean_deg": 0.0, "p99_deg": 0.0, "max_deg": 0.0, "bias_deg": 0.0}
    found.append({"name": "exact", "method": "exact", **entry, **zero})
    show(found[-1])
    return found, truth


def over_pyramid(
    terrain: adret.Terrain,
    azimuths: NDArray[np.float64],
    rows: NDArray[np.int64],
    columns: NDArray[np.int64],
    truth: NDArray[np.float32],
) -> Entry:
    """Prior work: a march of each cell over coarser heights further away, 16 samples an octave."""
    levels = levels_of(terrain.heights)
    pyramid_slopes(levels, terrain.cell_size, 0.0, 1)
    start, slopes = time.process_time(), []
    for azimuth in azimuths:
        slopes.append(pyramid_slopes(levels, terrain.cell_size, azimuth, 16)[rows, columns])
    spent = time.process_time() - start
    entry = {
        "name": "pyramid, 16 samples an octave",
        "cpu_ns": spent / (len(azimuths) * terrain.heights.size) * 1e9,
        "azimuths": len(azimuths),
        **errors(np.degrees(np.arctan(np.array(slopes))), truth),
    }
    show(entry)
    return entry


def show(entry: Entry) -> None:
    """One line to the terminal."""
    error = f"{entry['mean_deg']:9.4f}" if "mean_deg" in entry else "        -"
    print(f"  {entry['name']:30s} {entry['cpu_ns']:10.2f} ns {error} deg", flush=True)


def other_tools(
    terrain: adret.Terrain,
    rows: NDArray[np.int64],
    columns: NDArray[np.int64],
    truth: NDArray[np.float32],
) -> list[Entry]:
    """The peers on the same raster, one child process each, the slow ones on fewer azimuths."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        dem = Path(folder) / "dem.tif"
        write(terrain, dem)
        for name in peers.PEERS:
            reason = peers.missing(name)
            if reason:
                print(f"  {name}: left out, {reason}", flush=True)
                found.append({"name": name, "left_out": reason})
                continue
            out = Path(folder) / f"{name}.npz"
            command = [sys.executable, peers.__file__, name, str(dem), str(out), str(DIRECTIONS)]
            done = subprocess.run(command, capture_output=True, text=True)
            if done.returncode:
                reason = done.stderr.strip().splitlines()[-1:]
                print(f"  {name}: failed, {reason}", flush=True)
                found.append({"name": name, "left_out": f"failed: {reason}"})
                continue
            with np.load(out) as result:
                work = terrain.heights.size * len(result["chosen"])
                entry = {
                    "name": name,
                    "version": str(result["version"]),
                    "azimuths": len(result["chosen"]),
                    "cpu_ns": float(result["cpu_seconds"]) / work * 1e9,
                }
                if "elevation_deg" in result:
                    layers = result["elevation_deg"][:, rows, columns]
                    inner = np.ones(rows.size, dtype=bool)
                    if name.startswith("rvt"):
                        height, width = terrain.shape
                        inner = (np.minimum(rows, height - 1 - rows) >= RVT_MARGIN) & (
                            np.minimum(columns, width - 1 - columns) >= RVT_MARGIN
                        )
                    if inner.any():
                        entry |= errors(layers[:, inner], truth[result["chosen"]][:, inner])
            found.append(entry)
            show(entry)
    return found


def write(terrain: adret.Terrain, path: Path) -> None:
    """A plain float32 GeoTIFF in metres that every tool reads."""
    dx, dy = terrain.cell_size
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        height=terrain.shape[0],
        width=terrain.shape[1],
        count=1,
        dtype="float32",
        nodata=-9999.0,
        crs="EPSG:32633",
        transform=Affine(dx, 0.0, 500_000.0, 0.0, -dy, 5_000_000.0),
    ) as file:
        heights = terrain.elevations()
        file.write(np.where(np.isnan(heights), -9999.0, heights).astype(np.float32), 1)


def growth(terrain: adret.Terrain, repeats: int, sizes: tuple[int, ...]) -> list[Entry]:
    """Cost a cell and azimuth against the raster's size, 8 oblique azimuths of the 32."""
    azimuths = adret.azimuth_set(DIRECTIONS)[1::4]
    found = []
    for size in sizes:
        part = terrain.window((0, size), (0, size))
        entry, _ = timed(part, azimuths, repeats)
        found.append({"name": f"{size} x {size}", "size": size, **entry})
        show(found[-1])
    return found


def sampled(terrain: adret.Terrain, count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Random cells with data, the same for every run."""
    rng = np.random.default_rng(7)
    cells = np.argwhere(~terrain.mask)
    chosen = cells[rng.choice(len(cells), min(count, len(cells)), replace=False)]
    return chosen[:, 0], chosen[:, 1]


def scenes(crop: int | None) -> list[tuple[str, adret.Terrain, bool]]:
    """(name, terrain, whether the peers run on it)."""
    folder = data_dir()
    if folder is None:
        terrain = adret.Terrain.open(EXAMPLE)
        found = [("Aletsch, 200 m", terrain, True)]
    else:
        mountains = adret.Terrain.open(folder / "dem" / "alpine_bigtujunga_srtm1_utm11_30m.tif")
        moon = adret.Terrain.open(
            folder / "dem" / "moon_gld100_eqc_118m_4096.tif", window=((1500, 2500), (1500, 2500))
        )
        found = [("Big Tujunga, 30 m", mountains, True), ("Moon, 118 m", moon, False)]
    if crop:
        found = [
            (name, t.window((0, crop), (0, crop)), with_peers) for name, t, with_peers in found
        ]
    return found


def main() -> None:
    """Measure, write, print where."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--crop", type=int, help="only the first N x N cells, for a quick look")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--no-peers", action="store_true")
    parser.add_argument("--out", type=Path, default=REPOSITORY / "benchmarks" / "results")
    options = parser.parse_args()

    results: Entry = {"about": present.about(), "default_near": NEAR_DEFAULT, "rasters": []}
    for name, terrain, with_peers in scenes(options.crop):
        print(f"{name}: {terrain.shape[1]} x {terrain.shape[0]} cells, {DIRECTIONS} azimuths")
        rows, columns = sampled(terrain, CELLS)
        entries, truth = own_methods(terrain, rows, columns, options.repeats)
        if with_peers and not options.no_peers:
            entries += other_tools(terrain, rows, columns, truth)
        results["rasters"].append(
            {"name": name, "shape": terrain.shape, "cells_compared": len(rows), "entries": entries}
        )
    folder = data_dir()
    if folder is not None:
        print(f"Growth with size (Moon), sweep near={NEAR_DEFAULT}")
        moon = adret.Terrain.open(folder / "dem" / "moon_gld100_eqc_118m_4096.tif")
        sizes = tuple(s for s in SIZES if not options.crop or s <= 2 * options.crop)
        results["growth"] = growth(moon, options.repeats, sizes)
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "horizon.json").write_text(json.dumps(results, indent=1) + "\n")
    (options.out / "horizon.md").write_text(present.table(results))
    present.plot(results, options.out / "horizon.png")
    for suffix in ("json", "md", "png"):
        print(options.out / f"horizon.{suffix}")


if __name__ == "__main__":
    main()
