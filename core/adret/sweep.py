"""One azimuth over a whole raster: the sweep frame, and the near and far field joined in it.

The sweep frame of an azimuth is the raster turned (transposed and flipped) so that the direction
towards the azimuth has its larger component along decreasing rows and its smaller, t times as
large in cells, along decreasing columns, 0 <= t <= 1. All kernels then know one kind of direction.
Azimuths of one octant share the frame's padded copy of the heights.
"""

import math
from collections import Counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adret import skips
from adret._kernels import jit
from adret._kernels.far_bound import far_can_rise
from adret._kernels.frames import angles_oriented, copy_oriented, mask_nodata
from adret._kernels.hull_sweep import MOST_LINES, RIGHT, hull_sweep
from adret._kernels.hull_window import hull_sweep_within
from adret._kernels.march import march
from adret._kernels.near_field import near_field, near_field_distance
from adret._kernels.raster_edge import raise_by_edge
from adret.blocks import Blocks
from adret.directions import POOL, SNAP, Direction, Layer, Orientation, stencil
from adret.grids import Frames

__all__ = ["POOL", "RIGHT", "Direction", "Layer", "Orientation", "Receivers", "SweepFrame"]

NEAR_ALONE = 3  # near radii within which a limited range is left to the near field: exact, quicker
LEAST_LINES = 128  # swept together
PAD = 4  # cells of NaN that a frame needs at least


