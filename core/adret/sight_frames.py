"""A raster turned for the azimuths of one octant, with the rays and lines of sight of its cells.

The turn is that of `adret.sweep`: the azimuth's larger component runs along decreasing rows, its
smaller, t times as large in cells, along decreasing columns. Line L passes row i at column
L + t·(i + anchor); the anchor makes a window's lines those of the whole raster.
"""

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adret._kernels import sight_lines, sight_rays
from adret._kernels import visibility as kernels
from adret._kernels.frames import copy_oriented
from adret.horizon import HorizonOptions
from adret.sight_rays import Sight, SightMethod, seen_on_ray
from adret.sweep import Direction, Orientation
from adret.terrain import Terrain

__all__ = ["SightFrame", "Work"]

Layer = NDArray[np.float32]
FINEST = 24
"""Heights on lines are rounded to 2 to the minus this of a cell."""

_NO_OFFSETS = np.empty((0, 0), np.int64)
_NO_LISTS = np.empty(0, np.int32)
_NO_LAYER = np.empty((0, 0), np.float32)
_NO_MASK = np.empty((0, 0), np.bool_)


def _no_work() -> NDArray[np.int64]:
    return np.zeros((kernels.CHUNKS, kernels.COUNTERS), np.int64)


@dataclass
class Work:
    """Counts of what was done, once an azimuth: on own rays, and by the tree, task by task."""

    receivers: int = 0
    samples_tested: int = 0
    samples_passed: int = 0
    lines: NDArray[np.int64] = field(default_factory=_no_work)


