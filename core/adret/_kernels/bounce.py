"""Light from visible terrain: bands of rising slope along each cell's own ray.

Along the ray of one azimuth a running maximum, the top, starts at the slope of the cell's own
plane. A crossing of the ray with a grid line that stands higher is visible; the band of elevations
between the top and its slope sees the piece of surface in front of it, which sends, over n_u,

    L (M(top) - M(slope)),   M(t) = B(t) - tp A(t),

A and B being the integrals of cos² e and of sin e cos e from atan(t) to the zenith and tp the
plane's slope (n_h = -n_u tp). L is the mean of the radiance at both ends of the piece: the
crossing, and the point before it at which the sight line of the old top meets the surface.

CHUNK receivers of a row of the sweep frame (see `adret.sweep`) walk together: they share the
offsets and weights of all crossings. What is left out changes nothing: a block of crossings none
of whose tiles is high enough, a group of which none is visible, light of tiles that are dark, and
(in later bounces) all that lies behind the last visible group of the first one.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adret._kernels.angles import HALF_PI, atan_slope
from adret._kernels.jit import greater, index, inline, prange, strict_kernel, strict_parallel_kernel

CHUNK = 128
LANES = 32  # of them whose light is added up together
GROUP = 4
BLOCK = 16
PAD = 8  # cells on the sides that rays run to: a group of crossings spans fewer
TILE_ROWS = 16
TILE_COLUMNS = 64
STRIP = 16  # rows of a task: they read nearly the same cells
COUNTERS = 5  # of each task: receivers, crossings tested, hidden, weighed, dark
MARGIN = np.float32(2e-6)  # rounding of slopes, for the tiles' bound
ZERO = np.float32(0.0)
HALF = np.float32(0.5)
ONE = np.float32(1.0)
# Where a chunk's state lies in its scratch array. One array needs few checks against aliasing,
# and loops with many are not vectorised. FIRST and SECOND hold four crossings each.
HERE, PLANE, TOP, ABOVE, BEST, FIRST = (index(i * CHUNK) for i in range(6))
SECOND, TOTAL = index(9 * CHUNK), index(13 * CHUNK)
SCRATCH = (13 + 3) * CHUNK


class Frame(NamedTuple):
    """A raster turned for one octant, padded by PAD rows and columns on the sides rays run to."""

    z: NDArray[np.float32]  # (R * width,) heights, NaN where there is none
    light: NDArray[np.float32]  # (bands, R * width) exit radiance, 0 where there is none
    width: int
    tops: NDArray[np.float32]  # highest height of each tile
    lit: NDArray[np.bool_]  # tiles that send any light


class Rays(NamedTuple):
    """Crossings of one azimuth in order of distance; the first is the receiver itself.

    After it follow a multiple of GROUP; those that fill up have a height of NaN.
    """

    cells: NDArray[np.int64]  # (S, 4) A, B, ROW, COLUMN
    numbers: NDArray[np.float32]  # (S, 8) P, Q, WAY, DROP, SLOPE_P, SLOPE_Q, SLOPE_V, SLOPE_K


# Offsets of the two cells that a crossing lies between; the lower of their row shifts, and the
# column shift of the first.
A, B, ROW, COLUMN = range(4)
# Weights of the two cells, distance [m], drop of the surface by curvature [m]; the slope is
# SLOPE_P za + SLOPE_Q zb - SLOPE_V z + SLOPE_K.
P, Q, WAY, DROP, SLOPE_P, SLOPE_Q, SLOPE_V, SLOPE_K = range(8)


@inline
def moment(slope, plane):
    """M: irradiance over n_u of an azimuth's terrain of radiance 1 above a slope."""
    cosine2 = ONE / (ONE + slope * slope)
    return HALF * (cosine2 - plane * (HALF_PI - atan_slope(slope) - slope * cosine2))


@strict_parallel_kernel
def tile_tops(z, tops):
    """Fill `tops` with the highest height of each tile of a padded frame, -inf for none."""
    for i in prange(tops.shape[0]):
        for j in range(tops.shape[1]):
            top = np.float32(-np.inf)
            for r in range(i * TILE_ROWS, min(z.shape[0], (i + 1) * TILE_ROWS)):
                for x in range(j * TILE_COLUMNS, min(z.shape[1], (j + 1) * TILE_COLUMNS)):
                    top = greater(z[r, x], top)
            tops[i, j] = top


