"""The horizon's options as keywords of the functions that sweep horizons themselves."""

from typing import TypedDict

from adret.horizon_options import Method

__all__ = ["HorizonKeywords"]


class HorizonKeywords(TypedDict, total=False):
    """Options of `adret.horizon_map` that other functions pass on; see there."""

    method: Method
    near: int
    max_distance: float | None
    radius: float | None
    refraction: float
    observer_height: float
