"""Volumetric ambient occlusion (S3), and its containment test."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adret._kernels.screen.containment import KEEP, TANGENT, containment
from adret._kernels.screen.relief import containment_over_relief
from adret._kernels.screen.vao import pipes
from adret.errors import InputError
from adret.screen.bands import NO_COLOR, Layer, no_light, run_in_bands
from adret.screen.crytek import nearness_of
from adret.screen.field import Field
from adret.screen.occlusion import Estimate, Progress
from adret.screen.options import Options as Base
from adret.screen.options import option
from adret.screen.samples import disk_samples

__all__ = ["Options", "Relief", "containment_kernel", "estimate"]

POWERS = {"volumetric": 3.0, "hard": math.inf, "quadratic": 2.0, "linear": 1.0, "root": 0.5}
"""Membership -> power of d/R."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Relief:
    """A height field that displaces what the depth buffer shows, without being in it.

    Attributes
    ----------
    heights : ndarray, shape (m, n), float32
        Height above the surface of the depth buffer [view units]; repeats beyond its edges.
    texels : ndarray, shape (2, rows, columns), float32
        Each pixel's place on it: column, row; whole numbers are texel centres. NaN: no relief.
    along : ndarray, shape (3, rows, columns), float32
        Direction (right, up, back) in which the texture's columns count on the surface; its rows
        count along normal x direction.
    texel : float
        Side of a texel on the surface [view units].
    """

    heights: NDArray[np.float32]
    texels: NDArray[np.float32]
    along: NDArray[np.float32]
    texel: float

    def __post_init__(self) -> None:
        """Check shapes and numbers."""
        for name in ("heights", "texels", "along"):
            object.__setattr__(self, name, _single(name, getattr(self, name)))
        if self.heights.ndim != 2 or not self.heights.size or not np.isfinite(self.heights).all():
            raise InputError("heights", "finite, of shape (m, n)", self.heights.shape)
        if self.texels.ndim != 3 or len(self.texels) != 2:
            raise InputError("texels", "of shape (2, rows, columns)", self.texels.shape)
        if self.along.shape != (3, *self.texels.shape[1:]):
            raise InputError("along", f"of shape {(3, *self.texels.shape[1:])}", self.along.shape)
        if not (isinstance(self.texel, int | float) and 0.0 < self.texel < math.inf):
            raise InputError("texel", "a number above 0", self.texel)


@dataclass(frozen=True, kw_only=True)
class Options(Base):
    """Options of volumetric ambient occlusion."""

    radius: float = option(
        1.0,
        "How far the tangent sphere reaches: its diameter",
        unit="view units",
        above=0.0,
        maximum=1e30,
    )
    estimator: Literal["pipes", "containment"] = option(
        "pipes", "pipes: lengths inside the tangent sphere; containment: points behind the surface"
    )
    samples: int = option(8, "Pipes or points of each pixel", minimum=1, maximum=1024)
    normalisation: Literal["weighted", "analytic"] = option(
        "weighted",
        "Volume of the sphere that pipes are divided by: of the same pipes, or the exact one",
    )
    membership: Literal["volumetric", "hard", "quadratic", "linear", "root"] = option(
        "volumetric",
        "Openness by distance, for containment: (d/R)³, as that of pipes; 0 up to R; (d/R)²; d/R; "
        "the root of d/R",
    )
    relief: Relief | None = option(  # noqa: RUF009
        None, "A height field on the surface that occludes as well, for containment"
    )
    disk: Literal["poisson", "stratified"] = option(
        "poisson",
        "Pipes' places: kept apart, as published; stratified: moved so that each lies in a ring of "
        "the same area, which makes both normalisations agree",
    )
    tile: int = option(
        4, "Side of the tile of turned samples that repeats over the image", minimum=1, maximum=64
    )
    seed: int = option(0, "Seed of the samples", minimum=0, maximum=2**31)

    def __post_init__(self) -> None:
        """Check the relief."""
        super().__post_init__()
        if self.relief is not None:
            if not isinstance(self.relief, Relief):
                raise InputError("relief", "a Relief", type(self.relief).__name__)
            if self.estimator != "containment":
                raise InputError("relief", "None for the estimator pipes", "given")


def containment_kernel(samples: int, membership: str, seed: int = 0) -> NDArray[np.float64]:
    """Points round the zenith of the unit hemisphere whose mean indicator is the openness.

    Parameters
    ----------
    samples : int
    membership : str
        See `Options`.
    seed : int

    Returns
    -------
    ndarray, shape (samples, 3), float64

    Notes
    -----
    Directions are cosine-distributed, being points of the disk raised to the sphere; distances are
    the inverse of the membership at stratified numbers.

    Examples
    --------
    >>> np.linalg.norm(containment_kernel(8, "hard"), axis=1).round(6)
    array([1., 1., 1., 1., 1., 1., 1., 1.])
    """
    disk = disk_samples(samples, seed)
    up = np.sqrt(np.maximum(0.0, 1.0 - (disk * disk).sum(axis=1)))
    draw = np.random.default_rng(seed + 1)
    openness = (draw.permutation(samples) + draw.random(samples)) / samples
    distance = openness ** (1.0 / POWERS[membership])
    return np.column_stack([disk, up]) * distance[:, None]


