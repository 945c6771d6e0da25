"""Indirect light: what terrain reflects, or emits, to the terrain that sees it."""

import time
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adret._values import real
from adret.azimuths import azimuth_set
from adret.bounce_bounds import Maxima, Rest, left_out
from adret.errors import InputError
from adret.horizon import NEAR_DEFAULT, HorizonOptions
from adret.horizon_run import Progress
from adret.light import Light, direct_light, reflectance
from adret.report import RunReport, remember
from adret.slices import Sky
from adret.terrain import Terrain
from adret.transport import Transport

__all__ = ["BounceReport", "Rendering", "indirect_light", "render"]

MAX_BOUNCES = 1000
PER_PI = np.float32(1.0 / np.pi)
Layer = NDArray[np.float32]


@dataclass(frozen=True, slots=True, kw_only=True)
class BounceReport(RunReport):
    """Work done and work skipped by a run of bounces.

    Attributes
    ----------
    receivers, receivers_skipped : int
        Cells that walked their ray, once an azimuth and bounce, and cells that did not: nodata,
        those that see no terrain, and those that have converged.
    crossings_tested, crossings_hidden : int
        Crossings of rays with grid lines that were looked at, and those passed over because
        nothing near them is high enough to be seen. What lies behind the last visible crossing
        is in neither, after the first bounce.
    crossings_weighed, crossings_dark : int
        Crossings of visible groups whose light was added up, and those that are dark.
    """

    receivers: int
    receivers_skipped: int
    crossings_tested: int
    crossings_hidden: int
    crossings_weighed: int
    crossings_dark: int


@dataclass(frozen=True, slots=True, eq=False)
class Rendering:
    """A lit terrain.

    Attributes
    ----------
    radiance : ndarray, shape (rows, columns) or (rows, columns, 3), float32
        What leaves each cell: albedo·(direct + indirect)/π + emission, in the unit of the sky's
        radiance; NaN at nodata.
    direct, indirect : Light
    """

    radiance: Layer
    direct: Light
    indirect: Light


def indirect_light(
    terrain: Terrain,
    sky: Sky | None,
    albedo: ArrayLike,
    *,
    radiance: ArrayLike | None = None,
    emission: ArrayLike | None = None,
    bounces: int | Literal["converge"] = 1,
    directions: int = 32,
    tolerance: float = 1e-3,
    near: int = NEAR_DEFAULT,
    max_distance: float | None = None,
    radius: float | None = None,
    refraction: float = 0.0,
    progress: Progress | None = None,
) -> Light:
    """Irradiance on every tilted cell from the terrain that it sees.

    Parameters
    ----------
    terrain : Terrain
    sky : UniformSky, OvercastSky, Sun, Environment or None
        What lights the terrain first, by `direct_light`; unused when `radiance` is given.
    albedo : float, or array_like of shape (rows, columns), (3,) or (rows, columns, 3)
        Share that Lambertian ground reflects, 0 to 1. NaN cells of an array reflect nothing.
    radiance : float, or array_like of the same shapes, optional
        Radiance that leaves each cell at first, instead of the light of the sky.
    emission : float, or array_like of the same shapes, optional
        Radiance that cells send by themselves, added to the first: lava, lamps. NaN sends nothing.
    bounces : int or "converge"
        How often light is passed on, 1 to 1000; "converge" goes on until the residual is at most
        `tolerance`.
    directions : int
        Number of azimuths, for the bounces and for the sky.
    tolerance : float
        Largest residual of "converge", above 0. Cells whose light cannot change by more than a
        part of it are left out.
    near : int
        Cells along the larger axis component up to which every crossing of a cell's own ray with
        the grid counts; beyond it, those with grid lines across the larger component.
    max_distance : float, optional
        Terrain further away than this [m] is not seen.
    radius, refraction
        As for `horizon_map`.
    progress : callable, optional
        Called with (azimuths done, azimuths in all); an exception from it ends the run. With
        "converge" the number in all grows.

    Returns
    -------
    Light
        `irradiance` is the indirect part alone; `bounces` says how many were made, and `residual`
        bounds what all further ones could add to any cell, as a share of the largest indirect
        irradiance.

    Raises
    ------
    InputError
        If an option or an array cannot be used.

    Notes
    -----
    In each azimuth φ a running maximum of the slope walks away from the cell, starting at the
    cell's own plane. Where it rises from elevation e1 to e2, the band between sees the terrain
    there and receives L [n_h (A(e1) - A(e2)) + n_u (B(e1) - B(e2))], with A(e) = (π/2 - e - sin e
    cos e)/2, B(e) = cos² e / 2 and n_h = n_e sin φ + n_n cos φ. L is the mean of the radiance at
    both ends of the visible piece of surface. Elevations below the horizontal count, so a cell's
    share of sky and of terrain is that of ``sky_view_factor(kind="normal", clip=False)``. Terrain
    outside the raster sends nothing.

    The share that terrain fills of a cell's view is normalised to at most 1, so no bounce is
    brighter than albedo times the one before, whatever the number of directions.

    References
    ----------
    V. Timonen, "Low-complexity intervisibility in height fields", 2012, section 10.1.

    Examples
    --------
    >>> import numpy as np, adret
    >>> valley = adret.Terrain(np.abs(np.arange(-20.0, 21.0)) * np.ones((41, 1)), (1.0, 1.0))
    >>> light = adret.indirect_light(valley, adret.UniformSky(), 0.5, bounces="converge")
    >>> light.bounces, light.residual < 1e-3, round(float(light.irradiance[20, 10]), 2)
    (5, True, 0.3)
    """
    if not isinstance(terrain, Terrain):
        raise InputError("terrain", "a Terrain", type(terrain).__name__)
    azimuths = azimuth_set(directions)
    options = HorizonOptions(
        near=near, max_distance=max_distance, radius=radius, refraction=refraction
    )
    limit = bounce_limit(bounces)
    real("tolerance", tolerance, "above 0 and at most 1", np.nextafter(0.0, 1.0), 1.0)
    share = shares(albedo, terrain)
    start = time.perf_counter()
    if radiance is not None:
        first = _sent("radiance", radiance, terrain.shape)
    elif sky is None:
        raise InputError("sky", "a sky, unless radiance is given", sky)
    else:
        light = direct_light(
            terrain,
            sky,
            directions,
            near=near,
            max_distance=max_distance,
            radius=radius,
            refraction=refraction,
            progress=None if progress is None else lambda done, total: progress(0, len(azimuths)),
        )
        first = share * _planes(light.irradiance, terrain.shape) * PER_PI
    if emission is not None:
        first = first + _sent("emission", emission, terrain.shape)
    return _bounce(
        terrain,
        first,
        share,
        Transport(terrain, azimuths, options),
        limit,
        tolerance if bounces == "converge" else None,
        progress,
        start,
    )


