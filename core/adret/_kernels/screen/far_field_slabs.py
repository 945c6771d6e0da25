"""The obscurance estimator (P4, equation 3): slabs of a horizon, for any falloff.

A slab is a straight line of the slice, between the horizon so far (cotangent c0) and a point that
raises it (c1 > c0). The obscurance that it adds is the integral over the angle θ from the view ray
of W(d) (n·ω) sin θ, d being the way to the line. Without W it has a closed form, `below`. One over
the line's distance from the view ray is e = α + β c, so d² is (1 + c²) / e². The closed form
is multiplied by the mean of W over the part nearer than the radius, of three nodes weighted by
their cosine: no table of integrals, exact where W is 1.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adret._kernels.jit import greater, inline, kernel
from adret._kernels.screen.far_field_block import (
    CLOSED,
    FROM,
    HEIGHT,
    LANES,
    LIST,
    NEAR,
    NORMAL_U,
    NORMAL_V,
    ONE,
    PLACE,
    SCRATCH,
    SEEN,
    SHARE,
    SIDE,
    TOP,
    ZERO,
    A,
    B,
    below,
)

WHOLE_SHARE = np.float32(1.0 - 1e-5)
HUGE = np.float32(1e18)
# Of the points that raise the horizon, side by side:
C0 = SCRATCH + 0 * LANES  # where the slab begins, then where its part within the radius does
C1 = SCRATCH + 1 * LANES  # where it ends
END = SCRATCH + 2 * LANES  # where its part within the radius does
AWAY = SCRATCH + 3 * LANES
HIGH = SCRATCH + 4 * LANES  # nearness of the point
PART = SCRATCH + 5 * LANES  # share of the sector
PER_A = SCRATCH + 6 * LANES  # A, then α
OFFSET = SCRATCH + 7 * LANES  # B, then β
OWN = SCRATCH + 8 * LANES  # nearness of the receiver
WIDE = SCRATCH + 9 * LANES  # SIDE
NU = SCRATCH + 10 * LANES
NV = SCRATCH + 11 * LANES
OLD = SCRATCH + 12 * LANES  # the horizon so far
# Its nodes:
X_FIRST = SCRATCH + 3 * LANES  # what AWAY, HIGH and the like held is done with
Y_FIRST = SCRATCH + 4 * LANES
X_MIDDLE = SCRATCH + 8 * LANES
Y_MIDDLE = SCRATCH + 9 * LANES
X_LAST = SCRATCH + 13 * LANES
Y_LAST = SCRATCH + 14 * LANES
W_FIRST = SCRATCH + 15 * LANES
W_MIDDLE = SCRATCH + 16 * LANES
W_LAST = SCRATCH + 17 * LANES
NODES = (
    (X_FIRST, Y_FIRST, W_FIRST),
    (X_MIDDLE, Y_MIDDLE, W_MIDDLE),
    (X_LAST, Y_LAST, W_LAST),
)
ASIDE_SHARE = np.float32(0.35)  # of the middle ray in those beside it
OUTER = np.float32(8.0 / 27.0)  # exact for parabolas over nodes at 1/8, 1/2 and 7/8
INNER = np.float32(11.0 / 27.0)


class Weights(NamedTuple):
    """A falloff W(d), 0 from the radius on.

    Attributes
    ----------
    plain : bool
        Whether W is 1 at any distance.
    radius : float32
    formula : ndarray, (4,), float32
        a, b, c, e of W = (a + b d²) / (c + e d²); used where there are no values.
    values : ndarray, float32
        W at the squared distances whose float32's bits are `base` plus multiples of 1/`scale`.
    scale : float32
    base : int32
    """

    plain: bool
    radius: np.float32
    formula: NDArray[np.float32]
    values: NDArray[np.float32]
    scale: np.float32
    base: np.int32


@inline
def bits(x):
    """The bits of a float32: linear in it between powers of 2, so nearly its logarithm."""
    return np.float32(x).view(np.int32)


@inline
def blend(share, c, top):
    """Cotangent of the weighted mean of two directions."""
    p = share / np.sqrt(ONE + c * c)
    q = (ONE - share) / np.sqrt(ONE + top * top)
    return (p * c + q * top) / (p + q)


@inline
def receiver(w, m):
    """The m-th receiver of the list; no index below 0, so nothing wraps round."""
    return np.int64(w[LIST + m]) & 255


@kernel
def pick(w, count, thick):
    """Copy what slabs need of the receivers whose point raises the horizon; returns how many."""
    found = 0
    for i in range(count):
        w[LIST + found] = np.float32(i)
        found += w[SEEN + i] > w[TOP + i]
    source = TOP if thick else FROM
    for m in range(found):
        i = receiver(w, m)
        w[C0 + m] = w[source + i]
        w[C1 + m] = w[SEEN + i]
        w[AWAY + m] = w[PLACE + i]
        w[HIGH + m] = w[HEIGHT + i]
        w[PART + m] = w[SHARE + i]
        w[PER_A + m] = w[A + i]
        w[OFFSET + m] = w[B + i]
        w[OWN + m] = w[NEAR + i]
        w[WIDE + m] = w[SIDE + i]
        w[NU + m] = w[NORMAL_U + i]
        w[NV + m] = w[NORMAL_V + i]
        w[OLD + m] = w[TOP + i]
    return found


@kernel
def set_lines(w, found, start, lean, perspective):
    """α and β of each slab's line.

    The slab meets the horizon's ray at the point's row (`lean` 0: it runs away from the eye) or
    nearer, as far as the row `start` where the point's interval begins (1). Where α + β c is below
    0, the ray and the line part.
    """
    if perspective:
        for m in range(found):
            c0, c1, away = w[C0 + m], w[C1 + m], w[AWAY + m]
            foot = away + lean * (start - away)
            wide, a = w[WIDE + m], w[PER_A + m]
            e1 = w[HIGH + m] / (wide * away)
            e0 = (w[OWN + m] * a + (c0 - w[OFFSET + m]) * foot) / (foot * a * wide)
            beta = (e1 - e0) / (c1 - c0)
            w[OFFSET + m] = beta
            w[PER_A + m] = e1 - beta * c1
    else:
        for m in range(found):
            c0, c1, away = w[C0 + m], w[C1 + m], w[AWAY + m]
            foot = away + lean * (start - away)
            e1 = ONE / (w[WIDE + m] * away)
            e0 = ONE / (w[WIDE + m] * foot)
            beta = (e1 - e0) / (c1 - c0)
            w[OFFSET + m] = beta
            w[PER_A + m] = e1 - beta * c1


@kernel
def cut(w, found, per_radius):
    """Ends of the part of each slab that is nearer than the radius, in C0 and END."""
    for m in range(found):
        alpha, beta = w[PER_A + m], w[OFFSET + m]
        # One over the distance is `size` times the cosine of the angle from the line's normal;
        # sines and cosines below are `size` times what they are.
        square = alpha * alpha + beta * beta - per_radius * per_radius
        sine = np.sqrt(square) if square > ZERO else ZERO
        low_sine = alpha * per_radius + beta * sine
        high_sine = alpha * per_radius - beta * sine
        low = (beta * per_radius - alpha * sine) / low_sine
        high = (beta * per_radius + alpha * sine) / high_sine
        # Where an end is not among the rays of the slice: none of them, or all on that side.
        below_all = -HUGE if beta < ZERO else HUGE
        above_all = HUGE if beta > ZERO else -HUGE
        below_all = -HUGE if alpha > ZERO else below_all
        above_all = HUGE if alpha > ZERO else above_all
        low = low if low_sine > ZERO else below_all
        high = high if high_sine > ZERO else above_all
        c0, c1 = w[C0 + m], w[C1 + m]
        start = low if low > c0 else c0
        end = high if high < c1 else c1
        open_ = square > ZERO and end > start
        w[C0 + m] = start if open_ else c0
        w[END + m] = end if open_ else c0


@kernel
def set_nodes(w, found):
    """Three rays of each slab, as unit vectors (along the view ray, across it).

    At about 1/8, 1/2 and 7/8 of its angle: exact in the middle, to 1/50 beside it.
    """
    for m in range(found):
        c0, c1 = w[C0 + m], w[END + m]
        y0 = ONE / np.sqrt(ONE + c0 * c0)
        y1 = ONE / np.sqrt(ONE + c1 * c1)
        x0 = c0 * y0
        x1 = c1 * y1
        x, y = x0 + x1, y0 + y1
        per = ONE / np.sqrt(x * x + y * y)
        x *= per
        y *= per
        w[X_MIDDLE + m] = x
        w[Y_MIDDLE + m] = y
        w[X_FIRST + m] = x0 + ASIDE_SHARE * x
        w[Y_FIRST + m] = y0 + ASIDE_SHARE * y
        w[X_LAST + m] = x1 + ASIDE_SHARE * x
        w[Y_LAST + m] = y1 + ASIDE_SHARE * y


@kernel
def weigh(w, found, formula):
    """W by its formula at each slab's nodes."""
    a, b, c, e = formula[0], formula[1], formula[2], formula[3]
    for m in range(found):
        for x, y, to in NODES:
            per = w[PER_A + m] * w[y + m] + w[OFFSET + m] * w[x + m]
            square = w[x + m] * w[x + m] + w[y + m] * w[y + m]
            value = (a * (per * per) + b * square) / (c * (per * per) + e * square)
            w[to + m] = value if per > ZERO else ZERO


