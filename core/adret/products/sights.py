"""Products about who sees whom: viewsheds, and what every cell sees."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from adret.errors import InputError
from adret.parameters import ViewshedParameters, VisibilityParameters
from adret.products.result import Progress, Result, body_options, hillshade, tags_of

if TYPE_CHECKING:
    from adret.terrain import Terrain
    from adret.viewsheds import Viewshed

__all__ = ["viewshed", "visibility"]

LINE = "a straight line of sight, nowhere below the surface at the grid lines it crosses,"
MEASURES = {
    "visible-count": ("1", "samples seen in all azimuths together"),
    "visible-area": ("m2", "ground seen in plan, without the cell itself (total viewshed)"),
    "sight-distance": ("m", "way to the farthest ground seen, mean over azimuths"),
    "max-sight-distance": ("m", "way to the farthest ground seen"),
    "horizon-count": ("1", "local horizons in all azimuths together"),
    "sky-view": ("1", "sky-view factor of the sloping cell, above the horizontal"),
    "terrain-view": ("1", "1 less the sky-view factor of the sloping cell"),
}
# Codes of `preview`: bright, dark, transparent.
BRIGHT, DARK, NOTHING = 0, 2, 3


def viewshed(
    terrain: "Terrain", parameters: ViewshedParameters, progress: Progress | None
) -> Result:
    from adret.sight import cell, cells_at
    from adret.viewsheds import viewshed as viewshed_of

    observers = [cell("observer", each, terrain) for each in parameters.observer or ()]
    for x, y in parameters.at or ():
        try:
            (place,) = cells_at(terrain, x, y)
        except InputError as error:
            field = "at" if error.field == "coordinates" else error.field
            raise InputError(field, error.limit, error.value) from None
        observers.append(cell("at", place, terrain))
    found = viewshed_of(
        terrain,
        observers,
        observer_height=parameters.observer_height,
        target_height=parameters.target_height,
        azimuth_range=_radians(parameters.azimuth_range_deg),
        pitch_range=_radians(parameters.pitch_range_deg),
        progress=progress,
        **body_options(terrain, parameters),
    )
    return Result(
        layers=_layers(found, parameters.layer),
        picture=lambda: _picture(found, parameters.layer),
        **_about(terrain, parameters, found.observers),
    )


def unseen(
    terrain: "Terrain", parameters: ViewshedParameters, places: Sequence[tuple[int, int]]
) -> Result:
    """A part of the viewshed of observers at some cells of the whole, none of whom sees it."""
    about = _about(terrain, parameters, places)
    if parameters.layer == "minimum-height":
        layers = np.full(terrain.shape, np.nan, np.float32)
    else:
        encoding = about["encoding"]
        layers = np.where(terrain.mask, encoding["nodata"], 0).astype(encoding["dtype"])
    if parameters.layer == "seen-by":
        layers = np.repeat(layers[np.newaxis], len(places), axis=0)
    return Result(layers=layers, picture=dict, **about)


def _about(
    terrain: "Terrain", parameters: ViewshedParameters, observers: Sequence[tuple[int, int]]
) -> dict[str, Any]:
    """What the file says of a viewshed, and how it stores it."""
    from adret.viewsheds import BITS

    definition = {
        "visible": f"1 where at least one observer has {LINE} to the target, else 0",
        "count": f"number of observers that have {LINE} to the target",
        "seen-by": f"1 where the observer has {LINE} to the target, else 0",
        "minimum-height": f"least height above ground of a target to which there is {LINE}",
    }[parameters.layer]
    places = [f"row {row} column {column}" for row, column in observers]
    tags = tags_of(terrain, "viewshed", definition, parameters) | {
        "ADRET_METHOD": "exact",
        "ADRET_OBSERVER_HEIGHT": f"{parameters.observer_height:g} m",
        "ADRET_TARGET_HEIGHT": f"{parameters.target_height:g} m",
        "ADRET_OBSERVERS": "; ".join(places[:BITS]) + ("; ..." if len(places) > BITS else ""),
    }
    for name, given in (
        ("AZIMUTH", parameters.azimuth_range_deg),
        ("PITCH", parameters.pitch_range_deg),
    ):
        if given is not None:
            tags[f"ADRET_{name}_RANGE"] = f"{given[0]:g} to {given[1]:g} deg"
    encoding: dict[str, Any] = {}
    if parameters.layer != "minimum-height":
        dtype, nodata = ("uint16", 65535) if parameters.layer == "count" else ("uint8", 255)
        encoding = {"dtype": dtype, "nodata": nodata, "resampling": "nearest"}
    return {
        "names": tuple(places) if parameters.layer == "seen-by" else (parameters.layer,),
        "unit": "m" if parameters.layer == "minimum-height" else "1",
        "tags": tags,
        "encoding": encoding,
    }


def visibility(
    terrain: "Terrain", parameters: VisibilityParameters, progress: Progress | None
) -> Result:
    from adret.sight_rays import NEAR
    from adret.sight_sweep import Reduction
    from adret.visibility import intervisibility

    near = NEAR[parameters.method] if parameters.near is None else parameters.near
    layer = intervisibility(
        terrain,
        parameters.directions,
        method=parameters.method,
        near=near,
        reduce=cast(Reduction, parameters.measure.replace("-", "_")),
        observer_height=parameters.observer_height,
        progress=progress,
        **body_options(terrain, parameters),
    )
    unit, definition = MEASURES[parameters.measure]
    return Result(
        layers=layer,
        names=(parameters.measure,),
        unit=unit,
        tags=tags_of(terrain, "visibility", definition, parameters)
        | {
            "ADRET_METHOD": parameters.method,
            "ADRET_NEAR": str(near),
            "ADRET_DIRECTIONS": str(parameters.directions),
            "ADRET_OBSERVER_HEIGHT": f"{parameters.observer_height:g} m",
        },
        picture=lambda: {"layer": layer, "colours": "dusk"},
    )


def _layers(found: "Viewshed", layer: str) -> Any:
    """The layers of a viewshed as they are stored."""
    if layer == "minimum-height":
        return found.minimum_height
    mask = found.terrain.mask
    if layer == "seen-by":
        assert found.seen_by is not None
        seen = found.seen_by
        return (
            (i, np.where(mask, 255, (seen >> np.uint64(i)) & np.uint64(1)).astype(np.uint8))
            for i in range(len(found.observers))
        )
    if layer == "count":
        return np.where(mask, 65535, found.count).astype(np.uint16)
    return np.where(mask, 255, found.visible).astype(np.uint8)


def _picture(found: "Viewshed", layer: str) -> dict[str, Any]:
    if layer in ("visible", "seen-by"):
        code = np.where(found.visible, BRIGHT, DARK).astype(np.uint8)
        code[found.terrain.mask] = NOTHING
        return {"layer": code, "shading": hillshade(found.terrain, 315.0, 45.0)}
    values = found.minimum_height
    if layer == "count":
        values = np.where(found.terrain.mask, np.nan, found.count).astype(np.float32)
    return {"layer": values, "colours": "dusk", "low": 0.0}


def _radians(pair: tuple[float, ...] | None) -> tuple[float, float] | None:
    return None if pair is None else (float(np.radians(pair[0])), float(np.radians(pair[1])))
