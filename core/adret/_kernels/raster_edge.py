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
def _columns_exits(first, steps, row, part, end, per_column):
    """How columns from `first` on leave by column 0: steps, rows up, share of the row below."""
    for x in range(end - first):
        way = (first + x) * per_column
        base = math.floor(SNAP - way)
        share = -way - base
        steps[x] = np.float32(way)
        row[x] = base
        part[x] = np.float32(share if share >= SNAP else 0.0)


@inline
def _through_column(edge, receiver, out, i, steps, row, part, limits):
    """Raise `out` by slopes to column 0."""
    observer, per_step, drop, _, _ = limits
    for x in range(len(out)):
        at = np.int32(i) + row[x]
        height = edge[index(at)]
        other = edge[index(at + 1)]
        # On a vertex the other one must not matter, even where it is NaN.
        other = other if part[x] > ZERO else height
        height = height * (np.float32(1.0) - part[x]) + other * part[x]
        slope = (height - receiver[x] - observer) * per_step / steps[x] - drop * steps[x]
        out[x] = greater(greater(slope, out[x]), NOTHING)


@inline
def _highest_of_windows(edge, count):
    """Highest of `size` entries from each one on, and `size`, a power of two up to `count`."""
    top = np.empty(len(edge), np.float32)
    for x in range(len(edge)):
        top[x] = greater(edge[x], NOTHING)
    size = 1
    while 2 * size <= count:
        for x in range(len(edge) - size):
            top[x] = greater(top[x + size], top[x])
        size *= 2
    return top, size


@inline
def _can_rise(receiver, best, top, nearest, farthest, limits):
    """Whether some receiver's slope to a point as high as `top` would exceed `best`."""
    observer, per_step, drop, _, _ = limits
    near, far = per_step / nearest, per_step / farthest
    lower = drop * nearest
    hopes = np.uint32(0)
    for x in range(len(best)):
        rise = top - receiver[x] - observer
        bound = rise * (near if rise > ZERO else far) - lower
        # A millionth more than the bound: far more than rounding can take from it.
        hopes = np.uint32(hopes + np.uint32(bound + abs(bound) * MILLIONTH > best[x]))
    return hopes > np.uint32(0)


def _rows(*arguments: Any) -> int:
    rows, *_ = arguments[-5:]
    return int(rows[1] - rows[0])


@shared_kernel(_rows)
def raise_by_edge(
    start, stop, z, pad, t, near, edge, limits, skip, rows, columns, best, distance, skipped
):
    """Raise `best` by the crossing at which each cell's ray leaves, beyond the near field.

    Parameters are those of `hull_sweep`; `edge` is column 0 without its padding, and one more
    entry, contiguous. With `skip`, blocks of receivers are left out that even the highest point of
    the part of column 0 which they look at could not raise; `skipped` (n,) counts their receivers.
    """
    _, per_step, _, _, reach = limits
    begin = max(columns[0], math.floor(near * t) + 1)  # columns before it have near fields alone
    width = max(columns[1] - begin, 0) if t > 0.0 else 0
    steps = np.empty(width, np.float32)
    rise = np.empty(width, np.int32)
    part = np.empty(width, np.float32)
    top, size = edge, 1
    if width > 0:
        _columns_exits(begin, steps, rise, part, columns[1], 1.0 / t)
        top, size = _highest_of_windows(edge, math.ceil(BLOCK / t) + 2)
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
        if width > 0:
            hi = min(first, math.floor(min(reach, 1e9) * t) + 1)
            for head in range(begin, hi, BLOCK):
                end = min(head + BLOCK, hi)
                own = slice(head - columns[0], end - columns[0])
                way = slice(head - begin, end - begin)
                if skip:
                    # Rows of column 0 that the block looks at: from its last to its first exit.
                    upper = i + rise[end - 1 - begin]
                    lower = i + rise[head - begin] + 1
                    highest = NOTHING
                    for row in range(upper, lower + 1, size):
                        highest = greater(top[index(min(row, max(lower - size + 1, 0)))], highest)
                    known = best[i, head:end]
                    at_head, at_end = steps[head - begin], steps[end - 1 - begin]
                    if not _can_rise(receiver[own], known, highest, at_head, at_end, limits):
                        skipped[i] += end - head
                        continue
                _through_column(
                    edge, receiver[own], out[own], i, steps[way], rise[way], part[way], limits
                )
        if distance is not None:
            known = best[i, columns[0] : columns[1]]
            for x in range(len(known)):
                if slope[x] > known[x]:
                    c = columns[0] + x
                    way = np.float32(i) if c >= first else np.float32(c / t)
                    distance[i, c] = way / per_step
                known[x] = greater(slope[x], known[x])
