"""Tiles through the durable queue: the same bytes, also when workers are killed."""

import hashlib
import os
import signal
from pathlib import Path

import pytest
from postgres import Postgres

import adret
import raster_files
from adret import products
from adret.errors import InputError
from adret.tiling import Job, Surface, prepare, run_batch
from adret_service import tile_queue
from adret_service.tile_queue import QueueExecutor


def test_tiles_of_the_queue_are_the_files_of_the_command(example_dem: Path, tmp_path: Path) -> None:
    check(example_dem, tmp_path, f"sqlite:///{tmp_path}/queue.db", kill=False)


@pytest.mark.slow
def test_a_worker_killed_with_a_tile_in_hand_loses_nothing(
    example_dem: Path, tmp_path: Path, postgres: Postgres, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tile_queue, "GRACE", 5.0)
    check(example_dem, tmp_path, postgres.url("tiles"), kill=True)


def check(example_dem: Path, tmp_path: Path, database: str, *, kill: bool) -> None:
    """Run a batch through a database and compare its file with the whole's."""
    small = raster_files.crop(example_dem, tmp_path / "small.tif", 140, 150)
    product = products.PRODUCTS["sky-view"]
    given = product.parameters(directions=36, kind="normal", curvature=True)
    job = Job(Surface.open([small]), {"sky-view": given}, 25 if kill else 75)
    products.run(product, adret.Terrain.open(small), given, tmp_path / "whole.tif")
    out = tmp_path / "out"
    prepare(job, out)
    executor = QueueExecutor(2 if kill else 1, 1, database)
    shot: list[int] = []

    def shoot(name: str, done: int, total: int) -> None:
        if kill and not shot and done >= 4:
            shot.append(executor.processes()[0])
            os.kill(shot[0], signal.SIGKILL)

    try:
        report = run_batch(job, out, executor, shoot)
    finally:
        executor.close()
    assert not report.failed, report
    assert bool(shot) == kill
    digests = [
        hashlib.sha256(path.read_bytes()).hexdigest()
        for path in (out / "sky-view.tif", tmp_path / "whole.tif")
    ]
    assert digests[0] == digests[1]


def test_a_queue_needs_a_database() -> None:
    with pytest.raises(InputError, match="scheduler: must be the URL of a PostgreSQL"):
        QueueExecutor(1, 1, None)
