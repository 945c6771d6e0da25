"""Sums over azimuths of functions of the horizon, one azimuth at a time.

Every kernel reads one layer of horizon slopes t = tan h and adds to `total`. Angles appear only
where the formula holds the angle itself: sin h = t / sqrt(1 + t²), cos² h = 1 / (1 + t²),
½ sin 2h = t / (1 + t²). NaN slopes stay NaN: clips are written so that a comparison with NaN
keeps the slope.
"""

import numpy as np

from adret._kernels.angles import HALF_PI, atan_slope, slope_of_angle
from adret._kernels.jit import first_rows, shared_kernel

ZERO = np.float32(0.0)
ONE = np.float32(1.0)


@shared_kernel(first_rows)
def add_sine(start, stop, slope, total):
    """Add sin max(h, 0)."""
    for y in range(start, stop):
        layer = slope[y]
        out = total[y]
        for x in range(len(out)):
            t = ZERO if layer[x] < ZERO else layer[x]
            out[x] += t / np.sqrt(ONE + t * t)


@shared_kernel(first_rows)
def add_cosine_squared(start, stop, slope, total):
    """Add cos² max(h, 0)."""
    for y in range(start, stop):
        layer = slope[y]
        out = total[y]
        for x in range(len(out)):
            t = ZERO if layer[x] < ZERO else layer[x]
            out[x] += ONE / (ONE + t * t)


@shared_kernel(first_rows)
def add_angle(start, stop, slope, total):
    """Add h [radians]; -π/2 where there is no terrain."""
    for y in range(start, stop):
        layer = slope[y]
        out = total[y]
        for x in range(len(out)):
            out[x] += atan_slope(layer[x])


@shared_kernel(first_rows)
def add_tilted(start, stop, slope, to_east, to_north, sin_azimuth, cos_azimuth, lowest, total):
    """Add one term of Dozier and Frew's eq. 7b over n_u, with e = max(h, hp, floor).

    The plane's own horizon hp has the slope tp = p sin φ + q cos φ, and n_e sin φ + n_n cos φ is
    -n_u tp, so the term over n_u is cos² e - tp (π/2 - e - ½ sin 2e). `lowest` is tan(floor).
    """
    for y in range(start, stop):
        layer = slope[y]
        p = to_east[y]
        q = to_north[y]
        out = total[y]
        for x in range(len(out)):
            tp = p[x] * sin_azimuth + q[x] * cos_azimuth
            t = tp if layer[x] < tp else layer[x]
            t = lowest if t < lowest else t
            cosine2 = ONE / (ONE + t * t)
            out[x] += cosine2 - tp * (HALF_PI - atan_slope(t) - t * cosine2)


@shared_kernel(first_rows)
def slopes_of_angles(start, stop, elevation, steepest, slope):
    """Slopes of elevations [radians]; ±`steepest` at and beyond ±π/2."""
    for y in range(start, stop):
        angle = elevation[y]
        out = slope[y]
        for x in range(len(out)):
            out[x] = slope_of_angle(angle[x], steepest)


@shared_kernel(first_rows)
def drain(start, stop, partial, total):
    """Move the float32 sums of a few azimuths into the float64 total."""
    for y in range(start, stop):
        few = partial[y]
        out = total[y]
        for x in range(len(out)):
            out[x] += few[x]
            few[x] = ZERO
