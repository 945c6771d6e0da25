"""The surface between pixel centres, and where a point of view space falls on the image.

The surface is kept as nearness: 1/z in perspective and -z in orthographic projection. Both are
linear over the image of a plane, and both grow towards the eye.
"""

import numpy as np

from adret._kernels.jit import inline, parallel_kernel, prange

HALF_PIXEL = 0.5
ROUNDING = 2.0**-22


@parallel_kernel
def to_nearness(depth, perspective, nearness):
    """Fill `nearness`, float32; NaN stays."""
    for row in prange(depth.shape[0]):
        for column in range(depth.shape[1]):
            z = depth[row, column]
            nearness[row, column] = np.float32(1.0) / z if perspective else -z


@inline
def nearness_of(perspective, z):
    """Nearness of a depth."""
    return 1.0 / z if perspective else -z


@inline
def behind(perspective, z, surface):
    """Whether a depth lies behind the surface by more than the rounding of float32 depths."""
    return nearness_of(perspective, z) + ROUNDING * abs(surface) < surface


@inline
def spread(perspective, z):
    """What image coordinates are multiplied by at depth z to become view space."""
    return z if perspective else 1.0


@inline
def inside(nearness, row, column):
    """Whether a place, in pixel centres, lies on the image."""
    return (
        row >= -HALF_PIXEL
        and column >= -HALF_PIXEL
        and row < nearness.shape[0] - HALF_PIXEL
        and column < nearness.shape[1] - HALF_PIXEL
    )


@inline
def surface_at(nearness, row, column):
    """Bilinear nearness at a place on the image; beside NaN that of the nearest pixel.

    In the outer half of the outermost pixels the bilinear patch goes on.
    """
    # Inside, 1 + row is above 0: the conversion rounds down.
    top = max(min(np.int64(row + 1.0) - 1, nearness.shape[0] - 2), 0)
    left = max(min(np.int64(column + 1.0) - 1, nearness.shape[1] - 2), 0)
    bottom = min(top + 1, nearness.shape[0] - 1)
    right = min(left + 1, nearness.shape[1] - 1)
    down = row - top
    across = column - left
    upper = nearness[top, left] + across * (nearness[top, right] - nearness[top, left])
    lower = nearness[bottom, left] + across * (nearness[bottom, right] - nearness[bottom, left])
    value = upper + down * (lower - upper)
    if value != value:
        value = np.float64(
            nearness[bottom if down > HALF_PIXEL else top, right if across > HALF_PIXEL else left]
        )
    return value
