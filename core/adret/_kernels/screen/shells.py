"""First hits in slices through the view ray, where the surface is solid for a finite thickness.

A stretch of the surface between two samples then hides an interval of directions, from its back to
its front, and the union of the intervals may have gaps. As long as an interval reaches down to what
is hidden already, it raises the horizon as `exact` does. What hangs above a gap is kept in a list
of the receiver, counted at once, and swallowed when the horizon rises to it.

A cell between four pixel centres is broken where their depths lie further apart than the thickness
and the surface's own steepness (the largest of its corners'): then each quarter has the depth of
its corner, and the receiver's own quarters are empty.
"""

import numpy as np

from adret._kernels.jit import greater, inline, kernel, parallel_kernel, prange
from adret._kernels.screen.ahead import all_empty, highest_ahead, may_rise
from adret._kernels.screen.exact import LOOK, border
from adret._kernels.screen.gaps import hide
from adret._kernels.screen.intervals import advance, any_rose, close
from adret._kernels.screen.slices import (
    BASE,
    HALF,
    HIGH,
    LANES,
    LOW,
    NORMAL_U,
    NORMAL_V,
    ONE,
    RAISED,
    SIZE,
    UNKNOWN,
    ZERO,
    A,
    B,
    add_direction,
    aim,
    farthest,
    finish,
    leave,
    open_share,
    place,
    write,
)

ENDLESS = np.float32(np.inf)
MINUS = np.float32(-np.inf)


@inline
def behind(h, thickness, perspective):
    """Nearness of the back of a shell."""
    return h / (1.0 + h * thickness) if perspective else h - thickness


@inline
def apart(a, b, thickness, perspective):
    """Whether two nearnesses are not of one surface; NaN never is."""
    gap = abs(1.0 / a - 1.0 / b) if perspective else abs(a - b)
    return not gap <= thickness


@inline
def sampled(a, b, share, thickness, steep, other, perspective):
    """Nearness between two pixels; that of the nearer one where the surface is broken."""
    h = a + (b - a) * share
    if apart(a, b, thickness + max(steep, other), perspective):
        h = b if share > 0.5 else a
    return h


@inline
def reach_of(base, old, h, way, here, thickness, perspective):
    """Slopes from the back to the front of a stretch of surface between two ways."""
    high = (h - base) / here
    low = (behind(h, thickness, perspective) - base) / here
    if way > ZERO:
        high = max(high, (old - base) / way)
        low = min(low, (behind(old, thickness, perspective) - base) / way)
    else:
        if old > base:
            high = ENDLESS
        if behind(old, thickness, perspective) < base:
            low = MINUS
    return low, high


