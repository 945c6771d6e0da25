"""Indirect light: run time against error over azimuths, near radius and bounces, and other tools.

``python benchmarks/bounces.py`` writes results/bounces.json with machine, versions and commit, a
table in results/bounces.md and a plot in results/bounces.png; ``--quick`` looks at less. Times are
CPU time of all threads. Real rasters come from $ADRET_DATA or ../shared/data; without them only the
example DEMs are measured. A tool that is not installed is left out, counted and named: ``pip
install embreex``; ``pip install mitsuba``, which needs an LLVM library of version 17 or newer
(DRJIT_LIBLLVM_PATH says where).
"""

import argparse
import json
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

os.environ.setdefault("NUMBA_NUM_THREADS", str(os.cpu_count()))

import bounce_tables
import light_rivals
import numpy as np
import present
from light_rivals import ALBEDO, ALETSCH, REPOSITORY, SKY, Entry, off, show, timed

import adret
import scenes
from adret.bounces import BounceReport
from adret.horizon import NEAR_DEFAULT

EVERY = 4096  # a near radius beyond any raster here: every crossing of the ray


def bowl(size: int, choices: Sequence[int]) -> list[Entry]:
    """The spherical bowl of 70 degrees, albedo 0.6, sun 25 degrees high: closed form."""
    scene = scenes.bowl(np.radians(70.0), size=size)
    terrain = adret.Terrain(scene.heights, scene.cell_size)
    first = adret.direct_light(terrain, adret.Sun(30.0, 25.0)).radiance(ALBEDO)
    entries = []
    for directions in choices:
        for asked, want in ((1, 0.055977), ("converge", 0.069744)):
            light, cpu = timed(
                lambda asked=asked, directions=directions: adret.indirect_light(
                    terrain, None, ALBEDO, radiance=first, bounces=asked, directions=directions
                )
            )
            values = light.irradiance[scene.where].astype(np.float64)
            entries.append(
                {
                    "size": size,
                    "directions": directions,
                    "bounces": light.bounces,
                    "residual": light.residual,
                    "cpu_seconds": cpu,
                    "want": want,
                    "got": float(values.mean()),
                    "within_1_percent": float((abs(values / want - 1.0) <= 0.01).mean()),
                    **off(values, np.full_like(values, want)),
                }
            )
            show("bowl", entries[-1])
    return entries


def sweeps(side: int) -> Entry:
    """Azimuths, near radius and bounces on a real raster, sun 20 degrees high."""
    terrain = adret.Terrain.open(ALETSCH, window=((60, 60 + side), (80, 80 + side)))
    first = adret.direct_light(terrain, adret.Sun(135.0, 20.0)).radiance(ALBEDO)

    def run(**options: Any) -> tuple[adret.Light, float]:
        return timed(lambda: adret.indirect_light(terrain, None, ALBEDO, radiance=first, **options))

    truth = run(directions=256, near=EVERY)[0].irradiance.astype(np.float64)
    exact = run(directions=64, near=EVERY)[0].irradiance.astype(np.float64)
    entries = []
    choices = [(directions, NEAR_DEFAULT) for directions in (8, 16, 32, 64, 128)]
    choices += [(64, near) for near in (0, 4, 8, 16, 64, EVERY)]
    for directions, near in choices:
        light, cpu = run(directions=directions, near=near)
        entry: Entry = {"directions": directions, "near": "all" if near == EVERY else near}
        entry["cpu_seconds"] = cpu
        entry["ns"] = cpu * 1e9 / terrain.mask.size / directions
        entry |= off(light.irradiance, truth)
        if directions == 64:
            entry["near_alone"] = off(light.irradiance, exact)
        entries.append(entry)
        show("sweep", entry)
    final = run(directions=32, bounces=20)[0].irradiance.astype(np.float64)
    bounces = []
    for asked in (1, 2, 3, 4, 5, "converge"):
        light, cpu = run(directions=32, bounces=asked)
        report = light.report
        assert isinstance(report, BounceReport)
        bounces.append(
            {
                "asked": asked,
                "bounces": light.bounces,
                "residual": light.residual,
                "cpu_seconds": cpu,
                "receivers_skipped": report.receivers_skipped
                / (report.receivers + report.receivers_skipped),
                "crossings_tested": report.crossings_tested,
                "crossings_hidden": report.crossings_hidden,
                "crossings_weighed": report.crossings_weighed,
                "most_of_largest": float(np.nanmax(abs(light.irradiance - final)))
                / float(np.nanmax(light.irradiance)),
                **off(light.irradiance, final),
            }
        )
        show("bounces", bounces[-1])
    name = f"{ALETSCH.stem.split('_')[1].capitalize()}, 200 m, {side} x {side} cells"
    return {"raster": name, "entries": entries, "bounces": bounces}


def growth(sizes: Sequence[int]) -> list[Entry]:
    """One bounce over fractal ground of growing size, 8 azimuths."""
    entries = []
    for size in sizes:
        z = scenes.fractal(np.random.default_rng(1), (size, size), relief=0.15 * size)
        terrain = adret.Terrain(z, (1.0, 1.0))
        light, cpu = timed(
            lambda terrain=terrain: adret.indirect_light(
                terrain, None, ALBEDO, radiance=1.0, directions=8
            )
        )
        report = light.report
        entry = {
            "size": size,
            "cpu_seconds": cpu,
            "ns": cpu * 1e9 / size**2 / 8,
            "crossings_tested": report.crossings_tested / size**2 / 8,
        }
        entries.append(entry)
        show("growth", entry)
    return entries


def main() -> None:
    """Measure, write JSON, table and plot."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="small rasters, few samples")
    parser.add_argument("--out", type=Path, default=REPOSITORY / "benchmarks" / "results")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    start, spent = time.perf_counter(), time.process_time()
    small = adret.Terrain(np.zeros((9, 9)), (1.0, 1.0))
    for sky in (adret.Sun(0.0, 30.0), adret.Environment.open(SKY)):
        adret.indirect_light(small, sky, 0.5, bounces=2)  # compile first
    results: Entry = {"about": present.about(), "near": NEAR_DEFAULT}
    results["bowl"] = bowl(129, (16, 32, 64, 128)) + bowl(257 if options.quick else 513, (64,))
    results["sweeps"] = sweeps(60 if options.quick else 200)
    results["growth"] = growth((125, 250) if options.quick else (125, 250, 500, 1000))
    results["tools"] = light_rivals.tools(options.quick)
    results["about"]["seconds"] = time.perf_counter() - start
    results["about"]["cpu_seconds"] = time.process_time() - spent
    (options.out / "bounces.json").write_text(json.dumps(results, indent=1) + "\n")
    (options.out / "bounces.md").write_text(bounce_tables.table(results))
    bounce_tables.plot(results, options.out / "bounces.png")
    for suffix in ("json", "md", "png"):
        print(options.out / f"bounces.{suffix}")
    print("{seconds:.0f} s in all, {cpu_seconds:.0f} s of CPU time".format(**results["about"]))


if __name__ == "__main__":
    main()
