"""A slice through the view ray of a receiver, for a block of receivers side by side.

All receivers of a block look along the same direction of the image, so a sample is a constant
shift and every loop over the block vectorises. The numbers of a block stand in one flat array
`w`, quantity after quantity, `LANES` apart: with constant distances nothing can alias. All of them
are always computed, those without a receiver as NaN: results do not depend on a receiver's place
in its block, as they would where vectors and the rest of a row divide differently.

In the slice a direction is known by the cotangent c of its angle from the view ray: +inf towards
the eye, -inf away from it. Where the image of a ray rises by m in nearness a pixel, c = A m + B:
1/z (or -z) of what is straight is linear in the image. Derivation:
docs/explanation/screen-space-exact.md.
"""

import math

import numpy as np

from adret._kernels.angles import HALF_PI, atan_slope
from adret._kernels.jit import greater, inline, kernel

LANES = 128
# Quantities of a block: of the receiver ...
BASE = 0 * LANES  # nearness, raised by the rounding of float32 depths
X = 1 * LANES  # of the view ray (x, y, -1), 0 in orthographic projection
SHORT = 2 * LANES  # 1 over its length
SPREAD = 3 * LANES  # depth (perspective) or 1
FAR = 4 * LANES  # distance from the eye (perspective) or 1
NORMAL_X = 5 * LANES
NORMAL_Y = 6 * LANES
NORMAL_V = 7 * LANES  # cosine of normal and direction to the eye
RISE_COLUMN = 8 * LANES  # nearness that the tangent plane gains a column and a row
RISE_ROW = 9 * LANES
TAU = 10 * LANES  # tangent of the eye's angle from the receiver to what the radius reaches
# ... of the direction ...
A = 11 * LANES
B = 12 * LANES
PER_SIDE = 13 * LANES  # 1 over what a pixel is across the view ray, at depth 1
SIDE_FAR = 14 * LANES  # at the receiver's depth
SIDE_SHORT = 15 * LANES  # over the view ray's length
NORMAL_U = 16 * LANES  # normal's component across the view ray
TURN = 17 * LANES  # angle round the view ray a radian of image direction, times a constant
# ... of the horizon as far as it is known ...
SLOPE = 18 * LANES  # m
RAISED = 19 * LANES  # m after the samples at hand
COSINE = 20 * LANES  # of its angle from the view ray
SINE = 21 * LANES
# ... and sums: of the direction ...
CLOSED = 22 * LANES
CLOSED_U = 23 * LANES
CLOSED_V = 24 * LANES
UNKNOWN = 25 * LANES
WHOLE = 26 * LANES
# ... and of all directions.
TOTAL_CLOSED = 27 * LANES
TOTAL_UNKNOWN = 28 * LANES
TOTAL_WHOLE = 29 * LANES
CLOSED_X = 30 * LANES
CLOSED_Y = 31 * LANES
CLOSED_Z = 32 * LANES
WEIGHT_OLD = 33 * LANES
WEIGHT_MIDDLE = 34 * LANES
WEIGHT_NEW = 35 * LANES
WEIGHT_NEAR = 36 * LANES
HARD = 37 * LANES
NORMAL_Z = 38 * LANES
COSINE_NEW = 39 * LANES
SINE_NEW = 40 * LANES
LOW = 41 * LANES  # cotangents between which an open ray leaves the image before the radius
HIGH = 42 * LANES
SIZE = 43 * LANES

ZERO = np.float32(0.0)
HALF = np.float32(0.5)
ONE = np.float32(1.0)
TWO_THIRDS = np.float32(2.0 / 3.0)
TINY = np.float32(1e-20)
HUGE = np.float32(1e18)
ROUNDING = np.float32(2.0**-21)
LEVEL = np.float32(2.0**-22)
"""Angle above the tangent plane [radians] below which nothing counts: normals are float32."""


