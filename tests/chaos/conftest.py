"""The fault tests use the servers, rasters and databases of the service's tests."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "service"))

from postgres import Postgres


@pytest.fixture(scope="session")
def postgres() -> Iterator[Postgres]:
    """A PostgreSQL server of the fault tests' own: they stop it."""
    server = Postgres()
    yield server
    server.remove()
