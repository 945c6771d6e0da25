"""Large jobs go on where they were: kill -9, dismissal and retry, damaged tiles, shared folders."""

import hashlib
import os
import re
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from servers import Server, gone, wait_for

from adret_service.children import ComputeChild
from adret_service.engine.memory import MemoryEngine
from adret_service.engine.port import JobRecord
from adret_service.ids import new_id
from adret_service.settings import Settings
from adret_service.tile_folders import TileFolders

# Tiles of 80 cells a side at most, of about 0.05 s each.
ORDER = {"directions": 120, "method": "sweep", "max_distance": 5000.0}
SIDE, TILES, SOME = 80, 20, 5


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A server for which the example is a large raster, and that tests may kill."""
    server = Server(
        tmp_path_factory.mktemp("tiled") / "data",
        ADRET_TILED_CELLS="100000",
        ADRET_TILED_SECONDS="0",
        ADRET_TILE_SIZE=str(SIDE),
    )
    try:
        server.start()
        yield server
    finally:
        server.stop()


@pytest.fixture(scope="module")
def large(own: Server, example_dem: Path) -> str:
    return str(own.upload(example_dem).json()["id"])


@pytest.fixture(scope="module")
def whole(server: Server, dataset: str) -> dict[str, str]:
    """Digests of what a server that cuts nothing makes of the order."""
    job = server.submit("sky-view", dataset=dataset, **ORDER)
    assert server.wait(job)["status"] == "successful"
    assert all("tiles" not in line for line in log_of(server, job))
    return digests(server, job)


def digests(server: Server, job: str) -> dict[str, str]:
    results = server.http.get(f"/jobs/{job}/results").json()
    found = {
        name: hashlib.sha256(server.http.get(each["href"]).content).hexdigest()
        for name, each in results.items()
    }
    assert found == {name: each["sha256"] for name, each in results.items()}
    return found


def log_of(server: Server, job: str) -> list[str]:
    return [line["message"] or "" for line in server.http.get(f"/jobs/{job}/logs").json()["logs"]]


def folder(server: Server, job: str) -> Path:
    return server.data / "tmp" / "tiles" / job


def done(server: Server, job: str) -> list[Path]:
    """Receipts of the tiles that are done."""
    return sorted(folder(server, job).glob("*/.adret-tiles/sky-view/r*.json"))


def begin(server: Server, dataset: str) -> str:
    """Order the long job, and let it get so far that some tiles are done and others not."""
    job = server.submit("sky-view", dataset=dataset, **ORDER)
    wait_for(lambda: len(done(server, job)) >= SOME, 30.0, server.log)
    return job


def resumed(server: Server, job: str) -> list[tuple[int, int]]:
    """How many tiles each attempt after the first found done, and how many were damaged."""
    lines = re.findall(
        rf"resumed: (\d+) of {TILES} tiles were there(?:; (\d+) more were damaged)?",
        "\n".join(log_of(server, job)),
    )
    return [(int(there), int(damaged or 0)) for there, damaged in lines]


def made(server: Server, job: str) -> list[int]:
    """How many tiles the attempt that ended well has made."""
    return [
        int(count)
        for count in re.findall(rf"{job}: tiles: .*'made': (\d+)", server.log.read_text())
    ]


def ended_well(server: Server, job: str, whole: dict[str, str]) -> int:
    """Check the end of a job that was cut short once; returns the tiles found done."""
    assert server.wait(job)["status"] == "successful"
    ((there, _),) = resumed(server, job)
    assert made(server, job) == [TILES - there]
    assert digests(server, job) == whole
    wait_for(lambda: not folder(server, job).exists(), 5.0, server.log)
    return there


@pytest.mark.slow
@pytest.mark.parametrize("victim", ["adret_service.compute", "adret_service.worker"])
def test_a_killed_process_leaves_its_tiles_to_the_next(
    own: Server, large: str, whole: dict[str, str], victim: str
) -> None:
    job = begin(own, large)
    os.kill(own.children(victim)[0], signal.SIGKILL)
    assert ended_well(own, job, whole) >= SOME


def test_a_killed_server_goes_on_with_the_tiles_that_are_left(
    own: Server, large: str, whole: dict[str, str]
) -> None:
    job = begin(own, large)
    workers = own.children("adret_service")
    own.kill()
    wait_for(lambda: all(map(gone, workers)), 5.0, own.log)
    there = len(done(own, job))
    own.start()
    assert ended_well(own, job, whole) == there


def test_a_retry_keeps_tiles_that_are_whole_and_makes_damaged_ones_anew(
    own: Server, large: str, whole: dict[str, str]
) -> None:
    job = begin(own, large)
    assert own.http.delete(f"/jobs/{job}").json()["status"] == "dismissed"
    time.sleep(0.5)  # within which its process stops
    kept = done(own, job)
    with kept[2].with_suffix(".tif").open("r+b") as tile:  # as long as before
        tile.seek(-40, os.SEEK_END)
        tile.write(bytes(40))
    wait_for(lambda: own.http.post(f"/jobs/{job}/retry").status_code == 201, 10.0, own.log)
    assert ended_well(own, job, whole) == len(kept) - 1
    assert resumed(own, job) == [(len(kept) - 1, 1)]


@pytest.mark.slow
def test_tiles_of_a_removed_job_go_with_it(own: Server, large: str) -> None:
    job = begin(own, large)
    for _ in range(2):  # dismissed, removed
        assert own.http.delete(f"/jobs/{job}").status_code == 200
    wait_for(lambda: not folder(own, job).exists(), 5.0, own.log)


@pytest.mark.slow
def test_two_attempts_in_one_folder_make_one_result(
    own: Server, large: str, whole: dict[str, str], tmp_path: Path
) -> None:
    """As of a worker that was taken for dead: one is frozen, woken, and both go on."""
    info = own.http.get(f"/datasets/{large}").json()
    (raster,) = (own.data / "store").glob(f"*/datasets/{large}/*heights.tif")
    (tmp_path / "tiles").mkdir()
    ends: list[dict[str, Any]] = []

    def attempt(name: str, child: ComputeChild) -> None:
        (tmp_path / name).mkdir()
        order = {
            "process": "sky-view",
            "inputs": ORDER,
            "raster": str(raster),
            "info": info,
            "folder": str(tmp_path / name),
            "tiles": {"folder": str(tmp_path / "tiles"), "size": SIDE, "room": 1 << 30},
        }
        ends.append(child.run(order, lambda _: True, 0.1))

    children = [ComputeChild(1), ComputeChild(1)]
    threads = [
        threading.Thread(target=attempt, args=(name, child))
        for name, child in zip("ab", children, strict=True)
    ]
    try:
        threads[0].start()
        wait_for(lambda: len(list(tmp_path.glob("tiles/*/.adret-tiles/*/r*.json"))) > 3, 30.0)
        frozen = children[0]._process
        assert frozen is not None
        frozen.send_signal(signal.SIGSTOP)
        threads[1].start()
        time.sleep(1.0)
        frozen.send_signal(signal.SIGCONT)
        for thread in threads:
            thread.join(60.0)
    finally:
        for child in children:
            child.kill()
    assert [end["event"] for end in ends] == ["done", "done"], ends
    for name in "ab":
        content = (tmp_path / name / "result.tif").read_bytes()
        assert hashlib.sha256(content).hexdigest() == whole["result"]


def test_tiles_of_ended_jobs_make_room_oldest_first(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path, min_free_bytes=0, scratch_max_bytes=2500)
    folders, engine = TileFolders(settings), MemoryEngine()
    assert folders.sweep(engine.look) == 0
    jobs = {}
    for name in ("waits", "fails", "is dismissed", "succeeds"):
        job = JobRecord(id=new_id(), tenant="t", process="p", dataset="", inputs={})
        jobs[name] = engine.submit(job).id
        (folders.open(jobs[name]) / "tile").write_bytes(bytes(1000))
    (folders.open(new_id()) / "tile").write_bytes(bytes(1000))
    engine.begin(jobs["succeeds"])
    engine.succeed(jobs["succeeds"])
    engine.fail(jobs["fails"], {"detail": "why", "status": 500})
    engine.cancel(jobs["is dismissed"], "t")

    def left() -> set[str]:
        return {name for name, job in jobs.items() if (folders.root / job).exists()}

    assert folders.sweep(engine.look) == 3  # the unknown one, the successful one, one for room
    assert left() == {"waits", "is dismissed"}
    assert folders.sweep(engine.look) == 0


def test_a_jobs_own_tiles_are_no_reason_to_wait_for_room(tmp_path: Path) -> None:
    folders = TileFolders(Settings(data_dir=tmp_path, min_free_bytes=0, scratch_max_bytes=2500))
    (folders.open("mine") / "tile").write_bytes(bytes(3000))
    assert (folders.others("mine"), folders.others("other")) == (0, 3000)
    (folders.open("other") / "tile").write_bytes(bytes(600))
    assert (folders.room("mine"), folders.room("other")) == (1900, -500)
