"""API and workers that share no disk: PostgreSQL holds the jobs, a bucket holds the files."""

import hashlib
import os
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from postgres import Postgres
from servers import ADRET, Server, wait_for

LONG = {"directions": 150, "method": "sweep"}
Start = Callable[[], "subprocess.Popen[bytes]"]


@pytest.fixture(scope="module")
def shared(postgres: Postgres, bucket: dict[str, str]) -> dict[str, str]:
    return {
        "ADRET_DATABASE_URL": postgres.url("machines"),
        **{f"ADRET_{name.upper()}": value for name, value in bucket.items()},
        "ADRET_LIVENESS_INTERVAL": "0.3",
        "ADRET_LIVENESS_GRACE": "0.5",
        "ADRET_QUEUE_POLL": "0.1",
    }


@pytest.fixture(scope="module")
def front(shared: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """The API alone."""
    server = Server(tmp_path_factory.mktemp("front") / "data", ADRET_ROLE="api", **shared)
    try:
        server.start(ready=False)
        yield server
    finally:
        server.stop()


@pytest.fixture
def start_worker(
    shared: dict[str, str], tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Start]:
    started: list[subprocess.Popen[bytes]] = []

    def start() -> "subprocess.Popen[bytes]":
        folder = tmp_path_factory.mktemp("machine")
        with (folder / "log").open("wb") as log:
            process = subprocess.Popen(
                [str(ADRET), "worker", "--data-dir", str(folder / "data")],
                env={**os.environ, **shared, "ADRET_THREADS_PER_JOB": "1"},
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


def test_a_job_moves_from_a_dead_machine_to_another(
    front: Server, start_worker: Start, example_dem: Path
) -> None:
    dataset = front.upload(example_dem).json()["id"]
    job = front.submit("sky-view", dataset=dataset, **LONG)
    assert front.status(job)["status"] == "accepted"
    first = start_worker()
    wait_for(lambda: front.status(job)["progress"] > 0, 60.0)
    first.kill()
    first.wait()
    start_worker()
    assert front.wait(job)["status"] == "successful"
    results = front.http.get(f"/jobs/{job}/results").json()
    content = front.http.get(results["result"]["href"]).content
    assert hashlib.sha256(content).hexdigest() == results["result"]["sha256"]
    part = front.http.get(results["result"]["href"], headers={"Range": "bytes=4-11"})
    assert (part.status_code, part.content) == (206, content[4:12])
    assert not list((front.data / "store").glob("**/*.tif")), "the API kept files of its own"


def test_jobs_outlive_a_database_that_goes_away(
    front: Server, start_worker: Start, example_dem: Path, postgres: Postgres
) -> None:
    dataset = front.upload(example_dem).json()["id"]
    start_worker()
    jobs = [front.submit("sky-view", dataset=dataset, **LONG, clip=clip) for clip in (True, False)]
    wait_for(lambda: front.status(jobs[0])["progress"] > 0, 60.0)
    postgres.stop("immediate")
    try:
        answer = front.http.get(f"/jobs/{jobs[0]}")
        assert answer.status_code == 503, answer.text
        assert int(answer.headers["retry-after"]) > 0
    finally:
        postgres.start()
    wait_for(lambda: front.http.get(f"/jobs/{jobs[0]}").status_code == 200, 10.0)
    for job in jobs:
        assert front.wait(job)["status"] == "successful"
