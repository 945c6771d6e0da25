"""A database that stops, a disk that fills up, a worker that freezes, a clock that jumps."""

import os
import shutil
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from email.utils import parsedate_to_datetime
from pathlib import Path

import httpx
import pytest
from postgres import Postgres
from servers import ADRET, Server, descendants, wait_for
from storm import Orders, half_files, left_over, nothing_wrong

pytestmark = pytest.mark.slow

LONG = {"directions": 600}


@contextmanager
def running(server: Server, *, ready: bool = True) -> Iterator[Server]:
    try:
        server.start(ready=ready)
        yield server
    finally:
        server.stop()


def test_a_database_that_stops_for_five_seconds_loses_nothing(
    postgres: Postgres, example_dem: Path, tmp_path: Path
) -> None:
    address = postgres.url("outage")
    shared = {"ADRET_DATABASE_URL": address, "ADRET_LIVENESS_GRACE": "3"}
    workers = {"ADRET_WORKERS": "2", "ADRET_THREADS_PER_JOB": "1"}
    with running(Server(tmp_path / "data", **shared, **workers)) as server:
        orders = Orders(server, example_dem, 30)
        orders.prepare()
        ordering = orders.start()
        orders.allow(0.5)
        wait_for(lambda: server.http.get("/jobs?status=running").json()["jobs"] != [], 60.0)
        postgres.stop("immediate")
        try:
            orders.allow(0.5)
            answers = []
            end = time.monotonic() + 5.0
            while time.monotonic() < end:
                answer = server.http.get("/jobs")
                answers.append((answer.status_code, "retry-after" in answer.headers))
                time.sleep(0.1)
        finally:
            postgres.start()
        assert set(answers) == {(503, True)}
        ordering.join(120.0)
        orders.wait_for_all(200.0)
        account = orders.account()
        assert nothing_wrong(account), account


def mounted(folder: Path, size: int) -> None:
    """Mount a small file system in memory, or skip."""
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)]
    if shutil.which("mount") is None or subprocess.run(command, capture_output=True).returncode:
        pytest.skip("a small file system cannot be mounted here")


def fill(ballast: Path) -> None:
    """Take all the space that is left."""
    with ballast.open("wb", buffering=0) as file:
        for piece in (1 << 20, 1 << 12, 1):
            while True:
                try:
                    file.write(bytes(piece))
                except OSError:
                    break


def test_a_disk_that_is_full_delays_jobs_and_loses_nothing(
    example_dem: Path, tmp_path: Path
) -> None:
    disk = tmp_path / "disk"
    mounted(disk, 64 << 20)
    ballast = disk / "ballast"
    try:
        with running(Server(disk / "data")) as server:
            orders = Orders(server, example_dem, 12)
            orders.prepare()
            ordering = orders.start()
            orders.allow(0.5)
            wait_for(lambda: server.http.get("/jobs?status=running").json()["jobs"] != [], 60.0)
            fill(ballast)
            with httpx.Client(base_url=server.url, timeout=30.0) as client:
                refused = client.post("/uploads", files={"file": ("a.tif", bytes(1 << 20))})
                assert refused.status_code == 507, refused.text
                assert client.get("/healthz").status_code == 200
            time.sleep(10.0)
            assert half_files(server.data / "store") == []
            ballast.unlink()
            orders.allow(0.5)
            ordering.join(120.0)
            orders.wait_for_all(200.0)
            wait_for(lambda: left_over(server.data) == [], 10.0, server.log)
            account = orders.account()
            assert nothing_wrong(account), account
    finally:
        subprocess.run(["umount", "--lazy", str(disk)], check=False)


@pytest.fixture
def start_worker(tmp_path: Path) -> Iterator[Callable[..., "subprocess.Popen[bytes]"]]:
    started: list[subprocess.Popen[bytes]] = []

    def start(data: Path, **environment: str) -> "subprocess.Popen[bytes]":
        log = (tmp_path / f"worker-{len(started)}.log").open("wb")
        with log:
            process = subprocess.Popen(
                [str(ADRET), "worker", "--data-dir", str(data)],
                env={**os.environ, **environment, "ADRET_THREADS_PER_JOB": "1"},
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
            )
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.wait()


