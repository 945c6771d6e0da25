"""Sky-view factors and openness, from a horizon map or fused with the sweep over a terrain."""

from collections.abc import Callable, Iterator
from copy import copy
from typing import Any, Literal, Unpack, get_args

import numpy as np
from numpy.typing import NDArray

from adret._kernels import horizon_integrals as kernels
from adret._values import one_of, whole
from adret.azimuths import azimuth_set
from adret.errors import InputError
from adret.horizon import HorizonMap, HorizonOptions
from adret.horizon_keywords import HorizonKeywords
from adret.horizon_run import HorizonRun, Progress
from adret.layer_sum import LayerSum
from adret.nested_azimuths import Directions, automatic, between, report_of, settled
from adret.normals import surface_slopes
from adret.slices import sine_cosine
from adret.terrain import Terrain

__all__ = ["openness", "sky_view_factor"]

Kind = Literal["visible", "horizontal", "normal"]
Layer = NDArray[np.float32]
AddLayer = Callable[[float, Layer, Layer], None]

# Slope that stands for the vertical; heights and cell sizes cannot make a steeper one.
STEEPEST = np.float32(2e15)
FLAT = np.float32(0.0)


def sky_view_factor(
    x: HorizonMap | Terrain,
    kind: Kind = "visible",
    directions: Directions = 64,
    clip: bool = True,
    *,
    tolerance: float | None = None,
    progress: Progress | None = None,
    **horizon: Unpack[HorizonKeywords],
) -> NDArray[np.float32]:
    """Share of the sky that each cell sees [-].

    Parameters
    ----------
    x : HorizonMap or Terrain
        A terrain is swept on the fly: one layer is held, never all K.
    kind : {"visible", "horizontal", "normal"}
        "visible": share of the upper hemisphere's solid angle, ⟨1 - sin h⟩. "horizontal": weighted
        by the cosine on a horizontal cell, ⟨cos² h⟩. "normal": weighted by the cosine on the
        tilted cell, V_d of Dozier and Frew.
    directions : int or "auto"
        Number K of azimuths for a terrain; a horizon map brings its own. "auto" doubles them from
        8 on until the result settles; `last_run_report` says where.
    clip : bool
        For "normal": True counts only sky above the horizontal; an infinite plane of slope S then
        has (1 + cos S)/2. False lets a tilted cell look below the horizontal, and the plane has 1.
    tolerance : float, optional
        For "auto": the mean of |change| that ends the doubling, as a share of 1; default 0.002.
    progress : callable, optional
        Called with (azimuths done, azimuths in all); an exception from it ends the run.
    **horizon
        method, near, max_distance, radius, refraction and observer_height of `horizon_map`; for
        a terrain only.

    Returns
    -------
    ndarray, shape (rows, columns), float32
        NaN at nodata; 0 to 1, up to rounding and azimuth count.

    Raises
    ------
    InputError
        If an option is out of range, or the map's azimuths are not equally spaced.

    Notes
    -----
    ⟨·⟩ is the mean over azimuths φ and h is clipped at 0. With n the cell's normal, its own plane's
    horizon hp = atan(-(n_e sin φ + n_n cos φ)/n_u) and e = max(h, hp, 0):
    V_d = ⟨(n_e sin φ + n_n cos φ)(π/2 - e - ½ sin 2e) + n_u cos² e⟩.

    References
    ----------
    J. Dozier and J. Frew, "Rapid calculation of terrain parameters for radiation modeling from
    digital elevation data", 1990, eq. 7b. K. Zakšek, K. Oštir and Ž. Kokalj, "Sky-view factor as a
    relief visualization technique", 2011.

    Examples
    --------
    >>> import numpy as np, adret
    >>> slope = adret.Terrain(np.tile(np.arange(9.0), (9, 1)), (1.0, 1.0))  # 45 degrees
    >>> round(float(adret.sky_view_factor(slope, "normal")[4, 4]), 4)
    0.8536
    """
    one_of("kind", kind, get_args(Kind))
    add: AddLayer
    if kind == "visible":

        def add(azimuth: float, slope: Layer, total: Layer) -> None:
            kernels.add_sine(slope, total)

    elif kind == "horizontal":

        def add(azimuth: float, slope: Layer, total: Layer) -> None:
            kernels.add_cosine_squared(slope, total)

    else:
        to_east, to_north = surface_slopes(x if isinstance(x, Terrain) else x.terrain)
        lowest = FLAT if clip else -STEEPEST

        def add(azimuth: float, slope: Layer, total: Layer) -> None:
            sine, cosine = sine_cosine(azimuth)
            kernels.add_tilted(slope, to_east, to_north, sine, cosine, lowest, total)

    mean = _mean_over_azimuths(x, add, directions, tolerance, 1.0, progress, horizon)
    if kind == "visible":
        mean = 1.0 - mean
    elif kind == "normal":
        mean /= np.sqrt(1.0 + to_east * to_east + to_north * to_north)
        np.maximum(mean, 0.0, out=mean)  # keeps NaN
    return mean


