"""Height fields whose light is known in closed form (scenes T1 to T10 and the bowl's shadow mask).

A scene gives heights in metres above its own zero, the cell size, the exact values and the cells
where they hold.  Sizes are in cells unless a name says metres; angles are in radians.  The values
are those of the infinite or smooth surface; where a raster can only approach them, the docstring
says by how much.  Shares no code with adret.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Scene:
    """A height field with known answers.

    Attributes
    ----------
    heights : (rows, columns) float64 [m]
    cell_size : (dx, dy) [m]
    where : (rows, columns) bool
        Cells at which the values hold.
    values : dict
        Exact values: floats or (rows, columns) arrays under the names "visible", "horizontal",
        "normal" (sky-view factors), "openness+" and "openness-" [degrees].
    horizon : callable or None
        Azimuth [rad] -> exact horizon elevation [rad], a float or (rows, columns).
    """

    heights: Array
    cell_size: tuple[float, float]
    where: NDArray[np.bool_]
    values: dict[str, float | Array] = field(default_factory=dict)
    horizon: Callable[[float], float | Array] | None = None


def metres(shape: tuple[int, int], cell_size: tuple[float, float]) -> tuple[Array, Array]:
    """East and north coordinates [m] of the cell centres, from the middle cell."""
    rows, columns = shape
    i, j = np.mgrid[0:rows, 0:columns]
    return (j - columns // 2) * cell_size[0], (rows // 2 - i) * cell_size[1]


def _inside(shape: tuple[int, int], margin: int = 1) -> NDArray[np.bool_]:
    where = np.zeros(shape, dtype=bool)
    where[margin : shape[0] - margin, margin : shape[1] - margin] = True
    return where


def _centre(shape: tuple[int, int]) -> NDArray[np.bool_]:
    where = np.zeros(shape, dtype=bool)
    where[shape[0] // 2, shape[1] // 2] = True
    return where


def flat(shape: tuple[int, int] = (9, 11), cell_size: tuple[float, float] = (1.0, 1.0)) -> Scene:
    """T1: flat ground, open to the whole sky."""
    values: dict[str, float | Array] = {
        "visible": 1.0,
        "horizontal": 1.0,
        "normal": 1.0,
        "openness+": 90.0,
        "openness-": 90.0,
    }
    return Scene(np.zeros(shape), cell_size, _inside(shape), values, lambda azimuth: 0.0)


def plane(
    slope: float,
    aspect: float,
    shape: tuple[int, int] = (25, 31),
    cell_size: tuple[float, float] = (1.0, 1.0),
) -> Scene:
    """T2: plane of a slope, facing the downslope azimuth `aspect`.

    The first crossing already lies on the plane's own line, so every cell off the edge sees the
    infinite plane's horizon at every azimuth.
    """
    east, north = metres(shape, cell_size)
    heights = -np.tan(slope) * (east * np.sin(aspect) + north * np.cos(aspect))
    view = (1.0 + np.cos(slope)) / 2.0
    values: dict[str, float | Array] = {
        "visible": 1.0 - slope / np.pi,
        "horizontal": view,
        "normal": view,
        "openness+": 90.0,
        "openness-": 90.0,
    }
    return Scene(
        heights,
        cell_size,
        _inside(shape),
        values,
        lambda azimuth: float(np.arctan(-np.tan(slope) * np.cos(azimuth - aspect))),
    )


def canyon(
    west_angle: float,
    east_angle: float,
    distance: int = 8,
    shape: tuple[int, int] = (33, 41),
    cell_size: tuple[float, float] = (1.0, 200.0),
) -> Scene:
    """T3: a floor between two infinite walls that stand `distance` cells west and east of it.

    An angle of 0 is no wall, so the infinite wall is a canyon with one side at 0.  Long cells (dy
    much above dx) make a small raster a long street; the values hold at the middle cell, at
    azimuths whose ray meets the wall inside the raster.
    """
    east, _ = metres(shape, cell_size)
    reach = distance * cell_size[0]
    heights = np.zeros(shape)
    heights[east <= -reach] = reach * np.tan(west_angle)
    heights[east >= reach] = reach * np.tan(east_angle)

    def horizon(azimuth: float) -> float:
        angle = east_angle if np.sin(azimuth) > 0 else west_angle
        return float(np.arctan(np.tan(angle) * abs(np.sin(azimuth))))

    values: dict[str, float | Array] = {
        "visible": 1.0 - (west_angle + east_angle) / np.pi,
        "horizontal": (np.cos(west_angle) + np.cos(east_angle)) / 2.0,
        "normal": (np.cos(west_angle) + np.cos(east_angle)) / 2.0,
    }
    return Scene(heights, cell_size, _centre(shape), values, horizon)


def valley(
    slope: float,
    shape: tuple[int, int] = (33, 81),
    cell_size: tuple[float, float] = (1.0, 400.0),
) -> Scene:
    """T3: an endless V valley along the north; the values hold in the middle row.

    `values["normal"]` is the two-dimensional result for walls of the raster's width, which is
    cos² S at the foot of infinitely high ones: a wall point sees the sky from its own plane to the
    opposite crest at elevation c, so V_d = (1 + cos(S + c))/2.  On the floor line the central
    difference is zero, the normal is up and V_d = SVFh = cos S of the whole valley.
    """
    east, _ = metres(shape, cell_size)
    heights = np.tan(slope) * np.abs(east)
    half = abs(east[0, 0])
    away = np.abs(east)
    crest = np.arctan(np.tan(slope) * (half - away) / (half + away))
    view = (1.0 + np.cos(slope + crest)) / 2.0
    view[away == 0] = np.cos(slope)
    where = np.zeros(shape, dtype=bool)
    where[shape[0] // 2, 1:-1] = True
    visible = 1.0 - (slope + crest) / np.pi
    values: dict[str, float | Array] = {
        "visible": visible,
        "horizontal": (np.cos(slope) + np.cos(crest)) / 2.0,
        "normal": view,
    }
    return Scene(heights, cell_size, where, values)


def bowl(half_angle: float, size: int = 257, fill: float = 0.8) -> Scene:
    """T4: spherical cap of `half_angle` sunk into flat ground, cells of 1 m.

    The chord between two samples of the rim passes below it, so cells within about five cells of
    the rim lie off the values; `where` ends at nine tenths of the rim's radius.
    """
    shape = (size, size)
    east, north = metres(shape, (1.0, 1.0))
    rim = fill * size / 2.0
    radius = rim / np.sin(half_angle)
    away = np.hypot(east, north)
    inside = away <= rim
    depth = radius * np.cos(half_angle)
    heights = -np.sqrt(np.where(inside, radius**2 - away**2, depth**2))
    view = (1.0 + np.cos(half_angle)) / 2.0

    def horizon(azimuth: float) -> Array:
        along = east * np.sin(azimuth) + north * np.cos(azimuth)
        to_rim = -along + np.sqrt(np.maximum(along**2 + rim**2 - away**2, 0.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.arctan((-depth - heights) / to_rim)

    return Scene(
        heights, (1.0, 1.0), away < 0.9 * rim, {"horizontal": view, "normal": view}, horizon
    )


def bowl_lit(
    half_angle: float, sun: Array, size: int = 257, fill: float = 0.8
) -> NDArray[np.bool_]:
    """Shadow mask of `bowl`: lit iff z(X - 2(X·s)s) >= -r cos(half_angle), for a point sun s."""
    scene = bowl(half_angle, size, fill)
    east, north = metres(scene.heights.shape, scene.cell_size)
    radius = fill * size / 2.0 / np.sin(half_angle)
    dot = east * sun[0] + north * sun[1] + scene.heights * sun[2]
    return scene.heights - 2.0 * dot * sun[2] >= -radius * np.cos(half_angle)


def funnel(angle: float, size: int = 161, flat_radius: float = 24.0) -> Scene:
    """T5, T6: a funnel whose middle cell sees the horizon `angle` all round.

    Within `flat_radius` cells the cone is cut off flat: near its tip the chords between samples of
    a cone stand above it (by 8 % at the first ring, by 1/(8 d²) at d cells).  The middle cell's
    horizon, and so every value, is the whole funnel's; it is also that of a pit's centre whose
    depth over radius is tan(angle).  A raster's corners are cut to a circle.
    """
    east, north = metres((size, size), (1.0, 1.0))
    away = np.hypot(east, north)
    heights = np.where(away < flat_radius, 0.0, np.tan(angle) * away)
    degrees = np.degrees(angle)
    values: dict[str, float | Array] = {
        "visible": 1.0 - np.sin(angle),
        "horizontal": np.cos(angle) ** 2,
        "normal": np.cos(angle) ** 2,
        "openness+": 90.0 - degrees,
    }
    return Scene(heights, (1.0, 1.0), _centre((size, size)), values, lambda azimuth: angle)


def cone(slope: float, size: int = 161) -> Scene:
    """T5: the tip of a cone; the chords lie below it by 1/(8 d²) at d cells, so far out they agree.

    `funnel` upside down gives its negative openness.
    """
    east, north = metres((size, size), (1.0, 1.0))
    heights = -np.tan(slope) * np.hypot(east, north)
    degrees = np.degrees(slope)
    values: dict[str, float | Array] = {
        "visible": 1.0,
        "horizontal": 1.0,
        "normal": 1.0,
        "openness+": 90.0 + degrees,
    }
    return Scene(heights, (1.0, 1.0), _centre((size, size)), values, lambda azimuth: -slope)


def pit(depth: float, radius: int = 40) -> Scene:
    """T6: middle of a cylindrical pit in a plain, cells of 1 m.

    A raster's wall stands between `radius` and `radius` + 2 cells away, so the horizon lies between
    atan(depth/(radius + 2)) and atan(depth/radius), the true one.
    """
    size = 2 * radius + 9
    east, north = metres((size, size), (1.0, 1.0))
    heights = np.where(np.hypot(east, north) < radius, 0.0, depth)
    angle = np.arctan(depth / radius)
    values: dict[str, float | Array] = {
        "visible": 1.0 - np.sin(angle),
        "horizontal": radius**2 / (radius**2 + depth**2),
        "normal": radius**2 / (radius**2 + depth**2),
    }
    return Scene(heights, (1.0, 1.0), _centre((size, size)), values, lambda azimuth: float(angle))


RING_DISTANCE = 5000.04
RING_HEIGHT = 1000.0
# T7: horizon [rad] of the middle of the ring: flat, sphere, sphere with refraction 1/7.
RING_HORIZON = {"flat": 0.197394, "sphere": 0.197017, "refracted": 0.197071}


def ring(cells: int = 100) -> Scene:
    """T7: a ring wall of 1000 m at 5000.04 m; exact along the axes."""
    step = RING_DISTANCE / cells
    shape = (2 * cells + 9, 2 * cells + 9)
    east, north = metres(shape, (step, step))
    heights = np.where(np.hypot(east, north) < RING_DISTANCE - step / 4, 0.0, RING_HEIGHT)
    angle = float(np.arctan(RING_HEIGHT / RING_DISTANCE))
    return Scene(heights, (step, step), _centre(shape), {}, lambda azimuth: angle)


# T8: elevation [degrees] of a target 1000 m higher: distance [m] -> flat, sphere, refraction 0.13.
CURVATURE_DEG = {
    10_000.0: (5.7106, 5.6661, 5.6719),
    50_000.0: (1.1458, 0.9210, 0.9502),
    100_000.0: (0.5729, 0.1233, 0.1818),
    200_000.0: (0.2865, -0.6128, -0.4959),
}


def target(distance: float) -> Scene:
    """T8: two cells, the eastern one 1000 m higher at `distance` metres."""
    heights = np.array([[0.0, 1000.0]])
    return Scene(heights, (distance, distance), np.array([[True, False]]), {}, None)


# T8: dip of the sea horizon [rad] for an eye 100 m above the sea: acos(R/(R+H)).
SEA_DIP = float(np.radians(0.32102))


def sea(columns: int = 801, step: float = 100.0) -> Scene:
    """T8: calm sea eastwards of the first column."""
    where = np.zeros((1, columns), dtype=bool)
    where[0, 0] = True
    return Scene(np.zeros((1, columns)), (step, step), where, {}, None)


def overcast_ratio(angle: float) -> float:
    """T9: irradiance of a horizontal cell under an overcast sky above a uniform horizon, E/E0."""
    return float((3.0 * np.cos(angle) ** 2 + 4.0 * (1.0 - np.sin(angle) ** 3)) / 7.0)


# T9: a plane of 30 degrees under an overcast sky, against the horizontal one.
OVERCAST_PLANE_30 = 0.903201
OVERCAST_FLAT = 7.0 * np.pi / 9.0  # irradiance of the open horizontal for a zenith radiance of 1


def daily_extraterrestrial(latitude: float, declination: float, solar_constant: float) -> float:
    """T10: energy of one day on the open horizontal [J/m²], sun-earth distance 1."""
    half_day = np.arccos(np.clip(-np.tan(latitude) * np.tan(declination), -1.0, 1.0))
    return float(
        solar_constant
        * 86_400.0
        / np.pi
        * (
            half_day * np.sin(latitude) * np.sin(declination)
            + np.cos(latitude) * np.cos(declination) * np.sin(half_day)
        )
    )


def fractal(rng: np.random.Generator, shape: tuple[int, int], relief: float = 100.0) -> Array:
    """Rough terrain with a falling spectrum, heights in [0, relief] in steps of 1/64 m."""
    rows, columns = shape
    ky = np.fft.fftfreq(rows)[:, None]
    kx = np.fft.rfftfreq(columns)[None, :]
    k = np.hypot(ky, kx)
    k[0, 0] = np.inf
    noise = rng.normal(size=k.shape) + 1j * rng.normal(size=k.shape)
    z = np.fft.irfft2(noise * k**-1.9, s=shape)
    z = (z - z.min()) / max(np.ptp(z), 1e-30) * relief
    return np.round(z * 64.0) / 64.0
