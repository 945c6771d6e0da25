"""What the surface between two samples of a line hides from a block of receivers, as shells.

All receivers of a block meet the same cell in the same place, so what it hides from each of them is
found side by side. Where that only raises a horizon a little it is done with; the others, where a
gap begins, grows or closes, are gone through one by one.
"""

import numpy as np

from adret._kernels.jit import greater, inline, kernel
from adret._kernels.screen.gaps import hide
from adret._kernels.screen.slices import BASE, HALF, HIGH, LANES, ONE, RAISED, SIZE, ZERO, A, B

# Quantities of a block, after those of `slices`: of the cell at hand ...
THERE = SIZE  # nearness where the line leaves it
BEFORE = SIZE + 1 * LANES  # where it enters it
LEAST = SIZE + 2 * LANES  # of its corners; NaN where one shows no surface
MOST = SIZE + 3 * LANES
STEEP = SIZE + 4 * LANES  # change of depth a pixel along the surface, of the steepest corner
BROKEN = SIZE + 5 * LANES  # 1 where it is not of one surface
BACK = SIZE + 6 * LANES  # slopes to the back and the front of a stretch of the surface
FRONT = SIZE + 7 * LANES
LEFT = SIZE + 8 * LANES  # 1 where it does more than raise the horizon
# ... and of the slice: slopes between which the lowest interval above a gap lies; inf for none.
HANGING = SIZE + 9 * LANES
HANGING_END = SIZE + 10 * LANES
SHELL_SIZE = SIZE + 11 * LANES

ENDLESS = np.float32(np.inf)
MINUS = np.float32(-np.inf)
UNKNOWN_CELL = np.float32(np.nan)
NARROW = np.float32(0.1)
"""Square of the tangent of an interval that may be counted later, as in `gaps`."""


@inline
def behind(h, thickness, perspective):
    """Nearness of the back of a shell."""
    return h / (ONE + h * thickness) if perspective else h - thickness


@inline
def difference(a, b, perspective):
    """Difference in depth of two nearnesses."""
    return abs(ONE / a - ONE / b) if perspective else abs(a - b)


@kernel
def clear_gaps(w, gaps):
    """Let no interval hang above a gap."""
    for x in range(LANES):
        gaps[x, 0] = ZERO
        w[HANGING + x] = ENDLESS
        w[HANGING_END + x] = ENDLESS


@kernel
def settle_plain(w, n):
    """Raise horizons by what lies from `BACK` to `FRONT`, where that is all; else mark as `LEFT`.

    Tells whether any is left.
    """
    some = False
    for x in range(n):
        top = w[RAISED + x]
        low, high = w[BACK + x], w[FRONT + x]
        hanging, end = w[HANGING + x], w[HANGING_END + x]
        c0 = w[A + x] * top + w[B + x]
        c1 = w[A + x] * high + w[B + x]
        turn = c1 - c0
        narrow = turn * turn < NARROW * (ONE + c0 * c0) * (ONE + c1 * c1)
        rises = high > top
        plain = rises & (low <= top) & (hanging > high) & narrow
        inside = (low >= hanging) & (high <= end)
        rest = rises & (not plain) & (not inside)
        w[RAISED + x] = high if plain else top
        w[LEFT + x] = ONE if rest else ZERO
        some |= rest
    return some


@kernel
def offer(w, start, stop, gaps, s, cosine, uniform, code, radius, scale, table):
    """Hide what lies from `BACK` to `FRONT` and `s` pixels away from receivers of a block."""
    if not settle_plain(w[start:], stop - start):
        return
    for x in range(start, stop):
        if w[LEFT + x] > ZERO:
            low, high = w[BACK + x], w[FRONT + x]
            hide(w, x, gaps, low, high, s, cosine, uniform, code, radius, scale, table)
            if gaps[x, 0] > ZERO:
                w[HANGING + x] = gaps[x, 1]
                w[HANGING_END + x] = gaps[x, 2]
            else:
                w[HANGING + x] = ENDLESS
                w[HANGING_END + x] = ENDLESS


@inline
def highest(h, base, one, two, s):
    """The larger of s and of the slopes to nearness h at two ways (as 1 over each)."""
    rise = h - base
    return greater(greater(rise * one, rise * two), s)


@kernel
def could_rise(w, n, a, b, c, d, one, two):
    """Fill `HIGH` with what four nearnesses may raise a slope to between two ways.

    Also `LEAST` and `MOST` of them. Tells whether any horizon may rise. `w` begins at the first
    receiver.
    """
    some = False
    for x in range(n):
        h, top = w[BASE + x], w[RAISED + x]
        p, q, r, t = a[x], b[x], c[x], d[x]
        s = highest(p, h, one, two, top)
        s = highest(q, h, one, two, s)
        s = highest(r, h, one, two, s)
        s = highest(t, h, one, two, s)
        total = p + q + r + t
        least = p if p < q else q
        most = p if p > q else q
        other = r if r < t else t
        more = r if r > t else t
        least = least if least < other else other
        w[LEAST + x] = least if total == total else UNKNOWN_CELL
        w[MOST + x] = most if most > more else more
        w[HIGH + x] = s
        some |= s > top
    return some


