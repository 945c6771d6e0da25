"""The Prefer header (RFC 7240): whether a client would rather wait or come back."""

import re
from collections.abc import Iterable

__all__ = ["Preferences", "preferences"]

Preferences = dict[str, str]

_TOKEN = r"[!#$%&'*+.^_`|~0-9A-Za-z-]+"
_PREFERENCE = re.compile(rf'\s*({_TOKEN})(?:\s*=\s*("(?:[^"\\]|\\.)*"|{_TOKEN}))?\s*')


def preferences(values: Iterable[str]) -> Preferences:
    """Return the preferences of all Prefer headers of a request, by name.

    A name that comes twice keeps its first value; parameters after a semicolon, and whatever is
    not a preference, are passed over, as the RFC asks.

    Examples
    --------
    >>> preferences(["respond-async , wait=10; x=1", "wait=20"])
    {'respond-async': '', 'wait': '10'}
    """
    found: Preferences = {}
    for value in values:
        for item in value.split(","):
            match = _PREFERENCE.fullmatch(item.split(";", 1)[0])
            if match is not None:
                name, given = match.groups()
                found.setdefault(name.lower(), (given or "").strip('"'))
    return found