@kernel
def pass_cell(
    near, w, start, stop, at, o, p, q, corners, pieces, cuts, steep, line, j, thickness,
    perspective, gaps, cosine, uniform, code, radius, scale, table,
):  # fmt: skip
    """Hide what the cell between samples j - 1 and j of a line hides from some receivers."""
    k = j - 1
    c0, c1, c2, c3 = at + corners[j, 0], at + corners[j, 1], at + corners[j, 2], at + corners[j, 3]
    a0, a1, b0, b1 = at + o[j, 0], at + o[j, 3], at + o[k, 0], at + o[k, 3]
    way, here = cuts[j, 0], cuts[j, 3]
    share, old_share = q[j] * here, q[k] * way
    between = HALF * (way + here)
    first = k == line
    for x in range(start, stop):
        top = w[RAISED + x]
        if not (first or w[HIGH + x] > top):
            continue
        base = w[BASE + x]
        one, two, three, four = near[c0 + x], near[c1 + x], near[c2 + x], near[c3 + x]
        far = min(min(one, two), min(three, four))
        close_by = max(max(one, two), max(three, four))
        known = one + two + three + four
        whole = known == known and not apart(far, close_by, thickness, perspective)
        if known == known and not whole:
            slope = max(max(steep[c0 + x], steep[c1 + x]), max(steep[c2 + x], steep[c3 + x]))
            whole = not apart(far, close_by, thickness + slope, perspective)
        if whole:
            h = near[a0 + x] + (near[a1 + x] - near[a0 + x]) * share
            if first:
                low = MINUS
                high = (h - base) / here
                beside = p[k] * near[b0 + x] + q[k] * near[b1 + x] - base * (p[k] + q[k])
                if beside > top:
                    hide(
                        w, x, gaps, low, beside, ZERO, cosine, uniform, code, radius, scale, table
                    )  # fmt: skip
            else:
                old = near[b0 + x] + (near[b1 + x] - near[b0 + x]) * old_share
                low, high = reach_of(base, old, h, way, here, thickness, perspective)
            if high > w[RAISED + x]:
                hide(
                    w, x, gaps, low, high, between, cosine, uniform, code, radius, scale, table
                )  # fmt: skip
            continue
        for i in range(3):
            out, back = cuts[j, i], cuts[j, i + 1]
            h = near[at + pieces[j, i] + x]
            if pieces[j, i] != 0 and back > out and h == h:
                low, high = reach_of(base, h, h, out, back, thickness, perspective)
                if high > w[RAISED + x]:
                    hide(
                        w, x, gaps, low, high, HALF * (out + back), cosine, uniform, code,
                        radius, scale, table,
                    )  # fmt: skip


@kernel
def pass_step(
    near, w, start, stop, at, o, q, s, steep, j, thickness, perspective, gaps, cosine, uniform,
    code, radius, scale, table,
):  # fmt: skip
    """Hide what lies between two samples that may be more than a pixel apart.

    They are of one surface if the depth changes by less than thickness and steepness a pixel.
    """
    a0, a1, b0, b1 = at + o[j, 0], at + o[j, 3], at + o[j - 1, 0], at + o[j - 1, 3]
    way, here = s[j - 1], s[j]
    share, old_share = q[j] * here, q[j - 1] * way
    middle = HALF * (way + here)
    pixels = max(here - way, ONE)
    for x in range(start, stop):
        if not w[HIGH + x] > w[RAISED + x]:
            continue
        base = w[BASE + x]
        u, v = steep[b0 + x], steep[b1 + x]
        old = sampled(near[b0 + x], near[b1 + x], old_share, thickness, u, v, perspective)
        slope = max(u, v)
        u, v = steep[a0 + x], steep[a1 + x]
        h = sampled(near[a0 + x], near[a1 + x], share, thickness, u, v, perspective)
        slope = max(slope, max(u, v))
        if not apart(h, old, pixels * (thickness + slope), perspective):
            low, high = reach_of(base, old, h, way, here, thickness, perspective)
            hide(w, x, gaps, low, high, middle, cosine, uniform, code, radius, scale, table)
            continue
        if old == old:
            low, high = reach_of(base, old, old, way, middle, thickness, perspective)
            between = HALF * (way + middle)
            hide(w, x, gaps, low, high, between, cosine, uniform, code, radius, scale, table)
        if h == h:
            low, high = reach_of(base, h, h, middle, here, thickness, perspective)
            between = HALF * (middle + here)
            hide(w, x, gaps, low, high, between, cosine, uniform, code, radius, scale, table)


@inline
def highest(h, base, one, two, s):
    """The larger of s and of the slopes to nearness h at two ways (as 1 over each)."""
    rise = h - base
    return greater(greater(rise * one, rise * two), s)


@kernel
def could_rise(a, b, c, d, base, raised, out, one, two):
    """Fill `out` with what slopes of four nearnesses may rise to between two ways."""
    for x in range(len(base)):
        h = base[x]
        s = highest(a[x], h, one, two, raised[x])
        s = highest(b[x], h, one, two, s)
        s = highest(c[x], h, one, two, s)
        out[x] = highest(d[x], h, one, two, s)


