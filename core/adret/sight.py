"""Line of sight between two cells, and the geometry that viewsheds share with it."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adret._kernels import sight as kernels
from adret._summaries import summary
from adret._values import real
from adret.errors import InputError
from adret.horizon import HorizonOptions
from adret.terrain import Terrain

__all__ = [
    "LineOfSight",
    "SightGrid",
    "cell",
    "cells_at",
    "check_terrain",
    "height_above_ground",
    "line_of_sight",
    "sight_options",
]

Cell = tuple[int, int]

MAX_HEIGHT = 1e6
ROW_PRECISION = 2e-4
"""Azimuth error [radians] below which neighbouring rows of a geographic raster share a size."""
BLOCK = 8
"""Neighbouring wedges of rays that one thread walks."""
ROUNDING = 1e-9
"""Share of the heights' magnitude that is more than any rounding error of a bound."""


@dataclass(frozen=True, slots=True, eq=False)
class LineOfSight:
    """The straight line between two points above the ground, and the ground below it.

    Attributes
    ----------
    visible : bool
        Whether no crossing of the line with the grid rises above it; touching is visible.
    distance : ndarray, shape (P,), float64
        Way from the observer [m]: 0, every crossing of the line with a grid row or column, and
        the target.
    ground : ndarray, shape (P,), float64
        Elevation of the terrain there [m]; NaN beside nodata, which hides nothing.
    line : ndarray, shape (P,), float64
        Elevation of the line of sight there [m above the curved datum].
    obstruction : int or None
        Index of the first crossing that rises above the line.
    minimum_height : float
        Least height of the target above its ground [m] at which it is seen; not below 0.
    grazing_elevation : float
        Elevation at the target's place [m] of the sight line that grazes the terrain before it:
        what is lower is hidden. It may lie below the target's ground; -inf where no terrain comes
        between.
    """

    visible: bool
    distance: NDArray[np.float64]
    ground: NDArray[np.float64]
    line: NDArray[np.float64]
    obstruction: int | None
    minimum_height: float
    grazing_elevation: float

    __repr__ = summary

    @property
    def clearance(self) -> NDArray[np.float64]:
        """Height of the line above the ground [m], shape (P,)."""
        return self.line - self.ground


def line_of_sight(
    terrain: Terrain,
    a: Cell,
    b: Cell,
    *,
    observer_height: float = 1.6,
    target_height: float = 0.0,
    radius: float | None = None,
    refraction: float = 0.0,
) -> LineOfSight:
    """Whether cell `b` is seen from cell `a`, with the profile in between.

    Parameters
    ----------
    terrain : Terrain
    a, b : (int, int)
        Row and column of observer and target, from 0.
    observer_height, target_height : float
        Height of the eye above its ground and of the target above its own [m].
    radius : float, optional
        Radius of the planet [m], such as ``terrain.body_radius``; None for a flat one.
    refraction : float
        Coefficient k of the ray's curvature, 0.13 or 1/7 on Earth; 0 without `radius`.

    Returns
    -------
    LineOfSight
        Its verdict is that of `viewshed`, bit for bit.

    Raises
    ------
    InputError
        If a cell is outside the raster or nodata, both are the same, or an option is out of range.

    Notes
    -----
    Over a distance d of D in all, the line is at ``E + (T - E) d/D - (1 - k) d (D - d) / (2 R)``
    above the datum, E and T the elevations of eye and target.

    Examples
    --------
    >>> import numpy as np, adret
    >>> terrain = adret.Terrain(np.array([[0.0, 0.0, 30.0, 0.0, 0.0]]), (10.0, 10.0))
    >>> sight = adret.line_of_sight(terrain, (0, 0), (0, 4), observer_height=10.0)
    >>> sight.visible, sight.distance[sight.obstruction], sight.minimum_height
    (False, np.float64(20.0), 50.0)
    >>> sight.clearance
    array([ 10. ,   7.5, -25. ,   2.5,   0. ])
    """
    check_terrain(terrain)
    options = sight_options(observer_height, None, radius, refraction)
    target_height = height_above_ground("target_height", target_height)
    grid = SightGrid(terrain, options)
    start, end = cell("a", a, terrain), cell("b", b, terrain)
    if start == end:
        raise InputError("b", f"another cell than {start}", end)
    rows_down, columns_right = end[0] - start[0], end[1] - start[1]
    down = terrain.shape[1] * (1 if rows_down >= 0 else -1)
    right = 1 if columns_right >= 0 else -1
    steps = [(abs(columns_right), right), (abs(rows_down), down)]
    (minor_steps, minor), (major_steps, major) = sorted(steps, key=lambda each: each[0])
    widths, norths = grid.squares(start[0])
    squared = float(norths[end[0]] + columns_right**2 * widths[end[0]])
    eye = float(terrain.heights[start]) + observer_height
    ground = float(terrain.heights[end])
    aim = ground + target_height

    most = major_steps + minor_steps
    along, height, need = (np.empty(most) for _ in range(3))
    over = np.empty(most, np.bool_)
    found = kernels.profile(
        grid.heights,
        grid.index(start),
        major,
        minor,
        major_steps,
        minor_steps,
        options.bend * squared,
        eye,
        aim,
        along,
        height,
        over,
        need,
    )
    share = np.concatenate([[0.0], along[:found], [1.0]])
    line = eye + (aim - eye) * share - options.bend * squared * share * (1.0 - share)
    line[-1] = aim
    surface = np.concatenate([[float(terrain.heights[start])], height[:found], [ground]])
    hidden = np.flatnonzero(over[:found])
    known = need[:found][~np.isnan(need[:found])]
    grazing = float(known.max()) if known.size else -math.inf
    return LineOfSight(
        visible=hidden.size == 0,
        distance=share * math.sqrt(squared),
        ground=surface + terrain.datum,
        line=line + terrain.datum,
        obstruction=int(hidden[0]) + 1 if hidden.size else None,
        minimum_height=max(grazing - ground, 0.0),
        grazing_elevation=grazing + terrain.datum,
    )


