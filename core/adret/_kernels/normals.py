"""Slopes and unit normals of a height field.

Paper P1 (section 7) sums the unnormalised normals of the four quads at a sample. Written out, that
sum is the central difference on each axis; where quads are missing it is the one-sided one.
"""

import numpy as np

from adret._kernels.jit import first_rows, inline, shared_kernel

ZERO = np.float32(0.0)
ONE = np.float32(1.0)
TWO = np.float32(2.0)


@inline
def mean_step(before, after):
    """Mean of the height steps to the two neighbours; the other one where one is NaN, else 0."""
    has_before = before == before
    has_after = after == after
    total = (before if has_before else ZERO) + (after if has_after else ZERO)
    return total / (TWO if has_before and has_after else ONE)


@shared_kernel(first_rows)
def gradients(start, stop, heights, per_width, per_height, to_east, to_north):
    """Rise per metre towards east and north; NaN at nodata.

    `per_width` and `per_height` hold one over the cell size [1/m] of each row.
    """
    rows, columns = heights.shape
    for y in range(start, stop):
        here = heights[y]
        east = to_east[y]
        north = to_north[y]
        across = per_width[y]
        along = per_height[y]
        # At the first and last row the neighbour is the row itself, marked as missing.
        above = heights[y - 1] if y > 0 else here
        below = heights[y + 1] if y < rows - 1 else here
        lost_above = ZERO if y > 0 else np.float32(np.nan)
        lost_below = ZERO if y < rows - 1 else np.float32(np.nan)
        for x in range(columns):
            z = here[x]
            step = mean_step(z - below[x] + lost_below, above[x] - z + lost_above)
            north[x] = step * along + (z - z)
        if columns == 1:
            east[0] = here[0] - here[0]
            continue
        left = here[:-2]
        middle = here[1:-1]
        right = here[2:]
        inner = east[1:-1]
        for x in range(len(inner)):
            z = middle[x]
            inner[x] = mean_step(z - left[x], right[x] - z) * across + (z - z)
        nan = np.float32(np.nan)
        first = here[0]
        last = here[columns - 1]
        east[0] = mean_step(nan, here[1] - first) * across + (first - first)
        east[columns - 1] = mean_step(last - here[columns - 2], nan) * across + (last - last)


@shared_kernel(first_rows)
def normals_from_gradients(start, stop, to_east, to_north, normals):
    """Unit normals (east, north, up) of planes that rise by these slopes."""
    columns = to_east.shape[1]
    for y in range(start, stop):
        p = to_east[y]
        q = to_north[y]
        east = normals[0, y]
        north = normals[1, y]
        up = normals[2, y]
        for x in range(columns):
            n_u = ONE / np.sqrt(ONE + p[x] * p[x] + q[x] * q[x])
            east[x] = -p[x] * n_u
            north[x] = -q[x] * n_u
            up[x] = n_u


@shared_kernel(first_rows)
def lowest_plane_slopes(start, stop, to_east, to_north, sin_azimuth, cos_azimuth, lowest):
    """Lowest slope of the cells' own planes towards each azimuth, row by row (rows, K)."""
    columns = to_east.shape[1]
    for y in range(start, stop):
        p = to_east[y]
        q = to_north[y]
        for k in range(len(sin_azimuth)):
            s = sin_azimuth[k]
            c = cos_azimuth[k]
            low = np.float32(np.inf)
            for x in range(columns):
                tilt = p[x] * s + q[x] * c
                low = tilt if tilt < low else low
            lowest[y, k] = low
