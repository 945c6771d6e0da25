"""Options of a method: one frozen dataclass each, checked when it is made."""

import math
from dataclasses import dataclass
from typing import Any, Literal

from adret.errors import InputError
from adret.parameters.specification import Parameters, _checked, option, specifications
from adret.screen.falloffs import Falloff, make_falloff

__all__ = ["FalloffOptions", "Options", "make_options", "option"]


@dataclass(frozen=True, kw_only=True)
class Options(Parameters):
    """Base: fields are made by `option`; a number with ``maximum=math.inf`` may be infinite."""

    def __post_init__(self) -> None:
        """Hold every value against its type and limits."""
        for spec in specifications(type(self)):
            value: Any = getattr(self, spec.name)
            if value is None and spec.optional:
                continue
            if spec.name == "falloff" and callable(value):
                continue
            if spec.maximum == math.inf and isinstance(value, float) and value == math.inf:
                continue
            object.__setattr__(self, spec.name, _checked(spec, value))


@dataclass(frozen=True, kw_only=True)
class FalloffOptions(Options):
    """Radius and falloff, shared by most methods."""

    radius: float = option(
        math.inf,
        "Distance from which on occluders do not count",
        unit="view units",
        above=0.0,
        maximum=math.inf,
    )
    falloff: Literal["none", "hard", "quadratic", "timonen"] = option(
        "none", "Weight of an occluder by its distance; in Python also a callable d -> W"
    )
    falloff_scale: float = option(
        1.0, "r of the falloff timonen, r/(r + d²)", unit="view units squared", above=0.0
    )

    def weights(self) -> Falloff:
        """The falloff."""
        return make_falloff(self.falloff, self.radius, self.falloff_scale)


def make_options(kind: type[Options], method: str, given: dict[str, Any]) -> Options:
    """Options of a method from keywords.

    Raises
    ------
    InputError
        For a keyword that the method does not know (the limit lists those it knows), and for
        values out of range.
    """
    known = [spec.name for spec in specifications(kind)]
    for name, value in given.items():
        if name not in known:
            raise InputError(name, f"an option of {method!r}: one of {', '.join(known)}", value)
    return kind(**given)
