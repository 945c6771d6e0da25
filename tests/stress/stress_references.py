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


def plane_slopes(
    heights: ArrayLike, cell_size: tuple[float, float]
) -> tuple[NDArray[np.longdouble], NDArray[np.longdouble]]:
    """Rise towards east and north: the mean of the one-sided differences that there are."""
    z = np.asarray(heights).astype(np.longdouble)
    found = []
    for size, (down, right) in zip(cell_size, ((0, 1), (-1, 0)), strict=True):
        ahead, behind = _shifted(z, down, right) - z, z - _shifted(z, -down, -right)
        both = (ahead + behind) / 2.0
        one = np.where(np.isnan(ahead), behind, ahead)
        rise = np.where(np.isnan(both), one, both)
        found.append(np.where(np.isnan(rise) & ~np.isnan(z), 0.0, rise) / size)
    return found[0], found[1]


def moment(slope: NDArray[np.longdouble], plane: NDArray[np.longdouble]) -> NDArray[np.longdouble]:
    """∫ (sin e - plane·cos e) cos e de from atan(slope) to the zenith."""
    # The angle down from the zenith, without the rounding of π/2 - e.
    left = np.arctan2(np.ones_like(slope), slope)
    cosine, sine = np.sin(left), np.cos(left)
    # π/2 - e - sin e cos e cancels near the zenith: there its series.
    gap = np.where(left < 1e-3, 2.0 / 3.0 * left**3 - 2.0 / 15.0 * left**5, left - sine * cosine)
    return (cosine**2 - plane * gap) / 2.0


def _rays(
    z: NDArray[np.longdouble], cell_size: tuple[float, float], azimuth: float
) -> list[tuple[np.longdouble, bool, tuple[tuple[int, int, float], ...]]]:
    """Crossings of a cell's ray by distance: (way, whether across its larger axis, cells beside).

    The cells beside are (rows down, columns right, weight).
    """
    dx, dy = cell_size
    down, right = -math.cos(azimuth) / dy, math.sin(azimuth) / dx
    large = max(abs(down), abs(right))
    down = 0.0 if abs(down) < SNAP * large else down
    right = 0.0 if abs(right) < SNAP * large else right
    found = []
    for by_row in (True, False):
        along, across = (down, right) if by_row else (right, down)
        if along == 0.0:
            continue
        sign = 1 if along > 0.0 else -1
        for j in range(1, z.shape[0] if by_row else z.shape[1]):
            way = np.longdouble(j) / abs(np.longdouble(along))
            position = float(np.longdouble(across) * way)
            low = math.floor(position + SNAP)
            share = position - low if position - low > SNAP else 0.0
            beside = [(low, 1.0 - share)] + ([(low + 1, share)] if share else [])
            cells = tuple(
                (sign * j, aside, w) if by_row else (aside, sign * j, w) for aside, w in beside
            )
            if share or by_row or not down:  # through a cell's centre: listed with the rows
                found.append((way, abs(along) > large * (1.0 - SNAP) or not share, cells))
    return sorted(found, key=lambda each: each[0])


def _along(
    values: NDArray[np.longdouble], cells: tuple[tuple[int, int, float], ...]
) -> NDArray[np.longdouble]:
    return np.sum([w * _shifted(values, down, right) for down, right, w in cells], axis=0)


def bounced(
    heights: ArrayLike, radiance: ArrayLike, cell_size: tuple[float, float], azimuths: ArrayLike
) -> NDArray[np.longdouble]:
    """Irradiance of every cell from the radiance of the ground that it sees.

    Each band of elevations that a crossing adds to the horizon sees the surface between that
    crossing and the point where the old line of sight meets the surface: the mean of both ends.
    """
    z = np.asarray(heights).astype(np.longdouble)
    light = np.where(np.isnan(z), 0.0, np.asarray(radiance).astype(np.longdouble))
    east, north = plane_slopes(z, cell_size)
    total, whole = np.zeros_like(z), np.zeros_like(z)
    for azimuth in np.atleast_1d(azimuths):
        plane = east * math.sin(azimuth) + north * math.cos(azimuth)
        top = plane.copy()
        whole += moment(plane, plane)
        way0, rise0, sent0 = np.longdouble(0.0), np.zeros_like(z), light
        for way, _, cells in _rays(z, cell_size, float(azimuth)):
            rise, sent = _along(z, cells) - z, _along(light, cells)
            seen = rise > top * way  # never beside nodata
            over, under = rise - top * way, np.fmax(top * way0 - rise0, 0.0)
            with np.errstate(invalid="ignore", divide="ignore"):
                share = np.where(np.isnan(rise0), 0.0, over / (over + under))
                old = np.where(share > 0.0, (1.0 - share) * sent + share * sent0, sent)
                band = moment(top, plane) - moment(rise / way, plane)
            total += np.where(seen, (sent + old) / 2.0 * band, 0.0)
            top = np.where(seen, rise / way, top)
            way0, rise0, sent0 = way, rise, sent
    return np.where(np.isnan(z), np.nan, math.pi * total / whole)


def seen_counts(
    heights: ArrayLike, cell_size: tuple[float, float], azimuths: ArrayLike
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Samples that every cell sees: for certain, and if all were seen that are hidden by little.

    Little is what is stated of own rays, twice, as both ends of a comparison have it: 2⁻²² of the
    largest height and 2⁻¹⁹ of a cell at the first crossing, and 2⁻²² of the slope. Rasters have
    17 rows and columns at most, so that no cell has a second group of sixteen samples.
    """
    z = np.asarray(heights).astype(np.longdouble)
    z = z - z[np.isfinite(z)][0]
    size = np.nanmax(np.abs(z))
    least, most = np.zeros(z.shape, np.int64), np.zeros(z.shape, np.int64)
    for azimuth in np.atleast_1d(azimuths):
        top = np.full(z.shape, -np.inf, np.longdouble)
        rays = _rays(z, cell_size, float(azimuth))
        for way, sample, cells in rays:
            slope = (_along(z, cells) - z) / way
            if sample:
                steep = np.where(np.isinf(top), 0.0, np.abs(top))
                little = (2.0**-22 * size + 2.0**-19 * min(cell_size)) / rays[0][0]
                least += slope >= top + 1e-16 * (size / way + steep)
                most += slope >= top - 2.0 * (little + 2.0**-22 * steep)
            top = np.fmax(top, slope)
    return least, most
