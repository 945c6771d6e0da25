"""The process that computes, and the only caller of the library's computations.

It reads orders as JSON lines from its standard input and answers in JSON lines on its standard
output. It has no connection to the database or the network, holds nothing between two orders and
may be killed at any moment: that is how a job stops in the middle of a kernel. When its input
closes, its worker is gone and it ends at once.
"""

import errno
import json
import os
import queue
import sys
import threading
import traceback
from dataclasses import asdict
from pathlib import Path
from typing import IO, Any

from adret.errors import Cancelled, InputError
from adret_service.precedence import step_back

__all__ = ["main"]

RESULT = "result.tif"
PREVIEW = "preview.png"


class Orders:
    """Orders from the worker; a cancel overtakes the order that is being run."""

    def __init__(self, source: IO[str]) -> None:
        self.cancelled = threading.Event()
        self._queue: queue.Queue[dict[str, Any]] = queue.Queue()
        self._source = source
        threading.Thread(target=self._read, name="orders", daemon=True).start()

    def next(self) -> dict[str, Any]:
        """Wait for the next order."""
        order = self._queue.get()
        self.cancelled.clear()
        return order

    def _read(self) -> None:
        for line in self._source:
            message = json.loads(line)
            if message == "cancel":
                self.cancelled.set()
            else:
                self._queue.put(message)
        os._exit(0)


def main() -> None:
    """Serve orders until the input closes; the argument is how nice to be to other processes."""
    step_back(int(sys.argv[1]) if len(sys.argv) > 1 else 0)
    # Whatever a library prints must not mix with the answers.
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8", buffering=1)
    os.dup2(2, 1)
    orders = Orders(sys.stdin)

    def answer(**message: Any) -> None:
        try:
            answers.write(json.dumps(message) + "\n")
        except BrokenPipeError:
            os._exit(0)  # the worker is gone

    try:
        answer(event="ready", layer=warm_up())
    except Exception as error:
        traceback.print_exc()
        answer(event="unfit", reason=str(error))
        return
    while True:
        order = orders.next()
        try:
            answer(event="done", notes=run(order, orders.cancelled, answer))
        except Cancelled:
            answer(event="cancelled")
        except InputError as error:
            answer(event="refused", field=error.field, limit=error.limit, value=str(error.value))
        except MemoryError:
            answer(
                event="refused",
                field="dataset",
                limit="small enough for the worker's memory",
                value="a computation that needs more",
            )
        except Exception as error:
            traceback.print_exc()
            full = getattr(error, "errno", None) in (errno.ENOSPC, errno.EDQUOT)
            answer(event="failed", reason=type(error).__name__, full=full)


def warm_up() -> str:
    """Load or compile a parallel kernel and return the threading layer it ran on.

    Raises
    ------
    RuntimeError
        If the layer is the one that aborts the process when two threads meet in a kernel.
    """
    import numpy as np

    import adret
    from adret._kernels.jit import threading_layer

    adret.sky_view_factor(adret.Terrain(np.zeros((64, 64)), (1.0, 1.0)), directions=4)
    layer = threading_layer()
    if layer == "workqueue":
        raise RuntimeError("threading layer: must be tbb or omp, got workqueue (install tbb)")
    return layer


def run(order: dict[str, Any], cancelled: threading.Event, answer: Any) -> dict[str, Any]:
    """Run one order; files appear in its folder.

    Parameters
    ----------
    order : dict
        process, inputs, raster (path), info (of the dataset), folder (path); tiles (see
        `adret_service.tiled_runs.tiled_job`), None for a job that is to be computed whole.
    cancelled : threading.Event
        Looked at between azimuths, or between tiles.
    answer : callable
        Sends progress.
    """
    from adret import products
    from adret_service import processes
    from adret_service.decoding import read_dataset

    def progress(done: int, total: int) -> None:
        if cancelled.is_set():
            raise Cancelled("the job was dismissed")
        answer(event="progress", done=done, total=total)

    folder = Path(order["folder"])
    product = products.PRODUCTS[order["process"]]
    parameters = processes.parameters(order["process"], order["inputs"])
    progress(0, 1)
    raster = Path(order["raster"])
    if order["tiles"] is not None:
        from adret_service.tiled_runs import compute_tiled, tiled_job

        tiled = tiled_job(order["process"], parameters, raster, order["info"], order["tiles"])
        if tiled is not None:
            counts = compute_tiled(
                tiled,
                Path(order["tiles"]["folder"]),
                folder / RESULT,
                folder / PREVIEW,
                progress,
                lambda line: answer(event="progress", note=line),
            )
            progress(1, 1)
            return {"bytes": (folder / RESULT).stat().st_size} | asdict(counts)
    source = read_dataset(raster, order["info"])
    products.run(
        product,
        source,
        parameters,
        folder / RESULT,
        preview_path=folder / PREVIEW,
        progress=progress,
    )
    progress(1, 1)
    return {"bytes": (folder / RESULT).stat().st_size}


if __name__ == "__main__":
    main()
