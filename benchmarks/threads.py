"""What a second thread gains: horizon maps, sky view and light with one thread and with two.

    python benchmarks/threads.py

In turns within one process, wall time; beside them two processes of plain arithmetic, which share
nothing: what the machine itself has to give. Ratios of medians and of leasts are both told, for
other users of a machine move both. Writes results/threads.json and results/threads.md.
"""

import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ["NUMBA_NUM_THREADS"] = "2"

from horizon import EXAMPLE, data_dir
from present import about

import adret
from adret._kernels import jit

RESULTS = Path(__file__).parent / "results"
TURNS = 5
DIRECTIONS = 64
ARITHMETIC = "x = 1\nfor i in range(12_000_000): x = x * 3 & 0xFFFFFF"

Work = Callable[[adret.Terrain], Any]
PRODUCTS: dict[str, Work] = {
    "horizon map": lambda t: adret.horizon_map(t, DIRECTIONS, near=22),
    "sky view, normal": lambda t: adret.sky_view_factor(t, "normal", DIRECTIONS, near=22),
    "uniform light": lambda t: adret.direct_light(t, adret.UniformSky(), DIRECTIONS, near=22),
}


def processes(count: int) -> float:
    """Wall seconds of so many processes of plain arithmetic at once."""
    start = time.perf_counter()
    all_of_them = [subprocess.Popen([sys.executable, "-c", ARITHMETIC]) for _ in range(count)]
    for each in all_of_them:
        each.wait()
    return time.perf_counter() - start


def in_turns(works: dict[int, Callable[[], Any]]) -> dict[int, list[float]]:
    """Wall seconds of each, in turns."""
    spent: dict[int, list[float]] = {count: [] for count in works}
    for _ in range(TURNS):
        for count, work in works.items():
            start = time.perf_counter()
            work()
            spent[count].append(time.perf_counter() - start)
    return spent


def ratios(spent: dict[int, list[float]], doubled: bool = False) -> dict[str, float]:
    """How often two do the work of one in the same time, by medians and by leasts."""
    each = 2.0 if doubled else 1.0
    return {
        "one_s": statistics.median(spent[1]),
        "two_s": statistics.median(spent[2]),
        "by_medians": each * statistics.median(spent[1]) / statistics.median(spent[2]),
        "by_leasts": each * min(spent[1]) / min(spent[2]),
    }


def with_threads(count: int, work: Work, terrain: adret.Terrain) -> Any:
    jit.threads(count)
    return work(terrain)


def scenes() -> dict[str, adret.Terrain]:
    folder = data_dir()
    if folder is None:
        return {"Aletsch, 200 m": adret.Terrain.open(EXAMPLE)}
    moon = folder / "dem" / "moon_gld100_eqc_118m_4096.tif"
    return {
        "Big Tujunga, 1197 x 643": adret.Terrain.open(
            folder / "dem" / "alpine_bigtujunga_srtm1_utm11_30m.tif"
        ),
        "Moon, 1000 x 1000": adret.Terrain.open(moon, window=((1500, 2500), (1500, 2500))),
    }


def main() -> None:
    """Measure, write, print where."""
    alone = ratios(in_turns({n: lambda n=n: processes(n) for n in (1, 2)}), doubled=True)
    results: dict[str, Any] = {"about": about(), "processes": alone, "runs": []}
    print("processes", alone, flush=True)
    for scene, terrain in scenes().items():
        for name, work in PRODUCTS.items():
            works = {n: lambda n=n, w=work, t=terrain: with_threads(n, w, t) for n in (1, 2)}
            for each in works.values():
                each()
            results["runs"].append({"scene": scene, "product": name, **ratios(in_turns(works))})
            print(results["runs"][-1], flush=True)
    (RESULTS / "threads.json").write_text(json.dumps(results, indent=1) + "\n")
    lines = [
        "# What a second thread gains",
        "",
        f"{results['about']['processor']}, {results['about']['cores']} processors; {DIRECTIONS} "
        f"azimuths, `near` 22, wall time of {TURNS} turns. Two processes of plain arithmetic, "
        f"sharing nothing, do {alone['by_medians']:.2f} times the work of one (medians; "
        f"{alone['by_leasts']:.2f} by leasts).",
        "",
        "| raster | product | one thread | two | ratio of medians | of leasts |",
        "|---|---|---:|---:|---:|---:|",
    ]
    lines += [
        f"| {r['scene']} | {r['product']} | {r['one_s']:.2f} s | {r['two_s']:.2f} s "
        f"| {r['by_medians']:.2f} | {r['by_leasts']:.2f} |"
        for r in results["runs"]
    ]
    (RESULTS / "threads.md").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
