"""Table and plot of the benchmark of indirect light."""

from pathlib import Path
from typing import Any

Entry = dict[str, Any]


def percent(value: float) -> str:
    """A share as per cent."""
    return f"{100.0 * value:.3g} %"


def rows_of(head: str, rows: list[list[str]]) -> list[str]:
    """A Markdown table; the first column is text."""
    columns = head.count("|") + 1
    return [
        "",
        f"| {head} |",
        "|---|" + "---:|" * (columns - 1),
        *(f"| {' | '.join(row)} |" for row in rows),
    ]


def table(results: Entry) -> str:
    """The results as Markdown."""
    about = results["about"]
    lines = [
        "# Indirect light: run time against error",
        "",
        f"{about['processor']}, {about['threads']} threads, Python {about['python']}, Numba "
        f"{about['packages']['numba']}, commit {about['commit'][:12]}, {about['time'][:10]}; load "
        f"{about['load_before']:.1f} before the run. CPU time is that of all threads together "
        f"({about['cpu_seconds']:.0f} s in all). Errors are shares of the mean of "
        "what they are measured against.",
        "",
        "## Spherical bowl of 70°, albedo 0.6, sun 25° high: closed form",
        *rows_of(
            "cells | azimuths | bounces | want | got | mean error | p99 | max | within 1 % | CPU s",
            [
                [
                    f"{e['size']}²",
                    f"{e['directions']}",
                    f"{e['bounces']}",
                    f"{e['want']:.6f}",
                    f"{e['got']:.6f}",
                    *(percent(e[key]) for key in ("mean", "p99", "most")),
                    f"{100.0 * e['within_1_percent']:.2f} %",
                    f"{e['cpu_seconds']:.1f}",
                ]
                for e in results["bowl"]
            ],
        ),
        "",
        f"## {results['sweeps']['raster']}, low sun, one bounce",
        "",
        "Against 256 azimuths with every crossing; the last columns against 64 azimuths with every "
        "crossing, which leaves the error of the near radius alone.",
        *rows_of(
            "azimuths | near | mean error | p99 | CPU ns a cell and azimuth | near alone: mean | "
            "near alone: p99",
            [
                [
                    f"{e['directions']}",
                    f"{e['near']}",
                    percent(e["mean"]),
                    percent(e["p99"]),
                    f"{e['ns']:.0f}",
                    *(
                        percent(e["near_alone"][key]) if "near_alone" in e else ""
                        for key in ("mean", "p99")
                    ),
                ]
                for e in results["sweeps"]["entries"]
            ],
        ),
        "",
        "Bounces, 32 azimuths, against 20 of them:",
        *rows_of(
            "bounces | residual (bound) | max error over the largest | mean error | CPU s | "
            "receivers skipped | crossings tested | passed over",
            [
                [
                    f"{e['bounces']}" + (" (converged)" if e["asked"] == "converge" else ""),
                    f"{e['residual']:.1e}",
                    f"{e['most_of_largest']:.1e}",
                    percent(e["mean"]),
                    f"{e['cpu_seconds']:.2f}",
                    percent(e["receivers_skipped"]),
                    f"{e['crossings_tested']:.2e}",
                    f"{e['crossings_hidden']:.2e}",
                ]
                for e in results["sweeps"]["bounces"]
            ],
        ),
        "",
        "## Growth with size: fractal ground, one bounce, 8 azimuths",
        *rows_of(
            "cells | CPU ns a cell and azimuth | crossings tested",
            [
                [f"{e['size']}²", f"{e['ns']:.0f}", f"{e['crossings_tested']:.0f}"]
                for e in results["growth"]
            ],
        ),
    ]
    return "\n".join(lines + tool_tables(results["tools"])) + "\n"


