"""Ambient occlusion of what a depth buffer shows, in screen space.

Names are imported on first use.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from adret.screen.camera import Camera
    from adret.screen.crytek import color_bleeding
    from adret.screen.depth import DepthBuffer, DepthPrecisionWarning
    from adret.screen.falloffs import make_falloff
    from adret.screen.indirect import indirect_color
    from adret.screen.normals import view_normals
    from adret.screen.occlusion import METHODS, AOResult, ScreenReport, ambient_occlusion
    from adret.screen.positions import LookupMap, PositionsBuffer
    from adret.screen.vao import Relief

_HOME = {
    "AOResult": "occlusion",
    "Camera": "camera",
    "DepthBuffer": "depth",
    "DepthPrecisionWarning": "depth",
    "LookupMap": "positions",
    "METHODS": "occlusion",
    "PositionsBuffer": "positions",
    "Relief": "vao",
    "ScreenReport": "occlusion",
    "ambient_occlusion": "occlusion",
    "color_bleeding": "crytek",
    "indirect_color": "indirect",
    "make_falloff": "falloffs",
    "view_normals": "normals",
}

__all__ = [
    "METHODS",
    "AOResult",
    "Camera",
    "DepthBuffer",
    "DepthPrecisionWarning",
    "LookupMap",
    "PositionsBuffer",
    "Relief",
    "ScreenReport",
    "ambient_occlusion",
    "color_bleeding",
    "indirect_color",
    "make_falloff",
    "view_normals",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        value = getattr(import_module(f"adret.screen.{_HOME[name]}"), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'adret.screen' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
