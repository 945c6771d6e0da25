"""Line-sweep ambient obscurance: the hulls of parallel lines (P3).

After Timonen, "Line-Sweep Ambient Obscurance", 2013 (paper P3), section 4 and algorithm 1, with
these changes:

- Points are in the plane that the eye and the line span, not projected along the viewing axis.
- The lines of a strip advance together. The first two tests of whether to pop are made for all of
  them at once, without branches; further pops, which are rare, one by one.
- Obscurances are compared as fractions, and slopes by the sign of a cross product: a division is
  left for the result alone. Everything along a line is float64, every stack as long as its line.

A line passes sampled rows of the frame (the depth image, or its transpose) in order; at sample i it
is at column ``start + shift[i] + blend[i]``, where ``blend`` is 0 if lines pass pixel centres.
"""

import math

import numpy as np

from adret._kernels.jit import kernel, parallel_kernel, prange
from adret._kernels.screen.falloffs import TABLE, weight

STRIP = 128  # lines a strip; their hulls' tops stay in the nearest caches
BOTTOM = 3  # NaN below a line's points: no test against them is true
FIXED = 0  # tangent plane: one for all; the receiver's; one to cull, the receiver's for the result
RECEIVER = 1
MIXED = 2


@kernel
def _cast(hx, hy, s, c, below, falloff):
    """Obscurance above the tangent plane, times the length of the eye's direction, as a fraction.

    `falloff` is (a, b, c, e, R²): W = (a + b d²)/(c + e d²), 0 from R on.
    """
    d2 = hx * hx + hy * hy
    d = math.sqrt(d2)
    num = falloff[0] + falloff[1] * d2
    n = (c * hy - s * hx - below * d) * (num if d2 < falloff[4] else 0.0)
    return n if n > 0.0 else 0.0, d * (falloff[2] + falloff[3] * d2)


@kernel
def _cast_by_table(hx, hy, s, c, below, falloff, table):
    """As `_cast`; with a table, the falloff is that, its scale and radius the first two numbers."""
    if len(table) == 0:
        return _cast(hx, hy, s, c, below, falloff)
    d = math.sqrt(hx * hx + hy * hy)
    n = (c * hy - s * hx - below * d) * weight(TABLE, falloff[1], falloff[0], table, d)
    return n if n > 0.0 else 0.0, d


@kernel
def _judge(points, c, tangent, tops, falloff, strict, pops, passed, value):
    """The first two tests of algorithm 1 on every line: how many points to pop, up to two.

    `tops` holds x and y of the three topmost points, and of the one kept aside. Writes the
    obscurance as if it were two at most; NaN where there is no point, or none before; and whether
    the topmost point, being below the tangent plane, was passed.
    """
    x, y, s, length = points[0], points[1], points[2], points[3]
    ax, ay = tops[0], tops[1]
    bx, by = tops[2], tops[3]
    ex, ey = tops[4], tops[5]
    ix, iy = tops[6], tops[7]
    for j in range(len(pops)):
        hx = ax[j] - x[j]
        hy = ay[j] - y[j]
        gx = bx[j] - x[j]
        gy = by[j] - y[j]
        fx = ex[j] - x[j]
        fy = ey[j] - y[j]
        below = tangent[j] * length[j]
        n1, m1 = _cast(hx, hy, s[j], c[j], below, falloff)
        n2, m2 = _cast(gx, gy, s[j], c[j], below, falloff)
        n3, m3 = _cast(fx, fy, s[j], c[j], below, falloff)
        n4, m4 = _cast(ix[j] - x[j], iy[j] - y[j], s[j], c[j], below, falloff)
        first = (hx * gy < hy * gx) & ((n1 * m2 < n2 * m1) | ((n1 == 0.0) & (not strict)))
        second = first & (gx * fy < gy * fx) & ((n2 * m3 < n3 * m2) | ((n2 == 0.0) & (not strict)))
        pops[j] = np.int64(first) + np.int64(second)
        passed[j] = first & (n1 == 0.0) & (not strict)
        n = n2 if first else n1
        m = m2 if first else m1
        aside = n * m4 < n4 * m
        n = n4 if aside else n
        m = m4 if aside else m
        value[j] = tangent[j] + n / (m * length[j])


