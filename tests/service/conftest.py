"""Fixtures of the service's tests."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from postgres import Postgres
from servers import Server, hill, write_dem


@pytest.fixture(scope="session")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A server for every test that leaves it alive."""
    server = Server(
        tmp_path_factory.mktemp("service") / "data",
        ADRET_MAX_UPLOAD_BYTES=str(4 << 20),
        ADRET_MAX_PIXELS=str(30_000_000),
        ADRET_RATIO_FLOOR_BYTES=str(1 << 20),
    )
    try:
        server.start()
        yield server
    finally:
        server.stop()


@pytest.fixture(scope="session")
def dataset(server: Server, example_dem: Path) -> str:
    """The example DEM as a dataset of the shared server."""
    answer = server.upload(example_dem)
    assert answer.status_code == 201, answer.text
    return str(answer.json()["id"])


@pytest.fixture
def small_dem(tmp_path: Path) -> Path:
    """A GeoTIFF of 40 x 50 cells with a hill and a hole."""
    return write_dem(tmp_path / "small.tif", hill(40, 50))


@pytest.fixture(scope="session")
def postgres() -> Iterator[Postgres]:
    """A PostgreSQL server for every test that leaves it running."""
    server = Postgres()
    yield server
    server.remove()
