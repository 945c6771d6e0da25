"""One azimuth over a whole raster: the sweep frame, and the near and far field joined in it.

The sweep frame of an azimuth is the raster turned (transposed and flipped) so that the direction
towards the azimuth has its larger component along decreasing rows and its smaller, t times as
large in cells, along decreasing columns, 0 <= t <= 1. All kernels then know one kind of direction.
Azimuths of one octant share the frame's padded copy of the heights.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adret import skips
from adret._kernels.frames import copy_oriented, mask_nodata
from adret._kernels.hull_sweep import RIGHT, hull_sweep
from adret._kernels.hull_window import hull_sweep_within
from adret._kernels.march import march
from adret._kernels.near_field import near_field, near_field_distance
from adret._kernels.raster_edge import raise_by_edge
from adret.grids import Frames

__all__ = ["POOL", "RIGHT", "Direction", "Layer", "Orientation", "Receivers", "SweepFrame"]

NEAR_ALONE = 3  # near radii within which a limited range is left to the near field: exact, quicker
PAD = 4  # cells of NaN that a frame needs at least
POOL = 4  # samples of a line that enter the far field's hull as one
SNAP = 1e-9  # cells: a crossing this near to a vertex is the vertex
Layer = NDArray[np.float32]
_Crossing = tuple[int, int, float, int, int, float, float]


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


class Receivers(NamedTuple):
    """The part of a frame's raster whose horizons are asked for."""

    top: int
    left: int
    rows: int
    columns: int


@dataclass(frozen=True, slots=True)
class _Stencil:
    """Crossings of the near field: shifts of the two cells, weights, distance [m]."""

    offsets: NDArray[np.int64]
    p: Layer
    q: Layer
    k: Layer
    reach: Layer


def _crossings(shear: float, first: int, last: int) -> list[_Crossing]:
    """Crossings from `first` to `last` major steps: (row, column, weight) twice, and the steps."""
    found: list[_Crossing] = []
    for j in range(first, last + 1):
        position = shear * j
        cell = math.floor(position + SNAP)
        weight = position - cell
        if weight < SNAP:
            found.append((-j, -cell, 1.0, -j, -cell, 0.0, float(j)))
        else:
            found.append((-j, -cell, 1.0 - weight, -j, -cell - 1, weight, float(j)))
    if shear > 0.0:
        for j in range(math.ceil(shear * (first - 1) + SNAP), math.floor(shear * last + SNAP) + 1):
            position = j / shear
            cell = math.floor(position + SNAP)
            weight = position - cell
            if j > 0 and weight >= SNAP:  # else the crossing is a vertex, listed above
                found.append((-cell, -j, 1.0 - weight, -cell - 1, -j, weight, position))
    return found


def _stencil(
    direction: Direction,
    near: int,
    max_distance: float,
    bend: float,
    observer: float,
    shape: tuple[int, int],
) -> _Stencil:
    """Crossings of the near field, and those just inside a limited range, that fit the raster.

    The far field resolves the range to a pool; where the ground rises, the horizon is there.
    """
    reach = max_distance / direction.step
    crossings = _crossings(direction.shear, 1, min(near, max(shape)))
    if near < reach < math.inf:
        last = math.floor(reach) + 1
        crossings += _crossings(direction.shear, max(near + 1, last - POOL - 1), last)
    crossings = [
        c
        for c in crossings
        if c[6] * direction.step <= max_distance and -c[3] <= shape[0] and -c[4] <= shape[1]
    ]
    crossings.sort(key=lambda c: c[6])
    if crossings:
        crossings += [crossings[-1]] * (-len(crossings) % 4)
    table = np.array(crossings, dtype=np.float64).reshape(-1, 7)
    distance = table[:, 6] * direction.step
    return _Stencil(
        offsets=table[:, [0, 1, 3, 4]].astype(np.int64),
        p=(table[:, 2] / distance).astype(np.float32),
        q=(table[:, 5] / distance).astype(np.float32),
        k=(-observer / distance - bend * distance).astype(np.float32),
        reach=distance.astype(np.float32),
    )


