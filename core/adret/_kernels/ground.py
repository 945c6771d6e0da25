"""Blocks of ground that a sweep need not look at: without data, or level as far as a ray runs.

`low` and `high` are the lowest and highest heights of blocks of `SIDE` x `SIDE` cells in the sweep
frame; `low` is NaN where any cell is nodata, `high` where every one is. The first block begins
`corner` cells before the raster.
"""

import numpy as np

from adret._kernels.jit import inline

SIDE = 32
ORDINARY, EMPTY, LEVEL = 0, 1, 2


@inline
def kind_of_block(low, high, corner, row, column, reach):
    """What can be said of the block that contains a cell, and of all that its rays pass.

    Rays run up to ``reach`` rows and columns towards smaller ones; `LEVEL` is a block whose
    receivers see nothing but their own height, and the raster's end nowhere.
    """
    r, c = (row + corner[0]) // SIDE, (column + corner[1]) // SIDE
    height = high[r, c]
    if np.isnan(height):
        return EMPTY
    if low[r, c] != height:
        return ORDINARY
    top, left = r * SIDE - reach[0], c * SIDE - reach[1]
    if top < corner[0] or left < corner[1]:
        return ORDINARY
    for i in range(top // SIDE, r + 1):
        for j in range(left // SIDE, c + 1):
            if low[i, j] != height or high[i, j] != height:
                return ORDINARY
    return LEVEL


@inline
def without_empty_ends(high, corner, row, first, end):
    """Columns `first` to `end` of a row, without the blocks at both ends that show no ground."""
    r = (row + corner[0]) // SIDE
    while first < end and np.isnan(high[r, (first + corner[1]) // SIDE]):
        first = ((first + corner[1]) // SIDE + 1) * SIDE - corner[1]
    while end > first and np.isnan(high[r, (end - 1 + corner[1]) // SIDE]):
        end = (end - 1 + corner[1]) // SIDE * SIDE - corner[1]
    return first, end
