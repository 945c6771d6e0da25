"""Copies between the north-up raster and the sweep frame (see `adret.sweep`)."""

import numpy as np

from adret._kernels.angles import atan_slope
from adret._kernels.jit import index, kernel, parallel_kernel, prange

TILE = 32  # a tile of both arrays fits the first-level cache while rows turn into columns


@kernel
def _transpose_tile(source, target, i0, i1, j0, j1, flip_i, flip_j):
    n, m = target.shape
    for i in range(i0, i1):
        column = index(n - 1 - i if flip_i else i)
        row = target[i]
        if flip_j:
            for j in range(j0, j1):
                row[index(j)] = source[index(m - 1 - j), column]
        else:
            for j in range(j0, j1):
                row[index(j)] = source[index(j), column]


@parallel_kernel
def copy_oriented(source, target, swap, flip_rows, flip_columns):
    """Fill `target` with `source`, transposed if `swap`, then flipped along target rows, columns.

    ``target[i, j] = source'[i or n-1-i, j or m-1-j]`` where source' is source or its transpose.
    """
    n, m = target.shape
    for band in prange((n + TILE - 1) // TILE):
        i0 = band * TILE
        i1 = min(n, i0 + TILE)
        if swap:
            for j0 in range(0, m, TILE):
                j1 = min(m, j0 + TILE)
                _transpose_tile(source, target, i0, i1, j0, j1, flip_rows, flip_columns)
            continue
        for i in range(i0, i1):
            line = source[n - 1 - i if flip_rows else i]
            row = target[i]
            if flip_columns:
                for j in range(m):
                    row[index(j)] = line[index(m - 1 - j)]
            else:
                for j in range(m):
                    row[index(j)] = line[index(j)]


@parallel_kernel
def mask_nodata(heights, layer):
    """Set `layer` to NaN where `heights` is NaN."""
    for i in prange(layer.shape[0]):
        z = heights[i]
        row = layer[i]
        for j in range(row.shape[0]):
            row[j] = row[j] if z[j] == z[j] else np.float32(np.nan)


@parallel_kernel
def to_elevation(slope, elevation):
    """Elevation angle [radians] of each slope; NaN stays, -inf becomes -π/2."""
    for i in prange(slope.shape[0]):
        s = slope[i]
        row = elevation[i]
        for j in range(row.shape[0]):
            row[j] = atan_slope(s[j])
