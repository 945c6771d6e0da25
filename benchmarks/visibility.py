"""Intervisibility: what is seen, the work of the convex-hull tree, and time against naive walks.

``python benchmarks/visibility.py`` runs it, on the four kinds of field of paper P2 (its tables 1, 2
and 3 and figure 8) and on real rasters.  Writes results/visibility.json (with machine, versions and
commit), .md and .png.  Times are CPU time of all threads, the least of several repeats, after a
warm-up that compiles, all in one run.
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
from numpy.typing import NDArray  # noqa: E402

import adret  # noqa: E402
import paper_fields  # noqa: E402
from adret.horizon import HorizonOptions  # noqa: E402
from adret.sight_sweep import Reduction, SightMethod, SightRun  # noqa: E402

Entry = dict[str, Any]

# Tables 1 to 3 of the paper: visible points, local horizons (its tree's root children) and
# iterations a point and azimuth, and how often faster than the naive walk.
PAPER = {
    "fractal terrain": (27.1, 9.25, 11.7, 2.4),
    "brick surface": (8.94, 3.06, 4.80, 4.2),
    "sine grid": (22.8, 1.68, 3.02, 13.0),
    "blocks": (5.56, 2.55, 3.76, 41.0),
}
OBLIQUE = np.radians([-10.0, -20.0, -30.0, -40.0])  # towards smaller rows and columns, one octant
ALL_ROUND = np.radians(np.arange(8) * 45.0 + 20.0)
GROWTH = (64, 128, 256, 512, 1024, 2048, 4096)
FIT_FROM = 512  # as the paper fits


def sweep(
    terrain: adret.Terrain,
    azimuths: NDArray[np.float64],
    reduce: Reduction,
    method: SightMethod = "tree",
) -> tuple[NDArray[np.float32], SightRun]:
    """One reduction, and the run that made it: it knows its work."""
    run = SightRun(terrain, azimuths, HorizonOptions(), method)
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
    """Visible points, horizons and checks a point and azimuth, all round."""
    seen, run = sweep(terrain, ALL_ROUND, "visible_count")
    ends, _ = sweep(terrain, ALL_ROUND, "horizon_count")
    samples = seen.size * len(ALL_ROUND)
    flat = adret.Terrain(np.zeros(terrain.shape), terrain.cell_size)
    steps = float(sweep(flat, ALL_ROUND, "visible_count")[0].sum(dtype=float)) / samples
    checks, children = run.work.sum(axis=0) / samples
    visible = float(seen.sum(dtype=float)) / samples
    return {
        "naive_steps": steps,
        "visible": visible,
        "visible_share": visible / steps,
        "local_horizons": float(ends.sum(dtype=float)) / samples,
        "root_children": float(children),
        "checks": float(checks),
        "checks_share": float(checks) / steps,
    }


def timed(terrain: adret.Terrain, repeats: int) -> Entry:
    """CPU time a cell and azimuth of the tree and of the walks, and whether results are equal."""
    samples = terrain.mask.size
    four, one = samples * len(OBLIQUE), OBLIQUE[1:2]
    z = np.ascontiguousarray(terrain.heights)
    shear = float(np.tan(-one[0]) * terrain.cell_size[1] / terrain.cell_size[0])
    count = np.empty(z.shape, np.float32)
    entry: Entry = {}
    for reduce, name in (("horizon_count", "horizons"), ("visible_count", "seen")):
        entry[f"tree_{name}"] = cpu_ns(
            lambda reduce=reduce: sweep(terrain, OBLIQUE, reduce), four, repeats
        )
        tree, _ = sweep(terrain, one, reduce)
        walked: list[NDArray[np.float32]] = []
        entry[f"walk_lines_{name}"] = cpu_ns(
            lambda reduce=reduce, out=walked: out.append(sweep(terrain, one, reduce, "march")[0]),
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
        _, run = sweep(terrain, np.array([np.pi / 2, 1.5 * np.pi]), "horizon_count")
        checks.append(float(run.work[:, 0].sum()) / (2 * len(field)))
    far = [i for i, n in enumerate(sizes) if n >= FIT_FROM]
    slope = np.polyfit(np.log([sizes[i] for i in far]), np.log([checks[i] for i in far]), 1)[0]
    return {"steps": list(sizes), "checks": checks, "exponent": float(slope)}


def real_fields() -> list[tuple[str, adret.Terrain]]:
    """The example DEM, and a larger one where the data folder is."""
    example = REPOSITORY / "examples" / "data" / "alpine_aletsch_dhm200_lv95_200m.tif"
    found = [("Aletsch, 200 m", adret.Terrain.open(example))]
    folder = Path(os.environ.get("ADRET_DATA", REPOSITORY.parent / "shared" / "data"))
    larger = folder / "dem" / "alpine_bigtujunga_srtm1_utm11_30m.tif"
    if larger.is_file():
        found.append(("Big Tujunga, 30 m", adret.Terrain.open(larger)))
    return found


def table(results: Entry) -> str:
    """The results as Markdown."""
    machine = results["about"]
    lines = [
        "# Intervisibility: the convex-hull tree against naive walks",
        "",
        f"{machine['processor']}, {machine['threads']} threads, Python {machine['python']}, "
        f"Numba {machine['packages']['numba']}, commit {machine['commit'][:12]}, "
        f"{machine['time'][:10]}. Everything is a cell and azimuth; times are CPU time of all "
        "threads together. In brackets: the paper's own fields, which these imitate.",
        "",
        "## What is seen, and the tree's work",
        "",
        "| field | walk's steps | visible points | of the steps | root children | "
        "local horizons | checks | of the steps |",
        "|---|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for e in results["fields"]:
        paper = PAPER.get(e["name"])
        seen, children, checks = (f" ({v})" for v in paper[:3]) if paper else ("", "", "")
        lines.append(
            f"| {e['name']} | {e['naive_steps']:.0f} | {e['visible']:.2f}{seen} | "
            f"{100 * e['visible_share']:.1f} % | {e['root_children']:.2f}{children} | "
            f"{e['local_horizons']:.2f} | {e['checks']:.2f}{checks} | "
            f"{100 * e['checks_share']:.2f} % |"
        )
    lines += [
        "",
        "Root children are the paper's local horizons, one a visible segment. The library's are "
        "the ends of runs of visible samples: fewer, since a run may hold several segments.",
        "",
        "## Time [CPU ns]",
        "",
        "| field | tree: horizons | tree: visible count | walk, published | walk on lines: "
        "horizons | visible count | walk of neighbours | tree equals walk |",
        "|---|---:|---:|---:|---:|---:|---:|---|",
    ]
    for e in results["fields"]:
        equal = "yes" if e["equal_horizons"] and e["equal_seen"] else "NO"
        lines.append(
            f"| {e['name']} | {e['tree_horizons']:.1f} | {e['tree_seen']:.1f} | "
            f"{e['walk_published']:.0f} | {e['walk_lines_horizons']:.0f} | "
            f"{e['walk_lines_seen']:.0f} | {e['walk_neighbours']:.0f} | {equal} |"
        )
    lines += [
        "",
        "*Walk, published*: scalar, one receiver after the other, the height field sampled at "
        'every step, float32. *Walk on lines*: method "march", the same exact comparisons as '
        "the tree on lines sampled beforehand. *Walk of neighbours*: a step of all receivers of "
        "a row at once, in vector instructions, float32.",
        "",
        "## How many times faster the tree is",
        "",
        "| field | the paper (GPU) | horizons against the published walk | visible count against "
        "it | horizons against the walk on lines | visible count against it | visible count "
        "against the walk of neighbours |",
        "|---|---:|---:|---:|---:|---:|---:|",
    ]
    for e in results["fields"]:
        paper_ratio = f"{PAPER[e['name']][3]:g}" if e["name"] in PAPER else ""
        ratios = (
            e["walk_published"] / e["tree_horizons"],
            e["walk_published"] / e["tree_seen"],
            e["walk_lines_horizons"] / e["tree_horizons"],
            e["walk_lines_seen"] / e["tree_seen"],
            e["walk_neighbours"] / e["tree_seen"],
        )
        lines.append(
            f"| {e['name']} | {paper_ratio} | " + " | ".join(f"{r:.1f}" for r in ratios) + " |"
        )
    lines += ["", "## Growth of the checks of a line with its steps n", ""]
    lines += ["| content | exponent | the paper |", "|---|---:|---:|"]
    for name, g in results["growth"].items():
        lines.append(f"| {name} | {g['exponent']:.2f} | {g['paper']:.2f} |")
    return "\n".join(lines) + "\n"


def plot(results: Entry, path: Path) -> None:
    """Checks against steps, and times, both logarithmic."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, (left, right) = pyplot.subplots(1, 2, figsize=(12.8, 4.8), layout="constrained")
    steps = np.array(GROWTH, dtype=float)
    left.loglog(steps, steps * (steps - 1.0) / 2.0, "k:", label="naive walk, n²/2")
    left.loglog(steps, steps, "k--", label="n")
    for name, g in results["growth"].items():
        left.loglog(g["steps"], g["checks"], "o-", label=f"{name}: n^{g['exponent']:.2f}")
    left.set_xlabel("steps n of a line")
    left.set_ylabel("convexity checks a line")
    names = [e["name"] for e in results["fields"]]
    places = np.arange(len(names))
    for offset, (key, label) in enumerate(
        (
            ("walk_published", "walk, published"),
            ("walk_lines_seen", "walk on lines"),
            ("walk_neighbours", "walk of neighbours"),
            ("tree_seen", "tree, visible count"),
            ("tree_horizons", "tree, horizons"),
        )
    ):
        heights = [e[key] for e in results["fields"]]
        right.bar(places + 0.16 * (offset - 2), heights, 0.15, label=label)
    right.set_yscale("log")
    right.set_xticks(places, names, fontsize=8)
    right.set_ylabel("CPU time [ns a cell and azimuth]")
    for axis in (left, right):
        axis.grid(True, which="both", alpha=0.25)
        axis.legend(fontsize=8)
    figure.savefig(path, dpi=120)
    pyplot.close(figure)