class Receivers(NamedTuple):
    """The part of a frame's raster whose horizons are asked for."""

    top: int
    left: int
    rows: int
    columns: int


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
    blocks : Blocks, optional
        Of `heights`: what need not be looked at.
    receivers : Receivers, optional
        The part whose horizons are asked for: layers that are filled cover it alone.
    stored : Frames, optional
        Turned heights that exist already; without a range.
    spare : SweepFrame, optional
        A frame that is used no more: its memory is taken over where it fits.
    """

    def __init__(
        self,
        heights: Layer,
        orientation: Orientation,
        near: int,
        reach: int = 0,
        origin: tuple[int, int] = (0, 0),
        blocks: Blocks | None = None,
        receivers: Receivers | None = None,
        stored: Frames | None = None,
        spare: "SweepFrame | None" = None,
    ) -> None:
        shape = heights.shape[::-1] if orientation.swap else heights.shape
        self.shape: tuple[int, int] = (shape[0], shape[1])
        self.orientation = orientation
        self.near = near
        self._heights, self._receivers = heights, receivers or Receivers(0, 0, *heights.shape)
        blocks = blocks or Blocks.unknown(heights.shape)
        self._holes = not np.isfinite(blocks.low).all()  # or nobody looked
        self._ground = blocks.turned(orientation, self.shape)
        rows, columns = self._pad = padding(self.shape, max(near, reach))
        self._mapped = stored is not None  # reading all of it would cost more than it saves
        if spare is not None and (spare.shape, spare._pad) != (self.shape, self._pad):
            spare = None
        if stored:
            self._z = stored.frame(orientation, near)
        elif spare:
            self._z = spare._z  # NaN all round, and the heights will be written over
        else:
            self._z = np.full((shape[0] + rows, shape[1] + columns + RIGHT), np.nan, np.float32)
        first = origin[1] if orientation.swap else origin[0]
        self._anchor = 1 - shape[0] - first if orientation.flip_rows else first
        self._best: Layer = spare._best if spare else np.empty(shape, np.float32)
        if not stored:
            # By way of a layer: an array with gaps would compile another kernel.
            copy_oriented(heights, self._best, *self._turn())
            self._z[rows:, columns:-RIGHT] = self._best
        self.left_out: Counter[str] = Counter()  # receivers, by skip
        self._top: np.float32 | None = None
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
        angles: bool = False,
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
        angles : bool
            Fill `slope` with elevation angles [radians] instead, -π/2 for -inf.
        """
        reach = max_distance / direction.step
        # A range that covers the raster is no limit.
        limited = reach < max(self.shape)
        near = self.near
        if limited and reach <= NEAR_ALONE * near:
            near = math.ceil(reach)
        crossings = stencil(
            direction,
            near,
            max_distance if limited else math.inf,
            bend,
            observer_height,
            self.shape,
        )
        frame_rows, frame_columns = self._span(rows)
        shared = (self._z, self._pad, crossings.offsets, crossings.p, crossings.q, crossings.k)
        if distance is None:
            far = None
            skipped = np.zeros((2, self.shape[0]), np.int64)
            spans = frame_rows, frame_columns
            near_field(*shared, *self._ground, skipped, *spans, self._best)
            for name, count in zip(("nodata", "level ground"), skipped.sum(1), strict=True):
                self.left_out[name] += int(count)
        else:
            if self._distance is None:
                self._distance = np.empty(self.shape, np.float32)
            far = self._distance
            near_field_distance(
                *shared, crossings.reach, frame_rows, frame_columns, self._best, far
            )
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
        self._write(self._best, slope, rows, angles)
        if far is not None and distance is not None:
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
        angles: bool = False,
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
        self._write(self._best, slope, rows, angles)

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
        distance: Layer | None,
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
            self._strip_width(direction, limited, rows, columns),
            pool,
            f(self.near),
            f(bend * direction.step**2),
            limits,
        )
        if not self._may_rise(limits, rows, columns):
            return
        _, *ground = self._ground
        if limited:
            block = math.ceil(reach / pool) + 1
            hull_sweep_within(*shared, block, *ground, rows, columns, self._best, distance)
        else:
            hull_sweep(*shared, *ground, rows, columns, self._best, distance)
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
        self.left_out["far edge"] += int(skipped.sum())

    def _strip_width(
        self,
        direction: Direction,
        limited: bool,
        rows: NDArray[np.int64],
        columns: NDArray[np.int64],
    ) -> int:
        """Lines that a thread sweeps together: many, but some strips for every thread."""
        if limited:
            return LEAST_LINES
        lines = int(columns[1] - columns[0] + direction.shear * (rows[1] - rows[0])) + 1
        shared = lines if jit.threads() == 1 else -(-lines // (4 * jit.threads()))
        return max(min(shared, MOST_LINES), LEAST_LINES)

    def _may_rise(
        self,
        limits: tuple[np.float32, ...],
        rows: NDArray[np.int64],
        columns: NDArray[np.int64],
    ) -> bool:
        """Whether the far field could rise over the near horizon somewhere."""
        if self._mapped or not skips.wanted("far field"):
            return True
        if self._top is None:
            self._top = np.fmax.reduce(self._z, axis=None)
        hope = np.zeros(1, np.bool_)
        shared = (self._top, self.near, limits, rows, columns)
        far_can_rise(self._z, self._pad, *shared, self._best, hope)
        if not hope[0]:
            self.left_out["far field"] += int((rows[1] - rows[0]) * (columns[1] - columns[0]))
        return bool(hope[0])

    def _write(
        self, layer: Layer, target: Layer, rows: tuple[int, int], angles: bool = False
    ) -> None:
        """Turn a frame layer back into rows of a raster layer and mask nodata."""
        o = self.orientation
        down, across = self._span(rows)
        part = layer[down[0] : down[1], across[0] : across[1]]
        part.flags.writeable = False  # as heights are: one kernel serves both
        flips = (o.flip_rows, o.flip_columns)
        # The inverse of "transpose, then flip" flips the other axis after transposing.
        turn = angles_oriented if angles else copy_oriented
        turn(part, target[slice(*rows)], o.swap, *(flips[::-1] if o.swap else flips))
        if self._holes:
            top, left, _, width = self._receivers
            mask_nodata(
                self._heights[top + rows[0] : top + rows[1], left : left + width],
                target[slice(*rows)],
            )
