"""The committed OpenAPI document is the one that the code makes."""

import json
from pathlib import Path

from adret_service.openapi import document

COMMITTED = Path(__file__).resolve().parents[2] / "openapi" / "adret-v1.json"


def test_the_committed_document_is_current() -> None:
    current = document()
    assert COMMITTED.read_text(encoding="utf-8") == current, "run: make openapi"


def test_every_operation_has_an_id_of_its_own_and_a_summary() -> None:
    operations = [
        operation
        for path in json.loads(document())["paths"].values()
        for operation in path.values()
    ]
    ids = [operation["operationId"] for operation in operations]
    assert len(ids) == len(set(ids)) >= 16
    assert all(operation["description"] for operation in operations)


def test_refusals_are_documented_as_problems() -> None:
    api = json.loads(document())
    for path, methods in api["paths"].items():
        for operation in methods.values():
            assert "422" not in operation["responses"], path
            schema = operation["responses"]["default"]["content"]["application/json"]["schema"]
            assert schema == {"$ref": "#/components/schemas/Problem"}
    assert set(api["components"]["schemas"]["Problem"]["required"]) == {
        "type",
        "title",
        "status",
        "detail",
        "instance",
        "errors",
        "request_id",
    }
