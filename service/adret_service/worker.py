"""The worker process: takes jobs from the queue and has them computed by killable children.

``python -m adret_service.worker`` is what `adret serve` starts: settings come as one JSON line on
the standard input, and when that input closes the server is gone and the worker ends. `adret
worker` runs the same without a server to watch. The queue is imported only while the children
load their kernels, which halves the time to the first job.
"""

import logging
import os
import signal
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import IO, NoReturn

from adret_service.children import ComputeChild, Unfit
from adret_service.engine.liveness import Lease
from adret_service.logs import set_up_logging
from adret_service.precedence import step_back
from adret_service.settings import Settings
from adret_service.tracing import set_up_tracing

__all__ = ["UNFIT", "run_worker", "set_up_logging"]

log = logging.getLogger("adret.worker")

UNFIT = 3  # exit status: no restart will help


def run_worker(settings: Settings, watched: IO[str] | None = None) -> NoReturn:
    """Work until a signal comes or `watched` closes; ends the process.

    Parameters
    ----------
    settings : Settings
        Settings of the service.
    watched : text stream, optional
        A pipe from the server; its end means that the server is gone.
    """
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    if watched is not None:
        threading.Thread(target=_at_end, args=(watched, stop), daemon=True).start()
    set_up_tracing(settings, "worker")
    lease = Lease(settings.locks_dir, settings.scratch_dir, "worker")
    children = [
        ComputeChild(settings.threads, nice=settings.compute_nice)
        for _ in range(settings.job_slots)
    ]
    with ThreadPoolExecutor() as starts:  # kernels load while the database opens
        starting = [starts.submit(child.start) for child in children]

        from adret_service.database import open_database
        from adret_service.datasets import DatasetCatalogue
        from adret_service.engine.durable import DurableEngine, Reaper, serve_queue
        from adret_service.running import JobRunner
        from adret_service.storage import open_storage

        storage = open_storage(settings)
        database = open_database(settings)
        engine = DurableEngine(settings, database)
        announced = engine.announce(lease)
    try:
        layers = {start.result() for start in starting}
    except (Unfit, RuntimeError) as error:
        log.error("no computing process: %s", error)
        for child in children:
            child.kill()
        lease.release()
        os._exit(UNFIT if isinstance(error, Unfit) else 1)
    catalogue = DatasetCatalogue(database, storage)
    runner = JobRunner(settings, engine, catalogue, storage, lease.scratch, children)
    reaper = Reaper(engine, settings)
    reaper.start()
    serve_queue(settings, lease, runner.execute)
    log.info("worker %s is ready (%s, %d threads)", lease.name, *layers, settings.threads)
    while not stop.wait(3600.0):
        continue
    runner.stop()
    reaper.stop()
    if announced is not None:
        announced.release()
    lease.release()
    os._exit(0)  # the queue's threads hold jobs that must not be marked as done


def _at_end(watched: IO[str], stop: threading.Event) -> None:
    watched.read()
    stop.set()


def main() -> NoReturn:
    """Entry of ``python -m adret_service.worker``."""
    settings = Settings.model_validate_json(sys.stdin.readline())
    step_back(settings.compute_nice, session=True)  # the server gave it one of its own
    set_up_logging(settings)
    run_worker(settings, sys.stdin)


if __name__ == "__main__":
    main()
