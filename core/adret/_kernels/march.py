"""Prior work: march along each cell's own ray to the raster's edge, one sample a major step.

O(N) a cell. It sees the ray's crossings with the grid lines across its major axis only. Vectorised
over the receivers of a row, which share offsets and weights. Arrays are in the sweep frame.
"""

import math

import numpy as np

from adret._kernels.jit import inline, kernel, parallel_kernel, prange
from adret._kernels.near_field import four_crossings

SNAP = 1e-9


@inline
def _offset(shear, j):
    position = shear * j
    cell = math.floor(position + SNAP)
    weight = position - cell
    return cell, np.float32(weight if weight >= SNAP else 0.0)


@kernel
def _one_step(line, column, cell, p, q, k, z):
    """Slope of one sample; NaN outside the raster or beside nodata."""
    left = column - cell - (1 if q > 0.0 else 0)
    if left < 0:
        return np.float32(np.nan)
    return (line[column - cell] - z) * p + (line[left] - z) * q + k


@parallel_kernel
def march(z, pad, width, shear, step, count, bend, observer, rows, columns, best):
    """Fill `best` with the slope of the highest of `count` samples along each cell's ray."""
    flat = z.reshape(z.size)
    for i in prange(rows[0], rows[1]):
        p = np.empty(4, np.float32)
        q = np.empty(4, np.float32)
        k = np.empty(4, np.float32)
        cells = np.empty(4, np.int64)
        right = np.empty(4, np.int64)
        left = np.empty(4, np.int64)
        out = best[i, columns[0] : columns[1]]
        out[:] = -np.inf
        receiver = z[i + pad[0], pad[1] : pad[1] + width]
        steps = min(i, count)
        for j0 in range(1, steps + 1, 4):
            for u in range(4):
                j = min(j0 + u, steps)
                cell, weight = _offset(shear, j)
                way = j * step
                cells[u] = cell
                p[u] = (1.0 - weight) / way
                q[u] = weight / way
                k[u] = -observer / way - bend * way
            lo = min(columns[1], max(columns[0], cells[3] + 1))
            for u in range(4):
                j = min(j0 + u, steps)
                line = z[i + pad[0] - j, pad[1] : pad[1] + width]
                for c in range(max(columns[0], cells[u]), lo):
                    slope = _one_step(line, c, cells[u], p[u], q[u], k[u], receiver[c])
                    if slope > out[c - columns[0]]:
                        out[c - columns[0]] = slope
                # With weight 0 the left-hand cell must not matter, even where it is NaN.
                right[u] = -j * z.shape[1] - cells[u]
                left[u] = right[u] - (1 if q[u] > 0.0 else 0)
            if lo < columns[1]:
                here = (i + pad[0]) * z.shape[1] + pad[1] + lo
                four_crossings(flat, right, left, here, out[lo - columns[0] :], p, q, k, 0)
