"""Tables of the obscurance of slabs, for any falloff (P4, section 4)."""

import math

import numpy as np

from adret._kernels.screen.far_field import Table
from adret.screen.falloffs import Falloff
from adret.screen.field import Field

__all__ = ["PLAIN", "slab_table"]

NODES = 65
"""Angles of a row."""
ROWS_LOG2 = 2
"""Rows between two powers of 2 of the squared distance, as a power of 2."""
PARTS = 8
"""Parts between two angles over which integrals are summed."""
SPAN = 2.0**-18
"""Nearest distance of the table, of its farthest; nearer than that W is taken for constant."""

PLAIN = Table(np.zeros(0, dtype=np.float32), 1, np.float32(1.0), 0)
"""Table of the falloff that is 1 at any distance."""


def slab_table(falloff: Falloff, nearest: float, farthest: float) -> Table:
    """Integrals along straight lines at distances between two limits.

    Parameters
    ----------
    falloff : Falloff
    nearest, farthest : float
        Distances of lines from the receiver [view units].

    Returns
    -------
    Table
        Row r, node x, column k: the integral over ψ from 0 to ψ_x of W(b_r / sin ψ) times 1,
        cos 2ψ and sin 2ψ (and 0). Nodes are even in cos ψ / (|cos ψ| + sin ψ) from 1 to -1; the
        squared distances are the float32 whose bits are `base` plus multiples of 1/`scale`.

    Notes
    -----
    Midpoint rule over `PARTS` parts a node, so a falloff that jumps is right to a part's width.

    Examples
    --------
    >>> from adret.screen import make_falloff
    >>> table = slab_table(make_falloff("hard", 1.0), 0.5, 1.0)
    >>> table.values.reshape(-1, table.nodes, 4)[0, -1, 0].round(2)  # π - 2 asin 0.5
    np.float32(2.09)
    """
    shift = 23 - ROWS_LOG2
    low, high = (int(np.float32(b * b).view(np.int32)) >> shift for b in (nearest, farthest))
    squares = (np.arange(low, high + 2, dtype=np.int32) << shift).view(np.float32)
    distance = np.sqrt(squares.astype(np.float64))[:, None]
    node = 1.0 - 2.0 * np.linspace(0.0, 1.0, (NODES - 1) * PARTS + 1)
    psi = np.arctan2(1.0 - np.abs(node), node)
    middle, width = 0.5 * (psi[1:] + psi[:-1]), np.diff(psi)
    weight = falloff.weight(distance / np.sin(middle)) * width
    values = np.zeros((len(squares), NODES, 4))
    for column, factor in enumerate(
        (np.ones_like(middle), np.cos(2.0 * middle), np.sin(2.0 * middle))
    ):
        sums = np.cumsum(weight * factor, axis=1)
        values[:, 1:, column] = sums[:, PARTS - 1 :: PARTS]
    return Table(
        values.astype(np.float32).ravel(), NODES, np.float32(2.0**-shift), int(low) << shift
    )


def table_of(field: Field, falloff: Falloff) -> Table:
    """The table for a field: from a quarter of a pixel to the farthest two points."""
    if falloff.name in ("none", "hard", "quadratic") and math.isinf(falloff.radius):
        return PLAIN
    rows, columns = field.depth.shape
    ax, bx, ay, by = field.rays
    x = np.abs([bx, ax * (columns - 1) + bx])
    y = np.abs([by, ay * (rows - 1) + by])
    wide = math.hypot(x.max(), y.max())
    low, high = float(np.nanmin(field.depth)), float(np.nanmax(field.depth))
    pixel = 0.25 * min(abs(ax), abs(ay)) * (low if field.perspective else 1.0)
    extent = 2.0 * (high * math.hypot(1.0, wide) if field.perspective else high - low + wide)
    farthest = min(max(extent, pixel), falloff.radius)
    return slab_table(falloff, max(min(pixel, farthest), SPAN * farthest), farthest)