def render(
    terrain: Terrain,
    sky: Sky,
    albedo: ArrayLike,
    bounces: int | Literal["converge"] = 1,
    *,
    emission: ArrayLike | None = None,
    directions: int = 64,
    tolerance: float = 1e-3,
    near: int = NEAR_DEFAULT,
    max_distance: float | None = None,
    radius: float | None = None,
    refraction: float = 0.0,
    progress: Progress | None = None,
) -> Rendering:
    """Radiance that leaves every cell: direct light and bounces, reflected, and emission.

    Parameters
    ----------
    terrain, sky, albedo, bounces, emission, directions, tolerance, near, max_distance, radius, \
refraction, progress
        As for `indirect_light`; 0 bounces are direct light alone.

    Returns
    -------
    Rendering

    Raises
    ------
    InputError
        If an option or an array cannot be used.

    Examples
    --------
    >>> import numpy as np, adret
    >>> flat = adret.Terrain(np.zeros((5, 5)), (1.0, 1.0))
    >>> picture = adret.render(flat, adret.Sun(180.0, 30.0, irradiance=1000.0), 0.3)
    >>> round(float(picture.radiance[2, 2]), 2)
    47.75
    """
    direct = direct_light(
        terrain,
        sky,
        directions,
        near=near,
        max_distance=max_distance,
        radius=radius,
        refraction=refraction,
        progress=None if progress is None else lambda done, total: progress(0, directions),
    )
    sent = direct.radiance(albedo)
    if bounces == 0 and not isinstance(bounces, bool):
        indirect = replace(direct, irradiance=direct.irradiance * np.float32(0.0))
    else:
        indirect = indirect_light(
            terrain,
            None,
            albedo,
            radiance=sent,
            emission=emission,
            bounces=bounces,
            directions=directions,
            tolerance=tolerance,
            near=near,
            max_distance=max_distance,
            radius=radius,
            refraction=refraction,
            progress=progress,
        )
    total = _planes(sent, terrain.shape) + _planes(indirect.radiance(albedo), terrain.shape)
    if emission is not None:
        total = total + _sent("emission", emission, terrain.shape)
    return Rendering(_layers(total), direct, indirect)


