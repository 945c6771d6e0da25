"""Far field: sweep parallel lines and keep, on each, the convex hull of what was passed (P1).

After Timonen and Westerholm 2010 (paper P1, sections 4 and 5, algorithm 1), with these changes,
each measured in `benchmarks/`:

- Lines are sheared, one cell apart along the minor axis, with one sample a major step. All lines of
  a row share one interpolation weight, so that sampling and gathering vectorise over lines.
- `pool` consecutive samples of a line enter the hull as one, the highest, at its own position.
  Insertion and query are one operation, so the hull costs a `pool`-th.
- The hull hands out its tangent *vertex*, not the angle: the slope is computed from the receiver's
  own cell and height for the vertices of the two neighbouring lines, then interpolated.
- Vertices no more than `near` steps away are left to the near field, which sees the cell's own ray.

Arrays are in the sweep frame (see `adret.sweep`); positions are major steps, in float32. With
curvature the hull holds z - bend·s², under which the hull of a bent line is that of a straight one.
"""

import math
from typing import Any

import numpy as np

from adret._kernels.ground import without_empty_ends
from adret._kernels.jit import greater, helper, index, inline, shared_kernel

SNAP = 1e-9  # cells: a line this near to a vertex passes it
RIGHT = 5  # columns of NaN that a frame needs on the right
MOST_LINES = 1024  # of a strip: the more, the less weighs what is done once a row
LINES = np.uintp(MOST_LINES + 1)  # a constant: 5 to 10 % quicker than the width of the strip
TWO_LINES = np.uintp(2 * (MOST_LINES + 1))
NOTHING = np.float32(-np.inf)


@inline
def _cut(t, step):
    """Columns that lines have moved at a global step; weight of the cell to the right."""
    u = t * step
    base = math.floor(u + SNAP)
    f = u - base
    return base, np.float32(f if f >= SNAP else 0.0)


@helper
def _highest_of_four(z, at, aside, f, steps, height, position):
    """Highest of four samples of each line, the last of equals, and its position; -inf if all NaN.

    `z` is flat; the four lie between its places `at`, of the first line, and those `aside` of them.

    Four at once write plainly; one by one they would be masked stores (see `jit.greater`).
    """
    a0, a1, a2, a3 = index(at[0]), index(at[1]), index(at[2]), index(at[3])
    b0, b1 = a0 + index(aside[0]), a1 + index(aside[1])
    b2, b3 = a2 + index(aside[2]), a3 + index(aside[3])
    for place in range(len(height)):
        x = index(place)
        top = greater(z[a0 + x] + (z[b0 + x] - z[a0 + x]) * f[0], NOTHING)
        s = steps[0]
        h = z[a1 + x] + (z[b1 + x] - z[a1 + x]) * f[1]
        s = steps[1] if h >= top else s
        top = greater(h, top)
        h = z[a2 + x] + (z[b2 + x] - z[a2 + x]) * f[2]
        s = steps[2] if h >= top else s
        top = greater(h, top)
        h = z[a3 + x] + (z[b3 + x] - z[a3 + x]) * f[3]
        position[x] = steps[3] if h >= top else s
        height[x] = greater(h, top)


@helper
def pool_samples(z, pad, t, anchor, first, columns, start, stop, height, position):
    """Highest sample of each line among rows start..stop, at most four; -inf where there is none.

    Reads up to three columns beyond the raster on either side, where the frame holds NaN.
    """
    height[:] = NOTHING
    if stop <= start:
        return
    width = len(height)
    left, _ = _cut(t, start + anchor)
    right, _ = _cut(t, stop - 1 + anchor)
    lo = max(0, -(first + right))
    hi = min(width, columns - (first + left))
    if hi <= lo:
        return
    # Fewer than four rows: the last one repeats, which changes nothing.
    r0 = start
    r1 = min(start + 1, stop - 1)
    r2 = min(start + 2, stop - 1)
    r3 = stop - 1
    x0, f0 = _cut(t, r0 + anchor)
    x1, f1 = _cut(t, r1 + anchor)
    x2, f2 = _cut(t, r2 + anchor)
    x3, f3 = _cut(t, r3 + anchor)
    # With weight 0 the right-hand cell must not matter, even where it is NaN.
    s0 = 1 if f0 > 0.0 else 0
    s1 = 1 if f1 > 0.0 else 0
    s2 = 1 if f2 > 0.0 else 0
    s3 = 1 if f3 > 0.0 else 0
    place = first + pad[1] + lo
    across = z.shape[1]
    _highest_of_four(
        z.reshape(z.size),
        (
            (r0 + pad[0]) * across + place + x0,
            (r1 + pad[0]) * across + place + x1,
            (r2 + pad[0]) * across + place + x2,
            (r3 + pad[0]) * across + place + x3,
        ),
        (s0, s1, s2, s3),
        (f0, f1, f2, f3),
        (np.float32(r0), np.float32(r1), np.float32(r2), np.float32(r3)),
        height[lo:hi],
        position[lo:hi],
    )