def estimate(field: Field, options: Options, progress: Progress | None) -> Estimate:
    """Occluded share of the tangent sphere, or of containment tests.

    Parameters
    ----------
    field : Field
    options : Options
    progress : callable or None

    Returns
    -------
    Estimate
        Occlusion, 1 less the published openness V or O. With the analytic normalisation single
        pixels leave 0..1 before the filter that averages the tile (`box_4x4`).

    Notes
    -----
    Pipes: V = Σ Δz_i / F, Δz_i being the free length of a pipe in the sphere of radius R/2 that
    touches the surface, F the sum of all lengths of the same pipes (weighted) or what it is on
    average (analytic). Samples are Poisson-disk points, turned from pixel to pixel of the tile;
    turning keeps their distances from the centre, so with the analytic volume every pixel, and a
    plane, is off by what the one set lacks: the mean chord of n points is 12, 7 and 4 % off at n =
    4, 8 and 16 (standard deviation over seeds); seed 0 with 8 points gives planes 0.07. No filter
    removes that; weighting does, and so does ``disk="stratified"`` (0.01 at 8).
    As published pipes run parallel to the viewing axis. Ours run along the view rays, through the
    disk that the sphere covers as seen from the eye, and count volumes instead of lengths: the
    same in orthographic projection; in perspective a plane is 0 at any tilt. Outside the image
    everything is free.

    Own integral: the sphere's share behind the surface. Flat 0; wall at a, with c = 2a/R:
    (1 - c)² (2 + c)/4. Containment: (1/π) ∫∫ μ'(r) [behind the surface] cos θ dr dω, which is the
    occlusion weighted by 1 - μ(d) wherever rays enter the solid at most once.

    With a relief the points are open where both the depth buffer and the relief leave them open.

    References
    ----------
    L. Szirmay-Kalos et al., "Volumetric Ambient Occlusion for Real-Time Rendering and Games",
    IEEE CG&A, 2010, equations 5 to 7, "Noise Reduction with Interleaved Sampling" and "Results".

    Examples
    --------
    >>> from adret import Camera, DepthBuffer, ambient_occlusion
    >>> wall = DepthBuffer(np.full((8, 8), 3.0), Camera.perspective(8, 8, fov_y_deg=60.0))
    >>> ambient_occlusion(wall, method="vao", radius=1.0).occlusion.max().round(5)
    np.float32(0.0)
    """
    nearness = nearness_of(field)
    if options.estimator == "pipes":
        disk = disk_samples(options.samples, options.seed, stratified=options.disk != "poisson")
        samples = _turned(disk, options)

        def fill(part: tuple[int, int, int, int], occlusion: Layer, confidence: Layer) -> None:
            pipes(
                nearness,
                field.normal,
                field.depth,
                field.rays,
                field.perspective,
                part,
                field.origin,
                0.5 * options.radius,
                samples,
                options.normalisation == "weighted",
                occlusion,
                confidence,
            )

    else:
        points = containment_kernel(options.samples, options.membership, options.seed)
        points = _turned(points, options)
        relief = options.relief

        def fill(part: tuple[int, int, int, int], occlusion: Layer, confidence: Layer) -> None:
            common = (
                nearness,
                field.normal,
                field.depth,
                field.rays,
                field.perspective,
                part,
                field.origin,
                options.radius,
            )
            if relief is None:
                containment(
                    *common,
                    False,
                    points.transpose(0, 2, 1).copy(),
                    TANGENT,
                    0.0,
                    KEEP,
                    NO_COLOR,
                    occlusion,
                    confidence,
                    no_light(occlusion),
                )
            else:
                containment_over_relief(
                    *common,
                    points,
                    relief.heights,
                    relief.texels,
                    relief.along,
                    relief.texel,
                    occlusion,
                    confidence,
                )

        if relief is not None and relief.texels.shape[1:] != field.depth.shape:
            limit = f"for an image of {field.depth.shape[0]} x {field.depth.shape[1]} pixels"
            raise InputError("relief", limit, relief.texels.shape[1:])
    occlusion, confidence = run_in_bands(field, fill, progress)
    return Estimate(occlusion, confidence, None, {})


def _turned(points: NDArray[np.float64], options: Options) -> NDArray[np.float64]:
    """The points turned about their third axis, by equally spaced angles in no order."""
    count = options.tile**2
    angles = 2.0 * np.pi * np.random.default_rng(options.seed + 2).permutation(count) / count
    cosine, sine = np.cos(angles)[:, None], np.sin(angles)[:, None]
    x, y, rest = points[:, 0], points[:, 1], points[:, 2:]
    turned = np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=2)
    return np.ascontiguousarray(
        np.concatenate([turned, np.broadcast_to(rest, (len(angles), *rest.shape))], axis=2)
    )


def _single(name: str, values: ArrayLike) -> NDArray[np.float32]:
    array = np.asarray(values)
    if array.dtype.kind not in "iuf":
        raise InputError(name, "an array of real numbers", str(array.dtype))
    return np.ascontiguousarray(array, dtype=np.float32)
