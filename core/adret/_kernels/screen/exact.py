"""First hits in slices through the view ray, where all behind the surface is solid.

Seen from a receiver such a solid hides, on one side of a slice, everything below a horizon. Going
outward the horizon only rises, and whatever a step raises it by is first hit there. So a slice is a
running maximum of slopes, four samples at a time for a whole block of receivers, and now and then
an interval of directions with known distances (`intervals`).
"""

import numpy as np

from adret._kernels.jit import greater, kernel, parallel_kernel, prange
from adret._kernels.screen.ahead import all_empty, highest_ahead, may_rise
from adret._kernels.screen.intervals import any_rose, lanes, settle, slope_of
from adret._kernels.screen.slices import (
    BASE,
    LANES,
    RAISED,
    SIZE,
    ZERO,
    add_direction,
    aim,
    farthest,
    finish,
    leave,
    place,
    write,
)

GROUP = 4
LOOK = np.float32(1.25)  # looks at what lies ahead are this factor of way apart


@kernel
def raise_by_four(
    a0, b0, a1, b1, a2, b2, a3, b3, base, raised, p0, p1, p2, p3, q0, q1, q2, q3, l0, l1, l2, l3,
    v0, v1, v2, v3,
):  # fmt: skip
    """Raise the horizon of receivers by four samples; four at a time keep the store plain."""
    c0, c1, c2, c3 = q0 > p0, q1 > p1, q2 > p2, q3 > p3
    for x in range(len(base)):
        h = base[x]
        s = greater(slope_of(a0[x], b0[x], p0, q0, l0, c0, h, v0), raised[x])
        s = greater(slope_of(a1[x], b1[x], p1, q1, l1, c1, h, v1), s)
        s = greater(slope_of(a2[x], b2[x], p2, q2, l2, c2, h, v2), s)
        raised[x] = greater(slope_of(a3[x], b3[x], p3, q3, l3, c3, h, v3), s)


@kernel
def raise_lanes(near, w, low, high, at, o, p, q, lone, v, j):
    """Raise the horizon of receivers low to high - 1 by samples j to j + 3."""
    at += low
    n = high - low
    raise_by_four(
        near[at + o[j, 0] : at + o[j, 0] + n],
        near[at + o[j, 3] : at + o[j, 3] + n],
        near[at + o[j + 1, 0] : at + o[j + 1, 0] + n],
        near[at + o[j + 1, 3] : at + o[j + 1, 3] + n],
        near[at + o[j + 2, 0] : at + o[j + 2, 0] + n],
        near[at + o[j + 2, 3] : at + o[j + 2, 3] + n],
        near[at + o[j + 3, 0] : at + o[j + 3, 0] + n],
        near[at + o[j + 3, 3] : at + o[j + 3, 3] + n],
        w[BASE + low : BASE + high],
        w[RAISED + low : RAISED + high],
        p[j], p[j + 1], p[j + 2], p[j + 3],
        q[j], q[j + 1], q[j + 2], q[j + 3],
        lone[j], lone[j + 1], lone[j + 2], lone[j + 3],
        v[j], v[j + 1], v[j + 2], v[j + 3],
    )  # fmt: skip


@kernel
def go_out(
    near, shape, w, n, row, first, at, o, p, q, lone, v, s, start, stop, reach, ahead, growth,
    cosine, uniform, tolerance, code, radius, scale, table,
):  # fmt: skip
    """Go through the samples of one direction of the image.

    Tells whether it was given up because nothing ahead can rise above the horizons.
    """
    settled = start
    before = ZERO
    look = ZERO
    i = start
    seen = True
    while i < stop:
        low, high = lanes(shape, row, first, n, o, i + GROUP - 1)
        if high > low:
            raise_lanes(near, w, low, high, at, o, p, q, lone, v, i)
        else:
            seen = False
        i += GROUP
        # Intervals end where they would for any other block, so that they give the same.
        if i == stop or s[i - 1] >= growth * before:
            if any_rose(w):
                settle(
                    near, shape, w, row, first, at, o, p, q, lone, v, s, settled, i, before,
                    cosine, uniform, tolerance, code, radius, scale, table,
                )  # fmt: skip
            settled = i
            before = s[i - 1]
            if not seen or before > reach:
                break
            if before > look and i < stop:
                look = LOOK * before
                if not may_rise(w, highest_ahead(ahead, before), before, s[stop - 1]):
                    return True
    return False


