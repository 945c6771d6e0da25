"""The directions by which horizons rise, weighted by the distance at which they are first hit.

An interval of directions begins where the horizon was and ends where it came to. Its weight is
Simpson's mean of the weights at both ends and in the middle, times the closed integral over the
slice. Where that is too coarse (`tolerance`) the receiver's samples are gone through one by one,
and each rise is a piece of the view ray half way between two samples.
"""

import math

import numpy as np

from adret._kernels.angles import atan_slope
from adret._kernels.jit import greater, inline, kernel
from adret._kernels.screen.falloffs import QUADRATIC, TABLE, TIMONEN, weight
from adret._kernels.screen.slices import (
    BASE,
    CLOSED,
    CLOSED_U,
    CLOSED_V,
    COSINE,
    COSINE_NEW,
    HALF,
    HARD,
    LANES,
    NORMAL_U,
    NORMAL_V,
    ONE,
    RAISED,
    SIDE_FAR,
    SIDE_SHORT,
    SINE,
    SINE_NEW,
    SLOPE,
    WEIGHT_MIDDLE,
    WEIGHT_NEAR,
    WEIGHT_NEW,
    WEIGHT_OLD,
    ZERO,
    A,
    B,
)

PI = np.float32(math.pi)
FOUR = np.float32(4.0)
SIXTH = np.float32(1.0 / 6.0)
THIRD = np.float32(1.0 / 3.0)
# Gauss-Legendre on [-1, 1] with five points, with two and with one, one after the other.
NODES = (
    0.0,
    -0.5384693101056831,
    0.5384693101056831,
    -0.906179845938664,
    0.906179845938664,
    -0.5773502691896258,
    0.5773502691896258,
    0.0,
)
SHARES = (
    0.5688888888888889,
    0.47862867049936647,
    0.47862867049936647,
    0.23692688505618908,
    0.23692688505618908,
    1.0,
    1.0,
    2.0,
)
# Largest tangents of a quarter of an interval that one and two points are enough for.
ONE_POINT = 0.01
TWO_POINTS = 0.06


@inline
def slope_of(a, b, p, q, lone, second, base, v):
    """Slope of a sample between two pixels; beside NaN that of the nearer pixel, if `lone`."""
    t = a * p + b * q - base * v
    nearer = (b if second else a) * lone - base * v
    return nearer if t != t else t


@kernel
def square_distances(w, old, new):
    """Squared distances where an interval begins, `old` pixels away, in its middle and at its end.

    The end is `new` pixels away, or as little as `old`. Also the new angles.
    """
    middle = HALF * (old + new)
    for i in range(LANES):
        b = w[B + i]
        side = w[SIDE_FAR + i]
        short = w[SIDE_SHORT + i]
        x0, y0 = w[COSINE + i], w[SINE + i]
        c = w[A + i] * w[RAISED + i] + b
        y1 = ONE / np.sqrt(ONE + c * c)
        x1 = c * y1
        x = x0 + x1
        y = y0 + y1
        d0 = old * side / (y0 + (x0 - b * y0) * (old * short))
        slant = (x1 - b * y1) * short
        d1 = new * side / (y1 + slant * new)
        d2 = old * side / (y1 + slant * old)
        d = middle * side / (y + (x - b * y) * (middle * short))
        w[WEIGHT_OLD + i] = d0 * d0
        w[WEIGHT_MIDDLE + i] = d * d * (x * x + y * y)
        w[WEIGHT_NEW + i] = d1 * d1
        w[WEIGHT_NEAR + i] = d2 * d2
        w[COSINE_NEW + i] = x1
        w[SINE_NEW + i] = y1


@kernel
def weigh(d2, code, radius, scale, table):
    """Turn squared distances into weights."""
    r2 = np.float32(radius) * np.float32(radius)
    if code == QUADRATIC:
        per = ONE / r2
        for i in range(len(d2)):
            q = ONE - d2[i] * per
            d2[i] = q if q > ZERO else ZERO
    elif code == TIMONEN:
        s = np.float32(scale)
        for i in range(len(d2)):
            q = s / (s + d2[i])
            d2[i] = q if d2[i] < r2 else ZERO
    elif code == TABLE:
        for i in range(len(d2)):
            d = math.sqrt(d2[i])
            d2[i] = weight(code, radius, scale, table, d) if d == d else 0.0
    else:
        for i in range(len(d2)):
            d2[i] = ONE if d2[i] < r2 else ZERO


