"""The gate: what comes in is received, decoded by a confined child, and catalogued."""

import hashlib
import json
import os
import queue
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from adret_service.datasets import Dataset, DatasetCatalogue
from adret_service.ids import new_id
from adret_service.problems import FieldError, Problem, too_large
from adret_service.receiving import Received
from adret_service.settings import Settings
from adret_service.storage import HEIGHTS

__all__ = ["Ingest", "ReadOptions"]

DIED = "the decoder died"
KEPT_ENVIRONMENT = {"PATH", "LANG", "LC_ALL", "PYTHONPATH", "LD_LIBRARY_PATH"}


class ReadOptions(BaseModel):
    """How to read a file that does not say everything itself."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    band: int = Field(default=1, ge=1, le=1000, description="Band that holds the heights.")
    cell_size: list[float] | None = Field(
        default=None,
        min_length=1,
        max_length=2,
        description="Ground width and height of a cell [m], for files without a geotransform.",
    )
    vertical_unit: str | None = Field(
        default=None, max_length=32, description="Unit of the heights, if not the file's own."
    )
    georeference: str | None = Field(
        default=None,
        max_length=2048,
        description="Place of a .npy or .npz array: a JSON object with crs (such as EPSG:2056), "
        "transform [a, b, c, d, e, f] and nodata.",
    )
    camera: str | None = Field(
        default=None,
        max_length=8192,
        description="The file is a depth buffer that this camera saw: a JSON object with width, "
        "height, fov_y_deg (or fx, fy, cx, cy, or extent), kind (linear, distance, device), "
        "near, far, guard_band and so on.",
    )


class Ingest:
    """Receives and decodes; safe to call from several threads.

    Parameters
    ----------
    settings : Settings
        Limits.
    catalogue : DatasetCatalogue
        Where datasets go.
    scratch : Path
        Folder of this process for uploads in progress.
    """

    def __init__(self, settings: Settings, catalogue: DatasetCatalogue, scratch: Path) -> None:
        self.settings = settings
        self.catalogue = catalogue
        self.scratch = scratch
        self.decoder = Decoder()
        self._slots = threading.BoundedSemaphore(settings.ingest_slots)

    @contextmanager
    def folder(self) -> Iterator[Path]:
        """Yield a private folder that is gone afterwards."""
        folder = self.scratch / f"upload-{new_id()}"
        folder.mkdir(mode=0o700)
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def register(self, tenant: str, received: Received, options: ReadOptions) -> Dataset:
        """Decode a received upload into a dataset; an equal upload gives the same dataset.

        Raises
        ------
        Problem
            400, 413 or 415 with field, limit and value; 503 if all decoders stay busy.
        """
        fingerprint = fingerprint_of(received.sha256, options)
        twin = self.catalogue.find(tenant, fingerprint)
        if twin is not None:
            return twin
        if self.settings.auth != "none":
            self._check_quota(tenant, received.size)
        if not self._slots.acquire(timeout=self.settings.ingest_timeout):
            raise Problem(503, "all decoders are busy", headers={"Retry-After": "10"})
        try:
            info = self._decode(received.path.parent, options)
        finally:
            self._slots.release()
        return self.catalogue.add(
            tenant,
            received.path.parent / HEIGHTS,
            sha256=fingerprint,
            name=received.name,
            upload_bytes=received.size,
            info=info,
        )

    def _check_quota(self, tenant: str, size: int) -> None:
        total = self.catalogue.stored_bytes(tenant) + size
        if total > self.settings.tenant_max_bytes:
            raise too_large("bytes", f"at most {self.settings.tenant_max_bytes} in all", total)

    def _decode(self, folder: Path, options: ReadOptions) -> dict[str, Any]:
        settings = self.settings
        limits = {
            "memory": settings.ingest_memory,
            "seconds": settings.ingest_timeout,
            "file_bytes": 8 * settings.max_pixels + (1 << 24),
            "max_pixels": settings.max_pixels,
            "max_dim": settings.max_dim,
            "max_bands": settings.max_bands,
            "max_block_bytes": settings.max_block_bytes,
            "max_ratio": settings.max_ratio,
            "ratio_floor_bytes": settings.ratio_floor_bytes,
            "exr": settings.allow_exr,
        }
        asked = options.model_dump()
        if options.cell_size is not None and len(options.cell_size) == 1:
            asked["cell_size"] = options.cell_size * 2
        order = {"folder": str(folder.absolute()), "limits": limits, "options": asked}
        end = self.decoder.ask(order, settings.ingest_timeout)
        if end["answer"]:
            answer = json.loads(end["answer"])
            if "info" in answer:
                return dict(answer["info"])
            refused = answer["refused"]
        else:
            limit = f"decodable within {settings.ingest_timeout:g} s and {limits['memory']} bytes"
            value = f"a file that ends the decoder ({end['exit']})"
            refused = {"status": 400, "field": "file", "limit": limit, "value": value}
        error = FieldError(refused["field"], refused["limit"], refused["value"])
        raise Problem(refused["status"], str(error), errors=[error])


class Decoder:
    """The decoder process as its user sees it; started when needed, again when it has died."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: subprocess.Popen[str] | None = None
        self._waiting: dict[str, queue.Queue[dict[str, Any]]] = {}

    def start(self) -> None:
        """Start the process unless it runs."""
        with self._lock:
            if self._process is not None and self._process.poll() is None:
                return
            self._process = subprocess.Popen(
                [sys.executable, "-m", "adret_service.decoder"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                env={k: v for k, v in os.environ.items() if k in KEPT_ENVIRONMENT}
                | {"OPENBLAS_NUM_THREADS": "1"},
                start_new_session=True,
            )
            threading.Thread(target=self._read, args=(self._process,), daemon=True).start()

    def ask(self, order: dict[str, Any], seconds: float) -> dict[str, Any]:
        """Have an order done; returns the child's last word, {"exit": ..., "answer": str}."""
        end = self._ask_once(order, seconds)
        # The process may have died for another order's sake; a second death is this order's.
        return self._ask_once(order, seconds) if end["exit"] == DIED else end

    def _ask_once(self, order: dict[str, Any], seconds: float) -> dict[str, Any]:
        name = new_id()
        answers: queue.Queue[dict[str, Any]] = queue.Queue()
        self._waiting[name] = answers
        try:
            self.start()
            self._send(order | {"order": name})
            try:
                return answers.get(timeout=seconds)
            except queue.Empty:
                self._send({"kill": name})
                return {"exit": f"killed after {seconds:g} s", "answer": ""}
        except BrokenPipeError:
            return {"exit": DIED, "answer": ""}
        finally:
            del self._waiting[name]

    def close(self) -> None:
        """End the process and its children."""
        with self._lock:
            process, self._process = self._process, None
        if process is not None and process.stdin is not None:
            if not self._waiting:
                process.kill()
            process.stdin.close()
            try:
                process.wait(2.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def _send(self, message: dict[str, Any]) -> None:
        with self._lock:
            if self._process is None or self._process.stdin is None:
                raise BrokenPipeError
            self._process.stdin.write(json.dumps(message) + "\n")
            self._process.stdin.flush()

    def _read(self, process: "subprocess.Popen[str]") -> None:
        assert process.stdout is not None
        with process.stdout:
            for line in process.stdout:
                ended = json.loads(line)
                answers = self._waiting.get(ended["order"])
                if answers is not None:
                    answers.put(ended)
        for answers in list(self._waiting.values()):
            answers.put({"exit": DIED, "answer": ""})


def fingerprint_of(sha256: str, options: ReadOptions) -> str:
    """Return the digest that tells datasets apart: the file's own, unless it is read specially."""
    if options == ReadOptions():
        return sha256
    left_out = {"georeference"} if options.georeference is None else None
    read_as = options.model_dump_json(exclude=left_out)
    return hashlib.sha256(f"{sha256} {read_as}".encode()).hexdigest()
