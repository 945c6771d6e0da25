"""Batches: the same files as the products' own commands, whatever was cut, killed or resumed."""

import contextlib
import hashlib
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

import adret
import raster_files
from adret import products
from adret.cli import main
from adret.errors import InputError, RasterError
from adret.tiling import Job, Surface, plan, prepare, run_batch
from adret.tiling.executors import LocalExecutor, Order, Outcome, attempt, open_executor
from adret.tiling.jobs import FOLDER, tile_path
from adret.tiling.plans import check_memory

RANGE = {None: {}, 5000.0: {"max_distance": 5000.0}}
CHOSEN: dict[str, dict[str, Any]] = {
    "horizon": {"directions": 6},
    "sky-view": {"directions": 36, "kind": "normal", "curvature": True},
    "openness": {"directions": 6, "sign": -1},
    "shadow": {"sun_deg": (250.0, 12.0)},
    "light": {"directions": 6, "sky": "overcast", "sun_deg": (250.0, 12.0)},
}


class Here:
    """An executor without processes."""

    def __init__(self, fail_after: int | None = None) -> None:
        self.fail_after = fail_after
        self.orders: list[Order] = []

    def map(self, orders: Sequence[Order]) -> Iterator[Outcome]:
        for count, order in enumerate(orders):
            if count == self.fail_after:
                raise KeyboardInterrupt
            self.orders.append(order)
            yield attempt(order)

    def close(self) -> None:
        """Nothing to let go."""


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def job_of(path: Path, names: Sequence[str], size: int, reach: float | None, **more: Any) -> Job:
    chosen = {
        name: products.PRODUCTS[name].parameters(**CHOSEN[name], **RANGE[reach], **more)
        for name in names
    }
    return Job(Surface.open([path]), chosen, size)


def batch(job: Job, out: Path, **options: bool) -> None:
    prepare(job, out, **options)
    assert not run_batch(job, out, Here()).failed


def whole_files(job: Job, path: Path, out: Path) -> dict[str, str]:
    """Digests of what the products' own commands write."""
    terrain = adret.Terrain.open(path)
    found = {}
    for name, parameters in job.products.items():
        products.run(products.PRODUCTS[name], terrain, parameters, out / f"{name}.tif")
        found[name] = digest(out / f"{name}.tif")
    return found


@pytest.fixture
def small(example_dem: Path, tmp_path: Path) -> Path:
    """A corner of the example with a void, 140 x 150 cells of 200 m."""
    return raster_files.crop(example_dem, tmp_path / "small.tif", 140, 150, void=(60, 75, 20, 50))


# --- the same bytes ------------------------------------------------------------------------------


@pytest.mark.parametrize("reach", list(RANGE))
def test_a_batch_writes_the_files_of_the_commands(
    reach: float | None, small: Path, tmp_path: Path
) -> None:
    job = job_of(small, list(CHOSEN), 64, reach)
    whole = whole_files(job, small, tmp_path)
    batch(job, tmp_path / "out")
    for name, wanted in whole.items():
        assert digest(tmp_path / "out" / f"{name}.tif") == wanted, name


@pytest.mark.slow
@pytest.mark.parametrize("reach", [None, 2500.0])
@pytest.mark.parametrize("size", [33, 64, 100, 128, 256, 512])
@pytest.mark.parametrize(
    "name",
    [
        "alpine_exploradores_aster_utm18s_30m_voids.tif",
        "geo_grenoble_copdem_epsg4326_decimated.tif",
        "moon_gld100_eqc_118m_4096.tif",
    ],
)
def test_every_size_on_real_rasters(
    name: str, size: int, reach: float | None, data_dir: Path, tmp_path: Path
) -> None:
    """Voids, a geographic grid, the Moon; five products, with and without a range."""
    path = data_dir / "dem" / name
    small = raster_files.crop(path, tmp_path / "part.tif", 400, 430)
    RANGE.setdefault(2500.0, {"max_distance": 2500.0})
    job = job_of(small, list(CHOSEN), size, reach)
    whole = whole_files(job, small, tmp_path)
    for workers in (1, 2, 3) if size == 100 else (1,):
        out = tmp_path / f"out{workers}"
        prepare(job, out)
        executor = LocalExecutor(workers, 1)
        try:
            assert not run_batch(job, out, executor).failed
        finally:
            executor.close()
        for product, wanted in whole.items():
            assert digest(out / f"{product}.tif") == wanted, product


def test_files_that_abut_are_one_surface(small: Path, tmp_path: Path) -> None:
    """Four files, one overlapping its neighbour by a row, give the file of the one."""
    job = job_of(small, ["sky-view"], 64, 5000.0)
    parts = [
        raster_files.crop(small, tmp_path / f"{name}.tif", *size, corner=corner)
        for name, size, corner in (
            ("d", (80, 70), (60, 80)),
            ("a", (61, 80), (0, 0)),
            ("c", (80, 80), (60, 0)),
            ("b", (60, 70), (0, 80)),
        )
    ]
    surface = Surface.open(parts)
    assert surface.grid.shape == (140, 150)
    assert surface.datum == job.surface.datum
    whole = whole_files(job, small, tmp_path)
    batch(Job(surface, job.products, 64), tmp_path / "out")
    assert digest(tmp_path / "out" / "sky-view.tif") == whole["sky-view"]


