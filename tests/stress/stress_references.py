"""Fields that are hard on arithmetic, and horizons in long double that share no code with Adret."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

SNAP = 1e-9  # cells: a crossing this near to a cell's centre is the centre
ANGLES = np.array(
    [0.0, math.pi / 2, math.pi, math.pi / 4, 3 * math.pi / 4 - 1e-12, 1e-12, 0.3, 2.2, 4.0, 5.5]
)
"""Axes, diagonals, azimuths beside them by less than can be told, and oblique ones [radians]."""


def fields(rows: int = 18, columns: int = 22) -> dict[str, NDArray[np.float64]]:
    """Shapes of heights from about -1 to 1, by name."""
    rng = np.random.default_rng(5)
    rough = rng.standard_normal((rows, columns)).cumsum(axis=0).cumsum(axis=1)
    row, column = np.mgrid[0:rows, 0:columns].astype(np.float64)
    return {
        "rough": rough / np.ptp(rough),
        "flat": np.zeros((rows, columns)),
        "plane": (3.0 * column - 2.0 * row) / 64.0,
        "cliff": np.where(column > columns // 2, 1.0, 0.0),
        "spike": np.where((row == rows // 2) & (column == columns // 2), 1.0, 0.0),
        "towers": np.where(rng.random((rows, columns)) < 0.05, 1.0, 0.0),
        "comb": column % 2,
        "stairs": np.floor(column / 3.0) / 8.0,
        "noise": rng.random((rows, columns)),
    }


def _shifted(z: NDArray[np.longdouble], down: int, right: int) -> NDArray[np.longdouble]:
    """``z[row + down, column + right]`` at every cell, NaN outside."""
    rows, columns = z.shape
    out = np.full(z.shape, np.nan, np.longdouble)
    if abs(down) < rows and abs(right) < columns:
        to = (
            slice(max(0, -down), rows - max(0, down)),
            slice(max(0, -right), columns - max(0, right)),
        )
        here = (
            slice(max(0, down), rows - max(0, -down)),
            slice(max(0, right), columns - max(0, -right)),
        )
        out[to] = z[here]
    return out


def slopes(
    heights: ArrayLike, cell_size: tuple[float, float], azimuths: ArrayLike
) -> NDArray[np.longdouble]:
    """Tangent of the horizon of every cell, shape (K, rows, columns); -inf where nothing lies.

    The maximum over all crossings of a cell's ray with the lines through cell centres, where the
    height is interpolated between the two centres beside; a crossing beside nodata does not count.
    """
    z = np.asarray(heights).astype(np.longdouble)
    dx, dy = cell_size
    found = []
    for azimuth in np.atleast_1d(azimuths):
        down, right = -math.cos(azimuth) / dy, math.sin(azimuth) / dx
        # A direction this near to an axis, in cells, is the axis.
        large = max(abs(down), abs(right))
        down = 0.0 if abs(down) < SNAP * large else down
        right = 0.0 if abs(right) < SNAP * large else right
        best = np.full(z.shape, -np.inf, np.longdouble)
        for by_row in (True, False):
            along, across = (down, right) if by_row else (right, down)
            if along == 0.0:
                continue
            sign = 1 if along > 0.0 else -1
            for j in range(1, z.shape[0] if by_row else z.shape[1]):
                distance = np.longdouble(j) / abs(np.longdouble(along))
                position = float(np.longdouble(across) * distance)
                low = math.floor(position + SNAP)
                share = position - low if position - low > SNAP else 0.0
                if by_row:
                    height = _shifted(z, sign * j, low)
                    beside = _shifted(z, sign * j, low + 1)
                else:
                    height = _shifted(z, low, sign * j)
                    beside = _shifted(z, low + 1, sign * j)
                if share > 0.0:
                    height = height * (1.0 - share) + beside * share
                best = np.fmax(best, (height - z) / distance)
        best[np.isnan(z)] = np.nan
        found.append(best)
    return np.stack(found)