@kernel
def add_intervals(w, cosine, uniform, tolerance):
    """Add the intervals by which the horizon rose; mark those that need more care."""
    hard_ones = False
    for i in range(LANES):
        x0, y0 = w[COSINE + i], w[SINE + i]
        x1, y1 = w[COSINE_NEW + i], w[SINE_NEW + i]
        w0, wm, w1 = w[WEIGHT_OLD + i], w[WEIGHT_MIDDLE + i], w[WEIGHT_NEW + i]
        nu, nv = w[NORMAL_U + i], w[NORMAL_V + i]
        rose = w[RAISED + i] > w[SLOPE + i]
        turn = x1 * y0 - x0 * y1
        along = x1 * x0 + y1 * y0
        angle = atan_slope(turn / along)
        angle = angle + PI if along < ZERO else angle
        bend = greater(abs(w0 - wm - wm + w1), HALF * (w[WEIGHT_NEAR + i] - w1))
        hard = rose and bend * greater(turn, -along) > tolerance
        mean = SIXTH * (w0 + FOUR * wm + w1) if rose and not hard else ZERO
        sines = y0 * y0 - y1 * y1
        squares = angle + x1 * y1 - x0 * y0
        w[CLOSED + i] += mean * (cosine * HALF * (nv * sines + nu * squares) + uniform * (x1 - x0))
        cubes_y = THIRD * (y0 * y0 * y0 - y1 * y1 * y1)
        cubes_x = THIRD * (x1 * x1 * x1 - x0 * x0 * x0)
        w[CLOSED_U + i] += mean * (
            cosine * (nv * cubes_y + nu * (x1 - x0 - cubes_x)) + uniform * HALF * squares
        )
        w[CLOSED_V + i] += mean * (cosine * (nv * cubes_x + nu * cubes_y) + uniform * HALF * sines)
        w[HARD + i] = ONE if hard else ZERO
        hard_ones |= hard
    return hard_ones


@kernel
def reached(rho, ku, kw, low, high, radius):
    """The part of directions c from `low` to `high` that meet a line within the radius.

    The line lies at rho/(ku sin + kw cos), the radius where (rho/R)² (1 + c²) = (ku + kw c)².
    """
    if radius == np.inf or not rho > 0.0:
        return low, high
    g = (rho / radius) ** 2
    inside = ku * ku + kw * kw - g
    if not inside > 0.0:
        return low, low
    a = g - kw * kw
    root = math.sqrt(g * inside)
    if a > 0.0:
        return max(low, (ku * kw - root) / a), min(high, (ku * kw + root) / a)
    if a < 0.0 and kw > 0.0:
        return max(low, (ku * kw - root) / a), high
    if a < 0.0:
        return low, min(high, (ku * kw + root) / a)
    return low, high


@inline
def view_ray(w, i, s):
    """The view ray `s` pixels away from receiver i as a line for `add_line`."""
    short = w[SIDE_SHORT + i]
    return s * w[SIDE_FAR + i], 1.0 - w[B + i] * s * short, s * short


@kernel
def segment(w, i, s0, c0, s1, c1):
    """The line through two points of a slice, given by way in the image and direction.

    For `add_line`; where c0 is NaN that is the view ray at s1.
    """
    if c0 != c0:
        return view_ray(w, i, s1)
    b, side, short = w[B + i], w[SIDE_FAR + i], w[SIDE_SHORT + i]
    u0 = s0 * side / (1.0 + (c0 - b) * s0 * short)
    u1 = s1 * side / (1.0 + (c1 - b) * s1 * short)
    return u0 * u1 * (c1 - c0), c1 * u1 - c0 * u0, u0 - u1


