"""Irradiance that one azimuth slice of the sky sends to tilted Lambertian cells.

A slice of azimuth φ sends n_h A(e) + n_u B(e) to a cell that sees it above the elevation e, where
n_h = n_e sin φ + n_n cos φ, A(e) and B(e) are the integrals of L cos² and of L sin cos from e to
the zenith, and e = max(h, hp) with hp the cell's own plane. With the plane's slope tp towards φ,
n_h = -n_u tp: the kernels add B - tp A to `total` and leave the factor n_u to the end.

Tables of moments are looked up in three passes over a few cells: positions, look-ups, sums. NaN
slopes become position 0; NaN reaches `total` through tp.
"""

import numpy as np

from adret._kernels.angles import HALF_PI, atan_slope
from adret._kernels.jit import first_rows, index, inline, shared_kernel
from adret._kernels.vectors import four_lookups

ZERO = np.float32(0.0)
HALF = np.float32(0.5)
ONE = np.float32(1.0)
THIRD = np.float32(1.0 / 3.0)
PER_PI = np.float32(1.0 / np.pi)
ONE_ROW = np.uint32(1)
CHUNK = 512  # cells whose positions, shares and light stay in the nearest cache


@shared_kernel(first_rows)
def add_smooth_sky(
    start, stop, slope, to_east, to_north, sin_azimuth, cos_azimuth, constant, sine, total
):
    """Add a slice of radiance constant + sine·sin e above the horizontal, none below."""
    for y in range(start, stop):
        layer = slope[y]
        p = to_east[y]
        q = to_north[y]
        out = total[y]
        for x in range(len(out)):
            tp = p[x] * sin_azimuth + q[x] * cos_azimuth
            t = tp if layer[x] < tp else layer[x]
            t = ZERO if t < ZERO else t
            cosine2 = ONE / (ONE + t * t)
            cosine = np.sqrt(cosine2)
            sine3 = t * t * t * cosine2 * cosine
            a_constant = HALF * (HALF_PI - atan_slope(t) - t * cosine2)
            a_sine = THIRD * cosine2 * cosine
            b_constant = HALF * cosine2
            b_sine = THIRD * (ONE - sine3)
            out[x] += constant * (b_constant - tp * a_constant) + sine * (b_sine - tp * a_sine)


@inline
def table_position(t, first, per_step, last):
    """Where the elevation of slope `t` lies in a table, between 0 and `last`; 0 for NaN."""
    position = (atan_slope(t) - first) * per_step
    position = position if position > ZERO else ZERO
    return last if position > last else position


@shared_kernel(first_rows)
def add_tables(
    start, stop, slope, to_east, to_north, sin_azimuth, cos_azimuth, first, per_step, table, total
):
    """Add a slice of one or three bands from its table of A and B.

    `first` is the elevation of the table's first entry, `per_step` one over its step [radians].
    `table` (8 (n + 1),) holds for each entry B of three bands, 0, A of three bands, 0; the last
    entry stands twice. `total` is (bands, rows, columns).
    """
    last = np.float32(table.size // 8 - 2)
    bands, _, columns = total.shape
    place = np.zeros(CHUNK, np.uint32)  # zeros: the last four cells may be fewer
    share = np.zeros(CHUNK, np.float32)
    lean = np.zeros(CHUNK, np.float32)
    light = np.empty(3 * CHUNK, np.float32)
    for y in range(start, stop):
        for left in range(0, columns, CHUNK):
            right = min(left + CHUNK, columns)
            layer = slope[y, left:right]
            p = to_east[y, left:right]
            q = to_north[y, left:right]
            for x in range(len(layer)):
                tp = p[x] * sin_azimuth + q[x] * cos_azimuth
                t = tp if layer[x] < tp else layer[x]
                position = table_position(t, first, per_step, last)
                entry = np.int32(position)
                place[x] = np.uint32(entry) * np.uint32(8)
                share[x] = position - np.float32(entry)
                lean[x] = tp
            for x in range(0, len(layer), 4):
                four_lookups(table, place, share, lean, index(x), light, index(CHUNK))
            for band in range(bands):
                out = total[band, y, left:right]
                here = light[band * CHUNK : (band + 1) * CHUNK]
                for x in range(len(out)):
                    out[x] += here[x]


@shared_kernel(first_rows)
def add_normal_table(
    start,
    stop,
    slope,
    to_east,
    to_north,
    sin_azimuth,
    cos_azimuth,
    first,
    per_step,
    sin_lean,
    cos_lean,
    table,
    total,
):
    """Add |N_p| L_p(normal angle, horizon angle) of paper P1, eq. 6.

    `table` is (N n, bands), the row of normal j and horizon i being j n + i: N even normals
    that lean by -π/2 to π/2 from the zenith towards the azimuth, with these sines and cosines (N,),
    and n horizon elevations from `first` up. The cell's normal over n_u is (-tp, 1) in the slice's
    plane; it is written as a sum of the two normals beside it, so light is exact where both of them
    see all that the cell sees. `total` is (bands, rows, columns).
    """
    bands = total.shape[0]
    normals = len(sin_lean)
    count = np.uint32(len(table) // normals)
    last = np.float32(count - 1)
    end = np.int32(count - 2)
    last_normal = np.int32(normals - 2)
    per_angle = np.float32(normals - 1) * PER_PI
    # Sine of the angle between neighbouring normals.
    per_sine = ONE / (sin_lean[1] * cos_lean[0] - cos_lean[1] * sin_lean[0])
    for y in range(start, stop):
        layer = slope[y]
        p = to_east[y]
        q = to_north[y]
        for x in range(len(layer)):
            tp = p[x] * sin_azimuth + q[x] * cos_azimuth
            t = tp if layer[x] < tp else layer[x]
            position = table_position(t, first, per_step, last)
            i = np.int32(position)
            i = end if i > end else i
            f = position - np.float32(i)
            lean = (HALF_PI - atan_slope(tp)) * per_angle
            j = np.int32(lean if lean > ZERO else ZERO)
            j = np.uint32(last_normal if j > last_normal else j)
            low = (sin_lean[j + ONE_ROW] + tp * cos_lean[j + ONE_ROW]) * per_sine
            high = -(sin_lean[j] + tp * cos_lean[j]) * per_sine
            row = j * count + np.uint32(i)
            next_row = row + count
            for band in range(bands):
                before = low * table[row, band] + high * table[next_row, band]
                after = low * table[row + ONE_ROW, band] + high * table[next_row + ONE_ROW, band]
                total[band, y, x] += before + f * (after - before)


@shared_kernel(first_rows)
def finish(start, stop, to_east, to_north, total, irradiance):
    """Multiply the sums by n_u and keep rounding from making them negative."""
    bands = total.shape[0]
    for y in range(start, stop):
        p = to_east[y]
        q = to_north[y]
        for x in range(len(p)):
            n_u = ONE / np.sqrt(ONE + p[x] * p[x] + q[x] * q[x])
            for band in range(bands):
                value = np.float32(total[band, y, x] * n_u)
                irradiance[y, x, band] = ZERO if value < ZERO else value