def _bounce(
    terrain: Terrain,
    sent: Layer,
    share: Layer,
    transport: Transport,
    limit: int,
    tolerance: float | None,
    progress: Progress | None,
    start: float,
) -> Light:
    """Pass light on until the limit, or until the residual is within the tolerance."""
    sent = _outgoing(terrain, sent, share)
    total = np.zeros(sent.shape)
    rest = Rest(tolerance, sent=float(sent.max()))
    azimuths, done, made = transport.count, 0, 0
    residual = 0.0

    def step() -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, azimuths * (limit if tolerance is None else made + 1))

    while made < limit and sent.any():
        needed, missing = None, 0.0
        if made:
            needed, bound = rest.needed(transport.view)
            missing = left_out(bound, needed)
        received = np.nan_to_num(transport(sent, needed, step))
        total += received
        sent = share * received * PER_PI
        made += 1
        residual = rest.after(Maxima.of(sent, total, transport.view, share, missing))
        if tolerance is not None and residual <= tolerance:
            break
    if not made:
        transport.work.receivers_skipped = int(terrain.mask.size) * azimuths
    report = BounceReport(
        method="bounce",
        near=transport.options.near,
        azimuths_swept=azimuths * made,
        azimuths_skipped=0 if made else azimuths,
        cells=int(terrain.mask.size),
        cells_skipped=int(terrain.mask.sum()),
        bands=transport.bands,
        seconds=time.perf_counter() - start,
        **vars(transport.work),
    )
    return Light(irradiance_of(terrain, total), terrain, remember(report), made, residual)


def shares(albedo: ArrayLike, terrain: Terrain) -> Layer:
    """Albedo as planes (1 or 3, rows or 1, columns or 1); 0 instead of NaN."""
    return np.nan_to_num(_planes(reflectance(albedo, terrain.shape), terrain.shape))


def first_sent(
    terrain: Terrain, radiance: ArrayLike, emission: ArrayLike | None, share: Layer
) -> Layer:
    """Radiance that leaves the cells before any bounce, shape (1 or 3, rows, columns)."""
    first = _sent("radiance", radiance, terrain.shape)
    if emission is not None:
        first = first + _sent("emission", emission, terrain.shape)
    return _outgoing(terrain, first, share)


def irradiance_of(terrain: Terrain, total: NDArray[np.float64]) -> Layer:
    """The sum of all bounces, (bands, rows, columns), as it is handed out; NaN at nodata."""
    return _layers(np.where(terrain.mask, np.nan, total).astype(np.float32))


def bounce_limit(bounces: Any) -> int:
    """Bounces at the most, checked."""
    if isinstance(bounces, str) and bounces == "converge":
        return MAX_BOUNCES
    wrong = isinstance(bounces, (bool, str)) or not isinstance(bounces, (int, np.integer))
    if wrong or not 1 <= bounces <= MAX_BOUNCES:
        limit = f"a whole number from 1 to {MAX_BOUNCES}, or 'converge'"
        raise InputError("bounces", limit, bounces)
    return int(bounces)


def _outgoing(terrain: Terrain, sent: Layer, share: Layer) -> Layer:
    """What is sent, with as many bands as light and ground have; nodata sends nothing."""
    shape = (max(len(sent), len(share)), *terrain.shape)
    return np.where(terrain.mask, np.float32(0.0), np.broadcast_to(sent, shape))


def _sent(field: str, values: ArrayLike, shape: tuple[int, int]) -> Layer:
    """Radiance as planes (1 or 3, rows or 1, columns or 1), 0 instead of NaN."""
    try:
        given = np.asarray(values, dtype=np.float32)
    except (TypeError, ValueError):
        raise InputError(field, "numbers of 0 or more", values) from None
    if given.shape not in ((), (3,), shape, (*shape, 3)):
        limit = f"one number, three, or of shape {shape} or {(*shape, 3)}"
        raise InputError(field, limit, f"shape {given.shape}")
    planes = np.nan_to_num(_planes(given, shape), nan=0.0, posinf=np.inf)
    wrong = ~((planes >= 0.0) & np.isfinite(planes))
    if wrong.any():
        raise InputError(field, "finite, 0 or more", float(planes[wrong][0]))
    return planes


def _planes(values: Layer, shape: tuple[int, int]) -> Layer:
    """(), (3,), `shape` or (*shape, 3) as (bands, rows or 1, columns or 1)."""
    if values.ndim == 0 or values.shape == shape:
        return values.reshape(1, *(values.shape or (1, 1)))
    if values.ndim == 1:
        return values.reshape(3, 1, 1)
    return np.moveaxis(values, 2, 0)


def _layers(planes: Layer) -> Layer:
    """(bands, rows, columns) as (rows, columns) or (rows, columns, 3)."""
    return planes[0] if len(planes) == 1 else np.ascontiguousarray(np.moveaxis(planes, 0, 2))
