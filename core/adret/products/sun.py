"""Products that need a source of light: shadow, direct light and bounces."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from adret.nested_azimuths import Directions
from adret.parameters import (
    BounceParameters,
    LightParameters,
    ShadowParameters,
    SourceParameters,
)
from adret.products.result import (
    Progress,
    Result,
    body_options,
    degrees_text,
    hillshade,
    ray_options,
    tags_of,
)

if TYPE_CHECKING:
    from adret.terrain import Terrain

__all__ = ["bounce", "light", "shadow"]


def shadow(terrain: "Terrain", parameters: ShadowParameters, progress: Progress | None) -> Result:
    from adret.shadows import shadow as shadow_of
    from adret.skies import Sun

    azimuth, elevation = parameters.sun_deg
    sun = Sun(azimuth, elevation, angular_diameter_deg=parameters.sun_diameter_deg)
    found = shadow_of(terrain, sun, progress=progress, **ray_options(terrain, parameters))
    tags = {
        "ADRET_SUN": f"azimuth {degrees_text(azimuth)} deg, elevation {degrees_text(elevation)} deg"
    }
    if parameters.layer == "code":
        definition = "0 lit, 1 self-shadowed (faces away), 2 cast shadow; 3 nodata"
        names = ("shadow code",)
        encoding = {"dtype": "uint8", "nodata": 3, "resampling": "nearest"}
    else:
        definition = "share of the solar disc above the horizon"
        names, encoding = ("share of the solar disc",), {}
    return Result(
        layers=found.code if parameters.layer == "code" else found.lit,
        names=names,
        unit="1",
        tags=tags_of(terrain, "shadow", definition, parameters) | tags,
        encoding=encoding,
        picture=lambda: {
            "layer": found.code,
            "shading": hillshade(terrain, azimuth, max(elevation, 30.0)),
        },
    )


def light(terrain: "Terrain", parameters: LightParameters, progress: Progress | None) -> Result:
    total, sources = _direct(
        terrain,
        parameters,
        parameters.directions,
        ray_options(terrain, parameters) | {"tolerance": parameters.tolerance},
        progress,
    )
    quantity = "irradiance on the sloping cell"
    if parameters.albedo is not None:
        total = total * np.float32(parameters.albedo / np.pi)
        quantity = f"radiance, albedo {parameters.albedo:g} times irradiance / pi,"
    definition = f"{quantity} from {', '.join(sources)}"
    return _lit(total, "light", tags_of(terrain, "light", definition, parameters))


def bounce(terrain: "Terrain", parameters: BounceParameters, progress: Progress | None) -> Result:
    from adret.bounces import indirect_light

    ground = albedo, emission = grounds(terrain, parameters)
    direct = bounce_light(terrain, parameters, _part(progress, 0, 2))
    found = indirect_light(
        terrain,
        None,
        albedo,
        radiance=reflected(albedo, direct),
        emission=emission,
        bounces=parameters.bounces,
        directions=parameters.directions,
        tolerance=parameters.tolerance,
        progress=_part(progress, 1, 2),
        **bounce_options(terrain, parameters),
    )
    return bounced(
        terrain, parameters, ground, found.irradiance, direct, found.bounces, found.residual
    )


def bounce_options(terrain: "Terrain", parameters: BounceParameters) -> dict[str, Any]:
    """Range, radius, refraction and near field of the bounces."""
    from adret.horizon import NEAR_DEFAULT

    near = NEAR_DEFAULT if parameters.near is None else parameters.near
    return body_options(terrain, parameters) | {"near": near}


def bounce_light(
    terrain: "Terrain", parameters: BounceParameters, progress: Progress | None = None
) -> NDArray[np.float32]:
    """Irradiance of sun and sky that the bounces begin with."""
    options = bounce_options(terrain, parameters)
    return _direct(terrain, parameters, parameters.directions, options, progress)[0]


def grounds(terrain: "Terrain", parameters: BounceParameters) -> tuple[Any, Any]:
    """Albedo, and the radiance that cells send by themselves or None."""
    from adret.overlays import read_overlay

    albedo: Any = parameters.albedo
    if parameters.albedo_map is not None:
        albedo = np.nan_to_num(read_overlay("albedo_map", parameters.albedo_map, terrain, 1.0))
    emission: Any = None
    if parameters.emission is not None:
        emission = np.nan_to_num(read_overlay("emission", parameters.emission, terrain))
    return albedo, emission


def bounced(
    terrain: "Terrain",
    parameters: BounceParameters,
    ground: tuple[Any, Any],
    indirect: NDArray[np.float32],
    direct: NDArray[np.float32],
    bounces: int,
    residual: float,
) -> Result:
    """The layer that was asked for, of indirect and direct irradiance on ground of `grounds`."""
    albedo, emission = ground
    total, quantity = indirect, "irradiance on the sloping cell from the terrain it sees"
    if parameters.layer != "indirect":
        total = _sum(total, direct)
        quantity = "irradiance on the sloping cell, direct and from the terrain it sees"
    if parameters.layer == "radiance":
        total = reflected(albedo, total)
        quantity = f"radiance, albedo / pi times {quantity}"
        if emission is not None:
            total = _sum(total, emission)
            quantity = f"{quantity}, and emission"
    sources = [text for _, text in _sources(parameters)]
    if parameters.emission is not None:
        sources.append(f"emission map {Path(parameters.emission).name}")
    definition = f"{quantity}, lit by {', '.join(sources)}"
    tags = tags_of(terrain, "bounce", definition, parameters) | {
        "ADRET_ALBEDO": f"{parameters.albedo:g}",
        "ADRET_BOUNCES": str(bounces),
        "ADRET_RESIDUAL": f"at most {residual:.3g} of the largest indirect irradiance",
        "ADRET_DIRECTIONS": str(parameters.directions),
        "ADRET_NEAR": str(bounce_options(terrain, parameters)["near"]),
    }
    if parameters.albedo_map is not None:
        tags["ADRET_ALBEDO"] = f"map {Path(parameters.albedo_map).name}"
    name = {"indirect": "indirect light", "total": "light", "radiance": "radiance"}
    return _lit(total, name[parameters.layer], tags)


def _direct(
    terrain: "Terrain",
    parameters: SourceParameters,
    directions: Directions,
    options: dict[str, Any],
    progress: Progress | None,
) -> tuple[NDArray[np.float32], list[str]]:
    """Irradiance of all sources together, and what they are."""
    from adret.light import direct_light

    sources = _sources(parameters)
    total = np.where(terrain.mask, np.float32(np.nan), np.float32(0.0))
    for part, (sky, _) in enumerate(sources):
        flux = direct_light(
            terrain, sky, directions, progress=_part(progress, part, len(sources)), **options
        ).irradiance
        total = _sum(total, flux)
    return total, [text for _, text in sources]


def _sum(one: NDArray[np.float32], other: NDArray[np.float32]) -> NDArray[np.float32]:
    """Sum of two quantities of light, each of one band or three."""
    if one.ndim != other.ndim:
        one, other = np.atleast_3d(one), np.atleast_3d(other)
    return one + other


def reflected(albedo: Any, irradiance: NDArray[np.float32]) -> NDArray[np.float32]:
    """Radiance of matt ground; albedo is one number, or one or three layers."""
    share = np.asarray(albedo / np.pi, dtype=np.float32)
    if share.ndim in (2, 3) and share.ndim != irradiance.ndim:
        share, irradiance = np.atleast_3d(share), np.atleast_3d(irradiance)
    return np.asarray(share * irradiance)


def _sources(parameters: SourceParameters) -> list[tuple[Any, str]]:
    """The skies that were asked for, each with its words for the definition."""
    from adret.skies import Environment, OvercastSky, Sun, UniformSky

    sources: list[tuple[Any, str]] = []
    if parameters.sun_deg is not None:
        azimuth, elevation = parameters.sun_deg
        sun = Sun(
            azimuth,
            elevation,
            irradiance=parameters.sun_irradiance,
            angular_diameter_deg=parameters.sun_diameter_deg,
        )
        place = f"azimuth {degrees_text(azimuth)}, elevation {degrees_text(elevation)} deg"
        sources.append((sun, f"sun at {place}"))
    if parameters.sky == "uniform":
        sources.append((UniformSky(parameters.sky_radiance), "uniform sky"))
    elif parameters.sky == "overcast":
        sources.append((OvercastSky(parameters.sky_radiance), "overcast sky (1 + 2 sin e)/3"))
    if parameters.environment is not None:
        table = {}
        if parameters.normal_angles is not None:
            table["normal_angles"] = parameters.normal_angles
        environment = Environment.open(
            parameters.environment, rotation_deg=parameters.environment_rotation_deg, **table
        )
        sources.append((environment, f"environment map {Path(parameters.environment).name}"))
    return sources


def _lit(values: NDArray[np.float32], name: str, tags: dict[str, str]) -> Result:
    """A quantity of light in one band, or in red, green and blue."""
    return Result(
        layers=values if values.ndim == 2 else np.moveaxis(values, 2, 0),
        names=(name,) if values.ndim == 2 else ("red", "green", "blue"),
        unit="unit of the sources",
        tags=tags,
        picture=lambda: {"layer": values, "low": 0.0, "gamma": 1.5},
    )


def _part(progress: Progress | None, part: int, parts: int) -> Progress | None:
    """Progress of one part of several, on the scale of the whole."""
    if progress is None:
        return None
    report = progress
    return lambda done, total: report(part * total + done, parts * total)
