"""Progress on the terminal: bars of bytes and of percent, on standard error."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    DownloadColumn,
    Progress,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
    TransferSpeedColumn,
)
from rich.table import Table

from adret_service.client.following import follow
from adret_service.client.records import Event, Job
from adret_service.client.session import Client

__all__ = ["bytes_bar", "follow_with_bar", "show_jobs"]


@contextmanager
def bytes_bar(title: str, total: int, *, shown: bool) -> Iterator[Callable[[int], None]]:
    """Yield a function that is told how many bytes are done."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        DownloadColumn(binary_units=True),
        TransferSpeedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), disable=not shown) as progress:
        bar = progress.add_task(title, total=total)
        yield lambda done: progress.update(bar, completed=done)


def follow_with_bar(
    client: Client, job_id: str, *, shown: bool, told: Callable[[Event], None] = lambda _: None
) -> Job:
    """Follow a job to its end; returns it as it ended."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    with Progress(*columns, console=console, disable=not shown) as progress:
        bar = progress.add_task("accepted", total=100)
        for event in follow(client, job_id):
            told(event)
            changes: dict[str, Any] = {}
            if "progress" in event.body:
                changes["completed"] = event.body["progress"]
            if event.kind in ("status", "end"):
                changes["description"] = event.body["status"]
            if event.kind == "log" and shown:
                progress.console.print(event.body.get("message", ""), markup=False)
            progress.update(bar, **changes)
    return client.job(job_id)


def show_jobs(jobs: list[Job]) -> None:
    """Print a table of jobs."""
    table = Table(box=None, pad_edge=False)
    for heading in ("job", "process", "status", "%", "created", "message"):
        table.add_column(heading, no_wrap=heading == "job")
    for job in jobs:
        cells = (job.id, job.process, job.status, str(job.progress), job.created, job.message)
        table.add_row(*cells)
    Console(markup=False, highlight=False).print(table)
