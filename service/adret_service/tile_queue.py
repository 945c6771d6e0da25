"""Tiles of batches on the durable queue: workers on any machine that sees database and folder.

An order is a workflow of DBOS whose arguments are texts and numbers. A worker that takes one keeps
touching a file of its name in the batch's folder; when that stands still, the worker is dead and
the client has its order taken again. Should the worker live after all, a tile is made twice, which
changes nothing: it is the same file.
"""

import contextlib
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from dbos import (
    DBOS,
    DBOSClient,
    DBOSConfig,
    DBOSPortableJSONSerializer,
    EnqueueOptions,
    WorkflowSerializationFormat,
    run_dbos_database_migrations,
)

from adret.errors import InputError
from adret.tiling.executors import Order, Outcome, attempt, use_threads
from adret.tiling.jobs import FOLDER
from adret.tiling.tasks import Written
from adret_service.ids import new_id

__all__ = ["QueueExecutor", "serve_tiles"]

APPLICATION = "adret-tiles"
QUEUE = "adret-tiles"
WORKFLOW = "adret_tile"
VERSION = "adret-tiles-1"
POLL = 0.2  # s between looks at the database
AHEAD = 2  # orders that a worker has in hand: one it works at, and the next
BEAT = 2.0  # s between touches of a worker's file
GRACE = 20.0  # s without a touch after which a worker is dead
LOOK = 1.0  # s between looks for the dead
ENDED = ["SUCCESS", "ERROR", "CANCELLED", "MAX_RECOVERY_ATTEMPTS_EXCEEDED"]
STARTS = 10  # of own workers, besides the first ones, before the run gives up on them


class QueueExecutor:
    """Runs tiles through a database; starts workers of its own, and shares with all others.

    Parameters
    ----------
    workers, threads : int
        Processes to start here, and threads of each.
    database : str or None
        URL of a PostgreSQL or SQLite database.

    Raises
    ------
    InputError
        If no database is named.
    """

    def __init__(self, workers: int, threads: int, database: str | None) -> None:
        if database is None or "://" not in database:
            limit = "the URL of a PostgreSQL or SQLite database, for the queue"
            raise InputError("scheduler", limit, database)
        self._database = database
        self._threads = threads
        run_dbos_database_migrations(database)
        self._client = DBOSClient(
            system_database_url=database,
            serializer=DBOSPortableJSONSerializer(),
            application_name=APPLICATION,
        )
        self._client.register_queue(QUEUE, worker_concurrency=AHEAD, polling_interval_sec=POLL)
        self._workers = [self._start() for _ in range(workers)]
        self._starts = STARTS

    def map(self, orders: Sequence[Order]) -> Iterator[Outcome]:
        """Run every order once; those of dead workers are taken by others."""
        run = new_id()
        open_orders = {f"{run}-{number}": order for number, order in enumerate(orders)}
        for name, order in open_orders.items():
            self._client.enqueue(_options(name), order.out, order.product, order.row, order.column)
        beats: dict[Path, tuple[float, float]] = {}
        looked = time.monotonic()
        try:
            while open_orders:
                for state in self._client.list_workflows(
                    workflow_id_prefix=f"{run}-", status=ENDED, queue_name=QUEUE
                ):
                    order = open_orders.pop(state.workflow_id)
                    yield _outcome(order, state.output)
                    self._client.delete_workflow(state.workflow_id)
                if time.monotonic() - looked >= LOOK:
                    looked = time.monotonic()
                    self._revive(run, open_orders, beats)
                    self._keep_workers()
                time.sleep(POLL)
        finally:
            if open_orders:
                self._client.cancel_workflows(list(open_orders))

    def close(self) -> None:
        """End the workers that were started here, and leave the database."""
        for worker in self._workers:
            worker.terminate()
        for worker in self._workers:
            with contextlib.suppress(subprocess.TimeoutExpired):
                worker.wait(5.0)
            worker.kill()
            worker.wait()
        self._client.destroy()

    def processes(self) -> list[int]:
        """Numbers of the processes that were started here."""
        return [worker.pid for worker in self._workers]

    def _start(self) -> "subprocess.Popen[bytes]":
        code = "import sys; from adret_service.tile_queue import child; child(*sys.argv[1:])"
        arguments = [sys.executable, "-c", code, str(self._threads), str(os.getpid())]
        # The address may hold a password: not for the list of processes.
        environment = os.environ | {"ADRET_TILE_DATABASE": self._database}
        return subprocess.Popen(arguments, env=environment, stdin=subprocess.DEVNULL)

    def _keep_workers(self) -> None:
        for place, worker in enumerate(self._workers):
            if worker.poll() is not None and self._starts > 0:
                self._starts -= 1
                self._workers[place] = self._start()

    def _revive(
        self, run: str, open_orders: dict[str, Order], beats: dict[Path, tuple[float, float]]
    ) -> None:
        """Have orders of dead workers taken again."""
        for state in self._client.list_workflows(
            workflow_id_prefix=f"{run}-", status="PENDING", queue_name=QUEUE
        ):
            order = open_orders.get(state.workflow_id)
            if order is None or state.executor_id is None:
                continue
            beat = _beat(Path(order.out), state.executor_id)
            touched = beat.stat().st_mtime if beat.exists() else 0.0
            now = time.monotonic()
            if beats.get(beat, (None, 0.0))[0] != touched:
                beats[beat] = (touched, now)
            elif now - beats[beat][1] > GRACE:
                self._client.resume_workflow(state.workflow_id, queue_name=QUEUE)


