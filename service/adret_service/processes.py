"""The library's products as OGC processes: schemas and checks come from their typed parameters."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from typing import Annotated, Any, Literal

from annotated_types import Ge, Gt, Le, Len
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    PlainSerializer,
    Strict,
    TypeAdapter,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WithJsonSchema,
    WrapValidator,
    create_model,
)

import adret
from adret.errors import InputError
from adret.parameters import MAX_LIST, Parameters, Specification, specifications
from adret.products import PRODUCTS
from adret_service.datasets import GEOTIFF
from adret_service.problems import FieldError, field_error, invalid

__all__ = ["Process", "names", "parameters", "process", "validated"]

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Process:
    """What can be ordered.

    Attributes
    ----------
    id, title, description, version : str
        For clients.
    control : tuple of str
        How it may be ordered: sync-execute, async-execute, dismiss.
    inputs, outputs : mapping of str to dict
        Descriptions by name, each with a JSON Schema.
    reads : str or None
        Kind of dataset that it takes: "terrain" or "depth"; None for none.
    objects : tuple of str
        Inputs that are JSON objects.
    validate : callable
        Checks inputs; returns the dataset's id and the parameters as JSON values.
    """

    id: str
    title: str
    description: str
    version: str
    control: tuple[str, ...]
    inputs: Mapping[str, dict[str, Any]]
    outputs: Mapping[str, dict[str, Any]]
    reads: str | None
    objects: tuple[str, ...] = ()
    validate: Callable[[Mapping[str, Any]], tuple[str, dict[str, Any]]]

    def summary(self) -> dict[str, Any]:
        """Return the short form."""
        return {
            "id": self.id,
            "title": self.title,
            "description": self.description,
            "version": self.version,
            "jobControlOptions": list(self.control),
            "outputTransmission": ["reference", "value"],
        }


@cache
def process(name: str) -> Process:
    """Return the process of a product; a large raster takes its time, so it is never waited for."""
    product = PRODUCTS[name]
    return Process(
        id=name,
        title=product.title,
        description=product.description,
        version=adret.__version__,
        control=("async-execute", "dismiss"),
        inputs=_inputs(name),
        outputs=OUTPUTS,
        reads=product.reads,
        validate=partial(validated, name),
    )


def _inputs(name: str) -> dict[str, dict[str, Any]]:
    schema = _model(name).model_json_schema()
    required = schema.get("required", [])
    inputs = {}
    for key, entry in schema["properties"].items():
        entry = plain(entry)
        inputs[key] = {
            "title": entry.pop("title", key),
            "description": entry.pop("description", ""),
            "schema": entry,
            "minOccurs": int(key in required),
            "maxOccurs": 1,
        }
    return inputs


def plain(schema: dict[str, Any]) -> dict[str, Any]:
    """Return a JSON Schema in words that the standard's own schema dialect has, too.

    That dialect is OpenAPI 3.0's: null is no type there and a bound is exclusive by a flag. What
    may be null may as well be left out, and is described so.

    Examples
    --------
    >>> plain({"anyOf": [{"type": "number", "exclusiveMinimum": 0}, {"type": "null"}]})
    {'type': 'number', 'minimum': 0, 'not': {'enum': [0]}, 'nullable': True}
    """
    found: dict[str, Any] = {}
    for key, value in schema.items():
        if key == "anyOf":
            branches = [plain(branch) for branch in value if branch != {"type": "null"}]
            found |= branches[0] if len(branches) == 1 else {"anyOf": branches}
            if len(branches) < len(value):
                found["nullable"] = True
        elif key == "exclusiveMinimum":
            found |= {"minimum": value, "not": {"enum": [value]}}
        elif key == "const":
            found["enum"] = [value]
        elif key == "items":
            found["items"] = plain(value)
        elif key != "default" or value is not None:
            found[key] = value
    return found


def validated(name: str, inputs: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """Check the inputs of an order; returns the dataset's id and the parameters as JSON values.

    Raises
    ------
    Problem
        400 that names every refused input at once.
    """
    try:
        checked = _model(name).model_validate(dict(inputs)).model_dump(mode="json")
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
        Field(pattern="^[0-9a-hjkmnp-tv-z]{26}$", description=DATASETS[PRODUCTS[name].reads]),
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
            # A union's errors would name the branches, not the field.
            number: Any = Annotated[int, Strict(), *bounds]
            words: Any = Literal.__getitem__(spec.choices)
            schema = TypeAdapter(number | words).json_schema()
            or_words = _or_one_of(spec.choices)
            kind = Annotated[number, or_words, _as_it_is, WithJsonSchema(schema)]
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
            single: Any = int if spec.type == "cells" else float
            member: Any = Annotated[single, Strict(), *bounds]
            pair: Any = Annotated[list[member], Len(2, 2)]
            kind = Annotated[list[pair], Len(1, MAX_LIST)]
        case _:
            kind = Literal[spec.choices] if spec.choices else Annotated[str, Strict()]
    if spec.optional:
        kind = kind | None
    unit = f" [{spec.unit}]" if spec.unit else ""
    return Annotated[kind, Field(description=spec.description + unit)]


_as_it_is = PlainSerializer(lambda value: value)


def _or_one_of(words: tuple[str, ...]) -> WrapValidator:
    """Let some words stand for a number."""

    def checked(value: Any, number: ValidatorFunctionWrapHandler) -> Any:
        if not isinstance(value, str):
            return number(value)
        if value not in words:
            raise ValueError(f"a whole number or {' or '.join(words)}")
        return value

    return WrapValidator(checked)


def _under_inputs(error: FieldError) -> FieldError:
    return FieldError(f"inputs.{error.field}", error.limit, error.value)
