"""Table and plot of viewsheds.py."""

from pathlib import Path
from typing import Any

Entry = dict[str, Any]


def share(part: float, whole: float) -> str:
    """A part as per cent of the whole."""
    return "–" if whole == 0 else f"{100.0 * part / whole:.3g} %"


def named(entry: Entry) -> str:
    """Name and version."""
    return f"{entry['name']} ({entry['version']})" if "version" in entry else str(entry["name"])


def table(results: Entry) -> str:
    """The results as Markdown."""
    about = results["about"]
    lines = [
        "# Viewsheds: run time against error",
        "",
        f"{about['processor']}, {about['cores']} cores, Python {about['python']}, Numba "
        f"{about['packages']['numba']}, commit {about['commit'][:12]}, {about['time'][:10]}; load "
        f"{about['load_before']:.1f} before the run, which took {results['seconds']:.0f} s "
        f"and {results['cpu_seconds']:.0f} s of CPU. CPU time is that of all threads together.",
        "",
        "## One observer",
        "",
        "*Pairs*: random targets, half of them seen, whose line of sight was followed in whole "
        "numbers. *Outside*: those whose cell and its eight neighbours have the same verdict. "
        "*Sees more, less*: share of all cells outside that band, against Adret. *Of the rule*: "
        "differing cells whose verdict the tool's own rule gives, as "
        "[decision 3](../../docs/explanation/decisions/0003-viewsheds-by-wedges.md) states it; of "
        "GRASS up to 500 a viewshed were looked at.",
    ]
    for raster in results["views"]:
        rows, columns = raster["shape"]
        lines += [
            "",
            f"### {raster['raster']}, {columns} x {rows}, {raster['observers']} observers, "
            f"{raster['seen']:.0%} seen",
            "",
            "| tool | CPU ns a cell | wrong of all pairs | wrong outside | sees more | sees less | "
            "least agreement | of the rule |",
            "|---|---:|---:|---:|---:|---:|---:|---:|",
        ]
        for e in raster["entries"]:
            if "left_out" in e:
                lines.append(f"| {e['name']} | left out: {e['left_out']} | | | | | | |")
                continue
            rule = share(e["of_rule"], e["differing"]) if "differing" in e else ""
            if rule:
                rule = f"{e['of_rule']} of {e['differing']}"
            built = f" + {e['build_seconds']:.1f} s" if "build_seconds" in e else ""
            name = f"**{named(e)}**" if e["name"] == "Adret" else named(e)
            lines.append(
                f"| {name} | {e['ns']:.0f}{built} | {e['pairs_wrong']} of {e['pairs']} | "
                f"{e['pairs_wrong_outside']} of {e['pairs_outside']} | "
                f"{100 * e['sees_more']:.4f} % | {100 * e['sees_less']:.4f} % | "
                f"{100 * e['least_agreement']:.3f} % | {rule} |"
            )
    lines += [
        "",
        "## All cells: the ground that each one sees",
        "",
        "Errors are shares of the mean area, on cells whose exact viewshed was measured. Embree "
        "and exact viewsheds were run from those cells alone; their time is that of as many "
        "as there are cells. WhiteboxTools counts the stations that see a cell's ground, not the "
        "ground that a station sees; it is held against exact viewsheds of that kind.",
    ]
    for raster in results["totals"]:
        lines += [
            "",
            f"### {raster['raster']}, {raster['side']}² cells, eye {raster['eye']:g} m, "
            f"{raster['sample']} cells compared",
            "",
            "| tool | CPU µs a cell | mean error | bias | largest |",
            "|---|---:|---:|---:|---:|",
        ]
        for e in raster["entries"]:
            if "left_out" in e:
                lines.append(f"| {e['name']} | left out: {e['left_out']} | | | |")
                continue
            lines.append(
                f"| {named(e)} | {e['us']:.1f} | {e['mean']:.2%} | {e['bias']:+.2%} | "
                f"{e['largest']:.1%} |"
            )
    lines += [
        "",
        "## Growth with size: one observer on fractal ground",
        "",
        "| cells | CPU ns a cell | seen |",
        "|---:|---:|---:|",
    ]
    lines += [f"| {e['side']}² | {e['ns']:.0f} | {e['seen']:.0%} |" for e in results["growth"]]
    missing = sum(
        "left_out" in e for r in (*results["views"], *results["totals"]) for e in r["entries"]
    )
    lines += ["", f"Measurements left out because a tool was not there: {missing}."]
    return "\n".join(lines) + "\n"


def plot(results: Entry, path: Path) -> None:
    """Errors against CPU time: of one observer's viewshed, and of total viewsheds."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    count = 1 + len(results["totals"])
    figure, axes = pyplot.subplots(1, count, figsize=(5.6 * count, 4.6), layout="constrained")
    one_observer(axes[0], results["views"])
    for axis, raster in zip(axes[1:], results["totals"], strict=True):
        all_cells(axis, raster)
    for axis in axes:
        axis.grid(True, which="both", alpha=0.25)
        axis.legend(fontsize=7)
    figure.savefig(path, dpi=110)
    pyplot.close(figure)


def one_observer(axis: Any, views: list[Entry]) -> None:
    """Share of pairs that are wrong against CPU time; a marker a raster."""
    names: dict[str, list[tuple[float, float]]] = {}
    for raster in views:
        for e in raster["entries"]:
            if "left_out" not in e:
                off = e["pairs_wrong"] / e["pairs"]
                names.setdefault(e["name"], []).append((e["ns"], off))
    floor = min((y for points in names.values() for _, y in points if y > 0), default=1e-3) / 4
    for marker, (name, points) in zip("o^v<>sDP", names.items(), strict=False):
        xs, ys = zip(*points, strict=True)
        axis.loglog(xs, [max(y, floor) for y in ys], marker, label=name)
    axis.axhline(floor, color="k", lw=0.8, ls=":")
    axis.annotate(
        "none wrong", (0.99, floor * 1.05), xycoords=("axes fraction", "data"), ha="right"
    )
    axis.set_xlabel("CPU time [ns a cell]")
    axis.set_ylabel("share of pairs that are wrong")
    axis.set_title("one observer")


def all_cells(axis: Any, raster: Entry) -> None:
    """Mean error of the area that each cell sees against CPU time."""
    for prefix, marker in (("Adret", "o"), ("WhiteboxTools", "s"), ("Embree", "D")):
        some = [
            e
            for e in raster["entries"]
            if e["name"].startswith(prefix) and e.get("mean", 0.0) > 0.0
        ]
        for usual in (True, False):
            group = [e for e in some if e.get("default_near", True) == usual]
            if not group:
                continue
            axis.loglog(
                [e["us"] for e in group],
                [e["mean"] for e in group],
                marker + ("" if prefix == "Embree" else "-"),
                label=prefix + ("" if usual else ", 64 azimuths, by near radius"),
            )
            for e in group:
                axis.annotate(
                    e["name"].split(", ", 1)[1].replace(" azimuths", ""),
                    (e["us"], e["mean"]),
                    textcoords="offset points",
                    xytext=(5, 4),
                    fontsize=7,
                )
    axis.set_xlabel("CPU time [µs a cell]")
    axis.set_ylabel("mean error of the area seen")
    axis.set_title(f"all cells: {raster['raster'].split('_')[1]}, {raster['side']}²")
