"""The four ways to find a horizon, behind one small interface."""

import math
from collections import Counter
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from adret import skips
from adret._kernels.exact_march import exact_at, exact_layer
from adret._kernels.frames import to_elevation
from adret._kernels.line_hull import look_up, sweep_lines
from adret.blocks import Blocks
from adret.errors import InputError
from adret.sweep import POOL, Direction, Layer, Orientation, Receivers, SweepFrame
from adret.terrain import Terrain

if TYPE_CHECKING:
    from adret.horizon import HorizonOptions

__all__ = [
    "ENGINES",
    "MAX_AZIMUTH_ERROR",
    "POOL",
    "Direction",
    "exact_points",
    "smallest_cell",
]


MAX_AZIMUTH_ERROR = math.radians(0.5)
"""Latitude bands keep the azimuth error of a geographic raster below this."""
HULL_BUFFER = 400_000_000
"""Largest buffer of the published hull [samples]; elongated cells need one far above the raster."""


def smallest_cell(terrain: Terrain) -> float:
    """Smallest cell side in any latitude band [m]."""
    return min(min(band.cell_size) for band in terrain.latitude_bands(MAX_AZIMUTH_ERROR))


class Target(NamedTuple):
    """Layers that a horizon is written to, and the raster rows (start, stop) of them."""

    slope: Layer
    distance: Layer | None
    rows: tuple[int, int]
    angles: bool
    """Whether `slope` gets elevations [radians], not their tangents."""


class Engine(Protocol):
    """Fills rows of a slope layer, and of a distance layer where one is given."""

    left_out: Counter[str]
    """Receivers left out so far, by the names of `skips.SKIPS`."""

    def __init__(self, terrain: Terrain, options: "HorizonOptions") -> None: ...

    def fill(self, direction: Direction, target: Target) -> None:
        """Write the horizon towards `direction`."""


class _Framed:
    """Keeps the latest octant's frame, or two: latitude bands may straddle an octant's border."""

    def __init__(self, terrain: Terrain, options: "HorizonOptions") -> None:
        self.terrain = terrain
        self.options = options
        self._frames: dict[Orientation, SweepFrame] = {}
        self._blocks: Blocks | None = None  # a mapped file is not read as a whole
        self.left_out: Counter[str] = Counter()
        bands = terrain.latitude_bands(MAX_AZIMUTH_ERROR)
        self._kept = min(len(bands), 2)
        cells = options.range / smallest_cell(terrain)
        self._reach = math.ceil(cells) if cells < math.inf else 0

    def frame(self, orientation: Orientation, near: int, reach: int) -> SweepFrame:
        if orientation not in self._frames:
            spare = None
            if len(self._frames) >= self._kept:
                spare = self._frames.pop(next(iter(self._frames)))
            seen, top, left, stored = self.terrain.view
            if stored is None and self._blocks is None:
                self._blocks = Blocks.of(seen)
            row, column = self.terrain.origin
            self._frames[orientation] = SweepFrame(
                seen,
                orientation,
                near,
                reach,
                (row - top, column - left),
                self._blocks,
                Receivers(top, left, *self.terrain.shape),
                stored,
                spare,
            )
            self._frames[orientation].left_out = self.left_out
        return self._frames[orientation]

    def _drop(self) -> None:
        if self.terrain.view.frames is not None:
            self.terrain.view.frames.drop()


class Sweep(_Framed):
    """Exact near field joined to a hull-swept far field."""

    def fill(self, direction: Direction, target: Target) -> None:
        """Write rows of the layer; see `SweepFrame.horizon`."""
        slope, distance, rows, angles = target
        o = self.options
        self.frame(direction.orientation, o.near, self._reach).horizon(
            direction,
            slope,
            distance,
            rows=rows,
            max_distance=o.range,
            bend=o.bend,
            observer_height=o.observer_height,
            angles=angles,
        )
        self._drop()


class March(_Framed):
    """One sample a step along each cell's own ray."""

    def fill(self, direction: Direction, target: Target) -> None:
        """Write rows of the layer; see `SweepFrame.march`."""
        slope, _, rows, angles = target
        o = self.options
        self.frame(direction.orientation, 0, 0).march(
            direction,
            slope,
            rows=rows,
            max_distance=o.range,
            bend=o.bend,
            observer_height=o.observer_height,
            angles=angles,
        )
        self._drop()