@kernel
def _settle(points, c, tangent, tops, falloff, table, strict, pops, passed, hull, size, value):
    """The rest of algorithm 1 on every line: further pops, and the push.

    With a table nothing has been judged, and all pops are made here.
    """
    judged = len(table) == 0
    for j in range(len(pops)):
        x = points[0, j]
        y = points[1, j]
        if y != y:
            value[j] = np.nan
            continue
        k = size[j] - pops[j]
        if pops[j] > 1 or not judged:
            s = points[2, j]
            length = points[3, j]
            below = tangent[j] * length
            hx = hull[j, k - 1, 0] - x
            hy = hull[j, k - 1, 1] - y
            n, m = _cast_by_table(hx, hy, s, c[j], below, falloff, table)
            passed[j] = passed[j] or (n == 0.0 and not strict)
            while True:
                gx = hull[j, k - 2, 0] - x
                gy = hull[j, k - 2, 1] - y
                # The next occluder is no higher: the horizon is reached.
                if not hx * gy < hy * gx:
                    break
                next_n, next_m = _cast_by_table(gx, gy, s, c[j], below, falloff, table)
                # It casts no more either: the largest occluder is on top.
                if not (n * next_m < next_n * m or (n == 0.0 and not strict)):
                    break
                k -= 1
                hx = gx
                hy = gy
                n = next_n
                m = next_m
            hx = tops[6, j] - x
            hy = tops[7, j] - y
            next_n, next_m = _cast_by_table(hx, hy, s, c[j], below, falloff, table)
            if n * next_m < next_n * m:
                n = next_n
                m = next_m
            value[j] = tangent[j] + n / (m * length)
        hull[j, k, 0] = x
        hull[j, k, 1] = y
        tops[6, j] = tops[0, j] if passed[j] else tops[6, j]
        tops[7, j] = tops[1, j] if passed[j] else tops[7, j]
        tops[0, j] = x
        tops[1, j] = y
        tops[2, j] = hull[j, k - 1, 0]
        tops[3, j] = hull[j, k - 1, 1]
        tops[4, j] = hull[j, k - 2, 0]
        tops[5, j] = hull[j, k - 2, 1]
        size[j] = k + 1


@kernel
def _weigh_anew(points, c, own, tops, falloff, table, value):
    """Replace the obscurance by that of the same occluder above the receiver's own tangent plane.

    After the push: the occluder is the second from the top.
    """
    for j in range(len(value)):
        if value[j] == value[j]:
            length = points[3, j]
            hx = tops[2, j] - points[0, j]
            hy = tops[3, j] - points[1, j]
            below = own[j] * length
            n, m = _cast_by_table(hx, hy, points[2, j], c[j], below, falloff, table)
            value[j] = own[j] + n / (m * length)


@kernel
def _blend(a, b, share, perspective):
    """Depth on the straight line through two pixels, `share` of the way from a to b; above 0."""
    mixed = a * b / (b + (a - b) * share) if perspective else a + (b - a) * share
    return mixed if mixed > 0.0 else a


@kernel
def _sample(depth, shift, blend, starts, edge, perspective, columns, z):
    """Depths of a strip's lines on one row, and the columns that they are nearest to.

    NaN outside the image, at sky and holes. Pixels whose depths differ by more than `edge` are not
    blended: then the nearer one's surface is continued from its other neighbour, if that is of it.
    """
    last = len(depth) - 1
    for j in range(len(starts)):
        near = starts[j] + shift
        column = min(max(near, 0), last)
        columns[j] = column
        z[j] = depth[column] if near == column else np.nan
    if blend == 0.0:
        return
    side = 1 if blend < 0.5 else -1
    share = blend if blend < 0.5 else 1.0 - blend
    for j in range(len(starts)):
        near = starts[j] + shift + (blend >= 0.5)
        column = min(max(near, 0), last)
        columns[j] = column
        if near != column:
            z[j] = np.nan
            continue
        a = np.float64(depth[near])
        limit = edge * a if perspective else edge
        beyond = np.float64(depth[near + side]) if 0 <= near + side <= last else np.nan
        behind = np.float64(depth[near - side]) if 0 <= near - side <= last else np.nan
        if abs(a - beyond) <= limit:
            a = _blend(a, beyond, share, perspective)
        elif abs(a - behind) <= limit:
            a = _blend(a, behind, -share, perspective)
        z[j] = a


