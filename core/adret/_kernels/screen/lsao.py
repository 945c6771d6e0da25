"""Line-sweep ambient obscurance: the hulls of parallel lines (P3).

After Timonen, "Line-Sweep Ambient Obscurance", 2013 (paper P3), section 4 and algorithm 1, with
these changes:

- Points are in the plane that the eye and the line span, not projected along the viewing axis.
- The lines of a strip advance together. The first two tests of whether to pop are made for all of
  them at once, without branches; further pops, which are rare, one by one.
- Obscurances are compared as fractions, and slopes by the sign of a cross product: a division is
  left for the result alone. Places are float64, differences of two places float32.

A line passes sampled rows of the frame (the depth image, or its transpose) in order; at sample i it
is at column ``start + shift[i] + blend[i]``, where ``blend`` is 0 if lines pass pixel centres.
"""

import math
from typing import Any

import numpy as np

from adret._kernels.jit import kernel, shared_kernel
from adret._kernels.screen.falloffs import in_singles
from adret._kernels.screen.lsao_hulls import (
    BOTTOM,
    FIRST,
    SIGHTS,
    VERDICTS,
    begin,
    judge,
    look,
    postpone,
    push,
    settle,
    weigh_anew,
)
from adret._kernels.screen.lsao_peaks import FARTHER, KEPT, begin_blocks, keep, look_at_peaks
from adret._kernels.screen.lsao_search import GROUPS, begin_groups, keep_latest, search_latest
from adret._kernels.screen.lsao_search import KEPT as LATEST
from adret._kernels.screen.lsao_strips import (
    ACROSS,
    ALONG,
    OWN,
    PLACES,
    STRIP,
    TANGENT,
    C,
    Z,
    in_image,
    place,
    sample_between,
    sample_pixels,
    set_tangents,
    shows_nothing,
)

FIXED = 0  # tangent plane: one for all; the receiver's; one to cull, the receiver's for the result
RECEIVER = 1
MIXED = 2
PEAKS = 1  # what is looked at beside the hulls: kept high points; the latest points before those
LATEST_TOO = 2
STARTS = 9  # which argument of `sweep_lines` that is


@kernel
def _sweep_strip(
    depth,
    normal,
    swap,
    perspective,
    rows,
    shifts,
    blends,
    starts,
    geometry,
    published,
    mode,
    fixed,
    edge,
    falloff,
    table,
    skip,
    beside,
    values,
    first,
):
    """Sweep the lines of one strip, side by side; returns how many samples were passed over."""
    skipped = 0
    loose = not published
    per_row, per_column, origin, across_per_column, across, dx, dy = geometry
    plane = (dx, dy)
    w = np.full(PLACES, np.nan)
    f = np.empty(SIGHTS, np.float32)
    w[C : C + STRIP] = 1.0
    w[ACROSS : ACROSS + STRIP] = 0.0
    w[TANGENT : TANGENT + STRIP] = fixed
    for j in range(len(starts)):
        w[ALONG + j] = per_column * starts[j]
        if perspective and not published:
            p = across + across_per_column * starts[j]
            w[ACROSS + j] = p
            w[C + j] = math.sqrt(1.0 + p * p)
    bits = w.view(np.int64)
    hull = np.empty((len(rows) + BOTTOM + 1) * 2 * STRIP)
    hull[: BOTTOM * 2 * STRIP] = np.nan
    sizes = np.full(STRIP, FIRST)
    verdicts = np.zeros(VERDICTS, np.int32)
    peaks = np.full(KEPT if beside else 0, np.nan)
    times = FARTHER if beside == LATEST_TOO else 1
    latest = np.empty(LATEST if beside == LATEST_TOO else 0)
    places = np.empty(GROUPS)
    steepest = 0.0
    short = in_singles(falloff)
    for i in range(len(rows)):
        row, shift, blend = rows[i], shifts[i], blends[i]
        here = per_row * row + per_column * (shift + blend) + origin
        if beside:
            begin_blocks(i, times, peaks)
        if beside == LATEST_TOO:
            begin_groups(i, here, latest, places)
        near = shift + (blend >= 0.5)
        low, high = in_image(starts, near, depth.shape[1])
        count = high - low
        if count == 0:
            continue
        value = values[i, first + low : first + high]
        lines = starts[low:high]
        if blend == 0.0:
            sample_pixels(depth[row], lines, shift, w[Z + low :])
        else:
            sample_between(depth[row], lines, shift, blend, edge, perspective, f, w[Z + low :])
        if skip and shows_nothing(w[Z + low :], count):
            value[:] = np.nan
            skipped += count
            continue
        place(w, low, count, here, perspective)
        if mode != FIXED:
            set_tangents(normal, swap, row, lines, near, plane, w, low)
        if mode == RECEIVER:
            w[TANGENT : TANGENT + STRIP] = w[OWN : OWN + STRIP]
        look(w, f, low, count)
        if len(table) == 0:
            judge(f, low, count, short, loose, verdicts, value)
        else:
            postpone(f, low, count, verdicts)
            value[:] = np.nan
        push(bits, low, count, verdicts)
        begun = settle(w, low, count, falloff, table, loose, verdicts, hull, sizes, value)
        if beside == LATEST_TOO:
            # Of all rays so far: what they pass at more than the radius need not be looked at.
            steepest = max(steepest, abs(here + w[ALONG + low]), abs(here + w[ALONG + high - 1]))
            search_latest(
                w, f, low, count, i, here, steepest, falloff, perspective, latest, places, value
            )
            keep_latest(w, low, count, i, latest)
        if beside:
            look_at_peaks(w, f, low, count, falloff, short, table, peaks, value)
            keep(w, low, count, i, times, peaks)
        if mode == MIXED:
            weigh_anew(w, low, count, falloff, table, value)
        if begun:
            begin(normal, swap, row, lines, near, plane, w, low, sizes, value)
    return skipped


