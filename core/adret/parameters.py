"""Typed parameters of every product: defaults, limits and descriptions in one place.

The command line, the service's JSON schemas and the checks all read them from here.
"""

import math
from dataclasses import dataclass, field, fields
from typing import Any, Literal, get_args, get_type_hints

from adret.errors import InputError

__all__ = [
    "HorizonParameters",
    "LightParameters",
    "OpennessParameters",
    "Parameters",
    "RayParameters",
    "RoundParameters",
    "ShadowParameters",
    "SkyViewParameters",
    "Specification",
    "specifications",
]


def _option(
    default: Any,
    description: str,
    *,
    unit: str | None = None,
    minimum: float | None = None,
    maximum: float | None = None,
    above: float | None = None,
    length: int | None = None,
    form: str | None = None,
) -> Any:
    """A field with what the command line and the schemas say about it."""
    metadata = {
        "description": description,
        "unit": unit,
        "minimum": minimum,
        "maximum": maximum,
        "above": above,
        "length": length,
        "form": form,
    }
    return field(default=default, metadata=metadata)


@dataclass(frozen=True, slots=True, kw_only=True)
class Specification:
    """What is known of one parameter.

    Attributes
    ----------
    name : str
        Name of the field; a name that ends in _deg is in degrees.
    type : type
        "integer", "number", "boolean", "string", or "numbers" (a list).
    optional : bool
        Whether None is allowed.
    default : object
    description : str
    unit : str or None
    choices : tuple of str
        Empty when any text goes.
    minimum, maximum, above : float or None
        Limits, `above` exclusive; of each member for a list.
    length : int or None
        Members of a list, when fixed.
    form : str or None
        "path" for a file that is read.
    """

    name: str
    type: str
    optional: bool
    default: Any
    description: str
    unit: str | None
    choices: tuple[str, ...]
    minimum: float | None
    maximum: float | None
    above: float | None
    length: int | None
    form: str | None


def specifications(parameters: "type[Parameters]") -> tuple[Specification, ...]:
    """What is known of each parameter of a product: its own first, then the shared ones.

    Examples
    --------
    >>> [s.name for s in specifications(OpennessParameters)][:3]
    ['sign', 'directions', 'method']
    """
    hints = get_type_hints(parameters)
    known = {entry.name: entry for entry in fields(parameters)}
    order = [name for part in parameters.__mro__ for name in vars(part).get("__annotations__", ())]
    found = []
    for entry in (known[name] for name in order):
        kind, optional, choices = _kind(hints[entry.name])
        found.append(
            Specification(
                name=entry.name,
                type=kind,
                optional=optional,
                default=entry.default,
                choices=choices,
                **entry.metadata,
            )
        )
    return tuple(found)


def _kind(hint: Any) -> tuple[str, bool, tuple[str, ...]]:
    members = [h for h in get_args(hint) if h is not type(None)]
    optional = type(None) in get_args(hint)
    if optional:
        hint = members[0]
    arguments = get_args(hint)
    if arguments and all(isinstance(a, str) for a in arguments):
        return "string", optional, arguments
    if arguments:
        return "numbers", optional, ()
    names = {int: "integer", float: "number", bool: "boolean", str: "string"}
    return names[hint], optional, ()


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """Base: every field is held against its type and limits when the object is made."""

    def __post_init__(self) -> None:
        """Check, and turn lists and whole numbers into the declared types."""
        for spec in specifications(type(self)):
            value = getattr(self, spec.name)
            if value is None and spec.optional:
                continue
            object.__setattr__(self, spec.name, _checked(spec, value))


def _checked(spec: Specification, value: Any) -> Any:
    if spec.type == "boolean":
        if not isinstance(value, bool):
            raise InputError(spec.name, "true or false", value)
        return value
    if spec.type == "string":
        if not isinstance(value, str) or (spec.choices and value not in spec.choices):
            limit = f"one of {', '.join(spec.choices)}" if spec.choices else "text"
            raise InputError(spec.name, limit, value)
        return value
    if spec.type == "numbers":
        if isinstance(value, str) or not hasattr(value, "__iter__"):
            raise InputError(spec.name, "a list of numbers", value)
        numbers = tuple(_number(spec, member) for member in value)
        if not numbers or (spec.length is not None and len(numbers) != spec.length):
            limit = f"{spec.length} numbers" if spec.length is not None else "at least one number"
            raise InputError(spec.name, limit, value)
        return numbers
    return _number(spec, value)


def _number(spec: Specification, value: Any) -> float | int:
    whole = spec.type == "integer"
    wanted = "a whole number" if whole else "a number"
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InputError(spec.name, f"{wanted}{_limits(spec)}", value)
    inside = (
        math.isfinite(value)
        and (spec.minimum is None or value >= spec.minimum)
        and (spec.maximum is None or value <= spec.maximum)
        and (spec.above is None or value > spec.above)
    )
    if not inside or (whole and value != int(value)):
        raise InputError(spec.name, f"{wanted}{_limits(spec)}", value)
    return int(value) if whole else float(value)


def _limits(spec: Specification) -> str:
    unit = f" {spec.unit}" if spec.unit else ""
    low = spec.minimum if spec.above is None else spec.above
    if low is not None and spec.maximum is not None:
        return f" between {low:g} and {spec.maximum:g}{unit}"
    if low is not None:
        return f" {'of at least' if spec.above is None else 'above'} {low:g}{unit}"
    return f" of at most {spec.maximum:g}{unit}" if spec.maximum is not None else ""


