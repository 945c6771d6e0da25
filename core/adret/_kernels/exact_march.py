"""The truth: every crossing of a cell's own ray with the grid lines, in float64."""

import math

import numpy as np

from adret._kernels.jit import kernel, parallel_kernel, prange

SNAP = 1e-9  # a crossing this near to a vertex (in cells) is the vertex
MORE = 1.0 + 1e-12  # what rounding can take from a quotient, many times over


@kernel
def exact_horizon(z, row, column, along_row, along_column, limit, bend, observer, top):
    """Slope of the horizon and the distance to it for one cell and one direction.

    `along_row` and `along_column` are index units a metre towards the azimuth, `bend` is
    (1 - k) / (2 R), not negative. No height is above `top`: what is too far away to rise above the
    horizon even with that is not looked at, and the third result tells whether it was so; infinity
    looks at everything. Returns (-inf, NaN, False) where nothing lies that way.
    """
    rows, columns = z.shape
    base = np.float64(z[row, column]) + observer
    best = -np.inf
    way = np.nan
    end = limit
    ended = False
    # Crossings with grid rows, between two columns; then with grid columns, between two rows.
    for axis in range(2):
        step = along_row if axis == 0 else along_column
        side = along_column if axis == 0 else along_row
        if step == 0.0:
            continue
        length = rows if axis == 0 else columns
        width = columns if axis == 0 else rows
        here = row if axis == 0 else column
        there = column if axis == 0 else row
        sign = 1 if step > 0.0 else -1
        ratio = side / abs(step)
        last = length - 1 - here if sign > 0 else here
        for j in range(1, last + 1):
            distance = j / abs(step)
            if distance > end:
                ended |= distance <= limit
                break
            position = there + ratio * j
            cell = math.floor(position + SNAP)
            weight = position - cell
            if weight < SNAP:
                weight = 0.0
            if cell < 0 or cell + (weight > 0.0) > width - 1:
                break
            at = here + sign * j
            if axis == 0:
                height = np.float64(z[at, cell])
                if weight > 0.0:
                    height = height * (1.0 - weight) + np.float64(z[at, cell + 1]) * weight
            else:
                height = np.float64(z[cell, at])
                if weight > 0.0:
                    height = height * (1.0 - weight) + np.float64(z[cell + 1, at]) * weight
            slope = (height - base) / distance - bend * distance
            if slope > best or (slope == best and distance < way):
                best = slope
                way = distance
                if best > 0.0:
                    end = min(limit, (top - base) / best * MORE)
    return best, way, ended


@parallel_kernel
def exact_at(z, row, column, along_row, along_column, limit, bend, observer, top, slope, distance):
    """Exact horizon of P cells in K directions; `slope` and `distance` are (K, P) float64."""
    for p in prange(len(row)):
        for k in range(len(along_row)):
            if np.isnan(z[row[p], column[p]]):
                slope[k, p] = np.nan
                distance[k, p] = np.nan
            else:
                best, way, _ = exact_horizon(
                    z, row[p], column[p], along_row[k], along_column[k], limit, bend, observer, top
                )
                slope[k, p] = best
                distance[k, p] = way


@parallel_kernel
def exact_layer(
    z, first, left, along_row, along_column, limit, bend, observer, top, slope, distance, ended
):
    """Exact horizon of rows from `first` and columns from `left` on, one direction.

    Outputs are float32 rows; `ended` counts, in each row, rays that were not followed to their end.
    """
    for i in prange(slope.shape[0]):
        for x in range(slope.shape[1]):
            c = left + x
            if np.isnan(z[first + i, c]):
                slope[i, x] = np.nan
                distance[i, x] = np.nan
            else:
                best, way, short = exact_horizon(
                    z, first + i, c, along_row, along_column, limit, bend, observer, top
                )
                ended[i] += short
                slope[i, x] = best
                distance[i, x] = way
