"""Viewsheds: what one or many observers see, by exact lines of sight."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adret._kernels import sight as kernels
from adret._summaries import summary
from adret._values import real
from adret.errors import InputError
from adret.horizon import HorizonOptions
from adret.report import RunReport, remember
from adret.sight import (
    Cell,
    SightGrid,
    cell,
    check_terrain,
    height_above_ground,
    sight_options,
)
from adret.sight_rays import SightMethod
from adret.terrain import Terrain

__all__ = ["Viewshed", "total_viewshed", "viewshed"]

Progress = Callable[[int, int], None]
Range = tuple[float, float]

MAX_OBSERVERS = 1_000_000
BITS = 64
"""Observers that a bit field can name."""


@dataclass(frozen=True, slots=True, eq=False)
class Viewshed:
    """What the observers see.

    Attributes
    ----------
    visible : ndarray, shape (rows, columns), bool
        Whether at least one observer sees the target on this cell; False at nodata.
    count : ndarray, shape (rows, columns), uint16, or uint32 from 65 536 observers on
        Number of observers that see it.
    seen_by : ndarray, shape (rows, columns), uint64, or None
        Bit i (value 2**i) is set where observer i sees it; None for more than 64 observers.
    minimum_height : ndarray, shape (rows, columns), float32
        Least height above ground [m] at which a target is in the line of sight of the best placed
        observer: 0 where the ground itself is seen. NaN at nodata, and beyond the distance and the
        azimuths of all observers. Without `pitch_range` it is at most `target_height` exactly
        where `visible`.
    observers : tuple of (int, int)
        Row and column of every observer.
    terrain : Terrain
    report : RunReport
    """

    visible: NDArray[np.bool_]
    count: NDArray[np.uint16] | NDArray[np.uint32]
    seen_by: NDArray[np.uint64] | None
    minimum_height: NDArray[np.float32]
    observers: tuple[Cell, ...]
    terrain: Terrain
    report: RunReport

    __repr__ = summary

    @property
    def minimum_elevation(self) -> NDArray[np.float64]:
        """Elevation from which on a target is seen [m]: never below the ground."""
        return self.terrain.elevations() + self.minimum_height


def viewshed(
    terrain: Terrain,
    observers: Cell | Sequence[Cell] | ArrayLike,
    *,
    observer_height: float = 1.6,
    target_height: float = 0.0,
    max_distance: float | None = None,
    radius: float | None = None,
    refraction: float = 0.0,
    azimuth_range: Range | None = None,
    pitch_range: Range | None = None,
    progress: Progress | None = None,
) -> Viewshed:
    """Which cells one or many observers see, and how tall a target must be to be seen.

    Parameters
    ----------
    terrain : Terrain
    observers : (int, int), or array_like of int, shape (P, 2)
        Row and column of each observer, from 0; `cells_at` finds them for map coordinates.
    observer_height : float
        Height of the eyes above the ground [m].
    target_height : float
        Height of the targets above the ground [m].
    max_distance : float, optional
        Targets further away than this [m] are not seen.
    radius : float, optional
        Radius of the planet [m], such as ``terrain.body_radius``; None for a flat one.
    refraction : float
        Coefficient k of the ray's curvature, 0.13 or 1/7 on Earth, 0 without air; 0 without
        `radius`.
    azimuth_range : (float, float), optional
        Azimuths [radians clockwise from grid north] that the observers look at: from the first,
        clockwise, to the second.
    pitch_range : (float, float), optional
        Lowest and highest elevation [radians] at which the top of a target is looked at.
    progress : callable, optional
        Called with (observers done, observers in all); an exception from it ends the run.

    Returns
    -------
    Viewshed
        An observer always sees its own cell.

    Raises
    ------
    InputError
        If an observer is outside the raster or on nodata, or an option is out of range.

    Notes
    -----
    A target is seen unless the straight line from the eye to its top, above its cell's centre,
    runs below the surface at a crossing with a grid row or column; between two cell centres the
    surface is linear there. Touching is seeing. A crossing beside nodata hides nothing. With the
    same height on both ends, A sees B exactly when B sees A, to the last bit.

    Every target gets the verdict of its own line. The lines of a narrow wedge share bounds of
    their crossings, which leave few crossings that could be the highest: those are looked at.
    The time grows with the number of cells, except on an even slope that is looked at from exactly
    its own height, where all crossings tie.

    Examples
    --------
    >>> import numpy as np, adret
    >>> wall = np.zeros((1, 6)); wall[0, 3] = 10.0
    >>> seen = adret.viewshed(adret.Terrain(wall, (10.0, 10.0)), (0, 1), observer_height=5.0)
    >>> seen.count[0]
    array([1, 1, 1, 1, 0, 0], dtype=uint16)
    >>> seen.minimum_height[0]
    array([ 0. ,  0. ,  0. ,  0. , 12.5, 15. ], dtype=float32)
    """
    start = time.perf_counter()
    check_terrain(terrain)
    options = sight_options(observer_height, max_distance, radius, refraction)
    target_height = height_above_ground("target_height", target_height)
    azimuths = _azimuth_range(azimuth_range)
    pitches = _pitch_range(pitch_range)
    places = _places(observers, terrain)

    shape = terrain.shape
    count = np.zeros(shape, np.uint16 if len(places) < 65_536 else np.uint32)
    seen_by = np.zeros(shape, np.uint64) if len(places) <= BITS else None
    least = np.full(shape, np.nan, np.float32)
    run = _Run(terrain, options, target_height, azimuths, pitches)
    for number, place in enumerate(places):
        window, seen, above = run.see(place)
        count[window] += seen
        if seen_by is not None:
            seen_by[window] |= seen * np.uint64(1 << number)
        np.fmin(least[window], above, out=least[window])
        if progress is not None:
            progress(number + 1, len(places))
    report = remember(
        RunReport(
            method="exact",
            near=0,
            azimuths_swept=0,
            azimuths_skipped=0,
            cells=terrain.mask.size,
            cells_skipped=int(np.isnan(least).sum()),
            bands=1,
            seconds=time.perf_counter() - start,
        )
    )
    return Viewshed(count > 0, count, seen_by, least, places, terrain, report)


def total_viewshed(
    terrain: Terrain,
    directions: int = 32,
    *,
    observer_height: float = 1.6,
    method: SightMethod = "rays",
    near: int | None = None,
    max_distance: float | None = None,
    radius: float | None = None,
    refraction: float = 0.0,
    progress: Progress | None = None,
) -> NDArray[np.float32]:
    """Ground that an observer on each cell sees, in plan [m²]: a viewshed for every cell.

    Parameters
    ----------
    terrain : Terrain
    directions : int
        Number of azimuths in which sight is followed.
    observer_height : float
        Height of the eyes above the ground [m]. What is seen is ground.
    method, near
        As for `intervisibility`.
    max_distance, radius, refraction, progress
        As for `viewshed`; progress counts azimuths.

    Returns
    -------
    ndarray, shape (rows, columns), float32
        The observer's own cell left out; NaN at nodata.

    Raises
    ------
    InputError
        If an option is out of range.

    Notes
    -----
    It is ``intervisibility(reduce="visible_area")``: 2π times the mean over the azimuths of the
    visible ground along each, weighted by its distance. Between azimuths nothing is looked at.
    Ground between cell centres counts as that at them, and is seen a little less: on rugged ground
    the area comes out 1 to 2 % below that of the cells whose centre `viewshed` sees.

    Examples
    --------
    >>> import numpy as np, adret
    >>> flat = adret.Terrain(np.zeros((41, 41)), (10.0, 10.0))
    >>> area = adret.total_viewshed(flat, 64)
    >>> round(float(area[20, 20]) / (410.0 * 410.0), 2)
    1.0
    """
    from adret.visibility import intervisibility

    check_terrain(terrain)
    return intervisibility(
        terrain,
        directions,
        reduce="visible_area",
        observer_height=observer_height,
        method=method,
        near=near,
        max_distance=max_distance,
        radius=radius,
        refraction=refraction,
        progress=progress,
    )


class _Run:
    """What all observers of a run share."""

    def __init__(
        self,
        terrain: Terrain,
        options: HorizonOptions,
        target_height: float,
        azimuths: Range | None,
        pitches: Range | None,
    ) -> None:
        self.grid = SightGrid(terrain, options)
        self.options = options
        self.target_height = target_height
        self.azimuths = azimuths
        self.pitches = pitches
        self._seen = np.empty(terrain.shape, np.bool_)
        self._above = np.empty(terrain.shape, np.float32)
        # float32 heights that are just enough, and just not enough, to be seen.
        self._enough = np.float32(target_height)
        if self._enough > target_height:
            self._enough = np.nextafter(self._enough, np.float32(-np.inf))
        self._short = np.nextafter(self._enough, np.float32(np.inf))

    def see(
        self, place: Cell
    ) -> tuple[tuple[slice, slice], NDArray[np.bool_], NDArray[np.float32]]:
        """The window in reach of an observer, which targets it sees, and from what height."""
        grid, options = self.grid, self.options
        window = grid.window(place)
        seen, above = self._seen[window], self._above[window]
        seen[...] = False
        above[...] = np.nan
        eye = float(grid.terrain.heights[place]) + options.observer_height
        widths, norths = grid.squares(place[0])
        octants, drops, tasks = grid.octants(place, self.azimuths)
        kernels.see_from(
            grid.heights,
            grid.index(place),
            place[0],
            eye,
            self.target_height,
            options.bend,
            options.range * options.range * (1.0 + 1e-12),
            grid.slack(eye, self.target_height),
            octants,
            drops,
            tasks,
            widths,
            norths,
            self._seen.reshape(-1),
            self._above.reshape(-1),
        )
        np.copyto(above, np.minimum(above, self._enough), where=seen)
        np.copyto(above, np.maximum(above, self._short), where=~seen)
        if self.azimuths is not None or self.pitches is not None:
            self._limit(place, window, eye, widths, norths, seen, above)
        self._seen[place] = True
        self._above[place] = 0.0
        return window, seen, above

    def _limit(
        self,
        place: Cell,
        window: tuple[slice, slice],
        eye: float,
        widths: NDArray[np.float64],
        norths: NDArray[np.float64],
        seen: NDArray[np.bool_],
        above: NDArray[np.float32],
    ) -> None:
        """Take away what lies outside the azimuths and pitches looked at."""
        rows = np.arange(window[0].start, window[0].stop)
        columns = np.arange(window[1].start, window[1].stop) - place[1]
        north = (np.sign(place[0] - rows) * np.sqrt(norths[window[0]]))[:, np.newaxis]
        east = np.sqrt(widths[window[0]])[:, np.newaxis] * columns
        if self.azimuths is not None:
            first, width = self.azimuths
            outside = (np.arctan2(east, north) - first) % math.tau > width
            seen &= ~outside
            above[outside] = np.nan
        if self.pitches is not None:
            squared = east**2 + north**2
            top = self.grid.terrain.heights[window].astype(np.float64) + self.target_height
            pitch = np.arctan2(top - eye - self.options.bend * squared, np.sqrt(squared))
            seen &= (pitch >= self.pitches[0]) & (pitch <= self.pitches[1])


def _places(observers: object, terrain: Terrain) -> tuple[Cell, ...]:
    try:
        given = np.asarray(observers)
    except ValueError:
        given = np.empty(0)
    if given.shape == (2,):
        given = given[np.newaxis]
    whole = given.dtype.kind in "iu" and not np.ma.is_masked(observers)
    if given.ndim != 2 or given.shape[1] != 2 or not whole:
        raise InputError("observers", "pairs of a row and a column, whole numbers", observers)
    if not 1 <= len(given) <= MAX_OBSERVERS:
        raise InputError("observers", f"from 1 to {MAX_OBSERVERS} cells", len(given))
    return tuple(cell("observers", each, terrain) for each in given)


def _numbers(field: str, limit: str, pair: Range) -> Range:
    try:
        first, second = (real(field, value, limit) for value in pair)
    except (TypeError, ValueError):
        raise InputError(field, limit, pair) from None
    return first, second


def _azimuth_range(given: Range | None) -> Range | None:
    """First azimuth and width [radians]; None for the whole circle."""
    if given is None:
        return None
    limit = "two different azimuths in radians"
    first, second = _numbers("azimuth_range", limit, given)
    if second - first >= math.tau:
        return None
    width = (second - first) % math.tau
    if width == 0.0:
        raise InputError("azimuth_range", limit, given)
    return first % math.tau, width


def _pitch_range(given: Range | None) -> Range | None:
    if given is None:
        return None
    limit = "two elevations between -pi/2 and pi/2, the lower one first"
    low, high = _numbers("pitch_range", limit, given)
    if not -math.pi / 2 <= low < high <= math.pi / 2:
        raise InputError("pitch_range", limit, given)
    return low, high
