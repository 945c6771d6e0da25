"""How a horizon is found: options that exist only if some kernel can serve them."""

import math
from dataclasses import dataclass
from typing import Literal, get_args

from adret import methods
from adret._values import one_of, real, whole
from adret.errors import InputError
from adret.grids import RasterGrid
from adret.terrain import Terrain

__all__ = ["NEAR_DEFAULT", "NEAR_MAX", "HorizonOptions", "Method"]

Method = Literal["sweep", "hull", "march", "exact"]

NEAR_DEFAULT = 32
NEAR_MAX = 4096


@dataclass(frozen=True, slots=True, kw_only=True)
class HorizonOptions:
    """How a horizon is found; see `horizon_map` for the meaning of each field.

    Raises
    ------
    InputError
        If a value is out of range.
    """

    method: Method = "sweep"
    near: int = NEAR_DEFAULT
    max_distance: float | None = None
    radius: float | None = None
    refraction: float = 0.0
    observer_height: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what no kernel can serve."""
        one_of("method", self.method, get_args(Method))
        near = whole("near", self.near, f"a whole number from 0 to {NEAR_MAX}", 0, NEAR_MAX)
        object.__setattr__(self, "near", near)
        if self.max_distance is not None:
            limit = "a distance above 0 m"
            if real("max_distance", self.max_distance, limit, 0.0, math.inf) == 0.0:
                raise InputError("max_distance", limit, self.max_distance)
            if self.method == "hull":
                raise InputError("max_distance", "None with method 'hull'", self.max_distance)
        if self.radius is not None:
            real("radius", self.radius, "a radius from 1 to 1e12 m, or None", 1.0, 1e12)
        refraction = real("refraction", self.refraction, "between -1 and 1", -1.0, 1.0)
        if refraction != 0.0 and self.radius is None:
            raise InputError("refraction", "0 without a radius", self.refraction)
        real("observer_height", self.observer_height, "between 0 and 1e6 m", 0.0, 1e6)

    @property
    def bend(self) -> float:
        """Drop of the surface by curvature and refraction a square metre of way [1/m]."""
        if self.radius is None:
            return 0.0
        return (1.0 - self.refraction) / (2.0 * self.radius)

    @property
    def range(self) -> float:
        """Largest distance [m], infinity for none."""
        return math.inf if self.max_distance is None else float(self.max_distance)

    def halo(self, terrain: Terrain) -> int:
        """Cells round a window of `terrain` that make its results those of the whole, in bytes.

        Raises
        ------
        InputError
            If `max_distance` is None: then a result may depend on the whole raster.
        """
        top, rows = terrain.origin[0], terrain.shape[0]
        return self.halo_of(terrain.grid, top, top + rows)

    def halo_of(self, grid: RasterGrid, start: int, stop: int) -> int:
        """As `halo`, for receivers in rows start..stop of a raster."""
        if self.max_distance is None:
            raise InputError("max_distance", "a distance, to know a halo", None)
        bands = grid.bands(start, stop, methods.MAX_AZIMUTH_ERROR)
        smallest = min(min(band.cell_size) for band in bands)
        return math.ceil(self.max_distance / smallest) + methods.POOL + 1