@strict_parallel_kernel
def tile_lights(light, lit):
    """Mark the tiles of padded frames (bands, rows, columns) that send any light."""
    for i in prange(lit.shape[0]):
        for j in range(lit.shape[1]):
            any_light = False
            for band in range(light.shape[0]):
                for r in range(i * TILE_ROWS, min(light.shape[1], (i + 1) * TILE_ROWS)):
                    for x in range(j * TILE_COLUMNS, min(light.shape[2], (j + 1) * TILE_COLUMNS)):
                        any_light |= light[band, r, x] != ZERO
            lit[i, j] = any_light


@strict_kernel
def highest(tops, top_row, bottom_row, left, right):
    """Highest of some tiles, both ends included."""
    top = np.float32(-np.inf)
    for i in range(top_row, min(bottom_row + 1, tops.shape[0])):
        for j in range(left, min(right + 1, tops.shape[1])):
            top = greater(tops[i, j], top)
    return top


@strict_kernel
def any_lit(lit, top_row, bottom_row, left, right):
    """Whether any of some tiles sends light, both ends included."""
    for i in range(top_row, min(bottom_row + 1, lit.shape[0])):
        for j in range(left, min(right + 1, lit.shape[1])):
            if lit[i, j]:
                return True
    return False


@inline
def tile_span(cells, first, last, i, lo, hi):
    """Tiles that hold crossings first to last of receivers lo to hi in row i."""
    return (
        max(i + PAD + cells[last, ROW], 0) // TILE_ROWS,
        (i + PAD + cells[first, ROW] + 1) // TILE_ROWS,
        max(lo + PAD + cells[last, COLUMN] - 1, 0) // TILE_COLUMNS,
        (hi + PAD + cells[first, COLUMN]) // TILE_COLUMNS,
    )


@inline
def differ(bits, start, stop):
    """Whether BEST differs from TOP anywhere."""
    changed = np.int32(0)
    for i in range(start, stop):
        x = index(i)
        changed |= bits[BEST + x] ^ bits[TOP + x]
    return changed != 0


@strict_kernel
def can_rise(height, drop, per_near, per_far, start, stop, s, bits):
    """Whether terrain of this height between two distances could rise above any top."""
    for i in range(start, stop):
        x = index(i)
        rise = height - drop - s[HERE + x]
        bound = rise * (per_near if rise > ZERO else per_far) + MARGIN
        s[BEST + x] = greater(bound, s[TOP + x])
    return differ(bits, start, stop)


@strict_kernel
def four_rise(z, cells, numbers, c, base, start, stop, s):
    """Put the tops after crossings c to c + 3 into BEST."""
    a0, a1 = index(base + cells[c, A]), index(base + cells[c + 1, A])
    a2, a3 = index(base + cells[c + 2, A]), index(base + cells[c + 3, A])
    b0, b1 = index(base + cells[c, B]), index(base + cells[c + 1, B])
    b2, b3 = index(base + cells[c + 2, B]), index(base + cells[c + 3, B])
    p0, q0, v0, k0 = numbers[c, 4], numbers[c, 5], numbers[c, 6], numbers[c, 7]
    p1, q1, v1, k1 = numbers[c + 1, 4], numbers[c + 1, 5], numbers[c + 1, 6], numbers[c + 1, 7]
    p2, q2, v2, k2 = numbers[c + 2, 4], numbers[c + 2, 5], numbers[c + 2, 6], numbers[c + 2, 7]
    p3, q3, v3, k3 = numbers[c + 3, 4], numbers[c + 3, 5], numbers[c + 3, 6], numbers[c + 3, 7]
    for i in range(start, stop):
        x = index(i)
        h = s[HERE + x]
        t = greater(z[a0 + x] * p0 + z[b0 + x] * q0 - h * v0 + k0, s[TOP + x])
        t = greater(z[a1 + x] * p1 + z[b1 + x] * q1 - h * v1 + k1, t)
        t = greater(z[a2 + x] * p2 + z[b2 + x] * q2 - h * v2 + k2, t)
        s[BEST + x] = greater(z[a3 + x] * p3 + z[b3 + x] * q3 - h * v3 + k3, t)


