"""JSON Schemas of the documents of OGC API - Processes 1.0, written down from the standard."""

from typing import Any

from jsonschema import Draft202012Validator

EXCEPTIONS = "http://www.opengis.net/def/exceptions/ogcapi-processes-1/1.0/"

LINK: dict[str, Any] = {
    "type": "object",
    "required": ["href"],
    "properties": {
        "href": {"type": "string"},
        "rel": {"type": "string"},
        "type": {"type": "string"},
        "hreflang": {"type": "string"},
        "title": {"type": "string"},
    },
}
LINKS = {"type": "array", "items": LINK}

EXCEPTION = {
    "type": "object",
    "required": ["type"],
    "properties": {
        "type": {"type": "string"},
        "title": {"type": "string"},
        "status": {"type": "integer"},
        "detail": {"type": "string"},
        "instance": {"type": "string"},
    },
}

LANDING = {
    "type": "object",
    "required": ["links"],
    "properties": {
        "title": {"type": "string"},
        "description": {"type": "string"},
        "links": LINKS,
    },
}

CONFORMANCE = {
    "type": "object",
    "required": ["conformsTo"],
    "properties": {"conformsTo": {"type": "array", "items": {"type": "string"}}},
}

TIME = {"type": "string", "pattern": r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d+)?(Z|[+-]\d\d:\d\d)$"}
STATUS = {
    "type": "object",
    "required": ["jobID", "status", "type"],
    "properties": {
        "processID": {"type": "string"},
        "type": {"type": "string", "enum": ["process"]},
        "jobID": {"type": "string"},
        "status": {
            "type": "string",
            "enum": ["accepted", "running", "successful", "failed", "dismissed"],
        },
        "message": {"type": "string"},
        "created": TIME,
        "started": TIME,
        "finished": TIME,
        "updated": TIME,
        "progress": {"type": "integer", "minimum": 0, "maximum": 100},
        "links": LINKS,
    },
}

JOBS = {
    "type": "object",
    "required": ["jobs", "links"],
    "properties": {"jobs": {"type": "array", "items": STATUS}, "links": LINKS},
}

DESCRIPTION = {
    "title": {"type": "string"},
    "description": {"type": "string"},
    "keywords": {"type": "array", "items": {"type": "string"}},
    "metadata": {"type": "array"},
    "additionalParameters": {
        "type": "object",
        "properties": {
            "title": {"type": "string"},
            "role": {"type": "string"},
            "href": {"type": "string"},
            "parameters": {
                "type": "array",
                "items": {
                    "type": "object",
                    "required": ["name", "value"],
                    "properties": {"name": {"type": "string"}, "value": {"type": "array"}},
                },
            },
        },
    },
}

SUMMARY = {
    "type": "object",
    "required": ["id", "version"],
    "properties": {
        **DESCRIPTION,
        "id": {"type": "string"},
        "version": {"type": "string"},
        "jobControlOptions": {
            "type": "array",
            "items": {"enum": ["sync-execute", "async-execute", "dismiss"]},
        },
        "outputTransmission": {"type": "array", "items": {"enum": ["value", "reference"]}},
        "links": LINKS,
    },
}

PROCESSES = {
    "type": "object",
    "required": ["processes", "links"],
    "properties": {"processes": {"type": "array", "items": SUMMARY}, "links": LINKS},
}

# The standard's schema of schemas: OpenAPI 3.0's words, and no others.
WORDS: dict[str, Any] = {
    "title": {"type": "string"},
    "description": {"type": "string"},
    "multipleOf": {"type": "number", "exclusiveMinimum": 0},
    "maximum": {"type": "number"},
    "exclusiveMaximum": {"type": "boolean"},
    "minimum": {"type": "number"},
    "exclusiveMinimum": {"type": "boolean"},
    "maxLength": {"type": "integer", "minimum": 0},
    "minLength": {"type": "integer", "minimum": 0},
    "pattern": {"type": "string", "format": "regex"},
    "maxItems": {"type": "integer", "minimum": 0},
    "minItems": {"type": "integer", "minimum": 0},
    "uniqueItems": {"type": "boolean"},
    "maxProperties": {"type": "integer", "minimum": 0},
    "minProperties": {"type": "integer", "minimum": 0},
    "required": {"type": "array", "items": {"type": "string"}, "minItems": 1},
    "enum": {"type": "array", "minItems": 1},
    "type": {"enum": ["array", "boolean", "integer", "number", "object", "string"]},
    "not": {"$ref": "#/$defs/schema"},
    "allOf": {"type": "array", "items": {"$ref": "#/$defs/schema"}},
    "oneOf": {"type": "array", "items": {"$ref": "#/$defs/schema"}},
    "anyOf": {"type": "array", "items": {"$ref": "#/$defs/schema"}},
    "items": {"$ref": "#/$defs/schema"},
    "properties": {"type": "object", "additionalProperties": {"$ref": "#/$defs/schema"}},
    "additionalProperties": {"anyOf": [{"$ref": "#/$defs/schema"}, {"type": "boolean"}]},
    "format": {"type": "string"},
    "default": {},
    "nullable": {"type": "boolean"},
    "readOnly": {"type": "boolean"},
    "writeOnly": {"type": "boolean"},
    "example": {},
    "deprecated": {"type": "boolean"},
    "contentMediaType": {"type": "string"},
    "contentEncoding": {"type": "string"},
    "contentSchema": {"type": "string"},
}
SCHEMA = {
    "$ref": "#/$defs/schema",
    "$defs": {"schema": {"type": "object", "properties": WORDS, "additionalProperties": False}},
}

INPUT = {
    "type": "object",
    "required": ["schema"],
    "properties": {
        **DESCRIPTION,
        "minOccurs": {"type": "integer"},
        "maxOccurs": {"anyOf": [{"type": "integer"}, {"enum": ["unbounded"]}]},
        "schema": {"$ref": "#/$defs/schema"},
    },
    "$defs": SCHEMA["$defs"],
}
OUTPUT = {
    "type": "object",
    "required": ["schema"],
    "properties": {**DESCRIPTION, "schema": {"$ref": "#/$defs/schema"}},
    "$defs": SCHEMA["$defs"],
}
PROCESS = {
    **SUMMARY,
    "properties": {
        **SUMMARY["properties"],  # type: ignore[dict-item]
        "inputs": {
            "type": "object",
            "additionalProperties": {k: v for k, v in INPUT.items() if k != "$defs"},
        },
        "outputs": {
            "type": "object",
            "additionalProperties": {k: v for k, v in OUTPUT.items() if k != "$defs"},
        },
    },
    "$defs": SCHEMA["$defs"],
}

BOX = {
    "type": "object",
    "required": ["bbox"],
    "properties": {"bbox": {"type": "array", "items": {"type": "number"}}},
}
VALUE = {
    "anyOf": [
        {"type": ["string", "number", "boolean", "array"]},
        BOX,
        {"type": "object", "required": ["value"]},
        {**LINK, "required": ["href"]},
    ]
}
RESULTS = {"type": "object", "additionalProperties": VALUE}


def check(document: Any, schema: dict[str, Any]) -> None:
    """Assert that a document is valid."""
    errors = [error.message for error in Draft202012Validator(schema).iter_errors(document)]
    assert not errors, errors


def check_exception(answer: Any, status: int, kind: str | None = None) -> dict[str, Any]:
    """Assert that an answer is an exception of the standard, in JSON, and return it."""
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"].split(";")[0] == "application/json"
    body = dict(answer.json())
    check(body, EXCEPTION)
    assert body["status"] == status
    if kind is not None:
        assert body["type"] == EXCEPTIONS + kind
    return body
