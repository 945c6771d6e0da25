"""Visibility along all lines of an azimuth, by the convex-hull tree or by the naive walk."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
    take_near_field,
)
from adret._kernels.sight_rays import LISTS, MOMENT, SEEN, SLOPE, WAY
from adret._kernels.sight_runs import (
    BLOCK,
    copy_lists,
    count_horizons,
    cut_at_reach,
    cut_at_wall,
    farthest,
    sum_runs,
)
from adret._kernels.visible_walk import count_by_walk, list_by_walk

CHUNKS = 32  # strips are dealt out to so many tasks, each with one set of buffers
COUNTERS = 3  # of each: convexity checks, children of all roots, roots that took the place of one


class Lines(NamedTuple):
    """Where lines pass each row (see `sight_lines`), and in which units."""

    left: NDArray[np.int64]  # (n,)
    weight: NDArray[np.float64]  # (n,)
    cell: NDArray[np.int64]  # (n,)
    bend: float  # drop by curvature a step squared [m]
    quanta: float  # a metre
    eye: float  # height of the eye [quanta]
    reach: float  # range [steps]


class NearField(NamedTuple):
    """What is known of the steps before `gap`; all empty, and gap 0, where there is no near field.

    See `adret._kernels.sight_rays.see_along_rays`.
    """

    gap: int
    rise: float  # quanta a step for a slope of 1
    best: NDArray[np.float32]  # (n, m)
    value: NDArray[np.float32]  # (n, m)
    open_run: NDArray[np.bool_]  # (n, m)


@kernel
def _reduce(
    quantity, place, end, gap, eye, eyes, wall, open_run, h, s, found, bounds, value, start, lists
):
    if quantity == SEEN:
        sum_runs(place, end, gap, eye, eyes, wall, False, h, s, found, bounds, value)
    elif quantity == MOMENT:
        sum_runs(place, end, gap, eye, eyes, wall, True, h, s, found, bounds, value)
    elif quantity == WAY:
        farthest(place, end, gap, eye, eyes, False, h, s, found, bounds, value)
    elif quantity == SLOPE:
        farthest(place, end, gap, eye, eyes, True, h, s, found, bounds, value)
    elif quantity == LISTS:
        copy_lists(place, end, gap, eyes, wall, open_run, h, found, bounds, start, lists)
    else:
        count_horizons(place, end, gap, eyes, wall, open_run, h, bounds, value)


@kernel
def _stride(samples):
    """Length of a strip's lines in memory: the samples, the empty place before them and one after,
    and an odd number of cache lines.

    Lines a power of two apart would all fall into the same few sets of the first-level cache.
    """
    return ((samples + 2 + BLOCK) // 16 + 1 | 1) * 16


@kernel
def _serve(
    chunk, tree, quantity, z, lines, near_field, rows, columns, scale, out, offsets, lists, work
):
    """Every CHUNKS-th strip of `sight_layer`, from `chunk` on; `work` is the chunk's."""
    left, weight, cell, bend, quanta, eye, reach = lines
    gap = near_field.gap
    strips = strip_count(cell, rows, columns)
    length = _stride(rows[1])
    heights = np.full((STRIP, length), np.nan)
    values = np.zeros((STRIP, length), np.float32)
    start = np.zeros((STRIP if quantity == LISTS else 1, length), np.int64)
    eyes = np.empty((STRIP if gap > 0 else 1, length))
    walls = np.empty((STRIP if gap > 0 else 1, length))
    open_runs = np.zeros((STRIP if gap > 0 else 1, length), np.bool_)
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
        values[:] = -np.inf if quantity == SLOPE else 0.0
        if gap > 0:
            take_near_field(
                cell, first, begin, end, rows, columns, bend, quanta, eye, near_field.rise,
                z, near_field.best, near_field.value, near_field.open_run, eyes, walls,
                values, open_runs,
            )  # fmt: skip
            if quantity == SLOPE:
                for line in range(STRIP):
                    for p in range(length):
                        values[line, p] = walls[line, p]
        if quantity == LISTS:
            place_lists(cell, first, begin, end, rows, columns, offsets, start)
        count = end - begin
        for line in range(STRIP):
            h = heights[line]
            value = values[line]
            near = line if gap > 0 else 0
            if not tree and quantity == SEEN and gap == 0:
                count_by_walk(count, eye, reach, h, s, value)
                continue
            place = 1
            while place <= count:
                if tree:
                    after = list_by_tree(
                        place, count, gap, eye, eyes[near], h, s, child, sibling, leaf, kids,
                        stack, later, state, zone, found, bounds, work,
                    )  # fmt: skip
                    if reach < count:
                        cut_at_reach(place, after, gap, eye, eyes[near], reach, h, s, found, bounds)
                    if gap > 0:
                        cut_at_wall(place, after, eyes[near], walls[near], h, s, found, bounds)
                else:
                    after = list_by_walk(
                        place, count, gap, eye, eyes[near], walls[near], reach, h, s, found,
                        bounds,
                    )  # fmt: skip
                _reduce(
                    quantity, place, after, gap, eye, eyes[near], walls[near],
                    open_runs[near], h, s, found, bounds, value,
                    start[line if quantity == LISTS else 0], lists,
                )  # fmt: skip
                place = after
        if quantity != LISTS:
            add_strip(cell, first, begin, end, rows, columns, scale, values, out)


@parallel_kernel
def sight_layer(
    tree, quantity, z, lines, near_field, rows, columns, scale, out, offsets, lists, work
):
    """Add scale·quantity of every cell to `out`, or write its local horizons to `lists`.

    Parameters
    ----------
    tree : bool
        The convex-hull tree, else the naive walk.
    quantity : int
        HORIZONS: number of local horizons; SEEN: of samples seen; MOMENT: sum of their distances
        [steps]; WAY: to the farthest one [steps]; SLOPE: of the line of sight to it [quanta a
        step], -inf without one; LISTS: distances of the local horizons, near to far [steps].
        Those of the near field are counted in.
    z : (n, m + 2) float32
        Heights in the sweep frame, a column of NaN on either side.
    lines, near_field
        `Lines`, `NearField`.
    rows, columns : (2,) int64
        Receivers to serve, start and stop.
    out : (n, m) float32
    offsets, lists : (n, m) int64, (total,) int32
        Where each cell's list starts, or goes on; empty unless LISTS.
    work : (CHUNKS, COUNTERS) int64
        Raised by the work of the tree.
    """
    for chunk in prange(CHUNKS):
        _serve(
            chunk, tree, quantity, z, lines, near_field, rows, columns, scale, out, offsets, lists,
            work[chunk],
        )  # fmt: skip
