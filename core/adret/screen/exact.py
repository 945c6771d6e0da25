"""Occlusion by exact slices: our own method."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from adret._kernels.screen.exact import slices
from adret.screen.field import Field
from adret.screen.occlusion import Estimate, Progress
from adret.screen.options import FalloffOptions, option
from adret.screen.slice_lines import SliceLines

__all__ = ["Options", "estimate"]

BANDS = 16
STRIDE = 1.0 / 32.0
"""Intervals are closed after this share of the way to the radius, or of the falloff's scale."""
TOLERANCE = 0.03
"""Largest bend of the weights over an interval, times its sine, for Simpson's rule."""


@dataclass(frozen=True, kw_only=True)
class Options(FalloffOptions):
    """Options of exact slices."""

    directions: int = option(
        32, "Directions of the image round each pixel", minimum=1, maximum=4096
    )
    weight: Literal["cosine", "uniform"] = option("cosine", "Of directions in the hemisphere")
    near: int = option(
        16,
        "Distance up to which every crossing with the pixel grid is looked at",
        unit="pixels",
        minimum=1,
        maximum=65536,
    )
    growth: float = option(
        1.0 / 32.0,
        "Distance of samples further out, as a share of the way to them; 0 for every pixel",
        minimum=0.0,
        maximum=1.0,
    )
    tile: int = option(
        1,
        "Side of the square of pixels whose directions are turned against each other, for a "
        "filter over that square",
        unit="pixels",
        minimum=1,
        maximum=8,
    )
    seed: int = option(0, "Deals the turned directions to the square", minimum=0, maximum=2**31)


def estimate(field: Field, options: Options, progress: Progress | None) -> Estimate:
    """Occlusion of every receiver from the first hits in slices through its view ray.

    Parameters
    ----------
    field : Field
    options : Options
    progress : callable or None

    Returns
    -------
    Estimate
        With bent normals. Confidence is the share of the (weighted) hemisphere that is hit or comes
        to the radius before it leaves the image.

    Notes
    -----
    Occlusion is ∫ V(ω) W(d) p(ω) dω with p = n·ω/π (weight "cosine") or 1/2π ("uniform"), d being
    the distance of the first hit, as for the method "raytraced": all behind the surface is solid.
    In a slice, a plane through the view ray, the inner integral is closed in the intervals by
    which the horizon rises, and the sum over the slices is divided by what the same slices give for
    a closed hemisphere. So a plane gives 0, whatever its tilt and the number of directions.

    The derivation is in ``docs/explanation/screen-space-exact.md``.

    References
    ----------
    The integral in a slice by the cosine: J. Jimenez et al., "Practical Real-Time Strategies for
    Accurate Indirect Occlusion", 2016, equation 7. The rest is ours.

    Examples
    --------
    >>> from adret import Camera, DepthBuffer, ambient_occlusion
    >>> step = np.where(np.arange(129) < 64, 50.0, 100.0) * np.ones((129, 1))
    >>> buffer = DepthBuffer(step, Camera.orthographic(129, 129, extent=(129.0, 129.0)))
    >>> foot = ambient_occlusion(buffer, method="exact", radius=40.0).occlusion[64, [64, 84, 128]]
    >>> foot.round(2)
    array([0.5 , 0.19, 0.  ], dtype=float32)
    """
    lines = SliceLines.of(
        field,
        options.radius,
        options.directions,
        options.near,
        options.growth,
        tile=options.tile,
        seed=options.seed,
    )
    weights = options.weights()
    row0, _, column0, column1 = field.frame
    shape = field.shape
    occlusion = np.empty(shape, dtype=np.float32)
    confidence = np.empty(shape, dtype=np.float32)
    bent = np.empty((3, *shape), dtype=np.float32)
    used = np.zeros((shape[0], 2), dtype=np.int64)
    cosine = np.float32(options.weight == "cosine")
    edges = np.linspace(0, shape[0], min(BANDS, shape[0]) + 1).astype(int).tolist()
    for done, (start, stop) in enumerate(pairwise(edges)):
        if progress is not None:
            progress(done, len(edges) - 1)
        slices(
            lines.near,
            lines.pad,
            field.depth.shape,
            field.normal,
            field.rays,
            field.perspective,
            (row0 + start, row0 + stop, column0, column1),
            *lines.samples,
            np.float32(STRIDE),
            np.float32(0.0),
            cosine,
            np.float32(1.0) - cosine,
            np.float32(TOLERANCE),
            *weights.numbers,
            occlusion[start:stop],
            confidence[start:stop],
            bent[:, start:stop],
            used[start:stop],
        )
    if progress is not None:
        progress(len(edges) - 1, len(edges) - 1)
    return Estimate(occlusion, confidence, bent, {})
