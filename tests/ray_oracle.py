"""What one cell sees along its own ray, in the words of the definition; shares no code with adret.

Samples are the crossings of the ray with the grid lines across its larger component in cells; all
crossings hide, those with the other lines too.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

import oracles

Array = NDArray[np.float64]
RELATIVE = 1e-12  # of a distance: two crossings this near are one
TIE = 1e-12  # slopes this near are equal


def seen_samples(
    heights: ArrayLike,
    cell_size: tuple[float, float],
    row: int,
    column: int,
    azimuth: float,
    *,
    near: int | None = None,
    max_distance: float = np.inf,
    bend: float = 0.0,
    observer_height: float = 0.0,
) -> tuple[NDArray[np.int64], float, Array]:
    """Steps of the samples seen, length of a step [m], and by how much each is seen.

    The last is the slope of each sample less that of the line of sight it must reach.  Beyond
    `near` steps, if given, only samples hide.  `bend` is the surface's drop a square metre of way.
    """
    z = np.asarray(heights, dtype=np.float64)
    east, north = abs(np.sin(azimuth)) / cell_size[0], abs(np.cos(azimuth)) / cell_size[1]
    step = 1.0 / max(east, north)
    if np.isnan(z[row, column]):
        return np.empty(0, np.int64), step, np.empty(0)
    way, height = oracles.ray_crossings(z, cell_size, row, column, azimuth, max_distance)
    slope = (height - z[row, column] - observer_height) / way - bend * way
    steps = way / step
    sample = abs(steps - np.round(steps)) < 1e-9 * np.maximum(steps, 1.0)
    # A crossing with the other lines may fall on one of these too: a vertex, listed twice.
    vertex = np.r_[False, np.diff(way) <= RELATIVE * way[1:]] if way.size else np.empty(0, bool)
    hides = sample if near is None else sample | (steps <= near)
    hides = np.ones_like(sample) if near is None else hides
    top = np.maximum.accumulate(np.r_[-np.inf, np.where(hides, slope, -np.inf)])[:-1]
    counted = sample & ~vertex
    margin = np.where(np.isinf(top), np.inf, slope - top)[counted]
    seen = margin >= -TIE
    return np.round(steps[counted]).astype(np.int64)[seen], step, margin


def runs(steps: NDArray[np.int64]) -> NDArray[np.int64]:
    """Last members of the runs of consecutive numbers."""
    return steps[np.diff(steps, append=-1) != 1]
