"""Crytek's ambient occlusion (S1): how much of a ball round each point is solid."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from adret._kernels.screen.containment import (
    FADE_BY_DEPTH,
    FADE_BY_RADIUS,
    KEEP,
    MIRRORED,
    VIEW,
    containment,
)
from adret._kernels.screen.surface import to_nearness
from adret.errors import InputError
from adret.screen.bands import Layer, run_in_bands
from adret.screen.field import Field
from adret.screen.occlusion import Estimate, Progress
from adret.screen.options import Options as Base
from adret.screen.options import option
from adret.screen.samples import rotations

__all__ = ["Options", "estimate", "nearness_of", "published_kernel"]

CHECKS = {"none": KEEP, "radius": FADE_BY_RADIUS, "depth": FADE_BY_DEPTH}


@dataclass(frozen=True, kw_only=True)
class Options(Base):
    """Options of Crytek's ambient occlusion."""

    radius: float = option(
        1.0,
        "Radius of the ball, in view units or as a share of the frame's width (see radius_in)",
        unit="view units",
        above=0.0,
        maximum=1e30,
    )
    radius_in: Literal["view", "frame"] = option(
        "view",
        "view: the radius is a length; frame: a share of the frame's width as seen at the point's "
        "depth, as published (0.0936 there)",
    )
    samples: int = option(16, "Samples of each pixel, a multiple of 8", minimum=8, maximum=512)
    domain: Literal["sphere", "hemisphere"] = option(
        "sphere",
        "sphere: as published, a flat wall is 1/2; hemisphere: samples behind the surface are "
        "mirrored to its front, a flat wall is 0",
    )
    range_check: Literal["none", "radius", "depth"] = option(
        "radius",
        "Samples whose surface lies far in front of the point fade to a flat wall's value: from "
        "one to two radii; depth: from 0 to the surface's own depth, as published; none: never",
    )
    amplify: bool = option(
        False, "Return 1 - min(1, a² + a) of the accessibility a, the published contrast"
    )
    tile: int = option(
        4, "Side of the tile of turned kernels that repeats over the image", minimum=1, maximum=64
    )
    seed: int = option(0, "Seed of the kernels' rotations", minimum=0, maximum=2**31)

    def __post_init__(self) -> None:
        """Check that the kernel is made of whole cubes."""
        super().__post_init__()
        if self.samples % 8:
            raise InputError("samples", "a multiple of 8", self.samples)


def published_kernel(samples: int) -> NDArray[np.float64]:
    """Corners of cubes whose distance grows from sample to sample, the last one at 1.

    Parameters
    ----------
    samples : int
        A multiple of 8.

    Returns
    -------
    ndarray, shape (samples, 3), float64

    Notes
    -----
    The i-th of n samples lies at (1 + 2.4/n)^(i - n): most are near, which attenuates far ones.

    Examples
    --------
    >>> np.linalg.norm(published_kernel(16), axis=1)[[0, 15]].round(4)
    array([0.1229, 1.    ])
    """
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    lengths = (1.0 + 2.4 / samples) ** np.arange(1.0 - samples, 1.0)
    directions = np.tile(corners / np.sqrt(3.0), (samples // 8, 1))
    return np.asarray(directions * lengths[:, None], dtype=np.float64)


def nearness_of(field: Field) -> Layer:
    """What the surface is bilinear in, growing towards the eye: 1/z or -z."""
    nearness = np.empty_like(field.depth)
    to_nearness(field.depth, field.perspective, nearness)
    return nearness


def estimate(field: Field, options: Options, progress: Progress | None) -> Estimate:
    """Share of the kernel's samples that lie behind the surface.

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
    Published is a kernel of 8, 16 or 24 cube corners, turned by one of 16 rotations that repeat
    every 4 x 4 pixels, and a filter of that size afterwards (`box_4x4`). Ours departs from it in
    what follows. Its kernel lives in texture coordinates, where the ball is squashed by the image's
    aspect; here it is a ball in view space. The surface is interpolated between pixels, so planes
    give exactly the flat value at any tilt. Samples outside the image count as on a flat wall
    (1/2, or 0 for the hemisphere). The published check of depths, relative to the depth of the
    surface, means something only where depth 0 is the eye; the default is relative to the radius.

    Own integral: the solid share of spheres of the kernel's radii. Flat wall 1/2, contact corner
    of two walls 3/4, edge 1/4.

    References
    ----------
    V. Kajalin, "Screen-Space Ambient Occlusion", ShaderX7, 2009, section 6.1. The hemisphere is
    its "Future improvements".

    Examples
    --------
    >>> from adret import Camera, DepthBuffer, ambient_occlusion
    >>> wall = DepthBuffer(np.full((8, 8), 3.0), Camera.perspective(8, 8, fov_y_deg=60.0))
    >>> ambient_occlusion(wall, method="crytek", radius=0.1).occlusion.mean()
    np.float32(0.5)
    """
    nearness = nearness_of(field)
    turns = rotations(options.tile**2, options.seed)
    kernel = published_kernel(options.samples)
    offsets = np.ascontiguousarray(np.einsum("tij,sj->tis", turns, kernel))
    sphere = options.domain == "sphere"
    in_frame = options.radius_in == "frame"
    radius = options.radius
    if in_frame:
        radius *= float(field.rays[0]) * field.shape[1]

    def fill(part: tuple[int, int, int, int], occlusion: Layer, confidence: Layer) -> None:
        containment(
            nearness,
            field.normal,
            field.depth,
            field.rays,
            field.perspective,
            part,
            field.origin,
            radius,
            in_frame,
            offsets,
            VIEW if sphere else MIRRORED,
            0.5 if sphere else 0.0,
            CHECKS[options.range_check],
            occlusion,
            confidence,
        )

    occlusion, confidence = run_in_bands(field, fill, progress)
    if options.amplify:
        free = 1.0 - occlusion
        occlusion = 1.0 - np.minimum(free * free + free, np.float32(1.0))
    return Estimate(occlusion, confidence, None, {})
