"""Falloffs as the slabs of far-field obscurance take them (P4, section 4)."""

import math

import numpy as np

from adret._kernels.screen.falloffs import NONE, QUADRATIC, TABLE, TIMONEN
from adret._kernels.screen.far_field_slabs import Weights
from adret.screen.falloffs import Falloff
from adret.screen.field import Field

__all__ = ["slab_weights", "weights_of"]

ROWS_LOG2 = 4
"""Values between two powers of 2 of the squared distance, as a power of 2."""
SPAN = 2.0**-18
"""Nearest distance of the table, of its farthest; nearer than that W is taken for constant."""


def slab_weights(falloff: Falloff, nearest: float, farthest: float) -> Weights:
    """W as a formula, or as a table between two distances [view units].

    Examples
    --------
    >>> from adret.screen import make_falloff
    >>> slab_weights(make_falloff("timonen", falloff_scale=4.0), 0.5, 1.0).formula
    array([4., 0., 4., 1.], dtype=float32)
    >>> len(slab_weights(make_falloff(lambda d: 1.0 / (1.0 + d)), 0.5, 1.0).values)
    34
    """
    code = falloff.code
    square = falloff.radius**2
    formulas = {
        QUADRATIC: (square, -1.0, square, 0.0),
        TIMONEN: (falloff.scale, 0.0, falloff.scale, 1.0),
    }
    values = np.zeros(0, dtype=np.float32)
    shift = 23 - ROWS_LOG2
    low = 0
    if code == TABLE:
        low, high = (int(np.float32(d * d).view(np.int32)) >> shift for d in (nearest, farthest))
        squares = (np.arange(low, high + 2, dtype=np.int32) << shift).view(np.float32)
        distance = np.minimum(
            np.sqrt(squares.astype(np.float64)), np.nextafter(falloff.radius, 0.0)
        )
        values = falloff.weight(distance).astype(np.float32)
    return Weights(
        plain=code == NONE and math.isinf(falloff.radius),
        radius=np.float32(falloff.radius),
        formula=np.array(formulas.get(code, (1.0, 0.0, 1.0, 0.0)), dtype=np.float32),
        values=values,
        scale=np.float32(2.0**-shift),
        base=np.int32(low << shift),
    )


def weights_of(field: Field, falloff: Falloff) -> Weights:
    """W for a field: from a quarter of a pixel to the farthest two points."""
    rows, columns = field.depth.shape
    ax, bx, ay, by = field.rays
    x = np.abs([bx, ax * (columns - 1) + bx])
    y = np.abs([by, ay * (rows - 1) + by])
    wide = math.hypot(x.max(), y.max())
    low, high = float(np.nanmin(field.depth)), float(np.nanmax(field.depth))
    pixel = 0.25 * min(abs(ax), abs(ay)) * (low if field.perspective else 1.0)
    extent = 2.0 * (high * math.hypot(1.0, wide) if field.perspective else high - low + wide)
    farthest = min(max(extent, pixel), falloff.radius)
    return slab_weights(falloff, max(min(pixel, farthest), SPAN * farthest), farthest)