def _strips(*arguments: Any) -> int:
    starts = arguments[STARTS]
    return len(starts) * -(-starts.shape[1] // STRIP)


@shared_kernel(_strips)
def sweep_lines(
    start,
    stop,
    depth,
    normal,
    swap,
    perspective,
    samples,
    rows,
    shifts,
    blends,
    lines,
    starts,
    geometry,
    published,
    mode,
    fixed,
    edge,
    falloff,
    table,
    skip,
    beside,
    values,
    skipped,
):
    """Obscurance that the largest occluder of every line casts on each of its samples.

    Parameters
    ----------
    depth : (R, C) float32
        The frame: depths, NaN at sky and holes, transposed if `swap`.
    normal : (3, rows, columns) float32
        Of the image, never transposed.
    samples, lines : (B,) int64
        Samples of each direction's lines, and lines.
    rows, shifts : (B, most samples) int64; blends : the same, float64
        Row of each sample in the order of the sweep, and its place between columns.
    starts : (B, most lines) int64
        Column of each line where its shift is 0, ascending.
    geometry : (B, 7) float64
        Place of a pixel on the plane at depth 1: along the sweep per row, per column, and at
        (0, 0); across it per column, and at (0, 0); and the sweep's direction (right, up).
    published : bool
        Whether points are projected along the viewing axis, and hulls lose points, as published.
    mode : int
        FIXED, RECEIVER or MIXED; `fixed` is the sine of the fixed tangent plane.
    edge : float
        Difference of depth across which samples are not blended, over the depth if `perspective`.
    falloff : 5-tuple of float; table : (n,) float64
        As for `lsao_hulls.cast` and `cast_by_table`.
    skip : bool
        Whether rows of a strip that show no surface are passed over.
    beside : int
        What is looked at beside the hulls: 0 nothing, PEAKS or, for a falloff that is 1 within its
        radius, LATEST_TOO; 0 for MIXED.
    values : (B, most samples, most lines) float32
        Output; NaN at sky and holes; undefined beyond the image.
    skipped : (B, strips) int64
        Output: samples that were passed over.
    """
    strips = (starts.shape[1] + STRIP - 1) // STRIP
    for task in range(start, stop):
        b = task // strips
        first = task % strips * STRIP
        last = min(lines[b], first + STRIP)
        if last > first:
            skipped[b, task % strips] = _sweep_strip(
                depth,
                normal,
                swap,
                perspective,
                rows[b, : samples[b]],
                shifts[b],
                blends[b],
                starts[b, first:last],
                geometry[b],
                published,
                mode,
                fixed,
                edge,
                falloff,
                table,
                skip,
                beside,
                values[b],
                first,
            )
