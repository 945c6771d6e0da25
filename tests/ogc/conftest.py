"""A real server that offers the echo process and may call back to this machine."""

import json
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

sys.path.append(str(Path(__file__).resolve().parents[1] / "service"))

from servers import Server, hill, wait_for, write_dem

SECRET = "a secret of the tests"


@dataclass
class Receiver:
    """Takes callbacks; `answers` are the statuses of the next ones, then 202."""

    port: int = 0
    got: list[tuple[str, dict[str, str], bytes]] = field(default_factory=list)
    answers: list[int] = field(default_factory=list)

    def url(self, path: str) -> str:
        """Address of one of its paths."""
        return f"http://127.0.0.1:{self.port}{path}"

    def at(self, path: str) -> list[dict[str, Any]]:
        """Bodies that came to a path."""
        return [json.loads(body) for where, _, body in list(self.got) if where == path]


@pytest.fixture(scope="session")
def receiver() -> Iterator[Receiver]:
    """An HTTP server that takes callbacks."""
    receiver = Receiver()

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["Content-Length"]))
            receiver.got.append((self.path, dict(self.headers), body))
            status = receiver.answers.pop(0) if receiver.answers else 202
            self.send_response(status)
            if status == 302:
                self.send_header("Location", receiver.url("/elsewhere"))
            self.send_header("Content-Length", "0")
            self.end_headers()

        def log_message(self, *_: Any) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    receiver.port = server.server_address[1]
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield receiver
    server.shutdown()
    server.server_close()


@pytest.fixture(scope="session")
def ogc(tmp_path_factory: pytest.TempPathFactory, receiver: Receiver) -> Iterator[Server]:
    """The server under test."""
    server = Server(
        tmp_path_factory.mktemp("ogc") / "data",
        ADRET_ENABLE_ECHO="1",
        ADRET_WEBHOOK_HOSTS=f"127.0.0.1:{receiver.port}",
        ADRET_WEBHOOK_SECRET=SECRET,
        ADRET_WEBHOOK_ALLOW_PRIVATE="1",
        ADRET_WEBHOOK_PAUSE="0.1",
        ADRET_WEBHOOK_ATTEMPTS="3",
        ADRET_SYNC_MAX_CELLS="10000",
    )
    try:
        server.start()
        yield server
    finally:
        server.stop()


@pytest.fixture(scope="session")
def terrain(ogc: Server, tmp_path_factory: pytest.TempPathFactory) -> str:
    """A dataset of 40 x 50 cells."""
    dem = write_dem(tmp_path_factory.mktemp("dem") / "small.tif", hill(40, 50))
    return str(ogc.upload(dem).json()["id"])


@pytest.fixture
def execute(ogc: Server) -> Callable[..., Any]:
    """Send an order to the echo process."""

    def send(prefer: str | None = None, process: str = "echo", **order: Any) -> Any:
        headers = {} if prefer is None else {"Prefer": prefer}
        return ogc.http.post(f"/processes/{process}/execution", json=order, headers=headers)

    return send


@pytest.fixture
def finished(ogc: Server) -> Callable[..., dict[str, Any]]:
    """Wait for the job that an answer names; returns its status."""

    def wait(answer: Any, seconds: float = 30.0) -> dict[str, Any]:
        location = answer.headers["location"]
        done = ("successful", "failed", "dismissed")
        wait_for(lambda: ogc.http.get(location).json()["status"] in done, seconds, ogc.log)
        return dict(ogc.http.get(location).json())

    return wait
