"""`adret batch`."""

import contextlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from adret.cli.running import progress_bar
from adret.cli.tiling import Request, expand, job_command, job_of
from adret.errors import AdretError, InputError

if TYPE_CHECKING:
    from adret.tiling import BatchReport, Job

__all__ = ["register"]

HELP = """Products of rasters of any size, tile by tile: OUT/<product>.tif for each.

The files are those that the products' own commands write. Many files that lie side by side on one
grid are one surface, without seams at their borders; --each makes them surfaces of their own.

Examples:

\b
  adret batch dem.tif out --product sky,horizon --directions 32 --max-distance 20000
  adret batch dem.tif out --product sky,horizon --directions 32 --max-distance 20000 --resume
  adret batch 'tiles/*.tif' out --product sky --workers 4 --memory 1G
  adret batch 'valleys/*.tif' out --each --product shadow --sun 135,20
  adret batch dem.tif out --executor dask --scheduler tcp://node1:8786
  adret batch items.json out --product sky --format zarr

Exit code 1 if a tile or a file failed; what is done is kept for --resume.
"""


def batch(
    places: tuple[str, ...],
    request: Request,
    *,
    executor: str,
    scheduler: str | None,
    each: bool,
    resume: bool,
    overwrite: bool,
    format: str,
) -> int:
    """Run a batch and print what became of it."""
    if len(places) < 2:
        raise InputError("OUT", "given after the rasters", places[-1])
    if resume and overwrite:
        raise InputError("resume", "without overwrite", "both")
    from adret.tiling import run_batch
    from adret.tiling.executors import open_executor
    from adret.tiling.plans import default_threads
    from adret.tiling.stores import file_of

    file_of("", format)  # known, and installed
    sources, out = expand(places[:-1]), Path(places[-1])
    groups = {out: sources}
    if each:
        groups = {out / Path(source).stem: [source] for source in sources}
        if len(groups) < len(sources):
            raise InputError("each", "for files of different names", f"{len(sources)} files")
        if not out.parent.is_dir():
            raise InputError("OUT", "in a folder that exists", str(out))
        out.mkdir(exist_ok=True)
    results: dict[Path, BatchReport | str] = {}
    threads = default_threads(request.workers)
    with contextlib.closing(
        open_executor(executor, workers=request.workers, threads=threads, scheduler=scheduler)
    ) as running:
        for folder, files in groups.items():
            try:
                job = _ready(request, files, folder, resume, overwrite, format)
                with _progress(folder.name) as progress:
                    results[folder] = run_batch(job, folder, running, progress, form=format)
            except (AdretError, OSError) as error:
                if not each:
                    raise
                results[folder] = " ".join(str(error).split())
    return _summary(out, results)


def _ready(
    request: Request, files: list[str], folder: Path, resume: bool, overwrite: bool, form: str
) -> "Job":
    """A job that fits the memory, in its folder."""
    from adret.tiling import plan
    from adret.tiling.batches import check_folder, prepare
    from adret.tiling.jobs import known_datum
    from adret.tiling.plans import check_memory, default_threads

    check_folder(folder)
    with progress_bar("heights") as progress:
        job = job_of(request, files, progress, known_datum(folder) if resume else None)
    found = plan(job, request.workers, default_threads(request.workers))
    check_memory(found, job, request.memory, folder)
    prepare(job, folder, resume=resume, overwrite=overwrite, form=form)
    return job


@contextlib.contextmanager
def _progress(name: str) -> Iterator[Callable[[str, int, int], None] | None]:
    """A progress bar that names the product."""
    with progress_bar(name) as bar:
        yield None if bar is None else lambda product, done, total: bar(done, total)


def _summary(out: Path, results: "dict[Path, BatchReport | str]") -> int:
    """Print a line a result, errors last; return the exit code."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title=str(out), title_justify="left")
    for name in ("file", "tiles", "resumed", "failed", "s", "Mcells az/s", "peak MiB"):
        table.add_column(name, justify="left" if name == "file" else "right", no_wrap=True)
    errors = []
    for folder, found in results.items():
        if isinstance(found, str):
            table.add_row(str(folder.relative_to(out)), "", "", "all", "", "", "")
            errors.append(f"{folder}: {found}")
            continue
        for each in found.products:
            rate = f"{each.samples / each.seconds * 1e-6:.1f}" if each.samples else ""
            table.add_row(
                str(folder.relative_to(out) / (each.file or each.product)),
                str(each.tiles),
                str(each.resumed),
                str(len(each.errors)),
                f"{each.seconds:.1f}",
                rate,
                f"{each.peak_rss / 2**20:.0f}" if each.peak_rss else "",
            )
            errors += [f"{folder}: {error}" for error in _grouped(each.errors)]
    Console().print(table)
    for error in errors:
        print(f"adret: {error}", file=sys.stderr)
    return 1 if errors else 0


def _grouped(errors: list[str]) -> list[str]:
    """One line for all tiles that failed for the same reason."""
    places: dict[str, list[str]] = {}
    for error in errors:
        place, _, reason = error.partition(": ")
        places.setdefault(reason, []).append(place)
    return [
        f"{found[0]}: {reason}" + (f" (and {len(found) - 1} more tiles)" if len(found) > 1 else "")
        for reason, found in places.items()
    ]


register = job_command(
    "batch",
    HELP,
    "IN... OUT",
    batch,
    (
        ("executor", str, "local", "NAME", "Where tiles run: local, dask or queue."),
        ("scheduler", str | None, None, "ADDRESS", "Of dask's scheduler, or the queue's database."),
        ("each", bool, False, None, "Every file is a surface of its own, in OUT/<name>/."),
        ("resume", bool, False, None, "Go on with what was begun in OUT."),
        ("overwrite", bool, False, None, "Replace what is in OUT."),
        (
            "format",
            str,
            "cog",
            "NAME",
            "Of the results: cog, zarr (version 3, in shards), or zarr2, which GDAL 3.10 reads.",
        ),
    ),
)
