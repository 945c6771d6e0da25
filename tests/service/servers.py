"""Real server processes on free ports, and small rasters to send them."""

import contextlib
import os
import signal
import socket
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial, partialmethod
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import rasterio
from anyio.from_thread import start_blocking_portal
from fastapi import FastAPI

ADRET = Path(sys.executable).with_name("adret")


class Server:
    """One `adret serve` process; `url` is its address, `data` its folder."""

    def __init__(self, data: Path, program: Path = ADRET, **environment: str) -> None:
        self.data = data
        self.program = program
        self.environment = environment
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        self.url = f"http://127.0.0.1:{self.port}"
        self.http = httpx.Client(base_url=self.url, timeout=30.0)
        self.process: subprocess.Popen[bytes] | None = None
        self.log = data / "server.log"

    def start(self, *, ready: bool = True) -> None:
        """Start the process and wait until it takes jobs (or at least answers)."""
        self.data.mkdir(exist_ok=True)
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(
                [
                    str(self.program),
                    "serve",
                    "--port",
                    str(self.port),
                    "--data-dir",
                    str(self.data),
                ],
                env={
                    **os.environ,
                    "ADRET_LIVENESS_INTERVAL": "0.3",
                    "ADRET_QUEUE_POLL": "0.1",
                    "ADRET_MIN_FREE_BYTES": "0",
                    "ADRET_COMPUTE_NICE": "0",
                    **self.environment,
                },
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
            )
        path = "/readyz" if ready else "/healthz"
        wait_for(lambda: self.ended() or self.answers(path), 60.0, self.log)
        assert not self.ended(), self.log.read_text(errors="replace")[-3000:]

    def ended(self) -> bool:
        """Whether the server process has ended by itself."""
        return self.process is not None and self.process.poll() is not None

    def answers(self, path: str) -> bool:
        """Whether the server answers 200 there."""
        try:
            return self.http.get(path).status_code == 200
        except httpx.TransportError:
            return False

    def kill(self) -> None:
        """Kill the server process as a power cut would."""
        assert self.process is not None
        self.process.kill()
        self.process.wait()
        self.process = None

    def stop(self) -> None:
        """Stop the server in peace."""
        if self.process is not None:
            self.process.send_signal(signal.SIGTERM)
            self.process.wait(20.0)
            self.process = None
        self.http.close()

    def children(self, module: str) -> list[int]:
        """Process ids of this server's descendants that run a module of the service."""
        assert self.process is not None
        return [
            pid for pid in descendants(self.process.pid) if module.encode() in command_line(pid)
        ]

    def upload(self, path: Path, **options: Any) -> httpx.Response:
        """Send a raster as a multipart form."""
        with path.open("rb") as file:
            return self.http.post("/uploads", files={"file": (path.name, file)}, params=options)

    def submit(self, process: str, **inputs: Any) -> str:
        """Order a computation and return the job's id."""
        answer = self.http.post(f"/processes/{process}/execution", json={"inputs": inputs})
        assert answer.status_code == 201, answer.text
        return str(answer.json()["jobID"])

    def status(self, job: str) -> dict[str, Any]:
        """Return the job's status."""
        return dict(self.http.get(f"/jobs/{job}").json())

    def wait(self, job: str, *states: str, seconds: float = 60.0) -> dict[str, Any]:
        """Wait until the job is in one of these states (default: finished)."""
        wanted = states or ("successful", "failed", "dismissed")
        wait_for(lambda: self.status(job)["status"] in wanted, seconds, self.log)
        return self.status(job)


class AppClient:
    """The application in this process, called over httpx's ASGI transport from sync code."""

    def __init__(self, app: FastAPI) -> None:
        self.app = app
        self._stack = contextlib.ExitStack()

    def __enter__(self) -> "AppClient":
        """Start the application."""
        self._portal = self._stack.enter_context(start_blocking_portal())
        lifespan = self.app.router.lifespan_context(self.app)
        self._stack.enter_context(self._portal.wrap_async_context_manager(lifespan))
        transport = httpx.ASGITransport(self.app, raise_app_exceptions=False)
        client = httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1")
        self._client = self._stack.enter_context(self._portal.wrap_async_context_manager(client))
        return self

    def __exit__(self, *_: object) -> None:
        """Stop the application."""
        self._stack.close()

    def request(self, method: str, url: str, **options: Any) -> httpx.Response:
        """Send one request."""
        return self._portal.call(partial(self._client.request, method, url, **options))

    get = partialmethod(request, "GET")
    put = partialmethod(request, "PUT")
    post = partialmethod(request, "POST")
    delete = partialmethod(request, "DELETE")


def wait_for(condition: Callable[[], bool], seconds: float, log: Path | None = None) -> float:
    """Wait until `condition` holds; returns how long it took [s]."""
    began = time.monotonic()
    while not condition():
        if time.monotonic() - began > seconds:
            tail = log.read_text(errors="replace")[-3000:] if log and log.exists() else ""
            raise AssertionError(f"nothing after {seconds} s\n{tail}")
        time.sleep(0.02)
    return time.monotonic() - began


def freeze(pid: int, data: Path) -> None:
    """Stop a process as a debugger would, at a moment when it holds no lock of a SQLite file.

    One that is stopped in the middle of a write keeps everybody from writing until it wakes or is
    killed: that is SQLite's bargain, and not what the callers look at.
    """
    while True:
        os.kill(pid, signal.SIGSTOP)
        try:
            for path in data.glob("*.db"):
                with contextlib.closing(sqlite3.connect(path, timeout=2.0)) as connection:
                    connection.execute("BEGIN IMMEDIATE")
                    connection.rollback()
            return
        except sqlite3.OperationalError:
            os.kill(pid, signal.SIGCONT)
            time.sleep(0.05)


def descendants(pid: int) -> list[int]:
    """Process ids of the children of a process, and of theirs; threads may end meanwhile."""
    ended = contextlib.suppress(FileNotFoundError, ProcessLookupError)
    children: list[int] = []
    with ended:
        for task in os.listdir(f"/proc/{pid}/task"):
            with ended:
                text = Path(f"/proc/{pid}/task/{task}/children").read_text()
                children += map(int, text.split())
    return [each for child in children for each in (child, *descendants(child))]


def gone(pid: int) -> bool:
    """Whether a process has ended, even if nobody has collected its status yet."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"
    except (FileNotFoundError, ProcessLookupError):
        return True


def command_line(pid: int) -> bytes:
    """Command line of a process; empty once it is gone."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except (FileNotFoundError, ProcessLookupError):
        return b""


def hill(rows: int, columns: int) -> Any:
    """A round hill with one cell of nodata."""
    y, x = np.mgrid[:rows, :columns].astype(np.float32)
    heights = 500.0 * np.exp(-((y - rows / 2) ** 2 + (x - columns / 2) ** 2) / 200.0)
    heights[3, 4] = np.nan
    return heights.astype(np.float32)


def write_dem(path: Path, heights: Any, **profile: Any) -> Path:
    """Write a GeoTIFF in UTM."""
    rows, columns = heights.shape
    settings = {
        "driver": "GTiff",
        "height": rows,
        "width": columns,
        "count": 1,
        "dtype": heights.dtype.name,
        "crs": "EPSG:32632",
        "transform": rasterio.Affine(30.0, 0.0, 4e5, 0.0, -30.0, 5e6),
        **profile,
    }
    with rasterio.open(path, "w", **settings) as target:
        target.write(heights, 1)
    return path