@kernel
def border(row, first, step, n, shape, along_column, along_row):
    """Way in the image to its border [pixels], of the receiver of a block that is nearest to it."""
    rows, columns = shape
    way = np.inf
    if along_row != 0.0:
        way = (rows - 1 - row if along_row > 0.0 else row) / abs(along_row)
    if along_column != 0.0:
        last = columns - 1 - (first + step * (n - 1))
        way = min(way, (last if along_column > 0.0 else first) / abs(along_column))
    return way


@kernel
def slice_row(
    row, near, pad, shape, normal, rays, perspective, frame, o, p, q, lone, v, s, lines, along,
    growth, cosine, uniform, tolerance, code, radius, scale, table, empty, tops, occlusion,
    confidence, bent, given_up,
):  # fmt: skip
    """One row of `slices`."""
    tile, width = near.shape[1], near.shape[2]
    flat = near.reshape(near.size)
    ax, ay = np.float32(rays[0]), np.float32(rays[2])
    i = row - frame[0]
    w = np.empty(SIZE, dtype=np.float32)
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
                    flat, near.shape, w, n, row + pad[0], first + pad[1], at, o, p, q, lone, v, s,
                    lines[row % tile, phase, k, 0], lines[row % tile, phase, k, 1], reach, ahead,
                    growth, cosine, uniform, tolerance, code, radius, scale, table,
                ):  # fmt: skip
                    given_up[i] += n
                if reach > border(row, column, tile, n, shape, dc, dr):
                    leave(w, column, tile, row, shape, dc, dr, radius, cosine, uniform)
                add_direction(w, y, ex, ey)
            finish(w, cosine, uniform)
            write(w, n, occlusion[i, j::tile], confidence[i, j::tile], bent[:, i, j::tile])


@parallel_kernel
def slices(
    near, pad, shape, normal, rays, perspective, frame, o, p, q, lone, v, s, lines, along,
    growth, cosine, uniform, tolerance, code, radius, scale, table, empty, tops, occlusion,
    confidence, bent, given_up,
):  # fmt: skip
    """Occlusion of a frame by horizons with falloff.

    Parameters
    ----------
    near : (R, T, W) float32
        Nearness, padded by -inf: pixel (r, c) is [r + pad[0], c % T, c // T + pad[1]].
    pad : (int, int)
        Padding above and to the left; at least the way between the first and the last sample of
        a group, on every side.
    shape : (int, int)
        Rows and columns of the image.
    normal, rays, perspective
        As in `Field`.
    frame : (int, int, int, int)
        Receivers: row0, row1, column0, column1.
    o : (S, 6) int64
        Of a sample's first pixel: shift in `near`, counted flat; in rows; and in W. Then the same
        of its second pixel.
    p, q, lone, v, s : (S,) float32
        Slope of a sample is p first + q second - v base, with one of them missing lone nearer -
        v base; `s` is its way in the image [pixels].
    lines : (T, T, K, 2) int64
        First sample of a line and the one after its last, by row and column modulo T; a multiple
        of `GROUP` samples.
    along : (T, T, K, 2) float64
        Directions (columns, rows), unit.
    growth : float32
        An interval of directions gathers samples while the way grows by this factor.
    cosine, uniform : float32
        1 and 0, or 0 and 1.
    tolerance : float32
        Largest difference of weights times width [radians] of an interval taken as one.
    code, radius, scale, table
        Falloff.
    empty : (row1 - row0, column1 - column0) bool
        Pixels without a receiver: a block of them is left out.
    tops : (4, max(rows, columns)) float32
        Largest nearness up to and from each row, up to and from each column.
    occlusion, confidence : (row1 - row0, column1 - column0) float32
        Outputs.
    bent : (3, row1 - row0, column1 - column0) float32
        Output: mean open direction, unit.
    given_up : (row1 - row0,) int64
        Output: directions of receivers that were given up because nothing ahead can occlude.
    """
    for row in prange(frame[0], frame[1]):
        slice_row(
            row, near, pad, shape, normal, rays, perspective, frame, o, p, q, lone, v, s, lines,
            along, growth, cosine, uniform, tolerance, code, radius, scale, table, empty, tops,
            occlusion, confidence, bent, given_up,
        )  # fmt: skip
