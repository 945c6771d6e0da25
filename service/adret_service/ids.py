"""Identifiers made by the server: sortable by time, impossible to guess."""

import re
import secrets
import time

__all__ = ["is_id", "new_id"]

_ALPHABET = "0123456789abcdefghjkmnpqrstvwxyz"
_PATTERN = re.compile(r"[0-9a-hjkmnp-tv-z]{26}")


def new_id() -> str:
    """Return a lower-case ULID: 48 bits of milliseconds, then 80 random bits.

    Examples
    --------
    >>> len(new_id())
    26
    """
    number = (int(time.time() * 1000) << 80) | secrets.randbits(80)
    return "".join(_ALPHABET[(number >> shift) & 31] for shift in range(125, -1, -5))


def is_id(text: str) -> bool:
    """Whether `text` has the form of an identifier made here.

    Examples
    --------
    >>> is_id("../../etc/passwd")
    False
    """
    return _PATTERN.fullmatch(text) is not None
