"""Parameters of products about who sees whom."""

from dataclasses import dataclass
from typing import Literal

from adret.errors import InputError
from adret.parameters.horizons import BodyParameters
from adret.parameters.specification import option

__all__ = ["ViewshedParameters", "VisibilityParameters"]

BITS = 64
"""Observers that a bit field can name."""


@dataclass(frozen=True, kw_only=True)
class ViewshedParameters(BodyParameters):
    """Parameters of the viewshed; at least one observer."""

    observer: tuple[tuple[int, int], ...] | None = option(
        None,
        "Observer's cell: row and column, counted from 0 at the north-western corner.",
        minimum=0,
    )
    at: tuple[tuple[float, float], ...] | None = option(
        None, "Observer's place: x and y in the raster's reference system."
    )
    observer_height: float = option(
        1.6, "Height of the eyes above the ground.", unit="m", minimum=0.0, maximum=1e6
    )
    target_height: float = option(
        0.0, "Height of the targets above the ground.", unit="m", minimum=0.0, maximum=1e6
    )
    azimuth_range_deg: tuple[float, ...] | None = option(
        None,
        "Look from the first of these azimuths clockwise to the second, from grid north.",
        unit="deg",
        minimum=-360.0,
        maximum=720.0,
        length=2,
    )
    pitch_range_deg: tuple[float, ...] | None = option(
        None,
        "Look at targets between these elevations above the horizontal.",
        unit="deg",
        minimum=-90.0,
        maximum=90.0,
        length=2,
    )
    layer: Literal["visible", "count", "seen-by", "minimum-height"] = option(
        "visible",
        "visible: 1 where any observer sees the target; count: number of observers that do; "
        "seen-by: the same for each observer, one band each; minimum-height: how far above the "
        "ground a target must reach to be seen.",
    )

    def __post_init__(self) -> None:
        """Check that somebody looks, and somewhere."""
        super().__post_init__()
        observers = len(self.observer or ()) + len(self.at or ())
        if observers == 0:
            raise InputError("observer", "given at least once, as a cell or as a place (at)", None)
        if self.layer == "seen-by" and observers > BITS:
            raise InputError("observer", f"at most {BITS} for layer seen-by", observers)
        azimuths = self.azimuth_range_deg
        if (
            azimuths is not None
            and azimuths[1] - azimuths[0] < 360.0
            and (azimuths[1] - azimuths[0]) % 360.0 == 0.0
        ):
            raise InputError("azimuth_range_deg", "two different azimuths", azimuths)
        pitches = self.pitch_range_deg
        if pitches is not None and not pitches[0] < pitches[1]:
            raise InputError("pitch_range_deg", "two elevations, the lower one first", pitches)


@dataclass(frozen=True, kw_only=True)
class VisibilityParameters(BodyParameters):
    """Parameters of what every cell sees."""

    measure: Literal[
        "visible-count",
        "visible-area",
        "sight-distance",
        "max-sight-distance",
        "horizon-count",
        "sky-view",
        "terrain-view",
    ] = option(
        "visible-area",
        "visible-count: samples seen; visible-area: ground seen, the total viewshed; "
        "sight-distance, max-sight-distance: way to the farthest ground seen, mean or largest over "
        "the azimuths; horizon-count: local horizons; sky-view, terrain-view: shares of the "
        "hemisphere over the sloping cell.",
    )
    directions: int = option(
        32, "Number of azimuths, equally spaced from grid north.", minimum=1, maximum=7200
    )
    method: Literal["rays", "tree", "march"] = option(
        "rays",
        "rays: every cell's own ray; tree: own rays up to near, and beyond it a convex-hull tree "
        "on swept lines; march: the naive walk instead of the tree, which gives the same.",
    )
    near: int | None = option(
        None,
        "Distance in cells up to which every crossing of a cell's own ray with the grid hides; "
        "larger is more accurate. Default: 4096 for rays, else 32.",
        minimum=0,
        maximum=4096,
    )
    observer_height: float = option(
        1.6, "Height of the eyes above the ground.", unit="m", minimum=0.0, maximum=1e6
    )
