"""Echoing: what the echo process does, in the worker and without a kernel."""

import base64
import binascii
import json
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

__all__ = ["BINARY", "ECHO", "ECHOED", "EchoFailed", "run_echo"]

ECHO = "echo"
ECHOED = ("string", "number", "array", "bbox", "object", "mixed", "binary")
BINARY = "application/octet-stream"
TICK = 0.1  # seconds


class EchoFailed(Exception):
    """The order asked for a failure."""


def run_echo(
    inputs: Mapping[str, Any], folder: Path, wanted: Callable[[], bool]
) -> dict[str, tuple[Path, str]] | None:
    """Write each input as an output; returns file and media type by name, None once unwanted.

    Parameters
    ----------
    inputs : mapping
        As `validated` made them.
    folder : Path
        Where the files go.
    wanted : callable
        Asked while the echo pauses.

    Raises
    ------
    EchoFailed
        If the inputs ask for it.
    """
    until = time.monotonic() + float(inputs.get("pause", 0.0))
    while time.monotonic() < until:
        if not wanted():
            return None
        time.sleep(min(TICK, max(until - time.monotonic(), 0.0)))
    if inputs.get("fail"):
        raise EchoFailed
    made = {}
    for name in ECHOED:
        if name not in inputs:
            continue
        if name == "binary":
            path, media = folder / "binary.bin", BINARY
            path.write_bytes(_decoded(inputs[name]))
        else:
            path, media = folder / f"{name}.json", "application/json"
            path.write_text(json.dumps(inputs[name]), encoding="utf-8")
        made[name] = path, media
    return made


def _decoded(text: str) -> bytes:
    """Base64 if it is, else the text's own bytes."""
    try:
        return base64.b64decode(text, validate=True)
    except (binascii.Error, ValueError):
        return text.encode("utf-8", "replace")