class SightFrame:
    """Heights of a raster in the sweep frame of one octant, and a layer to add results to.

    Parameters
    ----------
    terrain : Terrain
    orientation : Orientation

    Attributes
    ----------
    layer : ndarray, float32
        In frame orientation; starts at 0.
    """

    def __init__(self, terrain: Terrain, orientation: Orientation) -> None:
        self.terrain = terrain
        self.orientation = orientation
        rows, columns = terrain.shape[::-1] if orientation.swap else terrain.shape
        self.shape: tuple[int, int] = (rows, columns)
        self.layer: Layer = np.zeros(self.shape, np.float32)
        o = orientation
        first = terrain.origin[1] if o.swap else terrain.origin[0]
        self._anchor = 1 - rows - first if o.flip_rows else first
        self._highest = float(np.nanmax(np.abs(terrain.heights)))

    def _padded(self, above: int, left: int, right: int) -> Layer:
        (n, m), o = self.shape, self.orientation
        z = np.full((above + n, left + m + right), np.nan, np.float32)
        inner = z[above:, left : left + m]
        copy_oriented(self.terrain.heights, inner, o.swap, o.flip_rows, o.flip_columns)
        return z

    @cached_property
    def _z(self) -> Layer:
        """Heights with a column of NaN on either side, for lines."""
        return self._padded(0, 1, 1)

    @cached_property
    def _ground(self) -> tuple[Layer, Layer, Layer]:
        """Heights padded on the sides that rays run to, scratch, and the roof of an azimuth."""
        z = self._padded(sight_rays.PAD, sight_rays.SIDE, 0)
        return z, np.empty_like(z), np.empty_like(z[:: sight_rays.EVERY])

    @cached_property
    def _near(self) -> tuple[Layer, Layer, NDArray[np.bool_]]:
        """What the near field hands to the far field: quantity, highest slope, open runs."""
        value, best = np.zeros((2, *self.shape), np.float32)
        return value, best, np.zeros(self.shape, np.bool_)

    def sight(self, direction: Direction, options: HorizonOptions, method: SightMethod) -> Sight:
        """How sight is followed in one azimuth."""
        return Sight(direction, options, method, self.shape[0])

    def lines(self, sight: Sight) -> kernels.Lines:
        """Where lines pass each row, and in which units."""
        direction, options = sight.direction, sight.options
        passed = direction.shear * (np.arange(self.shape[0]) + self._anchor)
        left = np.floor(passed)
        weight = passed - left
        quanta = self.quanta(direction, options)
        return kernels.Lines(
            left.astype(np.int64),
            weight,
            (left + (weight > 0.5)).astype(np.int64),
            options.bend * direction.step**2,
            quanta,
            float(np.rint(options.observer_height * quanta)),
            sight.reach,
        )

    def span(self, band: tuple[int, int]) -> tuple[slice, slice]:
        """Frame rows and columns of a span of raster rows."""
        o, (n, m) = self.orientation, self.shape
        start, stop = band
        if o.swap:
            return slice(0, n), slice(m - stop, m - start) if o.flip_columns else slice(start, stop)
        return slice(n - stop, n - start) if o.flip_rows else slice(start, stop), slice(0, m)

    def in_raster(self, layer: NDArray[Any]) -> NDArray[Any]:
        """A frame layer as a view in raster orientation."""
        o = self.orientation
        back = layer[:: -1 if o.flip_rows else 1, :: -1 if o.flip_columns else 1]
        return back.T if o.swap else back

    def in_frame(self, layer: NDArray[Any]) -> NDArray[Any]:
        """A raster layer as a view in frame orientation."""
        o = self.orientation
        turned = layer.T if o.swap else layer
        return turned[:: -1 if o.flip_rows else 1, :: -1 if o.flip_columns else 1]

    def quanta(self, direction: Direction, options: HorizonOptions) -> float:
        """Quanta a metre: a power of two.

        Cross products of height differences and steps are then whole numbers below 2 to the 53.
        """
        drop = abs(options.bend) * (0.5 * self.shape[0] * direction.step) ** 2
        highest = self._highest + drop + options.observer_height
        finest = FINEST - math.floor(math.log2(min(self.terrain.cell_size)))
        room = 51 - math.ceil(math.log2(self.shape[0] + 1))
        largest = finest if highest == 0.0 else room - math.ceil(math.log2(highest))
        return 2.0 ** min(finest, largest)

    def fill(
        self,
        sight: Sight,
        *,
        quantity: int,
        band: tuple[int, int],
        work: Work,
        scale: float = 1.0,
        offsets: NDArray[np.int64] = _NO_OFFSETS,
        lists: NDArray[np.int32] = _NO_LISTS,
    ) -> None:
        """Add scale·quantity to `layer` for a span of raster rows, or fill `lists`.

        See `adret._kernels.sight_rays` and `adret._kernels.visibility`; `offsets` are in frame
        orientation. The slope of joined sight is that on bent lines [quanta a step].
        """
        rows, columns = (np.array([s.start, s.stop]) for s in self.span(band))
        near = kernels.NearField(0, 0.0, _NO_LAYER, _NO_LAYER, _NO_MASK)
        if sight.own > 0:
            self._fill_by_rays(sight, quantity, rows, columns, scale, offsets, lists, work)
        if sight.joined and sight.own > 0:
            value, best, open_run = self._near
            rise = self.quanta(sight.direction, sight.options) * sight.direction.step
            near = kernels.NearField(sight.own + 1, rise, best, value, open_run)
            if quantity == sight_rays.LISTS:
                offsets = offsets + value.astype(np.int64)
        if sight.joined:
            kernels.sight_layer(
                sight.method == "tree",
                quantity,
                self._z,
                self.lines(sight),
                near,
                rows,
                columns,
                scale,
                self.layer,
                offsets,
                lists,
                work.lines,
            )
        elif sight.own == 0 and quantity == sight_rays.SLOPE:
            self.layer[self.span(band)] = -np.inf  # no step is within reach

    def _fill_by_rays(
        self,
        sight: Sight,
        quantity: int,
        rows: NDArray[np.int64],
        columns: NDArray[np.int64],
        scale: float,
        offsets: NDArray[np.int64],
        lists: NDArray[np.int32],
        work: Work,
    ) -> None:
        z, scratch, roof = self._ground
        sight_rays.raise_roof(z, sight.columns(sight_rays.PAD), scratch, roof)
        near = self._near if sight.joined else (self.layer, _NO_LAYER, _NO_MASK)
        strips = -(-int(rows[1] - rows[0]) // sight_rays.STRIP)
        chunks = -(-self.shape[1] // sight_rays.CHUNK)
        done = np.zeros((strips * chunks, sight_rays.COUNTERS), np.int64)
        sight_rays.see_along_rays(
            quantity,
            sight_rays.Ground(z.ravel(), z.shape[1], roof.ravel()),
            sight.steps(z.shape[1], quantity),
            sight.joined,
            rows,
            columns,
            scale,
            *near,
            offsets,
            lists,
            done,
        )
        receivers, tested, passed = done.sum(axis=0).tolist()
        work.receivers += receivers
        work.samples_tested += tested
        work.samples_passed += passed

    def add_slopes(self, sight: Sight, *, band: tuple[int, int], work: Work) -> None:
        """Add the slope of the highest line of sight to `layer`, -inf where nothing is seen."""
        direction, options = sight.direction, sight.options
        unit = self.quanta(direction, options) * direction.step if sight.joined else 1.0
        self.fill(sight, quantity=sight_rays.SLOPE, band=band, work=work, scale=1.0 / unit)
        if sight.joined and options.bend != 0.0:
            # On the bent line tan h is the slope less twice the bend times the receiver's place.
            place = (np.arange(self.shape[0]) - 0.5 * self.shape[0]) * direction.step
            rows, columns = self.span(band)
            tilt = (2.0 * options.bend * place[rows, None]).astype(np.float32)
            self.layer[rows, columns] -= tilt

    def cells_at(
        self, sight: Sight, receiver: NDArray[np.int64], steps: NDArray[np.int32]
    ) -> NDArray[np.int64]:
        """Cells nearest to the samples so many steps from receivers; both flat raster numbers."""
        i, c = self._place(receiver)
        cell = self.lines(sight).cell
        on_line = c - cell[i] + cell[i - steps]
        c = np.where(steps <= sight.own, c - sight.column_at(steps), on_line)
        o, (n, m) = self.orientation, self.shape
        i = i - steps
        i = n - 1 - i if o.flip_rows else i
        c = m - 1 - c if o.flip_columns else c
        row, column = (c, i) if o.swap else (i, c)
        return np.asarray(row * self.terrain.shape[1] + column)

    def _place(self, receiver: Any) -> tuple[Any, Any]:
        """Row and column in the frame of flat raster numbers."""
        o, (n, m) = self.orientation, self.shape
        row, column = np.divmod(receiver, self.terrain.shape[1])
        i, c = (column, row) if o.swap else (row, column)
        return n - 1 - i if o.flip_rows else i, m - 1 - c if o.flip_columns else c

    def visible_steps(
        self, sight: Sight, receiver: int, ends: NDArray[np.int32]
    ) -> NDArray[np.int32]:
        """Distances of the samples that a receiver sees, near to far, from its local horizons."""
        if ends.size == 0:
            return ends
        i, c = self._place(receiver)
        seen, own = np.empty(0, np.int32), sight.own
        best = np.float32(-np.inf)
        if own > 0:
            z = self._ground[0]
            seen, best = seen_on_ray(sight.steps(z.shape[1]), z, i, c)
        if not sight.joined or ends[-1] <= own:
            return seen
        height, eye, wall = self._line_behind(sight, i, c, best)
        away = np.arange(own + 1, int(ends[-1]) + 1)
        rise = height[i + 1 - away] - eye
        # A sample is measured against the next nearer local horizon, or the wall.
        far = ends[ends > own]
        nearer = np.searchsorted(far, away) - 1
        over = np.where(nearer < 0, 1, far[nearer])
        top = np.where(nearer < 0, wall, height[i + 1 - over] - eye)
        with np.errstate(invalid="ignore"):
            beyond = rise * over >= top * away
        return np.concatenate([seen, away[beyond]]).astype(np.int32)

    def _line_behind(
        self, sight: Sight, i: int, c: int, best: np.float32
    ) -> tuple[NDArray[np.float64], float, float]:
        """Heights on the line of a cell, 1 + row, its eye [quanta], and its wall [quanta a step].

        As the kernels of `adret._kernels.sight_lines` make them.
        """
        lines = self.lines(sight)
        height = np.empty((1, i + 2))
        sight_lines.sample_strip(
            self._z, lines.left, lines.weight, lines.cell, c - lines.cell[i], 0, i + 1, lines.bend,
            lines.quanta, height,
        )  # fmt: skip
        if sight.own == 0:
            return height[0], height[0, i + 1] + lines.eye, -np.inf
        away = i - 0.5 * self.shape[0]
        drop = lines.bend * away * away
        eye = np.rint((np.float64(self._z[i, c + 1]) - drop) * lines.quanta) + lines.eye
        rise = lines.quanta * sight.direction.step
        tilt = 2.0 * lines.bend * lines.quanta * away
        lowered = best - abs(best) * np.float64(sight_rays.LEEWAY)
        return height[0], eye, np.rint(lowered * rise + tilt)
