"""Tables and plots of `visibility.py`."""

from pathlib import Path
from typing import Any

import numpy as np

Entry = dict[str, Any]

# Tables 1 to 3 of the paper: visible points, local horizons (its tree's root children) and
# iterations a point and azimuth, and how often faster than the naive walk.
PAPER = {
    "fractal terrain": (27.1, 9.25, 11.7, 2.4),
    "brick surface": (8.94, 3.06, 4.80, 4.2),
    "sine grid": (22.8, 1.68, 3.02, 13.0),
    "blocks": (5.56, 2.55, 3.76, 41.0),
}
EVERY = 4096


def table(results: Entry) -> str:
    """The results as Markdown."""
    machine = results["about"]
    lines = [
        "# Intervisibility: own rays, the convex-hull tree, naive walks",
        "",
        f"{machine['processor']}, {machine['threads']} threads, Python {machine['python']}, "
        f"Numba {machine['packages']['numba']}, commit {machine['commit'][:12]}, "
        f"{machine['time'][:10]}. Everything is a cell and azimuth; times are CPU time of all "
        "threads together. In brackets: the paper's own fields, which these imitate.",
        "",
        *_work(results),
        *_times(results),
        *_ratios(results),
        "",
        "## Growth of the checks of a line with its steps n",
        "",
        "| content | exponent | the paper |",
        "|---|---:|---:|",
    ]
    for name, g in results["growth"].items():
        lines.append(f"| {name} | {g['exponent']:.2f} | {g['paper']:.2f} |")
    lines += _long(results)
    for raster in results["azimuths"]:
        lines += _azimuths(raster)
    lines += _areas(results["areas"])
    return "\n".join(lines) + "\n"


