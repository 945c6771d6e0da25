"""How light falls on a height field: horizons, sky view, shadows and light.

Names are imported on first use, so that ``import adret`` and ``adret --help`` stay quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from adret.azimuths import azimuth_set
    from adret.errors import AdretError, Cancelled, InputError, RasterError
    from adret.horizon import HorizonMap, horizon_at, horizon_map
    from adret.light import Light, direct_light
    from adret.normals import surface_normals
    from adret.report import RunReport, last_run_report
    from adret.shadows import Shadow, shadow
    from adret.skies import Environment, OvercastSky, Sun, UniformSky
    from adret.sky_view import openness, sky_view_factor
    from adret.terrain import Terrain

__version__ = "0.1.0"

_HOME = {
    "AdretError": "errors",
    "Cancelled": "errors",
    "Environment": "skies",
    "HorizonMap": "horizon",
    "InputError": "errors",
    "Light": "light",
    "OvercastSky": "skies",
    "RasterError": "errors",
    "RunReport": "report",
    "Shadow": "shadows",
    "Sun": "skies",
    "Terrain": "terrain",
    "UniformSky": "skies",
    "azimuth_set": "azimuths",
    "direct_light": "light",
    "horizon_at": "horizon",
    "horizon_map": "horizon",
    "last_run_report": "report",
    "openness": "sky_view",
    "shadow": "shadows",
    "sky_view_factor": "sky_view",
    "surface_normals": "normals",
}

__all__ = [
    "AdretError",
    "Cancelled",
    "Environment",
    "HorizonMap",
    "InputError",
    "Light",
    "OvercastSky",
    "RasterError",
    "RunReport",
    "Shadow",
    "Sun",
    "Terrain",
    "UniformSky",
    "azimuth_set",
    "direct_light",
    "horizon_at",
    "horizon_map",
    "last_run_report",
    "openness",
    "shadow",
    "sky_view_factor",
    "surface_normals",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        value = getattr(import_module(f"adret.{_HOME[name]}"), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'adret' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
