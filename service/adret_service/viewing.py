"""The process that answers while a client waits: tiles, pictures, values and horizons of a point.

It reads orders as JSON lines from its standard input and answers each with one JSON line, followed
by as many bytes as that line says. It has no connection to the database or the network, opens only
rasters that Adret itself wrote, and ends with its input. Kernels are loaded by the first horizon.
"""

import json
import os
import sys
import traceback
from typing import Any, BinaryIO

from adret.errors import InputError
from adret_service import rendering
from adret_service.precedence import step_back
from adret_service.problems import FieldError, Problem, invalid

__all__ = ["main"]

JSON = "application/json"


def tile(order: dict[str, Any]) -> tuple[bytes, str] | None:
    """Return a tile."""
    with rendering.opened(order["path"]) as source:
        return rendering.tile(source, order["z"], order["x"], order["y"], **order["style"])


def preview(order: dict[str, Any]) -> tuple[bytes, str]:
    """Return a picture of the whole."""
    with rendering.opened(order["path"]) as source:
        return rendering.preview(source, **order["style"])


def tile_grid(order: dict[str, Any]) -> tuple[bytes, str]:
    """Return the grid of a raster's tiles."""
    with rendering.opened(order["path"]) as source:
        return as_json(rendering.tile_grid(source))


def statistics(order: dict[str, Any]) -> tuple[bytes, str]:
    """Return the statistics of a raster's bands."""
    with rendering.opened(order["path"]) as source:
        return as_json(rendering.statistics(source, bands=order["bands"]))


def point(order: dict[str, Any]) -> tuple[bytes, str]:
    """Return the values at a place."""
    with rendering.opened(order["path"]) as source:
        return as_json(rendering.point(source, order["lon"], order["lat"], bands=order["bands"]))


def horizon(order: dict[str, Any]) -> tuple[bytes, str]:
    """Return the horizon of a place."""
    from adret_service import skylines

    return as_json(skylines.skyline(order["path"], order["info"], **order["place"]))


WORK = {
    "tile": tile,
    "preview": preview,
    "tilegrid": tile_grid,
    "statistics": statistics,
    "point": point,
    "horizon": horizon,
}


def as_json(body: Any) -> tuple[bytes, str]:
    """Return a document as bytes."""
    return json.dumps(body).encode(), JSON


def answer_to(order: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
    """Do one order; returns the head of the answer and its bytes."""
    try:
        found = WORK[order["work"]](order)
    except Problem as problem:
        return refusal(problem), b""
    except InputError as error:
        return refusal(invalid(FieldError(error.field, error.limit, error.value))), b""
    except Exception as error:
        traceback.print_exc()
        return {"failed": type(error).__name__}, b""
    if found is None:
        return {"empty": True}, b""
    return {"type": found[1]}, found[0]


def refusal(problem: Problem) -> dict[str, Any]:
    """Return a refusal as JSON."""
    return {
        "status": problem.status,
        "type_": problem.type,
        "detail": problem.detail,
        "errors": [error.body() for error in problem.errors],
    }


def serve(source: BinaryIO, target: BinaryIO) -> None:
    """Answer orders until the input closes."""
    for line in source:
        head, body = answer_to(json.loads(line))
        target.write(json.dumps(head | {"bytes": len(body)}).encode() + b"\n" + body)
        target.flush()


def main() -> None:
    """Serve orders; the argument is how nice to be to the API.

    Whatever a library prints must not mix with the answers.
    """
    step_back(int(sys.argv[1]) if len(sys.argv) > 1 else 0, session=True)
    target = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    serve(sys.stdin.buffer, target)


if __name__ == "__main__":
    main()
