"""Separation of directions over 3 x 3 pixels, and the noise that shifts lines (P4, 10 and 11.1)."""

import numpy as np

from adret._kernels.jit import parallel_kernel, prange
from adret._kernels.screen.noise import uniform

NORMAL_LIMIT = 0.5
DEPTH_LIMIT = 0.03


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
    for row in prange(row0, row1):
        for column in range(column0, column1):
            z = depth[row, column]
            far = 0.0
            most = 0.0
            lost = 0.0
            for k in range(9):
                r = row + k // 3 - 1
                c = column + k % 3 - 1
                if not (row0 <= r < row1 and column0 <= c < column1):
                    continue
                along = (
                    normal[0, r, c] * normal[0, row, column]
                    + normal[1, r, c] * normal[1, row, column]
                    + normal[2, r, c] * normal[2, row, column]
                )
                if along > NORMAL_LIMIT and abs(depth[r, c] - z) < DEPTH_LIMIT * z:
                    far += closed[r, c]
                    most += whole[r, c]
                    lost += unknown[r, c]
            value = far / most
            if whole_near[row, column] > 0.0:
                value += closed_near[row, column] / whole_near[row, column]
            occlusion[row - row0, column - column0] = value
            confidence[row - row0, column - column0] = 1.0 - lost / most


@parallel_kernel
def fill_jitter(origin, seed, jitter):
    """Fill with noise between -1/2 and 1/2."""
    for row in prange(jitter.shape[0]):
        for column in range(jitter.shape[1]):
            noise = uniform(row + origin[0], column + origin[1], seed, 0)
            jitter[row, column] = np.float32(noise - 0.5)
