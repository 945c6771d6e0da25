"""Tiles of a raster up to 30 000 cells a side: throughput, memory, and what tiling costs.

    python benchmarks/scale/tiles.py size 30000      a row of tiles of a raster of that size
    python benchmarks/scale/tiles.py overhead 8192   a whole raster, untiled and in tiles
    python benchmarks/scale/tiles.py report          table and plot of what was measured

Each writes into results/tiles.json. A raster's tiles are alike, so one row of them in its middle
stands for all: with a range, a tile does not know how large its raster is. The time of the whole is
extrapolated from it. One process, all threads; the least time of two where it says so.
"""

import argparse
import json
import os
import platform
import resource
import subprocess
import tempfile
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import moon
import numpy as np

import adret
from adret import products
from adret.tiling import Job, Surface, plan
from adret.tiling.tasks import Tile, make_tile

HERE = Path(__file__).parent
RESULTS = HERE / "results"
DIRECTIONS = 32
RANGE = 20_000.0
GIB = 1 << 30

Entry = dict[str, Any]


def parameters(directions: int, reach: float | None) -> dict[str, Any]:
    """Sky view and horizons to uint16."""
    given = {"directions": directions, "max_distance": reach, "curvature": True}
    return {
        "sky-view": products.PRODUCTS["sky-view"].parameters(**given),
        "horizon": products.PRODUCTS["horizon"].parameters(**given, dtype="uint16"),
    }


