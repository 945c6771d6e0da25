"""Tables and plots of the ledger of screen-space occlusion."""

import math
from itertools import pairwise
from pathlib import Path
from typing import Any

Entry = dict[str, Any]
FIGURES = "e_A | <5 % | RMSE | max | bias | p99"
STRATA = ("interior", "depth edge", "frame edge")


def _figures(found: Entry) -> str:
    return (
        f"{found['e_A']:.4f} | {found['e_5']:.1%} | {found['rmse']:.4f} | {found['max']:.2f} | "
        f"{found['bias']:+.4f} | {found['p99']:.3f}"
    )


def _row(entry: Entry, key: str) -> str:
    found = entry[key]
    strata = " | ".join(f"{found[s]['e_A']:.4f}" if s in found else "–" for s in STRATA)
    return f"{_figures(found['all'])} | {strata}"


def crossing(rows: list[Entry], time: str, error: float) -> float | None:
    """Time at which a series of rows reaches an error, on straight lines between logarithms."""
    points = sorted((row[time], row["e_A"]) for row in rows)
    for (t0, e0), (t1, e1) in pairwise(points):
        if e0 > error >= e1:
            share = math.log(e0 / error) / math.log(e0 / e1)
            return math.exp(math.log(t0) + share * math.log(t1 / t0))
    return points[0][0] if points and points[0][1] <= error else None


def series_of(case: Entry, name: str) -> list[Entry]:
    """Rows of a series, each with its error by its own integral beside its time."""
    return [
        {**entry, **(entry.get("own") or entry["ideal"])["all"]}
        for entry in case["entries"]
        if entry.get("series") == name and "left_out" not in entry
    ]


def table(results: Entry, stem: str) -> str:
    """The results as Markdown."""
    about = results["about"]
    lines = [
        "# Screen-space ambient occlusion: error and time of every method",
        "",
        f"{about['processor']}, {about['threads']} threads, Python {about['python']}, Numba "
        f"{about['packages']['numba']}, commit {about['commit'][:12]}, {about['time'][:10]}, load "
        f"{about['load_before']:.1f} before the run. Times are CPU time of all threads for whole "
        "frames, compiled; errors are differences of occlusion (0 open, 1 closed) on random "
        "pixels.",
        "",
        "Each method is judged against the integral that it claims; *by rays* is ambient occlusion "
        "with the same falloff, where that is another quantity. Where the claim is no integral of "
        "rays, *own* is the method's own limit at many directions. e_A is the mean of |A - R|, "
        "<5 % the share of pixels that are off by less than 0.05; the last three columns are e_A "
        "in the interior, within 8 pixels of a depth edge, and within 32 of the frame's edge. "
        "G_inf: all behind the surface is solid; G_t: as far as a thickness. The surface is the "
        "bilinear one between pixel centres on both sides. Method, depth, camera and normals are "
        "the same on both sides; the guard band occludes and is not judged. RMSE is free of the "
        "reference's noise (the mean product of the differences to its two independent halves); "
        "the other figures contain it, so e_A is rather too large.",
    ]
    if "ledger" in results:
        lines += _summary(results["ledger"])
    if results.get("scaling", {}).get("equal_error"):
        lines += _equal_error(results["scaling"]["equal_error"])
    if results.get("scaling", {}).get("by_size"):
        lines += _speed(results["scaling"])
    if results.get("scaling", {}).get("by_radius"):
        lines += _radii(results["scaling"])
    for case in results.get("ledger", []):
        lines += _case(case)
    lines += ["", f"![Error against time]({stem}-error.png)", ""]
    lines += [f"![Time against radius and resolution]({stem}-scaling.png)", ""]
    lines += ["Depth buffers: " + "; ".join(_credits(results)) + ".", ""]
    return "\n".join(lines)


def _credits(results: Entry) -> list[str]:
    return [f"{case['name']}: {case['credit']}" for case in results.get("ledger", [])]


def _summary(cases: list[Entry]) -> list[str]:
    """Mean and worst e_A over the cases, for each setting."""
    lines = [
        "",
        "## Over all scenes",
        "",
        "| method | setting | claims | e_A mean | e_A worst | <5 % worst | by rays, e_A mean | "
        "ns a pixel |",
        "|---|---|---|---:|---:|---:|---:|---:|",
    ]
    seen: list[tuple[str, str]] = []
    for case in cases:
        for entry in case["entries"]:
            key = (entry["method"], entry["label"])
            if key not in seen and "left_out" not in entry:
                seen.append(key)
    for method, label in seen:
        rows = [
            entry
            for case in cases
            for entry in case["entries"]
            if (entry["method"], entry["label"]) == (method, label) and "left_out" not in entry
        ]
        own = [row["own"]["all"] for row in rows if "own" in row]
        ideal = [row["ideal"]["all"] for row in rows if "ideal" in row]
        mark = " (limit)" if rows[0].get("own_is_limit") else ""
        e_a = sum(o["e_A"] for o in own) / len(own)
        worst = max(o["e_A"] for o in own)
        share = min(o["e_5"] for o in own)
        rays = f"{sum(o['e_A'] for o in ideal) / len(ideal):.4f}" if ideal else "–"
        spent = sum(row["cpu_ns_a_pixel"] for row in rows) / len(rows)
        lines.append(
            f"| {method} | {label} | {rows[0]['claims']}{mark} | {e_a:.4f} | {worst:.4f} | "
            f"{share:.1%} | {rays} | {spent:.0f} |"
        )
    return lines


