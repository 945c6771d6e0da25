"""What `adret plan` and `adret batch` share: options of many products, sizes, the job."""

import glob
import inspect
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from adret.cli.options import numbers, option_name, option_of, parameter, value_of
from adret.errors import InputError
from adret.parameters import (
    BounceParameters,
    HorizonParameters,
    LightParameters,
    OpennessParameters,
    Parameters,
    ShadowParameters,
    SkyViewParameters,
    Specification,
    ViewshedParameters,
    VisibilityParameters,
    specifications,
)

if TYPE_CHECKING:
    from adret.tiling.jobs import Job

__all__ = ["Request", "job_command", "job_of"]

PARAMETERS: tuple[type[Parameters], ...] = (
    HorizonParameters,
    SkyViewParameters,
    OpennessParameters,
    ShadowParameters,
    LightParameters,
    VisibilityParameters,
    ViewshedParameters,
    BounceParameters,
)
UNITS = {"K": 1 << 10, "M": 1 << 20, "G": 1 << 30, "T": 1 << 40}

# Options of both commands: name, kind, default, metavar, help.
SHARED: tuple[tuple[str, Any, Any, str, str], ...] = (
    (
        "product",
        str,
        "sky",
        "NAME,NAME,...",
        "Of horizon, sky, openness, shadow, light, bounce, viewshed and visibility.",
    ),
    ("tile_size", str, "2048", "N", "Cells a side of a tile; multiples of 512 go fastest."),
    ("memory", str, "2G", "SIZE", "Memory that a worker may take, as in 800M or 2G."),
    ("workers", str, "1", "N", "Processes; the cores are shared out among them."),
    ("band", str, "1", "N", "Band that holds the heights."),
    ("cell_size", str | None, None, "DX,DY", "Metres a cell, for files that do not say it."),
    ("vertical_unit", str | None, None, "UNIT", "Unit of the heights: m, ft, us-ft, ..."),
    (
        "surroundings",
        str | None,
        None,
        "FILE",
        "Coarser raster of the ground beyond the edges; needs --max-distance.",
    ),
)

