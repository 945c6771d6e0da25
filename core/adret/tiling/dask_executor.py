"""Tiles on a Dask cluster that a user owns, or on one that is started here."""

import logging
from collections.abc import Iterator, Sequence
from typing import Any

from distributed import Client, LocalCluster, as_completed

from adret.errors import InputError
from adret.tiling.executors import Order, Outcome, attempt, use_threads

__all__ = ["DaskExecutor"]

CONNECT_SECONDS = 10.0
RETRIES = 3  # of a tile whose worker died


class DaskExecutor:
    """Runs tiles as tasks of Dask; every worker must see the rasters and the output folder.

    Parameters
    ----------
    workers, threads : int
        Processes of a cluster that is started here, and threads of each process's kernels.
    scheduler : str or None
        Address of a cluster that runs already, as in ``tcp://node1:8786``. Its workers should
        have one Dask thread each (``dask worker --nthreads 1``): kernels bring their own.

    Raises
    ------
    InputError
        If nobody answers at that address.
    """

    def __init__(self, workers: int, threads: int, scheduler: str | None = None) -> None:
        self._cluster: Any = None
        self._threads = threads
        # What goes wrong is said by our own errors; Dask's tracebacks would drown them.
        for name in ("distributed", "distributed.client"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
        if scheduler is None:
            self._cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                dashboard_address="127.0.0.1:0",  # None stands for port 8787 of every interface
                memory_limit=0,  # the plan holds tiles to their memory
            )
        try:
            self._client = Client(scheduler or self._cluster, timeout=CONNECT_SECONDS)
        except (OSError, ValueError) as error:
            limit = f"the address of a Dask scheduler that answers ({error})"
            raise InputError("scheduler", " ".join(limit.split()), scheduler) from None

    def map(self, orders: Sequence[Order]) -> Iterator[Outcome]:
        """Run every order once; Dask repeats those whose worker died.

        Raises
        ------
        InputError
            If the scheduler is gone; tiles that are done stay on the disk.
        """
        if not orders:
            return
        shared = None if self._cluster is None else self._threads
        futures = {
            self._client.submit(_attempt, order, shared, pure=False, retries=RETRIES): order
            for order in orders
        }
        try:
            for future in as_completed(futures):
                try:
                    yield future.result()
                except Exception as error:  # of Dask's own: a worker died too often, was cancelled
                    if self._client.status != "running":
                        limit = "one that goes on answering (--resume keeps what is done)"
                        address = getattr(self._client.scheduler, "address", None)
                        raise InputError("scheduler", limit, address) from None
                    kind = type(error).__name__
                    yield Outcome(futures[future], None, f"dask: {kind}")
                future.release()
        finally:
            if self._client.status == "running":
                self._client.cancel(list(futures))

    def close(self) -> None:
        """Leave the cluster; end it if it was started here."""
        self._client.close()
        if self._cluster is not None:
            self._cluster.close()


def _attempt(order: Order, threads: int | None) -> Outcome:
    """Make a tile on a Dask worker."""
    if threads is not None:
        use_threads(threads)
    return attempt(order)