def _equal_error(cases: list[Entry]) -> list[str]:
    """Time to reach an error, by Embree and by slices."""
    lines = []
    for case in cases:
        for error in (0.03, 0.02, 0.01, 0.006):
            both = [
                crossing(
                    [r for r in case["exact"] if ("gathered" in r["label"]) == gathered],
                    "cpu_ns_a_pixel",
                    error,
                )
                for gathered in (False, True)
            ]
            exact = min((each for each in both if each is not None), default=None)
            rows = [{**row, "ns": row["cast_seconds_a_pixel"] * 1e9} for row in case["embree"]]
            rays = crossing(rows, "ns", error)
            if exact is None or rays is None:
                continue
            lines.append(
                f"| {case['name']} | {error:g} | {exact:.0f} | {rays:.0f} | {rays / exact:.1f} |"
            )
    if not lines:
        return []
    return [
        "",
        "## At equal error: slices and Embree",
        "",
        "CPU time a pixel, taken one after the other, by interpolation between settings (a setting "
        "that is better at once counts with its own time; of slices alone and gathered the faster "
        "one counts); Embree's is that of casting alone "
        "(no making of rays, no building of its tree), on the depth mesh.",
        "",
        "| scene | e_A | exact, ns | Embree, ns | ratio |",
        "|---|---:|---:|---:|---:|",
        *lines,
    ]


def _speed(scaling: Entry) -> list[str]:
    sizes = sorted({(e["width"], e["height"]) for e in scaling["by_size"]})
    lines = [
        "",
        "## Speed on whole frames (made scene), wall seconds with both threads; Mpix/s a core",
        "",
        "| setting | " + " | ".join(f"{w} x {h}" for w, h in sizes) + " | Mpix/s a core |",
        "|---|" + "---:|" * (len(sizes) + 1),
    ]
    labels = list(dict.fromkeys(e["label"] for e in scaling["by_size"]))
    for label in labels:
        rows = {(e["width"], e["height"]): e for e in scaling["by_size"] if e["label"] == label}
        if any("left_out" in e for e in rows.values()):
            continue
        cells = " | ".join(f"{rows[s]['wall_s']:.3f}" if s in rows else "–" for s in sizes)
        middle = rows.get((1920, 1080)) or next(iter(rows.values()))
        lines.append(f"| {label} | {cells} | {middle['mpix_a_core_second']:.2f} |")
    return lines + _usual_size(scaling["by_size"])


def _usual_size(entries: list[Entry]) -> list[str]:
    """Wall and processor time at 1920 x 1080."""
    rows = [e for e in entries if (e["width"], e["height"]) == (1920, 1080) and "wall_s" in e]
    if not rows:
        return []
    return [
        "",
        "At 1920 x 1080, no guard band, both threads:",
        "",
        "| setting | wall, s | processor, s | Mpix/s a core |",
        "|---|---:|---:|---:|",
        *(
            f"| {e['label']} | {e['wall_s']:.3f} | {e['cpu_s']:.3f} | "
            f"{e['mpix_a_core_second']:.2f} |"
            for e in rows
        ),
    ]


def _radii(scaling: Entry) -> list[str]:
    width, height = scaling["radius_size"]
    radii = list(dict.fromkeys(float(e["radius_pixels"]) for e in scaling["by_radius"]))
    lines = [
        "",
        f"## Time against radius at {width} x {height}, CPU seconds",
        "",
        "The radius is in pixels at the median depth.",
        "",
        "| setting | " + " | ".join("∞" if math.isinf(r) else f"{r:g}" for r in radii) + " |",
        "|---|" + "---:|" * len(radii),
    ]
    for label in dict.fromkeys(e["label"] for e in scaling["by_radius"]):
        rows = {
            float(e["radius_pixels"]): e
            for e in scaling["by_radius"]
            if e["label"] == label and "left_out" not in e
        }
        cells = " | ".join(f"{rows[r]['cpu_s']:.3f}" if r in rows else "–" for r in radii)
        lines.append(f"| {label} | {cells} |")
    return lines


