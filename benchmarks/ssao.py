"""Screen-space ambient occlusion: the error of every method against rays, and its time.

``python benchmarks/ssao.py`` runs the quick form, a few minutes once kernels are compiled:
made scenes at a small size. ``--full`` runs the ledger: real depth buffers of $ADRET_DATA or
../shared/data and made ones, references of thousands of rays on 10 000 pixels each (minutes apiece;
kept in benchmarks/references), growth of time with radius and resolution, Embree on the same depth
meshes. ``--ledger`` and ``--timing`` do one half, or a part: ``--ledger --cases sponza_atrium``,
``--timing radii``; a scene that is done is kept.
Writes results/ssao.json, a table in results/ssao.md and plots (ssao-quick.* for the quick form).

Times are CPU time of all threads, the least of several repeats, after a warm-up that compiles.
"""

import argparse
import json
import os
import time
import warnings
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

THREADS = str(min(2, os.cpu_count() or 1))
os.environ.setdefault("NUMBA_NUM_THREADS", THREADS)

import numpy as np  # noqa: E402
import present  # noqa: E402
import ssao_present  # noqa: E402
from numpy.typing import NDArray  # noqa: E402
from ssao_references import References, embree, figures  # noqa: E402
from ssao_runs import Run, runs_of, scaling_runs, speed_runs  # noqa: E402
from ssao_scenes import CREDITS, REAL, STRATA, Case, made, made_case, real_case  # noqa: E402

from adret import DepthBuffer, InputError, ambient_occlusion  # noqa: E402
from adret.screen import DepthPrecisionWarning  # noqa: E402
from adret.screen.raytraced import RaySample  # noqa: E402

RESULTS = Path(__file__).resolve().parent / "results"
TIMES = ("sizes", "radii", "rays")
MADE = {"made blocks": "perspective", "made relief": "orthographic"}
RAYS = 8192
QUICK_RAYS = 2048
PIXELS = 10_000
EMBREE_RAYS = (4, 9, 16, 36, 64, 144, 256, 576)
RADII_PIXELS = (8.0, 16.0, 32.0, 64.0, 128.0, 256.0, 512.0, 1024.0, float("inf"))
SLICES = 32
"""Directions up to which slices are timed against Embree."""
REPEATED = 2.0
"""Runs shorter than this are timed three times [s]."""
QUICK_SIZE = (640, 360)
SIZES = ((1280, 720), (1920, 1080), (2560, 1440), (3840, 2160))

Entry = dict[str, Any]


def timed(case: Any, method: str, options: Entry, repeats: int = 1) -> tuple[Any, Entry]:
    """A method's result on a whole frame, with the least CPU and wall time [s] of some runs."""
    cpu, wall = [], []
    for _ in range(repeats):
        start = time.process_time(), time.perf_counter()
        result = ambient_occlusion(case, method=method, **options)
        cpu.append(time.process_time() - start[0])
        wall.append(time.perf_counter() - start[1])
    pixels = result.report.receivers
    return result, {
        "cpu_s": min(cpu),
        "wall_s": min(wall),
        "cpu_ns_a_pixel": min(cpu) / pixels * 1e9,
        "mpix_a_core_second": pixels / min(cpu) / 1e6,
    }


@cache
def small(perspective: bool) -> DepthBuffer:
    """A small buffer of a projection, for runs that compile."""
    return made("perspective" if perspective else "orthographic", 96, 64, count=4)


def warm(case: Case, run: Run) -> None:
    """Compile what a run needs, for arrays of the same kind."""
    buffer = small(case.buffer.camera.perspective_divide)
    like = Case("small", buffer, 1, rows=None if case.rows is None else 32).shown
    ambient_occlusion(like, method=run.method, **run.options)


