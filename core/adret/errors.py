"""The errors that Adret raises on purpose: each names the field, the limit and the value."""

from typing import Any

__all__ = ["AdretError", "Cancelled", "InputError", "RasterError"]


class AdretError(Exception):
    """Base of every error that Adret raises on purpose."""


class InputError(AdretError, ValueError):
    """A parameter or an array that cannot be used.

    Parameters
    ----------
    field : str
        Name of the parameter, as the caller wrote it.
    limit : str
        What the value must be, read after "must be".
    value : object
        What was given.

    Examples
    --------
    >>> raise InputError("directions", "between 1 and 7200", 0)
    Traceback (most recent call last):
    adret.errors.InputError: directions: must be between 1 and 7200, got 0
    """

    def __init__(self, field: str, limit: str, value: Any) -> None:
        super().__init__(field, limit, value)
        self.field = field
        self.limit = limit
        self.value = value

    def __str__(self) -> str:
        """One line: field, limit and value."""
        return f"{self.field}: must be {self.limit}, got {self.value!r}"


class RasterError(InputError):
    """A file that cannot be read or written as a raster."""


class Cancelled(AdretError):
    """The caller asked the run to stop."""
