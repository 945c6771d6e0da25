"""Separation of directions over 3 x 3 pixels, and the noise that shifts lines (P4, 10 and 11.1)."""

import numpy as np

from adret._kernels.jit import kernel, parallel_kernel, prange
from adret._kernels.screen.noise import uniform

NORMAL_LIMIT = np.float32(0.5)
DEPTH_LIMIT = np.float32(0.03)
ZERO = np.float32(0.0)
ONE = np.float32(1.0)


@kernel
def mark_like(a, b, c, other_a, other_b, other_c, like):
    """1 where two normals are less than 60° apart, else 0."""
    for x in range(len(like)):
        along = a[x] * other_a[x] + b[x] * other_b[x] + c[x] * other_c[x]
        like[x] = ONE if along > NORMAL_LIMIT else ZERO


@kernel
def keep_near(z, other, like):
    """0 where two depths differ by more than the limit, else what was there."""
    for x in range(len(like)):
        like[x] = like[x] if abs(other[x] - z[x]) < DEPTH_LIMIT * z[x] else ZERO


@kernel
def add_where(values, like, total):
    """Add what is of like surface."""
    for x in range(len(total)):
        total[x] += values[x] if like[x] > ZERO else ZERO


@parallel_kernel
def gather(
    depth, normal, frame, closed_near, whole_near, closed, whole, unknown, occlusion, confidence
):
    """Fill the frame: each pixel's near field, and the far field of the 3 x 3 pixels about it.

    Of these count whose normal is less than 60° away (cosine above `NORMAL_LIMIT`) and whose depth
    differs by less than `DEPTH_LIMIT` of the pixel's own, P4's limits. Inputs are of the whole
    image, the outputs of the frame.
    """
    row0, row1, column0, column1 = frame
    width = column1 - column0
    for row in prange(row0, row1):
        like = np.empty(width, dtype=np.float32)
        sums = np.zeros((3, width), dtype=np.float32)
        for k in range(9):
            r = row + k // 3 - 1
            side = k % 3 - 1
            if not row0 <= r < row1:
                continue
            start = max(0, -side)
            stop = width - max(0, side)
            here = slice(column0 + start, column0 + stop)
            there = slice(column0 + start + side, column0 + stop + side)
            mark_like(
                normal[0, row, here],
                normal[1, row, here],
                normal[2, row, here],
                normal[0, r, there],
                normal[1, r, there],
                normal[2, r, there],
                like[start:stop],
            )
            keep_near(depth[row, here], depth[r, there], like[start:stop])
            add_where(closed[r, there], like[start:stop], sums[0, start:stop])
            add_where(whole[r, there], like[start:stop], sums[1, start:stop])
            add_where(unknown[r, there], like[start:stop], sums[2, start:stop])
        frame_row = row - row0
        for x in range(width):
            near = whole_near[row, column0 + x]
            value = sums[0, x] / sums[1, x]
            value += closed_near[row, column0 + x] / near if near > ZERO else ZERO
            occlusion[frame_row, x] = value
            confidence[frame_row, x] = ONE - sums[2, x] / sums[1, x]


@parallel_kernel
def fill_jitter(origin, seed, jitter):
    """Fill with noise between -1/2 and 1/2."""
    for row in prange(jitter.shape[0]):
        for column in range(jitter.shape[1]):
            noise = uniform(row + origin[0], column + origin[1], seed, 0)
            jitter[row, column] = np.float32(noise - 0.5)
