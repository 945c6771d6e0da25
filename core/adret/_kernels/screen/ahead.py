"""What need not be looked at: blocks without receivers, and directions with nothing ahead.

Of a direction of the image the largest nearness from some row on, and from some column on, bounds
the slope of every sample that is still to come. Where that bound is below the horizons of a whole
block, going on changes no bit.
"""

import math

import numpy as np

from adret._kernels.jit import kernel
from adret._kernels.screen.slices import BASE, LANES, RAISED

LEEWAY = np.float32(2.0**-20)  # rounding of slopes, as a share of the nearnesses they come from


@kernel
def all_empty(empty, n):
    """Whether the first n pixels of a block are all without a receiver."""
    return empty[:n].all()


@kernel
def highest_ahead(ahead, way):
    """Upper bound of the nearness of what a block meets beyond a way in the image.

    `ahead` is (tops, shape, row, first column, columns to the last one, direction).
    """
    tops, shape, row, column, span, dc, dr = ahead
    # A pixel further back, for cells that begin before the way does.
    high = np.float32(np.inf)
    if dr > 0.0:
        at = math.floor(row + way * dr) - 1
        high = tops[1, min(max(at, 0), shape[0] - 1)]
    elif dr < 0.0:
        at = math.ceil(row + way * dr) + 1
        high = tops[0, min(max(at, 0), shape[0] - 1)]
    if dc > 0.0:
        at = math.floor(column + way * dc) - 1
        high = min(high, tops[3, min(max(at, 0), shape[1] - 1)])
    elif dc < 0.0:
        at = math.ceil(column + span + way * dc) + 1
        high = min(high, tops[2, min(max(at, 0), shape[1] - 1)])
    return high


@kernel
def may_rise(w, high, way, last):
    """Whether a nearness of at most `high` from a way up to the last one may raise a horizon."""
    per_way = np.float32(1.0) / way
    per_last = np.float32(1.0) / last
    may = False
    for i in range(LANES):
        base = w[BASE + i]
        rise = high - base + LEEWAY * (abs(high) + abs(base))
        slope = rise * per_way
        late = rise * per_last
        may |= (slope if slope > late else late) > w[RAISED + i]
    return may
