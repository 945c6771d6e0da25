"""The last point of each cell's own ray inside the raster, exactly.

Where the ground rises to the raster's edge, the horizon is the point at which the cell's own ray
leaves. The far field's lines leave it a little sooner or later, so that this point is theirs only
by chance. Arrays are in the sweep frame: rays leave through row 0 or column 0.
"""

import math
from typing import Any

import numpy as np

from adret._kernels.jit import greater, index, inline, shared_kernel

SNAP = 1e-9
NOTHING = np.float32(-np.inf)
ZERO = np.float32(0.0)
MILLIONTH = np.float32(1e-6)
BLOCK = 64  # receivers that are tested together


@inline
def _through_row(left, right, receiver, out, weight, steps, limits):
    """Raise `out` by slopes to row 0, `steps` away: one shift and weight for a row's receivers."""
    observer, per_step, drop, _, _ = limits
    for x in range(len(out)):
        height = right[x] * (np.float32(1.0) - weight) + left[x] * weight
        slope = (height - receiver[x] - observer) * per_step / steps - drop * steps
        out[x] = greater(greater(slope, out[x]), NOTHING)


@inline
def _through_column(edge, receiver, out, i, first, per_column, limits):
    """Raise `out` by slopes to column 0, c / t steps away from column c."""
    observer, per_step, drop, _, _ = limits
    for x in range(len(out)):
        steps = (first + x) * per_column
        at = i - steps
        row = np.int64(at + SNAP)
        part = at - row
        height = edge[index(row)]
        other = edge[index(row + 1)]
        # On a vertex the other one must not matter, even where it is NaN.
        part = part if part >= SNAP else 0.0
        other = other if part > 0.0 else height
        part = np.float32(part)
        height = height * (np.float32(1.0) - part) + other * part
        way = np.float32(steps)
        slope = (height - receiver[x] - observer) * per_step / way - drop * way
        out[x] = greater(greater(slope, out[x]), NOTHING)


@inline
def _can_rise(receiver, best, top, i, first, per_column, limits):
    """Whether some receiver's slope to a point as high as `top` in column 0 would exceed `best`."""
    observer, per_step, drop, _, _ = limits
    nearest = np.float32(first * per_column)
    farthest = np.float32((first + len(best) - 1) * per_column)
    near, far = per_step / nearest, per_step / farthest
    lower = drop * nearest
    hopes = 0
    for x in range(len(best)):
        rise = top - receiver[x] - observer
        bound = rise * (near if rise > ZERO else far) - lower
        # A millionth more than the bound: far more than rounding can take from it.
        hopes += bound + abs(bound) * MILLIONTH > best[x]
    return hopes > 0


def _rows(*arguments: Any) -> int:
    rows, *_ = arguments[-5:]
    return int(rows[1] - rows[0])


@shared_kernel(_rows)
def raise_by_edge(
    start, stop, z, pad, t, near, edge, limits, skip, rows, columns, best, distance, skipped
):
    """Raise `best` by the crossing at which each cell's ray leaves, beyond the near field.

    Parameters are those of `hull_sweep`; `edge` is column 0 without its padding, and one more
    entry, contiguous. With `skip`, blocks of receivers that even the highest point of
    column 0 could not raise are left out, and `skipped` (n,) counts their receivers.
    """
    _, per_step, _, _, reach = limits
    top = NOTHING
    for each in edge:
        top = greater(each, top)
    slope = np.empty(columns[1] - columns[0], np.float32)
    for i in range(rows[0] + start, rows[0] + stop):
        out = best[i, columns[0] : columns[1]]
        if distance is not None:  # which of them rise must be known
            slope[:] = NOTHING
            out = slope
        receiver = z[i + pad[0], pad[1] + columns[0] : pad[1] + columns[1]]
        position = t * i
        base = math.floor(position + SNAP)
        weight = position - base
        weight = np.float32(weight if weight >= SNAP else 0.0)
        shift = 1 if weight > 0.0 else 0
        # Columns from `first` on leave through row 0, those before it through column 0.
        first = max(columns[0], min(columns[1], base + shift))
        if near < i <= reach and first < columns[1]:
            lo = pad[1] + first - base
            hi = pad[1] + columns[1] - base
            ahead = first - columns[0]
            _through_row(
                z[pad[0], lo - shift : hi - shift],
                z[pad[0], lo:hi],
                receiver[ahead:],
                out[ahead:],
                weight,
                np.float32(i),
                limits,
            )
        if t > 0.0:
            lo = max(columns[0], math.floor(near * t) + 1)
            hi = min(first, math.floor(min(reach, 1e9) * t) + 1)
            for head in range(lo, hi, BLOCK):
                end = min(head + BLOCK, hi)
                part = slice(head - columns[0], end - columns[0])
                known = best[i, head:end]
                if skip and not _can_rise(receiver[part], known, top, i, head, 1.0 / t, limits):
                    skipped[i] += end - head
                else:
                    _through_column(edge, receiver[part], out[part], i, head, 1.0 / t, limits)
        if distance is not None:
            known = best[i, columns[0] : columns[1]]
            for x in range(len(known)):
                if slope[x] > known[x]:
                    c = columns[0] + x
                    way = np.float32(i) if c >= first else np.float32(c / t)
                    distance[i, c] = way / per_step
                known[x] = greater(slope[x], known[x])
