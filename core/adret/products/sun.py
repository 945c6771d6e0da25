"""Products that need a source of light: shadow and direct light."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from adret.parameters import LightParameters, ShadowParameters
from adret.products.result import (
    Progress,
    Result,
    degrees_text,
    hillshade,
    ray_options,
    tags_of,
)

if TYPE_CHECKING:
    from adret.terrain import Terrain

__all__ = ["light", "shadow"]


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
    from adret.light import direct_light
    from adret.skies import Environment, OvercastSky, Sun, UniformSky

    skies: list[Any] = []
    sources = []
    if parameters.sun_deg is not None:
        azimuth, elevation = parameters.sun_deg
        skies.append(
            Sun(
                azimuth,
                elevation,
                irradiance=parameters.sun_irradiance,
                angular_diameter_deg=parameters.sun_diameter_deg,
            )
        )
        sources.append(
            f"sun at azimuth {degrees_text(azimuth)}, elevation {degrees_text(elevation)} deg"
        )
    if parameters.sky == "uniform":
        skies.append(UniformSky(parameters.sky_radiance))
        sources.append("uniform sky")
    elif parameters.sky == "overcast":
        skies.append(OvercastSky(parameters.sky_radiance))
        sources.append("overcast sky (1 + 2 sin e)/3")
    if parameters.environment is not None:
        table = {}
        if parameters.normal_angles is not None:
            table["normal_angles"] = parameters.normal_angles
        skies.append(
            Environment.open(
                parameters.environment, rotation_deg=parameters.environment_rotation_deg, **table
            )
        )
        sources.append(f"environment map {Path(parameters.environment).name}")

    options = ray_options(terrain, parameters)
    total: NDArray[np.float32] | None = None
    for part, sky in enumerate(skies):
        lit = direct_light(
            terrain,
            sky,
            parameters.directions,
            progress=_part(progress, part, len(skies)),
            **options,
        )
        flux = lit.irradiance
        if parameters.albedo is not None:
            flux = lit.radiance(parameters.albedo)
        if total is None:
            total = flux
        elif total.ndim == flux.ndim:
            total = total + flux
        else:
            total = np.atleast_3d(total) + np.atleast_3d(flux)
    assert total is not None
    quantity = "irradiance on the sloping cell"
    if parameters.albedo is not None:
        quantity = f"radiance, albedo {parameters.albedo:g} times irradiance / pi,"
    bands = total if total.ndim == 2 else np.moveaxis(total, 2, 0)
    names = ("light",) if total.ndim == 2 else ("red", "green", "blue")
    return Result(
        layers=bands,
        names=names,
        unit="unit of the sources",
        tags=tags_of(terrain, "light", f"{quantity} from {', '.join(sources)}", parameters),
        picture=lambda: {"layer": total, "low": 0.0, "gamma": 1.5},
    )


def _part(progress: Progress | None, part: int, parts: int) -> Progress | None:
    """Progress of one part of several, on the scale of the whole."""
    if progress is None:
        return None
    report = progress
    return lambda done, total: report(part * total + done, parts * total)
