"""Runs jobs: from a claimed id to published results and a record that says how it ended."""

import errno
import logging
import queue
import shutil
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

from adret_service.children import TICK, ComputeChild, Message
from adret_service.compute import PREVIEW, RESULT
from adret_service.database import persist
from adret_service.datasets import GEOTIFF, Dataset, DatasetCatalogue
from adret_service.echo import ECHO, EchoFailed, run_echo
from adret_service.engine.port import JobLedger, JobRecord, JobStatus
from adret_service.estimate import cost
from adret_service.logs import about
from adret_service.settings import Settings
from adret_service.status import prefix_of
from adret_service.storage import Artefact, Storage
from adret_service.tile_folders import TileFolders
from adret_service.tracing import job_span

__all__ = ["JobRunner"]

log = logging.getLogger("adret.worker")

REPORT = 0.5  # seconds between two notes of progress
FULL_DISK = (errno.ENOSPC, errno.EDQUOT)
ROOM = 16 << 20  # bytes below which a failed write is taken for a full disk
WITHOUT_RESULTS = (JobStatus.FAILED, JobStatus.DISMISSED)


class Unwanted(Exception):
    """The job was dismissed or removed, or another worker has ended it."""


class JobRunner:
    """Runs jobs by id, as many at a time as it has children.

    Parameters
    ----------
    settings : Settings
        Limits and timings.
    ledger : JobLedger
        Where states and progress are noted.
    catalogue : DatasetCatalogue
        Where inputs are found.
    storage : Storage
        Where results go.
    scratch : Path
        Folder of this process.
    children : list of ComputeChild
        One a slot.
    """

    def __init__(
        self,
        settings: Settings,
        ledger: JobLedger,
        catalogue: DatasetCatalogue,
        storage: Storage,
        scratch: Path,
        children: list[ComputeChild],
    ) -> None:
        self.settings = settings
        self.ledger = ledger
        self.catalogue = catalogue
        self.storage = storage
        self.scratch = scratch
        self.tile_folders = TileFolders(settings)
        self.stopping = threading.Event()
        self._children = children
        self._free: queue.Queue[ComputeChild] = queue.Queue()
        for child in children:
            self._free.put(child)

    def execute(self, job_id: str) -> None:
        """Run one job until its record says how it ended; safe to repeat after any crash."""
        for attempt in range(1, self.settings.job_max_attempts + 1):
            try:
                self._execute(job_id)
                return
            except Exception:
                if self.stopping.is_set():
                    hold()
                log.exception("job %s: attempt %d failed in the worker", job_id, attempt)
                self.stopping.wait(float(attempt))
        error = failure(500, "the worker failed while it ran the job")
        persist(lambda: self.ledger.fail(job_id, error))

    def _execute(self, job_id: str) -> None:
        job = persist(lambda: self.ledger.begin(job_id))
        if job is None:
            return
        parent = str(job.request.get("traceparent", ""))
        request = str(job.request.get("request_id", ""))
        with about(request_id=request, job_id=job_id), job_span(job_id, job.process, parent):
            log.info("job %s: %s begins", job_id, job.process)
            self._run(job)

    def _run(self, job: JobRecord) -> None:
        job_id = job.id
        prefix = prefix_of(job)
        error, unwanted = None, False
        if self.storage.manifest(prefix) is None:  # else: a crash between it and the record
            child = self._free.get()
            try:
                error = self._echo(job) if job.process == ECHO else self._compute(job, child)
            except Unwanted:
                unwanted = True
            finally:
                self._free.put(child)
        if self.stopping.is_set():
            hold()
        if error is not None:
            persist(lambda: self.ledger.fail(job_id, error))
            self._clear(job)
        elif unwanted or not persist(lambda: self.ledger.succeed(job_id)):
            self._clear(job)
        else:
            self.tile_folders.drop(job_id)

    def _clear(self, job: JobRecord) -> None:
        """Drop what was made for a job that ended without success, here or elsewhere.

        A worker that was taken for dead may wake up after another one finished its job: then the
        results are the other's, and stay.
        """
        if persist(lambda: self.ledger.status(job.id)) in (*WITHOUT_RESULTS, None):
            self.storage.delete(prefix_of(job))

    def stop(self) -> None:
        """End all children; jobs in progress are left for the next worker."""
        self.stopping.set()
        for child in self._children:
            child.kill()

    def _compute(self, job: JobRecord, child: ComputeChild) -> Mapping[str, Any] | None:
        """Compute and publish, again after a crash or a full disk; returns an error or None."""
        dataset = persist(lambda: self.catalogue.get(job.dataset, job.tenant))
        if dataset is None:
            return failure(400, f"dataset: must be an existing dataset, got {job.dataset!r}")
        deadline = time.monotonic() + self.settings.job_timeout
        crashes = 0
        while not self.stopping.is_set():
            if self.tile_folders.others(job.id) > self.settings.scratch_max_bytes:
                self._wait_for_room(job.id)
                continue
            folder = self.scratch / job.id
            folder.mkdir(exist_ok=True)
            tiles = self._tiles(job, dataset)
            kept = folder if tiles is None else Path(tiles["folder"])
            try:
                order = {
                    "process": job.process,
                    "inputs": dict(job.inputs),
                    "raster": str(self._raster(dataset, kept)),
                    "info": dict(dataset.info),
                    "folder": str(folder.absolute()),
                    "tiles": tiles,
                }
                end = child.run(
                    order, Notes(self, job.id, deadline).take, self.settings.cancel_grace
                )
                if end["event"] == "done":
                    if "tiles" in end["notes"]:
                        counts = {name: end["notes"][name] for name in ("tiles", "found", "made")}
                        log.info("job %s: tiles: %s", job.id, counts)
                    self._publish(job, computed(folder))
                    return None
                room = shutil.disk_usage(folder).free
            except OSError as error:
                if error.errno not in FULL_DISK:
                    raise
                end, room = {"event": "failed", "full": True}, 0
            finally:
                shutil.rmtree(folder, ignore_errors=True)
            if end["event"] == "cancelled":
                if time.monotonic() > deadline:
                    return failure(500, f"the job ran longer than {self.settings.job_timeout:g} s")
                raise Unwanted
            if tiles is not None and not kept.exists():
                self._note(job.id, "its tiles were dropped to make room; they begin again")
                continue
            if end["event"] == "refused":
                return failure(
                    400,
                    f"{end['field']}: must be {end['limit']}, got {end['value']}",
                    [{k: end[k] for k in ("field", "limit", "value")}],
                )
            if end["event"] == "failed" and not end.get("full") and room > ROOM:
                return failure(500, f"the computation failed ({end['reason']})")
            if end["event"] == "failed":
                self._wait_for_room(job.id)
                continue
            crashes += 1
            self._note(job.id, f"its computing process died (exit {end['exit']})")
            if crashes >= self.settings.job_max_attempts and not self.stopping.is_set():
                return failure(500, f"the computing process died {crashes} times")
        return None

    def _tiles(self, job: JobRecord, dataset: Dataset) -> dict[str, Any] | None:
        """How a job over a large raster is cut; None for one that is computed whole."""
        cells = int(dataset.info.get("rows", 0)) * int(dataset.info.get("columns", 0))
        large = 0 < self.settings.tiled_cells < cells
        if not large or dataset.info.get("kind") == "depth":
            return None
        work = cost(job.process, job.inputs, dataset.info).core_seconds
        if work < self.settings.tiled_seconds:
            return None
        return {
            "folder": str(self.tile_folders.open(job.id)),
            "size": self.settings.tile_size,
            "room": self.tile_folders.room(job.id),
        }

    def _raster(self, dataset: Dataset, folder: Path) -> Path:
        """The dataset's file on this machine: in the store, or fetched once into the folder."""
        fetched = folder / dataset.key.rsplit("/", 1)[-1]
        return fetched if fetched.exists() else self.storage.local(dataset.key, folder)

    def _echo(self, job: JobRecord) -> Mapping[str, Any] | None:
        """Give back what was sent, for tests of clients; returns an error or None."""
        deadline = time.monotonic() + self.settings.job_timeout
        notes = Notes(self, job.id, deadline)
        folder = self.scratch / job.id
        folder.mkdir(exist_ok=True)
        try:
            made = run_echo(job.inputs, folder, lambda: notes.take(None))
            if made is not None:
                self._publish(job, made)
            return None
        except EchoFailed:
            error = {"field": "inputs.fail", "limit": "false", "value": True}
            return failure(400, "inputs.fail: must be false, got True", [error])
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def _publish(self, job: JobRecord, made: Mapping[str, tuple[Path, str]]) -> None:
        prefix = prefix_of(job)
        artefacts: dict[str, Artefact] = {
            name: self.storage.publish(path, prefix, path.name, media_type)
            for name, (path, media_type) in made.items()
        }
        self.storage.write_manifest(
            prefix, artefacts, {"process": job.process, "inputs": dict(job.inputs)}
        )

    def _note(self, job_id: str, message: str, level: str = "warning") -> None:
        log.log(logging.getLevelNamesMapping()[level.upper()], "job %s: %s", job_id, message)
        persist(lambda: self.ledger.note(job_id, level, message))

    def _wait_for_room(self, job_id: str) -> None:
        self._note(job_id, "no space left on the disk")
        self.tile_folders.sweep(self.ledger.look)
        persist(lambda: self.ledger.progress(job_id, 0, "waiting for disk space"))
        self.stopping.wait(5.0)


