"""One bounce: from the radiance that leaves every cell to the irradiance that reaches every cell.

The operator is linear and its visibility is fixed by the terrain, so it is built once for all
bounces. Storing what each cell sees would take some 30 numbers a cell and azimuth (7 GB for a
million cells and 32 azimuths); walking again takes less time than reading them. What is kept is
one number for each 128 cells and azimuth: behind which crossing nothing is visible any more.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adret._kernels import bounce as kernels
from adret._kernels.frames import copy_oriented
from adret.horizon import HorizonOptions
from adret.methods import MAX_AZIMUTH_ERROR
from adret.normals import surface_slopes
from adret.sweep import Direction, Orientation
from adret.terrain import Terrain

__all__ = ["Transport", "Work"]

SNAP = 1e-9  # cells: a crossing this near to a vertex is the vertex
Layer = NDArray[np.float32]


@dataclass
class Work:
    """Counts of what was done: receivers and crossings, each once an azimuth and bounce."""

    receivers: int = 0
    receivers_skipped: int = 0
    crossings_tested: int = 0
    crossings_hidden: int = 0
    crossings_weighed: int = 0
    crossings_dark: int = 0


@dataclass(frozen=True)
class _Task:
    """One azimuth over the raster rows of one latitude band."""

    azimuth: float
    direction: Direction
    rows: tuple[int, int]


class Transport:
    """Irradiance from visible terrain.

    Parameters
    ----------
    terrain : Terrain
    azimuths : ndarray, shape (K,), float64
        Equally spaced.
    options : HorizonOptions
        near, max_distance, radius and refraction.

    Attributes
    ----------
    view : ndarray, shape (rows, columns), float32
        V_t, the cosine-weighted share of the half space above each cell's own plane that terrain
        fills; NaN at nodata. Known after the first bounce.
    work : Work
    """

    def __init__(
        self, terrain: Terrain, azimuths: NDArray[np.float64], options: HorizonOptions
    ) -> None:
        self.terrain = terrain
        self.options = options
        self.work = Work()
        self.view: Layer = np.empty((0, 0), np.float32)
        self.count = len(azimuths)
        self._slopes = surface_slopes(terrain)
        self._reach: dict[_Task, NDArray[np.int32]] = {}
        self._to_irradiance = np.empty((0, 0))
        bands = terrain.latitude_bands(MAX_AZIMUTH_ERROR)
        self.bands = len(bands)
        tasks = [
            _Task(a, Direction.of(a, band.cell_size), (band.start, band.stop))
            for a in azimuths.tolist()
            for band in bands
        ]
        self._tasks = sorted(tasks, key=lambda t: (t.direction.orientation, t.azimuth, t.rows))

    def __call__(
        self,
        radiance: Layer,
        needed: NDArray[np.bool_] | None = None,
        step: Callable[[], None] | None = None,
    ) -> Layer:
        """Irradiance of every cell from the radiance of all that it sees.

        Parameters
        ----------
        radiance : ndarray, shape (bands, rows, columns), float32
            Finite; of nodata cells it does not matter.
        needed : ndarray, shape (rows, columns), bool, optional
            Cells whose irradiance is asked for; others may get 0.
        step : callable, optional
            Called after every azimuth.

        Returns
        -------
        ndarray, shape (bands, rows, columns), float32
            NaN at nodata.
        """
        known = bool(self._reach)
        layers = len(radiance) + (0 if known else 2)
        total = np.zeros((layers, *self.terrain.shape))
        frame: _OctantFrame | None = None
        azimuth = None
        for task in self._tasks:
            if step is not None and azimuth not in (None, task.azimuth):
                step()
            azimuth = task.azimuth
            orientation = task.direction.orientation
            if frame is None or frame.orientation != orientation:
                if frame is not None:
                    frame.add_to(total)
                frame = _OctantFrame(self, orientation, radiance, needed, layers)
            if not known:
                self._reach[task] = np.zeros(frame.needed.shape, np.int32)
            frame.gather(task, self._reach[task], known, 2.0 * np.pi / self.count)
        if frame is not None:
            frame.add_to(total)
        if step is not None:
            step()
        if not known:
            seen, whole = total[-2:]
            # Few azimuths sum a tilted half space to a little more or less than π. Normalised,
            # no row of the operator sums to more than π: light cannot grow, whatever K is.
            with np.errstate(invalid="ignore"):
                self.view = (seen / whole).astype(np.float32)
                # Cells that nobody asked for have neither.
                unknown = self.terrain.mask | (whole == 0.0)
                self._to_irradiance = np.where(unknown, np.nan, np.pi) / whole
        bands = total[: len(radiance)]
        return np.asarray(np.maximum(bands, 0.0) * self._to_irradiance, dtype=np.float32)

    def memory(self) -> dict[str, NDArray[Any]]:
        """What the first bounce found out, for `recall`."""
        kept: dict[str, NDArray[Any]] = {"view": self.view, "to_irradiance": self._to_irradiance}
        return kept | {f"reach-{i}": self._reach[task] for i, task in enumerate(self._tasks)}

    def recall(self, memory: Mapping[str, NDArray[Any]]) -> None:
        """Take up what the first bounce of another run on the same terrain found out."""
        self.view, self._to_irradiance = memory["view"], memory["to_irradiance"]
        self._reach = {task: memory[f"reach-{i}"] for i, task in enumerate(self._tasks)}


class _OctantFrame:
    """The arrays of one octant, and the sums of its azimuths."""

    def __init__(
        self,
        transport: Transport,
        orientation: Orientation,
        radiance: Layer,
        needed: NDArray[np.bool_] | None,
        layers: int,
    ) -> None:
        self.orientation = orientation
        self._transport = transport
        rows, columns = transport.terrain.shape
        self.shape = (columns, rows) if orientation.swap else (rows, columns)
        n, m = self.shape
        z = self._padded(transport.terrain.heights, np.nan)
        mask = transport.terrain.mask
        light = np.stack([self._padded(np.where(mask, 0.0, b), 0.0) for b in radiance])
        tiles = (-(-z.shape[0] // kernels.TILE_ROWS), -(-z.shape[1] // kernels.TILE_COLUMNS))
        tops, lit = np.empty(tiles, np.float32), np.empty(tiles, np.bool_)
        kernels.tile_tops(z, tops)
        kernels.tile_lights(light, lit)
        self.frame = kernels.Frame(z.ravel(), light.reshape(len(light), -1), z.shape[1], tops, lit)
        self._slopes = [self._turned(layer) for layer in transport._slopes]
        wanted = ~mask if needed is None else needed & ~mask
        self.needed = _any_in_chunks(self._turned(wanted.astype(np.float32)))
        self._sums = np.zeros((layers, n, m), np.float32)

    def _turn(self) -> tuple[bool, bool, bool]:
        o = self.orientation
        return o.swap, o.flip_rows, o.flip_columns

    def _turned(self, layer: Layer) -> Layer:
        turned = np.empty(self.shape, np.float32)
        copy_oriented(layer, turned, *self._turn())
        return turned

    def _padded(self, layer: Layer, fill: float) -> Layer:
        n, m = self.shape
        pad = kernels.PAD
        frame = np.full((n + pad, m + pad), fill, np.float32)
        copy_oriented(layer.astype(np.float32, copy=False), frame[pad:, pad:], *self._turn())
        return frame

    def _span(self, rows: tuple[int, int]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Frame rows and columns of a span of raster rows."""
        o, (n, m) = self.orientation, self.shape
        if o.swap:
            first, last = (m - rows[1], m - rows[0]) if o.flip_columns else rows
            return np.array([0, n]), np.array([first, last])
        first, last = (n - rows[1], n - rows[0]) if o.flip_rows else rows
        return np.array([first, last]), np.array([0, m])

    def gather(self, task: _Task, reach: NDArray[np.int32], known: bool, scale: float) -> None:
        """Add one azimuth's light to the sums."""
        options = self._transport.options
        rays = _rays(
            task.direction, options.near, self.shape[0], self.frame.width, options.range,
            options.bend,
        )  # fmt: skip
        rows, columns = self._span(task.rows)
        tasks = -(-int(rows[1] - rows[0]) // kernels.STRIP) * self.needed.shape[1]
        counters = np.zeros((tasks, kernels.COUNTERS), np.int64)
        kernels.gather(
            self.frame,
            rays,
            *self._slopes,
            np.array([math.sin(task.azimuth), math.cos(task.azimuth)], np.float32),
            rows,
            columns,
            self.needed,
            known,
            reach,
            np.float32(scale),
            counters,
            self._sums,
        )
        work = self._transport.work
        receivers, tested, hidden, weighed, dark = counters.sum(axis=0).tolist()
        cells = int((rows[1] - rows[0]) * (columns[1] - columns[0]))
        work.receivers += receivers
        work.receivers_skipped += cells - receivers
        work.crossings_tested += tested
        work.crossings_hidden += hidden
        work.crossings_weighed += weighed
        work.crossings_dark += dark

    def add_to(self, total: NDArray[np.float64]) -> None:
        """Turn the sums back and add them to raster layers."""
        o = self.orientation
        layer = np.empty(total.shape[1:], np.float32)
        for own, target in zip(self._sums, total, strict=True):
            if o.swap:
                # The inverse of "transpose, then flip" flips the other axis after transposing.
                copy_oriented(own, layer, True, o.flip_columns, o.flip_rows)
            else:
                copy_oriented(own, layer, False, o.flip_rows, o.flip_columns)
            target += layer


def _any_in_chunks(layer: Layer) -> NDArray[np.bool_]:
    """Whether any of each CHUNK cells of a row is not 0, shape (n, chunks)."""
    starts = np.arange(0, layer.shape[1], kernels.CHUNK)
    return np.asarray(np.maximum.reduceat(layer, starts, axis=1) != 0.0)


def _rays(
    direction: Direction, near: int, rows: int, width: int, reach: float, bend: float
) -> kernels.Rays:
    """Crossings of a ray: all up to `near` major steps, those of the major axis beyond."""
    table = _crossings(direction.shear, min(near, rows), rows)
    table = table[table[:, 6] * direction.step <= reach]
    extra = -len(table) % kernels.GROUP
    receiver = np.array([[0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0]])
    table = np.concatenate([receiver, table, np.repeat(table[-1:], extra, axis=0)])
    fill = slice(len(table) - extra, None)
    cells = table[:, [0, 1, 3, 4]].astype(np.int64)
    p, q, way = table[:, 2], table[:, 5], table[:, 6] * direction.step
    p[fill] = q[fill] = 0.0
    drop = bend * way**2
    drop[fill] = np.nan
    per_way = np.concatenate([[0.0], 1.0 / way[1:]])
    lowest = np.minimum(cells[:, 0], cells[:, 2])
    offsets = [cells[:, 0] * width + cells[:, 1], cells[:, 2] * width + cells[:, 3]]
    numbers = [p, q, way, drop, p * per_way, q * per_way, per_way, -drop * per_way]
    return kernels.Rays(
        np.stack([*offsets, lowest, cells[:, 1]], axis=1),
        np.stack(numbers, axis=1).astype(np.float32),
    )


def _crossings(shear: float, near: int, steps: int) -> NDArray[np.float64]:
    """(S, 7): row, column and weight of both cells, and the way in major steps, by distance."""
    tables = [_grid_lines(np.arange(1.0, steps + 1.0), shear)]
    if shear > 0.0:
        minor = _grid_lines(np.arange(1.0, math.floor(shear * near + SNAP) + 1.0), 1.0 / shear)
        minor = minor[minor[:, 5] > 0.0]  # else the crossing is a vertex, and listed
        minor[:, 6] /= shear
        tables.append(minor[:, [1, 0, 2, 4, 3, 5, 6]])  # rows and columns change places
    table = np.concatenate(tables)
    return table[np.argsort(table[:, 6], kind="stable")]


def _grid_lines(lines: NDArray[np.float64], rise: float) -> NDArray[np.float64]:
    """Crossings with lines 1, 2, ... of one family, of a ray that moves `rise` cells a line."""
    cell = np.floor(lines * rise + SNAP)
    weight = lines * rise - cell
    weight[weight < SNAP] = 0.0
    return np.column_stack(
        [-lines, -cell, 1.0 - weight, -lines, -cell - (weight > 0.0), weight, lines]
    )