def tool_tables(found: Entry) -> list[str]:
    """What the other tools say, and which are missing."""
    lines = ["", "## Other tools", ""]
    lines += [f"- {name} {version}" for name, version in found["versions"].items()]
    lines += [f"- {name}: left out, {reason}" for name, reason in found["left_out"].items()]
    lines += [
        "",
        f"{len(found['left_out'])} left out. The sky is {found['sky']}, an HDR photograph.",
    ]
    gathers = [(r, r["gather"]) for r in found["rasters"] if "gather" in r]
    if gathers:
        lines += [
            "",
            "One bounce from the same radiance of every cell. Embree casts rays at triangles; the "
            f"truth is {gathers[0][1]['rays']} of its rays from {gathers[0][1]['cells']} cells. "
            "The other diagonal: the same with the triangles of every four cells cut the other "
            "way, which is as good a surface. Adret knows neither diagonal.",
        ]
        rows = []
        for raster, gather in gathers:
            for e in gather["entries"]:
                own = e["tool"] == "adret"
                how = f"Adret, {e['directions']} azimuths" if own else f"Embree, {e['rays']} rays"
                rows.append([raster["name"], how, f"{e['us']:.1f}", *marks(e)])
            rows.append(
                [raster["name"], "the other diagonal", "", *marks(gather["other_diagonal"])]
            )
        lines += rows_of("raster | how | CPU µs a cell | mean error | p99 | bias", rows)
    traced = [(r, e) for r in found["rasters"] for e in r.get("paths", [])]
    if traced:
        lines += [
            "",
            f"All indirect light, against Mitsuba's path tracer on the triangles: "
            f"{traced[0][1]['paths']} paths from each of {traced[0][0]['cells']} cells; depth d is "
            "d - 1 bounces. Noise is half the mean difference of two seeds, which is that of their "
            "mean; beyond noise is the square root of the difference of squares.",
        ]
        rows = [
            [
                r["name"],
                f"{e['depth']}",
                f"{e['directions']}",
                percent(e["mean"]),
                percent(e["noise"]),
                percent(e["beyond_noise"]),
                percent(e["bias"]),
                f"{e['us']:.0f}",
                f"{e['mitsuba_us']:.0f}",
            ]
            for r, e in traced
        ]
        lines += rows_of(
            "raster | depth | azimuths | mean error | noise | beyond noise | bias | CPU µs a "
            "cell | Mitsuba's",
            rows,
        )
    return lines


def marks(e: Entry) -> list[str]:
    """Mean error, 99th percentile and bias."""
    return [percent(e[key]) for key in ("mean", "p99", "bias")]


def plot(results: Entry, path: Path) -> None:
    """Error against CPU time, what further bounces add, and the tools."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, (left, middle, right) = pyplot.subplots(1, 3, figsize=(18.0, 5.0), layout="constrained")
    entries = results["sweeps"]["entries"]
    for label, chosen, name, error in (
        (
            f"azimuths, near = {results['near']}",
            lambda e: e["near"] == results["near"],
            "directions",
            None,
        ),
        ("near radius, 64 azimuths", lambda e: "near_alone" in e, "near", "near_alone"),
    ):
        some = sorted(filter(chosen, entries), key=lambda e: e["ns"] * e["directions"])
        points = [
            (e["ns"] * e["directions"] / 1e3, (e[error] if error else e)["mean"]) for e in some
        ]
        drawn = [(e, p) for e, p in zip(some, points, strict=True) if p[1] > 0.0]
        left.loglog([p[0] for _, p in drawn], [p[1] for _, p in drawn], "o-", label=label)
        for e, point in drawn:
            left.annotate(str(e[name]), point, textcoords="offset points", xytext=(5, 5))
    left.set_xlabel("CPU time of one bounce [µs a cell]")
    left.set_ylabel("mean error / mean")
    left.set_title(results["sweeps"]["raster"])
    bounces = [e for e in results["sweeps"]["bounces"] if e["asked"] != "converge"]
    for label, style, key in (
        ("largest error", "o-", "most_of_largest"),
        ("residual (bound)", "s--", "residual"),
    ):
        middle.semilogy(
            [e["bounces"] for e in bounces], [e[key] for e in bounces], style, label=label
        )
    middle.set_xlabel("bounces")
    middle.set_ylabel("share of the largest indirect light")
    middle.set_title("what further bounces add, albedo 0.6")
    for colour, raster in zip(("C0", "C1", "C2"), results["tools"]["rasters"], strict=False):
        if "gather" not in raster:
            continue
        for tool, style in (("adret", "o-"), ("embreex", "s--")):
            some = [e for e in raster["gather"]["entries"] if e["tool"] == tool]
            label = f"{'Adret' if tool == 'adret' else 'Embree'}, {raster['name']}"
            right.loglog(
                [e["us"] for e in some], [e["mean"] for e in some], style, color=colour, label=label
            )
        right.axhline(raster["gather"]["other_diagonal"]["mean"], color=colour, linestyle=":")
    right.set_xlabel("CPU time of one bounce [µs a cell]")
    right.set_title("against cast rays; dotted: the triangles' other diagonal")
    for axis in (left, middle, right):
        axis.grid(True, which="both", alpha=0.25)
        if axis.get_legend_handles_labels()[0]:
            axis.legend(fontsize=8)
    figure.savefig(path, dpi=100)
    pyplot.close(figure)
