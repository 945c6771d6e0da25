"""What is known of a parameter, and the check of every value against it."""

import sys
from dataclasses import dataclass, field, fields
from types import NoneType
from typing import Any, get_args, get_type_hints

from adret.errors import InputError

__all__ = ["Parameters", "Specification", "option", "specifications"]

MAX_LIST = 7200
"""Members that a list of pairs may have."""

LARGEST = sys.float_info.max  # whole numbers may be larger, and are no floats then


def option(
    default: Any,
    description: str,
    *,
    unit: str | None = None,
    minimum: float | None = None,
    maximum: float | None = None,
    above: float | None = None,
    length: int | None = None,
    form: str | None = None,
) -> Any:
    """A field with what the command line and the schemas say about it."""
    metadata = {
        "description": description,
        "unit": unit,
        "minimum": minimum,
        "maximum": maximum,
        "above": above,
        "length": length,
        "form": form,
    }
    return field(default=default, metadata=metadata)


@dataclass(frozen=True, slots=True, kw_only=True)
class Specification:
    """What is known of one parameter.

    Attributes
    ----------
    name : str
        Name of the field; a name that ends in _deg is in degrees.
    type : type
        "integer", "number", "boolean", "string", "numbers" (a list), "cells" (a list of pairs of
        whole numbers), "points" (a list of pairs of numbers) or "object" (of a class of ours, for
        callers from Python only; its owner checks it).
    optional : bool
        Whether None is allowed.
    default : object
    description : str
    unit : str or None
    choices : tuple of str
        Texts that are allowed, empty when any goes; of an "integer", words besides numbers.
    minimum, maximum, above : float or None
        Limits, `above` exclusive; of each number for a list.
    length : int or None
        Members of a list, when fixed.
    form : str or None
        "path" for a file that is read.
    """

    name: str
    type: str
    optional: bool
    default: Any
    description: str
    unit: str | None
    choices: tuple[str, ...]
    minimum: float | None
    maximum: float | None
    above: float | None
    length: int | None
    form: str | None


_KNOWN: dict[type, tuple[Specification, ...]] = {}


def specifications(parameters: "type[Parameters]") -> tuple[Specification, ...]:
    """What is known of each parameter of a product: its own first, then the shared ones.

    Examples
    --------
    >>> from adret.parameters import OpennessParameters
    >>> [s.name for s in specifications(OpennessParameters)][:3]
    ['sign', 'directions', 'tolerance']
    """
    if parameters in _KNOWN:
        return _KNOWN[parameters]
    hints = get_type_hints(parameters)
    known = {entry.name: entry for entry in fields(parameters)}
    parts = (vars(part).get("__annotations__", ()) for part in parameters.__mro__)
    order = dict.fromkeys(name for part in parts for name in part)
    found = []
    for entry in (known[name] for name in order):
        kind, optional, choices = _kind(hints[entry.name])
        found.append(
            Specification(
                name=entry.name,
                type=kind,
                optional=optional,
                default=entry.default,
                choices=choices,
                **entry.metadata,
            )
        )
    return _KNOWN.setdefault(parameters, tuple(found))


def _kind(hint: Any) -> tuple[str, bool, tuple[str, ...]]:
    """Type, whether None is allowed, and the words that are allowed."""
    members = [h for h in get_args(hint) if h is not NoneType]
    optional = NoneType in get_args(hint)
    if optional:
        hint = members[0]
    arguments = get_args(hint)
    if arguments and all(isinstance(a, str) for a in arguments):
        return "string", optional, arguments
    if arguments and arguments[0] is int and get_args(arguments[-1]):
        return "integer", optional, get_args(arguments[-1])  # a number, or one of some words
    if arguments:
        pairs = {tuple[int, int]: "cells", tuple[float, float]: "points"}
        return pairs.get(arguments[0], "numbers"), optional, ()
    names = {int: "integer", float: "number", bool: "boolean", str: "string"}
    return names.get(hint, "object"), optional, ()


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """Base: every field is held against its type and limits when the object is made."""

    def __post_init__(self) -> None:
        """Check, and turn lists and whole numbers into the declared types."""
        for spec in specifications(type(self)):
            value = getattr(self, spec.name)
            if value is None and spec.optional:
                continue
            object.__setattr__(self, spec.name, _checked(spec, value))


def _checked(spec: Specification, value: Any) -> Any:
    if spec.type == "boolean":
        if not isinstance(value, bool):
            raise InputError(spec.name, "true or false", value)
        return value
    if spec.type == "string":
        if not isinstance(value, str) or (spec.choices and value not in spec.choices):
            limit = f"one of {', '.join(spec.choices)}" if spec.choices else "text"
            raise InputError(spec.name, limit, value)
        return value
    if spec.type == "numbers":
        if isinstance(value, str) or not hasattr(value, "__iter__"):
            raise InputError(spec.name, "a list of numbers", value)
        numbers = tuple(_number(spec, member) for member in value)
        if not numbers or (spec.length is not None and len(numbers) != spec.length):
            limit = f"{spec.length} numbers" if spec.length is not None else "at least one number"
            raise InputError(spec.name, limit, value)
        return numbers
    if spec.type in ("cells", "points"):
        return _pairs(spec, value)
    if spec.type == "object":
        return value
    if isinstance(value, str) and value in spec.choices:
        return value
    return _number(spec, value)


def _pairs(spec: Specification, value: Any) -> tuple[tuple[float | int, ...], ...]:
    limit = f"a list of up to {MAX_LIST} pairs of numbers"
    if isinstance(value, str) or not hasattr(value, "__len__") or not 1 <= len(value) <= MAX_LIST:
        raise InputError(spec.name, limit, value)
    for member in value:
        if isinstance(member, str) or not hasattr(member, "__len__") or len(member) != 2:
            raise InputError(spec.name, limit, member)
    return tuple(tuple(_number(spec, number) for number in member) for member in value)


def _number(spec: Specification, value: Any) -> float | int:
    whole = spec.type in ("integer", "cells")
    wanted = "a whole number" if whole else "a number"
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InputError(spec.name, f"{wanted}{_limits(spec)}", value)
    inside = (
        -LARGEST <= value <= LARGEST
        and (spec.minimum is None or value >= spec.minimum)
        and (spec.maximum is None or value <= spec.maximum)
        and (spec.above is None or value > spec.above)
    )
    if not inside or (whole and value != int(value)):
        raise InputError(spec.name, f"{wanted}{_limits(spec)}", value)
    return int(value) if whole else float(value)


def _limits(spec: Specification) -> str:
    words = f" or {' or '.join(spec.choices)}" if spec.choices else ""
    unit = (f" {spec.unit}" if spec.unit else "") + words
    low = spec.minimum if spec.above is None else spec.above
    if low is not None and spec.maximum is not None:
        return f" between {low:g} and {spec.maximum:g}{unit}"
    if low is not None:
        return f" {'of at least' if spec.above is None else 'above'} {low:g}{unit}"
    return f" of at most {spec.maximum:g}{unit}" if spec.maximum is not None else words
