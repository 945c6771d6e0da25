"""Command-line options made from the products' parameters: same names, limits and defaults."""

import inspect
from collections.abc import Callable
from typing import Annotated, Any

import typer

from adret.errors import InputError
from adret.parameters import Parameters, Specification, specifications

__all__ = ["DEPTH", "TERRAIN", "command", "numbers", "option_name"]

_METAVAR = {
    "integer": "N",
    "number": "X",
    "numbers": "X,X,...",
    "string": "TEXT",
    "cells": "ROW,COL",
    "points": "X,Y",
}

Common = tuple[str, Any, Any, str | None, str]

# Options of every product's command: name, kind, default, metavar, help.
_COMMON: tuple[Common, ...] = (
    ("preview", str | None, None, "PNG", "Write a picture as well."),
    ("threads", str | None, None, "N", "Threads to use; default: all."),
    ("overwrite", bool, False, None, "Replace files that exist."),
)

# Options of those that read a terrain, and of those that read a depth buffer.
TERRAIN: tuple[Common, ...] = (
    ("band", str, "1", "N", "Band that holds the heights."),
    ("cell_size", str | None, None, "DX,DY", "Metres a cell, for files that do not say it."),
    ("vertical_unit", str | None, None, "UNIT", "Unit of the heights: m, ft, us-ft, ..."),
)
DEPTH: tuple[Common, ...] = (
    ("camera", str, ..., "JSON", "Camera that saw the depths."),
    ("kind", str | None, None, "KIND", "linear, distance or device; default: as the camera says."),
    ("guard_band", str | None, None, "N", "Pixels at each side that only occlude."),
)


def option_name(field: str) -> str:
    """--near for near, --sun for sun_deg."""
    return "--" + field.removesuffix("_deg").replace("_", "-")


def command(
    name: str,
    parameters: type[Parameters],
    text: str,
    action: Callable[..., None],
    source: tuple[Common, ...] = TERRAIN,
) -> Callable[[typer.Typer], None]:
    """Return the function that registers a product's command.

    Parameters
    ----------
    name : str
        What is typed.
    parameters : type
        The product's dataclass; each field becomes an option.
    text : str
        Help, with examples.
    action : callable
        action(source, out, parameters, **common options).
    source : tuple
        Options about what is read: `TERRAIN` or `DEPTH`.
    """
    known = specifications(parameters)
    shared = (_COMMON[0], *source, *_COMMON[1:])

    def run(source: str, out: str, **given: Any) -> None:
        common = {entry[0]: given.pop(entry[0]) for entry in shared}
        chosen = {
            spec.name: value_of(spec, given[spec.name])
            for spec in known
            if given[spec.name] not in (None, [])
        }
        action(source, out, parameters(**chosen), **common)

    reads = "Elevation raster to read." if source is TERRAIN else "Depth buffer to read."
    arguments = [
        parameter("source", str, typer.Argument(metavar="IN", help=reads)),
        parameter("out", str, typer.Argument(metavar="OUT", help="GeoTIFF to write.")),
    ]
    options = [option_of(spec) for spec in known]
    for field, kind, default, metavar, text_of in shared:
        declared = typer.Option(option_name(field), metavar=metavar, help=text_of)
        empty = inspect.Parameter.empty
        options.append(parameter(field, kind, declared, empty if default is ... else default))
    options.sort(key=lambda option: option.default is not inspect.Parameter.empty)
    run.__signature__ = inspect.Signature([*arguments, *options])  # type: ignore[attr-defined]
    run.__annotations__ = {p.name: p.annotation for p in (*arguments, *options)}
    run.__doc__ = text

    def register(app: typer.Typer) -> None:
        app.command(name)(run)

    return register


def parameter(
    name: str, kind: Any, declared: Any, default: Any = inspect.Parameter.empty
) -> inspect.Parameter:
    return inspect.Parameter(
        name,
        inspect.Parameter.POSITIONAL_OR_KEYWORD,
        default=default,
        annotation=Annotated[kind, declared],
    )


def option_of(spec: Specification) -> inspect.Parameter:
    name = option_name(spec.name)
    text = spec.description if spec.unit is None else f"{spec.description} [{spec.unit}]"
    if spec.type == "boolean":
        names = f"{name}/--no-{name[2:]}"
        return parameter(spec.name, bool, typer.Option(names, help=text), spec.default)
    metavar = "|".join(spec.choices) if spec.choices else _METAVAR[spec.type]
    if spec.type == "integer" and spec.choices:
        metavar = f"N|{metavar}"
    if spec.type in ("cells", "points"):
        repeated = typer.Option(name, metavar=metavar, help=f"{text} May be repeated.")
        return parameter(spec.name, list[str] | None, repeated, None)
    if spec.length == 2:
        metavar = "FROM,TO" if "range" in spec.name else "AZ,EL"
    if spec.form == "path":
        metavar = "FILE"
    shown = spec.default is not None
    if shown:
        text = f"{text} [default: {_shown(spec.default)}]"
    # Text, so that wrong values meet the parameters' own checks and messages.
    declared = typer.Option(name, metavar=metavar, help=text, show_default=False)
    return parameter(spec.name, str | None, declared, None)


def _shown(default: Any) -> str:
    if isinstance(default, tuple):
        return ",".join(f"{member:g}" for member in default)
    return str(default)


def value_of(spec: Specification, text: Any) -> Any:
    """The typed value that was written; text stays text where it is no number."""
    if spec.type in ("boolean", "string"):
        return text
    if spec.type in ("cells", "points"):
        return tuple(numbers(spec.name, each, 2) for each in text)
    if spec.type == "numbers":
        return numbers(spec.name, text, spec.length)
    try:
        return int(text) if spec.type == "integer" else float(text)
    except ValueError:
        return text


def numbers(field: str, text: str, length: int | None = None) -> tuple[float, ...]:
    """Numbers separated by commas.

    Raises
    ------
    InputError
        If it is anything else, or not `length` numbers.
    """
    limit = f"{length} numbers" if length is not None else "numbers"
    try:
        found = tuple(float(part) for part in text.split(","))
    except ValueError:
        raise InputError(field, f"{limit} separated by commas", text) from None
    if length is not None and len(found) != length:
        raise InputError(field, f"{limit} separated by commas", text)
    return found
