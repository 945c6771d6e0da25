"""Far-field obscurance of every receiver in one direction of the image, with its near field (P4).

Each receiver meets the intervals of its lines outwards: single ones at first, then twice as long
ones wherever those of the pyramid begin.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adret._kernels.jit import inline, kernel, parallel_kernel, prange
from adret._kernels.screen.far_field_block import (
    CLOSED,
    LANES,
    SIZE,
    START,
    TOP,
    ZERO,
    aim,
    finish,
    leave,
    load,
    thin,
)
from adret._kernels.screen.far_field_mipmaps import mipmap_points, ways_of
from adret._kernels.screen.far_field_points import (
    add_points,
    line_points,
    near_samples,
    sector_means,
)
from adret._kernels.screen.far_field_slabs import add_plain, add_weighted

SECTORS = 0
LINES = 1
MIPMAPS = 2
MOST = 128
"""Intervals that a receiver can meet: at most two of each level but the last."""


class View(NamedTuple):
    """The image in the frame of a direction.

    Attributes
    ----------
    near : ndarray, (rows, columns), float32
        Nearness; NaN where there is no surface.
    normal : ndarray, (3, rows, columns), float32
        Along the rows' axis, along the columns' axis, back.
    rays : ndarray, (4,), float64
        Of rows and columns; see `load`.
    perspective : bool
    jitter : ndarray, (rows, columns), float32
        Share of a sector's width by which lines are shifted, -1/2 to 1/2; used by `LINES`.
    """

    near: NDArray[np.float32]
    normal: NDArray[np.float32]
    rays: NDArray[np.float64]
    perspective: bool
    jitter: NDArray[np.float32]


@inline
def begin(row, sign, size):
    """First interval in front of a receiver that is at least `size` rows away throughout."""
    return row // size + 2 if sign > 0 else (row + 1) // size - 2


@kernel
def walk(row, sign, size, rows, levels, starts, plan):
    """Fill `plan` with the intervals in front of a receiver: array row, first and last row + 1."""
    n = begin(row, sign, size)
    intervals = (rows + size - 1) // size
    level = 0
    found = 0
    while 0 <= n < intervals:
        span = 1 << level
        low = n if sign > 0 else n - span + 1
        plan[found, 0] = starts[level] + (n >> level)
        plan[found, 1] = low * size
        plan[found, 2] = min(rows, (low + span) * size)
        found += 1
        n += sign * span
        edge = n if sign > 0 else n + 1
        if edge % (2 * span) == 0 and level < levels - 1:
            level += 1
    return found


@kernel
def add_intervals(
    w,
    f,
    g,
    plan,
    found,
    lines,
    view,
    row,
    sign,
    low_slope,
    high_slope,
    first,
    step,
    count,
    kind,
    thickness,
    lean,
    weights,
):
    """Raise the horizon by the intervals of a sector, or of a line in its middle."""
    own = -row * lines.slope - lines.first
    middle = 0.5 * (low_slope + high_slope)
    for k in range(found):
        interval, low, high = plan[k]
        if lines.spans[interval, 1] == 0:
            continue
        ahead = 0.5 * (low + high - 1) - row
        if kind == SECTORS:
            a = own + 0.5 + ahead * (low_slope - lines.slope)
            b = own + 0.5 + ahead * (high_slope - lines.slope)
            start, stop = sector_means(
                w,
                f,
                g,
                lines,
                interval,
                min(a, b),
                max(a, b),
                first,
                step,
                count,
                (low - row) * sign,
                sign,
                ahead * sign,
                sign * (middle - lines.slope),
            )
            if weights.plain:
                add_plain(w[start:], stop - start, True)
            else:
                near = low - row if sign > 0 else row - high + 1
                at = np.float32(near - 0.5)
                add_weighted(w[start:], stop - start, at, lean, view.perspective, weights, True)
        else:
            to = own + ahead * (middle - lines.slope)
            spread = ahead * (high_slope - low_slope)
            line_points(w, lines, interval, to, spread, view.jitter[row], first, step, count)
            start = low - row if sign > 0 else row - high + 1
            add_points(
                w,
                count,
                row,
                sign,
                start - 0.5,
                ahead * sign,
                sign * (middle - lines.slope),
                thickness,
                lean,
                view.perspective,
                weights,
            )


@kernel
def add_mipmaps(
    w, mipmaps, ways, found, view, row, sign, slope, wedge, first, step, count, lean, weights
):
    """Raise the horizon by samples of the mipmaps, ever farther apart."""
    for k in range(1, found):
        mipmap_points(
            w,
            mipmaps,
            view.near.shape,
            row,
            sign,
            ways[k - 1],
            ways[k],
            slope,
            wedge,
            first,
            step,
            count,
        )
        start = 0.5 * (ways[k - 1] + ways[k])
        add_points(w, count, row, sign, start, 0.0, 0.0, np.inf, lean, view.perspective, weights)


@kernel
def shows_nothing(near, first, step, count):
    """Whether none of `count` receivers, `step` apart, shows a surface."""
    for i in range(count):
        at = near[first + step * i]
        if at == at:
            return False
    return True


@kernel
def all_small(small, first, step, count):
    """Whether all of `count` receivers, `step` apart, are marked."""
    found = 0
    for i in range(count):
        found += small[first + step * i]
    return found == count


@parallel_kernel
def obscurance(
    view,
    lines,
    mipmaps,
    weights,
    frame,
    sign,
    slopes,
    wedges,
    kind,
    near_field,
    thickness,
    lean,
    third,
    per_radius,
    closed_near,
    whole_near,
    closed,
    whole,
    unknown,
    skip,
    skipped,
    small,
    unmet,
):
    """Add the obscurance of a direction's sectors to the arrays, all (rows, columns) float32.

    Parameters
    ----------
    view, lines, mipmaps, weights : View, Lines, Mipmaps, Weights
    frame : (4,) int64
        row0, row1, column0, column1 of the receivers.
    sign : int
        1: the direction looks down the rows; -1: up.
    slopes : (sectors + 1,) float64
        Columns a row of the sectors' borders.
    wedges : (sectors,) float64
        Their angles in the plane of view rays (x, y, -1).
    kind : int
        `SECTORS`, `LINES` or `MIPMAPS`.
    near_field : bool
        Whether what comes before the first interval counts.
    thickness : float
        Of the solid behind the surface, in depth.
    lean : float
        See `set_slab`.
    third : int
        -1: all receivers see the far field, and `closed` and `whole` get all. Else only those of
        row % 3 = third // 3 and column % 3 = third % 3; the near field of all is in `closed_near`.
    per_radius : float
        One over the radius.
    closed_near, whole_near, closed, whole, unknown : (rows, columns) float32
        Sums to add to: obscurance and what it could be; open directions that leave the image.
    skip : bool
        Whether blocks of receivers that show no surface are passed over.
    skipped : (rows,) int64
        Raised by the receivers that were.
    small : (rows, columns) bool
        Receivers whose radius is less than a pixel and ends inside the image: blocks of them meet
        no interval, as none could weigh anything; all false to meet all.
    unmet : (rows,) int64
        Raised by the receivers, once a sector, that did not.
    """
    rows, columns = view.near.shape
    row0, row1, column0, column1 = frame
    am, _, an, _ = view.rays
    plain = weights.plain
    reach = np.float32(per_radius)
    slant = np.float32(lean)
    level = np.float32(1.0 if lean > 0.0 else 0.0)
    for row in prange(row0, row1):
        mine = third < 0 or row % 3 == third // 3
        if not near_field and not mine:
            continue
        apart = 1 if third < 0 or near_field else 3
        begin_at = column0 if apart == 1 else column0 + (third - column0) % 3
        w = np.zeros(SIZE, dtype=np.float32)
        thinned = np.zeros(SIZE if third >= 0 and near_field else 0, dtype=np.float32)
        f = np.empty((2, LANES))
        g = np.empty((8, LANES), dtype=np.int32)
        plan = np.empty((MOST, 3), dtype=np.int64)
        ways = np.empty(MOST)
        n = begin(row, sign, lines.size) * lines.size
        last = n - row - 1 if sign > 0 else row - n - lines.size
        if kind == MIPMAPS:
            last = lines.size + lines.size // 2
            found = ways_of(last, rows + columns, ways)
        else:
            found = walk(row, sign, lines.size, rows, len(lines.starts), lines.starts, plan)
        for first in range(begin_at, column1, apart * LANES):
            count = min(LANES, (column1 - first + apart - 1) // apart)
            if skip and shows_nothing(view.near[row], first, apart, count):
                skipped[row] += count
                continue
            major = load(
                w,
                view.near,
                view.normal,
                view.rays,
                view.perspective,
                level,
                row,
                first,
                apart,
                count,
            )
            for s in range(len(wedges)):
                slope = 0.5 * (slopes[s] + slopes[s + 1])
                da = am * sign
                db = an * sign * slope
                side = np.sqrt(da * da + db * db)
                aim(
                    w,
                    count,
                    major,
                    np.float32(da / side),
                    np.float32(db / side),
                    np.float32(side),
                    np.float32(wedges[s]),
                )
                if near_field:
                    near_samples(
                        w, count, view, row, first, sign, slope, last, thickness, slant, weights
                    )
                block, start, step, number = w, first, apart, count
                if third >= 0 and near_field:
                    finish(w, count, plain, 1, closed_near[row, first:], whole_near[row, first:])
                    if not mine:
                        continue
                    lead = (third - first) % 3
                    block, start, step = thinned, first + lead, 3
                    number = thin(w, thinned, lead, count)
                    for i in range(number):
                        thinned[START + i] = thinned[TOP + i]
                        thinned[CLOSED + i] = ZERO
                if all_small(small[row], start, step, number):
                    unmet[row] += number
                elif kind == MIPMAPS:
                    add_mipmaps(
                        block,
                        mipmaps,
                        ways,
                        found,
                        view,
                        row,
                        sign,
                        slope,
                        wedges[s],
                        start,
                        step,
                        number,
                        slant,
                        weights,
                    )
                else:
                    add_intervals(
                        block,
                        f,
                        g,
                        plan,
                        found,
                        lines,
                        view,
                        row,
                        sign,
                        slopes[s],
                        slopes[s + 1],
                        start,
                        step,
                        number,
                        kind,
                        thickness,
                        slant,
                        weights,
                    )
                finish(block, number, plain, step, closed[row, start:], whole[row, start:])
                leave(
                    block,
                    number,
                    step,
                    start,
                    rows - 1 - row if sign > 0 else row,
                    sign * slope,
                    columns,
                    reach,
                    unknown[row, start:],
                )