def split(
    case: Case,
    found: NDArray[np.float64],
    truth: RaySample | NDArray[np.float64],
    judged: NDArray[np.bool_] | None = None,
) -> Entry:
    """Error figures of the sampled pixels, all and in each stratum; or of those that are judged."""
    stratum = case.strata[case.sample][case.part]
    chosen = np.ones(found.shape, dtype=bool) if judged is None else judged
    parts = {"all": chosen}
    for k, name in enumerate(STRATA):
        if (chosen & (stratum == k)).any():
            parts[name] = chosen & (stratum == k)
    if not isinstance(truth, RaySample):
        return {name: figures((found - truth)[part]) for name, part in parts.items()}
    off, halves = found - truth.occlusion, found - truth.halves
    return {name: figures(off[part], halves[:, part]) for name, part in parts.items()}


def ledger_row(case: Case, run: Run, references: References, limits: dict[str, Any]) -> Entry:
    """One setting of one method: its time, and its error by its own integral and by rays."""
    entry: Entry = {
        "method": run.method,
        "label": run.label,
        "claims": run.claims,
        "series": run.series,
        "samples": run.samples,
    }
    try:
        warm(case, run)
        result, spent = timed(case.shown, run.method, run.options)
    except InputError as error:  # an option that this version's method does not have
        return {**entry, "left_out": str(error)}
    entry |= spent
    found = case.at_judged(result.occlusion)
    if run.truth is not None:
        truth = run.truth(references)
        judged = truth.confidence > 0.999 if run.volume else None
        entry["own"] = split(case, found, truth, judged)
        entry["reference_noise"] = truth.noise
        entry["reference_noise_mean"] = float(np.abs(truth.halves[0] - truth.halves[1]).mean() / 2)
    elif run.limit is not None:
        key = repr((run.method, sorted(run.limit.items())))
        if key not in limits:
            limits[key] = case.at_judged(timed(case.shown, run.method, run.limit)[0].occlusion)
        entry["own"] = split(case, found, limits[key])
        entry["own_is_limit"] = True
        entry["limit_options"] = run.limit
    if run.ideal is not None:
        entry["ideal"] = split(case, found, run.ideal(references))
    return entry


def show(entry: Entry) -> None:
    """One line to the terminal."""
    name = f"  {entry['method']:10s} {entry['label']:32s}"
    if "left_out" in entry:
        print(name, "left out:", entry["left_out"][:60], flush=True)
        return
    own = entry.get("own", entry.get("ideal"))["all"]
    print(
        name,
        f"{entry['cpu_ns_a_pixel']:9.0f} ns/px  e_A {own['e_A']:.4f}  <5% {own['e_5']:.2%}  "
        f"bias {own['bias']:+.4f}",
        flush=True,
    )


def ledger(
    cases: list[Case], rays: int, quick: bool, only: tuple[str, ...] = ()
) -> Iterator[Entry]:
    """All methods, or only those whose names or labels are given, on all cases, case by case."""
    for case in cases:
        references = References(case, rays)
        print(f"{case.name}: {case.part.sum()} pixels, radius {case.radius:g}", flush=True)
        _ = case.shown.field  # normals are rebuilt once, not in the first method's time
        entries: list[Entry] = []
        limits: dict[str, Any] = {}
        for run in runs_of(case, quick):
            if only and not {run.method, run.label} & {*only}:
                continue
            entries.append(ledger_row(case, run, references, limits))
            show(entries[-1])
        truth = references.get("cosine")
        stratum = case.strata[case.sample][case.part]
        entry: Entry = {
            "name": case.name,
            "credit": CREDITS.get(case.name, "made for this benchmark"),
            "shape": case.buffer.shape,
            "frame": case.buffer.frame,
            "pixels": len(stratum),
            "rows": case.rows,
            "strata": {name: int((stratum == k).sum()) for k, name in enumerate(STRATA)},
            "radius": case.radius,
            "thickness": case.thickness,
            "timonen": case.timonen,
            "rays": truth.rays,
            "noise": truth.noise,
            "noise_mean": float(np.abs(truth.halves[0] - truth.halves[1]).mean() / 2),
            "mean_occlusion": float(truth.occlusion.mean()),
            "confidence": float(truth.confidence.mean()),
            "entries": entries,
        }
        if not only and not case.buffer.sky.any() and not case.buffer.holes.any():
            entry["embree"] = embree_rows(case, references, quick)
        yield entry