@kernel
def place(near, at, normal, row, first, step, count, rays, perspective, radius, w):
    """Set a block's receivers: columns first, first + step, ... of a row, nearness from `at` on.

    Clears the sums, and returns y of the view rays (x, y, -1).
    """
    ax, bx, ay, by = rays
    y = ay * row + by if perspective else 0.0
    for i in range(LANES):
        column = first + step * min(i, count - 1)
        h = np.float64(near[at + i]) if i < count else np.nan
        n0 = np.float64(normal[0, row, column])
        n1 = np.float64(normal[1, row, column])
        n2 = np.float64(normal[2, row, column])
        x = ax * column + bx if perspective else 0.0
        short = 1.0 / math.sqrt(x * x + y * y + 1.0)
        h1 = h if perspective else 1.0
        facing = (n2 - n0 * x - n1 * y) * short
        away = -h1 * short / facing
        far = 1.0 / (h1 * short)
        tau = radius
        if perspective:
            share = radius / far
            tau = share / math.sqrt(1.0 - share * share) if share < 1.0 else np.inf
        w[BASE + i] = h + abs(h) * ROUNDING
        w[X + i] = x
        w[SHORT + i] = short
        w[SPREAD + i] = 1.0 / h1
        w[FAR + i] = far
        w[NORMAL_X + i] = n0
        w[NORMAL_Y + i] = n1
        w[NORMAL_Z + i] = n2
        w[NORMAL_V + i] = facing
        w[RISE_COLUMN + i] = away * ax * n0
        w[RISE_ROW + i] = away * ay * n1
        w[TAU + i] = tau
    for i in range(TOTAL_CLOSED, WEIGHT_OLD):
        w[i] = ZERO
    return np.float32(y)


@kernel
def aim(w, y, ex, ey, along_column, along_row, perspective, cosine, uniform):
    """Turn a block to a direction of the image; start the horizon just above the tangent plane.

    `ex`, `ey` is what a pixel of way adds to the view rays' x and y.
    """
    flat = ONE if perspective else ZERO
    e2 = ex * ex + ey * ey
    for i in range(LANES):
        x = w[X + i]
        short = w[SHORT + i]
        lean = (ex * x + ey * y) * short
        side2 = e2 - lean * lean
        per_side = ONE / np.sqrt(side2)
        side = side2 * per_side
        facing = w[NORMAL_V + i]
        a = w[FAR + i] * per_side
        b = -lean * per_side
        nu = (w[NORMAL_X + i] * ex + w[NORMAL_Y + i] * ey + lean * facing) * per_side
        m = w[RISE_COLUMN + i] * along_column + w[RISE_ROW + i] * along_row
        c = a * m + b
        m += LEVEL * (ONE + c * c) / a
        c = a * m + b
        sine = ONE / np.sqrt(ONE + c * c)
        w[A + i] = a
        w[B + i] = b
        w[PER_SIDE + i] = per_side
        w[SIDE_FAR + i] = side * w[SPREAD + i]
        w[SIDE_SHORT + i] = side * short * flat
        w[NORMAL_U + i] = nu
        w[TURN + i] = short * per_side * per_side
        w[SLOPE + i] = m
        w[RAISED + i] = m
        w[SINE + i] = sine
        w[COSINE + i] = c * sine
        w[CLOSED + i] = ZERO
        w[CLOSED_U + i] = ZERO
        w[CLOSED_V + i] = ZERO
        w[UNKNOWN + i] = ZERO
        # The part of the slice above the tangent plane, whose cotangent is -nu / facing.
        upper = HALF * (nu * (HALF_PI + atan_slope(nu / facing)) + facing)
        w[WHOLE + i] = cosine * upper + uniform * (ONE + nu / np.sqrt(nu * nu + facing * facing))


@kernel
def farthest(w, perspective):
    """Way in the image [pixels] beyond which no point of a slice is within the radius.

    The largest of the block.
    """
    endless = np.float32(np.inf)
    top = ZERO
    for i in range(LANES):
        tau = w[TAU + i]
        if perspective:
            over = ONE + w[B + i] * tau
            way = tau / (over * w[SIDE_SHORT + i]) if over > ZERO else endless
            way = endless if tau == endless else way
        else:
            way = tau * w[PER_SIDE + i]
        top = greater(way, top)
    return top


@inline
def cosine_share(c, nu, nv):
    """Integral of the cosine-weighted slice from c = 0 to c."""
    s = ONE / (ONE + c * c)
    return HALF * (nv * (ONE - s) + nu * (c * s + atan_slope(c)))


@inline
def open_share(low, high, nu, nv, cosine, uniform):
    """Integral of the weighted slice between two cotangents."""
    share = cosine * (cosine_share(high, nu, nv) - cosine_share(low, nu, nv))
    return share + uniform * (high / np.sqrt(ONE + high * high) - low / np.sqrt(ONE + low * low))