@inline
def _between(left_z, left_s, right_z, right_s, weight, here, c, shear, reach):
    """Height and steps of the point between two lines' vertices, on the receiver's own ray.

    Heights and distances are interpolated, not slopes: a plane is then exact however far apart
    the vertices lie. A vertex beyond reach, or beyond the point where the own ray leaves the
    raster, does not count, and the one beside it then neither: alone it lies off the ray, and a
    steep plane would seem to stand above itself. The height is then -inf. It is -inf or NaN where
    there is no vertex: both raise nothing.
    """
    right = here - right_s
    left = here - left_s
    farthest = greater(right, left)
    counts = (farthest * shear <= c) & (farthest <= reach)
    share = np.float32(1.0) - weight
    height = right_z * share + left_z * weight
    return height if counts else NOTHING, right * share + left * weight


@helper
def _gather(left_z, left_s, right_z, right_s, receiver, best, weight, here, limits, column):
    """Raise `best` by the slopes to the points between the vertices of two lines.

    `limits`: observer height, 1 / step length, bend · step length, shear, reach in steps.
    """
    observer, per_step, drop, shear, reach = limits
    first = np.float32(column)
    for x in range(len(best)):
        c = first + np.float32(np.int32(x))
        height, steps = _between(
            left_z[x], left_s[x], right_z[x], right_s[x], weight, here, c, shear, reach
        )
        slope = (height - receiver[x] - observer) * per_step / steps - drop * steps
        best[x] = greater(greater(slope, best[x]), NOTHING)


@helper
def _gather_distance(
    left_z, left_s, right_z, right_s, receiver, best, distance, weight, here, limits, column
):
    """As `_gather`, and keep the distance to that point."""
    observer, per_step, drop, shear, reach = limits
    first = np.float32(column)
    for x in range(len(best)):
        c = first + np.float32(np.int32(x))
        height, steps = _between(
            left_z[x], left_s[x], right_z[x], right_s[x], weight, here, c, shear, reach
        )
        slope = (height - receiver[x] - observer) * per_step / steps - drop * steps
        if slope > best[x]:
            best[x] = slope
            distance[x] = steps / per_step


@helper
def gather_rows(
    z,
    pad,
    t,
    anchor,
    first,
    start,
    stop,
    high,
    corner,
    rows,
    columns,
    vertex_z,
    vertex_s,
    limits,
    best,
    distance,
):
    """Gather for the receivers of rows start..stop that lie between the strip's lines."""
    width = len(vertex_z)
    for i in range(max(start, rows[0]), min(stop, rows[1])):
        base, f = _cut(t, i + anchor)
        column = first + base
        lo = max(column + 1, columns[0])
        hi = min(column + width, columns[1])
        lo, hi = without_empty_ends(high, corner, i, lo, hi)
        lo, hi = lo - column, hi - column
        if hi <= lo:
            continue
        # With f = 0 the left-hand line must not matter.
        shift = 1 if f > 0.0 else 0
        x = column + pad[1]
        c = column + lo
        if distance is None:
            _gather(
                vertex_z[lo - shift : hi - shift],
                vertex_s[lo - shift : hi - shift],
                vertex_z[lo:hi],
                vertex_s[lo:hi],
                z[i + pad[0], x + lo : x + hi],
                best[i, c : column + hi],
                f,
                np.float32(i),
                limits,
                c,
            )
        else:
            _gather_distance(
                vertex_z[lo - shift : hi - shift],
                vertex_s[lo - shift : hi - shift],
                vertex_z[lo:hi],
                vertex_s[lo:hi],
                z[i + pad[0], x + lo : x + hi],
                best[i, c : column + hi],
                distance[i, c : column + hi],
                f,
                np.float32(i),
                limits,
                c,
            )