class Notes:
    """Turns a child's messages into notes of progress, and says when to stop."""

    def __init__(self, runner: JobRunner, job_id: str, deadline: float) -> None:
        self.runner = runner
        self.job_id = job_id
        self.deadline = deadline
        self._asked = self._reported = -1e9
        self._percent = -1

    def take(self, message: Message | None) -> bool:
        """Note a message; False once the job is to stop."""
        now = time.monotonic()
        if message is not None and "note" in message:
            self.runner._note(self.job_id, str(message["note"]), "info")
        elif message is not None and now - self._reported >= REPORT:
            percent = 99 * message["done"] // max(message["total"], 1)
            if percent != self._percent:
                self._percent, self._reported = percent, now
                persist(lambda: self.runner.ledger.progress(self.job_id, percent, "running"))
        if self.runner.stopping.is_set() or now > self.deadline:
            return False
        if now - self._asked < TICK:
            return True
        self._asked = now
        return persist(lambda: self.runner.ledger.wanted(self.job_id))


def computed(folder: Path) -> dict[str, tuple[Path, str]]:
    """Return the files that a computation has made, with their media types, by output."""
    files = {
        "result": (folder / RESULT, f"{GEOTIFF}; profile=cloud-optimized"),
        "preview": (folder / PREVIEW, "image/png"),
    }
    return {name: made for name, made in files.items() if name == "result" or made[0].exists()}


def failure(
    status: int, detail: str, errors: list[dict[str, Any]] | None = None
) -> Mapping[str, Any]:
    """Return the error that a failed job keeps."""
    return {"type": "about:blank", "status": status, "detail": detail, "errors": errors or []}


def hold() -> NoReturn:
    """Wait for the end of the process: returning would tell the queue that the job is done."""
    while True:
        time.sleep(3600.0)
