"""Angles from slopes and back in float32, without branches, so that loops over cells vectorise."""

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
# Minimax fit of tan(x) on [0, π/4] by x·P(x²), relative error 2e-8 before rounding.
T1 = np.float32(1.000000016337738)
T3 = np.float32(0.33333075992442435)
T5 = np.float32(0.1333989091464617)
T7 = np.float32(0.05334912882661603)
T9 = np.float32(0.024600873361827143)
T11 = np.float32(0.0028957557901511874)
T13 = np.float32(0.009498288996338505)
ZERO = np.float32(0.0)
ONE = np.float32(1.0)
QUARTER_PI = np.float32(np.pi / 4.0)
HALF_PI_TAIL = np.float32(np.pi / 2.0 - float(np.float32(np.pi / 2.0)))
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
    return -angle if slope < ZERO else angle


@inline
def slope_of_angle(angle, steepest):
    """Slope of a float32 elevation; ±`steepest` at and beyond ±π/2, NaN at NaN.

    Relative error 3e-7, steeper than 45° in the distance from the vertical.
    """
    size = abs(angle)
    steep = size > QUARTER_PI
    z = (HALF_PI - size) + HALF_PI_TAIL if steep else size
    z = ZERO if z < ZERO else z
    q = z * z
    p = T13
    p = p * q + T11
    p = p * q + T9
    p = p * q + T7
    p = p * q + T5
    p = p * q + T3
    p = p * q + T1
    tangent = p * z
    slope = ONE / tangent if steep else tangent
    slope = steepest if slope > steepest else slope
    return -slope if angle < ZERO else slope
