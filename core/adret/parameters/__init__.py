"""Typed parameters of every product: defaults, limits and descriptions in one place.

The command line, the service's JSON schemas and the checks all read them from here.
"""

from adret.parameters.horizons import (
    BodyParameters,
    HorizonParameters,
    OpennessParameters,
    RayParameters,
    RoundParameters,
    SettledParameters,
    SkyViewParameters,
)
from adret.parameters.lights import (
    BounceParameters,
    LightParameters,
    ShadowParameters,
    SourceParameters,
)
from adret.parameters.screens import SsaoParameters
from adret.parameters.sights import ViewshedParameters, VisibilityParameters
from adret.parameters.specification import MAX_LIST, Parameters, Specification, specifications

__all__ = [
    "MAX_LIST",
    "BodyParameters",
    "BounceParameters",
    "HorizonParameters",
    "LightParameters",
    "OpennessParameters",
    "Parameters",
    "RayParameters",
    "RoundParameters",
    "SettledParameters",
    "ShadowParameters",
    "SkyViewParameters",
    "SourceParameters",
    "Specification",
    "SsaoParameters",
    "ViewshedParameters",
    "VisibilityParameters",
    "specifications",
]
