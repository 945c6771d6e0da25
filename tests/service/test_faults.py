"""Kill -9 of computing processes, workers and servers: no accepted job is lost or done wrong."""

import hashlib
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from servers import Server, freeze, gone, wait_for

# Long enough to be killed in the middle, short enough to be waited for.
LONG = {"directions": 300, "method": "sweep"}


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A server that the tests may kill, as long as they start it again."""
    server = Server(tmp_path_factory.mktemp("faults") / "data")
    try:
        server.start()
        yield server
    finally:
        server.stop()


@pytest.fixture(scope="module")
def expected(server: Server, dataset: str) -> str:
    """Digest of the raster that an undisturbed server makes of the long order."""
    job = server.submit("sky-view", dataset=dataset, **LONG)
    assert server.wait(job)["status"] == "successful"
    return digest_of(server, job)


def start_long_job(server: Server, dem: Path) -> str:
    dataset = server.upload(dem).json()["id"]
    job = server.submit("sky-view", dataset=dataset, **LONG)
    wait_for(lambda: server.status(job)["progress"] > 0, 30.0, server.log)
    assert server.status(job)["status"] == "running"
    return job


def digest_of(server: Server, job: str) -> str:
    results = server.http.get(f"/jobs/{job}/results").json()
    content = server.http.get(results["result"]["href"]).content
    found = hashlib.sha256(content).hexdigest()
    assert found == results["result"]["sha256"]
    return found


def leftovers(server: Server) -> list[Path]:
    """Work in progress that no live process owns."""
    return [p for p in (server.data / "tmp").glob("*/*") if not p.name.startswith("upload-")]


def test_a_killed_computing_process_costs_nothing_but_time(
    own: Server, example_dem: Path, expected: str
) -> None:
    job = start_long_job(own, example_dem)
    os.kill(own.children("adret_service.compute")[0], signal.SIGKILL)
    assert own.wait(job)["status"] == "successful"
    assert digest_of(own, job) == expected


def test_a_killed_worker_is_replaced_and_its_jobs_are_finished(
    own: Server, example_dem: Path, expected: str
) -> None:
    job = start_long_job(own, example_dem)
    waiting = own.submit("shadow", dataset=own.status(job)["inputs"]["dataset"])
    compute = own.children("adret_service.compute")[0]
    os.kill(own.children("adret_service.worker")[0], signal.SIGKILL)
    took = wait_for(lambda: gone(compute), 5.0, own.log)
    assert took < 2.0, "the computing process outlived its worker"
    assert own.wait(job)["status"] == "successful"
    assert own.wait(waiting)["status"] == "successful"
    assert digest_of(own, job) == expected
    wait_for(lambda: leftovers(own) == [], 5.0, own.log)


def test_a_killed_server_finishes_its_jobs_after_a_restart(
    own: Server, example_dem: Path, expected: str
) -> None:
    job = start_long_job(own, example_dem)
    waiting = [own.submit("shadow", dataset=own.status(job)["inputs"]["dataset"]) for _ in range(3)]
    workers = own.children("adret_service")
    own.kill()
    wait_for(lambda: all(map(gone, workers)), 5.0, own.log)
    own.start()
    assert own.wait(job)["status"] == "successful"
    for each in waiting:
        assert own.wait(each)["status"] == "successful"
    assert digest_of(own, job) == expected
    assert own.status(job)["created"] < own.status(waiting[0])["created"]
    wait_for(lambda: leftovers(own) == [], 5.0, own.log)


def test_a_dismissal_survives_the_death_of_the_worker(own: Server, example_dem: Path) -> None:
    job = start_long_job(own, example_dem)
    worker = own.children("adret_service.worker")[0]
    freeze(worker, own.data)
    try:
        assert own.http.delete(f"/jobs/{job}").json()["status"] == "dismissed"
    finally:
        os.kill(worker, signal.SIGKILL)
    after = own.submit("shadow", dataset=own.status(job)["inputs"]["dataset"])
    assert own.wait(after)["status"] == "successful"
    assert own.status(job)["status"] == "dismissed"
    assert not (own.data / "store" / "local" / "jobs" / job).exists()


def test_a_stopped_server_goes_in_peace_and_its_job_runs_later(
    own: Server, example_dem: Path, expected: str
) -> None:
    job = start_long_job(own, example_dem)
    began = time.monotonic()
    assert own.process is not None
    own.process.send_signal(signal.SIGTERM)
    assert own.process.wait(20.0) is not None
    assert time.monotonic() - began < 8.0
    assert list((own.data / "tmp").iterdir()) == []
    own.start()
    assert own.wait(job)["status"] == "successful"
    assert digest_of(own, job) == expected