def machine() -> Entry:
    """Where this was measured."""
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=HERE, capture_output=True, text=True
    ).stdout.strip()
    return {
        "cores": os.cpu_count(),
        "processor": platform.processor() or platform.machine(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "commit": commit,
        "adret": adret.__version__,
    }


def warm_up(folder: Path) -> None:
    """Compile, so that no tile pays for it."""
    path = folder / "warm.tif"
    moon.write(path, 1024, [(0, 1024)])
    job = Job(Surface.open([path]), parameters(8, RANGE), 512)
    for name in job.products:
        make_tile(job, name, job.tiles[0], folder / "warm-tile.tif")


def one_size(size: int, tile: int, count: int) -> Entry:
    """Tiles from the middle of a raster, both products."""
    with tempfile.TemporaryDirectory(dir=os.environ.get("ADRET_SCRATCH")) as name:
        folder = Path(name)
        warm_up(folder)
        path = folder / "moon.tif"
        top = min(size // 2 // tile * tile, max(size - tile, 0))
        margin = 1024
        start = time.perf_counter()
        moon.write(path, size, [(max(top - margin, 0), min(top + tile + margin, size))])
        made = time.perf_counter() - start
        surface = Surface.open([path])
        job = Job(surface, parameters(DIRECTIONS, RANGE), tile)
        row = [each for each in job.tiles if each.rows[0] == top]
        chosen = row[:: max(1, len(row) // count)][:count]
        entry: Entry = {
            "size": size,
            "tile": tile,
            "tiles_measured": len(chosen),
            "tiles": len(job.tiles),
            "planned_bytes": plan(job, 1, os.cpu_count() or 1).worker_bytes,
            "file_bytes": path.stat().st_size,
            "made_s": made,
            "products": {},
        }
        for product in job.products:
            written = [
                make_tile(job, product, each, folder / f"{product}-{each.name}.tif")
                for each in chosen
            ]
            seconds = sum(each.seconds for each in written)
            cells = sum(each.cells for each in written)
            entry["products"][product] = {
                "seconds": seconds,
                "cells": cells,
                "mcells_azimuths_per_s": cells * DIRECTIONS / seconds * 1e-6,
                "bytes_a_cell": sum(each.bytes for each in written) / cells,
                "whole_s": seconds / cells * size**2,
                "whole_bytes": sum(each.bytes for each in written) / cells * size**2,
            }
        entry["peak_rss"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    return entry


def overhead(size: int, tile: int) -> Entry:
    """Sky view of a whole raster in memory, and of the same raster tile by tile from its file."""
    directions = 16
    with tempfile.TemporaryDirectory(dir=os.environ.get("ADRET_SCRATCH")) as name:
        folder = Path(name)
        warm_up(folder)
        path = folder / "moon.tif"
        moon.write(path, size, [(0, size)])
        job = Job(Surface.open([path]), parameters(directions, RANGE), tile)
        given = job.products["sky-view"]
        cut = []
        start = time.perf_counter()
        for each in job.tiles:
            cut.append(make_tile(job, "sky-view", each, folder / f"{each.name}.tif"))
        tiled = time.perf_counter() - start
        rss = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
        start = time.perf_counter()
        whole_tile = Tile((0, size), (0, size))
        make_tile(
            Job(job.surface, job.products, size), "sky-view", whole_tile, folder / "whole.tif"
        )
        whole = time.perf_counter() - start
        return {
            "size": size,
            "tile": tile,
            "directions": directions,
            "max_distance": RANGE,
            "tiles": len(cut),
            "tiled_s": tiled,
            "untiled_s": whole,
            "overhead": tiled / whole - 1.0,
            "tiled_peak_rss": rss,
            "untiled_peak_rss": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
            "parameters": asdict(given),
        }


def keep(kind: str, key: str, entry: Entry) -> None:
    """Enter a measurement into the results."""
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / "tiles.json"
    known = json.loads(path.read_text()) if path.exists() else {}
    known["machine"] = machine()
    known.setdefault(kind, {})[key] = entry
    path.write_text(json.dumps(known, indent=1) + "\n")
    print(json.dumps(entry, indent=1))


def report() -> None:
    """Write the table and the plot."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    known = json.loads((RESULTS / "tiles.json").read_text())
    sizes = sorted(known["size"].values(), key=lambda entry: (entry["size"], entry["tile"]))
    lines = [
        "# Tiles",
        "",
        f"{known['machine']['cores']} cores, commit {known['machine']['commit']}; lunar raster, "
        f"{DIRECTIONS} azimuths, range {RANGE / 1000:g} km, curvature on.",
        "",
        "| raster | tile | product | Mcells·azimuths/s | a worker, MiB (planned) | whole raster |",
        "|---|---|---|---|---|---|",
    ]
    for entry in sizes:
        for product, found in entry["products"].items():
            lines.append(
                f"| {entry['size']}² | {entry['tile']} | {product} "
                f"| {found['mcells_azimuths_per_s']:.1f} "
                f"| {entry['peak_rss'] / 2**20:.0f} ({entry['planned_bytes'] / 2**20:.0f}) "
                f"| {found['whole_s'] / 60:.1f} min, {found['whole_bytes'] / GIB:.2f} GiB |"
            )
    for entry in known.get("overhead", {}).values():
        lines += [
            "",
            f"Sky view of {entry['size']}² in {entry['tiles']} tiles of {entry['tile']}²: "
            f"{entry['tiled_s']:.1f} s and {entry['tiled_peak_rss'] / 2**20:.0f} MiB; untiled "
            f"{entry['untiled_s']:.1f} s and {entry['untiled_peak_rss'] / 2**20:.0f} MiB: "
            f"{100 * entry['overhead']:+.1f} %.",
        ]
    (RESULTS / "tiles.md").write_text("\n".join(lines) + "\n")
    figure, axis = pyplot.subplots(figsize=(6.0, 3.6), layout="constrained")
    for product in ("sky-view", "horizon"):
        shown = [entry for entry in sizes if product in entry["products"]]
        axis.plot(
            [entry["size"] for entry in shown],
            [entry["products"][product]["mcells_azimuths_per_s"] for entry in shown],
            "o-",
            label=product,
        )
    axis.set_xlabel("cells a side")
    axis.set_ylabel("Mcells · azimuths / s")
    axis.set_ylim(bottom=0.0)
    axis.legend()
    figure.savefig(RESULTS / "tiles.png", dpi=120)


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("size", "overhead", "report"))
    parser.add_argument("cells", type=int, nargs="?", default=8192)
    parser.add_argument("--tile", type=int, default=2048)
    parser.add_argument("--count", type=int, default=3, help="tiles of the row to measure")
    given = parser.parse_args()
    if given.what == "size":
        key = f"{given.cells}-{given.tile}"
        keep("size", key, one_size(given.cells, given.tile, given.count))
    elif given.what == "overhead":
        keep("overhead", f"{given.cells}-{given.tile}", overhead(given.cells, given.tile))
    else:
        report()


if __name__ == "__main__":
    main()
