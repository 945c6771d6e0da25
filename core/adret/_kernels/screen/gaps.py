"""The directions that a receiver's shells hide in a slice: a horizon, and intervals above gaps.

`gaps[x]` are receiver x's intervals above its horizon: their number, then their ends, ascending.
"""

import numpy as np

from adret._kernels.jit import kernel
from adret._kernels.screen.intervals import add_line, view_ray
from adret._kernels.screen.slices import COSINE, ONE, RAISED, SINE, SLOPE, A, B

NARROW = 0.1  # square of the tangent of an interval that may be counted later


@kernel
def count(w, x, low, high, s, cosine, uniform, code, radius, scale, table):
    """Add directions of receiver x between two slopes, first hit `s` pixels away."""
    a, b = np.float64(w[A + x]), np.float64(w[B + x])
    rho, ku, kw = view_ray(w, x, s)
    add_line(
        w, x, rho, ku, kw, a * low + b, a * high + b, cosine, uniform, code, radius, scale, table
    )


@kernel
def narrow(w, x, low, high):
    """Whether the angle between two slopes is small."""
    a, b = w[A + x], w[B + x]
    c0 = a * low + b
    c1 = a * high + b
    return (c1 - c0) * (c1 - c0) < NARROW * (1.0 + c0 * c0) * (1.0 + c1 * c1)


@kernel
def begin_anew(w, x, m):
    """Let the horizon of receiver x go on from slope m, all below being counted."""
    c = w[A + x] * m + w[B + x]
    sine = ONE / np.sqrt(ONE + c * c)
    w[RAISED + x] = m
    w[SLOPE + x] = m
    w[SINE + x] = sine
    w[COSINE + x] = c * sine


@kernel
def hide(w, x, gaps, low, high, s, cosine, uniform, code, radius, scale, table):
    """Hide the directions between two slopes of receiver x by what is `s` pixels away.

    What is wide or lies above a gap is counted at once, the rest by `intervals.close`.
    """
    top = w[RAISED + x]
    if not high > top:
        return
    low = max(low, top)
    number = int(gaps[x, 0])
    # Intervals first to after - 1 touch the new one.
    first = 0
    while first < number and gaps[x, 2 + 2 * first] < low:
        first += 1
    after = first
    while after < number and gaps[x, 1 + 2 * after] <= high:
        after += 1
    if low == top and after == 0 and narrow(w, x, top, high):
        w[RAISED + x] = high
        return
    done = low
    for k in range(first, after):
        if gaps[x, 1 + 2 * k] > done:
            count(w, x, done, gaps[x, 1 + 2 * k], s, cosine, uniform, code, radius, scale, table)
        done = max(done, gaps[x, 2 + 2 * k])
    if done < high:
        count(w, x, done, high, s, cosine, uniform, code, radius, scale, table)
    if after > first:
        low = min(low, gaps[x, 1 + 2 * first])
        high = max(high, gaps[x, 2 * after])
    if low == top:
        if top > w[SLOPE + x]:
            count(w, x, w[SLOPE + x], top, s, cosine, uniform, code, radius, scale, table)
        begin_anew(w, x, high)
        shift = after
    else:
        shift = after - first - 1
    if shift < 0:
        for k in range(2 * number, 2 * first, -1):
            gaps[x, k + 2] = gaps[x, k]
    else:
        for k in range(2 * after + 1, 2 * number + 1):
            gaps[x, k - 2 * shift] = gaps[x, k]
    if low > top:
        gaps[x, 1 + 2 * first] = low
        gaps[x, 2 + 2 * first] = high
    gaps[x, 0] = number - shift
