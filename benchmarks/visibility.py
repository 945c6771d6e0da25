"""Intervisibility: what is seen, the tree's work, time against naive walks, and time against error.

    python benchmarks/visibility.py [--size 1024] [--repeats 2] [--out benchmarks/results]

On the four kinds of field of paper P2 (its tables 1, 2 and 3 and figure 8) and on real rasters.
Errors are those of single azimuths, against every crossing of each cell's own ray in double
precision, and those of total viewsheds, against the areas of exact viewsheds. Writes
results/visibility.json (with machine, versions and commit), .md and .png. Times are CPU time of all
threads, the least of several repeats, after a warm-up that compiles, all in one run.
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

THREADS = str(min(2, os.cpu_count() or 1))
os.environ.setdefault("NUMBA_NUM_THREADS", THREADS)

REPOSITORY = Path(__file__).resolve().parents[1]
sys.path.append(str(REPOSITORY / "tests"))

import numpy as np  # noqa: E402
import present  # noqa: E402
import sight_rivals  # noqa: E402
import visibility_tables  # noqa: E402
from numpy.typing import NDArray  # noqa: E402

import adret  # noqa: E402
import paper_fields  # noqa: E402
import ray_oracle  # noqa: E402
from adret.horizon import HorizonOptions  # noqa: E402
from adret.sight_rays import NEAR, SightMethod  # noqa: E402
from adret.sight_sweep import Reduction, SightRun  # noqa: E402

Entry = dict[str, Any]
Layer = NDArray[np.float32]

OBLIQUE = np.radians([-10.0, -20.0, -30.0, -40.0])  # towards smaller rows and columns, one octant
ALL_ROUND = np.radians(np.arange(8) * 45.0 + 20.0)
GROWTH = (64, 128, 256, 512, 1024, 2048, 4096)
FIT_FROM = 512  # as the paper fits
LONG = (1024, 4096)
METHODS: tuple[tuple[SightMethod, int], ...] = (
    *(("rays", near) for near in (0, 8, 32, 128, NEAR["rays"])),
    *(("tree", near) for near in (0, 8, 32, 128)),
)
LARGE = 300_000  # cells: errors are measured on a part of larger rasters
EYE = 2.0  # metres
TOWER, RANGE = 20.0, 20_000.0  # of total viewsheds, metres


def sweep(
    terrain: adret.Terrain,
    azimuths: NDArray[np.float64],
    reduce: Reduction,
    method: SightMethod = "rays",
    near: int | None = None,
    **options: float,
) -> tuple[Layer, SightRun]:
    """One reduction, and the run that made it: it knows its work."""
    near = NEAR[method] if near is None else near
    run = SightRun(terrain, azimuths, HorizonOptions(near=near, **options), method)
    return run.layer(reduce), run


def cpu_ns(work: Callable[[], Any], samples: int, repeats: int) -> float:
    """Least CPU time a sample [ns]."""
    least = np.inf
    for _ in range(repeats):
        start = time.process_time()
        work()
        least = min(least, time.process_time() - start)
    return least / samples * 1e9


def counted(terrain: adret.Terrain) -> Entry:
    """Visible points, horizons and checks a point and azimuth, all round; and what rays skip."""
    seen, run = sweep(terrain, ALL_ROUND, "visible_count", "tree", 0)
    ends, _ = sweep(terrain, ALL_ROUND, "horizon_count", "tree", 0)
    samples = seen.size * len(ALL_ROUND)
    flat = adret.Terrain(np.zeros(terrain.shape), terrain.cell_size)
    level, _ = sweep(flat, ALL_ROUND, "visible_count", "tree", 0)
    steps = float(level.sum(dtype=float)) / samples
    checks, children, taken = run.work.lines.sum(axis=0) / samples
    visible = float(seen.sum(dtype=float)) / samples
    _, rays = sweep(terrain, ALL_ROUND, "visible_count")
    return {
        "naive_steps": steps,
        "visible": visible,
        "visible_share": visible / steps,
        "local_horizons": float(ends.sum(dtype=float)) / samples,
        "root_children": float(children),
        "checks": float(checks),
        "checks_share": float(checks) / steps,
        "repairs_skipped": float(taken),
        "rays_tested": rays.work.samples_tested / samples,
        "rays_skipped": rays.work.samples_passed / samples,
    }


def timed(terrain: adret.Terrain, repeats: int) -> Entry:
    """CPU time a cell and azimuth of rays, tree and walks, and whether tree and walk are equal."""
    samples = terrain.mask.size
    four, one = samples * len(OBLIQUE), OBLIQUE[1:2]
    z = np.ascontiguousarray(terrain.heights)
    shear = float(np.tan(-one[0]) * terrain.cell_size[1] / terrain.cell_size[0])
    count = np.empty(z.shape, np.float32)
    entry: Entry = {}
    for reduce, name in (("horizon_count", "horizons"), ("visible_count", "seen")):
        for method, near in (("rays", NEAR["rays"]), ("tree", 0), ("tree", NEAR["tree"])):
            label = method if near in (0, NEAR["rays"]) else f"{method}_near"
            entry[f"{label}_{name}"] = cpu_ns(
                lambda reduce=reduce, method=method, near=near: sweep(
                    terrain, OBLIQUE, reduce, method, near
                ),
                four,
                repeats,
            )
        tree, _ = sweep(terrain, one, reduce, "tree", 0)
        walked: list[Layer] = []
        entry[f"walk_lines_{name}"] = cpu_ns(
            lambda reduce=reduce, out=walked: out.append(
                sweep(terrain, one, reduce, "march", 0)[0]
            ),
            samples,
            1,
        )
        entry[f"equal_{name}"] = bool(np.array_equal(tree, walked[0], equal_nan=True))
    entry["walk_published"] = cpu_ns(
        lambda: sight_rivals.walk_as_published(z, shear, count), samples, 1
    )
    entry["walk_neighbours"] = cpu_ns(
        lambda: sight_rivals.walk_of_neighbours(z, shear, count), samples, repeats
    )
    return entry


def growth(kind: Callable[[int], NDArray[np.float64]], sizes: tuple[int, ...]) -> Entry:
    """Checks a line of n steps, along the rows of n x n fields; the exponent of n."""
    checks = []
    for n in sizes:
        field = kind(n)[:: max(1, n // 64)]
        terrain = adret.Terrain(field, (1.0, 1.0))
        east_and_west = np.array([np.pi / 2, 1.5 * np.pi])
        _, run = sweep(terrain, east_and_west, "horizon_count", "tree", 0)
        checks.append(float(run.work.lines[:, 0].sum()) / (2 * len(field)))
    far = [i for i, n in enumerate(sizes) if n >= FIT_FROM]
    slope = np.polyfit(np.log([sizes[i] for i in far]), np.log([checks[i] for i in far]), 1)[0]
    return {"steps": list(sizes), "checks": checks, "exponent": float(slope)}


def long_lines(name: str) -> Entry:
    """CPU time a cell of rays and tree on strips of large fields."""
    entry: Entry = {"name": name}
    for n in LONG:
        strip = paper_fields.KINDS[name](n)[:, : n // 8]
        terrain = adret.Terrain(np.ascontiguousarray(strip), (1.0, 1.0))
        for method, near in (("rays", NEAR["rays"]), ("tree", 0), ("tree", NEAR["tree"])):
            entry[f"{method}_{near}_{n}"] = cpu_ns(
                lambda terrain=terrain, method=method, near=near: sweep(
                    terrain, np.radians([-3.0]), "visible_count", method, near
                ),
                terrain.mask.size,
                1,
            )
    return entry


def errors_of_azimuths(name: str, terrain: adret.Terrain, cells: int, repeats: int) -> Entry:
    """CPU time and error of methods and near radii, each azimuth for itself."""
    rng = np.random.default_rng(1)
    azimuths = np.arange(12) * (2.0 * np.pi / 12.0) + 0.05
    if terrain.mask.size > LARGE:
        terrain = terrain.window((100, 500), (300, 900))
    places = rng.permutation(np.argwhere(~terrain.mask))[:cells]
    names: tuple[Reduction, ...] = ("visible_area", "visible_count", "sight_distance")
    exact = {reduce: np.zeros(len(places)) for reduce in names}
    for i, (row, column) in enumerate(places):
        for azimuth in azimuths:
            steps, step, _ = ray_oracle.seen_samples(
                terrain.heights, terrain.cell_size, row, column, azimuth, observer_height=EYE
            )
            exact["visible_area"][i] += 2.0 * np.pi / len(azimuths) * step**2 * steps.sum()
            exact["visible_count"][i] += steps.size
            exact["sight_distance"][i] += steps.max(initial=0) * step / len(azimuths)
    views = adret.horizon_at(
        terrain, places[:, 0], places[:, 1], azimuths=azimuths, observer_height=EYE
    )
    entries = []
    for method, near in METHODS:
        entry: Entry = {"method": method, "near": near}
        for reduce in names:
            layer, _ = sweep(terrain, azimuths, reduce, method, near, observer_height=EYE)
            off = layer[tuple(places.T)] - exact[reduce]
            entry[reduce] = float(abs(off).mean() / exact[reduce].mean())
            entry[f"{reduce}_bias"] = float(off.mean() / exact[reduce].mean())
        entry["horizon_deg"] = horizon_error(terrain, places, azimuths, views, method, near)
        entry["ns"] = cpu_ns(
            lambda method=method, near=near: sweep(
                terrain, azimuths, "visible_area", method, near, observer_height=EYE
            ),
            terrain.mask.size * len(azimuths),
            repeats,
        )
        entries.append(entry)
    return {"name": name, "cells": len(places), "entries": entries}


def horizon_error(
    terrain: adret.Terrain,
    places: NDArray[np.int64],
    azimuths: NDArray[np.float64],
    exact: Layer,
    method: SightMethod,
    near: int,
) -> float:
    """Mean error of the horizon in some azimuths [degrees], what sky-view factors are made of."""
    from adret.sight_frames import SightFrame, Work
    from adret.sweep import Direction

    options = HorizonOptions(near=near, observer_height=EYE)
    off = []
    for k, azimuth in enumerate(azimuths.tolist()):
        direction = Direction.of(azimuth, terrain.cell_size)
        frame = SightFrame(terrain, direction.orientation)
        sight = frame.sight(direction, options, method)
        frame.add_slopes(sight, band=(0, terrain.shape[0]), work=Work())
        slope = frame.in_raster(frame.layer)[tuple(places.T)]
        off.append(np.degrees(abs(np.arctan(slope) - exact[k])))
    return float(np.mean(off))


def errors_of_areas(terrain: adret.Terrain, cells: int) -> Entry:
    """Error of total viewsheds over the number of azimuths, against exact viewsheds."""
    rng = np.random.default_rng(2)
    places = rng.permutation(np.argwhere(~terrain.mask))[:cells]
    cell = terrain.cell_size[0] * terrain.cell_size[1]
    seen = [
        adret.viewshed(terrain, place, observer_height=TOWER, max_distance=RANGE).visible.sum()
        for place in places
    ]
    exact = cell * (np.array(seen) - 1.0)
    entries = []
    for method, near in (("rays", NEAR["rays"]), ("rays", 32), ("tree", 0), ("tree", 32)):
        for directions in (8, 16, 32, 64, 128):
            area, _ = sweep(
                terrain,
                adret.azimuth_set(directions),
                "visible_area",
                method,
                near,
                observer_height=TOWER,
                max_distance=RANGE,
            )
            off = area[tuple(places.T)] - exact
            entries.append(
                {
                    "method": method,
                    "near": near,
                    "directions": directions,
                    "mean": float(abs(off).mean() / exact.mean()),
                    "bias": float(off.mean() / exact.mean()),
                }
            )
    return {"cells": len(places), "entries": entries}


def real_fields() -> list[tuple[str, adret.Terrain]]:
    """The example DEM, and a larger one where the data folder is."""
    example = REPOSITORY / "examples" / "data" / "alpine_aletsch_dhm200_lv95_200m.tif"
    found = [("Aletsch, 200 m", adret.Terrain.open(example))]
    folder = Path(os.environ.get("ADRET_DATA", REPOSITORY.parent / "shared" / "data"))
    larger = folder / "dem" / "alpine_bigtujunga_srtm1_utm11_30m.tif"
    if larger.is_file():
        found.append(("Big Tujunga, 30 m", adret.Terrain.open(larger)))
    return found


def warm_up() -> None:
    """Compile."""
    small = adret.Terrain(paper_fields.fractal_terrain(64), (1.0, 1.0))
    counted(small)
    timed(small, 1)
    errors_of_azimuths("small", small, 2, 1)


def main() -> None:
    """Measure, write, print where."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, default=1024, help="cells a side of the fields")
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--cells", type=int, default=100, help="cells of which the error is known")
    parser.add_argument("--out", type=Path, default=REPOSITORY / "benchmarks" / "results")
    options = parser.parse_args()
    results: Entry = {"about": present.about(), "fields": []}
    warm_up()
    fields = [
        (name, adret.Terrain(kind(options.size), (1.0, 1.0)))
        for name, kind in paper_fields.KINDS.items()
    ]
    real = real_fields()
    for name, terrain in [*fields, *real]:
        entry = {"name": name, **counted(terrain), **timed(terrain, options.repeats)}
        results["fields"].append(entry)
        print(
            f"{name}: rays {entry['rays_seen']:.1f}, tree {entry['tree_seen']:.1f} ns, walks "
            f"{entry['walk_published']:.0f}, {entry['walk_lines_seen']:.0f}, "
            f"{entry['walk_neighbours']:.0f} ns",
            flush=True,
        )
    results["growth"] = {
        "growing detail (fractal)": growth(paper_fields.fractal_terrain, GROWTH) | {"paper": 1.65},
        "growing extent (random)": growth(paper_fields.random_heights, GROWTH) | {"paper": 1.01},
    }
    results["long"] = [long_lines(name) for name in paper_fields.KINDS]
    results["azimuths"] = [
        errors_of_azimuths(name, terrain, options.cells, options.repeats) for name, terrain in real
    ]
    results["areas"] = errors_of_areas(real[0][1], options.cells)
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "visibility.json").write_text(json.dumps(results, indent=1) + "\n")
    (options.out / "visibility.md").write_text(visibility_tables.table(results))
    visibility_tables.plot(results, options.out / "visibility.png")
    print(visibility_tables.table(results))
    for suffix in ("json", "md", "png"):
        print(options.out / f"visibility.{suffix}")


if __name__ == "__main__":
    main()
