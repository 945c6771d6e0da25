"""The processes that answer while a client waits, as the API sees them: asked in turn, kept warm.

Kernels and rasters stay out of the API's own process. A view of a raster never changes, because
what is in the store never does, so the last answers are kept in memory.
"""

import hashlib
import json
import os
import subprocess
import sys
import threading
import zlib
from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import anyio

from adret_service.ingest import KEPT_ENVIRONMENT
from adret_service.problems import FieldError, Problem
from adret_service.settings import Settings
from adret_service.storage import FileStorage, Storage

__all__ = ["View", "Viewers"]

MAX_WAITING = 500  # requests for one process, above which the next is sent away
KEPT_BYTES = 64 << 20
HOMES = {"HOME", "NUMBA_CACHE_DIR", "XDG_CACHE_HOME"}  # where compiled kernels are kept


@dataclass(frozen=True, slots=True)
class View:
    """What was asked for: its bytes and media type; no bytes where there is no data."""

    body: bytes
    media_type: str


class Viewer:
    """One process; started when it is first asked, and again when it has died."""

    def __init__(self, seconds: float, nice: int) -> None:
        self.seconds = seconds
        self.nice = nice
        self.turn = anyio.CapacityLimiter(1)
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def waiting(self) -> int:
        """How many requests this process has before it."""
        return self.turn.borrowed_tokens + self.turn.statistics().tasks_waiting

    def ask(self, order: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        """Have one order done; a process that dies of it is started once more.

        Raises
        ------
        Problem
            503 if it takes too long, 500 if it fails.
        """
        with self._lock:
            for _ in range(2):
                late = threading.Event()
                try:
                    head, body = self._once(order, late)
                except (BrokenPipeError, ValueError):
                    self._end()
                    if late.is_set():
                        detail = f"seconds: must be at most {self.seconds:g} for one view"
                        raise Problem(503, detail, headers={"Retry-After": "5"}) from None
                    continue
                if "failed" in head:
                    break
                return head, body
        raise Problem(500, "this view cannot be made; the request id finds the reason")

    def _once(self, order: dict[str, Any], late: threading.Event) -> tuple[dict[str, Any], bytes]:
        process = self._started()
        assert process.stdin is not None
        assert process.stdout is not None

        def give_up() -> None:
            late.set()
            process.kill()

        timer = threading.Timer(self.seconds, give_up)
        timer.daemon = True
        timer.start()
        try:
            process.stdin.write(json.dumps(order).encode() + b"\n")
            process.stdin.flush()
            head = json.loads(process.stdout.readline())
            size = head.pop("bytes")
            body = process.stdout.read(size)
            if len(body) < size:
                raise BrokenPipeError
        finally:
            timer.cancel()
        return head, body

    def _started(self) -> "subprocess.Popen[bytes]":
        if self._process is None or self._process.poll() is not None:
            self._end()
            kept = {k: v for k, v in os.environ.items() if k in KEPT_ENVIRONMENT | HOMES}
            self._process = subprocess.Popen(
                [sys.executable, "-m", "adret_service.viewing", str(self.nice)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env=kept | {"NUMBA_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
                start_new_session=True,
            )
        return self._process

    def close(self) -> None:
        """End the process, even in the middle of an order."""
        process = self._process
        if process is not None:
            process.kill()
        with self._lock:
            self._end()

    def _end(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()
            for pipe in (process.stdin, process.stdout):
                try:
                    if pipe is not None:
                        pipe.close()
                except BrokenPipeError:
                    continue


class Viewers:
    """All viewing processes of one API process, and the files and answers that they share.

    Parameters
    ----------
    settings : Settings
        viewers, view_timeout, view_cache_bytes.
    storage : Storage
        Where rasters are.
    folder : Path
        Where copies of files in a bucket are kept.
    """

    def __init__(self, settings: Settings, storage: Storage, folder: Path) -> None:
        nice = settings.compute_nice // 2  # behind the API, before the jobs
        self._pool = [Viewer(settings.view_timeout, nice) for _ in range(settings.viewers)]
        self._copies = Copies(storage, folder, settings.view_cache_bytes)
        self._kept: OrderedDict[str, View] = OrderedDict()
        self._size = 0

    async def ask(self, work: str, key: str, *, sticky: bool = False, **order: Any) -> View:
        """Have a view of a stored raster made.

        Parameters
        ----------
        work : str
            Name in `adret_service.viewing.WORK`.
        key : str
            Key of the raster in the store.
        sticky : bool
            Ask the same process for the same raster, which it keeps in memory.
        **order
            What that work takes.

        Raises
        ------
        Problem
            Whatever the process refused; 410 if the file is gone, 503 when too many wait.
        """
        name = json.dumps([work, key, order], sort_keys=True)
        kept = self._kept.get(name)
        if kept is not None:
            self._kept.move_to_end(name)
            return kept
        turn = zlib.crc32(key.encode()) % len(self._pool)
        viewer = self._pool[turn] if sticky else min(self._pool, key=lambda each: each.waiting)
        if viewer.waiting > MAX_WAITING:
            detail = f"waiting views: must be at most {MAX_WAITING}, got {viewer.waiting}"
            raise Problem(503, detail, headers={"Retry-After": "1"})
        view = await anyio.to_thread.run_sync(
            self._look, viewer, work, key, order, limiter=viewer.turn
        )
        if name not in self._kept and len(view.body) < KEPT_BYTES // 16:
            self._kept[name] = view
            self._size += len(view.body) + len(name)
            while self._size > KEPT_BYTES:
                old, gone = self._kept.popitem(last=False)
                self._size -= len(gone.body) + len(old)
        return view

    def close(self) -> None:
        """End all processes."""
        for viewer in self._pool:
            viewer.close()

    def _look(self, viewer: Viewer, work: str, key: str, order: dict[str, Any]) -> View:
        path = self._copies.path(key)
        head, body = viewer.ask({"work": work, "path": str(path), **order})
        if "status" in head:
            errors = [FieldError(**entry) for entry in head["errors"]]
            raise Problem(head["status"], head["detail"], type_=head["type_"], errors=errors)
        return View(body, head.get("type", ""))


class Copies:
    """Files of the store on this machine: the store's own, or copies of a bucket's.

    Parameters
    ----------
    storage : Storage
    folder : Path
        Where copies go.
    limit : int
        Bytes above which the copies that were used least recently are deleted.
    """

    def __init__(self, storage: Storage, folder: Path, limit: int) -> None:
        self._storage = storage
        self._folder = folder
        self._limit = limit
        self._lock = threading.Lock()
        self._held: OrderedDict[str, Path] = OrderedDict()

    def path(self, key: str) -> Path:
        """Return a file with the bytes of an artefact.

        Raises
        ------
        Problem
            410 if the store no longer has it.
        """
        if isinstance(self._storage, FileStorage):
            if not self._storage.exists(key):
                raise Problem(410, "the file is gone")
            return self._storage.path(key).absolute()
        with self._lock:
            path = self._held.get(key)
            if path is None:
                if not self._storage.exists(key):
                    raise Problem(410, "the file is gone")
                folder = self._folder / hashlib.sha256(key.encode()).hexdigest()[:32]
                folder.mkdir(parents=True, exist_ok=True)
                path = self._held[key] = self._storage.local(key, folder)
            self._held.move_to_end(key)
            while len(self._held) > 1 and self._bytes() > self._limit:
                self._held.popitem(last=False)[1].unlink(missing_ok=True)
        return path

    def _bytes(self) -> int:
        return sum(path.stat().st_size for path in self._held.values())