def cells_at(terrain: Terrain, x: ArrayLike, y: ArrayLike) -> list[Cell]:
    """Row and column of the cells that hold some points of the map.

    Parameters
    ----------
    terrain : Terrain
        With a transform.
    x, y : array_like, shape () or (P,)
        Coordinates in the terrain's CRS: easting and northing, or longitude and latitude.

    Returns
    -------
    list of (int, int)

    Raises
    ------
    InputError
        If the terrain has no transform or a point lies outside the raster.

    Examples
    --------
    >>> import adret
    >>> aletsch = adret.Terrain.open("examples/data/alpine_aletsch_dhm200_lv95_200m.tif")
    >>> adret.cells_at(aletsch, 2_650_000.0, 1_150_000.0)
    [(172, 244)]
    """
    check_terrain(terrain)
    transform = terrain.transform
    if transform is None:
        raise InputError("terrain", "georeferenced (with a transform)", repr(terrain))
    rows, columns = terrain.shape
    found = []
    try:
        easts, norths = np.broadcast_arrays(np.atleast_1d(x), np.atleast_1d(y))
    except ValueError:
        easts = norths = np.empty((0, 0))
    if easts.ndim != 1 or easts.dtype.kind not in "iuf" or norths.dtype.kind not in "iuf":
        raise InputError("coordinates", "numbers x and y, one each or as many of both", (x, y))
    for east, north in zip(easts.tolist(), norths.tolist(), strict=True):
        column = (east - transform.c) / transform.a
        row = (north - transform.f) / transform.e
        if not (0.0 <= row < rows and 0.0 <= column < columns):
            raise InputError("coordinates", "inside the raster", (float(east), float(north)))
        found.append((math.floor(row), math.floor(column)))
    return found


def cell(field: str, given: Any, terrain: Terrain) -> Cell:
    """A cell of the raster that holds data.

    Raises
    ------
    InputError
        If it is none.
    """
    try:
        pair = np.asarray(given)
    except ValueError:
        pair = np.empty(0)
    if pair.shape != (2,) or pair.dtype.kind not in "iu" or np.ma.is_masked(given):
        raise InputError(field, "a row and a column, whole numbers", given)
    row, column = int(pair[0]), int(pair[1])
    rows, columns = terrain.shape
    if not (0 <= row < rows and 0 <= column < columns):
        raise InputError(
            field, f"a cell between (0, 0) and ({rows - 1}, {columns - 1})", (row, column)
        )
    if terrain.mask[row, column]:
        raise InputError(field, "a cell that is not nodata", (row, column))
    return row, column


def check_terrain(terrain: Any) -> None:
    """Refuse what is no `Terrain`.

    Raises
    ------
    InputError
        Naming what was given.
    """
    if not isinstance(terrain, Terrain):
        raise InputError("terrain", "a Terrain", type(terrain).__name__)


def height_above_ground(field: str, value: Any) -> float:
    """A height that options may hold [m]."""
    return real(field, value, "between 0 and 1e6 m", 0.0, MAX_HEIGHT)


def sight_options(
    observer_height: float, max_distance: float | None, radius: float | None, refraction: float
) -> HorizonOptions:
    """The options that sight lines share with exact horizons, checked."""
    return HorizonOptions(
        method="exact",
        observer_height=observer_height,
        max_distance=max_distance,
        radius=radius,
        refraction=refraction,
    )


