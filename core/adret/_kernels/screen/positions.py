"""Loops of the light-field variant: looking a map up, and holding samples against the surface."""

import numpy as np

from adret._kernels.jit import kernel, parallel_kernel, prange
from adret._kernels.screen.surface import ROUNDING, inside, surface_at


@parallel_kernel
def trilinear(points, low, per_step, table, image):
    """Interpolate `table` (3, p, q, r) at points (3, n); NaN outside of the table.

    Index 0 of the table's axes lies at `low`; `per_step` are steps per length.
    """
    for i in prange(points.shape[1]):
        x = (points[0, i] - low[0]) * per_step[0]
        y = (points[1, i] - low[1]) * per_step[1]
        z = (points[2, i] - low[2]) * per_step[2]
        p, q, r = table.shape[1] - 1, table.shape[2] - 1, table.shape[3] - 1
        if x >= 0.0 and y >= 0.0 and z >= 0.0 and x <= p and y <= q and z <= r:
            a, b, c = min(np.int64(x), p - 1), min(np.int64(y), q - 1), min(np.int64(z), r - 1)
            u, v, w = x - a, y - b, z - c
            for k in range(3):
                t = table[k]
                near = (1.0 - v) * (t[a, b, c] + u * (t[a + 1, b, c] - t[a, b, c])) + v * (
                    t[a, b + 1, c] + u * (t[a + 1, b + 1, c] - t[a, b + 1, c])
                )
                far = (1.0 - v) * (
                    t[a, b, c + 1] + u * (t[a + 1, b, c + 1] - t[a, b, c + 1])
                ) + v * (t[a, b + 1, c + 1] + u * (t[a + 1, b + 1, c + 1] - t[a, b + 1, c + 1]))
                image[k, i] = near + w * (far - near)
        else:
            for k in range(3):
                image[k, i] = np.nan


@kernel
def tested(nearness, row, column, near, neutral):
    """1 for a sample behind the surface, 0 before it, `neutral` beside the image."""
    term = neutral
    if inside(nearness, row, column) and near == near:
        surface = surface_at(nearness, row, column)
        term = 1.0 if near + ROUNDING * abs(surface) < surface else 0.0
    return term


@parallel_kernel
def add_tests(nearness, image, neutral, total, seen):
    """Add a sample of each pixel to `total`, and whether it fell on the image to `seen`.

    `image` (3, rows, columns): column and row from the image's corner, and depth; `nearness`
    (rows, columns) of the whole view is minus depth.
    """
    for i in prange(total.shape[0]):
        for j in range(total.shape[1]):
            row, column = image[1, i, j] - 0.5, image[0, i, j] - 0.5
            total[i, j] += tested(nearness, row, column, -image[2, i, j], neutral)
            seen[i, j] += 1.0 if inside(nearness, row, column) else 0.0
