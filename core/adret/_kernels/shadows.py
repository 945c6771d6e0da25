"""Shadow codes of one sun from one layer of horizon slopes."""

import numpy as np

from adret._kernels.jit import first_rows, shared_kernel

LIT = np.uint8(0)
SELF_SHADOWED = np.uint8(1)
CAST_SHADOW = np.uint8(2)
MASKED = np.uint8(3)


@shared_kernel(first_rows)
def shadow_codes(start, stop, slope, to_east, to_north, sin_azimuth, cos_azimuth, sun_slope, code):
    """Compare the sun's centre, of slope tan(elevation), with the cell's plane and its horizon."""
    for y in range(start, stop):
        layer = slope[y]
        p = to_east[y]
        q = to_north[y]
        out = code[y]
        for x in range(len(out)):
            tp = p[x] * sin_azimuth + q[x] * cos_azimuth
            cast = CAST_SHADOW if layer[x] >= sun_slope else LIT
            lit = SELF_SHADOWED if tp >= sun_slope else cast
            out[x] = lit if layer[x] == layer[x] else MASKED