@kernel
def look_ahead(near, w, low, high, at, corners, cuts, j):
    """Fill `HIGH` of receivers low to high - 1: what their horizons may rise to by cell j."""
    at += low
    n = high - low
    could_rise(
        near[at + corners[j, 0] : at + corners[j, 0] + n],
        near[at + corners[j, 1] : at + corners[j, 1] + n],
        near[at + corners[j, 2] : at + corners[j, 2] + n],
        near[at + corners[j, 3] : at + corners[j, 3] + n],
        w[BASE + low : BASE + high],
        w[RAISED + low : RAISED + high],
        w[HIGH + low : HIGH + high],
        ONE / cuts[j, 0],
        ONE / cuts[j, 3],
    )


@kernel
def in_image(shape, tile, width, row, column, n, o, j):
    """First and last + 1 receiver of a block for which sample j lies in the image.

    Of a block that begins at `column`. Beyond the outermost pixel centres there is no surface, so
    none reaches half a pixel further.
    """
    low = 0
    high = n
    for k in range(2):
        down, across = o[j, 3 * k + 1], o[j, 3 * k + 2]
        shift = tile * across + (o[j, 3 * k] - across) // width - down * tile
        low = max(low, -((column + shift) // tile))
        high = min(high, (shape[1] - 1 - column - shift) // tile + 1)
        if row + down < 0 or row + down >= shape[0]:
            high = low
    return low, high


@kernel
def go_out(
    near, shape, tile, width, w, n, row, column, at, o, p, q, s, corners, pieces, cuts, steep, line,
    stop, reach, ahead, growth, thickness, perspective, gaps, cosine, uniform, code, radius, scale,
    table,
):  # fmt: skip
    """Go through the samples of one direction of the image.

    Tells whether it was given up because nothing ahead can rise above the horizons.
    """
    look = ZERO
    for x in range(n):
        gaps[x, 0] = ZERO
    before = ZERO
    seen = True
    j = line + 1
    while j < stop:
        low, high = in_image(shape, tile, width, row, column, n, o, j)
        if high > low:
            if j > line + 1:
                look_ahead(near, w, low, high, at, corners, cuts, j)
            if pieces[j, 0] == 0 and pieces[j, 2] == 0:
                pass_step(
                    near, w, low, high, at, o, q, s, steep, j, thickness, perspective, gaps,
                    cosine, uniform, code, radius, scale, table,
                )  # fmt: skip
            else:
                pass_cell(
                    near, w, low, high, at, o, p, q, corners, pieces, cuts, steep, line, j,
                    thickness, perspective, gaps, cosine, uniform, code, radius, scale, table,
                )  # fmt: skip
        else:
            seen = False
        # Intervals end where they would for any other block, so that they give the same.
        if j == stop - 1 or s[j] >= growth * before:
            if any_rose(w):
                close(w, before, s[j], cosine, uniform, ENDLESS, code, radius, scale, table)
                advance(w)
            before = s[j]
            if not seen or before > reach:
                break
            if before > look and j < stop - 1:
                look = LOOK * before
                if not may_rise(w, highest_ahead(ahead, before), before, s[stop - 1]):
                    return True
        j += 1
    return False


@kernel
def leave_behind(w, n, gaps, cosine, uniform):
    """Take from `UNKNOWN` what `leave` added of directions that shells hide."""
    for x in range(n):
        nu, nv = w[NORMAL_U + x], w[NORMAL_V + x]
        for k in range(int(gaps[x, 0])):
            low = max(w[A + x] * gaps[x, 1 + 2 * k] + w[B + x], w[LOW + x])
            high = min(w[A + x] * gaps[x, 2 + 2 * k] + w[B + x], w[HIGH + x])
            if high > low:
                w[UNKNOWN + x] -= open_share(low, high, nu, nv, cosine, uniform)


@kernel
def shell_row(
    row, longest, near, pad, shape, normal, rays, perspective, frame, o, p, q, s, lines, along,
    corners, pieces, cuts, steep, growth, cosine, uniform, thickness, code, radius, scale, table,
    empty, tops, occlusion, confidence, bent, given_up,
):  # fmt: skip
    """One row of `shell_slices`."""
    tile, width = near.shape[1], near.shape[2]
    flat = near.reshape(near.size)
    ax, ay = np.float32(rays[0]), np.float32(rays[2])
    i = row - frame[0]
    w = np.empty(SIZE, dtype=np.float32)
    gaps = np.empty((LANES, 6 * longest + 3), dtype=np.float32)
    given_up[i] = 0
    for phase in range(tile):
        begin = (frame[2] - phase + tile - 1) // tile
        end = (frame[3] - phase + tile - 1) // tile
        for first in range(begin, end, LANES):
            n = min(LANES, end - first)
            column = phase + tile * first
            j = column - frame[2]
            resting = all_empty(empty[i, j::tile], n)
            at = ((row + pad[0]) * tile + phase) * width + first + pad[1]
            y = place(flat, at, normal, row, column, tile, n, rays, perspective, radius, w)
            for k in range(0 if resting else lines.shape[2]):
                dc = np.float32(along[row % tile, phase, k, 0])
                dr = np.float32(along[row % tile, phase, k, 1])
                ex = ax * dc
                ey = ay * dr
                aim(w, y, ex, ey, dc, dr, perspective, cosine, uniform)
                reach = farthest(w, perspective)
                ahead = (tops, shape, row, column, tile * (n - 1), dc, dr)
                if go_out(
                    flat, shape, tile, width, w, n, row, column, at, o, p, q, s, corners, pieces,
                    cuts, steep, lines[row % tile, phase, k, 0], lines[row % tile, phase, k, 1],
                    reach, ahead, growth, thickness, perspective, gaps, cosine, uniform, code,
                    radius, scale, table,
                ):  # fmt: skip
                    given_up[i] += n
                if reach > border(row, column, tile, n, shape, dc, dr):
                    leave(w, column, tile, row, shape, dc, dr, radius, cosine, uniform)
                    leave_behind(w, n, gaps, cosine, uniform)
                add_direction(w, y, ex, ey)
            finish(w, cosine, uniform)
            write(w, n, occlusion[i, j::tile], confidence[i, j::tile], bent[:, i, j::tile])


@parallel_kernel
def shell_slices(
    near, pad, shape, normal, rays, perspective, frame, o, p, q, lone, v, s, lines, along,
    corners, pieces, cuts, steep, growth, cosine, uniform, thickness, code, radius, scale, table,
    empty, tops, occlusion, confidence, bent, given_up,
):  # fmt: skip
    """Occlusion of a frame by shells; the rest as for `exact.slices`.

    Parameters
    ----------
    corners : (S, 4) int64
        Flat shifts in `near` of the corners of the cell between the sample before and this one;
        of the four pixels of both samples where these are further apart.
    pieces : (S, 3) int64
        Of up to three of its quarters that the line goes through; all 0 where samples are further
        apart, one 0 for the receiver's own.
    cuts : (S, 4) float32
        Ways at which the line enters and leaves these quarters; the last one is the sample's own.
    steep : (R T W,) float32
        Change of depth a pixel along the surface, laid out as `near`.
    thickness : float32
    """
    longest = 0
    for k in range(lines.size // 2):
        line = lines.reshape(lines.size // 2, 2)[k]
        longest = max(longest, line[1] - line[0])
    for row in prange(frame[0], frame[1]):
        shell_row(
            row, longest, near, pad, shape, normal, rays, perspective, frame, o, p, q, s, lines,
            along, corners, pieces, cuts, steep, growth, cosine, uniform, thickness, code, radius,
            scale, table, empty, tops, occlusion, confidence, bent, given_up,
        )  # fmt: skip
