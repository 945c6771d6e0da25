"""How light falls on a height field: horizons, sky view, shadows and light.

Names are imported on first use, so that ``import adret`` and ``adret --help`` stay quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from adret.azimuths import azimuth_set
    from adret.bounces import indirect_light, render
    from adret.errors import AdretError, Cancelled, InputError, RasterError
    from adret.horizon import HorizonMap, HorizonOptions, horizon_at, horizon_map
    from adret.light import Light, direct_light
    from adret.normals import surface_normals
    from adret.report import RunReport, last_run_report
    from adret.screen import AOResult, Camera, DepthBuffer, ambient_occlusion
    from adret.shadows import Shadow, shadow
    from adret.sight import LineOfSight, cells_at, line_of_sight
    from adret.skies import Environment, OvercastSky, Sun, UniformSky
    from adret.sky_view import openness, sky_view_factor
    from adret.terrain import Terrain
    from adret.viewsheds import Viewshed, total_viewshed, viewshed
    from adret.visibility import Intervisibility, intervisibility

__version__ = "0.1.0"

_HOME = {
    "AOResult": "screen",
    "AdretError": "errors",
    "Camera": "screen",
    "Cancelled": "errors",
    "DepthBuffer": "screen",
    "Environment": "skies",
    "HorizonMap": "horizon",
    "HorizonOptions": "horizon",
    "InputError": "errors",
    "Intervisibility": "visibility",
    "Light": "light",
    "LineOfSight": "sight",
    "OvercastSky": "skies",
    "RasterError": "errors",
    "RunReport": "report",
    "Shadow": "shadows",
    "Sun": "skies",
    "Terrain": "terrain",
    "UniformSky": "skies",
    "Viewshed": "viewsheds",
    "ambient_occlusion": "screen",
    "azimuth_set": "azimuths",
    "cells_at": "sight",
    "direct_light": "light",
    "horizon_at": "horizon",
    "horizon_map": "horizon",
    "indirect_light": "bounces",
    "intervisibility": "visibility",
    "last_run_report": "report",
    "line_of_sight": "sight",
    "openness": "sky_view",
    "render": "bounces",
    "shadow": "shadows",
    "sky_view_factor": "sky_view",
    "surface_normals": "normals",
    "total_viewshed": "viewsheds",
    "viewshed": "viewsheds",
}

__all__ = [
    "AOResult",
    "AdretError",
    "Camera",
    "Cancelled",
    "DepthBuffer",
    "Environment",
    "HorizonMap",
    "HorizonOptions",
    "InputError",
    "Intervisibility",
    "Light",
    "LineOfSight",
    "OvercastSky",
    "RasterError",
    "RunReport",
    "Shadow",
    "Sun",
    "Terrain",
    "UniformSky",
    "Viewshed",
    "ambient_occlusion",
    "azimuth_set",
    "cells_at",
    "direct_light",
    "horizon_at",
    "horizon_map",
    "indirect_light",
    "intervisibility",
    "last_run_report",
    "line_of_sight",
    "openness",
    "render",
    "shadow",
    "sky_view_factor",
    "surface_normals",
    "total_viewshed",
    "viewshed",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        value = getattr(import_module(f"adret.{_HOME[name]}"), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'adret' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