@kernel
def add_line(w, i, rho, ku, kw, low, high, cosine, uniform, code, radius, scale, table):
    """Add directions c from `low` to `high` of receiver i that first hit a line."""
    nu, nv = np.float64(w[NORMAL_U + i]), np.float64(w[NORMAL_V + i])
    low, high = reached(rho, ku, kw, low, high, radius)
    if not high > low:
        return
    # Angles are half-angle tangents from the interval's middle: no trigonometry.
    y0 = 1.0 / math.sqrt(1.0 + low * low)
    x0 = low * y0
    y1 = 1.0 / math.sqrt(1.0 + high * high)
    x1 = high * y1
    xm, ym = x0 + x1, y0 + y1
    length = 1.0 / math.sqrt(xm * xm + ym * ym)
    xm *= length
    ym *= length
    half = (x1 * ym - xm * y1) / (1.0 + x1 * xm + y1 * ym)
    closed = 0.0
    closed_u = 0.0
    closed_v = 0.0
    first = 7 if half < ONE_POINT else 5 if half < TWO_POINTS else 0
    last = 8 if half < ONE_POINT else 7 if half < TWO_POINTS else 5
    for k in range(first, last):
        t = half * NODES[k]
        per = 1.0 / (1.0 + t * t)
        turn_x = (1.0 - t * t) * per
        turn_y = 2.0 * t * per
        x = xm * turn_x + ym * turn_y
        y = ym * turn_x - xm * turn_y
        d = rho / (ku * y + kw * x) if rho > 0.0 else 0.0
        f = SHARES[k] * half * 2.0 * per * y * (cosine * (nv * x + nu * y) + uniform)
        f *= weight(code, radius, scale, table, d)
        closed += f
        closed_u += f * y
        closed_v += f * x
    w[CLOSED + i] += closed
    w[CLOSED_U + i] += closed_u
    w[CLOSED_V + i] += closed_v


@inline
def lanes(shape, row, first, n, o, j):
    """First and last + 1 receiver of a block for which sample j lies in the padded image."""
    low = max(0, -first - min(o[j, 2], o[j, 5]))
    high = min(n, shape[2] - first - max(o[j, 2], o[j, 5]))
    if min(row + o[j, 1], row + o[j, 4]) < 0 or max(row + o[j, 1], row + o[j, 4]) >= shape[0]:
        high = low
    return low, high


@kernel
def walk(
    near, shape, w, x, row, first, at, o, p, q, lone, v, s, start, stop, before, cosine, uniform,
    code, radius, scale, table,
):  # fmt: skip
    """Add the intervals of receiver x sample by sample."""
    m = w[SLOPE + x]
    a, b = np.float64(w[A + x]), np.float64(w[B + x])
    old = m  # the first sample is the pixel itself
    if s[start] > ZERO:
        one, two = near[at + o[start - 1, 0] + x], near[at + o[start - 1, 3] + x]
        j = start - 1
        old = slope_of(one, two, p[j], q[j], lone[j], q[j] > p[j], w[BASE + x], v[j])
    for j in range(start, stop):
        low, high = lanes(shape, row, first + x, 1, o, j)
        if high <= low:
            break
        one, two = near[at + o[j, 0] + x], near[at + o[j, 3] + x]
        t = slope_of(one, two, p[j], q[j], lone[j], q[j] > p[j], w[BASE + x], v[j])
        if t > m:
            c = a * t + b
            rho, ku, kw = segment(w, x, np.float64(before), a * old + b, np.float64(s[j]), c)
            add_line(
                w, x, rho, ku, kw, a * m + b, c, cosine, uniform, code, radius, scale, table
            )  # fmt: skip
            m = t
        if s[j] > ZERO:
            old = t
        before = s[j]


@kernel
def close(w, before, now, cosine, uniform, tolerance, code, radius, scale, table):
    """Add what was raised between two ways in the image; tell whether any needs more care."""
    square_distances(w, before, now)
    weigh(w[WEIGHT_OLD : WEIGHT_OLD + 4 * LANES], code, radius, scale, table)
    return add_intervals(w, cosine, uniform, tolerance)


@kernel
def advance(w):
    """Let the horizon begin anew where it has risen to."""
    for x in range(LANES):
        w[SLOPE + x] = w[RAISED + x]
        w[COSINE + x] = w[COSINE_NEW + x]
        w[SINE + x] = w[SINE_NEW + x]


@kernel
def settle(
    near, shape, w, row, first, at, o, p, q, lone, v, s, start, stop, before, cosine, uniform,
    tolerance, code, radius, scale, table,
):  # fmt: skip
    """Add what samples start to stop - 1 raised the horizon by."""
    now = s[stop - 1]
    if close(w, before, now, cosine, uniform, tolerance, code, radius, scale, table):
        for x in range(LANES):
            if w[HARD + x] > ZERO:
                walk(
                    near, shape, w, x, row, first, at, o, p, q, lone, v, s, start, stop, before,
                    cosine, uniform, code, radius, scale, table,
                )  # fmt: skip
    advance(w)


@kernel
def any_rose(w):
    """Whether the horizon rose for any receiver of a block."""
    rose = False
    for i in range(LANES):
        rose |= w[RAISED + i] > w[SLOPE + i]
    return rose