class SightGrid:
    """Distances and octants of a terrain as the kernels of sight lines want them.

    The way between two cells of a geographic raster is measured with the mean size of a cell in
    their two rows, so it is the same from both ends.
    """

    def __init__(self, terrain: Terrain, options: HorizonOptions) -> None:
        self.terrain = terrain
        self.options = options
        self.heights = terrain.heights.reshape(-1)
        self._width = np.empty(terrain.shape[0])
        self._height = np.empty(terrain.shape[0])
        for band in terrain.latitude_bands(ROW_PRECISION):
            self._width[band.start : band.stop], self._height[band.start : band.stop] = (
                band.cell_size
            )
        self._highest = float(np.nanmax(np.abs(terrain.heights)))

    def index(self, place: Cell) -> int:
        """Where a cell lies in the flat array."""
        return place[0] * self.terrain.shape[1] + place[1]

    def slack(self, eye: float, target_height: float) -> float:
        """More than the rounding errors of heights in the kernels [m]."""
        return ROUNDING * (self._highest + abs(eye) + target_height)

    def squares(self, row: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Squared width of a column, and squared way north, from `row` to every row [m²]."""
        way = (np.arange(len(self._height)) - row) * (0.5 * (self._height + self._height[row]))
        return (0.5 * (self._width + self._width[row])) ** 2, way**2

    def octants(
        self, place: Cell, azimuths: tuple[float, float] | None = None
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
        """Octants round an observer, their fall by curvature, and the tasks for threads.

        See `see_from` for what the columns hold. Wedges outside `azimuths`, a first one and a
        width, get no task.
        """
        rows, columns = self.terrain.shape
        row, column = place
        limit, bend = self.options.range, self.options.bend
        width = 0.5 * (self._width + self._width[row])
        height = 0.5 * (self._height + self._height[row])
        spans = {
            (0, 1): columns - 1 - column,
            (0, -1): column,
            (1, 0): rows - 1 - row,
            (-1, 0): row,
        }
        octants, drops, tasks = [], [], []
        for x, length in spans.items():
            across = x[0] == 0
            size, aside = (width, height) if across else (height, width)
            # One cell more than the range: distances are judged one by one.
            reach = int(min(length, limit / float(size.min()) + 1.0))
            if reach == 0:
                continue
            for y, breadth in spans.items():
                if (y[0] == 0) == across:
                    continue
                diagonal, axis = int(across), int(sum(y) > 0)
                strides = [x[0] * columns + x[1], y[0] * columns + y[1]]
                spread = [reach, min(breadth, reach), reach]
                octants.append([*strides, *spread, x[0], y[0], diagonal, axis])
                low = [bend * (1.0 - 1e-12) * float(s.min()) ** 2 for s in (size, aside)]
                high = [bend * (1.0 + 1e-12) * float(s.max()) ** 2 for s in (size, aside)]
                drops.append([*low, *high])
                first = np.arange(0, reach + diagonal, BLOCK)
                last = np.minimum(first + BLOCK, reach + diagonal)
                if azimuths is not None:
                    stretch = aside.min() / size.max(), aside.max() / size.min()
                    looked_at = _within(x, y, first / reach, last / reach, stretch, azimuths)
                    first, last = first[looked_at], last[looked_at]
                tasks.append(np.stack([np.full_like(first, len(octants) - 1), first, last], axis=1))
        return (
            np.array(octants, dtype=np.int64).reshape(-1, 9),
            np.array(drops, dtype=np.float64).reshape(-1, 4),
            np.concatenate([np.empty((0, 3), np.int64), *tasks]),
        )

    def window(self, place: Cell) -> tuple[slice, slice]:
        """Rows and columns that the range can reach from a cell."""
        slices = []
        for at, length, sizes in (
            (place[0], self.terrain.shape[0], 0.5 * (self._height + self._height[place[0]])),
            (place[1], self.terrain.shape[1], 0.5 * (self._width + self._width[place[0]])),
        ):
            reach = int(min(length, self.options.range / float(sizes.min()) + 1.0))
            slices.append(slice(max(at - reach, 0), min(at + reach + 1, length)))
        return slices[0], slices[1]


def _within(
    x: Cell,
    y: Cell,
    low: NDArray[np.float64],
    top: NDArray[np.float64],
    stretch: tuple[float, float],
    azimuths: tuple[float, float],
) -> NDArray[np.bool_]:
    """Whether rays between low and top steps along y for one along x may lie in a range.

    `stretch` is the length of a step along y over one along x, least and most.
    """
    first, width = azimuths
    axis, beside = (math.atan2(step[1], -step[0]) for step in (x, y))
    clockwise = math.sin(beside - axis) > 0.0
    near, far = np.arctan(low * stretch[0]), np.arctan(top * stretch[1])
    start = (axis + near if clockwise else axis - far) - ROUNDING
    spread = far - near + 2.0 * ROUNDING
    return np.asarray(
        ((start - first) % math.tau <= width) | ((first - start) % math.tau <= spread)
    )
