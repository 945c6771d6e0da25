"""SIGKILL for workers, clients and schedulers of batches: nothing that is done is lost."""

import hashlib
import os
import random
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import adret
import raster_files
from adret import products
from adret.tiling.jobs import FOLDER

pytestmark = pytest.mark.slow

ADRET = [sys.executable, "-c", "import sys; from adret.cli import main; sys.exit(main())"]
DASK = [sys.executable, "-m", "dask"]
OPTIONS = [
    *("--product", "sky", "--kind", "normal", "--directions", "36", "--curvature"),
    *("--tile-size", "16"),
]
TILES = 90
KILLS = int(os.environ.get("ADRET_KILLS", "20"))


@pytest.fixture(scope="module")
def small(example_dem: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A corner of the example with a void, 140 x 150 cells of 200 m."""
    path = tmp_path_factory.mktemp("dem") / "small.tif"
    return raster_files.crop(example_dem, path, 140, 150, void=(60, 75, 20, 50))


@pytest.fixture(scope="module")
def wanted(small: Path) -> str:
    """Digest of the file that the product's own command writes."""
    product = products.PRODUCTS["sky-view"]
    given = product.parameters(kind="normal", directions=36, curvature=True)
    products.run(product, adret.Terrain.open(small), given, small.with_name("whole.tif"))
    return digest(small.with_name("whole.tif"))


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def receipts(out: Path) -> dict[str, float]:
    """Tiles that are done, and when they were."""
    found = {}
    for path in (out / FOLDER / "sky-view").glob("*.json"):
        try:
            found[path.stem] = path.stat().st_mtime
        except OSError:
            continue  # the product was put together meanwhile
    return found


def wait_for(condition: Callable[[], bool], seconds: float = 120.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, condition
        time.sleep(0.01)


def children(process: int) -> list[int]:
    try:
        text = Path(f"/proc/{process}/task/{process}/children").read_text()
    except OSError:
        return []
    return [int(each) for each in text.split()]


def is_worker(process: int) -> bool:
    try:
        return b"spawn_main" in Path(f"/proc/{process}/cmdline").read_bytes()
    except OSError:
        return False


def runs(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().split()[2] != "Z"
    except OSError:
        return False


def test_twenty_kills_of_workers_and_clients_at_any_moment(
    small: Path, wanted: str, tmp_path: Path
) -> None:
    """By turns a worker or the client dies; every resumption keeps what was done."""
    chance = random.Random(int(os.environ.get("ADRET_SEED", "11")))
    out, kills, ends = tmp_path / "out", 0, 0
    while kills < KILLS:
        before = receipts(out)
        kills += disturb(small, out, chance)
        after = receipts(out)
        if not (out / "sky-view.tif").exists():
            assert {name: after.get(name) for name in before} == before
            continue
        assert digest(out / "sky-view.tif") == wanted
        ends += 1
        out = tmp_path / f"out{ends}"
    resume = ["--resume"] if (out / FOLDER / "job.json").exists() else ["--overwrite"]
    done = subprocess.run([*ADRET, "batch", str(small), str(out), *OPTIONS, *resume])
    assert done.returncode == 0
    assert digest(out / "sky-view.tif") == wanted
    print(f"{kills} kills, {ends + 1} runs to the end")


def disturb(small: Path, out: Path, chance: random.Random) -> int:
    """Begin or resume a batch and kill a worker, then the client; or the client. How many died."""
    resume = ["--resume"] if (out / FOLDER / "job.json").exists() else ["--overwrite"]
    done = len(receipts(out))
    client = subprocess.Popen(
        [*ADRET, "batch", str(small), str(out), *OPTIONS, *resume], stdout=subprocess.DEVNULL
    )
    new = chance.choice([0, 1, 3, 8, 20])
    wait_for(lambda: len(receipts(out)) >= done + new or client.poll() is not None)
    time.sleep(chance.random() * 0.5)
    workers = [each for each in children(client.pid) if is_worker(each)]
    kills = 0
    if workers and chance.random() < 0.5 and client.poll() is None:
        os.kill(workers[0], signal.SIGKILL)
        kills += 1
        time.sleep(chance.random() * 3.0)  # the run replaces its worker
        workers += [each for each in children(client.pid) if is_worker(each)]
    if client.poll() is None:
        client.send_signal(signal.SIGKILL)
        kills += 1
    client.wait()
    wait_for(lambda: not any(runs(each) for each in workers))
    return kills


@pytest.fixture
def cluster() -> Iterator[tuple[str, subprocess.Popen[bytes], list[subprocess.Popen[bytes]]]]:
    """A scheduler and two workers, each a process of its own."""
    pytest.importorskip("distributed", reason="the extra adret[dask] is not here")
    started: list[subprocess.Popen[bytes]] = []

    def start(*arguments: str) -> subprocess.Popen[bytes]:
        process = subprocess.Popen(
            [*DASK, *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        started.append(process)
        return process

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    scheduler = start("scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard")
    options = ["--nthreads", "1", "--no-dashboard", "--no-nanny", "--death-timeout", "60"]
    workers = [start("worker", address, *options) for _ in range(2)]
    yield address, scheduler, workers
    for process in started:
        process.kill()
        process.wait()


@pytest.mark.parametrize("victim", ["scheduler", "worker"])
def test_a_scheduler_or_worker_of_dask_that_is_killed_loses_no_tile(
    victim: str,
    cluster: tuple[str, subprocess.Popen[bytes], list[subprocess.Popen[bytes]]],
    small: Path,
    wanted: str,
    tmp_path: Path,
) -> None:
    address, scheduler, workers = cluster
    out = tmp_path / "out"
    arguments = [*ADRET, "batch", str(small), str(out), *OPTIONS]
    client = subprocess.Popen(
        [*arguments, "--executor", "dask", "--scheduler", address],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    wait_for(lambda: len(receipts(out)) >= 8 or client.poll() is not None)
    assert client.poll() is None, client.communicate()
    (scheduler if victim == "scheduler" else workers[0]).kill()
    _, said = client.communicate(timeout=120.0)
    if victim == "worker":
        assert client.returncode == 0, said
        assert digest(out / "sky-view.tif") == wanted
        return
    # One line, no traceback, and what is done is there.
    assert client.returncode == 2, said
    lines = said.decode().strip().splitlines()
    assert len(lines) == 1, said
    assert "scheduler: must be one that goes on answering" in lines[0]
    time.sleep(2.0)  # workers end the tiles that they have in hand
    kept = receipts(out)
    assert 8 <= len(kept) < TILES
    assert not (out / "sky-view.tif").exists()
    done = subprocess.run([*arguments, "--resume"])
    assert done.returncode == 0
    assert digest(out / "sky-view.tif") == wanted
