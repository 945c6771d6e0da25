"""The last point of each cell's own ray inside the raster, exactly.

Where the ground rises to the raster's edge, the horizon is the point at which the cell's own ray
leaves. The far field's lines leave it a little sooner or later, so that this point is theirs only
by chance. Arrays are in the sweep frame: rays leave through row 0 or column 0.
"""

import math

import numpy as np

from adret._kernels.jit import greater, kernel, parallel_kernel, prange

SNAP = 1e-9


@kernel
def _through_row(left, right, receiver, best, weight, steps, limits):
    observer, per_step, drop, _, _ = limits
    for x in range(len(best)):
        height = right[x] * (np.float32(1.0) - weight) + left[x] * weight
        slope = (height - receiver[x] - observer) * per_step / steps - drop * steps
        best[x] = greater(slope, best[x])


@parallel_kernel
def raise_by_edge(z, pad, t, near, edge, limits, rows, columns, best, distance):
    """Raise `best` by the crossing at which each cell's ray leaves, beyond the near field.

    Parameters are those of `hull_sweep`; `edge` is column 0 without its padding, contiguous.
    """
    observer, per_step, drop, _, reach = limits
    for i in prange(rows[0], rows[1]):
        position = t * i
        base = math.floor(position + SNAP)
        weight = position - base
        weight = np.float32(weight if weight >= SNAP else 0.0)
        first = max(columns[0], min(columns[1], base + (1 if weight > 0.0 else 0)))
        steps = np.float32(i)
        if near < steps <= reach and first < columns[1]:
            lo = pad + first - base
            hi = pad + columns[1] - base
            shift = 1 if weight > 0.0 else 0
            out = best[i, first : columns[1]]
            before = out.copy() if distance.shape[0] > 0 else out
            _through_row(
                z[pad, lo - shift : hi - shift],
                z[pad, lo:hi],
                z[i + pad, pad + first : pad + columns[1]],
                out,
                weight,
                steps,
                limits,
            )
            if distance.shape[0] > 0:
                for x in range(len(out)):
                    if out[x] > before[x]:
                        distance[i, first + x] = steps / per_step
        if t == 0.0:
            continue
        for c in range(columns[0], first):
            way = c / t
            if way <= near or way > reach:
                continue
            at = i - way
            row = math.floor(at + SNAP)
            part = at - row
            height = edge[row]
            if part >= SNAP:
                part = np.float32(part)
                height = height * (np.float32(1.0) - part) + edge[row + 1] * part
            way = np.float32(way)
            slope = (height - z[i + pad, c + pad] - observer) * per_step / way - drop * way
            if slope > best[i, c]:
                best[i, c] = slope
                if distance.shape[0] > 0:
                    distance[i, c] = way / per_step
