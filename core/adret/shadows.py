"""Shadows of a sun: codes, and the visible share of its disc."""

from dataclasses import dataclass
from enum import IntEnum
from math import radians, sin, tan
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from adret._kernels import shadows as kernels
from adret._summaries import summary
from adret.errors import InputError
from adret.horizon import HorizonOptions
from adret.horizon_keywords import HorizonKeywords
from adret.horizon_run import HorizonRun, Progress
from adret.layer_sum import LayerSum
from adret.light import lit_slices
from adret.normals import surface_slopes
from adret.report import RunReport
from adret.skies import Sun
from adret.slices import Receivers, sine_cosine
from adret.terrain import Terrain

__all__ = ["Shadow", "ShadowCode", "shadow"]

# Azimuths that a disc wider than 1° may be cut into.
MAX_STRIPS = 64


class ShadowCode(IntEnum):
    """What keeps the centre of the sun from a cell."""

    LIT = 0  # nothing
    SELF_SHADOWED = 1  # the cell faces away
    CAST = 2  # terrain stands in between
    MASKED = 3  # the cell is nodata


@dataclass(frozen=True, slots=True, eq=False)
class Shadow:
    """Shadows of a terrain under one sun.

    Attributes
    ----------
    code : ndarray, shape (rows, columns), uint8
        For the sun's centre: 0 lit, 1 self-shadowed, 2 cast shadow, 3 masked (`ShadowCode`).
    lit : ndarray, shape (rows, columns), float32
        Share of the solar disc above the horizon and above the cell's own plane, 0 to 1; NaN at
        nodata. Zero exactly where the sun's irradiance is zero.
    terrain : Terrain
    report : RunReport
    """

    code: NDArray[np.uint8]
    lit: NDArray[np.float32]
    terrain: Terrain
    report: RunReport

    __repr__ = summary


def shadow(
    terrain: Terrain,
    sun: Sun,
    *,
    progress: Progress | None = None,
    **horizon: Unpack[HorizonKeywords],
) -> Shadow:
    """Self-shadow, cast shadow and penumbra of one sun.

    Parameters
    ----------
    terrain : Terrain
    sun : Sun
        Its irradiance does not matter.
    progress : callable, optional
        Called with (azimuths done, azimuths in all); an exception from it ends the run.
    **horizon
        method, near, max_distance, radius, refraction and observer_height of `horizon_map`.

    Returns
    -------
    Shadow

    Raises
    ------
    InputError
        If an option is out of range.

    Notes
    -----
    A cell is self-shadowed when n·s <= 0 for the direction s of the sun's centre, else in cast
    shadow when the centre is at or below the horizon. The share of the disc is within 1e-4 of
    [acos(-u) + u sqrt(1 - u²)]/π, u the height of the centre above the higher of the two edges in
    radii: elevations carry an error of up to 2e-7 rad.

    Only the azimuths of the disc are swept (one up to 1°), and none where every cell faces away.

    Examples
    --------
    >>> import numpy as np, adret
    >>> wall = np.zeros((1, 6)); wall[0, 0] = 10.0
    >>> shade = adret.shadow(adret.Terrain(wall, (10.0, 10.0)), adret.Sun(270.0, 20.0))
    >>> shade.code[0]
    array([1, 1, 2, 0, 0, 0], dtype=uint8)
    """
    if not isinstance(terrain, Terrain):
        raise InputError("terrain", "a Terrain", type(terrain).__name__)
    if not isinstance(sun, Sun):
        raise InputError("sun", "a Sun", type(sun).__name__)
    options = HorizonOptions(**horizon)
    receivers = Receivers(*surface_slopes(terrain))
    strips = sun.share_slices(MAX_STRIPS)
    visible = {id(each) for each in lit_slices(strips, receivers)}
    azimuths = np.array([each.azimuth for each in strips], dtype=np.float64)
    only = [k for k, each in enumerate(strips) if id(each) in visible]
    run = HorizonRun(terrain, azimuths, options, progress, only=only)
    code = np.full(terrain.shape, ShadowCode.SELF_SHADOWED, dtype=np.uint8)
    code[terrain.mask] = ShadowCode.MASKED
    total = LayerSum((1, *terrain.shape), len(strips))
    # At the zenith the slope is finite, and above all that heights and cell sizes can make.
    slope_of_sun = np.float32(min(max(tan(radians(sun.elevation_deg)), -1e18), 1e18))
    if abs(sun.elevation_deg) == 90.0:
        slope_of_sun = np.float32(1e18 * sin(radians(sun.elevation_deg)))
    for k, slope in run.layers():
        total.at(run.number)
        strips[k].add(slope, receivers, total.layer)
        total.added()
        if k == 0:
            kernels.shadow_codes(
                slope,
                receivers.to_east,
                receivers.to_north,
                *sine_cosine(strips[0].azimuth),
                slope_of_sun,
                code,
            )
    lit = np.asarray(total.total()[0], dtype=np.float32)
    lit[terrain.mask] = np.nan
    np.clip(lit, 0.0, 1.0, out=lit)  # keeps NaN
    return Shadow(code, lit, terrain, run.report())
