"""Skies: where the light comes from, and how much."""

from dataclasses import dataclass
from math import acos, asin, atan2, ceil, cos, hypot, pi, radians, sin

import numpy as np
from numpy.typing import NDArray

from adret._values import real
from adret.environments import Environment
from adret.slices import LightSlice, SmoothSlice, TableSlice

__all__ = ["Environment", "OvercastSky", "Sun", "UniformSky"]

# A disc up to this diameter is one slice; a larger one is cut into slices no wider than this.
STRIP_WIDTH = radians(1.0)
STRIP_SAMPLES = 32
DISC_STEPS = 2048
MIN_DISC_RADIUS = 1e-6


def _check_not_negative(field: str, value: float) -> None:
    real(field, value, "a number of 0 or more", 0.0)


@dataclass(frozen=True)
class UniformSky:
    """The same radiance from everywhere above the horizontal, none from below.

    Parameters
    ----------
    radiance : float
        Radiance [any unit U]; irradiance then comes in U sr, π·radiance on open flat ground.

    Notes
    -----
    Closed form of paper P1, eq. 5, but without its factor sin(π/n)/(π/n) on the horizontal term.
    The factor is exact where the horizon is constant across a swath; where the cell's own plane
    is the horizon it spoils the midpoint rule. Largest error on open planes of 10° to 80° against
    π(1 + cos S)/2, without and with the factor: 1.6e-3 and 6.8e-3 of it at 16 azimuths (3e-7 and
    2.3e-3 up to 50°), 4.0e-5 and 1.4e-3 at 32, 7e-8 and 3.3e-4 at 64.

    Examples
    --------
    >>> UniformSky(2.0).bands
    1
    """

    radiance: float = 1.0

    def __post_init__(self) -> None:
        _check_not_negative("radiance", self.radiance)

    @property
    def bands(self) -> int:
        """One band."""
        return 1

    def slices(self, directions: int) -> list[LightSlice]:
        """Equal slices, the first one about north."""
        width = 2.0 * pi / directions
        return [SmoothSlice(width * k, width * self.radiance, 0.0) for k in range(directions)]


@dataclass(frozen=True)
class OvercastSky:
    """CIE (Moon-Spencer) overcast sky: radiance L = zenith_radiance·(1 + 2 sin e)/3.

    Parameters
    ----------
    zenith_radiance : float
        Radiance at the zenith [any unit U]; open flat ground gets 7π/9 of it [U sr].

    References
    ----------
    P. Moon and D. E. Spencer, "Illumination from a non-uniform sky", 1942.

    Examples
    --------
    >>> OvercastSky().zenith_radiance
    1.0
    """

    zenith_radiance: float = 1.0

    def __post_init__(self) -> None:
        _check_not_negative("zenith_radiance", self.zenith_radiance)

    @property
    def bands(self) -> int:
        """One band."""
        return 1

    def slices(self, directions: int) -> list[LightSlice]:
        """Equal slices, the first one about north."""
        width = 2.0 * pi / directions
        third = width * self.zenith_radiance / 3.0
        return [SmoothSlice(width * k, third, 2.0 * third) for k in range(directions)]


@dataclass(frozen=True)
class Sun:
    """A round, evenly bright disc in the sky: a sun, a moon, or an area light at any size.

    Parameters
    ----------
    azimuth_deg : float
        Azimuth of the centre [degrees clockwise from grid north]; any finite number.
    elevation_deg : float
        Elevation of the centre [degrees], -90 to 90.
    irradiance : float
        Irradiance across the beam, on a plane that faces the disc [any unit].
    angular_diameter_deg : float
        Diameter [degrees], 0 to 180; below 0.0001 it is a point with hard shadows.

    Notes
    -----
    Discs up to 1° are one slice: one azimuth is swept, and the visible fraction over a horizon at
    u radii below the centre is [acos(-u) + u sqrt(1 - u²)]/π. Larger discs are cut into an odd
    number of slices at most 1° wide (but no more than `directions`), each with the part of the
    disc that lies in it.

    Examples
    --------
    >>> Sun(315.0, 35.0) == Sun(-45.0, 35.0)
    True
    """

    azimuth_deg: float
    elevation_deg: float
    irradiance: float = 1.0
    angular_diameter_deg: float = 0.533

    def __post_init__(self) -> None:
        folded = real("azimuth_deg", self.azimuth_deg, "a finite number") % 360.0
        real("elevation_deg", self.elevation_deg, "between -90 and 90", -90.0, 90.0)
        _check_not_negative("irradiance", self.irradiance)
        diameter = self.angular_diameter_deg
        real("angular_diameter_deg", diameter, "between 0 and 180", 0.0, 180.0)
        object.__setattr__(self, "azimuth_deg", folded if folded < 360.0 else 0.0)

    @property
    def bands(self) -> int:
        """One band."""
        return 1

    @property
    def direction(self) -> NDArray[np.float64]:
        """Unit vector (east, north, up) towards the centre, shape (3,), float64."""
        azimuth, elevation = radians(self.azimuth_deg), radians(self.elevation_deg)
        return np.array(
            [cos(elevation) * sin(azimuth), cos(elevation) * cos(azimuth), sin(elevation)]
        )

    def slices(self, directions: int) -> list[LightSlice]:
        """The strips of the disc, the one through its centre first."""
        return [strip.light(self.irradiance) for strip in self._strips(directions)]

    def share_slices(self, directions: int) -> list[TableSlice]:
        """Slices that add the share of the disc above the horizon to an upright unit."""
        return [strip.share() for strip in self._strips(directions)]

    def _strips(self, directions: int) -> list["_Strip"]:
        azimuth, elevation = radians(self.azimuth_deg), radians(self.elevation_deg)
        radius = max(radians(self.angular_diameter_deg) / 2.0, MIN_DISC_RADIUS)
        if 2.0 * radius <= STRIP_WIDTH * (1.0 + 1e-9):
            return [_narrow_disc(azimuth, elevation, radius)]
        return _wide_disc(azimuth, elevation, radius, directions)


