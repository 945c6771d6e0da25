"""The library's products as OGC processes: schemas and checks come from their typed parameters."""

from functools import cache
from typing import Annotated, Any, Literal

from annotated_types import Ge, Gt, Le, Len
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    Strict,
    TypeAdapter,
    ValidationError,
    WithJsonSchema,
    create_model,
)

import adret
from adret.errors import InputError
from adret.parameters import MAX_LIST, Parameters, Specification, specifications
from adret.products import PRODUCTS
from adret_service.datasets import GEOTIFF
from adret_service.problems import FieldError, field_error, invalid

__all__ = ["description", "names", "parameters", "reads", "summary", "validated"]

# Nothing a client sends may become a path; these only matter beside an environment map's.
WITHHELD = {"environment_rotation_deg", "normal_angles"}

DATASETS = {
    "terrain": "The elevation model: its id.",
    "depth": "The depth buffer, which was uploaded with its camera: its id.",
}

OUTPUTS: dict[str, dict[str, Any]] = {
    "result": {
        "title": "The raster",
        "description": "Cloud-optimized GeoTIFF with units and definitions in its tags.",
        "schema": {
            "type": "string",
            "contentEncoding": "binary",
            "contentMediaType": f"{GEOTIFF}; profile=cloud-optimized",
        },
    },
    "preview": {
        "title": "A picture of it",
        "description": "PNG for looking at.",
        "schema": {
            "type": "string",
            "contentEncoding": "binary",
            "contentMediaType": "image/png",
        },
    },
}


def names() -> list[str]:
    """Return the ids of all processes."""
    return list(PRODUCTS)


def reads(name: str) -> str:
    """Return the kind of dataset that a process takes: "terrain" or "depth"."""
    return PRODUCTS[name].reads


def summary(name: str) -> dict[str, Any]:
    """Return the short form of a process."""
    product = PRODUCTS[name]
    return {
        "id": name,
        "title": product.title,
        "description": product.description,
        "version": adret.__version__,
        "jobControlOptions": ["async-execute", "dismiss"],
        "outputTransmission": ["reference"],
    }


def description(name: str) -> dict[str, Any]:
    """Return the full description: inputs as JSON Schema, and outputs."""
    schema = _model(name).model_json_schema()
    required = schema.get("required", [])
    inputs = {}
    for key, entry in schema["properties"].items():
        entry = dict(entry)
        inputs[key] = {
            "title": entry.pop("title", key),
            "description": entry.pop("description", ""),
            "schema": entry,
            "minOccurs": int(key in required),
            "maxOccurs": 1,
        }
    return summary(name) | {"inputs": inputs, "outputs": OUTPUTS}


def validated(name: str, inputs: dict[str, Any]) -> tuple[str, dict[str, Any]]:
    """Check the inputs of an order; returns the dataset's id and the parameters as JSON values.

    Raises
    ------
    Problem
        400 that names every refused input at once.
    """
    try:
        checked = _model(name).model_validate(inputs).model_dump(mode="json")
    except ValidationError as error:
        entries = error.errors(include_url=False, include_context=False)
        raise invalid(*(_under_inputs(field_error(entry)) for entry in entries)) from None
    dataset = checked.pop("dataset")
    try:
        parameters(name, checked)
    except InputError as error:
        raise invalid(FieldError(f"inputs.{error.field}", error.limit, error.value)) from None
    return dataset, checked


def parameters(name: str, inputs: dict[str, Any]) -> Parameters:
    """Return the product's own parameters for checked inputs."""
    made: Parameters = PRODUCTS[name].parameters(**inputs)
    return made


@cache
def _model(name: str) -> type[BaseModel]:
    dataset = Annotated[
        str,
        Strict(),
        Field(pattern="^[0-9a-hjkmnp-tv-z]{26}$", description=DATASETS[reads(name)]),
    ]
    fields: dict[str, Any] = {"dataset": (dataset, ...)}
    for spec in specifications(PRODUCTS[name].parameters):
        if spec.form != "path" and spec.name not in WITHHELD:
            default = list(spec.default) if isinstance(spec.default, tuple) else spec.default
            fields[spec.name] = (_annotation(spec), default)
    config = ConfigDict(extra="forbid", allow_inf_nan=False)
    return create_model(f"{name}-inputs", __config__=config, **fields)


def _annotation(spec: Specification) -> Any:
    bounds = [
        make(limit)
        for make, limit in ((Ge, spec.minimum), (Le, spec.maximum), (Gt, spec.above))
        if limit is not None
    ]
    kind: Any
    match spec.type:
        case "integer" if spec.choices:
            # A union's errors would name the branches; the library's own check names the field.
            words: Any = Literal.__getitem__(spec.choices)
            schema = TypeAdapter(Annotated[int, *bounds] | words).json_schema()
            kind = Annotated[Any, WithJsonSchema(schema)]
        case "integer":
            kind = Annotated[int, Strict(), *bounds]
        case "number":
            kind = Annotated[float, Strict(), *bounds]
        case "boolean":
            kind = Annotated[bool, Strict()]
        case "numbers":
            sizes = Len(spec.length or 1, spec.length or MAX_LIST)
            kind = Annotated[list[Annotated[float, Strict(), *bounds]], sizes]
        case "cells" | "points":
            number: Any = int if spec.type == "cells" else float
            member: Any = Annotated[number, Strict(), *bounds]
            pair: Any = Annotated[list[member], Len(2, 2)]
            kind = Annotated[list[pair], Len(1, MAX_LIST)]
        case _:
            kind = Literal[spec.choices] if spec.choices else Annotated[str, Strict()]
    if spec.optional:
        kind = kind | None
    unit = f" [{spec.unit}]" if spec.unit else ""
    return Annotated[kind, Field(description=spec.description + unit)]


def _under_inputs(error: FieldError) -> FieldError:
    return FieldError(f"inputs.{error.field}", error.limit, error.value)
