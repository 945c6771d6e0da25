"""Line-sweep ambient obscurance: the hulls of a strip's lines, side by side (P3, algorithm 1).

A hull is a stack of points. The three topmost, and one point kept aside, stand in `tops`; all are
also in `hull`, layer after layer over the lines, so that neighbouring lines' tops share memory
pages. Below a line's points are `BOTTOM` layers of NaN: no test against them is true.
"""

import math

import numpy as np

from adret._kernels.jit import index, kernel
from adret._kernels.screen.falloffs import TABLE, weight
from adret._kernels.screen.lsao_strips import (
    LENGTH,
    OWN,
    STRIP,
    TANGENT,
    TOPS,
    C,
    S,
    X,
    Y,
    sine_of_tangent,
)

BOTTOM = 3
TOP_X = TOPS
TOP_Y = TOPS + 1 * STRIP
NEXT_X = TOPS + 2 * STRIP
NEXT_Y = TOPS + 3 * STRIP
THIRD_X = TOPS + 4 * STRIP
THIRD_Y = TOPS + 5 * STRIP
ASIDE_X = TOPS + 6 * STRIP
ASIDE_Y = TOPS + 7 * STRIP
# In float32: differences to the four points, and what is seen.
HX, HY, GX, GY, FX, FY, IX, IY = (k * STRIP for k in range(8))
SEEN_S = 8 * STRIP
SEEN_C = 9 * STRIP
BELOW = 10 * STRIP  # the tangent plane's sine, times the length of the eye's direction
LONG = 11 * STRIP
SINE = 12 * STRIP
HERE = 13 * STRIP  # NaN where there is no point
# Verdicts: points to pop, up to two; then -1 (as a whole number: all bits) where it is so.
POPS = 14 * STRIP
THERE = 15 * STRIP  # there is a point
UNPOPPED = 16 * STRIP  # and none to pop
PASSED = 17 * STRIP  # the topmost point, being below the tangent plane, was passed
ONLY = 18 * STRIP  # and no other
SIGHTS = 19 * STRIP
# Verdicts in int32, from `POPS` on as above; then:
LEFT = 5 * STRIP  # points left on the hull
CHOSEN = 6 * STRIP  # lines to go on with
VERDICTS = 7 * STRIP + 1
ZERO = np.float32(0.0)
ONE = np.float32(1.0)
MINUS = np.float32(-1.0)
NEVER = np.int32(0)
FIRST = np.int32(BOTTOM)


@kernel
def cast(hx, hy, s, c, below, falloff, zero):
    """Obscurance above the tangent plane, times the length of the eye's direction, as a fraction.

    `falloff` is (a, b, c, e, R²): W = (a + b d²)/(c + e d²), 0 from R on.
    """
    d2 = hx * hx + hy * hy
    d = np.sqrt(d2)
    num = falloff[0] + falloff[1] * d2
    n = (c * hy - s * hx - below * d) * (num if d2 < falloff[4] else zero)
    return n if n > zero else zero, d * (falloff[2] + falloff[3] * d2)


@kernel
def cast_by_table(hx, hy, s, c, below, falloff, table):
    """As `cast`; with a table, the falloff is that, its scale and radius the first two numbers."""
    if len(table) == 0:
        return cast(hx, hy, s, c, below, falloff, 0.0)
    d = math.sqrt(hx * hx + hy * hy)
    n = (c * hy - s * hx - below * d) * weight(TABLE, falloff[1], falloff[0], table, d)
    return n if n > 0.0 else 0.0, d


@kernel
def look(w, f, low, count):
    """What the four points are like from the points of this row."""
    v = w[low:]
    g = f[low:]
    for i in range(count):
        x, y = v[X + i], v[Y + i]
        g[HX + i] = np.float32(v[TOP_X + i] - x)
        g[HY + i] = np.float32(v[TOP_Y + i] - y)
        g[GX + i] = np.float32(v[NEXT_X + i] - x)
        g[GY + i] = np.float32(v[NEXT_Y + i] - y)
        g[FX + i] = np.float32(v[THIRD_X + i] - x)
        g[FY + i] = np.float32(v[THIRD_Y + i] - y)
        g[IX + i] = np.float32(v[ASIDE_X + i] - x)
        g[IY + i] = np.float32(v[ASIDE_Y + i] - y)
        g[SEEN_S + i] = np.float32(v[S + i])
        g[SEEN_C + i] = np.float32(v[C + i])
        g[LONG + i] = np.float32(v[LENGTH + i])
        g[SINE + i] = np.float32(v[TANGENT + i])
        g[HERE + i] = np.float32(y)