def joined(old: Entry | None, new: Entry, parts: bool) -> Entry:
    """A case as it was measured now; where only parts were, they take the place of their rows."""
    about = present.about()
    if old is None or not parts:
        return {**new, "about": about}
    rows = {(row["method"], row["label"]): {**row, "about": about} for row in new["entries"]}
    entries = [rows.pop((row["method"], row["label"]), row) for row in old["entries"]]
    for row in rows.values():  # settings that are new stand below the last of their method
        same = [k for k, each in enumerate(entries) if each["method"] == row["method"]]
        entries.insert(same[-1] + 1 if same else len(entries), row)
    return {**old, "entries": entries}


def case_of(name: str) -> Case | None:
    """A case of the ledger by its name; None where its data are not here."""
    if name in MADE:
        return made_case(MADE[name], 1280, 720, 128, PIXELS)
    return real_case(name, PIXELS)


def embree_rows(case: Case, references: References, quick: bool) -> list[Entry]:
    """Time and error of plain rays by Embree on the same mesh."""
    try:
        found = embree(case, EMBREE_RAYS[: 4 if quick else None])
    except ImportError as error:
        print(f"  Embree left out: {error}", flush=True)
        return []
    truth = references.get("cosine")
    for row in found:
        occlusion = row.pop("occlusion")
        row |= figures(occlusion - truth.occlusion, occlusion - truth.halves)
        print(
            f"  embree     {row['rays']:4d} rays {row['ns_a_ray']:18.0f} ns/ray "
            f"{row['cast_seconds_a_pixel'] * 1e9:9.0f} ns/px  e_A {row['e_A']:.4f}",
            flush=True,
        )
    return found


def equal_error_times(entries: list[Entry]) -> list[Entry]:
    """Times of slices and of Embree's rays one after the other, for the errors of the ledger.

    The ledger's scenes may have been done beside other work; a ratio of times should not be.
    """
    found = []
    for entry in entries:
        case = case_of(entry["name"])
        if case is None or not entry.get("embree"):
            continue
        errors = {e["label"]: e["own"]["all"]["e_A"] for e in entry["entries"] if "own" in e}
        rows = []
        for run in runs_of(case, quick=False):
            chosen = run.series.startswith("exact") and run.label in errors
            if not chosen or run.samples > SLICES:
                continue
            warm(case, run)
            spent = timed(case.buffer, run.method, run.options)[1]
            rows.append({"label": run.label, "e_A": errors[run.label], **spent})
            print("  ", entry["name"], rows[-1], flush=True)
        rays = embree_rows(case, References(case, entry["rays"]), quick=False)
        found.append({"name": entry["name"], "exact": rows, "embree": rays})
    return found


def pixel_of(buffer: DepthBuffer) -> float:
    """Width of a pixel at the median depth [view units]."""
    return float(buffer.camera.rays[0] * np.nanmedian(buffer.depth))


def times_by_size(sizes: tuple[tuple[int, int], ...]) -> list[Entry]:
    """Time against resolution, the radius being the same share of the image."""
    found = []
    for width, height in sizes:
        buffer = made("perspective", width, height)
        radius = 80.0 * pixel_of(buffer) * height / 1080.0
        for label, method, options in speed_runs(radius, slow=height <= 1080):
            found.append(measured(buffer, label, method, options, width=width, height=height))
    return found


def times_by_radius(size: tuple[int, int], radii: tuple[float, ...]) -> list[Entry]:
    """Time against radius at one size."""
    buffer = made("perspective", *size)
    pixel = pixel_of(buffer)
    return [
        measured(buffer, label, method, options, radius_pixels=radius)
        for radius in radii
        for label, method, options in scaling_runs(radius * pixel)
    ]