@dataclass(frozen=True, kw_only=True)
class RayParameters(Parameters):
    """How a horizon is found; shared by all products."""

    method: Literal["sweep", "hull", "march", "exact"] = _option(
        "sweep",
        "sweep: exact near field and hull-swept far field; hull: convex-hull sweep alone; "
        "march: every sample along the line; exact: every crossing of the cell's own ray.",
    )
    near: int | None = _option(
        None,
        "Radius of the exact near field of the sweep in cells; larger is more accurate. "
        "Default: the library's.",
        minimum=0,
        maximum=4096,
    )
    max_distance: float | None = _option(
        None, "Look no further than this; default: to the raster's edge.", unit="m", above=0.0
    )
    curvature: bool = _option(False, "Let the body's surface fall away, by the CRS's radius.")
    radius: float | None = _option(
        None,
        "Radius of the body, instead of the CRS's; switches curvature on.",
        unit="m",
        minimum=1e3,
        maximum=1e9,
    )
    refraction: float = _option(
        0.0,
        "Refraction coefficient of the air (0.13 is usual on Earth); only with curvature.",
        minimum=-1.0,
        maximum=1.0,
    )
    observer_height: float = _option(
        0.0, "Height of the receiver above the ground.", unit="m", minimum=0.0, maximum=1e6
    )


@dataclass(frozen=True, kw_only=True)
class RoundParameters(RayParameters):
    """Products that look round the whole circle."""

    directions: int = _option(
        64, "Number of azimuths, equally spaced from grid north.", minimum=1, maximum=7200
    )


@dataclass(frozen=True, kw_only=True)
class HorizonParameters(RoundParameters):
    """Parameters of the horizon map."""

    azimuths_deg: tuple[float, ...] | None = _option(
        None,
        "Azimuths to use instead, clockwise from grid north.",
        unit="deg",
        minimum=-360.0,
        maximum=720.0,
    )
    dtype: Literal["uint16", "float32"] = _option(
        "uint16",
        "How angles are stored: uint16 with scale and offset (step 0.00275 degrees), or float32.",
    )


@dataclass(frozen=True, kw_only=True)
class SkyViewParameters(RoundParameters):
    """Parameters of the sky view."""

    kind: Literal["visible", "horizontal", "normal"] = _option(
        "visible",
        "visible: share of the sky seen; horizontal: sky-view factor of a horizontal receiver; "
        "normal: of the sloping cell.",
    )
    clip: bool = _option(True, "Count no sky below the horizontal (kind normal).")


@dataclass(frozen=True, kw_only=True)
class OpennessParameters(RoundParameters):
    """Parameters of openness."""

    sign: int = _option(1, "1 for positive, -1 for negative openness.", minimum=-1, maximum=1)

    def __post_init__(self) -> None:
        """Refuse 0."""
        super().__post_init__()
        if self.sign == 0:
            raise InputError("sign", "1 or -1", self.sign)


@dataclass(frozen=True, kw_only=True)
class ShadowParameters(RayParameters):
    """Parameters of the shadow map."""

    sun_deg: tuple[float, ...] = _option(
        (315.0, 35.0),
        "Azimuth (clockwise from grid north) and elevation of the sun.",
        unit="deg",
        minimum=-360.0,
        maximum=720.0,
        length=2,
    )
    sun_diameter_deg: float = _option(
        0.533, "Angular diameter of the solar disc.", unit="deg", minimum=0.0, maximum=20.0
    )
    layer: Literal["code", "lit"] = _option(
        "code",
        "code: 0 lit, 1 self-shadowed, 2 cast shadow; lit: share of the solar disc that is seen.",
    )

    def __post_init__(self) -> None:
        """Check the sun's elevation."""
        super().__post_init__()
        _check_sun(self.sun_deg)


@dataclass(frozen=True, kw_only=True)
class LightParameters(RoundParameters):
    """Parameters of the light map; at least one of sun, sky and environment."""

    sun_deg: tuple[float, ...] | None = _option(
        None,
        "Azimuth (clockwise from grid north) and elevation of the sun.",
        unit="deg",
        minimum=-360.0,
        maximum=720.0,
        length=2,
    )
    sun_irradiance: float = _option(
        1.0, "The sun's irradiance across its beam.", minimum=0.0, maximum=1e9
    )
    sun_diameter_deg: float = _option(
        0.533, "Angular diameter of the solar disc.", unit="deg", minimum=0.0, maximum=20.0
    )
    sky: Literal["none", "uniform", "overcast"] = _option(
        "none", "Sky light: uniform, or Moon and Spencer's overcast sky."
    )
    sky_radiance: float = _option(
        1.0,
        "Radiance of the uniform sky, or the overcast sky's at the zenith.",
        minimum=0.0,
        maximum=1e9,
    )
    environment: str | None = _option(
        None,
        "Environment map of the sky: .hdr, .exr or .npy, equirectangular or cube map.",
        form="path",
    )
    environment_rotation_deg: float = _option(
        0.0, "Turn the environment clockwise.", unit="deg", minimum=-360.0, maximum=360.0
    )
    normal_angles: int | None = _option(
        None,
        "Normal angles in the environment's table; default: the library's.",
        minimum=2,
        maximum=1024,
    )
    albedo: float | None = _option(
        None,
        "Reflectance: write the radiance that a matt surface sends back instead of the irradiance.",
        minimum=0.0,
        maximum=1.0,
    )

    def __post_init__(self) -> None:
        """Check the sun's elevation, and that there is any light."""
        super().__post_init__()
        if self.sun_deg is not None:
            _check_sun(self.sun_deg)
        if self.sun_deg is None and self.sky == "none" and self.environment is None:
            raise InputError("sky", "lit by at least one of sun, sky and environment", "none")


def _check_sun(sun: tuple[float, ...]) -> None:
    if not -90.0 <= sun[1] <= 90.0:
        raise InputError("sun_deg", "an elevation between -90 and 90 deg", sun[1])
