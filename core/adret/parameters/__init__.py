"""Typed parameters of every product: defaults, limits and descriptions in one place.

The command line, the service's JSON schemas and the checks all read them from here.
"""

from adret.parameters.horizons import (
    BodyParameters,
    HorizonParameters,
    OpennessParameters,
    RayParameters,
    RoundParameters,
    SkyViewParameters,
)
from adret.parameters.lights import LightParameters, ShadowParameters
from adret.parameters.sights import ViewshedParameters
from adret.parameters.specification import MAX_LIST, Parameters, Specification, specifications

__all__ = [
    "MAX_LIST",
    "BodyParameters",
    "HorizonParameters",
    "LightParameters",
    "OpennessParameters",
    "Parameters",
    "RayParameters",
    "RoundParameters",
    "ShadowParameters",
    "SkyViewParameters",
    "Specification",
    "ViewshedParameters",
    "specifications",
]