@kernel
def look_ahead(near, w, low, high, at, corners, cuts, j):
    """Fill `HIGH` of receivers low to high - 1: what their horizons may rise to by cell j."""
    at += low
    n = high - low
    return could_rise(
        w[low:],
        n,
        near[at + corners[j, 0] : at + corners[j, 0] + n],
        near[at + corners[j, 1] : at + corners[j, 1] + n],
        near[at + corners[j, 2] : at + corners[j, 2] + n],
        near[at + corners[j, 3] : at + corners[j, 3] + n],
        ONE / cuts[j, 0],
        ONE / cuts[j, 3],
    )


@kernel
def steepest(w, n, a, b, c, d):
    """Fill `STEEP` with the largest of four."""
    for x in range(n):
        w[STEEP + x] = greater(greater(a[x], b[x]), greater(c[x], d[x]))


@kernel
def set_steep(steep, w, low, high, at, i0, i1, i2, i3):
    """Fill `STEEP` of receivers low to high - 1 from four pixels."""
    at += low
    n = high - low
    steepest(
        w[low:],
        n,
        steep[at + i0 : at + i0 + n],
        steep[at + i1 : at + i1 + n],
        steep[at + i2 : at + i2 + n],
        steep[at + i3 : at + i3 + n],
    )


@kernel
def lines_between(w, n, a0, a1, b0, b1, share, old_share):
    """Fill `THERE` and `BEFORE` with what lies between two pixels each."""
    for x in range(n):
        w[THERE + x] = a0[x] + (a1[x] - a0[x]) * share
        w[BEFORE + x] = b0[x] + (b1[x] - b0[x]) * old_share


@kernel
def mark_broken(w, n, thickness, perspective):
    """Mark as `BROKEN` what may raise a horizon and is not of one surface; tell whether any is."""
    some = False
    for x in range(n):
        gap = difference(w[LEAST + x], w[MOST + x], perspective)
        whole = (gap <= thickness) | (gap <= thickness + w[STEEP + x])
        broken = (w[HIGH + x] > w[RAISED + x]) & (not whole)
        w[BROKEN + x] = ONE if broken else ZERO
        some |= broken
    return some


@kernel
def reach_whole(w, n, one, two, thickness, perspective):
    """Set `BACK` and `FRONT` of a stretch between two ways (as 1 over each), unless broken."""
    for x in range(n):
        base, h, old = w[BASE + x], w[THERE + x], w[BEFORE + x]
        front = greater((old - base) * one, (h - base) * two)
        a = (behind(old, thickness, perspective) - base) * one
        b = (behind(h, thickness, perspective) - base) * two
        w[BACK + x] = a if a < b else b
        taken = (w[HIGH + x] > w[RAISED + x]) & (w[BROKEN + x] == ZERO)
        w[FRONT + x] = front if taken else MINUS


@kernel
def reach_first(w, n, per_way):
    """Set `FRONT` of the surface from the pixel itself to a way (as 1 over it), unless broken."""
    for x in range(n):
        w[BACK + x] = MINUS
        front = (w[THERE + x] - w[BASE + x]) * per_way
        w[FRONT + x] = front if w[BROKEN + x] == ZERO else MINUS


@kernel
def reach_beside(w, n, b0, b1, p, q):
    """Set `FRONT` of the surface right beside the pixel, unless broken."""
    for x in range(n):
        w[BACK + x] = MINUS
        front = p * b0[x] + q * b1[x] - w[BASE + x] * (p + q)
        w[FRONT + x] = front if w[BROKEN + x] == ZERO else MINUS


@kernel
def reach_even(w, n, h, one, two, thickness, perspective):
    """Set `BACK` and `FRONT` of an even stretch between two ways (as 1 over each), where broken."""
    for x in range(n):
        base = w[BASE + x]
        rise = h[x] - base
        fall = behind(h[x], thickness, perspective) - base
        a, b = fall * one, fall * two
        w[BACK + x] = a if a < b else b
        front = greater(rise * one, rise * two)
        w[FRONT + x] = front if w[BROKEN + x] > ZERO else MINUS


