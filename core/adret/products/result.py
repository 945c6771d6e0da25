"""What a product computes, and what all products say about themselves."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from adret.cogs import Layers, PixelGrid
from adret.errors import InputError
from adret.parameters import BodyParameters, RayParameters, RoundParameters, SettledParameters
from adret.report import last_run_report

if TYPE_CHECKING:
    from adret.terrain import Terrain

__all__ = [
    "Progress",
    "Result",
    "body_options",
    "degrees_text",
    "hillshade",
    "ray_options",
    "tags_of",
]

Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """Layers of a product and what they are.

    Attributes
    ----------
    layers : ndarray or iterator
        Shape (bands, rows, columns) or (rows, columns), or pairs (band index, layer) to be used
        one by one.
    names : tuple of str
        One a band.
    unit : str
        Unit of every band.
    tags : dict
        Metadata for the file: product, definition, parameters.
    encoding : dict
        How the numbers are stored: dtype, scale, offset, nodata, resampling (see `write`).
    picture : callable
        Gives the options of `preview`, `layer` among them; called when all layers were used.
    grid : PixelGrid or None
        Where the layers lie, if that is not where the terrain does.
    """

    layers: Layers
    names: tuple[str, ...]
    unit: str
    tags: dict[str, str]
    picture: Callable[[], dict[str, Any]]
    encoding: dict[str, Any] = field(default_factory=dict)
    grid: PixelGrid | None = None


def body_options(terrain: "Terrain", parameters: BodyParameters) -> dict[str, Any]:
    """Range, radius and refraction as the library takes them: the radius curvature stands for."""
    radius = parameters.radius
    if radius is None and parameters.curvature:
        radius = terrain.body_radius
        if radius is None:
            raise InputError("radius", "given for curvature (the raster names no body)", None)
    return {
        "max_distance": parameters.max_distance,
        "radius": radius,
        "refraction": parameters.refraction,
    }


def ray_options(terrain: "Terrain", parameters: RayParameters) -> dict[str, Any]:
    """The horizon's own options."""
    options = body_options(terrain, parameters) | {
        "method": parameters.method,
        "observer_height": parameters.observer_height,
    }
    if parameters.near is not None:
        options["near"] = parameters.near
    return options


def tags_of(
    terrain: "Terrain", name: str, definition: str, parameters: BodyParameters
) -> dict[str, str]:
    """What the file says about itself."""
    import adret
    from adret.horizon import NEAR_DEFAULT
    from adret.methods import MAX_AZIMUTH_ERROR

    radius = body_options(terrain, parameters)["radius"]
    tags = {
        "ADRET_VERSION": adret.__version__,
        "ADRET_PRODUCT": name,
        "ADRET_DEFINITION": definition,
        "ADRET_AZIMUTH_CONVENTION": "degrees clockwise from grid north",
        "ADRET_RADIUS": "flat" if radius is None else f"{radius:.1f} m",
        "ADRET_REFRACTION": f"{parameters.refraction:g}",
        "ADRET_CELL_SIZE": f"{terrain.cell_size[0]:.9g} x {terrain.cell_size[1]:.9g} m",
    }
    if parameters.max_distance is not None:
        tags["ADRET_MAX_DISTANCE"] = f"{parameters.max_distance:g} m"
    if isinstance(parameters, RayParameters):
        tags["ADRET_METHOD"] = parameters.method
        tags["ADRET_OBSERVER_HEIGHT"] = f"{parameters.observer_height:g} m"
        if parameters.method == "sweep":
            tags["ADRET_NEAR"] = str(NEAR_DEFAULT if parameters.near is None else parameters.near)
    if isinstance(parameters, RoundParameters):
        tags["ADRET_DIRECTIONS"] = str(parameters.directions)
    report = last_run_report()
    if isinstance(parameters, SettledParameters) and parameters.directions == "auto" and report:
        tags["ADRET_DIRECTIONS"] = f"{report.directions} (auto: changed by {report.change:.3g})"
    if terrain.grid.azimuth_error > 0.0:
        error = np.degrees(min(terrain.grid.azimuth_error, MAX_AZIMUTH_ERROR))
        tags["ADRET_AZIMUTH_ERROR"] = f"at most {error:.4f} deg"
    return tags


def hillshade(terrain: "Terrain", azimuth_deg: float, elevation_deg: float) -> NDArray[Any]:
    """Brightness 0.3..1 of the ground for a picture."""
    from adret.normals import surface_normals

    azimuth, elevation = np.radians(azimuth_deg), np.radians(elevation_deg)
    toward = (
        np.sin(azimuth) * np.cos(elevation),
        np.cos(azimuth) * np.cos(elevation),
        np.sin(elevation),
    )
    normals = surface_normals(terrain)
    cosine = sum(np.float32(t) * n for t, n in zip(toward, normals, strict=True))
    return np.asarray(0.3 + 0.7 * np.clip(cosine, 0.0, 1.0))


def degrees_text(degrees: float) -> str:
    """45.0, 5.625: at least one decimal, no rounding noise."""
    text = f"{round(float(degrees), 9):.9f}".rstrip("0")
    return text + "0" if text.endswith(".") else text