@strict_kernel
def add_four(z, light, cells, numbers, first, base, start, stop, s):
    """Raise TOP by four crossings and add the light of the first band.

    FIRST and SECOND keep the weights of the radiance of each crossing and of the one before it.
    """
    for u in range(GROUP):
        c = first + u
        a1, b1 = index(base + cells[c, A]), index(base + cells[c, B])
        a0, b0 = index(base + cells[c - 1, A]), index(base + cells[c - 1, B])
        p1, q1, way1, drop1 = numbers[c, P], numbers[c, Q], numbers[c, WAY], numbers[c, DROP]
        p0, q0 = numbers[c - 1, P], numbers[c - 1, Q]
        way0, drop0 = numbers[c - 1, WAY], numbers[c - 1, DROP]
        per_way = numbers[c, SLOPE_V]
        one, other = FIRST + index(u * CHUNK), SECOND + index(u * CHUNK)
        for i in range(start, stop):
            x = index(i)
            h = s[HERE + x]
            top = s[TOP + x]
            rise = z[a1 + x] * p1 + z[b1 + x] * q1 - drop1 - h
            slope = rise * per_way
            # The sight line of the old top passes `under` above the crossing before and `over`
            # below this one: it meets the surface between the two in that proportion.
            over = rise - top * way1
            gap = top * way0 - (z[a0 + x] * p0 + z[b0 + x] * q0 - drop0 - h)
            share = HALF * over / (over + greater(ZERO, gap))  # NaN stays
            above = moment(slope, s[PLANE + x])
            seen = slope > top
            # NaN beside nodata, anything at all where the crossing is out of sight.
            share = share if seen and share == share else ZERO
            before = s[ABOVE + x]
            part = before - above if seen else ZERO
            second = part * share
            s[one + x] = part - second
            s[other + x] = second
            s[TOP + x] = slope if seen else top
            s[ABOVE + x] = above if seen else before
            s[TOTAL + x] += (part - second) * (light[a1 + x] * p1 + light[b1 + x] * q1) + second * (
                light[a0 + x] * p0 + light[b0 + x] * q0
            )


@strict_kernel
def add_band(light, cells, numbers, first, base, start, stop, total, s):
    """Add the light of another band by the weights of `add_four`."""
    to = index(total)
    for u in range(GROUP):
        c = first + u
        a1, b1 = index(base + cells[c, A]), index(base + cells[c, B])
        a0, b0 = index(base + cells[c - 1, A]), index(base + cells[c - 1, B])
        p1, q1 = numbers[c, P], numbers[c, Q]
        p0, q0 = numbers[c - 1, P], numbers[c - 1, Q]
        one, other = FIRST + index(u * CHUNK), SECOND + index(u * CHUNK)
        for i in range(start, stop):
            x = index(i)
            s[to + x] += s[one + x] * (light[a1 + x] * p1 + light[b1 + x] * q1) + s[other + x] * (
                light[a0 + x] * p0 + light[b0 + x] * q0
            )


@strict_kernel
def take_tops(start, stop, s):
    """BEST becomes TOP."""
    for i in range(start, stop):
        x = index(i)
        s[TOP + x] = s[BEST + x]


@strict_kernel
def renew_moments(count, s):
    """Moments above tops that rose over dark senders."""
    for i in range(count):
        x = index(i)
        s[ABOVE + x] = moment(s[TOP + x], s[PLANE + x])