@kernel
def judge(f, low, count, falloff, loose, verdicts, value):
    """The first two tests of algorithm 1 on every line: how many points to pop, up to two.

    Writes the obscurance as if it were two at most; NaN where there is no point, or none before.
    `loose`: points below the tangent plane are popped though what is behind them casts no more.
    """
    g = f[low:]
    for i in range(count):
        hx, hy = g[HX + i], g[HY + i]
        gx, gy = g[GX + i], g[GY + i]
        fx, fy = g[FX + i], g[FY + i]
        s, c, length, sine = g[SEEN_S + i], g[SEEN_C + i], g[LONG + i], g[SINE + i]
        below = sine * length
        n1, m1 = cast(hx, hy, s, c, below, falloff, ZERO)
        n2, m2 = cast(gx, gy, s, c, below, falloff, ZERO)
        n3, m3 = cast(fx, fy, s, c, below, falloff, ZERO)
        n4, m4 = cast(g[IX + i], g[IY + i], s, c, below, falloff, ZERO)
        first = (hx * gy < hy * gx) & ((n1 * m2 < n2 * m1) | ((n1 == ZERO) & loose))
        second = first & (gx * fy < gy * fx) & ((n2 * m3 < n3 * m2) | ((n2 == ZERO) & loose))
        n = n2 if first else n1
        m = m2 if first else m1
        aside = n * m4 < n4 * m
        n = n4 if aside else n
        m = m4 if aside else m
        value[i] = sine + n / (m * length)
        there = MINUS if g[HERE + i] == g[HERE + i] else ZERO
        passed = MINUS if first & (n1 == ZERO) & loose else ZERO
        g[POPS + i] = (ONE if first else ZERO) + (ONE if second else ZERO)
        g[THERE + i] = there
        g[UNPOPPED + i] = ZERO if first else there
        g[PASSED + i] = passed
        g[ONLY + i] = ZERO if second else passed
    mask(f, low, count, verdicts)


@kernel
def postpone(f, low, count, verdicts):
    """Verdicts on lines that are not judged: nothing is popped so far."""
    g = f[low:]
    for i in range(count):
        there = MINUS if g[HERE + i] == g[HERE + i] else ZERO
        g[POPS + i] = ZERO
        g[THERE + i] = there
        g[UNPOPPED + i] = there
        g[PASSED + i] = ZERO
        g[ONLY + i] = ZERO
    mask(f, low, count, verdicts)


@kernel
def mask(f, low, count, verdicts):
    """Verdicts as whole numbers: a step of its own, or loops do not vectorise."""
    for shift in (POPS, THERE, UNPOPPED, PASSED, ONLY):
        g = f[shift + low :]
        v = verdicts[shift - POPS :]
        for i in range(count):
            v[i] = np.int32(g[i])


@kernel
def push(bits, low, count, verdicts):
    """Put the points of this row on top, of hulls from which at most one was popped.

    `bits` are those of the strip's numbers: chosen by masks, as a conditional would become a store
    under a mask, which takes several times as long.
    """
    v = bits[low:]
    for i in range(count):
        there = np.int64(verdicts[THERE - POPS + i])
        none = np.int64(verdicts[UNPOPPED - POPS + i])
        only = np.int64(verdicts[ONLY - POPS + i])
        ax, ay = v[TOP_X + i], v[TOP_Y + i]
        bx, by = v[NEXT_X + i], v[NEXT_Y + i]
        v[ASIDE_X + i] = (ax & only) | (v[ASIDE_X + i] & ~only)
        v[ASIDE_Y + i] = (ay & only) | (v[ASIDE_Y + i] & ~only)
        v[TOP_X + i] = (v[X + i] & there) | (ax & ~there)
        v[TOP_Y + i] = (v[Y + i] & there) | (ay & ~there)
        v[NEXT_X + i] = (ax & none) | (bx & ~none)
        v[NEXT_Y + i] = (ay & none) | (by & ~none)
        v[THIRD_X + i] = (bx & none) | (v[THIRD_X + i] & ~none)
        v[THIRD_Y + i] = (by & none) | (v[THIRD_Y + i] & ~none)


