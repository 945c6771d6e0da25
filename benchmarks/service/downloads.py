"""How fast a large result comes, whole and by range, beside plain file servers; with what memory.

    python benchmarks/service/downloads.py

The same client reads the same bytes from the service, from nginx where it is installed, and from
Python's own http.server.
"""

import argparse
import contextlib
import hashlib
import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from common import DEM, record, resident, serving
from servers import Server, wait_for

PIECE = 1 << 20


def read(url: str, start: int, stop: int) -> int:
    """Read the bytes [start, stop) of a file over one connection; returns how many came."""
    parts = urlsplit(url)
    request = (
        f"GET {parts.path} HTTP/1.1\r\nHost: {parts.netloc}\r\n"
        f"Range: bytes={start}-{stop - 1}\r\nConnection: close\r\n\r\n"
    )
    buffer = bytearray(PIECE)
    with socket.create_connection((parts.hostname or "", parts.port or 80)) as connection:
        connection.sendall(request.encode())
        head = b""
        while b"\r\n\r\n" not in head:
            head += connection.recv(4096)
        head, _, rest = head.partition(b"\r\n\r\n")
        assert head.split()[1] in (b"206", b"200"), head
        came = len(rest)
        while got := connection.recv_into(buffer):
            came += got
    return came


class Memory(threading.Thread):
    """Watches the resident memory of a process."""

    def __init__(self, pid: int) -> None:
        super().__init__(daemon=True)
        self.pid, self.seen, self.over = pid, [resident(pid)], threading.Event()

    def run(self) -> None:
        while not self.over.wait(0.02):
            self.seen.append(resident(self.pid))


def timed(url: str, size: int, pieces: int) -> float:
    """Return the rate of reading a file in so many ranges, one after the other [MiB/s]."""
    began = time.perf_counter()
    came = 0
    for number in range(pieces):
        start, stop = size * number // pieces, size * (number + 1) // pieces
        came += read(url, start, stop)
    assert came == size, (came, size)
    return round(size / 2**20 / (time.perf_counter() - began), 1)


def big_result(server: Server, size: int) -> str:
    """Give a finished job an output of so many bytes, as a worker would; returns its address."""
    dataset = server.upload(DEM).json()["id"]
    job = server.submit("shadow", dataset=dataset)
    server.wait(job, "successful")
    folder = next((server.data / "store").glob(f"*/jobs/{job}"))
    noise = os.urandom(PIECE)
    digest = hashlib.sha256()
    with (folder / "draft").open("wb") as file:
        for _ in range(size // PIECE):
            file.write(noise)
            digest.update(noise)
    name = f"{digest.hexdigest()[:16]}-big.bin"
    (folder / "draft").rename(folder / name)
    manifest = json.loads((folder / "manifest.json").read_text())
    key = f"{folder.relative_to(server.data / 'store').as_posix()}/{name}"
    entry = {"key": key, "size": size, "sha256": digest.hexdigest(), "media_type": "image/tiff"}
    manifest["artefacts"]["result"] = entry
    (folder / "manifest.json").write_text(json.dumps(manifest))
    return f"{server.url}/jobs/{job}/results/result"


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextlib.contextmanager
def plain_python(folder: Path) -> Iterator[str]:
    """Serve a folder by http.server, which knows no ranges."""
    port = free_port()
    command = [sys.executable, "-m", "http.server", str(port), "--bind", "127.0.0.1"]
    with serving_process(command, folder, port) as url:
        yield url


@contextlib.contextmanager
def nginx(folder: Path) -> Iterator[str]:
    """Serve a folder by nginx, one worker."""
    port = free_port()
    scratch = Path(tempfile.mkdtemp(prefix="adret-nginx-"))
    config = scratch / "nginx.conf"
    user = "user root;" if os.getuid() == 0 else ""
    config.write_text(
        f"{user} daemon off; worker_processes 1;\n"
        f"pid {scratch}/pid; error_log {scratch}/error.log;\n"
        "events { worker_connections 64; }\n"
        f"http {{ access_log off; sendfile on; client_body_temp_path {scratch}/body;\n"
        f"proxy_temp_path {scratch}/proxy; fastcgi_temp_path {scratch}/fastcgi;\n"
        f"uwsgi_temp_path {scratch}/uwsgi; scgi_temp_path {scratch}/scgi;\n"
        f"server {{ listen 127.0.0.1:{port}; root {folder}; }} }}\n"
    )
    program = shutil.which("nginx") or "/usr/sbin/nginx"
    try:
        with serving_process([program, "-p", str(scratch), "-c", str(config)], folder, port) as url:
            yield url
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


@contextlib.contextmanager
def serving_process(command: list[str], folder: Path, port: int) -> Iterator[str]:
    quiet = subprocess.DEVNULL
    process = subprocess.Popen(command, cwd=folder, stdout=quiet, stderr=quiet)
    try:
        wait_for(lambda: answers(port), 10.0)
        yield f"http://127.0.0.1:{port}"
    finally:
        process.terminate()
        process.wait()


def answers(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--mebibytes", type=int, default=1024)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--keep", action="store_true", help="Write the results' file.")
    options = parser.parse_args()
    size = options.mebibytes * PIECE
    figures: dict[str, Any] = {"mebibytes": options.mebibytes, "mib_a_second": {}}
    with serving(ADRET_WORKERS="1") as server:
        url = big_result(server, size)
        file = next(server.data.glob("store/*/jobs/*/*-big.bin"))
        assert server.process is not None
        read(url, 0, PIECE)
        memory = Memory(server.process.pid)
        before = memory.seen[0]
        memory.start()
        rates: dict[str, list[float]] = {}
        with contextlib.ExitStack() as stack:
            rivals = {"http.server, whole": stack.enter_context(plain_python(file.parent))}
            if shutil.which("nginx") or Path("/usr/sbin/nginx").exists():
                rivals["nginx, whole"] = stack.enter_context(nginx(file.parent))
            for _ in range(options.repeat):
                rates.setdefault("adret, whole", []).append(timed(url, size, 1))
                rates.setdefault("adret, 128 ranges", []).append(timed(url, size, 128))
                for name, base in rivals.items():
                    rates.setdefault(name, []).append(timed(f"{base}/{file.name}", size, 1))
        memory.over.set()
        memory.join()
        figures["mib_a_second"] = {name: max(seen) for name, seen in rates.items()}
        figures["memory_mib"] = {
            "before": round(before / 2**20, 1),
            "most": round(max(memory.seen) / 2**20, 1),
        }
    if options.keep:
        record("downloads", figures)
    else:
        print(json.dumps(figures, indent=1))


if __name__ == "__main__":
    main()
