"""Fixtures of the service's tests."""

import os
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import patch

import pytest
from moto.server import ThreadedMotoServer
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


@pytest.fixture(scope="session")
def bucket() -> Iterator[dict[str, str]]:
    """Settings of a store in a bucket: a real S3 protocol, a double behind it."""
    import boto3

    secrets = {
        "AWS_ACCESS_KEY_ID": "key",
        "AWS_SECRET_ACCESS_KEY": "secret",
        "AWS_DEFAULT_REGION": "us-east-1",
    }
    server = ThreadedMotoServer("127.0.0.1", 0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    endpoint = f"http://{host}:{port}"
    with patch.dict(os.environ, secrets):
        boto3.client("s3", endpoint_url=endpoint).create_bucket(Bucket="adret")
        yield {
            "storage_url": "s3://adret/store",
            "storage_endpoint": endpoint,
            "storage_allow_http": "1",
        }
    server.stop()