def _work(results: Entry) -> list[str]:
    lines = [
        "## What is seen, and the tree's work (near = 0)",
        "",
        "| field | walk's steps | visible points | of the steps | root children | "
        "local horizons | checks | of the steps | repairs skipped |",
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for e in results["fields"]:
        paper = PAPER.get(e["name"])
        seen, children, checks = (f" ({v})" for v in paper[:3]) if paper else ("", "", "")
        lines.append(
            f"| {e['name']} | {e['naive_steps']:.0f} | {e['visible']:.2f}{seen} | "
            f"{100 * e['visible_share']:.1f} % | {e['root_children']:.2f}{children} | "
            f"{e['local_horizons']:.2f} | {e['checks']:.2f}{checks} | "
            f"{100 * e['checks_share']:.2f} % | {100 * e['repairs_skipped']:.0f} % |"
        )
    lines += [
        "",
        "Root children are the paper's local horizons, one a visible segment. The library's are "
        "the ends of runs of visible samples: fewer, since a run may hold several segments. "
        "Repairs are skipped in the safe zone.",
    ]
    return lines


def _times(results: Entry) -> list[str]:
    lines = [
        "",
        "## Time [CPU ns]",
        "",
        "| field | rays (default): horizons | visible count | samples looked at | tree: horizons | "
        "visible count | tree, near 32: visible count | walk, published | walk on lines: horizons "
        "| visible count | walk of neighbours | tree equals walk |",
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---|",
    ]
    for e in results["fields"]:
        equal = "yes" if e["equal_horizons"] and e["equal_seen"] else "NO"
        looked = e["rays_tested"] / (e["rays_tested"] + e["rays_skipped"])
        lines.append(
            f"| {e['name']} | {e['rays_horizons']:.1f} | {e['rays_seen']:.1f} | "
            f"{100 * looked:.0f} % | {e['tree_horizons']:.1f} | "
            f"{e['tree_seen']:.1f} | {e['tree_near_seen']:.1f} | "
            f"{e['walk_published']:.0f} | {e['walk_lines_horizons']:.0f} | "
            f"{e['walk_lines_seen']:.0f} | {e['walk_neighbours']:.0f} | {equal} |"
        )
    lines += [
        "",
        "*Rays*: every crossing of each cell's own ray, neighbours together, over what is too low "
        "to be seen. *Tree*: swept lines alone, near = 0. *Walk, published*: scalar, one receiver "
        "after the other, the height field sampled at every step, float32. *Walk on lines*: method "
        '"march" with near = 0, the same exact comparisons as the tree on lines sampled '
        "beforehand. *Walk of neighbours*: a step of all receivers of a row at once, in vector "
        "instructions, float32, rows only.",
    ]
    return lines


def _ratios(results: Entry) -> list[str]:
    lines = [
        "",
        "## How many times faster",
        "",
        "| field | the paper (GPU) | tree's horizons against the published walk | tree's visible "
        "count against it | tree's horizons against the walk on lines | rays' visible count "
        "against the published walk | against the walk of neighbours | against the tree |",
        "|---|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for e in results["fields"]:
        paper_ratio = f"{PAPER[e['name']][3]:g}" if e["name"] in PAPER else ""
        ratios = (
            e["walk_published"] / e["tree_horizons"],
            e["walk_published"] / e["tree_seen"],
            e["walk_lines_horizons"] / e["tree_horizons"],
            e["walk_published"] / e["rays_seen"],
            e["walk_neighbours"] / e["rays_seen"],
            e["tree_seen"] / e["rays_seen"],
        )
        lines.append(
            f"| {e['name']} | {paper_ratio} | " + " | ".join(f"{r:.1f}" for r in ratios) + " |"
        )
    return lines


def _long(results: Entry) -> list[str]:
    methods = (("rays", EVERY), ("tree", 0), ("tree", 32))
    sizes = sorted({int(key.rsplit("_", 1)[1]) for key in results["long"][0] if "_" in key})
    heads = [f"{method}, near {near}: {n} rows" for method, near in methods for n in sizes]
    lines = [
        "",
        "## Long lines: visible count on fields of more rows [CPU ns]",
        "",
        "| field | " + " | ".join(heads) + " |",
        "|---|" + "---:|" * len(heads),
    ]
    for e in results["long"]:
        times = [e[f"{method}_{near}_{n}"] for method, near in methods for n in sizes]
        lines.append(f"| {e['name']} | " + " | ".join(f"{t:.0f}" for t in times) + " |")
    return lines


def _azimuths(raster: Entry) -> list[str]:
    lines = [
        "",
        f"## Time against error of single azimuths: {raster['name']}",
        "",
        f"{raster['cells']} random cells, 12 azimuths, eye 2 m above the ground, against every "
        "crossing of the cell's own ray in double precision: mean absolute error as a share of "
        "the mean, and bias.",
        "",
        "| method | near | CPU ns | visible area | bias | visible count | bias | sight distance | "
        "bias | horizon |",
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for e in raster["entries"]:
        figures = [
            f"{100 * e[key]:{'+' if key.endswith('bias') else ''}.3f} %"
            for name in ("visible_area", "visible_count", "sight_distance")
            for key in (name, f"{name}_bias")
        ]
        near = "every crossing" if e["near"] == EVERY else e["near"]
        lines.append(
            f"| {e['method']} | {near} | {e['ns']:.0f} | {' | '.join(figures)} | "
            f"{e['horizon_deg']:.4f}° |"
        )
    return lines


def _areas(areas: Entry) -> list[str]:
    counts = sorted({e["directions"] for e in areas["entries"]})
    lines = [
        "",
        "## Total viewsheds against exact viewsheds",
        "",
        f"{areas['cells']} cells of the Aletsch raster, 20 m above the ground, within 20 km: mean "
        "absolute error of the area as a share of the mean, and bias, over the number of azimuths.",
        "",
        "| method | near | " + " | ".join(f"{k}" for k in counts) + " |",
        "|---|---:|" + "---:|" * len(counts),
    ]
    for method, near in dict.fromkeys((e["method"], e["near"]) for e in areas["entries"]):
        row = {
            e["directions"]: f"{100 * e['mean']:.1f} % ({100 * e['bias']:+.1f})"
            for e in areas["entries"]
            if (e["method"], e["near"]) == (method, near)
        }
        label = "every crossing" if near == EVERY else near
        lines.append(f"| {method} | {label} | " + " | ".join(row[k] for k in counts) + " |")
    lines += [
        "",
        "An exact viewshed counts cells whose centre is seen; azimuths look at the ground between "
        "centres, too, and a little less of that is seen.",
    ]
    return lines


def plot(results: Entry, path: Path) -> None:
    """Growth, times, time against error, error against azimuths."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(2, 2, figsize=(13.6, 10.4), layout="constrained")
    _plot_growth(axes[0, 0], results)
    _plot_times(axes[0, 1], results)
    _plot_errors(axes[1, 0], results)
    _plot_areas(axes[1, 1], results)
    for axis in axes.flat:
        axis.grid(True, which="both", alpha=0.25)
    figure.savefig(path, dpi=110)
    pyplot.close(figure)


def _plot_growth(axis: Any, results: Entry) -> None:
    steps = np.array(next(iter(results["growth"].values()))["steps"], dtype=float)
    axis.loglog(steps, steps * (steps - 1.0) / 2.0, "k:", label="naive walk, n²/2")
    axis.loglog(steps, steps, "k--", label="n")
    for name, g in results["growth"].items():
        axis.loglog(g["steps"], g["checks"], "o-", label=f"{name}: n^{g['exponent']:.2f}")
    axis.set_xlabel("steps n of a line")
    axis.set_ylabel("convexity checks a line")
    axis.legend(fontsize=8)


def _plot_times(axis: Any, results: Entry) -> None:
    names = [e["name"] for e in results["fields"]]
    places = np.arange(len(names))
    bars = (
        ("walk_published", "walk, published"),
        ("walk_lines_seen", "walk on lines"),
        ("walk_neighbours", "walk of neighbours"),
        ("tree_seen", "tree, visible count"),
        ("tree_horizons", "tree, horizons"),
        ("rays_seen", "rays, visible count"),
    )
    for offset, (key, label) in enumerate(bars):
        heights = [e[key] for e in results["fields"]]
        axis.bar(places + 0.14 * (offset - 2.5), heights, 0.13, label=label)
    axis.set_yscale("log")
    axis.set_xticks(places, [name.replace(", ", ",\n") for name in names], fontsize=8)
    axis.set_ylabel("CPU time [ns a cell and azimuth]")
    # Above the bars, none of which it covers.
    axis.legend(fontsize=8, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))


def _plot_errors(axis: Any, results: Entry) -> None:
    for raster in results["azimuths"]:
        for method, marker in (("rays", "o-"), ("tree", "s--")):
            entries = [e for e in raster["entries"] if e["method"] == method]
            axis.loglog(
                [e["ns"] for e in entries],
                [100 * e["visible_area"] for e in entries],
                marker,
                label=f"{raster['name']}: {method}",
            )
            for e in entries:
                axis.annotate(
                    "all" if e["near"] == EVERY else str(e["near"]),
                    (e["ns"], 100 * e["visible_area"]),
                    textcoords="offset points",
                    xytext=(5, 4),
                    fontsize=8,
                )
    axis.set_xlabel("CPU time [ns a cell and azimuth]; the numbers are near radii")
    axis.set_ylabel("mean error of the visible area of single azimuths [%]")
    axis.legend(fontsize=8)


def _plot_areas(axis: Any, results: Entry) -> None:
    entries = results["areas"]["entries"]
    for method, near in dict.fromkeys((e["method"], e["near"]) for e in entries):
        some = [e for e in entries if (e["method"], e["near"]) == (method, near)]
        label = "every crossing" if near == EVERY else f"near {near}"
        axis.loglog(
            [e["directions"] for e in some],
            [100 * e["mean"] for e in some],
            "o-" if method == "rays" else "s--",
            label=f"{method}, {label}",
        )
    axis.set_xlabel("azimuths")
    axis.set_ylabel("mean error of the total viewshed's area [%]")
    axis.legend(fontsize=8)
