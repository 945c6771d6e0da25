"""The echo process: gives back what it got. Conformance suites need one; a setting offers it."""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, Strict, ValidationError

import adret
from adret_service.echo import BINARY, ECHO
from adret_service.problems import FieldError, field_error, invalid
from adret_service.processes import Process

__all__ = ["ECHO_PROCESS"]

Text = Annotated[str, Strict(), Field(max_length=65_536)]
Number = Annotated[float, Strict()]


class Box(BaseModel):
    """A bounding box with its CRS."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    bbox: Annotated[list[Number], Field(min_length=4, max_length=6)]
    crs: Annotated[str, Strict(), Field(max_length=200)] | None = None


class Inputs(BaseModel):
    """What can be echoed, and what to do before."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    string: Text | None = None
    number: Number | None = None
    array: Annotated[list[Text], Field(max_length=1000)] | None = None
    bbox: Box | None = None
    object: dict[str, Any] | None = None
    mixed: Number | dict[str, Any] | None = None
    binary: Text | None = None
    pause: Annotated[float, Field(ge=0, le=60)] = 0.0
    fail: Annotated[bool, Strict()] = False


SCHEMAS: dict[str, dict[str, Any]] = {
    "string": {"type": "string", "maxLength": 65_536},
    "number": {"type": "number"},
    "array": {"type": "array", "items": {"type": "string"}, "maxItems": 1000},
    "bbox": {
        "allOf": [
            {"format": "ogc-bbox"},
            {
                "type": "object",
                "required": ["bbox"],
                "properties": {
                    "bbox": {
                        "type": "array",
                        "items": {"type": "number"},
                        "minItems": 4,
                        "maxItems": 6,
                    },
                    "crs": {"type": "string"},
                },
            },
        ]
    },
    "object": {"type": "object"},
    "mixed": {"oneOf": [{"type": "number"}, {"type": "object"}]},
    "binary": {"type": "string", "contentEncoding": "base64", "contentMediaType": BINARY},
}
OBJECTS = ("bbox", "object", "mixed")


def validated(inputs: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """Check the inputs; an echo reads no dataset."""
    try:
        checked = Inputs.model_validate(dict(inputs))
    except ValidationError as error:
        entries = error.errors(include_url=False, include_context=False)
        found = [field_error(entry) for entry in entries]
        raise invalid(*(FieldError(f"inputs.{e.field}", e.limit, e.value) for e in found)) from None
    return "", checked.model_dump(mode="json", exclude_none=True)


def _described(name: str, schema: dict[str, Any], what: str) -> dict[str, Any]:
    return {"title": name, "description": what, "schema": schema}


ECHO_PROCESS = Process(
    id=ECHO,
    title="Echo",
    description="Gives back what it got, after a pause; for tests of clients and of conformance.",
    version=adret.__version__,
    control=("sync-execute", "async-execute", "dismiss"),
    inputs={
        name: _described(name, schema, f"Anything that is: {name}.")
        | {"minOccurs": 0, "maxOccurs": 1}
        for name, schema in (
            SCHEMAS
            | {
                "pause": {"type": "number", "minimum": 0, "maximum": 60, "default": 0},
                "fail": {"type": "boolean", "default": False},
            }
        ).items()
    },
    outputs={
        name: _described(name, schema, "The input of this name.")
        for name, schema in SCHEMAS.items()
    },
    reads=None,
    objects=OBJECTS,
    validate=validated,
)