@pytest.mark.parametrize("measure", ["visible-count", "visible-area", "sky-view"])
def test_tiles_of_visibility_are_the_file_of_the_command(
    measure: str, small: Path, tmp_path: Path
) -> None:
    product = products.PRODUCTS["visibility"]
    given = product.parameters(measure=measure, directions=6, max_distance=3000.0)
    part = raster_files.crop(small, tmp_path / "part.tif", 90, 90)
    job = Job(Surface.open([part]), {"visibility": given}, 37)
    whole = whole_files(job, part, tmp_path)
    batch(job, tmp_path / "out")
    assert digest(tmp_path / "out" / "visibility.tif") == whole["visibility"]
    endless = Job(job.surface, {"visibility": product.parameters(directions=6)}, 37)
    with pytest.raises(InputError, match="max_distance: must be given for visibility in tiles"):
        prepare(endless, tmp_path / "endless")


def test_files_off_the_grid_are_refused(small: Path, tmp_path: Path) -> None:
    other = raster_files.crop(small, tmp_path / "b.tif", 50, 50, shift=0.3)
    with pytest.raises(RasterError, match="on the grid of the first file"):
        Surface.open([small, other])


# --- killed, damaged, resumed --------------------------------------------------------------------


def test_a_batch_goes_on_where_it_was_stopped(small: Path, tmp_path: Path) -> None:
    job = job_of(small, ["sky-view"], 50, 5000.0)
    batch(job, tmp_path / "calm")
    out = tmp_path / "out"
    prepare(job, out)
    with pytest.raises(KeyboardInterrupt):
        run_batch(job, out, Here(fail_after=4))
    # One tile is damaged, and one lost its receipt.
    damaged = tile_path(out, "sky-view", job.tiles[1])
    data = bytearray(damaged.read_bytes())
    data[len(data) // 2] ^= 0xFF
    damaged.write_bytes(data)
    tile_path(out, "sky-view", job.tiles[2]).with_suffix(".json").unlink()
    again = Job.read(out)
    prepare(again, out, resume=True)
    executor = Here()
    report = run_batch(again, out, executor)
    assert report.products[0].resumed == 2
    assert len(executor.orders) == len(job.tiles) - 2
    assert digest(out / "sky-view.tif") == digest(tmp_path / "calm" / "sky-view.tif")
    manifest = json.loads((out / "manifest.json").read_text())["products"]["sky-view"]
    assert manifest["sha256"] == digest(out / "sky-view.tif")
    assert len(manifest["tiles"]) == len(job.tiles)
    # Nothing is left to do.
    prepare(again, out, resume=True)
    idle = Here()
    assert run_batch(again, out, idle).products[0].resumed == len(job.tiles)
    assert not idle.orders


def test_a_killed_client_and_its_killed_workers_lose_nothing(small: Path, tmp_path: Path) -> None:
    """SIGKILL for the client in the middle; its worker ends by itself; --resume ends the job."""
    out = tmp_path / "out"
    arguments = [
        *("batch", str(small), str(out), "--product", "sky", "--kind", "normal"),
        *("--directions", "36", "--tile-size", "16", "--curvature"),
    ]
    code = "import sys; from adret.cli import main; sys.exit(main())"
    client = subprocess.Popen([sys.executable, "-c", code, *arguments])
    receipts = out / FOLDER / "sky-view"
    deadline = time.monotonic() + 120.0
    while len(list(receipts.glob("*.json"))) < 5 and time.monotonic() < deadline:
        assert client.poll() is None
        time.sleep(0.01)
    children = Path(f"/proc/{client.pid}/task/{client.pid}/children").read_text().split()
    client.send_signal(signal.SIGKILL)
    client.wait()
    while any(_runs(int(child)) for child in children) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not any(_runs(int(child)) for child in children)
    kept = len(list(receipts.glob("*.json")))
    assert 5 <= kept < 90
    assert not (out / "sky-view.tif").exists()
    assert main([*arguments, "--resume"]) == 0
    job = job_of(small, ["sky-view"], 16, None)
    assert digest(out / "sky-view.tif") == whole_files(job, small, tmp_path)["sky-view"]


def _runs(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().split()[2] != "Z"
    except OSError:
        return False


def test_a_worker_that_is_killed_is_replaced(small: Path, tmp_path: Path) -> None:
    job = job_of(small, ["sky-view"], 16, 5000.0)
    out = tmp_path / "out"
    prepare(job, out)
    executor = LocalExecutor(1, 1)
    shot: list[int] = []

    def shoot(product: str, done: int, total: int) -> None:
        if not shot and done >= 3:
            (worker,) = executor.processes()
            os.kill(worker, signal.SIGKILL)
            shot.append(worker)

    try:
        report = run_batch(job, out, executor, shoot)
    finally:
        executor.close()
    assert shot
    assert not report.failed
    assert digest(out / "sky-view.tif") == whole_files(job, small, tmp_path)["sky-view"]


def test_tiles_of_a_dask_cluster_are_the_same_bytes(small: Path, tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="the extra adret[dask] is not here")
    from adret.tiling.dask_executor import DaskExecutor

    job = job_of(small, ["sky-view"], 64, 5000.0)
    out = tmp_path / "out"
    prepare(job, out)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address="127.0.0.1:0"
    ) as cluster:
        executor = DaskExecutor(1, 1, cluster.scheduler_address)
        try:
            assert not run_batch(job, out, executor).failed
        finally:
            executor.close()
    assert digest(out / "sky-view.tif") == whole_files(job, small, tmp_path)["sky-view"]


def test_a_dask_cluster_of_our_own_wants_no_port_that_may_be_taken() -> None:
    pytest.importorskip("distributed", reason="the extra adret[dask] is not here")
    from adret.tiling.dask_executor import DaskExecutor

    with socket.socket() as taken:
        with contextlib.suppress(OSError):  # somebody else has it: as good
            taken.bind(("127.0.0.1", 8787))
            taken.listen()
        DaskExecutor(1, 1).close()  # a warning about the port would be an error here


def test_an_executor_that_is_not_there_is_named(small: Path, tmp_path: Path) -> None:
    arguments = ["batch", str(small), str(tmp_path / "out"), "--executor", "abacus"]
    assert main(arguments) == 2
    assert not (tmp_path / "out").exists()
    with pytest.raises(InputError, match="executor: must be one of local, dask, queue"):
        open_executor("abacus", workers=1, threads=1, scheduler=None)


def test_another_job_is_not_resumed(small: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    prepare(job_of(small, ["sky-view"], 64, 5000.0), out)
    with pytest.raises(InputError, match="its tile_size was 64"):
        prepare(job_of(small, ["sky-view"], 32, 5000.0), out, resume=True)
    with pytest.raises(RasterError, match="a new folder"):
        prepare(job_of(small, ["sky-view"], 64, 5000.0), out)


def test_each_file_is_done_even_when_another_cannot_be(
    small: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = tmp_path / "broken.tif"
    broken.write_bytes(small.read_bytes()[:300])
    sources = [str(broken), str(small)]
    options = ["--each", "--product", "shadow", "--tile-size", "80"]
    assert main(["batch", *sources, str(tmp_path / "out"), *options]) == 1
    said = capsys.readouterr()
    assert "out/broken: path: must be a readable GTiff file" in said.err
    assert "small/shadow.tif" in said.out
    terrain = adret.Terrain.open(small)
    chosen = products.PRODUCTS["shadow"]
    products.run(chosen, terrain, chosen.parameters(), tmp_path / "whole.tif")
    assert digest(tmp_path / "out" / "small" / "shadow.tif") == digest(tmp_path / "whole.tif")


def test_options_of_products_that_are_not_made_are_refused(small: Path, tmp_path: Path) -> None:
    arguments = ["batch", str(small), str(tmp_path / "out"), "--product", "sky", "--sun", "1,2"]
    assert main(arguments) == 2
    assert main(["plan", str(small), "--product", "viewshed"]) == 2


# --- memory --------------------------------------------------------------------------------------


def test_too_little_memory_is_refused_before_anything_starts(small: Path, tmp_path: Path) -> None:
    job = job_of(small, ["sky-view"], 64, None)
    found = plan(job, 1, 2)
    with pytest.raises(InputError, match=r"memory: must be at least .*M for tiles of 64 cells"):
        check_memory(found, job, 64 << 20, tmp_path)
    check_memory(found, job, found.worker_bytes, tmp_path)
    arguments = ["batch", str(small), str(tmp_path / "out"), "--memory", "64M"]
    assert main(arguments) == 2
    assert not (tmp_path / "out").exists()


def test_the_plan_of_a_large_raster_names_a_tile_size_that_fits(tmp_path: Path) -> None:
    from adret.grids import RasterGrid
    from adret.tiling.surfaces import Piece

    shape = (100_000, 100_000)
    grid = RasterGrid(None, None, shape, (10.0, 10.0))
    surface = Surface((Piece("none", 0, 0, shape),), grid, 1, "m", 4, 0.0)
    given = products.PRODUCTS["sky-view"].parameters(max_distance=5000.0)
    job = Job(surface, {"sky-view": given}, 8192)
    found = plan(job, 1, 2)
    assert found.products[0].tiles == 13 * 13
    assert found.products[0].halo == 505
    with pytest.raises(InputError, match=r"or --tile-size 4096"):
        check_memory(found, job, 2 << 30, tmp_path)
