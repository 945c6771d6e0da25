"""Near field: every crossing of a cell's own ray with the grid, as a maximum over constant shifts.

For one azimuth the crossings' offsets and interpolation weights are the same for every cell, so the
horizon of the near field is a maximum over shifted, weighted copies of the array. The array is in
the sweep frame (see `adret.sweep`): the ray runs towards smaller rows and columns, and NaN padding
on those sides stands for "outside the raster". NaN never wins a maximum.
"""

import numpy as np

from adret._kernels.jit import greater, kernel, parallel_kernel, prange

BLOCK = 1024  # columns whose accumulator and rows stay in the first-level cache


@kernel
def four_crossings(a0, b0, a1, b1, a2, b2, a3, b3, receiver, best, p, q, v, k):
    """Raise `best` by four crossings; four at a time saves loads and keeps the store plain."""
    p0, p1, p2, p3 = p[0], p[1], p[2], p[3]
    q0, q1, q2, q3 = q[0], q[1], q[2], q[3]
    v0, v1, v2, v3 = v[0], v[1], v[2], v[3]
    k0, k1, k2, k3 = k[0], k[1], k[2], k[3]
    for x in range(len(best)):
        z = receiver[x]
        s = greater(a0[x] * p0 + b0[x] * q0 - z * v0 + k0, best[x])
        s = greater(a1[x] * p1 + b1[x] * q1 - z * v1 + k1, s)
        s = greater(a2[x] * p2 + b2[x] * q2 - z * v2 + k2, s)
        best[x] = greater(a3[x] * p3 + b3[x] * q3 - z * v3 + k3, s)


@parallel_kernel
def near_field(z, pad, offsets, p, q, v, k, rows, columns, best):
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
    p, q, v, k : (S,) float32
        The crossing's slope is ``p·z1 + q·z2 - v·z0 + k``.
    rows, columns : (2,) int64
        Receivers to fill, start and stop.
    best : (n, m) float32
        Output; -inf where no crossing exists.
    """
    for i in prange(rows[0], rows[1]):
        r = i + pad[0]
        for start in range(columns[0], columns[1], BLOCK):
            stop = min(columns[1], start + BLOCK)
            out = best[i, start:stop]
            out[:] = -np.inf
            lo = start + pad[1]
            hi = stop + pad[1]
            for s in range(0, len(v), 4):
                o = offsets[s : s + 4]
                four_crossings(
                    z[r + o[0, 0], lo + o[0, 1] : hi + o[0, 1]],
                    z[r + o[0, 2], lo + o[0, 3] : hi + o[0, 3]],
                    z[r + o[1, 0], lo + o[1, 1] : hi + o[1, 1]],
                    z[r + o[1, 2], lo + o[1, 3] : hi + o[1, 3]],
                    z[r + o[2, 0], lo + o[2, 1] : hi + o[2, 1]],
                    z[r + o[2, 2], lo + o[2, 3] : hi + o[2, 3]],
                    z[r + o[3, 0], lo + o[3, 1] : hi + o[3, 1]],
                    z[r + o[3, 2], lo + o[3, 3] : hi + o[3, 3]],
                    z[r, lo:hi],
                    out,
                    p[s : s + 4],
                    q[s : s + 4],
                    v[s : s + 4],
                    k[s : s + 4],
                )


@parallel_kernel
def near_field_distance(z, pad, offsets, p, q, v, k, reach, rows, columns, best, distance):
    """As `near_field`, and fill `distance` with the `reach` of the crossing that is the horizon.

    NaN where no crossing exists. Of two crossings of equal slope the nearer one counts.
    """
    for i in prange(rows[0], rows[1]):
        r = i + pad[0]
        for c in range(columns[0], columns[1]):
            x = c + pad[1]
            top = np.float32(-np.inf)
            way = np.float32(np.nan)
            for s in range(len(v)):
                slope = (
                    z[r + offsets[s, 0], x + offsets[s, 1]] * p[s]
                    + z[r + offsets[s, 2], x + offsets[s, 3]] * q[s]
                    - z[r, x] * v[s]
                    + k[s]
                )
                if slope > top or (slope == top and reach[s] < way):
                    top = slope
                    way = reach[s]
            best[i, c] = top
            distance[i, c] = way
