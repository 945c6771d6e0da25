"""Points of a sector from mipmaps of nearness (P4, section 5), for comparison."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adret._kernels.jit import kernel
from adret._kernels.screen.far_field_block import ASIDE, HEIGHT, PLACE, SHARE

GROWTH = 1.5
"""Each step is so much longer than the one before (P4)."""
SCARCE = 1e-3


class Mipmaps(NamedTuple):
    """Means over 2^v by 2^v pixels, the levels one after another in flat arrays.

    Attributes
    ----------
    starts : ndarray, (levels + 1,), int64
        Where a level begins in the arrays.
    widths : ndarray, (levels,), int64
        Columns of a level.
    height : ndarray, float32
        Mean nearness of the pixels that show a surface.
    share : ndarray, float32
        How much of the pixels show one.
    """

    starts: NDArray[np.int64]
    widths: NDArray[np.int64]
    height: NDArray[np.float32]
    share: NDArray[np.float32]


@kernel
def ways_of(start, reach, ways):
    """Fill `ways` [rows] with where samples lie; the first one is where the near field ends."""
    way = 1.0
    step = 1.0
    found = 1
    ways[0] = start
    while way < reach and found < len(ways):
        if way > start:
            ways[found] = way
            found += 1
        step *= GROWTH
        way += step
    return found


@kernel
def sample(mipmaps, level, row, column):
    """Sum of nearness and share of the four texels about a place, bilinear."""
    width = mipmaps.widths[level]
    start = mipmaps.starts[level]
    height = (mipmaps.starts[level + 1] - start) // width
    scale = 1.0 / (1 << level)
    y = min(max((row + 0.5) * scale - 0.5, 0.0), height - 1.0)
    x = min(max((column + 0.5) * scale - 0.5, 0.0), width - 1.0)
    top = int(y)
    left = int(x)
    total = 0.0
    share = 0.0
    for k in range(4):
        r = min(top + k // 2, height - 1)
        c = min(left + k % 2, width - 1)
        a = y - top if k // 2 else 1.0 - (y - top)
        b = x - left if k % 2 else 1.0 - (x - left)
        at = start + r * width + c
        part = a * b * mipmaps.share[at]
        if part > 0.0:
            total += part * mipmaps.height[at]
            share += part
    return total, share


@kernel
def mipmap_points(w, mipmaps, shape, row, sign, before, way, slope, wedge, first, step, count):
    """Trilinear samples `way` rows away, at the image's edge where that lies between.

    The level is the one whose texels are as wide as a sector of angle `wedge` there.
    """
    rows, columns = shape
    levels = len(mipmaps.widths)
    stretch = np.sqrt(1.0 + slope * slope)
    for i in range(count):
        column = first + step * i
        to = sign * slope
        border = float(rows - 1 - row if sign > 0 else row)
        side = columns - 1 - column if to > 0.0 else column
        if side < border * abs(to):
            border = side / abs(to)
        w[ASIDE + i] = np.float32(0.0)
        w[HEIGHT + i] = -np.inf
        w[PLACE + i] = np.nan
        w[SHARE + i] = np.float32(1.0)
        if border <= before:
            continue
        here = min(way, border)
        level = np.log2(max(1.0, here * stretch * wedge))
        level = min(level, levels - 1.0)
        lower = min(int(level), max(levels - 2, 0))
        upper = min(lower + 1, levels - 1)
        blend = level - lower
        y = row + sign * here
        x = column + here * to
        a, p = sample(mipmaps, lower, y, x)
        b, q = sample(mipmaps, upper, y, x)
        share = (1.0 - blend) * p + blend * q
        if share > SCARCE:
            w[HEIGHT + i] = np.float32(((1.0 - blend) * a + blend * b) / share)
            w[PLACE + i] = np.float32(y)
            w[SHARE + i] = np.float32(share)