@kernel
def pass_cell(
    near, w, start, stop, at, o, p, q, corners, pieces, cuts, steep, line, j, thickness,
    perspective, gaps, cosine, uniform, code, radius, scale, table,
):  # fmt: skip
    """Hide what the cell between samples j - 1 and j of a line hides from some receivers."""
    k = j - 1
    n = stop - start
    a0, a1, b0, b1 = (
        at + start + o[j, 0], at + start + o[j, 3], at + start + o[k, 0], at + start + o[k, 3]
    )  # fmt: skip
    way, here = cuts[j, 0], cuts[j, 3]
    v = w[start:]
    i0, i1, i2, i3 = corners[j, 0], corners[j, 1], corners[j, 2], corners[j, 3]
    set_steep(steep, w, start, stop, at, i0, i1, i2, i3)
    some = mark_broken(v, n, thickness, perspective)
    lines_between(
        v, n, near[a0 : a0 + n], near[a1 : a1 + n], near[b0 : b0 + n], near[b1 : b1 + n],
        q[j] * here, q[k] * way,
    )  # fmt: skip
    if k == line:
        reach_beside(v, n, near[b0 : b0 + n], near[b1 : b1 + n], p[k], q[k])
        offer(w, start, stop, gaps, ZERO, cosine, uniform, code, radius, scale, table)
        reach_first(v, n, ONE / here)
    else:
        reach_whole(v, n, ONE / way, ONE / here, thickness, perspective)
    offer(w, start, stop, gaps, HALF * (way + here), cosine, uniform, code, radius, scale, table)
    for i in range(3 if some else 0):
        out, back = cuts[j, i], cuts[j, i + 1]
        if pieces[j, i] != 0 and back > out:
            piece = at + start + pieces[j, i]
            reach_even(
                v, n, near[piece : piece + n], ONE / out, ONE / back, thickness, perspective
            )  # fmt: skip
            between = HALF * (out + back)
            offer(w, start, stop, gaps, between, cosine, uniform, code, radius, scale, table)


@kernel
def sampled(out, a, b, u, v, share, thickness, perspective):
    """Nearness between two pixels; that of the nearer one where the surface is broken."""
    nearer_second = share > HALF
    for x in range(len(out)):
        whole = difference(a[x], b[x], perspective) <= thickness + greater(u[x], v[x])
        lone = b[x] if nearer_second else a[x]
        out[x] = a[x] + (b[x] - a[x]) * share if whole else lone


@kernel
def mark_torn(w, n, pixels, thickness, perspective):
    """Mark as `BROKEN` where two samples, some pixels apart, are not of one surface."""
    some = False
    for x in range(n):
        gap = difference(w[THERE + x], w[BEFORE + x], perspective)
        whole = gap <= pixels * (thickness + w[STEEP + x])
        broken = (w[HIGH + x] > w[RAISED + x]) & (not whole)
        w[BROKEN + x] = ONE if broken else ZERO
        some |= broken
    return some


@kernel
def pass_step(
    near, w, start, stop, at, o, q, s, steep, j, thickness, perspective, gaps, cosine, uniform,
    code, radius, scale, table,
):  # fmt: skip
    """Hide what lies between two samples that may be more than a pixel apart.

    They are of one surface if the depth changes by less than thickness and steepness a pixel.
    """
    n = stop - start
    a0, a1, b0, b1 = (
        at + start + o[j, 0], at + start + o[j, 3], at + start + o[j - 1, 0],
        at + start + o[j - 1, 3],
    )  # fmt: skip
    way, here = s[j - 1], s[j]
    middle = HALF * (way + here)
    v = w[start:]
    sampled(
        w[BEFORE + start : BEFORE + stop], near[b0 : b0 + n], near[b1 : b1 + n],
        steep[b0 : b0 + n], steep[b1 : b1 + n], q[j - 1] * way, thickness, perspective,
    )  # fmt: skip
    sampled(
        w[THERE + start : THERE + stop], near[a0 : a0 + n], near[a1 : a1 + n],
        steep[a0 : a0 + n], steep[a1 : a1 + n], q[j] * here, thickness, perspective,
    )  # fmt: skip
    set_steep(steep, w, start, stop, at, o[j - 1, 0], o[j - 1, 3], o[j, 0], o[j, 3])
    some = mark_torn(v, n, max(here - way, ONE), thickness, perspective)
    reach_whole(v, n, ONE / way, ONE / here, thickness, perspective)
    offer(w, start, stop, gaps, middle, cosine, uniform, code, radius, scale, table)
    if some:
        h = w[BEFORE + start : BEFORE + stop]
        reach_even(v, n, h, ONE / way, ONE / middle, thickness, perspective)
        between = HALF * (way + middle)
        offer(w, start, stop, gaps, between, cosine, uniform, code, radius, scale, table)
        h = w[THERE + start : THERE + stop]
        reach_even(v, n, h, ONE / middle, ONE / here, thickness, perspective)
        between = HALF * (middle + here)
        offer(w, start, stop, gaps, between, cosine, uniform, code, radius, scale, table)
