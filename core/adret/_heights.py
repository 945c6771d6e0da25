"""Arrays of heights as callers give them, checked and brought above a datum."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adret._values import real
from adret.errors import InputError

__all__ = ["MAX_HEIGHT", "above_datum", "check_range", "checked_array", "middle"]

MAX_HEIGHT = 1e9
_BLOCK = 1 << 22


def checked_array(heights: ArrayLike) -> tuple[NDArray[Any], NDArray[np.bool_] | None]:
    """The caller's array as it is, and its mask."""
    mask = np.ma.getmask(heights)
    values = np.ma.getdata(heights) if isinstance(heights, np.ma.MaskedArray) else heights
    try:
        array = np.asarray(values)
    except ValueError:
        raise InputError("heights", "a two-dimensional array", type(heights).__name__) from None
    if array.dtype.kind not in "iuf":
        raise InputError("heights", "real numbers", array.dtype.name)
    if array.ndim != 2:
        raise InputError("heights", "two-dimensional (rows, columns)", f"shape {array.shape}")
    if array.size == 0:
        raise InputError("heights", "at least 1 x 1 cells", f"shape {array.shape}")
    return array, None if mask is np.ma.nomask else np.asarray(mask)


def above_datum(
    values: NDArray[Any],
    masked: NDArray[np.bool_] | None,
    factor: float,
    datum: float | None,
) -> tuple[NDArray[np.float32], float]:
    """Metres above the datum, and the datum; in blocks of rows to spare memory."""
    step = max(1, _BLOCK // values.shape[1])
    blocks = [slice(r, r + step) for r in range(0, values.shape[0], step)]

    def metres(rows: slice) -> NDArray[np.float64]:
        block = values[rows].astype(np.float64)
        if masked is not None:
            block[masked[rows]] = np.nan
        return np.multiply(block, factor, out=block)

    low, high = math.inf, -math.inf
    for rows in blocks:
        block = metres(rows)
        low = min(low, float(np.fmin.reduce(block, axis=None, initial=math.inf)))
        high = max(high, float(np.fmax.reduce(block, axis=None, initial=-math.inf)))
    check_range(low, high)
    if datum is None:
        datum = middle(low, high)
    else:
        limit = f"a height within +-{MAX_HEIGHT:g} m"
        datum = real("datum", datum, limit, -MAX_HEIGHT, MAX_HEIGHT)
    heights = np.empty(values.shape, dtype=np.float32)
    for rows in blocks:
        np.subtract(metres(rows), float(datum), out=heights[rows], casting="same_kind")
    heights.setflags(write=False)
    return heights, float(datum)


def check_range(low: float, high: float) -> None:
    """Refuse heights from `low` to `high` [m] that are infinite, too large, or not there at all."""
    if high == math.inf:
        raise InputError("heights", "finite or NaN", math.inf)
    if math.isinf(low) and low > 0.0:
        raise InputError("heights", "a number in at least one cell", "all nodata")
    for value in (low, high):
        if not abs(value) <= MAX_HEIGHT:
            limit = f"within +-{MAX_HEIGHT:g} m (is a nodata value undeclared?)"
            raise InputError("heights", "finite or NaN" if math.isinf(value) else limit, value)


def middle(low: float, high: float) -> float:
    """The datum of a raster: the middle of its range of heights, in whole metres."""
    return float(round(low / 2.0 + high / 2.0))