@kernel
def _place(z, s0, s_line, c, perspective, points):
    """Points of a strip's lines in their planes, and the eye's directions.

    `points` holds, for every line, the point (along the sweep, towards the eye), the direction
    towards the eye, of any length, by the first component reversed (the second is `c`), and its
    length.
    """
    x, y, s, length = points[0], points[1], points[2], points[3]
    if perspective:
        for j in range(len(z)):
            at = s0 + s_line[j]
            s[j] = at
            length[j] = math.sqrt(at * at + c[j] * c[j])
            x[j] = z[j] * at
            y[j] = -z[j] * c[j]
    else:
        for j in range(len(z)):
            s[j] = 0.0
            length[j] = 1.0
            x[j] = s0 + s_line[j]
            y[j] = -z[j]


@kernel
def _sine_of_tangent(normal, swap, row, column, plane, p, s, c, length):
    """Sine of the elevation of a pixel's tangent plane, against the sweep."""
    i = column if swap else row
    j = row if swap else column
    right, up, back = normal[0, i, j], normal[1, i, j], normal[2, i, j]
    dx, dy = plane
    along = right * dx + up * dy
    out = (back - p * (up * dx - right * dy)) / math.sqrt(1.0 + p * p)
    return (out * s + along * c) / (math.sqrt(along * along + out * out) * length)


@kernel
def _tangents(normal, swap, row, columns, plane, p, c, points, own):
    """Sines of the receivers' own tangent planes."""
    for j in range(len(columns)):
        own[j] = _sine_of_tangent(
            normal, swap, row, columns[j], plane, p[j], points[2, j], c[j], points[3, j]
        )


@kernel
def _begin(normal, swap, row, columns, plane, p, c, points, size, value):
    """The first point of a line sees nothing above its own tangent plane."""
    for j in range(len(columns)):
        if size[j] == BOTTOM + 1 and points[1, j] == points[1, j]:
            value[j] = _sine_of_tangent(
                normal, swap, row, columns[j], plane, p[j], points[2, j], c[j], points[3, j]
            )


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
    values,
    first,
):
    """Sweep the lines of one strip, side by side."""
    width = len(starts)
    strict = published
    per_row, per_column, origin, across_per_column, across, dx, dy = geometry
    plane = (dx, dy)
    # Neighbouring lines' tops must not fall into the same sets of the cache: an odd number of
    # quarter lines apart.
    hull = np.empty((width, (len(rows) + BOTTOM) // 8 * 8 + 13, 2))
    s_line = np.empty(width)
    p = np.zeros(width)
    c = np.ones(width)
    for j in range(width):
        s_line[j] = per_column * starts[j]
        hull[j, :BOTTOM] = np.nan
        if perspective and not published:
            p[j] = across + across_per_column * starts[j]
            c[j] = math.sqrt(1.0 + p[j] * p[j])
    tops = np.full((8, width), np.nan)
    passed = np.zeros(width, np.bool_)
    size = np.full(width, BOTTOM)
    pops = np.zeros(width, np.int64)
    columns = np.zeros(width, np.int64)
    z = np.empty(width)
    points = np.empty((4, width))
    own = np.full(width, fixed)
    fixed_sine = np.full(width, fixed)
    for i in range(len(rows)):
        shift = shifts[i]
        if starts[0] + shift >= depth.shape[1] or starts[width - 1] + shift < -1:
            continue
        row = rows[i]
        value = values[i, first : first + width]
        _sample(depth[row], shift, blends[i], starts, edge, perspective, columns, z)
        here = per_row * row + per_column * (shift + blends[i]) + origin
        _place(z, here, s_line, c, perspective, points)
        if mode != FIXED:
            _tangents(normal, swap, row, columns, plane, p, c, points, own)
        tangent = own if mode == RECEIVER else fixed_sine
        if len(table) == 0:
            _judge(points, c, tangent, tops, falloff, strict, pops, passed, value)
        _settle(points, c, tangent, tops, falloff, table, strict, pops, passed, hull, size, value)
        if mode == MIXED:
            _weigh_anew(points, c, own, tops, falloff, table, value)
        _begin(normal, swap, row, columns, plane, p, c, points, size, value)


@parallel_kernel
def sweep_lines(
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
    values,
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
        As for `_cast` and `_cast_by_table`.
    values : (B, most samples, most lines) float32
        Output; NaN at sky and holes; undefined beyond the image.
    """
    strips = (starts.shape[1] + STRIP - 1) // STRIP
    for task in prange(len(lines) * strips):
        b = task // strips
        first = task % strips * STRIP
        last = min(lines[b], first + STRIP)
        if last > first:
            _sweep_strip(
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
                values[b],
                first,
            )