@dataclass(frozen=True, eq=False)
class _Strip:
    """Weights of a disc's strip above each entry, for an irradiance of 1 across the beam."""

    azimuth: float
    first: float
    step: float
    horizontal: NDArray[np.float64]
    vertical: NDArray[np.float64]
    visible: NDArray[np.float64]

    def light(self, irradiance: float) -> TableSlice:
        return TableSlice(
            self.azimuth,
            self.first,
            self.step,
            irradiance * self.horizontal[None, :],
            irradiance * self.vertical[None, :],
        )

    def share(self) -> TableSlice:
        none = np.zeros((1, len(self.visible)))
        return TableSlice(self.azimuth, self.first, self.step, none, self.visible[None, :])


def _narrow_disc(azimuth: float, elevation: float, radius: float) -> _Strip:
    """A small disc as one vertical strip, weighted by its chords."""
    u = np.linspace(-1.0, 1.0, DISC_STEPS + 1)
    below = 0.5 + (u * np.sqrt(1.0 - u * u) + np.arcsin(u)) / pi
    below[0], below[-1] = 0.0, 1.0
    weight = np.diff(below)
    middle = elevation + radius * (u[:-1] + u[1:]) / 2.0
    horizontal = _above(weight * np.cos(middle))
    vertical = _above(weight * np.sin(middle))
    # The chords' mean direction is a little shorter than 1.
    length = hypot(horizontal[0], vertical[0])
    return _Strip(
        azimuth,
        elevation - radius,
        2.0 * radius / DISC_STEPS,
        horizontal / length,
        vertical / length,
        1.0 - below,
    )


def _wide_disc(azimuth: float, elevation: float, radius: float, directions: int) -> list[_Strip]:
    """A large disc as strips of azimuth, each integrated over the elevations it covers."""
    reach = sin(radius) / max(cos(elevation), 1e-12)
    whole_turn = reach >= 1.0
    half = pi if whole_turn else asin(reach)
    count = min(ceil(2.0 * half / STRIP_WIDTH), directions)
    count = count if whole_turn else count | 1
    width = 2.0 * half / count
    low, high = max(elevation - radius, -pi / 2.0), min(elevation + radius, pi / 2.0)
    if whole_turn:
        low, high = (low, pi / 2.0) if elevation > 0.0 else (-pi / 2.0, high)
    entries = np.linspace(low, high, DISC_STEPS + 1)
    samples = width * ((np.arange(STRIP_SAMPLES) + 0.5) / STRIP_SAMPLES - 0.5)
    offsets = [width * k if whole_turn else width * (k - count // 2) for k in range(count)]
    offsets.sort(key=abs)  # the centre's own azimuth first
    strips = []
    for offset in offsets:
        moments = np.zeros((3, len(entries)))
        for aside in offset + samples:
            bounds = _chord(elevation, radius, float(aside))
            if bounds is not None:
                moments += _moments_between(np.clip(entries, *bounds), bounds[1])
        step = (high - low) / DISC_STEPS
        strips.append(_Strip(azimuth + offset, low, step, *moments))
    # Normalise by what an open cell that faces the disc receives.
    beam = sum(
        s.vertical[0] * sin(elevation) + s.horizontal[0] * cos(elevation) * cos(s.azimuth - azimuth)
        for s in strips
    )
    size = sum(s.visible[0] for s in strips)
    return [
        _Strip(
            s.azimuth % (2.0 * pi),
            s.first,
            s.step,
            s.horizontal / beam,
            s.vertical / beam,
            s.visible / size,
        )
        for s in strips
    ]


def _chord(elevation: float, radius: float, aside: float) -> tuple[float, float] | None:
    """Elevations that a disc covers at an azimuth `aside` of its centre."""
    up, along = sin(elevation), cos(elevation) * cos(aside)
    length = hypot(up, along)
    if length <= abs(cos(radius)):
        return None
    centre, half = atan2(up, along), acos(cos(radius) / length)
    low, high = max(centre - half, -pi / 2.0), min(centre + half, pi / 2.0)
    return (low, high) if low < high else None


def _moments_between(low: NDArray[np.float64], high: float) -> NDArray[np.float64]:
    """Integrals of cos², sin cos and cos over elevation from `low` to `high`, shape (3, n)."""
    return np.stack(
        [
            (high - low + sin(high) * cos(high) - np.sin(low) * np.cos(low)) / 2.0,
            (sin(high) ** 2 - np.sin(low) ** 2) / 2.0,
            sin(high) - np.sin(low),
        ]
    )


def _above(steps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sums from each entry to the top, with the top's 0 at the end."""
    return np.append(np.cumsum(steps[::-1])[::-1], 0.0)
