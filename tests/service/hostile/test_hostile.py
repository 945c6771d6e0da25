"""A corpus of hostile files and requests against one server that is watched all the time."""

import http.client
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hostile_files import FILES, HARMLESS, SECRET
from hostile_requests import LINES, REQUESTS
from servers import ADRET, Server, descendants, wait_for
from watching import CALLS, Memory, Trace, left_behind, settled

STRACE = shutil.which("strace")
SECONDS = 5.0
GIB = 1 << 30
LIMITS = {
    "ADRET_ROLE": "api",
    "ADRET_MAX_UPLOAD_BYTES": str(8 << 20),
    "ADRET_MAX_PIXELS": str(30_000_000),
    "ADRET_RATIO_FLOOR_BYTES": str(1 << 20),
    "ADRET_UPLOAD_IDLE": "1",
}


class Watched(Server):
    """A server below strace, if there is one; `trace` is what it wrote."""

    def start(self, *, ready: bool = True) -> None:
        self.data.mkdir(exist_ok=True)
        self.trace = self.data.parent / "trace.txt"
        command = [str(ADRET), "serve", "--port", str(self.port), "--data-dir", str(self.data)]
        if STRACE is not None:
            watch = [STRACE, "-f", "-qq", "--seccomp-bpf", "-s", "300", "-e", f"trace={CALLS}"]
            command = [*watch, "-o", str(self.trace), *command]
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(
                command,
                env={"PATH": "/usr/bin:/bin", "ADRET_MIN_FREE_BYTES": "0", **self.environment},
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
            )
        wait_for(lambda: self.ended() or self.answers("/healthz"), 60.0, self.log)
        assert not self.ended(), self.log.read_text(errors="replace")[-3000:]

    def stop(self) -> None:
        """Stop the server itself: strace ends with it."""
        assert self.process is not None
        mains = descendants(self.process.pid)[:1] if STRACE is not None else [self.process.pid]
        os.kill(mains[0], signal.SIGTERM)
        self.process.wait(30.0)
        self.process = None
        self.http.close()


class Listener:
    """A port that nobody may call."""

    def __init__(self) -> None:
        self.socket = socket.create_server(("127.0.0.1", 0))
        self.socket.settimeout(0.0)
        self.address = f"http://127.0.0.1:{self.socket.getsockname()[1]}"

    def called(self) -> bool:
        try:
            self.socket.accept()[0].close()
        except BlockingIOError:
            return False
        return True


@pytest.fixture(scope="module")
def listener() -> Iterator[Listener]:
    listener = Listener()
    yield listener
    listener.socket.close()


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Watched]:
    server = Watched(tmp_path_factory.mktemp("hostile") / "data", **LIMITS)
    try:
        server.start()
        yield server
    finally:
        server.stop()


@pytest.fixture(scope="module")
def memory(watched: Watched) -> Iterator[Memory]:
    assert watched.process is not None
    with Memory(watched.process.pid) as memory:
        yield memory


def harmless(server: Watched, body: bytes, query: dict[str, Any]) -> Any:
    headers = {"Content-Disposition": 'attachment; filename="/vsicurl/http://x/../dem.tif"'}
    return server.http.post("/uploads", content=body, params=query, headers=headers)


def test_the_corpus_is_large_enough() -> None:
    assert len(FILES) + len(REQUESTS) + len(LINES) >= 60
    assert len(FILES) >= 60


@pytest.mark.parametrize("name", HARMLESS)
def test_what_is_odd_but_readable_is_taken(
    name: str, watched: Watched, memory: Memory, listener: Listener, tmp_path: Path
) -> None:
    before = left_behind(watched.data)
    answer = harmless(watched, HARMLESS[name](tmp_path, listener.address), {})
    assert answer.status_code == 201, answer.text
    assert answer.json()["highest"] == 63.0
    assert watched.http.delete(f"/datasets/{answer.json()['id']}").status_code == 204
    assert settled(watched.data, before)


