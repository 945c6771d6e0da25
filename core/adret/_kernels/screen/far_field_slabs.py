"""The obscurance estimator (P4, equation 3): slabs of a horizon, from a table of their integrals.

A slab is a straight line of the slice, between the horizon so far (cotangent c0) and a point that
raises it (c1 > c0). The obscurance that it adds is the integral over the angle θ from the view ray
of W(d) (n·ω) sin θ, d being the way to the line. With b the line's distance from the receiver, γ
its angle from the view ray and ψ = θ - γ, d is b / sin ψ, and cosine and sine of θ are those of ψ
turned by γ. So L(a, b, c, d) of P4 is the product of three integrals over ψ, which depend on ψ and
b alone, with numbers that depend on γ and the normal alone: exact in c and d, where P4 picks the
nearest of the tabulated normals.
"""

import numpy as np

from adret._kernels.jit import greater, index, inline, kernel
from adret._kernels.screen.far_field_block import (
    CLOSED,
    COSINE,
    FROM,
    HALF,
    HEIGHT,
    LIST,
    NEAR,
    NORMAL_U,
    NORMAL_V,
    ONE,
    PLACE,
    SEEN,
    SHARE,
    SIDE,
    SINE,
    TOP,
    TWO,
    X0,
    X1,
    ZERO,
    A,
    B,
    Y,
    below,
)

WHOLE_SHARE = np.float32(1.0 - 1e-5)


@inline
def bits(x):
    """The bits of a float32: linear in it between powers of 2, so nearly its logarithm."""
    return np.float32(x).view(np.int32)


@inline
def set_slab(w, i, start, lean, perspective, scale, base, last, half):
    """Where the slab of receiver i's point lies in the table.

    The slab meets the horizon's ray at the point's row (`lean` 0: it runs away from the eye) or
    nearer, as far as the row `start` where the point's interval begins (1).
    """
    c0 = w[FROM + i]
    c1 = w[SEEN + i]
    away = w[PLACE + i]
    foot = away + lean * (start - away)
    side = w[SIDE + i]
    # One over the distance from the view ray, where the rays of c1 and of c0 meet the line: linear
    # in c between them. Below 0: the ray and the line part.
    e1 = ONE / (side * away)
    e0 = ONE / (side * foot)
    if perspective:
        e1 *= w[HEIGHT + i]
        e0 *= w[NEAR + i] + (c0 - w[B + i]) / w[A + i] * foot
    beta = (e1 - e0) / (c1 - c0)
    alpha = e1 - beta * c1
    b2 = ONE / (alpha * alpha + beta * beta)
    double_cosine = (alpha * alpha - beta * beta) * b2
    double_sine = -TWO * alpha * beta * b2
    k1 = c1 * alpha - beta
    k0 = c0 * alpha - beta
    s1 = e1 if e1 > ZERO else ZERO
    s0 = e0 if e0 > ZERO else ZERO
    y = np.float32(bits(b2) - base) * scale
    y = y if y > ZERO else ZERO
    w[Y + i] = y if y < last else last
    w[X1 + i] = half * (ONE - k1 / (abs(k1) + s1))
    w[X0 + i] = half * (ONE - k0 / (abs(k0) + s0))
    nu, nv = w[NORMAL_U + i], w[NORMAL_V + i]
    w[COSINE + i] = nv * double_sine - nu * double_cosine
    w[SINE + i] = nu * double_sine + nv * double_cosine


@kernel
def slab(values, nodes, w, i):
    """Obscurance of the slab of receiver i's point."""
    y, x0, x1 = w[Y + i], w[X0 + i], w[X1 + i]
    row = int(y)
    n0 = int(x0)
    n1 = int(x1)
    fy = y - np.float32(row)
    f0 = x0 - np.float32(n0)
    f1 = x1 - np.float32(n1)
    g = ONE - fy
    a0, a1, a2, a3 = g * (ONE - f0), g * f0, fy * (ONE - f0), fy * f0
    b0, b1, b2, b3 = g * (ONE - f1), g * f1, fy * (ONE - f1), fy * f1
    s = 4 * nodes
    p = 4 * (row * nodes + n0)
    q = 4 * (row * nodes + n1)
    t = values[p : p + s + 8]
    u = values[q : q + s + 8]
    whole = a0 * t[0] + a1 * t[4] + a2 * t[s] + a3 * t[s + 4]
    cosine = a0 * t[1] + a1 * t[5] + a2 * t[s + 1] + a3 * t[s + 5]
    sine = a0 * t[2] + a1 * t[6] + a2 * t[s + 2] + a3 * t[s + 6]
    whole -= b0 * u[0] + b1 * u[4] + b2 * u[s] + b3 * u[s + 4]
    cosine -= b0 * u[1] + b1 * u[5] + b2 * u[s + 1] + b3 * u[s + 5]
    sine -= b0 * u[2] + b1 * u[6] + b2 * u[s + 2] + b3 * u[s + 6]
    return HALF * (w[NORMAL_U + i] * whole + w[COSINE + i] * cosine + w[SINE + i] * sine)


@inline
def blend(share, c, top):
    """Cotangent of the weighted mean of two directions."""
    p = share / np.sqrt(ONE + c * c)
    q = (ONE - share) / np.sqrt(ONE + top * top)
    return (p * c + q * top) / (p + q)


@kernel
def add_weighted(w, count, start, lean, perspective, table):
    """Raise the horizon by the points that are above it, weighted by a falloff's table."""
    values, nodes, scale, base = table
    half = np.float32(0.5 * (nodes - 1.01))
    last = np.float32(len(values) // (4 * nodes) - 1.01)
    found = 0
    for i in range(count):
        w[LIST + found] = np.float32(i)
        found += w[SEEN + i] > w[TOP + i]
    # All at once is a quarter of the time each.
    every = 4 * found > count
    if every:
        for i in range(count):
            set_slab(w, i, start, lean, perspective, scale, base, last, half)
    for m in range(found):
        i = index(w[LIST + m])
        if not every:
            set_slab(w, i, start, lean, perspective, scale, base, last, half)
        c = w[SEEN + i]
        share = w[SHARE + i]
        if c > w[FROM + i]:
            w[CLOSED + i] += share * slab(values, nodes, w, i)
        w[TOP + i] = c if share > WHOLE_SHARE else blend(share, c, w[TOP + i])


@kernel
def add_plain(w, count, thick):
    """Raise the horizon by the points that are above it, all of weight 1.

    What lies below the horizon is added at the end; here what is seen of it between slabs (`thick`:
    none), or beside points that stand for a part of the sector, is taken away.
    """
    simple = thick
    for i in range(count):
        simple = simple and not w[SHARE + i] < WHOLE_SHARE
    if simple:
        for i in range(count):
            w[TOP + i] = greater(w[SEEN + i], w[TOP + i])
        return
    for i in range(count):
        c = w[SEEN + i]
        top = w[TOP + i]
        if c > top:
            nu, nv = w[NORMAL_U + i], w[NORMAL_V + i]
            share = w[SHARE + i]
            if not share < WHOLE_SHARE:
                share = ONE
            new = c if share == ONE else blend(share, c, top)
            behind = min(w[FROM + i], c)
            w[CLOSED + i] += share * (below(c, nu, nv) - below(behind, nu, nv))
            w[CLOSED + i] -= below(new, nu, nv) - below(top, nu, nv)
            w[TOP + i] = new