Common = tuple[str, Any, Any, str | None, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """What was typed, checked."""

    sources: tuple[str, ...]
    products: Mapping[str, Parameters]
    tile_size: int
    memory: int
    workers: int
    band: int
    cell_size: tuple[float, float] | None
    vertical_unit: str | None
    surroundings: str | None


def job_command(
    name: str,
    text: str,
    places: str,
    action: Callable[..., int | None],
    more: Sequence[Common] = (),
) -> Callable[[typer.Typer], None]:
    """Return the function that registers a command about many products.

    Parameters
    ----------
    name, text : str
        What is typed, and its help.
    places : str
        What the arguments are, for the help.
    action : callable
        action(arguments, request, **more) -> exit code; arguments as they were typed, the
        request made of them all.
    more : sequence
        Further options.
    """
    known: dict[str, Specification] = {}
    for parameters in PARAMETERS:
        for spec in specifications(parameters):
            first = known.setdefault(spec.name, spec)
            choices = dict.fromkeys((*first.choices, *spec.choices))
            known[spec.name] = replace(first, choices=tuple(choices))

    def run(places: list[str], **given: Any) -> int | None:
        shared = {entry[0]: given.pop(entry[0]) for entry in SHARED}
        others = {entry[0]: given.pop(entry[0]) for entry in more}
        typed = {
            field: value_of(known[field], value)
            for field, value in given.items()
            if value not in (None, [])
        }
        return action(tuple(places), _request(typed, **shared), **others)

    argument = typer.Argument(metavar=places, help="Elevation rasters; patterns are expanded.")
    options = [parameter("places", list[str], argument)]
    for field, kind, default, metavar, words in (*SHARED, *more):
        if kind is bool:
            declared = typer.Option(option_name(field), help=words)
        else:
            declared = typer.Option(option_name(field), metavar=metavar, help=words)
        options.append(parameter(field, kind, declared, default))
    for spec in known.values():
        # Products have defaults of their own: nothing typed is nothing said.
        silent = replace(spec, default=None) if spec.type != "boolean" else spec
        made = option_of(silent)
        if spec.type == "boolean":
            made = made.replace(default=None, annotation=_maybe(made.annotation))
        options.append(made)
    run.__signature__ = inspect.Signature(options)  # type: ignore[attr-defined]
    run.__annotations__ = {each.name: each.annotation for each in options}
    run.__doc__ = text

    def register(app: typer.Typer) -> None:
        app.command(name)(run)

    return register


def job_of(
    request: Request,
    sources: Sequence[str],
    progress: Any = None,
    datum: float | None = None,
) -> "Job":
    """The job of a surface of files; of one that was begun, its datum is known."""
    from adret.tiling import Job, Surface

    surface = Surface.open(
        expand(sources),
        request.band,
        cell_size=request.cell_size,
        vertical_unit=request.vertical_unit,
        datum=datum,
        surroundings=request.surroundings,
        progress=progress,
    )
    return Job(surface, request.products, request.tile_size)


def expand(sources: Sequence[str]) -> list[str]:
    """Files of names, patterns and STAC items, without repetition.

    A pattern's are in the order of the names, a collection's in that of its items.

    Raises
    ------
    InputError
        If a pattern fits no file.
    RasterError
        If a document with items cannot be used.
    """
    from adret.tiling.item_collections import is_collection, rasters_of

    found: list[str] = []
    for source in sources:
        names = [source]
        if not os.path.exists(source) and glob.has_magic(source):
            names = sorted(glob.glob(source))
            if not names:
                raise InputError("IN", "a file, or a pattern of files that exist", source)
        for name in names:
            files = rasters_of(name) if is_collection(name) else [name]
            found += [file for file in files if file not in found]
    return found


def size_of(field: str, text: str) -> int:
    """Bytes of 800M, 2G, 2.5GiB.

    Examples
    --------
    >>> size_of("memory", "2G") == 2 * 1024**3
    True
    """
    short = text.strip().upper().removesuffix("B").removesuffix("I")
    unit = UNITS.get(short[-1:], 0)
    try:
        size = float(short[:-1] if unit else short) * (unit or 1)
    except ValueError:
        size = -1.0
    if not 1 << 20 <= size <= 1 << 60:
        raise InputError(field, "a size such as 800M or 2G, at least 1M", text)
    return int(size)


def whole_of(field: str, text: str, low: int, high: int) -> int:
    """A whole number in range."""
    limit = f"a whole number between {low} and {high}"
    if not text.isdigit() or not low <= int(text) <= high:
        raise InputError(field, limit, text)
    return int(text)


def _request(
    typed: dict[str, Any],
    *,
    product: str,
    tile_size: str,
    memory: str,
    workers: str,
    band: str,
    cell_size: str | None,
    vertical_unit: str | None,
    surroundings: str | None,
) -> Request:
    from adret.tiling.tasks import tiled_product

    for field in ("environment", "albedo_map", "emission"):
        if field in typed:
            typed[field] = str(Path(typed[field]).absolute())
    products: dict[str, Parameters] = {}
    used: set[str] = set()
    for name in product.split(","):
        chosen = tiled_product(name.strip())
        fields = {spec.name for spec in specifications(chosen.parameters)}
        used |= fields
        own = {field: value for field, value in typed.items() if field in fields}
        products[chosen.name] = chosen.parameters(**own)
    for field in typed:
        if field not in used:
            raise InputError(field, f"left out for {product}", typed[field])
    size = None if cell_size is None else numbers("cell_size", cell_size, 2)
    return Request(
        sources=(),
        products=products,
        tile_size=whole_of("tile_size", tile_size, 16, 65536),
        memory=size_of("memory", memory),
        workers=whole_of("workers", workers, 1, 1024),
        band=whole_of("band", band, 1, 65535),
        cell_size=None if size is None else (size[0], size[1]),
        vertical_unit=vertical_unit,
        surroundings=surroundings,
    )


def _maybe(annotation: Any) -> Any:
    """An annotated switch that may also be left alone."""
    from typing import Annotated

    return Annotated[bool | None, annotation.__metadata__[0]]