@pytest.mark.parametrize("name", FILES)
def test_a_hostile_file_is_refused_and_leaves_nothing(
    name: str, watched: Watched, memory: Memory, listener: Listener, tmp_path: Path
) -> None:
    query, status, field, build = FILES[name]
    body = build(tmp_path, listener.address)
    before = left_behind(watched.data)
    began = time.monotonic()
    answer = harmless(watched, body, query)
    assert time.monotonic() - began < SECONDS
    assert answer.status_code == status, answer.text
    told = answer.json()
    assert [error["field"] for error in told["errors"]] == [field], told
    assert told["errors"][0]["limit"]
    assert "value" in told["errors"][0]
    for leak in (SECRET, str(watched.data), str(tmp_path), "Traceback", "adret_service"):
        assert leak not in answer.text
    assert settled(watched.data, before)
    assert memory.most < GIB


@pytest.mark.parametrize("name", REQUESTS)
def test_a_hostile_request_is_refused_and_leaves_nothing(
    name: str, watched: Watched, memory: Memory
) -> None:
    method, path, headers, body, status, field = REQUESTS[name]
    before = left_behind(watched.data)
    began = time.monotonic()
    connection = http.client.HTTPConnection("127.0.0.1", watched.port, timeout=SECONDS)
    connection.request(method, path, body, headers)
    answer = connection.getresponse()
    text = answer.read().decode()
    connection.close()
    assert time.monotonic() - began < SECONDS
    assert answer.status == status, text
    if field is not None:
        assert f'"field":"{field}"' in text, text
        assert '"limit":"' in text
    assert "Traceback" not in text
    assert settled(watched.data, before)
    assert memory.most < GIB


@pytest.mark.parametrize("name", LINES)
def test_a_request_that_breaks_the_protocol_is_refused(
    name: str, watched: Watched, memory: Memory
) -> None:
    pieces, pause, wanted = LINES[name]
    before = left_behind(watched.data)
    began = time.monotonic()
    with socket.create_connection(("127.0.0.1", watched.port), timeout=SECONDS) as line:
        try:
            for piece in pieces:
                line.sendall(piece)
                time.sleep(pause)
        except (BrokenPipeError, ConnectionResetError):
            assert wanted in (b"", b"4"), "it hung up before everything was sent"
        got = b""
        try:
            while b"\r\n\r\n" not in got and (data := line.recv(65536)):
                got += data
        except ConnectionResetError:
            assert wanted in (b"", b"4")
    assert time.monotonic() - began < SECONDS
    assert got.startswith(b"HTTP/1.1 " + wanted) if wanted else got == b"", got
    assert settled(watched.data, before)


def test_the_server_still_works_and_stayed_small(
    watched: Watched, memory: Memory, listener: Listener, tmp_path: Path
) -> None:
    assert watched.answers("/healthz")
    answer = harmless(watched, next(iter(HARMLESS.values()))(tmp_path, ""), {})
    assert answer.status_code == 201
    assert memory.most < GIB, f"{memory.most / GIB:.2f} GiB"
    print(f"most memory: {memory.most / (1 << 20):.0f} MiB")
    assert not listener.called()
    assert not Path("/tmp/adret-was-here").exists()


@pytest.mark.skipif(STRACE is None, reason="strace is not installed")
def test_the_decoders_children_open_their_one_file_and_no_socket(
    watched: Watched, memory: Memory
) -> None:
    trace = Trace(watched.trace)
    assert len(trace.children) > 50, "every upload has a child of its own"
    assert trace.sockets == []
    assert trace.started == []
    assert trace.connected == [], "nothing of the server calls anybody"
    prefixes = (
        sys.prefix,
        sys.base_prefix,
        str(Path(__file__).resolve().parents[3] / "core"),
        str(Path(__file__).resolve().parents[3] / "service"),
        "/usr/",
        "/lib",
        "/proc/",
        "/sys/",
        "/dev/null",
        "/etc/ld.so.cache",
    )
    scratch = f"{watched.data}/tmp/"
    others = {
        path
        for path in trace.opened
        if path.startswith("/") and not path.startswith((*prefixes, scratch))
    }
    assert others == set()
    own = {path for path in trace.opened if not path.startswith("/")}
    own |= {path.rsplit("/", 1)[1] for path in trace.opened if path.startswith(scratch)}
    assert own <= {"upload", "heights.tif"}, own
