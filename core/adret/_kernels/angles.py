"""Angles from slopes in float32, without branches, so that loops over cells vectorise."""

import numpy as np

from adret._kernels.jit import inline

# Minimax fit of atan(x) on [0, 1] by x·P(x²), relative error 9e-8 before rounding.
C1 = np.float32(0.9999999114136624)
C3 = np.float32(-0.33332093512496885)
C5 = np.float32(0.1997137514665452)
C7 = np.float32(-0.14029419765883472)
C9 = np.float32(0.09942759462693711)
C11 = np.float32(-0.059904718320744114)
C13 = np.float32(0.024557126937525712)
C15 = np.float32(-0.004780456166712092)
ONE = np.float32(1.0)
HALF_PI = np.float32(np.pi / 2.0)


@inline
def atan_slope(slope):
    """Elevation angle [radians] of a float32 slope: ±π/2 at ±inf, NaN at NaN, error < 2e-7."""
    size = abs(slope)
    steep = size > ONE
    # One division serves both sides of 45°: x = min(|t|, 1) / max(|t|, 1).
    x = (ONE if steep else size) / (size if steep else ONE)
    q = x * x
    p = C15
    p = p * q + C13
    p = p * q + C11
    p = p * q + C9
    p = p * q + C7
    p = p * q + C5
    p = p * q + C3
    p = p * q + C1
    angle = p * x
    angle = HALF_PI - angle if steep else angle
    return -angle if slope < np.float32(0.0) else angle
