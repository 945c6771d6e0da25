"""Inputs by reference: the service's own datasets, and data URLs; no other address is opened."""

import base64
import binascii
import json
from collections.abc import Iterable, Mapping
from typing import Any
from urllib.parse import unquote_to_bytes

from adret_service.problems import FieldError, invalid

__all__ = ["resolved"]

LIMIT = "a data: URL, or for a dataset its address in this service"


def resolved(inputs: Mapping[str, Any], base: str, objects: Iterable[str] = ()) -> dict[str, Any]:
    """Return the inputs with references and qualified values replaced by what they stand for.

    Parameters
    ----------
    inputs : mapping
        As a client sent them: ``{"href": …}`` and ``{"value": …}`` are allowed for every input.
    base : str
        Absolute URL of the service.
    objects : iterable of str
        Inputs that are objects themselves: a member named value means nothing special there.

    Raises
    ------
    Problem
        400 that names every reference that is not followed.

    Examples
    --------
    >>> here = "https://adret.example"
    >>> resolved({"dataset": {"href": f"{here}/datasets/01m8"}, "n": {"value": 3}}, here)
    {'dataset': '01m8', 'n': 3}
    """
    errors: list[FieldError] = []
    found: dict[str, Any] = {}
    plain = set(objects)
    for name, value in inputs.items():
        if isinstance(value, dict) and isinstance(value.get("href"), str):
            try:
                found[name] = _followed(value["href"], base)
            except ValueError:
                errors.append(FieldError(f"inputs.{name}.href", LIMIT, value["href"]))
        elif isinstance(value, dict) and "value" in value and name not in plain:
            found[name] = value["value"]
        else:
            found[name] = value
    if errors:
        raise invalid(*errors)
    return found


def _followed(href: str, base: str) -> Any:
    own = f"{base}/datasets/"
    if href.startswith(own):
        return href[len(own) :]
    kind, comma, data = href.partition(",")
    if not kind.lower().startswith("data:") or not comma:
        raise ValueError(href)
    content = unquote_to_bytes(data)
    if kind.lower().endswith(";base64"):
        try:
            content = base64.b64decode(content, validate=True)
        except binascii.Error as error:
            raise ValueError(href) from error
    text = content.decode("utf-8")
    try:
        return json.loads(text) if "json" in kind.lower() else text
    except RecursionError as error:
        raise ValueError(href) from error