def measured(buffer: Any, label: str, method: str, options: Entry, **where: Any) -> Entry:
    """One timing, after a run on a small buffer that compiles; the quick ones are repeated."""
    entry: Entry = {"label": label, "method": method, **where}
    try:
        ambient_occlusion(small(True), method=method, **options)
        entry |= timed(buffer, method, options)[1]
        if entry["wall_s"] < REPEATED:
            again = timed(buffer, method, options, repeats=2)[1]
            entry = min(entry, {**entry, **again}, key=lambda each: each["cpu_s"])
    except InputError as error:
        entry["left_out"] = str(error)
    print("  ", entry, flush=True)
    return entry


def main() -> None:
    """Measure, write and plot."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--full", action="store_true", help="the whole ledger")
    parser.add_argument("--ledger", action="store_true", help="of it, errors only")
    parser.add_argument(
        "--timing",
        nargs="*",
        choices=TIMES,
        help="of it, times only: against resolution, against radius, slices and Embree",
    )
    parser.add_argument("--present", action="store_true", help="write tables and plots anew")
    parser.add_argument("--cases", nargs="*", help="names of depth buffers, for --ledger")
    parser.add_argument(
        "--only", nargs="*", default=[], help="methods or labels measured anew, for --ledger"
    )
    parser.add_argument(
        "--rows", type=int, help="for --ledger: judge so many rows in the frame's middle"
    )
    asked = parser.parse_args()
    if asked.timing == []:
        asked.timing = list(TIMES)
    quick = not (asked.full or asked.ledger or asked.timing or asked.present)
    warnings.simplefilter("ignore", DepthPrecisionWarning)
    path = RESULTS / ("ssao-quick.json" if quick else "ssao.json")
    if quick:
        run_quick(path)
    if asked.full or asked.ledger:
        cases = [c for name in (*REAL, *MADE) if (c := case_of(name)) is not None]
        wanted = [
            replace(c, rows=asked.rows) for c in cases if not asked.cases or c.name in asked.cases
        ]
        for each in ledger(wanted, RAYS, quick=False, only=tuple(asked.only)):
            results = kept(path)
            known = {old["name"]: old for old in results.get("ledger", [])}
            known[each["name"]] = joined(known.get(each["name"]), each, bool(asked.only))
            results["ledger"] = [known[case.name] for case in cases if case.name in known]
            save(results, path)
    for part in TIMES if asked.full else asked.timing or ():
        found = times(part, kept(path).get("ledger", []))
        results = kept(path)
        results["scaling"] = {**results.get("scaling", {}), "radius_size": SIZES[1], **found}
        save(results, path)
    results = kept(path)
    path.with_suffix(".md").write_text(ssao_present.table(results, path.stem))
    ssao_present.plots(results, path.with_suffix(""))


def run_quick(path: Path) -> None:
    """Made scenes at a small size, one resolution, three radii."""
    cases = [
        made_case("perspective", 480, 270, 48, 2000),
        made_case("orthographic", 480, 270, 48, 2000),
    ]
    times = {
        "radius_size": QUICK_SIZE,
        "by_size": times_by_size((QUICK_SIZE,)),
        "by_radius": times_by_radius(QUICK_SIZE, RADII_PIXELS[::3]),
    }
    save({"ledger": list(ledger(cases, QUICK_RAYS, quick=True)), "scaling": times}, path)


def times(part: str, entries: list[Entry]) -> Entry:
    """One part of the times, with what it ran on."""
    found: dict[str, Any] = {f"{part}_about": present.about()}
    if part == "sizes":
        found["by_size"] = times_by_size(SIZES)
    elif part == "radii":
        found["by_radius"] = times_by_radius(SIZES[1], RADII_PIXELS)
    else:
        found["equal_error"] = equal_error_times(entries)
    return found


def kept(path: Path) -> Entry:
    """What other runs have written: a run that is cut short or is beside another loses nothing."""
    return json.loads(path.read_text()) if path.is_file() else {}  # type: ignore[no-any-return]


def save(results: Entry, path: Path) -> None:
    """Write the numbers, and what the last of them were taken on."""
    RESULTS.mkdir(exist_ok=True)
    results = {**results, "about": present.about()}
    path.write_text(json.dumps(results, indent=1, default=_plain) + "\n")


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.generic | np.ndarray) else str(value)


if __name__ == "__main__":
    main()
