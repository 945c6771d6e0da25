"""What a benchmark ran on, its table and its plot."""

import importlib.metadata
import os
import platform
import subprocess
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

REPOSITORY = Path(__file__).resolve().parents[1]
PACKAGES = ("adret", "numpy", "numba", "llvmlite", "tbb", "rasterio")
PEER_NAMES = {
    "whitebox": "WhiteboxTools horizon_angle",
    "rvt-10": "RVT, radius 10 cells",
    "rvt-100": "RVT, radius 100 cells",
    "grass": "GRASS r.horizon",
    "saga": "SAGA sky view factor",
}


def about() -> dict[str, Any]:
    """Machine, versions, commit and time of a run."""

    def git(*words: str) -> str:
        done = subprocess.run(
            ["git", *words], cwd=REPOSITORY, capture_output=True, text=True, check=False
        )
        return done.stdout.strip()

    model = platform.processor()
    information = Path("/proc/cpuinfo")
    if information.is_file():
        for line in information.read_text().splitlines():
            if line.startswith("model name"):
                model = line.split(":", 1)[1].strip()
                break
    return {
        "time": datetime.now(UTC).isoformat(timespec="seconds"),
        "commit": git("rev-parse", "HEAD"),
        "uncommitted_changes": bool(git("status", "--porcelain", "--", "core", "benchmarks")),
        "processor": model,
        "cores": os.cpu_count(),
        "threads": int(os.environ.get("NUMBA_NUM_THREADS", "0")),
        "load_before": os.getloadavg()[0],
        "system": platform.platform(),
        "python": platform.python_version(),
        "packages": {name: importlib.metadata.version(name) for name in PACKAGES},
    }


def table(results: dict[str, Any]) -> str:
    """The results as Markdown."""
    machine = results["about"]
    lines = [
        "# Horizon maps: run time against error",
        "",
        f"{machine['processor']}, {machine['threads']} threads, Python {machine['python']}, "
        f"Numba {machine['packages']['numba']}, commit {machine['commit'][:12]}, "
        f"{machine['time'][:10]}. CPU time is that of all threads together, a cell and azimuth; "
        "errors are against the exact method on random cells, in degrees.",
    ]
    for raster in results["rasters"]:
        rows, columns = raster["shape"]
        lines += [
            "",
            f"## {raster['name']}, {columns} x {rows}",
            "",
            f"{raster['cells_compared']} cells. RVT is compared 100 cells or more off the edge.",
            "",
            "| method | CPU ns | mean error | p99 | max | bias | CPU against the default |",
            "|---|---:|---:|---:|---:|---:|---:|",
        ]
        default = next(
            e for e in raster["entries"] if e["name"] == f"sweep near={results['default_near']}"
        )
        for entry in raster["entries"]:
            name = PEER_NAMES.get(entry["name"], entry["name"])
            if entry is default:
                name = f"**{name} (default)**"
            if "left_out" in entry:
                lines.append(f"| {name} | {entry['left_out']} | | | | | |")
                continue
            if "version" in entry:
                name += f" {entry['version']}"
            figures = [
                f"{entry[key]:.4f}" if key in entry else "-"
                for key in ("mean_deg", "p99_deg", "max_deg", "bias_deg")
            ]
            ratio = entry["cpu_ns"] / default["cpu_ns"]
            lines.append(
                f"| {name} | {entry['cpu_ns']:.1f} | {' | '.join(figures)} | {ratio:.2f} |"
            )
    if results.get("growth"):
        first = results["growth"][0]["cpu_ns"]
        lines += ["", "## Growth with size", "", "| cells | CPU ns | ratio |", "|---|---:|---:|"]
        lines += [
            f"| {e['name']} | {e['cpu_ns']:.1f} | {e['cpu_ns'] / first:.2f} |"
            for e in results["growth"]
        ]
    return "\n".join(lines) + "\n"


def plot(results: dict[str, Any], path: Path) -> None:
    """Mean error against CPU time, both logarithmic."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    rasters = results["rasters"]
    figure, axes = pyplot.subplots(
        1, len(rasters), figsize=(7.0 * len(rasters), 5.6), squeeze=False, layout="constrained"
    )
    for axis, raster in zip(axes[0], rasters, strict=True):
        entries = [e for e in raster["entries"] if e.get("mean_deg", 0.0) > 0.0]
        sweep = [e for e in entries if e.get("method") == "sweep"]
        axis.loglog(
            [e["cpu_ns"] for e in sweep],
            [e["mean_deg"] for e in sweep],
            "o-",
            label="sweep, near = " + ", ".join(str(e["near"]) for e in sweep),
        )
        for entry in sweep:
            axis.annotate(
                str(entry["near"]),
                (entry["cpu_ns"], entry["mean_deg"]),
                textcoords="offset points",
                xytext=(5, 5),
                fontsize=8,
            )
        for marker, entry in zip(
            "sD^v<>Ph", (e for e in entries if e.get("method") != "sweep"), strict=False
        ):
            name = PEER_NAMES.get(entry["name"], entry["name"])
            axis.loglog([entry["cpu_ns"]], [entry["mean_deg"]], marker, label=name)
        axis.set_xlabel("CPU time [ns a cell and azimuth]")
        axis.set_ylabel("mean error of the horizon [degrees]")
        axis.set_title(raster["name"])
        axis.grid(True, which="both", alpha=0.25)
        axis.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncol=3)
    figure.savefig(path, dpi=120)
    pyplot.close(figure)