def _case(case: Entry) -> list[str]:
    columns, rows = case["shape"][1], case["shape"][0]
    shares = ", ".join(f"{case['strata'][s]} {s}" for s in STRATA)
    band = f" of {case['rows']} rows in the middle" if case.get("rows") else ""
    lines = [
        "",
        f"## {case['name']}, {columns} x {rows}",
        "",
        f"{case['pixels']} pixels{band} ({shares}); R {case['radius']:g}, thickness "
        f"{case['thickness']:g}, r {case['timonen']:g}; mean occlusion "
        f"{case['mean_occlusion']:.3f}, confidence {case['confidence']:.3f}. Reference "
        f"{case['rays']} rays; its own noise "
        f"{case['noise_mean']:.5f} (mean), {case['noise']:.5f} (standard error).",
        "",
        f"| method | setting | ns a pixel | {FIGURES} | interior | depth edge | frame edge |",
        "|---|---|---:|" + "---:|" * 9,
    ]
    left_out = []
    for entry in case["entries"]:
        if "left_out" in entry:
            left_out.append(f"{entry['method']} {entry['label']} ({entry['left_out']})")
            continue
        head = f"| {entry['method']} | {entry['label']}"
        spent = f"{entry['cpu_ns_a_pixel']:.0f}"
        mark = ", own limit" if entry.get("own_is_limit") else ""
        if "own" in entry:
            lines.append(f"{head}{mark} | {spent} | {_row(entry, 'own')} |")
        if "ideal" in entry:
            lines.append(f"{head}, *by rays* | {spent} | {_row(entry, 'ideal')} |")
    for row in case.get("embree", []):
        lines.append(
            f"| Embree | {row['rays']} rays | {row['cast_seconds_a_pixel'] * 1e9:.0f} | "
            f"{_figures(row)} | – | – | – |"
        )
    if left_out:
        lines += ["", "Left out: " + "; ".join(left_out) + "."]
    return lines


def plots(results: Entry, path: Path) -> None:
    """Error against time for each scene; time against radius and resolution."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    if results.get("ledger"):
        _plot_errors(pyplot, results["ledger"], path.with_name(path.name + "-error.png"))
    if results.get("scaling"):
        _plot_scaling(pyplot, results["scaling"], path.with_name(path.name + "-scaling.png"))


def _plot_errors(pyplot: Any, cases: list[Entry], path: Path) -> None:
    across = min(4, len(cases))
    down = -(-len(cases) // across)
    figure, axes = pyplot.subplots(
        down, across, figsize=(5.2 * across, 4.4 * down), squeeze=False, layout="constrained"
    )
    for axis in axes.flat[len(cases) :]:
        axis.set_visible(False)
    for axis, case in zip(axes.flat, cases, strict=False):
        for name, style in (
            ("exact", "o-"),
            ("exact, gathered", "D-"),
            ("ffao", "s-"),
            ("lsao", "^-"),
            ("hbao", "v-"),
            ("vao", "P-"),
            ("raytraced", "x--"),
        ):
            rows = sorted(series_of(case, name), key=lambda row: row["cpu_ns_a_pixel"])
            if rows:
                axis.loglog(
                    [row["cpu_ns_a_pixel"] for row in rows],
                    [row["e_A"] for row in rows],
                    style,
                    label=name + (" (own limit)" if rows[0].get("own_is_limit") else ""),
                )
        if case.get("embree"):
            axis.loglog(
                [row["cast_seconds_a_pixel"] * 1e9 for row in case["embree"]],
                [row["e_A"] for row in case["embree"]],
                "k.--",
                label="Embree, casting only",
            )
        axis.axhline(case["noise_mean"], color="grey", linewidth=0.8, linestyle=":")
        axis.set_title(case["name"])
        axis.set_xlabel("CPU time [ns a pixel]")
        axis.set_ylabel("e_A against the own integral")
        axis.grid(True, which="both", alpha=0.25)
        axis.legend(fontsize=7)
    figure.savefig(path, dpi=110)
    pyplot.close(figure)


def _plot_scaling(pyplot: Any, scaling: Entry, path: Path) -> None:
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(12.0, 4.8), layout="constrained")
    entries = [e for e in scaling.get("by_radius", []) if "left_out" not in e]
    for label in dict.fromkeys(e["label"] for e in entries):
        rows = [e for e in entries if e["label"] == label]
        finite = [e for e in rows if math.isfinite(float(e["radius_pixels"]))]
        line = left.loglog(
            [float(e["radius_pixels"]) for e in finite],
            [e["cpu_s"] for e in finite],
            "o-",
            label=label,
        )[0]
        for e in rows:
            if not math.isfinite(float(e["radius_pixels"])):
                left.loglog([3000.0], [e["cpu_s"]], "D", color=line.get_color())
    width, height = scaling["radius_size"]
    left.set_xlabel("radius [pixels at the median depth]; diamonds: unlimited")
    left.set_ylabel(f"CPU time at {width} x {height} [s]")
    entries = [e for e in scaling.get("by_size", []) if "left_out" not in e]
    for label in dict.fromkeys(e["label"] for e in entries):
        rows = [e for e in entries if e["label"] == label]
        right.loglog(
            [e["width"] * e["height"] / 1e6 for e in rows],
            [e["cpu_s"] for e in rows],
            "o-",
            label=label,
        )
    right.set_xlabel("size of the frame [million pixels]")
    right.set_ylabel("CPU time [s]")
    for axis in (left, right):
        axis.grid(True, which="both", alpha=0.25)
        if axis.get_legend_handles_labels()[0]:
            axis.legend(fontsize=7)
    figure.savefig(path, dpi=110)
    pyplot.close(figure)
