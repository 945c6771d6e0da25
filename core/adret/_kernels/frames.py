"""Copies between the north-up raster and the sweep frame (see `adret.sweep`)."""

from typing import Any

import numpy as np

from adret._kernels.angles import atan_slope
from adret._kernels.jit import first_rows, helper, index, shared_kernel
from adret._kernels.vectors import turn_eight

TILE = 32  # a tile of both arrays fits the first-level cache while rows turn into columns


@helper
def _transpose_tile(source, target, i0, i1, j0, j1, flip_i, flip_j):
    n, m = target.shape
    eights_i = i0 + (i1 - i0) // 8 * 8
    eights_j = j0 + (j1 - j0) // 8 * 8
    for i in range(i0, eights_i, 8):
        column = n - 8 - i if flip_i else i
        first, step = (i + 7, -1) if flip_i else (i, 1)
        for j in range(j0, eights_j, 8):
            row, row_step = (m - 1 - j, -1) if flip_j else (j, 1)
            turn_eight(source, row, row_step, column, target, first, step, j)
    for i in range(i0, i1):
        column = index(n - 1 - i if flip_i else i)
        for j in range(eights_j if i < eights_i else j0, j1):
            target[i, j] = source[index(m - 1 - j if flip_j else j), column]


def _bands(source: Any, target: Any, *_: Any) -> int:
    return -(-len(target) // TILE)


@helper
def _turn_band(source, target, i0, i1, swap, flip_rows, flip_columns):
    n, m = target.shape
    if swap:
        for j0 in range(0, m, TILE):
            j1 = min(m, j0 + TILE)
            _transpose_tile(source, target, i0, i1, j0, j1, flip_rows, flip_columns)
        return
    for i in range(i0, i1):
        line = source[n - 1 - i if flip_rows else i]
        row = target[i]
        if flip_columns:
            for j in range(m):
                row[index(j)] = line[index(m - 1 - j)]
        else:
            for j in range(m):
                row[index(j)] = line[index(j)]


@shared_kernel(_bands)
def copy_oriented(start, stop, source, target, swap, flip_rows, flip_columns):
    """Fill `target` with `source`, transposed if `swap`, then flipped along target rows, columns.

    ``target[i, j] = source'[i or n-1-i, j or m-1-j]`` where source' is source or its transpose.
    """
    for i0 in range(start * TILE, min(stop * TILE, len(target)), TILE):
        i1 = min(len(target), i0 + TILE)
        _turn_band(source, target, i0, i1, swap, flip_rows, flip_columns)


@shared_kernel(_bands)
def angles_oriented(start, stop, source, target, swap, flip_rows, flip_columns):
    """As `copy_oriented`, of slopes, and write their elevation angles [radians].

    A band's angles are taken while it is in the cache: one pass over memory instead of two.
    """
    for i0 in range(start * TILE, min(stop * TILE, len(target)), TILE):
        i1 = min(len(target), i0 + TILE)
        _turn_band(source, target, i0, i1, swap, flip_rows, flip_columns)
        for i in range(i0, i1):
            row = target[i]
            for j in range(len(row)):
                row[j] = atan_slope(row[j])


@shared_kernel(first_rows)
def mask_nodata(start, stop, heights, layer):
    """Set `layer` to NaN where `heights` is NaN."""
    for i in range(start, stop):
        z = heights[i]
        row = layer[i]
        for j in range(row.shape[0]):
            row[j] = row[j] if z[j] == z[j] else np.float32(np.nan)


@shared_kernel(first_rows)
def to_elevation(start, stop, slope, elevation):
    """Elevation angle [radians] of each slope; NaN stays, -inf becomes -π/2."""
    for i in range(start, stop):
        s = slope[i]
        row = elevation[i]
        for j in range(row.shape[0]):
            row[j] = atan_slope(s[j])
