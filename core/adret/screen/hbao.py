"""Image-space horizon-based ambient occlusion (S2), and its ray-marched form."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from adret._kernels.screen.hbao import horizons
from adret._kernels.screen.marched_rays import marched_rays
from adret.errors import InputError
from adret.screen.bands import Layer, run_in_bands
from adret.screen.crytek import nearness_of
from adret.screen.field import Field
from adret.screen.occlusion import Estimate, Progress
from adret.screen.options import FalloffOptions, option

__all__ = ["QUALITY", "Options", "estimate"]

QUALITY = {"low": (4, 4), "medium": (6, 6), "high": (8, 8), "ultra": (16, 16)}
"""Directions and steps of the published figures and tables."""


@dataclass(frozen=True, kw_only=True)
class Options(FalloffOptions):
    """Options of horizon-based ambient occlusion."""

    falloff: Literal["none", "hard", "quadratic", "timonen"] = option(
        "quadratic", "Weight of an occluder by its distance; in Python also a callable d -> W"
    )
    form: Literal["horizon", "rays"] = option(
        "horizon", "horizon: the method; rays: the ray-marched Monte Carlo form that it stands for"
    )
    directions: int | None = option(
        None, "Directions round each pixel; default by quality", minimum=1, maximum=1024
    )
    steps: int | None = option(
        None, "Steps of a direction or of a ray; default by quality", minimum=1, maximum=65536
    )
    quality: Literal["low", "medium", "high", "ultra"] = option(
        "medium",
        "Directions and steps where they are not given: low 4 and 4, medium 6 and 6, high 8 and "
        "8, ultra 16 and 16",
    )
    spacing: float | None = option(
        None,
        "Distance of samples instead of a number of steps; work grows with the radius",
        unit="pixels",
        minimum=1.0,
        maximum=65536.0,
    )
    rays: int = option(3, "Rays of each direction of the form rays", minimum=1, maximum=1024)
    tangents: Literal["sample", "direction"] = option(
        "sample",
        "sample: each sample stands on its own tangent (equation 9); direction: all on that of "
        "the direction's first (equation 8)",
    )
    angle_bias_deg: float = option(
        0.0,
        "Elevation above the surface below which nothing counts",
        unit="degrees",
        minimum=0.0,
        maximum=90.0,
    )
    jitter: bool = option(True, "Turn directions and shift samples by noise, from pixel to pixel")
    seed: int = option(0, "Seed of the noise", minimum=0, maximum=2**31)

    def __post_init__(self) -> None:
        """Check what excludes each other."""
        super().__post_init__()
        if self.spacing is not None and (self.steps is not None or self.form == "rays"):
            limit = "None where steps are given, and for the form rays"
            raise InputError("spacing", limit, self.spacing)
        if self.form == "rays" and math.isinf(self.radius):
            raise InputError("radius", "finite for the form rays", self.radius)

    @property
    def counts(self) -> tuple[int, int]:
        """Directions and steps."""
        directions, steps = QUALITY[self.quality]
        return self.directions or directions, self.steps or steps


def estimate(field: Field, options: Options, progress: Progress | None) -> Estimate:
    """Occlusion from the horizons of a few directions, or from marched rays.

    Parameters
    ----------
    field : Field
    options : Options
    progress : callable or None

    Returns
    -------
    Estimate

    Notes
    -----
    In each direction the samples that raise the elevation φ above the plane across the view ray add
    W(|S - P|) [(sin φ_i - sin t_i) - (sin φ_{i-1} - sin t_{i-1})], t_i being the elevation of the
    tangent plane below the sample; the mean over the directions is the occlusion, weighted
    uniformly over the hemisphere. Samples further away than the radius are left out.

    A direction's samples lie at (i + β) steps, i = 1 to N, of 1/(N + 1) of the projected radius,
    snapped to pixels. Where a step would be shorter than a pixel there are fewer, and where the
    radius is, none. Published is an end at that point for the whole pixel. What lies within the
    first step is not seen: few steps at a large projected radius give too little occlusion.

    Ours is exact where the publication is not. Published elevations stand on the image plane; a
    surface that the eye sees but that plane does not (beside the axis of a perspective camera)
    then shadows itself wholly, and a line of the image is not one azimuth. Ours stand on the plane
    across the pixel's view ray, directions are uniform about that ray, and tangents are taken at
    the samples' own places: a plane gives 0 at any tilt, and with W = 1 the limit of many samples
    is the uniform integral. In orthographic projection both are the same.

    The integral as published counts a vertical wall by one sample at its top, and weighs it by
    the distance to there: a step of 0.6 at a distance of 0.5, W = 1 - (d/2)², gives 0.204, where
    rays give 0.222. Directions are uniform about the view ray, not the normal. The form ``rays``
    marches through the depth image along 3D rays that are uniform over the hemisphere round the
    normal; as published it weighs the surface behind which a ray first finds itself, again a
    wall's top, and steps on where that is further away than the radius.

    References
    ----------
    L. Bavoil and M. Sainz, "Image-Space Horizon-Based Ambient Occlusion", ShaderX7, 2009, section
    6.2, equations 6 to 10; slides of the same title, SIGGRAPH 2008.

    Examples
    --------
    >>> import numpy as np
    >>> from adret import Camera, DepthBuffer, ambient_occlusion
    >>> wall = DepthBuffer(np.full((8, 8), 3.0), Camera.perspective(8, 8, fov_y_deg=60.0))
    >>> shown = ambient_occlusion(wall, method="hbao", radius=1.0)
    >>> bool(shown.occlusion.max() < 1e-6)
    True
    """
    directions, steps = options.counts
    weights = options.weights()
    if options.form == "rays":
        nearness = nearness_of(field)

        def fill(part: tuple[int, int, int, int], occlusion: Layer, confidence: Layer) -> None:
            marched_rays(
                nearness,
                field.depth,
                field.normal,
                field.rays,
                field.perspective,
                part,
                field.origin,
                options.seed,
                options.jitter,
                directions,
                options.rays,
                steps,
                *weights.numbers,
                occlusion,
                confidence,
            )

    else:

        def fill(part: tuple[int, int, int, int], occlusion: Layer, confidence: Layer) -> None:
            horizons(
                field.depth,
                field.normal,
                field.rays,
                field.perspective,
                part,
                field.origin,
                options.seed,
                options.jitter,
                directions,
                steps,
                options.spacing or 0.0,
                options.tangents == "sample",
                math.radians(options.angle_bias_deg),
                *weights.numbers,
                occlusion,
                confidence,
            )

    occlusion, confidence = run_in_bands(field, fill, progress)
    return Estimate(occlusion, confidence, None, {"small_radius": _small(field, options)})


def _small(field: Field, options: Options) -> int:
    """Pixels whose projected radius is below a pixel, so that no sample of them can count."""
    if options.form == "rays":
        return 0
    row0, row1, column0, column1 = field.frame
    depth = field.depth[row0:row1, column0:column1]
    ax, bx, ay, by = field.rays
    pixel = np.full(depth.shape, min(ax, -ay))
    if field.perspective:
        u = ax * np.arange(column0, column1) + bx
        v = ay * np.arange(row0, row1) + by
        pixel *= depth / np.sqrt(1.0 + u * u + (v * v)[:, None])
    return int(np.count_nonzero(~np.isnan(depth) & (options.radius < pixel)))
