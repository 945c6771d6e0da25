"""Numbers as callers give them: what is none, or out of range, is refused by name."""

import math
import numbers
import os
import sys
from collections.abc import Sequence
from typing import Any

from adret.errors import InputError, RasterError

__all__ = ["file_path", "one_of", "real", "whole"]


LARGEST = sys.float_info.max


def real(field: str, value: Any, limit: str, low: float = -LARGEST, high: float = LARGEST) -> float:
    """A number from `low` to `high`, as a float; infinite only where a bound is.

    Texts, truth values, complex numbers and arrays are no numbers.

    Raises
    ------
    InputError
        Naming `field` and `limit`.
    """
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise InputError(field, limit, value)
    try:
        number = float(value)
    except OverflowError:
        raise InputError(field, limit, value) from None
    if not low <= number <= high:
        raise InputError(field, limit, value)
    return number


def whole(field: str, value: Any, limit: str, low: int, high: float = math.inf) -> int:
    """A whole number from `low` to `high`, as an int; 2.0 is one.

    Raises
    ------
    InputError
        Naming `field` and `limit`.
    """
    number = real(field, value, limit, low, high)
    if not number.is_integer():
        raise InputError(field, limit, value)
    return int(value)


def one_of(field: str, value: Any, words: Sequence[str]) -> None:
    """Refuse what is none of these words.

    Raises
    ------
    InputError
        Naming `field` and the words.
    """
    if not isinstance(value, str) or value not in words:
        raise InputError(field, f"one of {', '.join(words)}", value)


def file_path(field: str, value: Any) -> str:
    """The path of a file as text.

    Raises
    ------
    RasterError
        If it is none.
    """
    try:
        text = os.fspath(value)
    except TypeError:
        text = None
    if not isinstance(text, str):
        raise RasterError(field, "the path of a file", value)
    return text
