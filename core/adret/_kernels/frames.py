"""Copies between the north-up raster and the sweep frame (see `adret.sweep`)."""

import numpy as np

from adret._kernels.angles import atan_slope
from adret._kernels.jit import kernel, parallel_kernel, prange

TILE = 32  # a tile of both arrays fits the first-level cache while rows turn into columns


@kernel
def _copy_tile(source, target, i0, i1, j0, j1, swap, flip_i, flip_j):
    n, m = target.shape
    for i in range(i0, i1):
        si = n - 1 - i if flip_i else i
        row = target[i]
        if swap:
            for j in range(j0, j1):
                row[j] = source[m - 1 - j if flip_j else j, si]
        else:
            line = source[si]
            for j in range(j0, j1):
                row[j] = line[m - 1 - j if flip_j else j]


@parallel_kernel
def copy_oriented(source, target, swap, flip_rows, flip_columns):
    """Fill `target` with `source`, transposed if `swap`, then flipped along target rows, columns.

    ``target[i, j] = source'[i or n-1-i, j or m-1-j]`` where source' is source or its transpose.
    """
    n, m = target.shape
    for band in prange((n + TILE - 1) // TILE):
        i0 = band * TILE
        i1 = min(n, i0 + TILE)
        for j0 in range(0, m, TILE):
            _copy_tile(source, target, i0, i1, j0, min(m, j0 + TILE), swap, flip_rows, flip_columns)


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