@kernel
def leave(w, first, step, row, shape, along_column, along_row, radius, cosine, uniform):
    """Add to `UNKNOWN` the open directions that leave the image before the radius.

    Of a ray's crossing with the view ray at the border, s pixels away: its distance is below the
    radius between two cotangents, the roots of a quadratic.
    """
    rows, columns = shape
    per_radius = ONE / np.float32(radius)
    edge_row = np.float32(np.inf)
    if along_row > ZERO:
        edge_row = np.float32(rows - 1 - row) / along_row
    elif along_row < ZERO:
        edge_row = np.float32(row) / -along_row
    for i in range(LANES):
        column = first + step * i
        ahead = np.float32(columns - 1 - column) if along_column > ZERO else np.float32(column)
        speed = abs(along_column)
        s = ahead / speed if speed > ZERO else np.float32(np.inf)
        s = edge_row if edge_row < s else s
        p = s * w[SIDE_SHORT + i]
        k = ONE - w[B + i] * p
        g = s * w[SIDE_FAR + i] * per_radius
        g = g * g
        g = TINY if g < TINY else g
        inside = k * k + p * p - g
        root = np.sqrt(g * (inside if inside > ZERO else ZERO))
        a = g - p * p
        low = (p * k - root) / a
        high = (p * k + root) / a
        low = high if a < ZERO and high > low else low
        high = HUGE if a <= ZERO or high > HUGE else high
        c = w[COSINE + i] / w[SINE + i]
        low = c if low < c else low
        nu, nv = w[NORMAL_U + i], w[NORMAL_V + i]
        lost = open_share(low, high, nu, nv, cosine, uniform)
        some = inside > ZERO and high > low
        w[UNKNOWN + i] += lost if some else ZERO
        w[LOW + i] = low if some else ZERO
        w[HIGH + i] = high if some else ZERO


@kernel
def add_direction(w, y, ex, ey):
    """Add the sums of a direction to those of the receivers."""
    for i in range(LANES):
        turn = w[TURN + i]
        w[TOTAL_CLOSED + i] += turn * w[CLOSED + i]
        w[TOTAL_UNKNOWN + i] += turn * w[UNKNOWN + i]
        w[TOTAL_WHOLE + i] += turn * w[WHOLE + i]
        # Across the view ray and along it, in view space.
        x = w[X + i]
        short = w[SHORT + i]
        b = w[B + i]
        per_side = w[PER_SIDE + i]
        u = turn * w[CLOSED_U + i]
        v = turn * w[CLOSED_V + i]
        w[CLOSED_X + i] += u * (ex * per_side + b * x * short) - v * x * short
        w[CLOSED_Y + i] += u * (ey * per_side + b * y * short) - v * y * short
        w[CLOSED_Z + i] += (v - u * b) * short


@kernel
def finish(w, cosine, uniform):
    """Turn the sums into occlusion, confidence and bent normal, in their places."""
    for i in range(LANES):
        per_whole = ONE / w[TOTAL_WHOLE + i]
        closed = w[TOTAL_CLOSED + i] * per_whole
        known = ONE - w[TOTAL_UNKNOWN + i] * per_whole
        # The whole hemisphere's mean direction is 2/3 n or n/2.
        share = (TWO_THIRDS * cosine + HALF * uniform) * w[TOTAL_WHOLE + i]
        x = share * w[NORMAL_X + i] - w[CLOSED_X + i]
        y = share * w[NORMAL_Y + i] - w[CLOSED_Y + i]
        z = share * w[NORMAL_Z + i] - w[CLOSED_Z + i]
        per_length = ONE / np.sqrt(x * x + y * y + z * z)
        w[TOTAL_CLOSED + i] = ONE if closed > ONE else closed
        w[TOTAL_UNKNOWN + i] = ZERO if known < ZERO else known
        w[CLOSED_X + i] = x * per_length
        w[CLOSED_Y + i] = y * per_length
        w[CLOSED_Z + i] = z * per_length


@kernel
def write(w, n, occlusion, confidence, bent):
    """Write what `finish` left of a block."""
    for i in range(n):
        occlusion[i] = w[TOTAL_CLOSED + i]
        confidence[i] = w[TOTAL_UNKNOWN + i]
        bent[0, i] = w[CLOSED_X + i]
        bent[1, i] = w[CLOSED_Y + i]
        bent[2, i] = w[CLOSED_Z + i]
