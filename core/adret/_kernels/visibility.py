"""Visibility along all lines of an azimuth, by the convex-hull tree or by the naive walk."""

import numpy as np

from adret._kernels.hull_tree import list_by_tree
from adret._kernels.jit import kernel, parallel_kernel, prange
from adret._kernels.sight_lines import (
    STRIP,
    add_strip,
    first_line,
    place_lists,
    sample_strip,
    strip_count,
    strip_rows,
)
from adret._kernels.sight_runs import (
    BLOCK,
    copy_lists,
    count_horizons,
    cut_at_reach,
    farthest,
    sum_runs,
)
from adret._kernels.visible_walk import count_by_walk, list_by_walk

HORIZONS = 0
SEEN = 1
MOMENT = 2
WAY = 3
SLOPE = 4
LISTS = 5
CHUNKS = 32  # strips are dealt out to so many tasks, each with one set of buffers


@kernel
def _reduce(quantity, place, end, eye, h, s, found, bounds, value, start, lists):
    if quantity == SEEN:
        sum_runs(place, end, eye, False, h, s, found, bounds, value)
    elif quantity == MOMENT:
        sum_runs(place, end, eye, True, h, s, found, bounds, value)
    elif quantity == WAY:
        farthest(place, end, eye, False, h, s, found, bounds, value)
    elif quantity == SLOPE:
        farthest(place, end, eye, True, h, s, found, bounds, value)
    elif quantity == LISTS:
        copy_lists(place, end, found, bounds, start, lists)
    else:
        count_horizons(place, end, bounds, value)


@kernel
def _stride(samples):
    """Length of a strip's lines in memory: the samples, the empty place before them and one after,
    and an odd number of cache lines.

    Lines a power of two apart would all fall into the same few sets of the first-level cache.
    """
    return ((samples + 2 + BLOCK) // 16 + 1 | 1) * 16


@parallel_kernel
def sight_layer(
    tree, quantity, z, left, weight, cell, bend, quanta, eye, reach, rows, columns, scale, out,
    offsets, lists, work,
):  # fmt: skip
    """Add scale·quantity of every cell to `out`, or write its local horizons to `lists`.

    Parameters
    ----------
    tree : bool
        The convex-hull tree, else the naive walk.
    quantity : int
        HORIZONS: number of local horizons; SEEN: of samples seen; MOMENT: sum of their distances
        [steps]; WAY: to the farthest one [steps]; SLOPE: of the line of sight to it [quanta a
        step], -inf without one; LISTS: distances of the local horizons, near to far [steps].
    z : (n, m + 2) float32
        Heights in the sweep frame, a column of NaN on either side.
    left, weight, cell : (n,) int64, float64, int64
        Where lines pass each row: see `sight_lines`.
    bend, quanta, eye, reach : float
        Curvature's drop a step squared [m], quanta a metre, height of the eye [quanta], range
        [steps].
    rows, columns : (2,) int64
        Receivers to serve, start and stop.
    out : (n, m) float32
    offsets, lists : (n, m) int64, (total,) int32
        Where each cell's list starts; empty unless LISTS.
    work : (CHUNKS, 2) int64
        Raised by the convexity checks, and by the children of all roots.
    """
    strips = strip_count(cell, rows, columns)
    for chunk in prange(CHUNKS):
        length = _stride(rows[1])
        heights = np.full((STRIP, length), np.nan)
        values = np.zeros((STRIP, length), np.float32)
        start = np.zeros((STRIP if quantity == LISTS else 1, length), np.int64)
        s = np.arange(length).astype(np.float64)
        child = np.empty(length, np.int32)
        sibling = np.empty(length, np.int32)
        leaf = np.empty(length, np.uint8)
        kids = np.empty(length, np.int32)
        stack = np.empty(length, np.int32)
        later = np.empty(length, np.int32)
        found = np.empty(max(8192, 2 * length), np.int32)
        bounds = np.empty(length + 1, np.int64)
        state = np.zeros(4, np.int64)
        zone = np.zeros(4)
        for strip in range(chunk, strips, CHUNKS):
            first = first_line(cell, strip, rows, columns)
            begin, end = strip_rows(cell, first, rows[1], z.shape[1] - 2)
            sample_strip(z, left, weight, cell, first, begin, end, bend, quanta, heights)
            if quantity == LISTS:
                place_lists(cell, first, begin, end, rows, columns, offsets, start)
            count = end - begin
            for line in range(STRIP):
                h = heights[line]
                value = values[line]
                if not tree and quantity == SEEN:
                    count_by_walk(count, eye, reach, h, s, value)
                    continue
                place = 1
                while place <= count:
                    if tree:
                        after = list_by_tree(
                            place, count, eye, h, s, child, sibling, leaf, kids,
                            stack, later, state, zone, found, bounds, work[chunk],
                        )  # fmt: skip
                        if reach < count:
                            cut_at_reach(place, after, eye, reach, h, s, found, bounds)
                    else:
                        after = list_by_walk(place, count, eye, reach, h, s, found, bounds)
                    _reduce(
                        quantity, place, after, eye, h, s, found, bounds, value,
                        start[line if quantity == LISTS else 0], lists,
                    )  # fmt: skip
                    place = after
            if quantity != LISTS:
                add_strip(cell, first, begin, end, rows, columns, scale, values, out)
