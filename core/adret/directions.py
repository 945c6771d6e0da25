"""Directions on a grid: how an azimuth runs through its cells, and what it crosses near by."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["POOL", "SNAP", "Direction", "Layer", "Orientation", "Stencil", "stencil"]

POOL = 4  # samples of a line that enter the far field's hull as one
SNAP = 1e-9  # cells: a crossing this near to a vertex is the vertex
Layer = NDArray[np.float32]
Table = NDArray[np.float64]


@dataclass(frozen=True, slots=True, order=True)
class Orientation:
    """How a raster is turned into its sweep frame: transposed first, then flipped."""

    swap: bool
    flip_rows: bool
    flip_columns: bool


@dataclass(frozen=True, slots=True)
class Direction:
    """An azimuth on a grid of given cell size.

    Attributes
    ----------
    cell_size : (float, float)
        (dx, dy) [m].
    along_row, along_column : float
        Index units a metre towards the azimuth.
    orientation : Orientation
        Of the azimuth's octant.
    shear : float
        t: minor cells a major step.
    step : float
        Ground length of a major step [m].
    """

    cell_size: tuple[float, float]
    along_row: float
    along_column: float
    orientation: Orientation
    shear: float
    step: float

    @classmethod
    def of(cls, azimuth: float, cell_size: tuple[float, float]) -> "Direction":
        """Resolve an azimuth [radians clockwise from north], exact on axes and cell diagonals.

        Within `SNAP` of one of them, in cells, it is that one: rounding in an azimuth then moves
        no ray off the raster's edge along which it runs.
        """
        dx, dy = cell_size
        row, column = -math.cos(azimuth) / dy, math.sin(azimuth) / dx
        large = max(abs(row), abs(column))
        row = 0.0 if abs(row) < SNAP * large else row
        column = 0.0 if abs(column) < SNAP * large else column
        if abs(abs(row) - abs(column)) < SNAP * large:
            diagonal = 1.0 / math.hypot(dx, dy)
            row, column = math.copysign(diagonal, row), math.copysign(diagonal, column)
        swap = abs(column) > abs(row)
        major, minor = (column, row) if swap else (row, column)
        along, across = (dx, dy) if swap else (dy, dx)
        shear = abs(minor) / abs(major)
        return cls(
            cell_size=cell_size,
            along_row=row,
            along_column=column,
            orientation=Orientation(swap, major > 0.0, minor > 0.0),
            shear=shear,
            step=math.hypot(along, shear * across),
        )


@dataclass(frozen=True, slots=True)
class Stencil:
    """Crossings of the near field: shifts of the two cells, weights, distance [m]."""

    offsets: NDArray[np.int64]
    p: Layer
    q: Layer
    k: Layer
    reach: Layer


def _between(major: Table, minor: Table, swap: bool) -> Table:
    """Crossings `major` cells along one axis, `minor` along the other; `swap`: the axes' order."""
    cell = np.floor(minor + SNAP)
    weight = minor - cell
    vertex = weight < SNAP
    beside = np.where(vertex, cell, cell + 1.0)
    pairs = [-major, -cell, -major, -beside]
    if swap:
        pairs = [-cell, -major, -beside, -major]
    shares = [np.where(vertex, 1.0, 1.0 - weight), np.where(vertex, 0.0, weight)]
    return np.stack([*pairs, *shares, minor if swap else major], axis=1)


def _crossings(shear: float, first: int, last: int) -> Table:
    """Crossings from `first` to `last` major steps: two (row, column), two weights, the steps."""
    steps = np.arange(first, last + 1, dtype=np.float64)
    found = _between(steps, shear * steps, False)
    if shear > 0.0:
        start = max(math.ceil(shear * (first - 1) + SNAP), 1)
        columns = np.arange(start, math.floor(shear * last + SNAP) + 1, dtype=np.float64)
        across = _between(columns, columns / shear, True)
        # Where its weight is 0 the crossing is a vertex, listed above.
        found = np.concatenate([found, across[across[:, 5] > 0.0]])
    return found


def stencil(
    direction: Direction,
    near: int,
    max_distance: float,
    bend: float,
    observer: float,
    shape: tuple[int, int],
) -> Stencil:
    """Crossings of the near field, and those just inside a limited range, that fit the raster.

    The far field resolves the range to a pool; where the ground rises, the horizon is there.
    """
    reach = max_distance / direction.step
    crossings = _crossings(direction.shear, 1, min(near, max(shape)))
    if near < reach < math.inf:
        last = math.floor(reach) + 1
        edge = _crossings(direction.shear, max(near + 1, last - POOL - 1), last)
        crossings = np.concatenate([crossings, edge])
    inside = crossings[:, 6] * direction.step <= max_distance
    inside &= (-crossings[:, 2] <= shape[0]) & (-crossings[:, 3] <= shape[1])
    table = crossings[inside]
    table = table[np.argsort(table[:, 6], kind="stable")]
    if len(table):
        table = np.concatenate([table, np.repeat(table[-1:], -len(table) % 4, axis=0)])
    distance = table[:, 6] * direction.step
    return Stencil(
        offsets=table[:, :4].astype(np.int64),
        p=(table[:, 4] / distance).astype(np.float32),
        q=(table[:, 5] / distance).astype(np.float32),
        k=(-observer / distance - bend * distance).astype(np.float32),
        reach=distance.astype(np.float32),
    )