def main() -> None:
    """Measure, write, print where."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, default=1024, help="cells a side of the fields")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--out", type=Path, default=REPOSITORY / "benchmarks" / "results")
    options = parser.parse_args()
    results: Entry = {"about": present.about(), "fields": []}
    small = adret.Terrain(paper_fields.fractal_terrain(64), (1.0, 1.0))
    counted(small)
    timed(small, 1)
    fields = [
        (name, adret.Terrain(kind(options.size), (1.0, 1.0)))
        for name, kind in paper_fields.KINDS.items()
    ]
    for name, terrain in [*fields, *real_fields()]:
        entry = {"name": name, **counted(terrain), **timed(terrain, options.repeats)}
        results["fields"].append(entry)
        print(
            f"{name}: tree {entry['tree_horizons']:.1f} and {entry['tree_seen']:.1f} ns, walks "
            f"{entry['walk_published']:.0f}, {entry['walk_lines_seen']:.0f}, "
            f"{entry['walk_neighbours']:.0f} ns",
            flush=True,
        )
    results["growth"] = {
        "growing detail (fractal)": growth(paper_fields.fractal_terrain, GROWTH) | {"paper": 1.65},
        "growing extent (random)": growth(paper_fields.random_heights, GROWTH) | {"paper": 1.01},
    }
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "visibility.json").write_text(json.dumps(results, indent=1) + "\n")
    (options.out / "visibility.md").write_text(table(results))
    plot(results, options.out / "visibility.png")
    print(table(results))
    for suffix in ("json", "md", "png"):
        print(options.out / f"visibility.{suffix}")


if __name__ == "__main__":
    main()
