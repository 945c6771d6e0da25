"""Horizon maps as published: Timonen and Westerholm 2010 (paper P1), sections 4 and 5.

Parallel lines, one sample spacing apart, cover the raster along the azimuth; heights are sampled
bilinearly at even steps; each line keeps the convex hull of what it passed as a stack (algorithm
1) and writes one horizon a sample into a buffer aligned with the lines. Cells then look their value
up in that buffer, bilinearly.
"""

import math

import numpy as np

from adret._kernels.jit import kernel, parallel_kernel, prange

EPS = 1e-9


@kernel
def _height(z, row, column):
    """Bilinear height; NaN outside the cell centres' rectangle and beside nodata."""
    rows, columns = z.shape
    r = math.floor(row + EPS)
    c = math.floor(column + EPS)
    v = max(row - r, 0.0)
    u = max(column - c, 0.0)
    v = v if v > EPS else 0.0
    u = u if u > EPS else 0.0
    if r < 0 or c < 0 or r + (v > 0.0) > rows - 1 or c + (u > 0.0) > columns - 1:
        return np.nan
    top = np.float64(z[r, c])
    if u > 0.0:
        top = top * (1.0 - u) + z[r, c + 1] * u
    if v == 0.0:
        return top
    low = np.float64(z[r + 1, c])
    if u > 0.0:
        low = low * (1.0 - u) + z[r + 1, c + 1] * u
    return top * (1.0 - v) + low * v


@parallel_kernel
def sweep_lines(z, centre, towards, across, spacing, bend, observer, buffer):
    """Fill `buffer` (lines, samples) with horizon slopes; NaN where a line has no sample.

    `towards` and `across` are (rows, columns) a metre along and at right angles to the azimuth.
    Sample q of line p lies ``(half - q) · spacing`` towards the azimuth from the centre.
    """
    lines, samples = buffer.shape
    for p in prange(lines):
        hull_z = np.empty(samples, np.float64)
        hull_s = np.empty(samples, np.float64)
        size = 0
        aside = (p - lines // 2) * spacing
        for q in range(samples):
            ahead = (samples // 2 - q) * spacing
            row = centre[0] + towards[0] * ahead + across[0] * aside
            column = centre[1] + towards[1] * ahead + across[1] * aside
            height = _height(z, row, column)
            buffer[p, q] = np.nan
            if np.isnan(height):
                continue
            s = q * spacing
            h = height - bend * s * s
            slope = -np.inf
            while size > 1:
                rise = hull_z[size - 1] - h
                further = hull_z[size - 2] - h
                if further * (s - hull_s[size - 1]) < rise * (s - hull_s[size - 2]):
                    break
                size -= 1
            if size > 0:
                top = size - 1
                slope = (hull_z[top] - h - observer) / (s - hull_s[top])
                while observer > 0.0 and top > 0:
                    top -= 1
                    other = (hull_z[top] - h - observer) / (s - hull_s[top])
                    if other < slope:
                        break
                    slope = other
                slope -= 2.0 * bend * s
            buffer[p, q] = slope
            hull_z[size] = h
            hull_s[size] = s
            size += 1


@parallel_kernel
def look_up(buffer, centre, towards, across, spacing, first, slope):
    """Fill rows of `slope` from the aligned buffer, bilinearly over the samples that exist.

    Here `towards` and `across` are metres a (row, column), the inverse of those of the sweep.
    """
    lines, samples = buffer.shape
    for i in prange(slope.shape[0]):
        for c in range(slope.shape[1]):
            row = first + i - centre[0]
            column = c - centre[1]
            q = samples // 2 - (towards[0] * row + towards[1] * column) / spacing
            p = lines // 2 + (across[0] * row + across[1] * column) / spacing
            p0 = math.floor(p)
            q0 = math.floor(q)
            total = 0.0
            weight = 0.0
            for a in range(2):
                for b in range(2):
                    pa = p0 + a
                    qb = q0 + b
                    share = (1.0 - abs(p - pa)) * (1.0 - abs(q - qb))
                    if share > EPS and 0 <= pa < lines and 0 <= qb < samples:
                        value = buffer[pa, qb]
                        if np.isfinite(value):
                            total += share * value
                            weight += share
            slope[i, c] = total / weight if weight > 0.0 else -np.inf
