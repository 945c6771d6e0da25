"""The reference: rays through the depth image, exact but for the noise of their directions."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adret._kernels.screen import depth_cells, filled_spheres
from adret._kernels.screen import raytraced as kernels
from adret.errors import InputError
from adret.screen.falloffs import Falloff
from adret.screen.field import Field
from adret.screen.occlusion import Estimate, Progress
from adret.screen.options import FalloffOptions, option

__all__ = ["Options", "RaySample", "estimate", "trace_at", "trace_several"]

SECOND_LAYER = True
VOLUMES = ("volumetric", "hemisphere", "sphere", "shell")
Layer = NDArray[np.float32]
Bounds = tuple[Layer, Layer, Layer, Layer, float, float, NDArray[np.float64]]
CHUNK = 4096
"""Pixels between two calls of progress."""


@dataclass(frozen=True, kw_only=True)
class Options(FalloffOptions):
    """Options of the reference."""

    rays: int = option(
        256,
        "Rays from each pixel, rounded down to twice a product of two whole numbers (points, "
        "rounded down to twice a cube or square, for volumes and shells)",
        minimum=2,
        maximum=1 << 24,
    )
    weight: Literal["cosine", "uniform", "volumetric", "hemisphere", "sphere", "shell"] = option(
        "cosine",
        "Of directions in the hemisphere: cosine, uniform; volumetric: solid share of the tangent "
        "sphere whose diameter is the radius; hemisphere: of the hemisphere of that radius, by the "
        "cosine; sphere: of the whole sphere; shell: of its surface",
    )
    thickness: float = option(
        math.inf,
        "How far the solid reaches behind the surface, in depth",
        unit="view units",
        above=0.0,
        maximum=math.inf,
    )
    seed: int = option(0, "Seed of the directions", minimum=0, maximum=2**31)

    def __post_init__(self) -> None:
        """Volumes need a radius, and know no falloff."""
        super().__post_init__()
        if self.weight in VOLUMES:
            if math.isinf(self.radius):
                raise InputError("radius", f"finite for the weight {self.weight}", self.radius)
            if self.falloff != "none":
                raise InputError("falloff", f"'none' for the weight {self.weight}", self.falloff)


class RaySample(NamedTuple):
    """The reference at some pixels.

    Attributes
    ----------
    halves : ndarray, shape (2, n), float64
        Two independent estimates of the occlusion; the best one is their mean.
    confidence : ndarray, shape (n,), float64
        Share of the rays (points) that were decided inside the image.
    bent_normal : ndarray, shape (3, n), float64, or None
        Mean open direction, unit; NaN where nothing is open. None for volumes.
    rays : int
        Rays (points) of each pixel, both halves.
    """

    halves: NDArray[np.float64]
    confidence: NDArray[np.float64]
    bent_normal: NDArray[np.float64] | None
    rays: int

    @property
    def occlusion(self) -> NDArray[np.float64]:
        """Mean of both halves, shape (n,)."""
        return np.asarray(self.halves.mean(axis=0))

    @property
    def noise(self) -> float:
        """Standard error of `occlusion`, root mean square over the pixels."""
        if not self.halves.size:
            return 0.0
        return float(0.5 * np.sqrt(np.mean((self.halves[0] - self.halves[1]) ** 2)))


def trace_at(
    field: Field,
    rows: ArrayLike,
    columns: ArrayLike,
    options: Options,
    progress: Progress | None = None,
) -> RaySample:
    """Occlusion of some pixels by casting rays through the depth image.

    Parameters
    ----------
    field : Field
    rows, columns : array_like, shape (n,), int
        Pixels of the field (guard band counted) that show a surface.
    options : Options
    progress : callable, optional
        Called as progress(done, total).

    Returns
    -------
    RaySample

    Raises
    ------
    InputError
        If a pixel lies outside, is sky or a hole.

    Notes
    -----
    Occlusion is ∫ V(ω) W(d) p(ω) dω with p = n·ω/π (weight "cosine") or 1/2π ("uniform"): V is 1
    where the ray enters the solid, first at distance d. The solid lies behind the surface, away
    from the eye along the view rays: all of it (thickness infinite, G_inf), or as far as
    `thickness` in depth (G_t).

    The surface is bilinear in 1/z (perspective) or z (orthographic) in each cell between four
    pixel centres, so a ray crosses it at the root of a quadratic: no step size. A cell that touches
    sky or a hole is broken: each quarter has the depth of its corner, if any. With a finite
    thickness so is a cell whose depths differ by more than the thickness and the surface's slope:
    else nothing could pass behind what stands in front. The slope is that of its steepest corner,
    where along each axis the smaller one of the changes of depth to both neighbours counts, and
    none if these have two signs: so a plane is whole at any tilt. A receiver's own quarters are
    empty.

    Weight "volumetric" is the solid share of the tangent sphere with the radius as its diameter
    (Szirmay-Kalos et al. 2010); "sphere" that of the sphere about the point with that radius,
    "shell" the share of its surface, and "hemisphere" (3/π R³) ∫∫ [solid] r² cos θ dr dω.

    Rays are stratified over the square that maps to the hemisphere and jittered by a hash of
    pixel, seed and ray. Each half has its own strata, so their difference tells the noise.

    References
    ----------
    S. Zhukov, A. Iones, G. Kronin, "An Ambient Light Illumination Model", 1998 (falloff by
    distance). L. Szirmay-Kalos et al., "Volumetric Ambient Occlusion for Real-Time Rendering and
    Games", 2010. Tangent frame: T. Duff et al., "Building an Orthonormal Basis, Revisited", 2017.

    Examples
    --------
    >>> from adret import Camera, DepthBuffer
    >>> groove = np.abs(np.arange(9) - 4.0) * np.ones((9, 1))
    >>> buffer = DepthBuffer(10.0 - groove, Camera.orthographic(9, 9, extent=(9.0, 9.0)))
    >>> trace_at(buffer.field, [4], [2], Options(rays=512)).bent_normal.round(1)[:, 0]
    array([0.5, 0. , 0.9])
    """
    return trace_several(field, rows, columns, options, [options.weights()], progress)[0]


def trace_several(
    field: Field,
    rows: ArrayLike,
    columns: ArrayLike,
    options: Options,
    falloffs: Sequence[Falloff],
    progress: Progress | None = None,
) -> list[RaySample]:
    """As `trace_at`, by the same rays for several falloffs; for weights of directions only.

    The options' own radius and falloff are not used. Confidence is that of the largest radius,
    bent normals are by the first falloff.
    """
    row = np.atleast_1d(np.asarray(rows, dtype=np.int64))
    column = np.atleast_1d(np.asarray(columns, dtype=np.int64))
    if row.shape != column.shape or row.ndim != 1:
        raise InputError("columns", f"of the rows' shape {row.shape}", column.shape)
    inside = (row >= 0) & (row < field.depth.shape[0])
    inside &= (column >= 0) & (column < field.depth.shape[1])
    if not inside.all():
        at = int(np.argmin(inside))
        raise InputError("rows", "inside the image", (int(row[at]), int(column[at])))
    if np.isnan(field.depth[row, column]).any():
        at = int(np.argmax(np.isnan(field.depth[row, column])))
        raise InputError("rows", "pixels that show a surface", (int(row[at]), int(column[at])))
    solid = _Solid(field, options.thickness)
    count = len(row)
    halves = np.zeros((len(falloffs), 2, count))
    decided = np.zeros(count)
    bent = None if options.weight in VOLUMES else np.zeros((3, count))
    rays = 0
    for start in range(0, count, CHUNK):
        if progress is not None:
            progress(start, count)
        part = slice(start, start + CHUNK)
        found = (halves[:, :, part], decided[part])
        if bent is None:
            rays = solid.fill(options, row[part], column[part], *found)
        else:
            rays = solid.cast(options, falloffs, row[part], column[part], *found, bent[:, part])
    if progress is not None:
        progress(count, count)
    return [RaySample(each, decided, bent, rays) for each in halves]


class _Solid:
    """Nearness with a border of NaN, and bounds of cells and blocks of it; of both layers."""

    def __init__(self, field: Field, thickness: float) -> None:
        self.field = field
        self.thickness = thickness
        self.near, self.bounds = self._padded(field.depth)
        self.second, self.second_bounds = np.zeros((0, 0)), self.bounds
        if field.second.size:
            self.second, self.second_bounds = self._padded(field.second)

    def _padded(self, depth: NDArray[np.float32]) -> tuple[NDArray[np.float64], Bounds]:
        rows, columns = depth.shape
        q = np.full((rows + 2, columns + 2), np.nan)
        z = depth.astype(np.float64)
        q[1:-1, 1:-1] = 1.0 / z if self.field.perspective else -z
        top, low = (np.empty((rows + 1, columns + 1), dtype=np.float32) for _ in range(2))
        depth_cells.cell_bounds(q, self.field.perspective, self.thickness, top, low)
        blocks = (rows // depth_cells.BLOCK + 1, columns // depth_cells.BLOCK + 1)
        block_top, block_low = (np.empty(blocks, dtype=np.float32) for _ in range(2))
        depth_cells.block_bounds(top, low, block_top, block_low)
        slopes = np.zeros_like(top, dtype=np.float64)
        depth_cells.cell_slopes(q, self.field.perspective, slopes)
        return q, (top, low, block_top, block_low, float(top.max()), float(low.min()), slopes)

    def cast(
        self,
        options: Options,
        falloffs: Sequence[Falloff],
        rows: NDArray[np.int64],
        columns: NDArray[np.int64],
        halves: NDArray[np.float64],
        decided: NDArray[np.float64],
        bent: NDArray[np.float64],
    ) -> int:
        """Cast rays from some pixels into the arrays; returns how many each had."""
        strata = max(1, math.isqrt(options.rays // 2))
        around = max(1, options.rays // 2 // strata)
        tables = np.zeros((len(falloffs), max(len(each.table) for each in falloffs)))
        for table, each in zip(tables, falloffs, strict=True):
            table[: len(each.table)] = each.table
        kernels.trace(
            self.near,
            self.bounds,
            self.second,
            self.second_bounds,
            *self._shared,
            rows,
            columns,
            strata,
            around,
            options.weight == "cosine",
            np.array([each.code for each in falloffs]),
            np.array([each.radius for each in falloffs]),
            np.array([each.scale for each in falloffs]),
            tables,
            options.seed,
            halves,
            decided,
            bent,
        )
        return 2 * strata * around

    def fill(
        self,
        options: Options,
        rows: NDArray[np.int64],
        columns: NDArray[np.int64],
        halves: NDArray[np.float64],
        decided: NDArray[np.float64],
    ) -> int:
        """Throw points into the spheres of some pixels; returns how many each had."""
        hollow = options.weight == "shell"
        touching = options.weight == "volumetric"
        domain = filled_spheres.SURFACE if hollow else filled_spheres.BALL
        if options.weight == "hemisphere":
            domain = filled_spheres.HEMISPHERE
        points = options.rays // 2
        strata = max(1, math.isqrt(points) if hollow else int((points + 0.5) ** (1.0 / 3.0)))
        radius = 0.5 * options.radius if touching else options.radius
        filled_spheres.fill_spheres(
            self.near,
            self.bounds[-1],
            self.second,
            self.second_bounds[-1],
            *self._shared,
            rows,
            columns,
            strata,
            domain,
            radius if touching else 0.0,
            radius,
            options.seed,
            halves[0],
            decided,
        )
        return 2 * strata ** (2 if hollow else 3)

    @property
    def _shared(self) -> tuple[Any, ...]:
        field = self.field
        return field.normal, field.rays, field.perspective, self.thickness, field.origin


def estimate(field: Field, options: Options, progress: Progress | None) -> Estimate:
    """Occlusion of every receiver by casting rays; see `trace_at`."""
    row0, row1, column0, column1 = field.frame
    solid = ~np.isnan(field.depth[row0:row1, column0:column1])
    rows, columns = np.nonzero(solid)
    found = trace_at(field, rows + row0, columns + column0, options, progress)
    occlusion = np.zeros(field.shape, dtype=np.float32)
    confidence = np.zeros(field.shape, dtype=np.float32)
    occlusion[solid] = found.occlusion
    confidence[solid] = found.confidence
    bent = None
    if found.bent_normal is not None:
        bent = np.full((3, *field.shape), np.nan, dtype=np.float32)
        bent[:, solid] = found.bent_normal
    return Estimate(
        occlusion, confidence, bent, {}, {"noise": found.noise, "rays": float(found.rays)}
    )
