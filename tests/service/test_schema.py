"""Requests made from the OpenAPI document: never a 5xx, and answers as the document says."""

import itertools
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, given, settings
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_headers_conformance,
    response_schema_conformance,
    status_code_conformance,
)
from servers import Server, hill, write_dem

DOCUMENT = Path(__file__).resolve().parents[2] / "openapi" / "adret-v1.json"
CHECKS = [
    not_a_server_error,
    status_code_conformance,
    content_type_conformance,
    response_headers_conformance,
    response_schema_conformance,
]
QUIET: dict[str, Any] = {
    "deadline": None,
    "derandomize": True,
    "database": None,
    "suppress_health_check": list(HealthCheck),
    "phases": (Phase.explicit, Phase.generate),
}

# Without workers the service is not ready, and says so with 503.
OPERATIONS = [
    (method.upper(), path)
    for path, methods in json.loads(DOCUMENT.read_text(encoding="utf-8"))["paths"].items()
    for method in methods
    if path != "/readyz"
]


@schemathesis.serializer("application/offset+octet-stream", "image/tiff")
def as_bytes(_context: Any, value: Any) -> Any:
    return value if isinstance(value, bytes) else str(value).encode()


@pytest.fixture(scope="module")
def schema() -> Any:
    return schemathesis.openapi.from_path(DOCUMENT)


@pytest.fixture(scope="module")
def api(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A server without workers: what is ordered waits."""
    server = Server(tmp_path_factory.mktemp("schema") / "data", ADRET_ROLE="api")
    try:
        server.start(ready=False)
        yield server
    finally:
        server.stop()


@pytest.fixture(scope="module")
def things(api: Server, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Ids of things that there are."""
    dem = write_dem(tmp_path_factory.mktemp("dem") / "dem.tif", hill(40, 50))
    dataset = api.upload(dem).json()["id"]
    return {"dataset_id": dataset, "job_id": api.submit("horizon", dataset=dataset)}


def ask(
    schema: Any, operation: tuple[str, str], api: Server, things: dict[str, str], examples: int
) -> None:
    """Send requests of one operation; every second one is about things that there are."""
    method, path = operation
    turn = itertools.count()

    @settings(max_examples=examples, **QUIET)
    @given(case=schema[path][method].as_strategy())
    def sent(case: Any) -> None:
        known = next(turn) % 2 == 0 and method != "DELETE"
        if known and path.endswith("/events"):
            return  # the job waits for ever, and so would the stream
        if known:
            for name in things.keys() & (case.path_parameters or {}).keys():
                case.path_parameters[name] = things[name]
        case.call_and_validate(base_url=api.url, checks=CHECKS, timeout=20)

    sent()


@pytest.mark.parametrize("operation", OPERATIONS, ids=" ".join)
def test_the_api_does_what_its_document_says(
    operation: tuple[str, str], schema: Any, api: Server, things: dict[str, str]
) -> None:
    ask(schema, operation, api, things, 6)


@pytest.mark.slow
@pytest.mark.parametrize("operation", OPERATIONS, ids=" ".join)
def test_the_api_does_what_its_document_says_at_length(
    operation: tuple[str, str], schema: Any, api: Server, things: dict[str, str]
) -> None:
    ask(schema, operation, api, things, 200)
