"""Products of the horizon alone: horizon map, sky view, openness."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from adret.azimuths import azimuth_set
from adret.parameters import HorizonParameters, OpennessParameters, SkyViewParameters
from adret.products.result import (
    Progress,
    Result,
    degrees_text,
    ray_options,
    tags_of,
)

if TYPE_CHECKING:
    from adret.terrain import Terrain

__all__ = ["horizon", "openness", "sky_view"]

# Horizon angles from -90 to 90 degrees on 0..65534; 65535 is nodata.
ANGLE_STEP = 180.0 / 65534.0
ANGLE_NODATA = 65535


def horizon(terrain: "Terrain", parameters: HorizonParameters, progress: Progress | None) -> Result:
    from adret._kernels.frames import to_elevation
    from adret.horizon import HorizonOptions
    from adret.horizon_run import horizon_slopes

    given = parameters.azimuths_deg
    azimuths = azimuth_set(parameters.directions, None if given is None else np.radians(given))
    options = HorizonOptions(**ray_options(terrain, parameters))
    slopes = horizon_slopes(terrain, azimuths, options, progress)
    total = np.zeros(terrain.shape, dtype=np.float32)

    def layers() -> Iterator[tuple[int, NDArray[np.float32]]]:
        angle = np.empty(terrain.shape, dtype=np.float32)
        for k, slope in slopes:
            to_elevation(slope, angle)
            np.degrees(angle, out=angle)
            np.add(total, np.maximum(angle, 0.0), out=total)
            yield k, angle

    encoding: dict[str, Any] = {"resampling": "nearest"}
    if parameters.dtype == "uint16":
        encoding |= {
            "dtype": "uint16",
            "scale": ANGLE_STEP,
            "offset": -90.0,
            "nodata": ANGLE_NODATA,
        }
    definition = (
        "elevation of the horizon above the horizontal, atan(max over the distance d of "
        "(height - receiver's height - (1 - k) d^2 / (2 R)) / d); -90 where no terrain lies"
    )
    return Result(
        layers=layers(),
        names=tuple(f"azimuth {degrees_text(a)} deg" for a in np.degrees(azimuths)),
        unit="degree",
        tags=tags_of(terrain, "horizon", definition, parameters)
        | {"ADRET_DIRECTIONS": str(len(azimuths))},
        encoding=encoding,
        picture=lambda: {"layer": total / np.float32(len(azimuths)), "colours": "dusk"},
    )


def sky_view(
    terrain: "Terrain", parameters: SkyViewParameters, progress: Progress | None
) -> Result:
    from adret.sky_view import sky_view_factor

    factor = sky_view_factor(
        terrain,
        parameters.kind,
        clip=parameters.clip,
        progress=progress,
        directions=parameters.directions,
        tolerance=parameters.tolerance,
        **ray_options(terrain, parameters),
    )
    clipped = "max(h, hp, 0)" if parameters.clip else "max(h, hp)"
    definition = {
        "visible": "visible sky fraction <1 - sin max(h, 0)>",
        "horizontal": "sky-view factor of a horizontal receiver <cos^2 max(h, 0)>",
        "normal": "sky-view factor of the terrain normal n, <(n_e sin a + n_n cos a)"
        f"(pi/2 - e - sin(2 e)/2) + n_u cos^2 e>, e = {clipped}, hp = own plane's horizon",
    }[parameters.kind]
    return Result(
        layers=factor,
        names=(f"sky view ({parameters.kind})",),
        unit="1",
        tags=tags_of(terrain, "sky-view", definition, parameters),
        picture=lambda: {"layer": factor},
    )


def openness(
    terrain: "Terrain", parameters: OpennessParameters, progress: Progress | None
) -> Result:
    from adret.sky_view import openness as openness_of

    angle = openness_of(
        terrain,
        1 if parameters.sign > 0 else -1,
        progress=progress,
        directions=parameters.directions,
        tolerance=parameters.tolerance,
        **ray_options(terrain, parameters),
    )
    word = "positive" if parameters.sign > 0 else "negative"
    of = "" if parameters.sign > 0 else " of the terrain turned upside down"
    return Result(
        layers=angle,
        names=(f"{word} openness",),
        unit="degree",
        tags=tags_of(terrain, "openness", f"{word} openness <90 - h>{of}", parameters),
        picture=lambda: {"layer": angle},
    )
