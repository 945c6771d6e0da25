"""Products of depth buffers."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from adret.cogs import PixelGrid
from adret.errors import InputError
from adret.parameters import SsaoParameters
from adret.pictures import read_picture
from adret.products.result import Progress, Result

if TYPE_CHECKING:
    from adret.screen import AOResult, DepthBuffer

__all__ = ["ssao"]

DEFINITIONS = {
    "occlusion": "share of the hemisphere, weighted as the method does, that occluders close",
    "visibility": "1 less the occlusion",
    "confidence": "share of the hemisphere that was decided inside the image",
    "bent-normal": "mean open direction, unit vector (right, up, back)",
}


def ssao(buffer: "DepthBuffer", parameters: SsaoParameters, progress: Progress | None) -> Result:
    from adret.screen import ambient_occlusion

    colour = None if parameters.color is None else read_picture(parameters.color, "color")
    if colour is not None:
        colour = _frame_of(colour, buffer)
    result = ambient_occlusion(buffer, progress=progress, **parameters.options())
    layers = _layers(result, parameters)
    bent = parameters.layer == "bent-normal"
    names = tuple(f"bent normal, {axis}" for axis in ("right", "up", "back"))
    return Result(
        layers=layers,
        names=names if bent else (parameters.layer,),
        unit="1",
        tags=_tags(buffer, result, parameters),
        picture=lambda: _picture(result, parameters, colour),
        grid=PixelGrid(result.occlusion.shape),
    )


def _shaded(result: "AOResult", colour: NDArray[Any]) -> NDArray[np.float32]:
    """Linear colours of the frame, (rows, columns, 3), darkened by the occlusion."""
    open_share = 1.0 - np.nan_to_num(result.occlusion)
    return np.asarray(colour * open_share[..., None], dtype=np.float32)


def _frame_of(colour: NDArray[Any], buffer: "DepthBuffer") -> NDArray[Any]:
    """The part of a picture of the whole image that is the frame; a picture of the frame as is."""
    row0, row1, column0, column1 = buffer.frame
    if colour.shape[:2] == buffer.shape:
        return colour[row0:row1, column0:column1]
    if colour.shape[:2] != (row1 - row0, column1 - column0):
        whole, part = buffer.shape, (row1 - row0, column1 - column0)
        raise InputError("color", f"of {whole} pixels, or of {part} for the frame", colour.shape)
    return colour


def _layers(result: "AOResult", parameters: SsaoParameters) -> NDArray[np.float32]:
    if parameters.layer == "confidence":
        return result.confidence
    if parameters.layer == "visibility":
        return np.asarray(1.0 - result.occlusion, dtype=np.float32)
    if parameters.layer == "bent-normal":
        if result.bent_normal is None:
            raise InputError("layer", f"one that {parameters.method!r} gives", parameters.layer)
        return result.bent_normal
    return result.occlusion


def _picture(
    result: "AOResult", parameters: SsaoParameters, colour: NDArray[Any] | None
) -> dict[str, Any]:
    if colour is not None:
        high = float(np.percentile(colour, 99.5)) if colour.max() > 1.0 else 1.0
        return {"layer": _shaded(result, colour), "low": 0.0, "high": high, "gamma": 2.2}
    if parameters.layer == "bent-normal" and result.bent_normal is not None:
        colours = 0.5 + 0.5 * np.moveaxis(result.bent_normal, 0, 2)
        return {"layer": colours, "low": 0.0, "high": 1.0}
    layer = result.confidence if parameters.layer == "confidence" else 1.0 - result.occlusion
    return {"layer": layer, "low": 0.0, "high": 1.0}


def _tags(buffer: "DepthBuffer", result: "AOResult", parameters: SsaoParameters) -> dict[str, str]:
    import adret

    tags = {
        "ADRET_VERSION": adret.__version__,
        "ADRET_PRODUCT": "ssao",
        "ADRET_DEFINITION": DEFINITIONS[parameters.layer],
        "ADRET_METHOD": parameters.method,
        "ADRET_CAMERA": "perspective" if buffer.camera.perspective_divide else "orthographic",
        "ADRET_FRAME": "rows {}:{}, columns {}:{} of the depth buffer".format(*result.frame),
        "ADRET_POWER": f"{parameters.power:g}",
        "ADRET_INTENSITY": f"{parameters.intensity:g}",
        "ADRET_HALF_RES": str(parameters.half_res).lower(),
        "ADRET_DENOISE": parameters.denoise or "none",
    }
    for name, value in result.report.options.items():
        if isinstance(value, float) and math.isinf(value):
            value = "unlimited"
        if value is not None and not callable(value):
            tags[f"ADRET_OPTION_{name.upper()}"] = str(value)
    return tags
