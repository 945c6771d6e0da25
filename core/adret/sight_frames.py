"""A raster turned for the azimuths of one octant, with the lines of sight that pass its cells.

The turn is that of `adret.sweep`: the azimuth's larger component runs along decreasing rows, its
smaller, t times as large in cells, along decreasing columns. Line L passes row i at column
L + t·(i + anchor); the anchor makes a window's lines those of the whole raster.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adret._kernels import sight_lines
from adret._kernels import visibility as kernels
from adret._kernels.frames import copy_oriented
from adret.horizon import HorizonOptions
from adret.sweep import Direction, Orientation
from adret.terrain import Terrain

__all__ = ["SightFrame"]

Layer = NDArray[np.float32]
Lines = tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]
FINEST = 24
"""Heights are rounded to 2 to the minus this of a cell."""

_NO_OFFSETS = np.empty((0, 0), np.int64)
_NO_LISTS = np.empty(0, np.int32)


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
        heights = terrain.heights
        rows, columns = heights.shape[::-1] if orientation.swap else heights.shape
        self.shape: tuple[int, int] = (rows, columns)
        self.layer: Layer = np.zeros(self.shape, np.float32)
        self._z = np.full((rows, columns + 2), np.nan, np.float32)
        o = orientation
        copy_oriented(heights, self._z[:, 1:-1], o.swap, o.flip_rows, o.flip_columns)
        first = terrain.origin[1] if o.swap else terrain.origin[0]
        self._anchor = 1 - rows - first if o.flip_rows else first
        self._highest = float(np.nanmax(np.abs(heights)))

    def lines(self, direction: Direction) -> Lines:
        """Left-hand cell, weight of the right-hand one, and nearer cell of line 0 in every row."""
        passed = direction.shear * (np.arange(self.shape[0]) + self._anchor)
        left = np.floor(passed)
        weight = passed - left
        return left.astype(np.int64), weight, (left + (weight > 0.5)).astype(np.int64)

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

    def _units(
        self, direction: Direction, options: HorizonOptions
    ) -> tuple[float, float, float, float]:
        """Curvature a step squared [m], quanta a metre, eye [quanta], reach [steps]."""
        quanta = self.quanta(direction, options)
        return (
            options.bend * direction.step**2,
            quanta,
            float(np.rint(options.observer_height * quanta)),
            float(np.floor(options.range / direction.step + 1e-9)),
        )

    def fill(
        self,
        direction: Direction,
        options: HorizonOptions,
        *,
        tree: bool,
        quantity: int,
        band: tuple[int, int],
        work: NDArray[np.int64],
        scale: float = 1.0,
        offsets: NDArray[np.int64] = _NO_OFFSETS,
        lists: NDArray[np.int32] = _NO_LISTS,
    ) -> None:
        """Add scale·quantity to `layer` for a span of raster rows, or fill `lists`.

        See `adret._kernels.visibility.sight_layer`; `offsets` are in frame orientation.
        """
        rows, columns = self.span(band)
        kernels.sight_layer(
            tree,
            quantity,
            self._z,
            *self.lines(direction),
            *self._units(direction, options),
            np.array([rows.start, rows.stop]),
            np.array([columns.start, columns.stop]),
            scale,
            self.layer,
            offsets,
            lists,
            work,
        )

    def add_slopes(
        self,
        direction: Direction,
        options: HorizonOptions,
        *,
        tree: bool,
        band: tuple[int, int],
        work: NDArray[np.int64],
    ) -> None:
        """Add the slope of the highest line of sight to `layer`, -inf where nothing is seen."""
        scale = 1.0 / (self.quanta(direction, options) * direction.step)
        self.fill(
            direction,
            options,
            tree=tree,
            quantity=kernels.SLOPE,
            band=band,
            work=work,
            scale=scale,
        )
        if options.bend != 0.0:
            # On the bent line tan h is the slope less twice the bend times the receiver's place.
            place = (np.arange(self.shape[0]) - 0.5 * self.shape[0]) * direction.step
            rows, columns = self.span(band)
            tilt = (2.0 * options.bend * place[rows, None]).astype(np.float32)
            self.layer[rows, columns] -= tilt

    def cells_at(
        self, direction: Direction, receiver: NDArray[np.int64], steps: NDArray[np.int32]
    ) -> NDArray[np.int64]:
        """Cells so many steps from receivers; both as flat raster numbers."""
        o, (n, m) = self.orientation, self.shape
        row, column = np.divmod(receiver, self.terrain.shape[1])
        i, c = (column, row) if o.swap else (row, column)
        i = n - 1 - i if o.flip_rows else i
        c = m - 1 - c if o.flip_columns else c
        cell = self.lines(direction)[2]
        c = c - cell[i] + cell[i - steps]
        i = i - steps
        i = n - 1 - i if o.flip_rows else i
        c = m - 1 - c if o.flip_columns else c
        row, column = (c, i) if o.swap else (i, c)
        return np.asarray(row * self.terrain.shape[1] + column)

    def visible_steps(
        self,
        direction: Direction,
        options: HorizonOptions,
        receiver: int,
        ends: NDArray[np.int32],
    ) -> NDArray[np.int32]:
        """Distances of the samples that a receiver sees, near to far, from its local horizons."""
        if ends.size == 0:
            return ends
        o, (n, m) = self.orientation, self.shape
        row, column = divmod(receiver, self.terrain.shape[1])
        i, c = (column, row) if o.swap else (row, column)
        i = n - 1 - i if o.flip_rows else i
        c = m - 1 - c if o.flip_columns else c
        left, weight, cell = self.lines(direction)
        bend, quanta, eye, _ = self._units(direction, options)
        height = np.empty((1, i + 2))
        sight_lines.sample_strip(
            self._z, left, weight, cell, c - cell[i], 0, i + 1, bend, quanta, height
        )
        away = np.arange(1, int(ends[-1]) + 1)
        rise = height[0, i + 1 - away] - (height[0, i + 1] + eye)
        # A sample is measured against the next nearer local horizon.
        nearer = np.searchsorted(ends, away) - 1
        over = np.where(nearer < 0, 0, ends[nearer])
        seen = np.where(nearer < 0, rise == rise, rise * over >= rise[over - 1] * away)
        return np.asarray(away[seen], dtype=np.int32)
