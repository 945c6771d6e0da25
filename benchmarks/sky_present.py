"""Table and plot of the sky views' and shadows' run time against error."""

from pathlib import Path
from typing import Any

Entry = dict[str, Any]
VIEW_NAMES = {
    "visible": "visible sky, ⟨1 − sin h⟩",
    "normal": "sky view of the normal, V_d",
    "horizontal": "sky view of a horizontal cell, ⟨cos² h⟩",
}


def table(results: Entry) -> str:
    """The results as Markdown."""
    machine = results["about"]
    rows, columns = results["shape"]
    default = f"near={results['default_near']}"
    lines = [
        "# Sky view and shadows: run time against error",
        "",
        f"{results['raster']}, {columns} x {rows} cells; {machine['processor']}, "
        f"{machine['threads']} threads, Python {machine['python']}, "
        f"Numba {machine['packages']['numba']}, commit {machine['commit'][:12]}, "
        f"{machine['time'][:10]}. CPU time of all threads. Sky views against exact horizons "
        f"towards 720 azimuths at {results['cells']} random cells (RVT: 100 cells off the edge); "
        "with `near` varied, and for prior work and other tools, 32 azimuths unless said. A tool "
        "that has a definition of its own is held against the nearest of ours.",
    ]
    for view, title in VIEW_NAMES.items():
        chosen = [e for e in results["views"] if e.get("view") == view]
        if not chosen:
            continue
        lines += ["", f"## {title[0].upper()}{title[1:]}", ""]
        lines += ["| method | azimuths | CPU µs a cell | mean error | p99 | max | bias |"]
        lines += ["|---|---:|---:|---:|---:|---:|---:|"]
        for e in chosen:
            figures = " | ".join(f"{e[key]:.5f}" for key in ("mean", "p99", "max", "bias"))
            lines.append(
                f"| {_name(e, default)} | {e['azimuths']} | {e['us_a_cell']:.3g} | {figures} |"
            )
    missing = [e for e in results["views"] + results["shadows"] if "left_out" in e]
    if missing:
        said = "; ".join(f"{e['series']} ({e['left_out']})" for e in missing)
        lines += ["", f"Left out: {said}."]
    suns = ", ".join(f"{a:g}°/{e:g}°" for a, e in results["suns"])
    lines += [
        "",
        "## Cast shadows",
        "",
        f"Suns at {suns}; cells that face the sun. The last column is how far the sun stands from "
        "the true horizon where the verdict is wrong, at most.",
        "",
        "| method | CPU ns a cell and sun | wrong verdicts | sun off the horizon |",
        "|---|---:|---:|---:|",
    ]
    for e in results["shadows"]:
        if "left_out" in e:
            continue
        name = _name(e, default) + (" (first sun)" if e["suns"] < len(results["suns"]) else "")
        lines.append(
            f"| {name} | {e['ns_a_cell']:.3g} | {100 * e['wrong']:.4f} % | {e['off_deg']:.2f}° |"
        )
    lines += [
        "",
        "## What the number of azimuths costs",
        "",
        "Mean error of sky views from exact horizons towards fewer azimuths.",
        "",
        "| azimuths | visible | horizontal | normal |",
        "|---:|---:|---:|---:|",
    ]
    for e in results["azimuths"]:
        figures = " | ".join(f"{e[v]['mean']:.6f}" for v in ("visible", "horizontal", "normal"))
        lines.append(f"| {e['azimuths']} | {figures} |")
    lines += [
        "",
        "## What the resolution costs",
        "",
        "Means of 3 × 3 and 9 × 9 cells of the whole raster. *Method*: the default sweep against "
        "exact horizons of the same raster; *ground*: exact sky views of the coarser raster "
        "against those of the finest at the same places (32 azimuths both).",
        "",
        "| cell | cells | horizon, method | visible, method | normal, method | visible, ground "
        "| normal, ground |",
        "|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for e in results["resolution"]:
        lines.append(
            f"| {e['cell_m']:g} m | {e['shape'][1]} x {e['shape'][0]} | {e['horizon_deg']:.4f}° | "
            f"{e['method']['visible']:.6f} | {e['method']['normal']:.6f} | "
            f"{e['ground']['visible']:.4f} | {e['ground']['normal']:.4f} |"
        )
    return "\n".join(lines) + "\n"


def _name(e: Entry, default: str) -> str:
    name = f"{e['series']}, {e['knob']}" if e["knob"] else e["series"]
    name = name.replace("sweep, azimuths, ", "sweep, ").replace("sweep, near, ", "sweep, ")
    if "version" in e:
        name += f" {e['version']}"
    return f"**{name} (default)**" if e["knob"] == default else name


def plot(results: Entry, path: Path) -> None:
    """Mean error, and wrong verdicts, against CPU time."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, 3, figsize=(17.0, 6.2), layout="constrained")
    panels = [
        ([e for e in results["views"] if e.get("view") == view], "us_a_cell", "mean", title)
        for view, title in VIEW_NAMES.items()
        if view != "horizontal"
    ]
    shadows = [e for e in results["shadows"] if e.get("wrong")]
    panels.append((shadows, "ns_a_cell", "wrong", "cast shadows"))
    for axis, (entries, x, y, title) in zip(axes, panels, strict=True):
        series: dict[str, list[Entry]] = {}
        for e in entries:
            series.setdefault(e["series"], []).append(e)
        markers = iter("sD^v<>Ph*Xdp" * 2)
        for name, points in series.items():
            line = "o-" if len(points) > 1 else next(markers)
            axis.loglog([e[x] for e in points], [e[y] for e in points], line, label=name)
            if len(points) > 1:
                for e in points:
                    knob = e["knob"].split("=")[-1].split(" ")[0]
                    at = (e[x], e[y])
                    axis.annotate(knob, at, textcoords="offset points", xytext=(4, 4), fontsize=7)
        unit = "µs a cell" if x == "us_a_cell" else "ns a cell and sun"
        axis.set_xlabel(f"CPU time [{unit}]")
        axis.set_ylabel("mean error [-]" if y == "mean" else "share of wrong verdicts")
        axis.set_title(title)
        axis.grid(True, which="both", alpha=0.25)
        axis.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.13), ncol=3)
    figure.savefig(path, dpi=110)
    pyplot.close(figure)