def serve_tiles(database: str, threads: int) -> None:
    """Take tiles from the queue in background threads of this process, one at a time."""
    name = f"tiles-{socket.gethostname()}-{new_id()}"
    use_threads(threads)
    config: DBOSConfig = {
        "name": APPLICATION,
        "system_database_url": database,
        "application_version": VERSION,
        "executor_id": name,
        "serializer": DBOSPortableJSONSerializer(),
        "log_level": "ERROR",
        "run_migrations": False,
        "scheduler_polling_interval_sec": 3600.0,
    }
    DBOS(config=config)

    one_by_one = threading.Lock()

    @DBOS.workflow(name=WORKFLOW)
    def adret_tile(out: str, product: str, row: int, column: int) -> dict[str, Any]:
        with _beating(_beat(Path(out), name)), one_by_one:
            use_threads(threads)
            outcome = attempt(Order(out, product, row, column))
        written = None if outcome.written is None else asdict(outcome.written)
        return {"written": written, "error": outcome.error}

    DBOS.listen_queues([QUEUE])
    DBOS.launch()


def child(threads: str, client: str) -> None:
    """A worker that a client started: it ends when the client is gone."""
    serve_tiles(os.environ["ADRET_TILE_DATABASE"], int(threads))
    while os.getppid() == int(client):
        time.sleep(0.5)
    os._exit(1)


def _options(name: str) -> EnqueueOptions:
    return {
        "workflow_name": WORKFLOW,
        "queue_name": QUEUE,
        "workflow_id": name,
        "app_version": VERSION,
        "serialization_type": WorkflowSerializationFormat.PORTABLE,
    }


def _outcome(order: Order, output: Any) -> Outcome:
    if not isinstance(output, dict):
        return Outcome(order, None, "queue: the order was cancelled or failed")
    known = output["written"]
    return Outcome(order, None if known is None else Written(**known), output["error"])


def _beat(out: Path, name: str) -> Path:
    """The file that a worker touches while it makes a tile."""
    return out / FOLDER / "workers" / name


@contextlib.contextmanager
def _beating(beat: Path) -> Iterator[None]:
    """Touch a file again and again, from a thread of its own."""
    beat.parent.mkdir(parents=True, exist_ok=True)
    ended = threading.Event()

    def touch() -> None:
        while not ended.is_set():
            beat.touch()
            ended.wait(BEAT)

    beat.touch()
    thread = threading.Thread(target=touch, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        beat.unlink(missing_ok=True)
