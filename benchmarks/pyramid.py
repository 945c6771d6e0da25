"""Horizons over a pyramid of the heights, as game and GIS tools shorten their marches.

Prior work to compare with: each cell marches along its own ray, and the further it looks, the
coarser the level that it samples and the longer its steps, so that a ray costs `span` samples an
octave of distance. Snyder and Nowrouzezahrai (2008) blend such levels, SAGA's "multi scale" and
RVT's sky illumination go the same way; P1 compares itself with it. Written from that description.
"""

import math

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

Levels = tuple[NDArray[np.float32], ...]


def levels_of(heights: NDArray[np.float32]) -> Levels:
    """Means of 2 x 2, 4 x 4, ... cells, down to a level of two cells or fewer on a side."""
    levels = [np.ascontiguousarray(heights, np.float32)]
    while min(levels[-1].shape) > 2:
        z = levels[-1]
        even = np.pad(z, [(0, n % 2) for n in z.shape], mode="edge")
        quarters = (even[::2, ::2], even[::2, 1::2], even[1::2, ::2], even[1::2, 1::2])
        levels.append(np.mean(quarters, axis=0, dtype=np.float32))
    return tuple(levels)


def pyramid_slopes(
    levels: Levels, cell_size: tuple[float, float], azimuth: float, span: int
) -> NDArray[np.float32]:
    """Largest slope towards an azimuth (no nodata), -inf where nothing lies that way.

    `span` is the number of samples with which the distance doubles; the first 2·span lie on the
    heights themselves.
    """
    dx, dy = cell_size
    across, down = math.sin(azimuth) / dx, -math.cos(azimuth) / dy
    longest = max(abs(across), abs(down))
    flat = np.concatenate([z.ravel() for z in levels])
    shapes = np.array([z.shape for z in levels], np.int32)
    starts = np.cumsum([0, *(z.size for z in levels)], dtype=np.int32)
    slopes = np.empty(levels[0].shape, np.float32)
    steps = (down / longest, across / longest, 1.0 / longest)
    _march(flat, shapes, starts, *steps, span, slopes)
    return slopes


@njit(parallel=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _march(flat, shapes, starts, down, across, length, span, slopes):  # type: ignore[no-untyped-def]
    rows, columns = slopes.shape
    for i in prange(rows):
        for j in range(columns):
            height = flat[i * columns + j]
            best = np.float32(-np.inf)
            # Samples until the ray leaves the raster.
            to_row = i if down < 0.0 else rows - 1 - i
            to_column = j if across < 0.0 else columns - 1 - j
            end = min(to_row / max(abs(down), 1e-9), to_column / max(abs(across), 1e-9)) + 1e-9
            at, count = 1.0, 2 * span
            for level in range(len(shapes)):
                if at > end:
                    break
                scale = 2.0**level
                m, n, first = shapes[level, 0], shapes[level, 1], starts[level]
                if level + 1 == len(shapes):
                    count = 1 << 30
                count = min(count, int((end - at) / scale) + 1)
                # Centres of a level's cells lie between those of the level below.
                v = np.float32((i + at * down + 0.5) / scale - 0.5)
                u = np.float32((j + at * across + 0.5) / scale - 0.5)
                way = np.float32(at * length)
                step = np.float32(scale * length)
                dv, du = np.float32(down), np.float32(across)
                for k in range(count):
                    f = np.float32(k)
                    y, x = max(v + f * dv, np.float32(0.0)), max(u + f * du, np.float32(0.0))
                    v0, u0 = min(np.int32(y), m - 1), min(np.int32(x), n - 1)
                    v1, u1 = min(v0 + 1, m - 1), min(u0 + 1, n - 1)
                    b, a = y - np.float32(v0), x - np.float32(u0)
                    upper, lower = first + v0 * n, first + v1 * n
                    z0 = flat[upper + u0] + a * (flat[upper + u1] - flat[upper + u0])
                    z1 = flat[lower + u0] + a * (flat[lower + u1] - flat[lower + u0])
                    best = max(best, (z0 + b * (z1 - z0) - height) / (way + f * step))
                at += count * scale
                count = span
            slopes[i, j] = best