@strict_kernel
def walk(frame, rays, reach, i, lo, hi, s, bits, counters):
    """Walk the crossings below `reach`; return one more than the last in a visible group."""
    z, light, width, tops, lit = frame
    cells, numbers = rays
    base = (i + PAD) * width + PAD + lo
    count = hi - lo
    visible = 1
    fresh = True
    c = 1
    while c < reach:
        if i + cells[c, ROW] < -1:
            break
        start = max(0, -(lo + cells[c, COLUMN]))
        if start >= count:
            break
        if (c - 1) % BLOCK == 0 and c > BLOCK and c + BLOCK <= len(cells):
            end = c + BLOCK - 1
            row0, row1, left, right = tile_span(cells, c, end, i, lo, hi)
            top = highest(tops, row0, row1, left, right)
            per_near, per_far = numbers[c, SLOPE_V], numbers[end, SLOPE_V]
            if not can_rise(top, numbers[c, DROP], per_near, per_far, start, count, s, bits):
                counters[2] += BLOCK * count
                c += BLOCK
                continue
        counters[1] += GROUP * count
        four_rise(z, cells, numbers, c, base, start, count, s)
        bright = -1
        for first in range(start, count, LANES):
            stop = min(first + LANES, count)
            if not differ(bits, first, stop):
                continue
            if bright < 0:
                visible = c + GROUP
                row0, row1, left, right = tile_span(cells, c - 1, c + GROUP - 1, i, lo, hi)
                bright = 1 if any_lit(lit, row0, row1, left, right) else 0
                if bright == 1 and not fresh:
                    renew_moments(count, s)
                    fresh = True
                fresh = fresh and bright == 1
            if bright == 0:
                counters[4] += GROUP * (stop - first)
                take_tops(first, stop, s)
                continue
            counters[3] += GROUP * (stop - first)
            add_four(z, light[0], cells, numbers, c, base, first, stop, s)
            for band in range(1, len(light)):
                to = TOTAL + index(band * CHUNK)
                add_band(light[band], cells, numbers, c, base, first, stop, to, s)
        c += GROUP
    if not fresh:
        renew_moments(count, s)
    return visible


@strict_parallel_kernel
def gather(
    frame, rays, to_east, to_north, turn, rows, columns, needed, known, reach, scale, counters, out
):
    """Add `scale` times the light of one azimuth over n_u to `out`.

    Parameters
    ----------
    frame, rays
        `Frame`, `Rays`.
    to_east, to_north : (n, m) float32
        Slopes of the receivers.
    turn : (2,) float32
        Sine and cosine of the azimuth.
    rows, columns : (2,) int64
        Receivers, start and stop.
    needed : (n, ceil(m / CHUNK)) bool
        Chunks that may receive anything.
    known : bool
        Whether `reach` is known from an earlier bounce; else it is filled.
    reach : (n, ceil(m / CHUNK)) int32
        Crossings to walk, in each chunk.
    counters : (tasks, COUNTERS) int64
        Work done is added.
    out : (bands + 2, n, m) float32
        Light of the bands; then, unless `known`, what terrain of radiance 1 would send, and
        what all of the sphere above the cell's plane would.
    """
    m = to_east.shape[1]
    bands = len(frame.light)
    chunks = (m + CHUNK - 1) // CHUNK
    for task in prange(len(counters)):
        chunk = task % chunks
        first = rows[0] + task // chunks * STRIP
        lo = max(chunk * CHUNK, columns[0])
        hi = min((chunk + 1) * CHUNK, columns[1])
        s = np.empty(SCRATCH, np.float32)
        bits = s.view(np.int32)
        for i in range(first, min(first + STRIP, rows[1]) if lo < hi else first):
            if not needed[i, chunk]:
                continue
            count = hi - lo
            base = (i + PAD) * frame.width + PAD + lo
            for x in range(count):
                plane = to_east[i, lo + x] * turn[0] + to_north[i, lo + x] * turn[1]
                s[HERE + index(x)] = frame.z[base + x]
                s[PLANE + index(x)] = plane
                s[TOP + index(x)] = plane
                s[ABOVE + index(x)] = moment(plane, plane)
                for band in range(bands):
                    s[TOTAL + index(band * CHUNK + x)] = ZERO
            counters[task, 0] += count
            end = reach[i, chunk] if known else len(rays.cells)
            visible = walk(frame, rays, end, i, lo, hi, s, bits, counters[task])
            for band in range(bands):
                for x in range(count):
                    out[band, i, lo + x] += scale * s[TOTAL + index(band * CHUNK + x)]
            if known:
                continue
            reach[i, chunk] = visible
            for x in range(count):
                plane = s[PLANE + index(x)]
                whole = moment(plane, plane)
                out[bands, i, lo + x] += scale * (whole - s[ABOVE + index(x)])
                out[bands + 1, i, lo + x] += scale * whole
