"""Where tiles run: the small interface, and the processes of this machine.

An executor gets orders, which are plain texts and numbers, and hands outcomes back in any order.
The job's folder is all that client and workers share.
"""

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from importlib import metadata
from multiprocessing import get_context, parent_process
from typing import Any, Protocol

from adret.errors import AdretError, InputError
from adret.tiling.tasks import Written

__all__ = ["EXECUTORS", "LocalExecutor", "Order", "Outcome", "TileExecutor", "open_executor"]

EXECUTORS = ("local", "dask", "queue")
GROUP = "adret.executors"
DEATHS = 3  # workers that may die while no tile comes out, before the run gives up

RunTile = Callable[[str, str, int, int], Written]


@dataclass(frozen=True, slots=True)
class Order:
    """A tile to be made: what `run_tile` is called with."""

    out: str
    product: str
    row: int
    column: int


@dataclass(frozen=True, slots=True)
class Outcome:
    """A tile that was made, or why it was not."""

    order: Order
    written: Written | None
    error: str = ""


class TileExecutor(Protocol):
    """Runs `adret.tiling.jobs.run_tile`."""

    def map(self, orders: Sequence[Order]) -> Iterator[Outcome]:
        """Run every order once; closing the iterator early drops those that have not begun."""

    def close(self) -> None:
        """Let the workers go."""


def open_executor(name: str, *, workers: int, threads: int, scheduler: str | None) -> TileExecutor:
    """The executor of that name.

    Parameters
    ----------
    name : str
        "local", "dask", or one that an installed package brings under ``adret.executors``.
    workers, threads : int
        Processes, and threads in each; for executors that start their own.
    scheduler : str or None
        Address of the scheduler or database that an executor needs.

    Raises
    ------
    InputError
        If it is not known, or not installed.
    """
    if name == "local":
        return LocalExecutor(workers, threads)
    if name == "dask":
        try:
            from adret.tiling.dask_executor import DaskExecutor
        except ImportError as error:
            limit = 'installed for dask with pip install "adret[dask]"'
            raise InputError("executor", limit, f"no module {error.name}") from None
        return DaskExecutor(workers, threads, scheduler)
    for entry in metadata.entry_points(group=GROUP, name=name):
        opened: TileExecutor = entry.load()(workers, threads, scheduler)
        return opened
    raise InputError("executor", f"one of {', '.join(EXECUTORS)} that is installed", name)


class LocalExecutor:
    """Processes of this machine, started anew, each with its own share of the cores.

    Parameters
    ----------
    workers : int
        Processes.
    threads : int
        Of each.
    """

    def __init__(self, workers: int, threads: int) -> None:
        self.workers = workers
        self.threads = threads
        self._pool = self._start()

    def _start(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(
            self.workers,
            mp_context=get_context("spawn"),
            initializer=_begin,
            initargs=(self.threads,),
        )

    def map(self, orders: Sequence[Order]) -> Iterator[Outcome]:
        """Run every order once; those that a dying worker took along go to new ones."""
        waiting = list(reversed(orders))
        running: dict[Future[Outcome], Order] = {}
        deaths = 0
        try:
            while waiting or running:
                while waiting and len(running) < 2 * self.workers:
                    order = waiting.pop()
                    try:
                        running[self._pool.submit(attempt, order)] = order
                    except BrokenProcessPool:
                        waiting.append(order)
                        break
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                broken = not done
                for future in done:
                    order = running.pop(future)
                    try:
                        outcome = future.result()
                    except BrokenProcessPool:
                        broken = True
                        waiting.append(order)
                        continue
                    deaths = 0
                    yield outcome
                if broken:
                    deaths += 1
                    waiting.extend(running.values())
                    running.clear()
                    self._pool.shutdown(wait=True, cancel_futures=True)
                    self._pool = self._start()
                    if deaths > DEATHS:
                        for order in waiting:
                            yield Outcome(order, None, "worker: its process died again and again")
                        waiting.clear()
        finally:
            for future in running:
                future.cancel()

    def processes(self) -> list[int]:
        """Numbers of the processes that run now."""
        return list(self._pool._processes or ())

    def close(self) -> None:
        """Let the processes end."""
        self._pool.shutdown(wait=True, cancel_futures=True)


def attempt(order: Order) -> Outcome:
    """Make a tile; what goes wrong becomes words."""
    from adret.tiling.jobs import run_tile

    try:
        return Outcome(order, run_tile(order.out, order.product, order.row, order.column))
    except AdretError as error:
        return Outcome(order, None, " ".join(str(error).split()))
    except MemoryError:
        return Outcome(order, None, "memory: too little for this tile")
    except OSError as error:
        where = f" ({error.filename})" if error.filename else ""
        return Outcome(order, None, f"{error.strerror or error}{where}")


def use_threads(count: int) -> None:
    """Let kernels of this process use so many threads."""
    from adret._kernels import jit

    jit.threads(min(count, jit.threads()))


def _begin(threads: int) -> None:
    """In a new worker: take a share of the cores, and end when the client is gone."""
    client: Any = parent_process()

    def follow() -> None:
        client.join()
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()
    use_threads(threads)
