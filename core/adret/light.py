"""Direct light: what a sky sends straight to each cell of a terrain."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adret import skips
from adret._kernels import light as kernels
from adret._kernels import normals as normal_kernels
from adret._summaries import summary
from adret.azimuths import azimuth_set
from adret.errors import InputError
from adret.horizon import HorizonOptions
from adret.horizon_keywords import HorizonKeywords
from adret.horizon_run import HorizonRun, Progress
from adret.layer_sum import LayerSum
from adret.nested_azimuths import (
    FIRST,
    Directions,
    Settled,
    automatic,
    report_of,
    settled,
)
from adret.normals import surface_slopes
from adret.report import RunReport
from adret.slices import LightSlice, Receivers, Sky, SmoothSlice
from adret.terrain import Terrain

__all__ = ["Light", "direct_light", "reflectance"]


@dataclass(frozen=True, slots=True, eq=False)
class Light:
    """Irradiance of a terrain.

    Attributes
    ----------
    irradiance : ndarray, shape (rows, columns) or (rows, columns, 3), float32
        On the tilted cell, in the unit of the sky (radiance times steradian); NaN at nodata.
    terrain : Terrain
    report : RunReport
        What was swept, and what could be skipped.
    bounces : int
        Number of bounces that the irradiance holds; 0 for direct light.
    residual : float
        Upper bound of what all further bounces could add to any cell, as a share of the largest
        irradiance here; 0 for direct light.
    """

    irradiance: NDArray[np.float32]
    terrain: Terrain
    report: RunReport
    bounces: int = 0
    residual: float = 0.0

    __repr__ = summary

    def radiance(self, albedo: ArrayLike = 1.0) -> NDArray[np.float32]:
        """Radiance that Lambertian ground sends back, albedo·irradiance/π.

        Parameters
        ----------
        albedo : float, or array_like of shape (rows, columns), (3,) or (rows, columns, 3)
            Reflected share, 0 to 1; NaN cells of an array stay NaN. Three values are red, green
            and blue, also under a sky of one band.

        Returns
        -------
        ndarray, shape (rows, columns) or (rows, columns, 3), float32
            In the unit of the sky's radiance; NaN at nodata.

        Raises
        ------
        InputError
            If a value is outside [0, 1] or the shape does not fit.

        Examples
        --------
        >>> import numpy as np, adret
        >>> flat = adret.Terrain(np.zeros((3, 3)), (1.0, 1.0))
        >>> light = adret.direct_light(flat, adret.UniformSky(2.0))
        >>> round(float(light.radiance(0.5)[1, 1]), 6)
        1.0
        """
        shape = self.terrain.shape
        share = reflectance(albedo, shape)
        irradiance = self.irradiance
        if share.shape == shape and irradiance.ndim == 3:
            share = share[:, :, None]
        elif share.ndim in (1, 3) and irradiance.ndim == 2:
            irradiance = irradiance[:, :, None]
        return np.asarray(share * irradiance * np.float32(1.0 / np.pi), dtype=np.float32)


def reflectance(albedo: ArrayLike, shape: tuple[int, int]) -> NDArray[np.float32]:
    """Albedo as checked numbers of shape (), (3,), `shape` or (*shape, 3); cells may be NaN."""
    try:
        share = np.asarray(albedo, dtype=np.float32)
    except (TypeError, ValueError):
        raise InputError("albedo", "numbers between 0 and 1", albedo) from None
    if share.shape not in ((), (3,), shape, (*shape, 3)):
        limit = f"one number, three, or of shape {shape} or {(*shape, 3)}"
        raise InputError("albedo", limit, f"shape {share.shape}")
    wrong = (share < 0.0) | (share > 1.0)
    if share.shape not in (shape, (*shape, 3)):
        wrong |= np.isnan(share)  # nodata is a matter of cells
    if wrong.any():
        raise InputError("albedo", "between 0 and 1", float(share[wrong][0]))
    return share


def direct_light(
    terrain: Terrain,
    sky: Sky,
    directions: Directions = 64,
    *,
    tolerance: float | None = None,
    normals: ArrayLike | None = None,
    progress: Progress | None = None,
    **horizon: Unpack[HorizonKeywords],
) -> Light:
    """Irradiance on every tilted cell, straight from the sky.

    Parameters
    ----------
    terrain : Terrain
    sky : UniformSky, OvercastSky, Sun or Environment
        Where the light comes from.
    directions : int or "auto"
        Number of azimuths of a whole sky. A sun up to 1° wide is one azimuth whatever this says.
        "auto" doubles them from 8 on until the result settles; the report says where.
    tolerance : float, optional
        For "auto": the mean of |change| that ends the doubling, as a share of the mean irradiance;
        default 0.002.
    normals : array_like, shape (3, rows, columns), optional
        Normals (east, north, up) to light instead of `surface_normals(terrain)`; of any length,
        up above 0; cells with NaN get NaN.
    progress : callable, optional
        Called with (azimuths done, azimuths in all); an exception from it ends the run.
    **horizon
        method, near, max_distance, radius, refraction and observer_height of `horizon_map`.

    Returns
    -------
    Light

    Raises
    ------
    InputError
        If an option is out of range.

    Notes
    -----
    In each slice of azimuth φ the cell sees the sky above e = max(h, hp): the horizon, or its own
    plane hp = atan(-(n_e sin φ + n_n cos φ)/n_u). Paper P1 (eq. 6) tabulates the slice's light over
    normal angle and horizon angle. But the normal enters the integral linearly, so two tables over
    e alone give it without interpolating normals: n_h A(e) + n_u B(e), with n_h = n_e sin φ + n_n
    cos φ, A and B the integrals of L cos² e and of L sin e cos e over the slice. Uniform and
    overcast skies have A and B in closed form. A sun is a sky whose slices are strips of its disc:
    there is one path for point, area and sky light.

    Under a uniform or an overcast sky, "auto" sweeps only the azimuths that a set has and the one
    before has not. The slices of pictures and wide suns change with their number: these skies are
    swept anew, at twice the cost of the last set.

    Azimuths that are dark above the lowest plane of any cell are not swept; `report` counts them.

    References
    ----------
    V. Timonen and J. Westerholm, "Scalable Height Field Self-Shadowing", 2010, section 6.

    Examples
    --------
    >>> import numpy as np, adret
    >>> flat = adret.Terrain(np.zeros((5, 5)), (1.0, 1.0))
    >>> light = adret.direct_light(flat, adret.Sun(180.0, 30.0, irradiance=1000.0))
    >>> round(float(light.irradiance[2, 2]), 2), light.report.azimuths_swept
    (500.0, 1)
    """
    if not isinstance(terrain, Terrain):
        raise InputError("terrain", "a Terrain", type(terrain).__name__)
    if not callable(getattr(sky, "slices", None)):
        raise InputError("sky", "a UniformSky, OvercastSky, Sun or Environment", sky)
    tolerance = automatic(directions, tolerance)
    options = HorizonOptions(**horizon)
    receivers = Receivers(*_slopes(terrain, normals))
    reports: list[RunReport] = []

    def irradiance(count: int, every: int) -> NDArray[Any]:
        """Sum over all slices of `count` (every 1), or over every other one (every 2)."""
        slices = sky.slices(count)[every - 1 :: every]
        total, run = _swept(terrain, slices, receivers, options, sky.bands, progress)
        reports.append(run.report(skipped=max(count // every - len(slices), 0)))
        return total

    if tolerance is None:
        count = len(azimuth_set(directions))  # type: ignore[arg-type]
        total, report = irradiance(count, 1), reports[0]
    else:
        found = _settled(sky, irradiance, tolerance)
        total, report = found.mean, report_of(reports, found)
    light = np.empty((*terrain.shape, sky.bands), dtype=np.float32)
    kernels.finish(receivers.to_east, receivers.to_north, total, light)
    return Light(light[:, :, 0] if sky.bands == 1 else light, terrain, report)


def _settled(sky: Sky, irradiance: Callable[[int, int], NDArray[Any]], tolerance: float) -> Settled:
    """Irradiance of enough azimuths."""
    if len(sky.slices(FIRST)) < FIRST:  # a narrow sun: one slice, however many are allowed
        return Settled(irradiance(FIRST, 1).astype(np.float64), len(sky.slices(FIRST)), 0.0)
    nested = all(isinstance(each, SmoothSlice) for each in sky.slices(FIRST))

    def sums(count: int, all_of_them: bool) -> NDArray[Any]:
        # A set's irradiance is the mean over its azimuths of `count` times their slices.
        every = 2 if nested and not all_of_them else 1
        return np.asarray(irradiance(count, every) * np.float64(count))

    return settled(sums, tolerance, None, nested=nested)


def _swept(
    terrain: Terrain,
    slices: list[Any],
    receivers: Receivers,
    options: HorizonOptions,
    bands: int,
    progress: Progress | None,
) -> tuple[NDArray[Any], HorizonRun]:
    """Irradiance over n_u of some slices, shape (bands, rows, columns)."""
    lit = {id(each) for each in lit_slices(slices, receivers)}
    azimuths = np.array([each.azimuth for each in slices], dtype=np.float64)
    only = [k for k, each in enumerate(slices) if id(each) in lit]
    run = HorizonRun(terrain, azimuths, options, progress, only=only)
    total = LayerSum((bands, *terrain.shape), len(slices))
    for k, slope in run.layers():
        total.at(run.number)
        slices[k].add(slope, receivers, total.layer)
        total.added()
    return total.total(), run


def lit_slices(slices: list[Any], receivers: Receivers) -> list[Any]:
    """The slices that are not dark above the lowest plane of any receiver."""
    if not skips.wanted("dark azimuths"):
        return slices
    candidates: list[LightSlice] = [each for each in slices if not each.dark_above(-np.pi / 2.0)]
    # Only slices that are dark above the horizontal need to know how low the planes look.
    low = [each for each in candidates if each.dark_above(0.0)]
    if not low:
        return candidates
    azimuth = np.array([each.azimuth for each in low])
    lowest = np.empty((len(receivers.to_east), len(low)), dtype=np.float32)
    normal_kernels.lowest_plane_slopes(
        receivers.to_east,
        receivers.to_north,
        np.sin(azimuth).astype(np.float32),
        np.cos(azimuth).astype(np.float32),
        lowest,
    )
    planes = np.arctan(lowest.min(axis=0).astype(np.float64))
    dark = {id(each) for each, plane in zip(low, planes, strict=True) if each.dark_above(plane)}
    return [each for each in candidates if id(each) not in dark]


def _slopes(
    terrain: Terrain, normals: ArrayLike | None
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Slopes of the receiving planes; NaN wherever the terrain is nodata."""
    if normals is None:
        return surface_slopes(terrain)
    given = np.asarray(normals)
    if given.dtype.kind not in "iuf":
        raise InputError("normals", "real numbers", str(given.dtype))
    if given.shape != (3, *terrain.shape):
        raise InputError("normals", f"of shape {(3, *terrain.shape)}", f"shape {given.shape}")
    east, north, up = given.astype(np.float64)
    if not (up[np.isfinite(up)] > 0.0).all() or np.isinf(given).any():
        raise InputError("normals", "finite or NaN, up above 0", float(np.nanmin(up)))
    outside = np.where(terrain.mask, np.nan, 0.0)
    return (
        np.asarray(outside - east / up, dtype=np.float32),
        np.asarray(outside - north / up, dtype=np.float32),
    )
