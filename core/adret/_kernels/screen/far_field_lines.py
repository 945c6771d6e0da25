"""Lines across a depth image: peaks of intervals, their pyramid and prefix sums (P4).

The image is in the frame of a direction: lines run down the rows and cross `slope` columns a row.
Line l passes column ``l + first`` at row 0. An interval is `size` rows of a line; interval n of
level v spans ``size 2^v`` rows from row ``n size 2^v`` on. Nearness (1/z or -z) is linear over the
image of a plane, so the mean of points of a plane lies in the plane.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adret._kernels.jit import inline, parallel_kernel, prange

HALF = np.float32(0.5)
ZERO = np.float32(0.0)


class Lines(NamedTuple):
    """Peaks of all lines of a direction, the levels of the pyramid one after another.

    Attributes
    ----------
    slope : float
    first, size : int
    rows : int
        Of the image.
    starts : ndarray, (levels,), int64
        Row of the arrays at which a level begins.
    height, place : ndarray, (intervals, lines), float32
        Nearness of each interval's peak, and its row; -inf where an interval has no surface.
    heights, places, counts : ndarray, (intervals, lines + 1), float64
        Their prefix sums, and those of the number of intervals that have a surface.
    """

    slope: float
    first: int
    size: int
    rows: int
    starts: NDArray[np.int64]
    height: NDArray[np.float32]
    place: NDArray[np.float32]
    heights: NDArray[np.float64]
    places: NDArray[np.float64]
    counts: NDArray[np.float64]


@inline
def between(a, b, share):
    """Linear from a to b; where one is NaN, the nearer of the two."""
    value = a + share * (b - a)
    if value != value:
        value = b if share > HALF else a
    return value


@inline
def shift_of(way, smooth):
    """Whole columns and the share of the next one; to the nearest column if not `smooth`."""
    if smooth:
        whole = int(np.floor(way))
        return whole, np.float32(way - np.floor(way))
    return int(np.floor(way + 0.5)), ZERO


@parallel_kernel
def scan(near, slope, first, size, fall, bias, smooth, height, place):
    """Fill the base level: the highest nearness of each interval, and a place.

    Parameters
    ----------
    near : (rows, columns) float32
        Nearness, NaN where there is no surface.
    slope : float
    first : int
    size : int
        Rows of an interval.
    fall : float
        0: `place` is the row of the highest point. Else it is the highest ``nearness + fall row``:
        the interval as seen along a line that loses `fall` a row.
    bias : float
        Nearness a row that a point may be lower by, to count as higher when it is on a lower row:
        of a flat top the receiver sees the near edge.
    smooth : bool
        Between two columns: linear, or the nearer one.
    height, place : (intervals, lines) float32
        Outputs; -inf where an interval has no surface.
    """
    rows, columns = near.shape
    lines = height.shape[1]
    tilt = np.float32(fall)
    for n in prange(height.shape[0]):
        height[n] = -np.inf
        place[n] = -np.inf
        for row in range(n * size, min(rows, (n + 1) * size)):
            shift, share = shift_of(row * slope, smooth)
            shift += first
            start = max(0, -shift)
            stop = min(lines, columns - shift - (1 if share > ZERO else 0))
            if not stop > start:
                continue
            left = near[row, start + shift : stop + shift]
            right = left if share == ZERO else near[row, start + shift + 1 : stop + shift + 1]
            top = height[n, start:stop]
            seen = place[n, start:stop]
            here = np.float32(row)
            if tilt == ZERO:
                lowered = np.float32(bias * row)
                for x in range(stop - start):
                    value = between(left[x], right[x], share) - lowered
                    taken = value > top[x]
                    top[x] = value if taken else top[x]
                    seen[x] = here if taken else seen[x]
            else:
                for x in range(stop - start):
                    value = between(left[x], right[x], share)
                    tilted = value + tilt * here
                    top[x] = value if value > top[x] else top[x]
                    seen[x] = tilted if tilted > seen[x] else seen[x]
        if tilt == ZERO:
            for x in range(lines):
                if height[n, x] > -np.inf:
                    height[n, x] += np.float32(bias * place[n, x])


@parallel_kernel
def merge(height, place, start, stop, base, bias, both):
    """Fill a level of the pyramid, rows from `base` on, from level `start` to `stop`.

    `both`: `place` is a maximum of its own; else it goes with `height`.
    """
    count = (stop - start + 1) // 2
    slant = np.float32(bias)
    for n in prange(count):
        a = start + 2 * n
        b = a + 1 if a + 1 < stop else a
        for x in range(height.shape[1]):
            taken = height[b, x] - slant * place[b, x] > height[a, x] - slant * place[a, x]
            if place[a, x] == -np.inf or place[b, x] == -np.inf:
                taken = height[b, x] > height[a, x]
            height[base + n, x] = height[b, x] if taken else height[a, x]
            if both:
                taken = place[b, x] > place[a, x]
            place[base + n, x] = place[b, x] if taken else place[a, x]


@parallel_kernel
def to_rows(height, place, fall):
    """Turn the second maximum into the row where both receiver angles meet, in place."""
    for n in prange(height.shape[0]):
        for x in range(height.shape[1]):
            place[n, x] = (place[n, x] - height[n, x]) / np.float32(fall)


@parallel_kernel
def sum_lines(height, place, heights, places, counts):
    """Prefix sums over the lines of each interval, of those that show a surface.

    Outputs are float64 of one line more: entry l is the sum over lines below l.
    """
    for n in prange(height.shape[0]):
        a = 0.0
        b = 0.0
        c = 0.0
        heights[n, 0] = a
        places[n, 0] = b
        counts[n, 0] = c
        for x in range(height.shape[1]):
            if height[n, x] > -np.inf:
                a += height[n, x]
                b += place[n, x]
                c += 1.0
            heights[n, x + 1] = a
            places[n, x + 1] = b
            counts[n, x + 1] = c
