"""Kill -9 of workers, computing processes and servers at random moments, on both databases."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from postgres import Postgres
from servers import Server
from storm import kill_storm, nothing_wrong


@pytest.fixture(params=["sqlite", "postgresql"])
def stormy(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Server]:
    """A server with two workers on one of the databases."""
    address = {}
    if request.param == "postgresql":
        postgres: Postgres = request.getfixturevalue("postgres")
        name = f"storm-{tmp_path.name}"
        address = {"ADRET_DATABASE_URL": postgres.url(name), "ADRET_LIVENESS_GRACE": "0.5"}
    server = Server(tmp_path / "data", ADRET_WORKERS="2", ADRET_THREADS_PER_JOB="1", **address)
    try:
        server.start()
        yield server
    finally:
        server.stop()


def test_a_few_kills_lose_nothing(stormy: Server, example_dem: Path) -> None:
    account = kill_storm(stormy, example_dem, jobs=10, kills=4)
    assert nothing_wrong(account), account


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_thirty_kills_and_a_hundred_jobs_lose_nothing(
    stormy: Server, example_dem: Path, seed: int
) -> None:
    account = kill_storm(stormy, example_dem, jobs=100, kills=30, seed=seed)
    assert nothing_wrong(account), account
