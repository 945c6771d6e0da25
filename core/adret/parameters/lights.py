"""Parameters of products that are lit."""

from dataclasses import dataclass
from typing import Literal

from adret.errors import InputError
from adret.parameters.horizons import BodyParameters, RayParameters, SettledParameters
from adret.parameters.specification import Parameters, option

__all__ = ["BounceParameters", "LightParameters", "ShadowParameters", "SourceParameters"]


@dataclass(frozen=True, kw_only=True)
class ShadowParameters(RayParameters):
    """Parameters of the shadow map."""

    sun_deg: tuple[float, ...] = option(
        (315.0, 35.0),
        "Azimuth (clockwise from grid north) and elevation of the sun.",
        unit="deg",
        minimum=-360.0,
        maximum=720.0,
        length=2,
    )
    sun_diameter_deg: float = option(
        0.533, "Angular diameter of the solar disc.", unit="deg", minimum=0.0, maximum=20.0
    )
    layer: Literal["code", "lit"] = option(
        "code",
        "code: 0 lit, 1 self-shadowed, 2 cast shadow; lit: share of the solar disc that is seen.",
    )

    def __post_init__(self) -> None:
        """Check the sun's elevation."""
        super().__post_init__()
        _check_sun(self.sun_deg)


@dataclass(frozen=True, kw_only=True)
class SourceParameters(Parameters):
    """What lights the terrain; at least one of sun, sky and environment."""

    sun_deg: tuple[float, ...] | None = option(
        None,
        "Azimuth (clockwise from grid north) and elevation of the sun.",
        unit="deg",
        minimum=-360.0,
        maximum=720.0,
        length=2,
    )
    sun_irradiance: float = option(
        1.0, "The sun's irradiance across its beam.", minimum=0.0, maximum=1e9
    )
    sun_diameter_deg: float = option(
        0.533, "Angular diameter of the solar disc.", unit="deg", minimum=0.0, maximum=20.0
    )
    sky: Literal["none", "uniform", "overcast"] = option(
        "none", "Sky light: uniform, or Moon and Spencer's overcast sky."
    )
    sky_radiance: float = option(
        1.0,
        "Radiance of the uniform sky, or the overcast sky's at the zenith.",
        minimum=0.0,
        maximum=1e9,
    )
    environment: str | None = option(
        None,
        "Environment map of the sky: .hdr, .exr or .npy, equirectangular or cube map.",
        form="path",
    )
    environment_rotation_deg: float = option(
        0.0, "Turn the environment clockwise.", unit="deg", minimum=-360.0, maximum=360.0
    )
    normal_angles: int | None = option(
        None,
        "Normal angles in the environment's table; default: the library's.",
        minimum=2,
        maximum=1024,
    )

    def __post_init__(self) -> None:
        """Check the sun's elevation, and that there is any light."""
        super().__post_init__()
        if self.sun_deg is not None:
            _check_sun(self.sun_deg)
        if not self.lit and self._needs_source:
            raise InputError("sky", "lit by at least one of sun, sky and environment", "none")

    @property
    def lit(self) -> bool:
        """Whether there is any of sun, sky and environment."""
        return not (self.sun_deg is None and self.sky == "none" and self.environment is None)

    @property
    def _needs_source(self) -> bool:
        return True


@dataclass(frozen=True, kw_only=True)
class LightParameters(SourceParameters, SettledParameters):
    """Parameters of the light map."""

    albedo: float | None = option(
        None,
        "Reflectance: write the radiance that a matt surface sends back instead of the irradiance.",
        minimum=0.0,
        maximum=1.0,
    )


@dataclass(frozen=True, kw_only=True)
class BounceParameters(SourceParameters, BodyParameters):
    """Parameters of the light that terrain reflects to terrain."""

    albedo: float = option(0.3, "Reflectance of the terrain.", minimum=0.0, maximum=1.0)
    albedo_map: str | None = option(
        None,
        "Raster of the reflectance of every cell, 0 to 1, instead: one band or three (red, green, "
        "blue) on the elevation model's grid. Cells without data reflect nothing.",
        form="path",
    )
    emission: str | None = option(
        None,
        "Raster of the radiance that cells send by themselves (lava, lamps): one band or three on "
        "the elevation model's grid. Cells without data send nothing. May be the only light.",
        form="path",
    )
    bounces: int | Literal["converge"] = option(
        1,
        "How often light is passed on; converge: until what further bounces could add is within "
        "the tolerance.",
        minimum=1,
        maximum=1000,
    )
    tolerance: float = option(
        1e-3,
        "What further bounces may add where bounces is converge, as a share of the most "
        "indirect light that any cell has.",
        above=0.0,
        maximum=1.0,
    )
    layer: Literal["indirect", "total", "radiance"] = option(
        "indirect",
        "indirect: irradiance from the terrain alone; total: with sun and sky; radiance: what "
        "matt terrain then sends back.",
    )
    directions: int = option(
        32, "Number of azimuths, equally spaced from grid north.", minimum=1, maximum=7200
    )
    near: int | None = option(
        None,
        "Cells up to which every crossing of a cell's own ray with the grid counts. "
        "Default: the library's.",
        minimum=0,
        maximum=4096,
    )

    @property
    def _needs_source(self) -> bool:
        return self.emission is None


def _check_sun(sun: tuple[float, ...]) -> None:
    if not -90.0 <= sun[1] <= 90.0:
        raise InputError("sun_deg", "an elevation between -90 and 90 deg", sun[1])
