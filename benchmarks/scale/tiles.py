"""Tiles of a raster up to 30 000 cells a side: throughput, memory, and what tiling costs.

    python benchmarks/scale/tiles.py size 30000      tiles of a raster of that size, 20 km range
    python benchmarks/scale/tiles.py size 8192 --all tiles that see the whole raster
    python benchmarks/scale/tiles.py overhead 8192   a whole raster, untiled and in tiles
    python benchmarks/scale/tiles.py overhead 4096 --all    the same without a range
    python benchmarks/scale/tiles.py report          table and plot of what was measured

Each writes into results/tiles.json. A raster's tiles are alike, so one row of them in its middle
stands for all: with a range, a tile does not know how large its raster is. The time of the whole is
extrapolated from it. One worker process, all threads. The machine may be busy with other things, so
rates are given by the processor's time as well.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import moon
import numpy as np

import adret
from adret import products
from adret.tiling import Job, Surface, plan, prepare
from adret.tiling.executors import LocalExecutor, Order
from adret.tiling.jobs import FOLDER, FRAMES
from adret.tiling.tasks import Tile, Written

HERE = Path(__file__).parent
RESULTS = HERE / "results"
DIRECTIONS = 32
OVERHEAD_DIRECTIONS = 8
MARGIN = 1024  # rows round the tiles that hold ground
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


def run(job: Job, tiles: list[Tile], product: str, folder: Path) -> list[Written]:
    """Make tiles in one fresh process with all threads, as a batch does; the first one compiles."""
    prepare(job, folder, resume=folder.exists())
    warm = {product: replace(job.products[product], directions=8)}
    warm_folder = folder.with_name(f"{folder.name}-warm")
    prepare(Job(job.surface, warm, 512), warm_folder)
    # Without a range the frames are made along with the first tile.
    orders = [Order(str(warm_folder), product, tiles[0].rows[0] // 512 * 512, 0)]
    if (frames := warm_folder / FOLDER / FRAMES) and job.products[product].max_distance is None:
        (folder / FOLDER).mkdir(exist_ok=True)
        frames.mkdir(parents=True)
        (folder / FOLDER / FRAMES).symlink_to(frames)
    orders += [Order(str(folder), product, each.rows[0], each.columns[0]) for each in tiles]
    with closing(LocalExecutor(1, os.cpu_count() or 1)) as executor:
        found = {}
        for number, order in enumerate(orders):
            say(f"{folder.name}: tile {number} of {len(orders) - 1}")
            (outcome,) = executor.map([order])
            if outcome.written is None:
                raise RuntimeError(outcome.error)
            found[order] = outcome.written
    return [found[order] for order in orders[1:]]


def say(words: str) -> None:
    """Progress, with the time."""
    print(f"{time.strftime('%H:%M:%S')} {words}", file=sys.stderr, flush=True)


def one_size(size: int, tile: int, count: int, reach: float | None) -> Entry:
    """Tiles from the middle of a raster: sky view, and with a range horizons too."""
    with tempfile.TemporaryDirectory(dir=os.environ.get("ADRET_SCRATCH")) as name:
        folder = Path(name)
        path = folder / "moon.tif"
        top = min(size // 2 // tile * tile, max(size - tile, 0))
        start = time.perf_counter()
        filled = (max(top - MARGIN, 0), min(top + tile + MARGIN, size)) if reach else (0, size)
        moon.write(path, size, [filled])
        made = time.perf_counter() - start
        given = parameters(DIRECTIONS, reach)
        if reach is None:
            del given["horizon"]
        job = Job(Surface.open([path]), given, tile)
        row = [each for each in job.tiles if each.rows[0] == top]
        chosen = row[:: max(1, len(row) // count)][:count]
        entry: Entry = {
            "size": size,
            "tile": tile,
            "max_distance": reach,
            "tiles_measured": len(chosen),
            "tiles": len(job.tiles),
            "planned_bytes": plan(job, 1, os.cpu_count() or 1).worker_bytes,
            "file_bytes": path.stat().st_size,
            "made_s": made,
            "products": {},
        }
        for product in job.products:
            written = run(job, chosen, product, folder / product)
            wall = sum(each.seconds for each in written)
            busy = sum(each.cpu_seconds for each in written)
            cells = sum(each.cells for each in written)
            entry["products"][product] = {
                "seconds": wall,
                "cpu_seconds": busy,
                "cells": cells,
                "mcells_azimuths_per_s": cells * DIRECTIONS / wall * 1e-6,
                "mcells_azimuths_per_cpu_s": cells * DIRECTIONS / busy * 1e-6,
                "bytes_a_cell": sum(each.bytes for each in written) / cells,
                "whole_cpu_s": busy / cells * size**2,
                "whole_bytes": sum(each.bytes for each in written) / cells * size**2,
                "peak_rss": max(each.peak_rss for each in written),
            }
    return entry


def swept_again(size: int, tile: int, directions: int) -> float:
    """How often a sample is swept, without a range: lines of a tile begin at the raster's edge.

    T (1 + t) lines pass a tile of T cells a side, t being their shear, and are swept from the edge.
    """
    shears = []
    for azimuth in np.arange(directions) * 2.0 * np.pi / directions:
        parts = sorted((abs(np.sin(azimuth)), abs(np.cos(azimuth))))
        shears.append(parts[0] / parts[1])
    count = -(-size // tile)
    return 1.0 if count == 1 else float(1.0 + np.mean(shears)) * (count + 1) / 2.0


def overhead(size: int, tile: int, reach: float | None) -> Entry:
    """Sky view of a whole raster in memory, and of the same raster tile by tile from its file."""
    with tempfile.TemporaryDirectory(dir=os.environ.get("ADRET_SCRATCH")) as name:
        folder = Path(name)
        path = folder / "moon.tif"
        say(f"writing {size} x {size} cells")
        moon.write(path, size, [(0, size)])
        say("reading them for their range")
        surface = Surface.open([path])
        found: dict[str, list[Written]] = {}
        for kind, side in (("tiled", tile), ("untiled", size)):
            job = Job(surface, parameters(OVERHEAD_DIRECTIONS, reach), side)
            found[kind] = run(job, job.tiles, "sky-view", folder / kind)
        entry: Entry = {
            "size": size,
            "tile": tile,
            "tiles": len(found["tiled"]),
            "directions": OVERHEAD_DIRECTIONS,
            "max_distance": reach,
        }
        if reach is None:
            entry["swept_again"] = swept_again(size, tile, OVERHEAD_DIRECTIONS)
            entry["bytes_swept"] = entry["swept_again"] * size**2 * OVERHEAD_DIRECTIONS * 4
        for kind, written in found.items():
            entry[f"{kind}_s"] = sum(each.seconds for each in written)
            entry[f"{kind}_cpu_s"] = sum(each.cpu_seconds for each in written)
            entry[f"{kind}_peak_rss"] = max(each.peak_rss for each in written)
        entry["overhead"] = entry["tiled_cpu_s"] / entry["untiled_cpu_s"] - 1.0
    return entry


def keep(kind: str, key: str, entry: Entry) -> None:
    """Enter a measurement into the results."""
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / "tiles.json"
    known = json.loads(path.read_text()) if path.exists() else {}
    known["machine"] = machine()
    known.setdefault(kind, {})[key] = entry | {"commit": known["machine"]["commit"]}
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
        f"{known['machine']['cores']} cores, commit {_commits(known)}; lunar raster, "
        f"{DIRECTIONS} azimuths, curvature on, one worker. The machine was busy with other work: "
        "CPU time is given, good to a tenth or so, and no wall time.",
        "",
        "| raster | tile | range | product | Mcells·azimuths a CPU second "
        "| a worker, MiB (planned) | whole raster |",
        "|---|---|---|---|---|---|---|",
    ]
    for entry in sizes:
        for product, found in entry["products"].items():
            lines.append(
                f"| {entry['size']}² | {entry['tile']} | {_range(entry)} | {product} "
                f"| {found['mcells_azimuths_per_cpu_s']:.1f} "
                f"| {found['peak_rss'] / 2**20:.0f} ({entry['planned_bytes'] / 2**20:.0f}) "
                f"| {found['whole_cpu_s'] / 3600:.2f} CPU h, "
                f"{found['whole_bytes'] / GIB:.2f} GiB of tiles |"
            )
    for entry in known.get("overhead", {}).values():
        lines += [
            "",
            f"Sky view ({entry['directions']} azimuths, range {_range(entry)}) of "
            f"{entry['size']}² in {entry['tiles']} tiles of {entry['tile']}²: "
            f"{entry['tiled_cpu_s']:.1f} CPU s and "
            f"{entry['tiled_peak_rss'] / 2**20:.0f} MiB; untiled {entry['untiled_cpu_s']:.1f} "
            f"CPU s and {entry['untiled_peak_rss'] / 2**20:.0f} MiB: "
            f"{100 * entry['overhead']:+.1f} %."
            + (
                f" Every sample is swept {entry['swept_again']:.1f} times an azimuth, "
                f"{entry['bytes_swept'] / GIB:.2f} GiB in all."
                if "swept_again" in entry
                else ""
            ),
        ]
    (RESULTS / "tiles.md").write_text("\n".join(lines) + "\n")
    figure, axis = pyplot.subplots(figsize=(6.0, 3.6), layout="constrained")
    for product in ("sky-view", "horizon"):
        shown = [entry for entry in sizes if product in entry["products"] and entry["max_distance"]]
        axis.plot(
            [entry["size"] for entry in shown],
            [entry["products"][product]["mcells_azimuths_per_cpu_s"] for entry in shown],
            "o-",
            label=product,
        )
    axis.set_xlabel("cells a side")
    axis.set_ylabel("Mcells · azimuths / CPU s")
    axis.set_ylim(bottom=0.0)
    axis.legend()
    figure.savefig(RESULTS / "tiles.png", dpi=120)


def _commits(known: Entry) -> str:
    """Which commit each kind of measurement is of."""
    found = []
    for kind in ("size", "overhead"):
        commits = sorted({str(entry["commit"]) for entry in known.get(kind, {}).values()})
        found.append(f"{', '.join(commits)} ({kind})")
    return "; ".join(found)


def _range(entry: Entry) -> str:
    reach = entry["max_distance"]
    return "all" if reach is None else f"{reach / 1000:g} km"


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("size", "overhead", "report"))
    parser.add_argument("cells", type=int, nargs="?", default=8192)
    parser.add_argument("--tile", type=int, default=2048)
    parser.add_argument("--count", type=int, default=3, help="tiles of the row to measure")
    parser.add_argument("--all", action="store_true", help="no range: tiles see the whole raster")
    given = parser.parse_args()
    if given.what == "size":
        reach = None if given.all else RANGE
        key = f"{given.cells}-{given.tile}" + ("-all" if given.all else "")
        keep("size", key, one_size(given.cells, given.tile, given.count, reach))
    elif given.what == "overhead":
        reach = None if given.all else RANGE
        key = f"{given.cells}-{given.tile}" + ("-all" if given.all else "")
        keep("overhead", key, overhead(given.cells, given.tile, reach))
    else:
        report()


if __name__ == "__main__":
    main()
