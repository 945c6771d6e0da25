"""Batches in the tests' own process."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from adret import products
from adret.tiling import Job, Surface, prepare, run_batch
from adret.tiling.executors import Order, Outcome, attempt


class Here:
    """An executor without processes, that may stop."""

    def __init__(self, stop_after: int | None = None) -> None:
        self.stop_after = stop_after
        self.orders: list[Order] = []

    def map(self, orders: Sequence[Order]) -> Iterator[Outcome]:
        for order in orders:
            if len(self.orders) == self.stop_after:
                raise KeyboardInterrupt
            self.orders.append(order)
            yield attempt(order)

    def close(self) -> None:
        """Nothing to let go."""


def job_of(paths: Sequence[str | Path], size: int, chosen: dict[str, dict[str, Any]]) -> Job:
    """The job of files and of products with their options."""
    given = {name: products.PRODUCTS[name].parameters(**more) for name, more in chosen.items()}
    return Job(Surface.open(list(paths)), given, size)


def batch(job: Job, out: Path, form: str = "cog", **options: bool) -> Here:
    """Run a job to its end."""
    executor = Here()
    prepare(job, out, form=form, **options)
    report = run_batch(job, out, executor, form=form)
    assert not report.failed, report
    return executor
