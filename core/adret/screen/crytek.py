"""Crytek's ambient occlusion (S1): how much of a ball round each point is solid."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

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
from adret.screen.bands import NO_COLOR, Frame, Layer, run_in_bands
from adret.screen.depth import DepthBuffer
from adret.screen.field import Field
from adret.screen.occlusion import Estimate, Progress
from adret.screen.options import Options as Base
from adret.screen.options import make_options, option
from adret.screen.samples import rotations

__all__ = ["Options", "color_bleeding", "estimate", "nearness_of", "published_kernel"]

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
    occlusion, confidence, _ = _tested(field, options, NO_COLOR, progress)
    if options.amplify:
        free = 1.0 - occlusion
        occlusion = 1.0 - np.minimum(free * free + free, np.float32(1.0))
    return Estimate(occlusion, confidence, None, {})


def color_bleeding(
    buffer: DepthBuffer, color: ArrayLike, *, progress: Progress | None = None, **options: Any
) -> Layer:
    """Light that the samples' surfaces send to each pixel: colors of what occludes it.

    Parameters
    ----------
    buffer : DepthBuffer
    color : array_like, shape (rows, columns) or (bands, rows, columns), real
        What each pixel of the buffer sends, in any unit.
    progress : callable, optional
        Called as progress(done, total); it may raise `Cancelled`.
    **options
        Those of the method "crytek". The default of `domain` is "hemisphere" here, because the
        whole sphere finds the surface itself.

    Returns
    -------
    ndarray, of the shape of the frame, or with bands in front, float32
        Mean over the samples of the color of the pixel behind whose surface each lies, 0 for
        those that lie behind none; 0 at sky and holes. Times a surface's reflectance it is one
        bounce; of one color it is that color times the occlusion.

    Raises
    ------
    InputError
        If the color does not fit the buffer, is not finite, or an option cannot be used.

    References
    ----------
    V. Kajalin, "Screen-Space Ambient Occlusion", ShaderX7, 2009, section 6.1, names the idea,
    "screen-space indirect lighting", and gives no formula; this is the plainest one.

    Examples
    --------
    >>> from adret import Camera, DepthBuffer
    >>> depth = np.where(np.arange(16) < 8, 2.6, 3.0) * np.ones((16, 1))
    >>> buffer = DepthBuffer(depth, Camera.perspective(16, 16, fov_y_deg=60.0))
    >>> red = np.stack([depth < 2.8, 0.0 * depth])
    >>> color_bleeding(buffer, red, radius=0.5).max(axis=(1, 2)).round(1)
    array([0.2, 0. ], dtype=float32)
    """
    if not isinstance(buffer, DepthBuffer):
        raise InputError("buffer", "a DepthBuffer", type(buffer).__name__)
    given = np.asarray(color)
    if given.dtype.kind not in "biuf" or given.ndim not in (2, 3):
        limit = "real, of shape (rows, columns) or (bands, rows, columns)"
        raise InputError("color", limit, f"{given.dtype} {given.shape}")
    if given.shape[-2:] != buffer.shape or not np.isfinite(given).all():
        raise InputError("color", f"finite, of {buffer.shape} pixels", given.shape)
    chosen = make_options(Options, "crytek", {"domain": "hemisphere", **options})
    assert isinstance(chosen, Options)
    bands = np.ascontiguousarray(given.reshape(-1, *buffer.shape), dtype=np.float32)
    _, _, light = _tested(buffer.field, chosen, bands, progress)
    return light[0] if given.ndim == 2 else light


def _tested(
    field: Field, options: Options, color: Layer, progress: Progress | None
) -> tuple[Layer, Layer, Layer]:
    """Occlusion, confidence and light (bands, rows, columns) of the frame."""
    nearness = nearness_of(field)
    turns = rotations(options.tile**2, options.seed)
    kernel = published_kernel(options.samples)
    offsets = np.ascontiguousarray(np.einsum("tij,sj->tis", turns, kernel))
    sphere = options.domain == "sphere"
    in_frame = options.radius_in == "frame"
    radius = options.radius
    if in_frame:
        radius *= float(field.rays[0]) * field.shape[1]
    light = np.zeros((len(color), *field.shape), dtype=np.float32)

    def fill(part: Frame, occlusion: Layer, confidence: Layer) -> None:
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
            color,
            occlusion,
            confidence,
            light[:, part[0] - field.frame[0] : part[1] - field.frame[0]],
        )

    occlusion, confidence = run_in_bands(field, fill, progress)
    return occlusion, confidence, light