@kernel
def weigh_by_table(w, found, values, scale, base):
    """W by its table at each slab's nodes."""
    last = np.float32(len(values)) - np.float32(1.01)
    for m in range(found):
        for x, y, to in NODES:
            per = w[PER_A + m] * w[y + m] + w[OFFSET + m] * w[x + m]
            per = per if per > ZERO else ZERO
            square = (w[x + m] * w[x + m] + w[y + m] * w[y + m]) / (per * per)
            place = np.float32(np.int32(bits(square) - base)) * scale
            place = place if place > ZERO else ZERO
            w[to + m] = place if place < last else last
    for m in range(found):
        for to in (W_FIRST, W_MIDDLE, W_LAST):
            place = w[to + m]
            k = np.int64(place) & 65535
            w[to + m] = values[k] + (place - np.float32(np.int32(place))) * (
                values[k + 1] - values[k]
            )


@inline
def obscured(x, y, nu, nv):
    """What a ray counts by the cosine, for each unit of angle, times its square (x, y)²."""
    return (nv * x + nu * y) * y


@kernel
def add_weighted(w, count, start, lean, perspective, weights, thick):
    """Raise the horizon by the points that are above it, weighted by a falloff."""
    found = pick(w, count, thick)
    if found == 0:
        return
    set_lines(w, found, start, lean, perspective)
    cut(w, found, ONE / weights.radius if weights.radius < HUGE else ZERO)
    set_nodes(w, found)
    if len(weights.values) == 0:
        weigh(w, found, weights.formula)
    else:
        weigh_by_table(w, found, weights.values, weights.scale, weights.base)
    least = ONE
    for m in range(found):
        part = w[PART + m]
        least = part if part < least else least
    for m in range(found):
        nu, nv = w[NU + m], w[NV + m]
        first = OUTER * obscured(w[X_FIRST + m], w[Y_FIRST + m], nu, nv)
        # The outer nodes are as long as each other, the middle one is 1 long.
        square = w[X_FIRST + m] * w[X_FIRST + m] + w[Y_FIRST + m] * w[Y_FIRST + m]
        middle = INNER * square * obscured(w[X_MIDDLE + m], w[Y_MIDDLE + m], nu, nv)
        last = OUTER * obscured(w[X_LAST + m], w[Y_LAST + m], nu, nv)
        mean = first * w[W_FIRST + m] + middle * w[W_MIDDLE + m] + last * w[W_LAST + m]
        mean /= first + middle + last
        all_of_it = below(w[END + m], nu, nv) - below(w[C0 + m], nu, nv)
        part = w[PART + m]
        part = part if part < WHOLE_SHARE else ONE
        w[W_MIDDLE + m] = part * all_of_it * mean if all_of_it > ZERO else ZERO
        w[PART + m] = part
    if least < WHOLE_SHARE:
        for m in range(found):
            c = blend(w[PART + m], w[C1 + m], w[OLD + m])
            w[C1 + m] = c if w[PART + m] < ONE else w[C1 + m]
    for m in range(found):
        i = receiver(w, m)
        w[CLOSED + i] += w[W_MIDDLE + m]
        w[TOP + i] = w[C1 + m]


@kernel
def add_plain(w, count, thick):
    """Raise the horizon by the points that are above it, all of weight 1.

    What lies below the horizon is added at the end; here what is seen of it between slabs (`thick`:
    none), or beside points that stand for a part of the sector, is taken away.
    """
    least = ONE
    for i in range(count):
        share = w[SHARE + i]
        least = share if share < least else least
    if thick and not least < WHOLE_SHARE:
        for i in range(count):
            w[TOP + i] = greater(w[SEEN + i], w[TOP + i])
        return
    found = pick(w, count, thick)
    for m in range(found):
        nu, nv = w[NU + m], w[NV + m]
        c, top = w[C1 + m], w[OLD + m]
        part = w[PART + m]
        part = part if part < WHOLE_SHARE else ONE
        new = blend(part, c, top)
        new = new if part < ONE else c
        closed = part * (below(c, nu, nv) - below(w[C0 + m], nu, nv))
        w[W_FIRST + m] = closed - (below(new, nu, nv) - below(top, nu, nv))
        w[W_LAST + m] = new
    for m in range(found):
        i = receiver(w, m)
        w[CLOSED + i] += w[W_FIRST + m]
        w[TOP + i] = w[W_LAST + m]
