"""Near field: every crossing of a cell's own ray with the grid, as a maximum over constant shifts.

For one azimuth the crossings' offsets and interpolation weights are the same for every cell, so the
horizon of the near field is a maximum over shifted, weighted copies of the array. The array is in
the sweep frame (see `adret.sweep`): the ray runs towards smaller rows and columns, and NaN padding
on those sides stands for "outside the raster". NaN never wins a maximum.
"""

from typing import Any

import numpy as np

from adret._kernels.ground import EMPTY, ORDINARY, SIDE, kind_of_block
from adret._kernels.jit import greater, helper, index, inline, shared_kernel

BLOCK = 1024  # columns that one thread serves at a time, of one row of blocks of ground


@helper
def four_crossings(z, a, b, here, best, p, q, k, crossing):
    """Raise `best` by four crossings from `crossing` on; four save loads and keep the store plain.

    `z` is flat, `here` the place in it of the first receiver; from there `a` and `b` lead to the
    two cells that each of its crossings lies between. Differences are taken before they are
    weighted: what lies level with the receiver is exactly level, whatever the height.
    """
    s0 = index(crossing)
    s1, s2, s3 = s0 + index(1), s0 + index(2), s0 + index(3)
    p0, p1, p2, p3 = p[s0], p[s1], p[s2], p[s3]
    q0, q1, q2, q3 = q[s0], q[s1], q[s2], q[s3]
    k0, k1, k2, k3 = k[s0], k[s1], k[s2], k[s3]
    first = index(here)
    a0, a1, a2, a3 = (
        first + index(a[s0]),
        first + index(a[s1]),
        first + index(a[s2]),
        first + index(a[s3]),
    )
    b0, b1, b2, b3 = (
        first + index(b[s0]),
        first + index(b[s1]),
        first + index(b[s2]),
        first + index(b[s3]),
    )
    for column in range(len(best)):
        x = index(column)
        z0 = z[first + x]
        s = greater((z[a0 + x] - z0) * p0 + ((z[b0 + x] - z0) * q0 + k0), best[x])
        s = greater((z[a1 + x] - z0) * p1 + ((z[b1 + x] - z0) * q1 + k1), s)
        s = greater((z[a2 + x] - z0) * p2 + ((z[b2 + x] - z0) * q2 + k2), s)
        best[x] = greater((z[a3 + x] - z0) * p3 + ((z[b3 + x] - z0) * q3 + k3), s)


@inline
def _near_block(z, width, pad, offsets, p, q, k, rows, columns, best):
    """The near field of one block of receivers."""
    a = offsets[:, 0] * width + offsets[:, 1]
    b = offsets[:, 2] * width + offsets[:, 3]
    for i in range(rows[0], rows[1]):
        out = best[i, columns[0] : columns[1]]
        out[:] = -np.inf
        here = (i + pad[0]) * width + columns[0] + pad[1]
        for s in range(0, len(p), 4):
            four_crossings(z, a, b, here, out, p, q, k, s)


def _tasks(*given: Any) -> int:
    corner, _, rows, columns, _ = given[-5:]
    across = (columns[1] - columns[0] + BLOCK - 1) // BLOCK
    return int(across * (-(-(rows[1] + corner[0]) // SIDE) - (rows[0] + corner[0]) // SIDE))


@shared_kernel(_tasks)
def near_field(
    start, stop, z, pad, offsets, p, q, k, low, high, corner, skipped, rows, columns, best
):
    """Fill `best` with the slope of the near horizon.

    Parameters
    ----------
    z : (pad[0] + n, pad[1] + m + RIGHT) float32
        Heights in the sweep frame, padded with NaN on the sides that rays run to; no shift is
        longer than the padding.
    pad : (int, int)
        Rows and columns of padding.
    offsets : (S, 4) int64
        Row and column shifts of the two cells between which a crossing lies; S a multiple of 4.
    p, q, k : (S,) float32
        The crossing's slope is ``p·(z1 - z0) + q·(z2 - z0) + k``.
    low, high, corner
        Blocks of ground, see `adret._kernels.ground`.
    skipped : (2, n) int64
        Receivers left out, added to the row that is the first of theirs: nodata, level ground.
    rows, columns : (2,) int64
        Receivers to fill, start and stop.
    best : (n, m) float32
        Output; -inf where no crossing exists.
    """
    flat = z.reshape(z.size)
    across = (columns[1] - columns[0] + BLOCK - 1) // BLOCK
    reach = (0, 0)
    level = np.float32(-np.inf)
    for s in range(len(p)):
        reach = (
            max(reach[0], -offsets[s, 0], -offsets[s, 2]),
            max(reach[1], -offsets[s, 1], -offsets[s, 3]),
        )
        level = greater(k[s] + np.float32(0.0), level)
    for task in range(start, stop):
        block = (rows[0] + corner[0]) // SIDE + task // across
        down = max(block * SIDE - corner[0], rows[0]), min((block + 1) * SIDE - corner[0], rows[1])
        left = columns[0] + task % across * BLOCK
        right = min(left + BLOCK, columns[1])
        while left < right:
            # Ordinary blocks are served together: long loops are quicker.
            end = left
            kind = ORDINARY
            while end < right and kind == ORDINARY:
                begin = end
                kind = kind_of_block(low, high, corner, down[0], begin, reach)
                end = min(((begin + corner[1]) // SIDE + 1) * SIDE - corner[1], right)
            ordinary = right if kind == ORDINARY else begin
            if ordinary > left:
                across_them = (left, ordinary)
                _near_block(flat, z.shape[1], pad, offsets, p, q, k, down, across_them, best)
            if kind != ORDINARY:
                best[down[0] : down[1], begin:end] = -np.inf if kind == EMPTY else level
                skipped[kind - 1, down[0]] += (down[1] - down[0]) * (end - begin)
            left = end


def _rows(*given: Any) -> int:
    rows, _, _, _ = given[-4:]
    return int(rows[1] - rows[0])


@shared_kernel(_rows)
def near_field_distance(
    start, stop, z, pad, offsets, p, q, k, reach, rows, columns, best, distance
):
    """As `near_field`, and fill `distance` with the `reach` of the crossing that is the horizon.

    NaN where no crossing exists. Of two crossings of equal slope the nearer one counts.
    """
    for i in range(rows[0] + start, rows[0] + stop):
        r = i + pad[0]
        for c in range(columns[0], columns[1]):
            x = c + pad[1]
            top = np.float32(-np.inf)
            way = np.float32(np.nan)
            for s in range(len(p)):
                slope = (
                    (z[r + offsets[s, 0], x + offsets[s, 1]] - z[r, x]) * p[s]
                    + (z[r + offsets[s, 2], x + offsets[s, 3]] - z[r, x]) * q[s]
                    + k[s]
                )
                if slope > top or (slope == top and reach[s] < way):
                    top = slope
                    way = reach[s]
            best[i, c] = top
            distance[i, c] = way
