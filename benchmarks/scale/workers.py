"""More workers: the same tiles by 1, 2 and 4 processes of each executor.

    python benchmarks/scale/workers.py                  all of them
    python benchmarks/scale/workers.py dask --quiet     one, on a machine with nothing else to do

Executors: local, dask, queue-sqlite, queue-postgresql (needs PostgreSQL's programs). Each worker
has one thread. Tiles of a first batch compile and warm up; then a second batch is timed. Two
figures are kept: how many times faster N workers are than one, which cannot exceed the machine's
cores, and how much of the workers' time goes into tiles, which is what the executor is
answerable for. Writes results/workers.json, .md and .png.
"""

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import moon
from tiles import RANGE, RESULTS, machine, parameters, say

from adret.tiling import Job, Surface, prepare, run_batch
from adret.tiling.executors import open_executor

SIZE, TILE, DIRECTIONS = 2048, 256, 16
EXECUTORS = ("local", "dask", "queue-sqlite", "queue-postgresql")
WORKERS = (1, 2, 4)
REPOSITORY = Path(__file__).resolve().parents[2]


@contextmanager
def scheduler_of(name: str, folder: Path) -> Iterator[str | None]:
    """Address of the database that an executor needs."""
    if name == "queue-sqlite":
        yield f"sqlite:///{folder}/queue.db"
    elif name == "queue-postgresql":
        sys.path.insert(0, str(REPOSITORY / "tests" / "service"))
        from postgres import Postgres

        server = Postgres()
        try:
            yield server.url("tiles")
        finally:
            server.remove()
    else:
        yield None


def measure(name: str, workers: int, surface: Surface, folder: Path) -> dict[str, Any]:
    """One timed batch after one to warm up."""
    executor = name.partition("-")[0]
    chosen = {"sky-view": parameters(DIRECTIONS, RANGE)["sky-view"]}
    with (
        tempfile.TemporaryDirectory(dir=folder) as place,
        scheduler_of(name, Path(place)) as scheduler,
        closing(
            open_executor(executor, workers=workers, threads=1, scheduler=scheduler)
        ) as running,
    ):
        for phase in ("warm", "timed"):
            say(f"{name}, {workers} workers: {phase}")
            job = Job(surface, chosen, TILE)
            out = Path(place) / phase
            prepare(job, out)
            ends: list[float] = []
            start = time.perf_counter()
            (report,) = run_batch(
                job, out, running, lambda *_, ends=ends: ends.append(time.perf_counter())
            ).products
            if report.errors:
                raise RuntimeError(report.errors[0])
    wall = ends[-1] - start  # without putting the file together, which one process does
    return {
        "workers": workers,
        "tiles": report.tiles,
        "wall_s": wall,
        "tile_s": report.tile_seconds,
        "busy": report.tile_seconds / (workers * wall),
    }


def report(known: dict[str, Any]) -> None:
    """Write table and plot."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    lines = [
        "# Workers",
        "",
        f"Sky view, {DIRECTIONS} azimuths, range {RANGE / 1000:g} km, of a lunar raster of "
        f"{SIZE}² in {(SIZE // TILE) ** 2} tiles of {TILE}², one thread a worker, on "
        f"{known['machine']['cores']} virtual cores that are two threads of one. Busy: "
        "share of the workers' time that goes into tiles. Where the machine was shared with other "
        "work, times say little about how much faster more workers are.",
        "",
        "| executor | workers | wall, s | times faster than 1 | efficiency up to 2 cores | busy "
        "| machine |",
        "|---|---:|---:|---:|---:|---:|---|",
    ]
    figure, axis = pyplot.subplots(figsize=(6.0, 3.6), layout="constrained")
    for name in (each for each in EXECUTORS if each in known):
        entries = known[name]
        one = entries[0]["wall_s"]
        for entry in entries:
            faster = one / entry["wall_s"]
            lines.append(
                f"| {name} | {entry['workers']} | {entry['wall_s']:.1f} | {faster:.2f} "
                f"| {faster / min(entry['workers'], known['machine']['cores']):.2f} "
                f"| {100 * entry['busy']:.0f} % | {'quiet' if entry['quiet'] else 'shared'} |"
            )
        axis.plot(
            [entry["workers"] for entry in entries],
            [one / entry["wall_s"] for entry in entries],
            "o-",
            label=name,
        )
    axis.set_xlabel("workers")
    axis.set_ylabel("times faster than one")
    axis.set_xticks(WORKERS)
    axis.set_ylim(bottom=0.0)
    axis.legend()
    figure.savefig(RESULTS / "workers.png", dpi=120)
    (RESULTS / "workers.md").write_text("\n".join(lines) + "\n")
    print("\n".join(lines))


def main() -> None:
    """Measure what is asked for, and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("executors", nargs="*", default=EXECUTORS)
    parser.add_argument("--quiet", action="store_true", help="nothing else runs meanwhile")
    given = parser.parse_args()
    path = RESULTS / "workers.json"
    known = json.loads(path.read_text()) if path.exists() else {}
    with tempfile.TemporaryDirectory(dir=os.environ.get("ADRET_SCRATCH")) as place:
        folder = Path(place)
        folder.chmod(0o755)
        moon.write(folder / "moon.tif", SIZE, [(0, SIZE)])
        surface = Surface.open([folder / "moon.tif"])
        for name in given.executors:
            known[name] = [
                measure(name, count, surface, folder) | {"quiet": given.quiet} for count in WORKERS
            ]
            known["machine"] = machine()
            path.write_text(json.dumps(known, indent=1) + "\n")
    report(known)


if __name__ == "__main__":
    main()