def openness(
    x: HorizonMap | Terrain,
    sign: Literal[1, -1] = 1,
    directions: Directions = 64,
    *,
    tolerance: float | None = None,
    progress: Progress | None = None,
    **horizon: Unpack[HorizonKeywords],
) -> NDArray[np.float32]:
    """Mean angle between the zenith (or nadir) and the horizon [degrees].

    Parameters
    ----------
    x : HorizonMap or Terrain
        A terrain is swept on the fly: one layer is held, never all K.
    sign : {+1, -1}
        +1: positive openness, ⟨90° - h⟩. -1: negative openness, the positive openness of the
        terrain turned upside down; it needs a terrain.
    directions : int or "auto"
        Number K of azimuths for a terrain; a horizon map brings its own. "auto" doubles them from
        8 on until the result settles; `last_run_report` says where.
    tolerance : float, optional
        For "auto": the mean of |change| that ends the doubling, as a share of 90°; default 0.002.
    progress : callable, optional
        Called with (azimuths done, azimuths in all); an exception from it ends the run.
    **horizon
        method, near, max_distance, radius, refraction and observer_height of `horizon_map`; for
        a terrain only.

    Returns
    -------
    ndarray, shape (rows, columns), float32
        0 to 180 degrees; NaN at nodata. Horizons below the horizontal count as they are; where no
        terrain lies in a direction, 180°.

    Raises
    ------
    InputError
        If an option is out of range, the map's azimuths are not equally spaced, or the negative
        openness of a horizon map is asked for.

    References
    ----------
    R. Yokoyama, M. Shirasawa and R. Pike, "Visualizing topography by openness", 2002.

    Examples
    --------
    >>> import numpy as np, adret
    >>> plain = adret.Terrain(np.zeros((9, 9)), (1.0, 1.0))
    >>> adret.openness(plain)[4, 4], adret.openness(plain, -1)[4, 4]
    (np.float32(90.0), np.float32(90.0))
    """
    if abs(whole("sign", sign, "1 or -1", -1, 1)) != 1:
        raise InputError("sign", "1 or -1", sign)
    if sign == -1:
        if not isinstance(x, Terrain):
            raise InputError("x", "a Terrain for negative openness", type(x).__name__)
        x = _upside_down(x)

    def add(azimuth: float, slope: Layer, total: Layer) -> None:
        kernels.add_angle(slope, total)

    mean = _mean_over_azimuths(x, add, directions, tolerance, np.pi / 2.0, progress, horizon)
    return np.asarray(90.0 - np.degrees(mean), dtype=np.float32)


def _upside_down(terrain: Terrain) -> Terrain:
    turned = copy(terrain)  # the same grid, and the same place in its raster
    turned._heights = -terrain.heights
    turned._heights.setflags(write=False)
    seen = terrain.view
    if seen.frames is not None:
        frames = seen.frames.upside_down()
        turned._view = seen._replace(heights=frames.heights(), frames=frames)
    elif seen.heights is terrain.heights:
        turned._view = seen._replace(heights=turned._heights)
    else:
        turned._view = seen._replace(heights=-seen.heights)
    turned._datum = -terrain.datum
    return turned


def _mean_over_azimuths(
    x: HorizonMap | Terrain,
    add: AddLayer,
    directions: Directions,
    tolerance: float | None,
    scale: float,
    progress: Progress | None,
    horizon: HorizonKeywords,
) -> NDArray[np.float32]:
    """Mean of what `add` adds for every azimuth, shape (rows, columns)."""
    tolerance = automatic(directions, tolerance)
    if isinstance(x, HorizonMap):
        for name in horizon:
            raise InputError(name, "left out for a horizon map, which has its own", horizon)
        azimuths = _evenly_spaced(x.azimuth)
        total = _sum(x.terrain.shape, azimuths, _map_layers(x, progress), add)
        return np.asarray(total / len(azimuths), dtype=np.float32)
    if not isinstance(x, Terrain):
        raise InputError("x", "a HorizonMap or a Terrain", type(x).__name__)
    options, reports = HorizonOptions(**horizon), []

    def sums(count: int, all_of_them: bool) -> NDArray[Any]:
        azimuths = azimuth_set(count) if all_of_them else between(count // 2)
        run = HorizonRun(x, azimuths, options, progress)
        total = _sum(x.shape, azimuths, run.layers(), add)
        reports.append(run.report())
        return total

    if tolerance is None:
        azimuths = azimuth_set(directions)  # type: ignore[arg-type]
        return np.asarray(sums(len(azimuths), True) / len(azimuths), dtype=np.float32)
    found = settled(sums, tolerance, scale)
    report_of(reports, found)
    return np.asarray(found.mean, dtype=np.float32)


def _sum(
    shape: tuple[int, int],
    azimuths: NDArray[np.float64],
    layers: Iterator[tuple[int, Layer]],
    add: AddLayer,
) -> NDArray[Any]:
    total = LayerSum((1, *shape), len(azimuths))
    for k, slope in layers:
        add(float(azimuths[k]), slope, total.layer[0])
        total.added()
    return np.asarray(total.total()[0])


def _evenly_spaced(azimuth: NDArray[np.float64]) -> NDArray[np.float64]:
    """The azimuths themselves, if they divide the circle evenly."""
    ordered = np.sort(azimuth)
    gaps = np.diff(ordered, append=ordered[0] + 2.0 * np.pi)
    if np.ptp(gaps) > 1e-6:
        raise InputError("azimuths", "equally spaced round the circle", azimuth.tolist())
    return azimuth


def _map_layers(x: HorizonMap, progress: Progress | None) -> Iterator[tuple[int, Layer]]:
    """The layers of a horizon map as slopes, like those of a sweep."""
    slope = np.empty(x.terrain.shape, dtype=np.float32)
    for k, elevation in enumerate(x.elevation):
        kernels.slopes_of_angles(elevation, STEEPEST, slope)
        yield k, slope
        if progress is not None:
            progress(k + 1, len(x.elevation))
