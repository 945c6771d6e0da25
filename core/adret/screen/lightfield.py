"""Ambient occlusion for light-field displays (S4): samples in a shell, on any image."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from adret._kernels.screen.containment import KEEP, VIEW, containment
from adret._kernels.screen.positions import add_tests
from adret.screen.bands import NO_COLOR, Layer, no_light, run_in_bands
from adret.screen.crytek import nearness_of
from adret.screen.field import Field
from adret.screen.occlusion import AOResult, Estimate, Progress, ScreenReport, strengthened
from adret.screen.options import Options as Base
from adret.screen.options import option
from adret.screen.positions import PositionsBuffer
from adret.screen.samples import rotations, shell_samples

__all__ = ["Options", "estimate", "estimate_positions"]

NEUTRAL = 0.5
"""Value of a sample beside the image: that of a flat surface."""
BAND = 1 << 18
"""Pixels that a map is asked about at once."""


@dataclass(frozen=True, kw_only=True)
class Options(Base):
    """Options of the light-field variant."""

    radius: float = option(
        1.0, "Outer radius of the largest shell", unit="view units", above=0.0, maximum=1e30
    )
    radii: int = option(
        1,
        "Shells, each smaller than the one before; the largest value counts (5 as published)",
        minimum=1,
        maximum=16,
    )
    ratio: float = option(
        0.5, "Radius of a shell by that of the one before", above=0.0, maximum=1.0
    )
    samples: int = option(8, "Samples of each pixel and shell", minimum=1, maximum=1024)
    sampler: Literal["cylindrical", "jittered", "latin", "poisson"] = option(
        "poisson",
        "How samples are spread over height and longitude of the sphere: independent, one in each "
        "cell of a grid, one in each row and column, or kept apart",
    )
    inner: float = option(0.8, "Inner radius of a shell by its outer one", minimum=0.0, maximum=1.0)
    tile: int = option(
        4,
        "Side of the tile of turned samples that repeats over the image; 1 turns none",
        minimum=1,
        maximum=64,
    )
    seed: int = option(0, "Seed of the samples", minimum=0, maximum=2**31)

    @property
    def offsets(self) -> NDArray[np.float64]:
        """Samples of each pixel of the tile, (tile², 3, samples), for a radius of 1."""
        points = shell_samples(self.sampler, self.samples, self.seed, self.inner)
        turns = np.eye(3)[None] if self.tile == 1 else rotations(self.tile**2, self.seed)
        return np.ascontiguousarray(np.einsum("tij,sj->tis", turns, points))

    @property
    def shells(self) -> list[float]:
        """Outer radii, from the largest on."""
        return [self.radius * self.ratio**k for k in range(self.radii)]


def estimate(field: Field, options: Options, progress: Progress | None) -> Estimate:
    """Share of the samples in a shell that lie behind the surface, largest over the shells.

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
    Points at height ξ₁ and longitude πξ₂, between 0.8 and 1 radius, uniform in that shell. All
    shells use the same samples at another scale, so a plane has one value in all of them.
    Samples beside the image count 1/2, as on a flat surface.

    Own integral: the solid share of the shell. Flat 1/2, contact corner 3/4.

    References
    ----------
    O. Doronin et al., "Screen-Space Ambient Occlusion for Light Field Displays", 2017, algorithms
    2 to 4 and section 6; T.-D. Hoang and K.-L. Low, "Multi-Resolution Screen-Space Ambient
    Occlusion", 2010.

    Examples
    --------
    >>> from adret import Camera, DepthBuffer, ambient_occlusion
    >>> wall = DepthBuffer(np.full((8, 8), 3.0), Camera.perspective(8, 8, fov_y_deg=60.0))
    >>> result = ambient_occlusion(wall, method="lightfield", radius=0.1, samples=256)
    >>> round(float(result.occlusion.mean()), 2)
    0.5
    """
    nearness = nearness_of(field)
    offsets = options.offsets
    occlusion = confidence = np.zeros(field.shape, dtype=np.float32)
    for k, radius in enumerate(options.shells):

        def fill(
            part: tuple[int, int, int, int],
            shares: Layer,
            seen: Layer,
            radius: float = radius,
        ) -> None:
            containment(
                nearness,
                field.normal,
                field.depth,
                field.rays,
                field.perspective,
                part,
                field.origin,
                radius,
                False,
                offsets,
                VIEW,
                NEUTRAL,
                KEEP,
                NO_COLOR,
                shares,
                seen,
                no_light(shares),
            )

        shares, seen = run_in_bands(field, fill, _part(progress, k, options.radii))
        occlusion = np.maximum(occlusion, shares)
        confidence = confidence + seen / np.float32(options.radii)
    return Estimate(occlusion, np.minimum(confidence, np.float32(1.0)), None, {})


def estimate_positions(
    buffer: PositionsBuffer,
    options: Options,
    *,
    power: float,
    intensity: float,
    progress: Progress | None,
) -> AOResult:
    """The same over images of positions; see `ambient_occlusion`.

    Arrays are (rows, columns), or (views, rows, columns) where positions had views. What a pixel
    without a surface shows is open, 0, at confidence 0.
    """
    start = time.perf_counter()
    offsets, shells = options.offsets, options.shells
    views, rows, columns = buffer.shape
    occlusion = np.zeros(buffer.shape)
    confidence = np.zeros(buffer.shape)
    nearness = np.ascontiguousarray(-buffer.depth, dtype=np.float64)
    tile = np.arange(rows)[:, None] % options.tile * options.tile
    tile = tile + np.arange(columns) % options.tile
    height = max(1, BAND // columns)
    total, done = views * math.ceil(rows / height) * len(shells), 0
    for view in range(views):
        for top in range(0, rows, height):
            part = slice(top, min(top + height, rows))
            here = buffer.positions[view, :, part]
            for radius in shells:
                if progress is not None:
                    progress(done, total)
                done += 1
                shares, seen = np.zeros(here.shape[1:]), np.zeros(here.shape[1:])
                for sample in range(options.samples):
                    offset = radius * offsets[tile[part], :, sample].transpose(2, 0, 1)
                    image = buffer.to_image(view, here + offset)
                    add_tests(nearness[view], image, NEUTRAL, shares, seen)
                best = occlusion[view, part]
                np.maximum(best, shares / options.samples, out=best)
                confidence[view, part] += seen / (options.samples * len(shells))
    if progress is not None:
        progress(total, total)
    empty = np.isnan(buffer.depth)
    result = strengthened(occlusion.astype(np.float32), power, intensity)
    result[empty] = 0.0
    confidence[empty] = 0.0
    choice = 0 if buffer.single else slice(None)
    return AOResult(
        occlusion=result[choice],
        confidence=confidence[choice].astype(np.float32),
        bent_normal=None,
        camera=None,
        frame=(0, rows, 0, columns),
        report=ScreenReport(
            method="lightfield",
            options={each.name: getattr(options, each.name) for each in fields(options)},
            receivers=int((~empty).sum()),
            skipped={"sky": int(empty.sum()), "holes": 0},
            measured={},
            normals={"degenerate": 0, "bent": 0, "missing": 0},
            seconds=time.perf_counter() - start,
        ),
    )


def _part(progress: Progress | None, done: int, count: int) -> Callable[[int, int], None] | None:
    """Progress of one of several equal parts."""
    if progress is None:
        return None
    return lambda step, steps: progress(done * steps + step, count * steps)
