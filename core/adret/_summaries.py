"""Results in one line: what they hold, not the numbers."""

from dataclasses import fields
from typing import Any

import numpy as np

__all__ = ["summary"]


def summary(result: Any) -> str:
    """Name of a dataclass and its fields, arrays by type and shape.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass
    ... class Found:
    ...     layer: np.ndarray
    ...     unit: str
    ...     __repr__ = summary
    >>> Found(np.zeros((2, 3), np.float32), "m")
    Found(layer=float32 (2, 3), unit='m')
    """
    shown = (f"{each.name}={_shown(getattr(result, each.name))}" for each in fields(result))
    return f"{type(result).__name__}({', '.join(shown)})"


def _shown(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape}"
    if isinstance(value, tuple) and len(value) > 4:
        return f"{len(value)} of them"
    return repr(value)
