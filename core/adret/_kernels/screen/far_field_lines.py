"""Lines across a depth image: peaks of intervals, their pyramid and prefix sums (P4).

The image is in the frame of a direction: lines run down the rows and cross `slope` columns a row.
Line l passes column ``l + first`` at row 0. An interval is `size` rows of a line; interval n of
level v spans ``size 2^v`` rows from row ``n size 2^v`` on. Nearness (1/z or -z) is linear over the
image of a plane, so the mean of points of a plane lies in the plane.
"""

from typing import Any, NamedTuple

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
    heights : ndarray, (intervals, phases, n), float64
        Prefix sums of heights: the sum over lines below l is at ``[l % phases, l // phases]``, so
        that receivers `phases` columns apart read what lies side by side.
    places : the same, int32
        Prefix sums of rows from the interval's first row on, in parts of a row. They may wrap round
        at 2^32: differences are right all the same.
    counts : the same, int32
        Prefix sums of the number of lines that show a surface.
    tops : the same, float32
        Heights, 0 where there is no surface.
    spans : ndarray, (intervals, 3), int64
        First and last line + 1 that show a surface, and whether all between them do.
    per_row : int
        Parts of a row in `places`.
    """

    slope: float
    first: int
    size: int
    rows: int
    starts: NDArray[np.int64]
    height: NDArray[np.float32]
    place: NDArray[np.float32]
    heights: NDArray[np.float64]
    places: NDArray[np.int32]
    counts: NDArray[np.int32]
    tops: NDArray[np.float32]
    spans: NDArray[np.int64]
    per_row: int


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
def sum_lines(height, place, first_rows, per_row, heights, places, counts, tops, spans):
    """Prefix sums over the lines of each interval, of those that show a surface.

    Parameters
    ----------
    height, place : (intervals, lines) float32
    first_rows : (intervals,) int64
        First row of each interval.
    per_row : int
        Parts of a row in `places`.
    heights, places, counts, tops, spans
        Outputs, see `Lines`.
    """
    phases = heights.shape[1]
    lines = height.shape[1]
    for n in prange(height.shape[0]):
        a = 0.0
        b = 0
        c = 0
        begin = lines
        end = 0
        for x in range(lines + 1):
            phase, at = x % phases, x // phases
            heights[n, phase, at] = a
            places[n, phase, at] = b
            counts[n, phase, at] = c
            if x < lines and height[n, x] > -np.inf:
                tops[n, phase, at] = height[n, x]
                a += height[n, x]
                away = place[n, x] - np.float32(first_rows[n])
                b += np.int64(np.float32(per_row) * away + HALF)
                c += 1
                begin = min(begin, x)
                end = x + 1
            else:
                tops[n, phase, at] = ZERO
        spans[n, 0] = begin
        spans[n, 1] = end
        spans[n, 2] = 1 if c == end - begin else 0


def empty_sums(intervals: int, phases: int, lines: int) -> tuple[Any, Any, Any, Any, Any]:
    """Room for the outputs of `sum_lines`."""
    shape = (intervals, phases, lines // phases + 1)
    return (
        np.zeros(shape),
        np.zeros(shape, dtype=np.int32),
        np.zeros(shape, dtype=np.int32),
        np.zeros(shape, dtype=np.float32),
        np.empty((intervals, 3), dtype=np.int64),
    )