@helper
def _query_and_insert(
    height, position, near, observer, bend, hull_z, hull_s, size, far, vertex_z, vertex_s
):
    """Algorithm 1 of P1 on every line of a strip: pop, hand out the tangent vertex, push.

    `far` counts the vertices at the bottom of each stack that lie beyond the near field: by
    convexity the tangent among them is the topmost. A line without a sample here (outside the
    raster, or nodata) keeps its latest vertex.

    The stacks of all lines are one flat array: vertex k of a line is at k · LINES + line, and
    `size` and `far` hold such places, which saves the products and tests of two indices.
    """
    for line in range(len(height)):
        z = height[line]
        if z == NOTHING:
            continue
        s = position[line]
        z -= bend * s * s
        first = index(line)
        end = size[line]  # where the next vertex goes
        beyond = far[line]
        if end > first:
            rise = hull_z[end - LINES] - z
            away = s - hull_s[end - LINES]
            while end > first + LINES:
                next_rise = hull_z[end - TWO_LINES] - z
                next_away = s - hull_s[end - TWO_LINES]
                if next_rise * away < rise * next_away:
                    break
                end -= LINES
                rise = next_rise
                away = next_away
            beyond = min(beyond, end)
            while beyond < end and s - hull_s[beyond] > near:
                beyond += LINES
            if beyond > first:
                q = beyond - LINES
                if observer > 0.0:
                    eye = z + observer
                    while q > first and (hull_z[q - LINES] - eye) * (s - hull_s[q]) >= (
                        hull_z[q] - eye
                    ) * (s - hull_s[q - LINES]):
                        q -= LINES
                at = hull_s[q]
                vertex_s[line] = at
                vertex_z[line] = hull_z[q] + bend * at * at
            else:
                vertex_s[line] = np.float32(-1.0)
                vertex_z[line] = NOTHING
        far[line] = beyond
        hull_s[end] = s
        hull_z[end] = z
        size[line] = end + LINES


def strips(*arguments: Any) -> int:
    """Strips whose lines pass a receiver; line L is at column L + floor(t·I) at global step I."""
    _, _, _, t, anchor, strip_width, *_, rows, columns, _, _ = arguments
    lowest = columns[0] - math.floor(t * (rows[1] - 1 + anchor) + SNAP)
    highest = columns[1] - 1 - math.floor(t * (rows[0] + anchor) + SNAP)
    return int((highest - lowest + strip_width) // strip_width)


@inline
def first_line(t, anchor, strip_width, strip, rows, columns):
    """The strip's first line; it is also the last of the strip before."""
    return columns[0] - _cut(t, rows[1] - 1 + anchor)[0] + strip * strip_width - 1


@shared_kernel(strips)
def hull_sweep(
    first_strip,
    end_strip,
    z,
    pad,
    width,
    t,
    anchor,
    strip_width,
    pool,
    near,
    bend,
    limits,
    high,
    corner,
    rows,
    columns,
    best,
    distance,
):
    """Raise `best` by the far horizon, unlimited range.

    Parameters
    ----------
    z : (pad[0] + n, pad[1] + m + RIGHT) float32
        Heights in the sweep frame, padded with NaN; pad at least 4.
    width : int
        Columns m of the raster.
    t : float
        Shear: minor cells a major step, 0 to 1.
    anchor : int
        Global step of row 0: lines and pools are anchored to the global grid.
    strip_width : int
        Lines that are swept together, at most `MOST_LINES`.
    pool : int
        Samples that enter the hull as one.
    near : float32
        Vertices up to so many steps away are left to the near field.
    bend : float32
        Curvature drop a step squared [m].
    limits : 5-tuple of float32
        Observer height, 1 / step length, curvature slope a step, shear, reach in steps.
    high, corner
        Blocks of ground, see `adret._kernels.ground`.
    rows, columns : (2,) int64
        Receivers to serve, start and stop.
    best : (n, m) float32
        Slopes, raised in place.
    distance : (n, m) float32, or None
        Distance to the horizon point, kept where `best` is raised; None to leave it out.
    """
    for strip in range(first_strip, end_strip):
        first = first_line(t, anchor, strip_width, strip, rows, columns)
        lines = strip_width + 1
        depth = rows[1] // pool + 2
        hull_z = np.empty(depth * (MOST_LINES + 1), np.float32)
        hull_s = np.empty(depth * (MOST_LINES + 1), np.float32)
        size = np.empty(lines, np.uintp)
        far = np.empty(lines, np.uintp)
        height = np.empty(lines, np.float32)
        position = np.empty(lines, np.float32)
        vertex_z = np.empty(lines, np.float32)
        vertex_s = np.empty(lines, np.float32)
        for line in range(lines):
            size[line] = line
            far[line] = line
            position[line] = 0.0
            vertex_z[line] = NOTHING
            vertex_s[line] = -1.0
        for begin in range(-(anchor % pool), rows[1], pool):
            start = max(begin, 0)
            # Whole pools, also where the receivers end: a tile is then as the whole.
            stop = min(begin + pool, z.shape[0] - pad[0])
            pool_samples(z, pad, t, anchor, first, width, start, stop, height, position)
            _query_and_insert(
                height,
                position,
                near,
                limits[0],
                bend,
                hull_z,
                hull_s,
                size,
                far,
                vertex_z,
                vertex_s,
            )
            gather_rows(
                z,
                pad,
                t,
                anchor,
                first,
                start,
                stop,
                high,
                corner,
                rows,
                columns,
                vertex_z,
                vertex_s,
                limits,
                best,
                distance,
            )
