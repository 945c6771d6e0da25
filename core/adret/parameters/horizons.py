"""Parameters of products that look at the horizon."""

from dataclasses import dataclass
from typing import Literal

from adret.errors import InputError
from adret.parameters.specification import Parameters, option

__all__ = [
    "BodyParameters",
    "HorizonParameters",
    "OpennessParameters",
    "RayParameters",
    "RoundParameters",
    "SettledParameters",
    "SkyViewParameters",
]


@dataclass(frozen=True, kw_only=True)
class BodyParameters(Parameters):
    """How far and over which body one looks; shared by all products."""

    max_distance: float | None = option(
        None, "Look no further than this; default: to the raster's edge.", unit="m", above=0.0
    )
    curvature: bool = option(False, "Let the body's surface fall away, by the CRS's radius.")
    radius: float | None = option(
        None,
        "Radius of the body, instead of the CRS's; switches curvature on.",
        unit="m",
        minimum=1e3,
        maximum=1e9,
    )
    refraction: float = option(
        0.0,
        "Refraction coefficient of the air (0.13 is usual on Earth); only with curvature.",
        minimum=-1.0,
        maximum=1.0,
    )

    def __post_init__(self) -> None:
        """Check that air bends light over a body."""
        super().__post_init__()
        if self.refraction != 0.0 and self.radius is None and not self.curvature:
            raise InputError("refraction", "0 without curvature", self.refraction)


@dataclass(frozen=True, kw_only=True)
class RayParameters(BodyParameters):
    """How a horizon is found."""

    method: Literal["sweep", "hull", "march", "exact"] = option(
        "sweep",
        "sweep: exact near field and hull-swept far field; hull: convex-hull sweep alone; "
        "march: every sample along the line; exact: every crossing of the cell's own ray.",
    )
    near: int | None = option(
        None,
        "Radius of the exact near field of the sweep in cells; larger is more accurate. "
        "Default: the library's.",
        minimum=0,
        maximum=4096,
    )
    observer_height: float = option(
        0.0, "Height of the receiver above the ground.", unit="m", minimum=0.0, maximum=1e6
    )


@dataclass(frozen=True, kw_only=True)
class RoundParameters(RayParameters):
    """Products that look round the whole circle."""

    directions: int = option(
        64, "Number of azimuths, equally spaced from grid north.", minimum=1, maximum=7200
    )


@dataclass(frozen=True, kw_only=True)
class SettledParameters(RoundParameters):
    """Products that may double their azimuths until they settle."""

    directions: int | Literal["auto"] = option(  # type: ignore[assignment]
        64,
        "Number of azimuths, equally spaced from grid north; auto: doubled from 8 until the "
        "result changes by no more than the tolerance.",
        minimum=1,
        maximum=7200,
    )
    tolerance: float | None = option(
        None,
        "Mean change, as a share of the scale (1, 90 degrees, the mean irradiance), that ends the "
        "doubling; only where directions is auto. Default: 0.002.",
        minimum=0.0,
        maximum=1.0,
    )

    def __post_init__(self) -> None:
        """Refuse a tolerance that nothing asks for."""
        super().__post_init__()
        if self.tolerance is not None and self.directions != "auto":
            raise InputError("tolerance", "left out unless directions is auto", self.tolerance)


@dataclass(frozen=True, kw_only=True)
class HorizonParameters(RoundParameters):
    """Parameters of the horizon map."""

    azimuths_deg: tuple[float, ...] | None = option(
        None,
        "Azimuths to use instead, clockwise from grid north.",
        unit="deg",
        minimum=-360.0,
        maximum=720.0,
    )
    dtype: Literal["uint16", "float32"] = option(
        "uint16",
        "How angles are stored: uint16 with scale and offset (step 0.00275 degrees), or float32.",
    )


@dataclass(frozen=True, kw_only=True)
class SkyViewParameters(SettledParameters):
    """Parameters of the sky view."""

    kind: Literal["visible", "horizontal", "normal"] = option(
        "visible",
        "visible: share of the sky seen; horizontal: sky-view factor of a horizontal receiver; "
        "normal: of the sloping cell.",
    )
    clip: bool = option(True, "Count no sky below the horizontal (kind normal).")


@dataclass(frozen=True, kw_only=True)
class OpennessParameters(SettledParameters):
    """Parameters of openness."""

    sign: int = option(1, "1 for positive, -1 for negative openness.", minimum=-1, maximum=1)

    def __post_init__(self) -> None:
        """Refuse 0."""
        super().__post_init__()
        if self.sign == 0:
            raise InputError("sign", "1 or -1", self.sign)