def test_a_frozen_worker_that_wakes_after_the_take_over_corrupts_nothing(
    postgres: Postgres,
    example_dem: Path,
    tmp_path: Path,
    start_worker: Callable[..., "subprocess.Popen[bytes]"],
) -> None:
    """It is stopped in mid job, the database loses sight of it, another one does the job."""
    shared = {
        "ADRET_DATABASE_URL": postgres.url("frozen"),
        "ADRET_LIVENESS_INTERVAL": "0.3",
        "ADRET_LIVENESS_GRACE": "0.5",
        "ADRET_QUEUE_POLL": "0.1",
    }
    data = tmp_path / "data"
    with running(Server(data, ADRET_ROLE="api", **shared), ready=False) as server:
        dataset = server.upload(example_dem).json()["id"]
        sleeper = start_worker(data, **shared)
        job = server.submit("sky-view", dataset=dataset, **LONG)
        wait_for(lambda: server.status(job)["progress"] > 0, 60.0)
        whole = [sleeper.pid, *descendants(sleeper.pid)]
        for pid in whole:
            os.kill(pid, signal.SIGSTOP)
        postgres.drop_sessions("frozen")  # the API's own come back by themselves
        start_worker(data, **shared)
        assert server.wait(job, seconds=90.0)["status"] == "successful"
        before = server.http.get(f"/jobs/{job}/results").json()["result"]["sha256"]
        for pid in whole:
            os.kill(pid, signal.SIGCONT)
        after = server.submit("sky-view", dataset=dataset, **LONG, clip=False)
        assert server.wait(after, seconds=90.0)["status"] == "successful"
        time.sleep(5.0)  # what the sleeper still wants to say
        results = server.http.get(f"/jobs/{job}/results").json()
        assert results["result"]["sha256"] == before
        assert half_files(server.data / "store") == []
        assert len(server.http.get(results["result"]["href"]).content) > 0
        told = [line.get("status") for line in server.http.get(f"/jobs/{job}/logs").json()["logs"]]
        assert told.count("successful") == 1
        assert sleeper.poll() is None, "the sleeper died"


@pytest.fixture(scope="module")
def calendar(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A library that shifts a process's calendar clock, and nothing else of its time."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler to build the clock with")
    library = tmp_path_factory.mktemp("clock") / "calendar.so"
    source = Path(__file__).with_name("calendar.c")
    command = [compiler, "-O2", "-shared", "-fPIC", "-o", str(library), str(source), "-ldl", "-lm"]
    subprocess.run(command, check=True)
    return library


def set_clock(path: Path, seconds: float) -> None:
    with path.open("r+b" if path.exists() else "wb") as file:
        file.write(struct.pack("d", seconds))


def ahead(server: Server) -> float:
    """Seconds by which the server's calendar runs before ours."""
    date = server.http.get("/").headers["date"]
    return parsedate_to_datetime(date).timestamp() - time.time()


def test_the_shifted_clock_is_the_calendar_alone(calendar: Path, tmp_path: Path) -> None:
    set_clock(tmp_path / "shift", 7200.0)
    code = (
        "import time; began = time.monotonic(); time.sleep(0.05);"
        "print(time.time(), time.monotonic() - began)"
    )
    environment = {"LD_PRELOAD": str(calendar), "CALENDAR_SHIFT": str(tmp_path / "shift")}
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | environment,
        check=True,
        capture_output=True,
        text=True,
    )
    calendar_time, slept = map(float, done.stdout.split())
    assert abs(calendar_time - time.time() - 7200.0) < 5.0
    assert 0.05 <= slept < 5.0


@pytest.mark.parametrize("jump", [3600.0, -3600.0])
def test_a_clock_that_jumps_an_hour_stops_nothing(
    jump: float, calendar: Path, example_dem: Path, tmp_path: Path
) -> None:
    clock = tmp_path / "clock"
    set_clock(clock, 0.0)
    faked = {"LD_PRELOAD": str(calendar), "CALENDAR_SHIFT": str(clock)}
    with running(Server(tmp_path / "data", **faked)) as server:
        orders = Orders(server, example_dem, 15)
        orders.prepare()
        ordering = orders.start()
        orders.allow(0.5)
        wait_for(lambda: server.http.get("/jobs?status=running").json()["jobs"] != [], 60.0)
        set_clock(clock, jump)
        wait_for(lambda: abs(ahead(server) - jump) < 10.0, 5.0)
        worker = server.children("adret_service.worker")[0]
        orders.allow(0.5)
        wait_for(lambda: server.http.get("/jobs?status=running").json()["jobs"] != [], 60.0)
        os.kill(worker, signal.SIGKILL)
        orders.allow(0.1)
        ordering.join(120.0)
        orders.wait_for_all(200.0)
        account = orders.account()
        assert nothing_wrong(account), account
