"""Weight of an occluder by its distance, as kernels evaluate it."""

import numpy as np

from adret._kernels.jit import inline

NONE = 0
HARD = 1
QUADRATIC = 2
TIMONEN = 3
TABLE = 4


@inline
def weight(code, radius, scale, table, d):
    """W(d): 0 from the radius on; `table` holds W over u = d/(d + scale) in [0, 1]."""
    w = 1.0
    if not d < radius:
        w = 0.0
    elif code == QUADRATIC:
        q = d / radius
        w = 1.0 - q * q
    elif code == TIMONEN:
        w = scale / (scale + d * d)
    elif code == TABLE:
        at = d / (d + scale) * (len(table) - 1)
        low = min(np.int64(at), len(table) - 2)
        w = table[low] + (at - low) * (table[low + 1] - table[low])
    return w


@inline
def in_singles(falloff):
    """Give the five numbers of a rational falloff (see `lsao_hulls.cast`) as float32."""
    return (
        np.float32(falloff[0]),
        np.float32(falloff[1]),
        np.float32(falloff[2]),
        np.float32(falloff[3]),
        np.float32(falloff[4]),
    )