@kernel
def pop_on(w, j, k, top, falloff, table, loose, passed, hull, value, i):
    """Further pops from one line's hull, of which `k` points are left; returns how many then are.

    Sets what `push` could not know: the topmost points, that aside and the obscurance.
    """
    x, y, s, c, length = w[X + j], w[Y + j], w[S + j], w[C + j], w[LENGTH + j]
    sine = w[TANGENT + j]
    below = sine * length
    layer = index(2 * STRIP)
    at = index(top - 1) * layer + index(2 * j)
    top_x, top_y = hull[at], hull[at + index(1)]
    at = index(k - 1) * layer + index(2 * j)
    hx, hy = hull[at] - x, hull[at + index(1)] - y
    n, m = cast_by_table(hx, hy, s, c, below, falloff, table)
    passed = passed or (loose and n == 0.0)
    while True:
        gx, gy = hull[at - layer] - x, hull[at - layer + index(1)] - y
        # The next occluder is no higher: the horizon is reached.
        if not hx * gy < hy * gx:
            break
        next_n, next_m = cast_by_table(gx, gy, s, c, below, falloff, table)
        # It casts no more either: the largest occluder is on top.
        if not (n * next_m < next_n * m or (loose and n == 0.0)):
            break
        k -= 1
        at -= layer
        hx, hy, n, m = gx, gy, next_n, next_m
    hx, hy = w[ASIDE_X + j] - x, w[ASIDE_Y + j] - y
    next_n, next_m = cast_by_table(hx, hy, s, c, below, falloff, table)
    if n * next_m < next_n * m:
        n = next_n
        m = next_m
    value[i] = sine + n / (m * length)
    if passed:
        w[ASIDE_X + j] = top_x
        w[ASIDE_Y + j] = top_y
    w[NEXT_X + j], w[NEXT_Y + j] = hull[at], hull[at + index(1)]
    w[THIRD_X + j], w[THIRD_Y + j] = hull[at - layer], hull[at - layer + index(1)]
    hull[at + layer] = x
    hull[at + layer + index(1)] = y
    return k


@kernel
def settle(w, low, count, falloff, table, loose, verdicts, hull, sizes, value):
    """The same in memory, then further pops, one line after the other.

    With a table nothing has been judged, and all pops are made here. `sizes` (int32) is how many
    points each hull has. Returns whether a line has its first point.
    """
    size = sizes[low:]
    begun = NEVER
    for i in range(count):
        there = verdicts[THERE - POPS + i]
        top = size[i]
        rest = np.int32(top - verdicts[i])
        verdicts[LEFT + i] = rest
        size[i] = rest - there
        begun |= there if top == FIRST else NEVER
    v = w[low:]
    for i in range(count):
        at = index(verdicts[LEFT + i]) * index(2 * STRIP) + index(2 * (low + i))
        hull[at] = v[X + i]
        hull[at + index(1)] = v[Y + i]
    more = 0
    if len(table) == 0:
        for i in range(count):
            verdicts[CHOSEN + more] = i
            more += verdicts[i] >> 1
    else:
        for i in range(count):
            verdicts[CHOSEN + more] = i
            more -= verdicts[THERE - POPS + i]
    for m in range(more):
        i = verdicts[CHOSEN + m]
        k = verdicts[LEFT + i]
        top = k + verdicts[i]
        passed = verdicts[PASSED - POPS + i] != 0
        k = pop_on(w, low + i, k, top, falloff, table, loose, passed, hull, value, i)
        size[i] = k + 1
    return begun != 0


@kernel
def weigh_anew(w, low, count, falloff, table, value):
    """Replace the obscurance by that of the same occluder above the receiver's own tangent plane.

    After the push: the occluder is the second from the top.
    """
    for i in range(count):
        j = low + i
        if value[i] == value[i]:
            length = w[LENGTH + j]
            hx, hy = w[NEXT_X + j] - w[X + j], w[NEXT_Y + j] - w[Y + j]
            below = w[OWN + j] * length
            n, m = cast_by_table(hx, hy, w[S + j], w[C + j], below, falloff, table)
            value[i] = w[OWN + j] + n / (m * length)


@kernel
def begin(normal, swap, row, starts, shift, plane, w, low, size, value):
    """The first point of a line sees nothing above its own tangent plane."""
    for i in range(len(starts)):
        j = low + i
        if size[j] == BOTTOM + 1 and w[Y + j] == w[Y + j]:
            value[i] = sine_of_tangent(normal, swap, row, starts[i] + shift, plane, w, j)
