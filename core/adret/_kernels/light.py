"""Irradiance that one azimuth slice of the sky sends to tilted Lambertian cells.

A slice of azimuth φ sends n_h A(e) + n_u B(e) to a cell that sees it above the elevation e, where
n_h = n_e sin φ + n_n cos φ, A(e) and B(e) are the integrals of L cos² and of L sin cos from e to
the zenith, and e = max(h, hp) with hp the cell's own plane. With the plane's slope tp towards φ,
n_h = -n_u tp: the kernels add B - tp A to `total` and leave the factor n_u to the end.

Table kernels walk each row twice: first the positions in the table, which vectorises, then the
look-ups, which does not. NaN slopes become position 0; NaN reaches `total` through tp.
"""

import numpy as np

from adret._kernels.angles import HALF_PI, atan_slope
from adret._kernels.jit import inline, parallel_kernel, prange

ZERO = np.float32(0.0)
HALF = np.float32(0.5)
ONE = np.float32(1.0)
THIRD = np.float32(1.0 / 3.0)
PER_PI = np.float32(1.0 / np.pi)
BLOCK = 16  # rows that share one row of positions


@parallel_kernel
def add_smooth_sky(slope, to_east, to_north, sin_azimuth, cos_azimuth, constant, sine, total):
    """Add a slice of radiance constant + sine·sin e above the horizontal, none below."""
    for y in prange(slope.shape[0]):
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


@parallel_kernel
def add_table_1(
    slope, to_east, to_north, sin_azimuth, cos_azimuth, first, per_step, table, positions, total
):
    """Add a slice of one band from its table of A and B.

    `first` is the elevation of the table's first entry, `per_step` one over its step [radians].
    `table` (n + 1, 4) holds B, its rise to the next entry, A, its rise; the last entry rises by 0.
    `positions` (ceil(rows / 16), columns) is scratch; `total` is (1, rows, columns).
    """
    rows = slope.shape[0]
    last = np.float32(len(table) - 1)
    for block in prange(positions.shape[0]):
        position = positions[block]
        for y in range(block * BLOCK, min((block + 1) * BLOCK, rows)):
            layer = slope[y]
            p = to_east[y]
            q = to_north[y]
            out = total[0, y]
            for x in range(len(position)):
                tp = p[x] * sin_azimuth + q[x] * cos_azimuth
                t = tp if layer[x] < tp else layer[x]
                position[x] = table_position(t, first, per_step, last)
            for x in range(len(position)):
                i = np.uint32(np.int32(position[x]))
                f = position[x] - np.float32(np.int32(i))
                tp = p[x] * sin_azimuth + q[x] * cos_azimuth
                out[x] += (table[i, 0] + f * table[i, 1]) - tp * (table[i, 2] + f * table[i, 3])


@parallel_kernel
def add_table_3(
    slope, to_east, to_north, sin_azimuth, cos_azimuth, first, per_step, table, positions, total
):
    """As `add_table_1` with three bands: `table` (n + 1, 12), `total` (3, rows, columns)."""
    rows = slope.shape[0]
    last = np.float32(len(table) - 1)
    for block in prange(positions.shape[0]):
        position = positions[block]
        for y in range(block * BLOCK, min((block + 1) * BLOCK, rows)):
            layer = slope[y]
            p = to_east[y]
            q = to_north[y]
            red = total[0, y]
            green = total[1, y]
            blue = total[2, y]
            for x in range(len(position)):
                tp = p[x] * sin_azimuth + q[x] * cos_azimuth
                t = tp if layer[x] < tp else layer[x]
                position[x] = table_position(t, first, per_step, last)
            for x in range(len(position)):
                i = np.uint32(np.int32(position[x]))
                f = position[x] - np.float32(np.int32(i))
                tp = p[x] * sin_azimuth + q[x] * cos_azimuth
                red[x] += (table[i, 0] + f * table[i, 1]) - tp * (table[i, 2] + f * table[i, 3])
                green[x] += (table[i, 4] + f * table[i, 5]) - tp * (table[i, 6] + f * table[i, 7])
                blue[x] += (table[i, 8] + f * table[i, 9]) - tp * (table[i, 10] + f * table[i, 11])


@parallel_kernel
def add_normal_table(
    slope, to_east, to_north, sin_azimuth, cos_azimuth, first, per_step, table, total
):
    """Add |N_p| L_p(normal angle, horizon angle) of paper P1, eq. 6, bilinear in both angles.

    `table` is (bands, N, n + 1): normal angles from -π/2 to π/2 towards the azimuth, horizon
    elevations from `first` up. `total` is (bands, rows, columns); the factor n_u is left out.
    """
    bands, normals, count = table.shape
    last = np.float32(count - 1)
    last_normal = np.float32(normals - 1)
    per_angle = last_normal * PER_PI
    for y in prange(slope.shape[0]):
        layer = slope[y]
        p = to_east[y]
        q = to_north[y]
        for x in range(len(layer)):
            tp = p[x] * sin_azimuth + q[x] * cos_azimuth
            position = table_position(layer[x], first, per_step, last)
            i = min(np.int32(position), count - 2)
            f = position - np.float32(i)
            # The projected normal leans by -hp from the zenith towards the azimuth.
            lean = (HALF_PI - atan_slope(tp)) * per_angle
            lean = lean if lean > ZERO else ZERO
            lean = last_normal if lean > last_normal else lean
            j = min(np.int32(lean), normals - 2)
            g = lean - np.float32(j)
            length = np.sqrt(ONE + tp * tp)
            for band in range(bands):
                low = table[band, j, i] + f * (table[band, j, i + 1] - table[band, j, i])
                high = table[band, j + 1, i] + f * (
                    table[band, j + 1, i + 1] - table[band, j + 1, i]
                )
                total[band, y, x] += length * (low + g * (high - low))


@parallel_kernel
def finish(to_east, to_north, total, irradiance):
    """Multiply the sums by n_u and keep rounding from making them negative."""
    bands = total.shape[0]
    for y in prange(total.shape[1]):
        p = to_east[y]
        q = to_north[y]
        for x in range(len(p)):
            n_u = ONE / np.sqrt(ONE + p[x] * p[x] + q[x] * q[x])
            for band in range(bands):
                value = np.float32(total[band, y, x] * n_u)
                irradiance[y, x, band] = ZERO if value < ZERO else value
