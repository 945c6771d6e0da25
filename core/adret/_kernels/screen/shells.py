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

from adret._kernels.jit import kernel, parallel_kernel, prange
from adret._kernels.screen.ahead import all_empty, highest_ahead, may_rise
from adret._kernels.screen.exact import LOOK, border
from adret._kernels.screen.intervals import advance, any_rose, close
from adret._kernels.screen.shell_cells import (
    SHELL_SIZE,
    clear_gaps,
    look_ahead,
    pass_cell,
    pass_step,
)
from adret._kernels.screen.slices import (
    HIGH,
    LANES,
    LOW,
    NORMAL_U,
    NORMAL_V,
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
    clear_gaps(w, gaps)
    before = ZERO
    seen = True
    j = line + 1
    while j < stop:
        low, high = in_image(shape, tile, width, row, column, n, o, j)
        if high > low:
            rises = look_ahead(near, w, low, high, at, corners, cuts, j)
            if j == line + 1:
                w[HIGH + low : HIGH + high] = ENDLESS
                rises = True
            if not rises:
                pass
            elif pieces[j, 0] == 0 and pieces[j, 2] == 0:
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
    w = np.empty(SHELL_SIZE, dtype=np.float32)
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