def padding(shape: tuple[int, int], near: int) -> tuple[int, int]:
    """Rows and columns of NaN round a frame: no shift inside the raster is longer than that."""
    return min(near, shape[0]) + PAD, min(near, shape[1]) + PAD


class SweepFrame:
    """A raster turned for one octant, with the kernels that run in it.

    Parameters
    ----------
    heights : ndarray, shape (rows, columns), float32
        NaN at nodata.
    orientation : Orientation
        Of the azimuths to come.
    near : int
        Radius of the near field [major steps].
    reach : int
        Cells within a limited range; `near` or less for none.
    origin : (int, int)
        Row and column of the first cell in the raster that `heights` was cut from: lines, pools
        and blocks of the far field are anchored there.
    receivers : Receivers, optional
        The part whose horizons are asked for: layers that are filled cover it alone.
    stored : Frames, optional
        Turned heights that exist already; without a range.
    """

    def __init__(
        self,
        heights: Layer,
        orientation: Orientation,
        near: int,
        reach: int = 0,
        origin: tuple[int, int] = (0, 0),
        receivers: Receivers | None = None,
        stored: Frames | None = None,
    ) -> None:
        shape = heights.shape[::-1] if orientation.swap else heights.shape
        self.shape: tuple[int, int] = (shape[0], shape[1])
        self.orientation = orientation
        self.near = near
        self._heights, self._receivers = heights, receivers or Receivers(0, 0, *heights.shape)
        rows, columns = self._pad = padding(self.shape, max(near, reach))
        if stored:
            self._z = stored.frame(orientation, near)
        else:
            self._z = np.full((shape[0] + rows, shape[1] + columns + RIGHT), np.nan, np.float32)
            copy_oriented(heights, self._z[rows:, columns:-RIGHT], *self._turn())
        first = origin[1] if orientation.swap else origin[0]
        self._anchor = 1 - shape[0] - first if orientation.flip_rows else first
        self._best: Layer = np.empty(shape, np.float32)
        self.left_out = 0  # receivers that no point of the raster's edge could raise, so far
        self._distance: Layer | None = None

    def _turn(self) -> tuple[bool, bool, bool]:
        o = self.orientation
        return o.swap, o.flip_rows, o.flip_columns

    def _span(self, rows: tuple[int, int]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Frame rows and columns of the receivers in a span of their rows."""
        o, (top, left, _, width), (n, m) = self.orientation, self._receivers, self.shape
        down = np.array([top + rows[0], top + rows[1]])
        across = np.array([left, left + width])
        if o.swap:
            down, across = across, down
        if o.flip_rows:
            down = n - down[::-1]
        if o.flip_columns:
            across = m - across[::-1]
        return np.ascontiguousarray(down), np.ascontiguousarray(across)

    def horizon(
        self,
        direction: Direction,
        slope: Layer,
        distance: Layer | None = None,
        *,
        rows: tuple[int, int],
        max_distance: float = math.inf,
        bend: float = 0.0,
        observer_height: float = 0.0,
        pool: int = POOL,
    ) -> None:
        """Fill rows of `slope` (and `distance` [m]) with the horizon towards one azimuth.

        Parameters
        ----------
        direction : Direction
            Of this frame's octant.
        slope : ndarray, shape (rows, columns), float32
            Output in raster orientation: tangent of the elevation, -inf where nothing lies that
            way, NaN at nodata.
        distance : ndarray, shape (rows, columns), float32, optional
            Output: way to the horizon point, NaN where there is none.
        rows : (int, int)
            Rows of the receivers to serve, start and stop; all rows of the raster are terrain.
        max_distance : float
            Range [m].
        bend : float
            (1 - refraction) / (2 · radius) [1/m].
        observer_height : float
            Height of the eye above the surface [m].
        pool : int
            Samples that enter the hull as one, 1 to 4.
        """
        reach = max_distance / direction.step
        # A range that covers the raster is no limit.
        limited = reach < max(self.shape)
        near = self.near
        if limited and reach <= NEAR_ALONE * near:
            near = math.ceil(reach)
        stencil = _stencil(
            direction,
            near,
            max_distance if limited else math.inf,
            bend,
            observer_height,
            self.shape,
        )
        frame_rows, frame_columns = self._span(rows)
        shared = (self._z, self._pad, stencil.offsets, stencil.p, stencil.q, stencil.k)
        if distance is None:
            far = np.empty((0, 0), np.float32)
            near_field(*shared, frame_rows, frame_columns, self._best)
        else:
            if self._distance is None:
                self._distance = np.empty(self.shape, np.float32)
            far = self._distance
            near_field_distance(*shared, stencil.reach, frame_rows, frame_columns, self._best, far)
        if min(reach, max(self.shape)) > near:
            self._far(
                direction,
                reach,
                limited,
                bend,
                observer_height,
                pool,
                frame_rows,
                frame_columns,
                far,
            )
        self._write(self._best, slope, rows)
        if distance is not None:
            self._write(far, distance, rows)

    def march(
        self,
        direction: Direction,
        slope: Layer,
        *,
        rows: tuple[int, int],
        max_distance: float = math.inf,
        bend: float = 0.0,
        observer_height: float = 0.0,
    ) -> None:
        """As `horizon`, by one sample a major step along each cell's own ray."""
        count = int(min(max_distance / direction.step + SNAP, self.shape[0]))
        march(
            self._z,
            self._pad,
            self.shape[1],
            direction.shear,
            direction.step,
            count,
            bend,
            observer_height,
            *self._span(rows),
            self._best,
        )
        self._write(self._best, slope, rows)

    def _far(
        self,
        direction: Direction,
        reach: float,
        limited: bool,
        bend: float,
        observer_height: float,
        pool: int,
        rows: NDArray[np.int64],
        columns: NDArray[np.int64],
        distance: Layer,
    ) -> None:
        f = np.float32
        limits = (
            f(observer_height),
            f(1.0 / direction.step),
            f(bend * direction.step),
            f(direction.shear),
            f(reach),
        )
        shared = (
            self._z,
            self._pad,
            self.shape[1],
            direction.shear,
            self._anchor,
            pool,
            f(self.near),
            f(bend * direction.step**2),
            limits,
        )
        if limited:
            block = math.ceil(reach / pool) + 1
            hull_sweep_within(*shared, block, rows, columns, self._best, distance)
        else:
            hull_sweep(*shared, rows, columns, self._best, distance)
        rows_above, columns_left = self._pad
        skipped = np.zeros(self.shape[0], np.int64)
        edge = np.append(self._z[rows_above:, columns_left], np.float32(np.nan))
        raise_by_edge(
            self._z,
            self._pad,
            direction.shear,
            f(self.near),
            edge,
            limits,
            skips.wanted("far edge"),
            rows,
            columns,
            self._best,
            distance,
            skipped,
        )
        self.left_out += int(skipped.sum())

    def _write(self, layer: Layer, target: Layer, rows: tuple[int, int]) -> None:
        """Turn a frame layer back into rows of a raster layer and mask nodata."""
        o = self.orientation
        down, across = self._span(rows)
        part = layer[down[0] : down[1], across[0] : across[1]]
        flips = (o.flip_rows, o.flip_columns)
        # The inverse of "transpose, then flip" flips the other axis after transposing.
        copy_oriented(part, target[slice(*rows)], o.swap, *(flips[::-1] if o.swap else flips))
        top, left, _, width = self._receivers
        mask_nodata(
            self._heights[top + rows[0] : top + rows[1], left : left + width],
            target[slice(*rows)],
        )