class Exact:
    """Every crossing of the cell's own ray with the grid lines, in float64."""

    def __init__(self, terrain: Terrain, options: "HorizonOptions") -> None:
        self.view = terrain.view
        self.left_out: Counter[str] = Counter()
        self.options = options
        self._top = _top(terrain)

    def fill(self, direction: Direction, target: Target) -> None:
        """Write rows of the layer."""
        slope, distance, (start, stop), angles = target
        way = np.empty_like(slope) if distance is None else distance
        ended = np.zeros(stop - start, np.int64)
        exact_layer(
            self.view.heights,
            self.view.top + start,
            self.view.left,
            direction.along_row,
            direction.along_column,
            self.options.range,
            self.options.bend,
            self.options.observer_height,
            self._top,
            slope[start:stop],
            way[start:stop],
            ended,
        )
        self.left_out["ends of rays"] += int(ended.sum())
        if angles:
            to_elevation(slope[start:stop], slope[start:stop])


def _top(terrain: Terrain) -> float:
    """No height that may occlude is above it [m above the datum]; infinity without that skip."""
    if terrain.view.frames is not None or not skips.wanted("ends of rays"):
        return math.inf  # a mapped file is not read as a whole
    top = float(np.fmax.reduce(terrain.view.heights, axis=None))
    return top + 1e-15 * abs(top)  # interpolated heights are rounded


class Hull:
    """Paper P1 as published."""

    def __init__(self, terrain: Terrain, options: "HorizonOptions") -> None:
        if terrain.view.heights.shape != terrain.shape:
            raise InputError("method", "another than 'hull' for a tile", "hull")
        self.heights = terrain.heights
        self.mask = terrain.mask
        self.left_out: Counter[str] = Counter()
        self.options = options

    def fill(self, direction: Direction, target: Target) -> None:
        """Write rows of the layer: sweep all lines, then look each cell up."""
        slope, _, (start, stop), angles = target
        n, m = self.heights.shape
        dy, dx = direction.cell_size[1], direction.cell_size[0]
        north, east = -direction.along_row * dy, direction.along_column * dx
        spacing = min(dx, dy)
        half = math.ceil(math.hypot(n * dy, m * dx) / (2.0 * spacing)) + 2
        size = 2 * half + 1
        if size**2 > HULL_BUFFER:
            limit = f"another than 'hull' where its buffer exceeds {HULL_BUFFER} samples"
            raise InputError("method", limit, f"{size} x {size} for cells of {dx:g} x {dy:g} m")
        buffer = np.empty((size, size), np.float64)
        # A cell of its own: along the axes, samples are then the cells themselves.
        centre = np.array([n // 2, m // 2], np.float64)
        sweep_lines(
            self.heights,
            centre,
            np.array([-north / dy, east / dx]),
            np.array([east / dy, north / dx]),
            spacing,
            self.options.bend,
            self.options.observer_height,
            buffer,
        )
        look_up(
            buffer,
            centre,
            np.array([-north * dy, east * dx]),
            np.array([east * dy, north * dx]),
            spacing,
            start,
            slope[start:stop],
        )
        slope[start:stop][self.mask[start:stop]] = np.nan
        if angles:
            to_elevation(slope[start:stop], slope[start:stop])


ENGINES: dict[str, type[Engine]] = {"sweep": Sweep, "march": March, "exact": Exact, "hull": Hull}


def exact_points(
    terrain: Terrain,
    options: "HorizonOptions",
    azimuths: NDArray[np.float64],
    row: NDArray[np.integer],
    column: NDArray[np.integer],
) -> Layer:
    """Exact slopes of P cells in K directions, float32 (K, P)."""
    slope = np.empty((azimuths.size, row.size))
    for band in terrain.latitude_bands(MAX_AZIMUTH_ERROR):
        inside = np.flatnonzero((row >= band.start) & (row < band.stop))
        directions = [Direction.of(a, band.cell_size) for a in azimuths.tolist()]
        part = np.empty((azimuths.size, inside.size))
        exact_at(
            terrain.view.heights,
            row[inside].astype(np.int64) + terrain.view.top,
            column[inside].astype(np.int64) + terrain.view.left,
            np.array([d.along_row for d in directions]),
            np.array([d.along_column for d in directions]),
            options.range,
            options.bend,
            options.observer_height,
            _top(terrain),
            part,
            np.empty_like(part),
        )
        slope[:, inside] = part
    return slope.astype(np.float32)
