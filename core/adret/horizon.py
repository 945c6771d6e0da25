"""Horizon maps: how high the terrain stands in each direction, seen from every cell."""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adret import methods
from adret._kernels.frames import to_elevation
from adret._values import one_of, real, whole
from adret.azimuths import azimuth_set
from adret.errors import InputError
from adret.grids import RasterGrid
from adret.report import RunReport, remember
from adret.terrain import Terrain

__all__ = [
    "NEAR_DEFAULT",
    "HorizonMap",
    "HorizonOptions",
    "Method",
    "horizon_at",
    "horizon_map",
    "horizon_slopes",
]

Method = Literal["sweep", "hull", "march", "exact"]
Progress = Callable[[int, int], None]

NEAR_DEFAULT = 32
NEAR_MAX = 4096


@dataclass(frozen=True, slots=True, kw_only=True)
class HorizonOptions:
    """How a horizon is found; see `horizon_map` for the meaning of each field.

    Raises
    ------
    InputError
        If a value is out of range.
    """

    method: Method = "sweep"
    near: int = NEAR_DEFAULT
    max_distance: float | None = None
    radius: float | None = None
    refraction: float = 0.0
    observer_height: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what no kernel can serve."""
        one_of("method", self.method, get_args(Method))
        near = whole("near", self.near, f"a whole number from 0 to {NEAR_MAX}", 0, NEAR_MAX)
        object.__setattr__(self, "near", near)
        if self.max_distance is not None:
            limit = "a distance above 0 m"
            if real("max_distance", self.max_distance, limit, 0.0, math.inf) == 0.0:
                raise InputError("max_distance", limit, self.max_distance)
            if self.method == "hull":
                raise InputError("max_distance", "None with method 'hull'", self.max_distance)
        if self.radius is not None:
            real("radius", self.radius, "a radius from 1 to 1e12 m, or None", 1.0, 1e12)
        refraction = real("refraction", self.refraction, "between -1 and 1", -1.0, 1.0)
        if refraction != 0.0 and self.radius is None:
            raise InputError("refraction", "0 without a radius", self.refraction)
        real("observer_height", self.observer_height, "between 0 and 1e6 m", 0.0, 1e6)

    @property
    def bend(self) -> float:
        """Drop of the surface by curvature and refraction a square metre of way [1/m]."""
        if self.radius is None:
            return 0.0
        return (1.0 - self.refraction) / (2.0 * self.radius)

    @property
    def range(self) -> float:
        """Largest distance [m], infinity for none."""
        return math.inf if self.max_distance is None else float(self.max_distance)

    def halo(self, terrain: Terrain) -> int:
        """Cells round a window of `terrain` that make its results those of the whole, in bytes.

        Raises
        ------
        InputError
            If `max_distance` is None: then a result may depend on the whole raster.
        """
        top, rows = terrain.origin[0], terrain.shape[0]
        return self.halo_of(terrain.grid, top, top + rows)

    def halo_of(self, grid: RasterGrid, start: int, stop: int) -> int:
        """As `halo`, for receivers in rows start..stop of a raster."""
        if self.max_distance is None:
            raise InputError("max_distance", "a distance, to know a halo", None)
        bands = grid.bands(start, stop, methods.MAX_AZIMUTH_ERROR)
        smallest = min(min(band.cell_size) for band in bands)
        return math.ceil(self.max_distance / smallest) + methods.POOL + 1


@dataclass(frozen=True, slots=True)
class HorizonMap:
    """Horizon elevation of every cell towards K azimuths.

    Attributes
    ----------
    elevation : ndarray, shape (K, rows, columns), float32
        Elevation [radians], negative below the horizontal, -π/2 where no terrain lies that way,
        NaN at nodata cells.
    azimuth : ndarray, shape (K,), float64
        Azimuths [radians clockwise from north].
    distance : ndarray, shape (K, rows, columns), float32, or None
        Way to the horizon point [m], NaN where there is none.
    terrain : Terrain
    options : HorizonOptions
    report : RunReport
    """

    elevation: NDArray[np.float32]
    azimuth: NDArray[np.float64]
    distance: NDArray[np.float32] | None
    terrain: Terrain
    options: HorizonOptions
    report: RunReport


def horizon_map(
    terrain: Terrain,
    directions: int = 64,
    *,
    azimuths: ArrayLike | None = None,
    method: Method = "sweep",
    near: int = NEAR_DEFAULT,
    max_distance: float | None = None,
    radius: float | None = None,
    refraction: float = 0.0,
    observer_height: float = 0.0,
    distance: bool = False,
    progress: Progress | None = None,
) -> HorizonMap:
    """Horizon elevation of every cell towards K azimuths [radians].

    Parameters
    ----------
    terrain : Terrain
    directions : int
        Number K of equally spaced azimuths, the first one north.
    azimuths : array_like, shape (K,), optional
        Azimuths [radians clockwise from grid north] instead.
    method : {"sweep", "hull", "march", "exact"}
        "sweep": every crossing of the cell's own ray with the grid up to `near` cells, and beyond
        it the convex hulls of swept lines. "hull": paper P1 as published. "march": one sample a
        step along the cell's own ray, O(N) a cell. "exact": every crossing in float64, O(N) a
        cell: the truth that the others are measured by.
    near : int
        Radius of the exact near field [cells along the larger axis component], 0 to 4096; more is
        slower and more accurate. Used by "sweep" alone, which leaves ranges of up to three near
        radii to the near field altogether.
    max_distance : float, optional
        Terrain further away than this [m] is not seen. "sweep" resolves it to a few cells, and its
        result then depends on nothing further away; not for "hull".
    radius : float, optional
        Radius of the planet [m], such as ``terrain.body_radius``; None for a flat one.
    refraction : float
        Coefficient k of the ray's curvature, 0.13 or 1/7 on Earth, 0 without air; 0 without
        `radius`.
    observer_height : float
        Height of the eye above the surface [m].
    distance : bool
        Also return the way to the horizon point; "sweep" and "exact" only.
    progress : callable, optional
        Called with (azimuths done, azimuths in all); an exception from it ends the run.

    Returns
    -------
    HorizonMap
        Elevations in float32. A height sample that touches nodata does not occlude; outside the
        raster there is nothing.

    Raises
    ------
    InputError
        If an option is out of range.

    Notes
    -----
    tan h is the maximum over distances d of ``(z(d) - z0 - observer_height) / d
    - (1 - refraction) d / (2 radius)``. Near field and far field are joined by taking the larger.

    References
    ----------
    Timonen and Westerholm 2010, *Scalable height field self-shadowing*, sections 4 and 5.

    Examples
    --------
    >>> import numpy as np, adret
    >>> wall = np.zeros((1, 5)); wall[0, 4] = 10.0
    >>> terrain = adret.Terrain(wall, cell_size=(10.0, 10.0))
    >>> east = adret.horizon_map(terrain, azimuths=[np.pi / 2])
    >>> np.degrees(east.elevation[0, 0]).round(2)
    array([ 14.04,  18.43,  26.57,  45.  , -90.  ], dtype=float32)
    """
    if not isinstance(terrain, Terrain):
        raise InputError("terrain", "a Terrain", type(terrain).__name__)
    options = HorizonOptions(
        method=method,
        near=near,
        max_distance=max_distance,
        radius=radius,
        refraction=refraction,
        observer_height=observer_height,
    )
    if distance and method not in ("sweep", "exact"):
        raise InputError("distance", "False with methods 'hull' and 'march'", distance)
    azimuth = azimuth_set(directions, azimuths)
    elevation = np.empty((azimuth.size, *terrain.shape), np.float32)
    ways = np.empty_like(elevation) if distance else None
    run = HorizonRun(terrain, azimuth, options, progress)
    for k, slope in run.layers(ways):
        to_elevation(slope, elevation[k])
    return HorizonMap(elevation, azimuth, ways, terrain, options, run.report())


class HorizonRun:
    """One pass over a set of azimuths; its report can be read when the layers are consumed.

    `only` names the azimuths, by index, that are swept.
    """

    number = 0

    def __init__(
        self,
        terrain: Terrain,
        azimuths: NDArray[np.float64],
        options: HorizonOptions,
        progress: Progress | None = None,
        *,
        only: Sequence[int] | None = None,
    ) -> None:
        self.terrain = terrain
        self.azimuths = azimuths
        size = terrain.cell_size  # of the whole raster: its tiles go in the same order
        turns = [methods.Direction.of(a, size).orientation for a in azimuths.tolist()]
        every = sorted(range(len(turns)), key=lambda k: (turns[k], k))
        wanted = range(len(turns)) if only is None else set(only)
        self._order = [(number, k) for number, k in enumerate(every) if k in wanted]
        self.options = options
        self._progress = progress
        self._bands = terrain.latitude_bands(methods.MAX_AZIMUTH_ERROR)
        self._start = time.perf_counter()

    def layers(
        self, distances: NDArray[np.float32] | None = None
    ) -> Iterator[tuple[int, NDArray[np.float32]]]:
        """Yield (k, slope): tangent of the elevation towards azimuth k, shape (rows, columns).

        -inf where nothing lies that way, NaN at nodata cells. The array is reused: consume it
        before the next step. `distances`, shape (K, rows, columns), is filled along the way, and
        `number` counts the layers, with those that `only` leaves out.
        Azimuths come grouped by octant, in an order that the list of azimuths alone decides.
        """
        slope = np.empty(self.terrain.shape, np.float32)
        engine = methods.ENGINES[self.options.method](self.terrain, self.options)
        for done, (number, k) in enumerate(self._order):
            self.number = number
            way = None if distances is None else distances[k]
            for band in self._bands:
                direction = methods.Direction.of(float(self.azimuths[k]), band.cell_size)
                engine.fill(direction, slope, way, (band.start, band.stop))
            yield k, slope
            if self._progress is not None:
                self._progress(done + 1, len(self._order))

    def report(self, skipped: int = 0) -> RunReport:
        """What was done, with `skipped` more azimuths that need not be; see `last_run_report`."""
        return remember(
            RunReport(
                method=self.options.method,
                near=self.options.near if self.options.method == "sweep" else 0,
                azimuths_swept=len(self._order),
                azimuths_skipped=len(self.azimuths) - len(self._order) + skipped,
                cells=self.terrain.mask.size,
                cells_skipped=int(self.terrain.mask.sum()),
                bands=len(self._bands),
                seconds=time.perf_counter() - self._start,
            )
        )


def horizon_slopes(
    terrain: Terrain,
    azimuths: NDArray[np.float64],
    options: HorizonOptions,
    progress: Progress | None = None,
) -> Iterator[tuple[int, NDArray[np.float32]]]:
    """Yield the layers of `HorizonRun`: for callers that need no report."""
    return HorizonRun(terrain, azimuths, options, progress).layers()


def horizon_at(
    terrain: Terrain,
    rows: ArrayLike,
    columns: ArrayLike,
    directions: int = 64,
    *,
    azimuths: ArrayLike | None = None,
    max_distance: float | None = None,
    radius: float | None = None,
    refraction: float = 0.0,
    observer_height: float = 0.0,
) -> NDArray[np.float32]:
    """Exact horizon of some cells [radians]: what ``horizon_map(method="exact")`` holds there.

    Parameters
    ----------
    terrain : Terrain
    rows, columns : array_like of int, shape (P,)
        Cells, from 0.
    directions, azimuths, max_distance, radius, refraction, observer_height
        As for `horizon_map`.

    Returns
    -------
    ndarray, shape (K, P), float32
        Elevations, the same bytes as those of the raster; NaN at nodata cells.

    Raises
    ------
    InputError
        If a cell lies outside the raster or an option is out of range.

    Examples
    --------
    >>> import numpy as np, adret
    >>> terrain = adret.Terrain(np.array([[0.0, 0.0, 30.0]]), cell_size=(10.0, 10.0))
    >>> np.degrees(adret.horizon_at(terrain, [0, 0], [0, 1], azimuths=[np.pi / 2])).round(2)
    array([[56.31, 71.57]], dtype=float32)
    """
    if not isinstance(terrain, Terrain):
        raise InputError("terrain", "a Terrain", type(terrain).__name__)
    options = HorizonOptions(
        method="exact",
        max_distance=max_distance,
        radius=radius,
        refraction=refraction,
        observer_height=observer_height,
    )
    azimuth = azimuth_set(directions, azimuths)
    row, column = (np.atleast_1d(np.asarray(a)) for a in (rows, columns))
    for field, index, length in (
        ("rows", row, terrain.shape[0]),
        ("columns", column, terrain.shape[1]),
    ):
        if index.ndim != 1 or index.dtype.kind not in "iu" or index.shape != row.shape:
            raise InputError(field, "a list of whole numbers, as many rows as columns", index)
        if index.size and (index.min() < 0 or index.max() >= length):
            raise InputError(
                field, f"between 0 and {length - 1}", index[(index < 0) | (index >= length)][0]
            )
    slope = methods.exact_points(terrain, options, azimuth, row, column)
    elevation = np.empty_like(slope)
    to_elevation(slope, elevation)
    return elevation
