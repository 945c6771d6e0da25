"""Camera files: JSON objects that say which camera saw a depth buffer."""

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from adret.errors import RasterError

__all__ = ["camera_arguments", "read_json", "stored_as"]

JSON_LIMIT = 1 << 20
SHARED = ("reversed", "clip", "handedness")


def read_json(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Members of a camera file; at most 1 MiB.

    Raises
    ------
    RasterError
        If it cannot be read or is no JSON object.
    """
    file = Path(path)
    try:
        with file.open("rb") as stream:
            text = stream.read(JSON_LIMIT + 1)
    except (OSError, ValueError) as error:
        raise RasterError("camera", "a file that can be read", str(error)) from None
    if len(text) > JSON_LIMIT:
        raise RasterError("camera", f"a file of at most {JSON_LIMIT} bytes", file.name)
    try:
        values = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise RasterError("camera", "a JSON file", str(error)) from None
    if not isinstance(values, dict):
        raise RasterError("camera", "a JSON object", type(values).__name__)
    return values


def camera_arguments(values: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """Which of `Camera`'s makers a camera file asks for, and its keywords."""
    given: dict[str, Any] = {name: _whole(values, name) for name in ("width", "height")}
    if "matrix" in values:
        given |= {
            name: values[name] for name in ("matrix", "matrix_clip", "clip") if name in values
        }
        return "from_matrix", given
    given |= {name: values[name] for name in SHARED if name in values}
    for name in ("near", "far"):
        if f"clip_{name}" in values:
            given[name] = _number(values, f"clip_{name}")
        elif name in values and "fx_px" not in values:
            given[name] = _number(values, name)
    projection = values.get("projection", "perspective")
    if projection == "orthographic":
        return "orthographic", {**given, "extent": values.get("extent")}
    if projection != "perspective":
        raise RasterError("projection", "perspective or orthographic", projection)
    for name in ("fov_y_deg", "fx", "fy", "cx", "cy"):
        for key in (name, f"{name}_px"):
            if key in values:
                given[name] = _number(values, key)
    if str(values.get("pixel_centre", "")).startswith("integer"):
        for name in {"cx", "cy"} & given.keys():
            given[name] += 0.5
    return "perspective", given


def stored_as(values: Mapping[str, Any]) -> dict[str, Any]:
    """How depth is stored, as far as a camera file says it: keywords of `DepthBuffer`."""
    said: dict[str, Any] = {}
    if "kind" in values:
        said["kind"] = values["kind"]
    elif str(values.get("depth", "")).startswith("non-linear"):
        said["kind"] = "device"
    for name in ("scale", "hole"):
        if name in values:
            said[name] = _number(values, name)
    frame = values.get("frame")
    if isinstance(frame, Mapping):
        x0, y0, width, height = (_whole(frame, name) for name in ("x0", "y0", "width", "height"))
        right, bottom = _whole(values, "width") - x0 - width, _whole(values, "height") - y0 - height
        said["guard_band"] = (y0, right, bottom, x0)
    elif "guard_band" in values or "guard_band_px" in values:
        band = values.get("guard_band", values.get("guard_band_px"))
        said["guard_band"] = tuple(band) if isinstance(band, list) else band
    return said


def _number(values: Mapping[str, Any], name: str) -> float:
    value = values.get(name)
    if value in ("inf", "infinity"):
        return math.inf
    if isinstance(value, bool) or not isinstance(value, int | float) or math.isnan(value):
        raise RasterError(name, "a number", value)
    return float(value)


def _whole(values: Mapping[str, Any], name: str) -> int:
    value = _number(values, name)
    if not math.isfinite(value) or value != int(value):
        raise RasterError(name, "a whole number", value)
    return int(value)
