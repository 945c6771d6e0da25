"""`adret plan`."""

from typing import TYPE_CHECKING

from adret.cli.running import progress_bar
from adret.cli.tiling import Request, job_command, job_of

if TYPE_CHECKING:
    from adret.tiling import Plan

__all__ = ["register", "show"]

HELP = """What a batch would cost: tiles, passes, memory, disk, time. Nothing is computed.

Examples:

\b
  adret plan dem.tif --product sky --max-distance 20000
  adret plan dem.tif --product horizon,sky --directions 32 --tile-size 4096 --memory 4G
  adret plan 'tiles/*.tif' --product shadow --sun 135,20

Heights are read once for their range. Where the memory would not do, this ends with what would.
"""


def plan(places: tuple[str, ...], request: Request) -> None:
    """Print what a job needs."""
    from pathlib import Path

    from adret.tiling import plan as plan_of
    from adret.tiling.plans import check_memory, default_threads

    with progress_bar("heights") as progress:
        job = job_of(request, places, progress)
    found = plan_of(job, request.workers, default_threads(request.workers))
    show(found)
    check_memory(found, job, request.memory, Path.cwd())


def show(found: "Plan") -> None:
    """Print a plan as a table."""
    from rich.console import Console
    from rich.table import Table

    rows, columns = found.shape
    size = found.tile_size
    table = Table(title=f"{rows} x {columns} cells, tiles of {size} x {size}", title_justify="left")
    for name in ("product", "tiles", "azimuths", "halo", "layers", "a worker", "disk", "core time"):
        table.add_column(name, justify="left" if name == "product" else "right")
    for each in found.products:
        table.add_row(
            each.product,
            str(each.tiles),
            str(each.azimuths),
            "all" if each.halo is None else str(each.halo),
            str(each.bands),
            f"{each.worker_bytes / 2**20:.0f} MiB",
            f"{each.disk_bytes / 2**20:.0f} MiB",
            _duration(each.core_seconds),
        )
    console = Console()
    console.print(table)
    console.print(
        f"{len(found.products)} passes, {found.workers} workers of {found.threads} threads: "
        f"about {_duration(found.seconds)}",
        highlight=False,
    )


def _duration(seconds: float) -> str:
    if seconds < 120.0:
        return f"{seconds:.1f} s"
    if seconds < 7200.0:
        return f"{seconds / 60.0:.0f} min"
    return f"{seconds / 3600.0:.1f} h"


register = job_command("plan", HELP, "IN...", plan)
