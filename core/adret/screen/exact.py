"""Occlusion by exact slices: our own method."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from adret._kernels.screen.exact import slices
from adret._kernels.screen.shells import shell_slices
from adret._kernels.screen.slice_gather import gather
from adret.errors import InputError
from adret.screen.field import Field
from adret.screen.occlusion import Estimate, Progress
from adret.screen.options import option
from adret.screen.slice_lines import highest_from, ways_to
from adret.screen.slice_options import TOLERANCE, SliceOptions, band_edges
from adret.screen.steepness import steepness

__all__ = ["Options", "estimate"]

GROWTH = np.float32(1.0625)
"""Way in the image at the end of an interval of directions, over that at its beginning."""

ONE_PIXEL = 1.0
"""Every sample of a line but the pixel itself is at least so far away [pixels]."""


@dataclass(frozen=True, kw_only=True)
class Options(SliceOptions):
    """Options of exact slices."""

    thickness: float = option(
        math.inf,
        "How far the solid reaches behind the surface, in depth",
        unit="view units",
        above=0.0,
        maximum=math.inf,
    )
    tolerance: float = option(
        TOLERANCE,
        "Largest bend of the falloff over directions that are taken together, times their width "
        "in radians; 0 takes sample by sample (for an infinite thickness)",
        minimum=0.0,
        maximum=10.0,
    )
    gather: bool = option(
        False,
        "Whether results are means over `tile` x `tile` pixels of like surface, which together "
        "look in that many times `directions`; `tile` is then 2 or more",
    )

    def __post_init__(self) -> None:
        """Only pixels that look in unlike directions are worth gathering."""
        super().__post_init__()
        if self.gather and self.tile == 1:
            raise InputError("tile", "2 or more to gather", self.tile)


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
        to the radius before it leaves the image. Skipped are ``small_radius``, pixels whose radius
        is below a pixel of the image, which look at their own patch of surface only; and
        ``directions``, directions of pixels that were given up before the image or the radius
        ended, because nothing ahead is near enough to rise above the horizon. Neither changes
        the result.

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
    lines = options.lines(field)
    shape = field.shape
    occlusion = np.empty(shape, dtype=np.float32)
    confidence = np.empty(shape, dtype=np.float32)
    bent = np.empty((3, *shape), dtype=np.float32)
    given_up = np.zeros(shape[0], dtype=np.int64)
    whole = math.isinf(options.thickness)
    kernel = slices if whole else shell_slices
    cells: tuple[NDArray[np.generic], ...] = ()
    if not whole:
        steep = steepness(field.depth, field.perspective)
        cells = (*lines.cells, lines.laid_out(steep[None])[0])
    last = np.float32(options.tolerance if whole else options.thickness)
    row0, row1, column0, column1 = field.frame
    window = (slice(row0, row1), slice(column0, column1))
    empty = np.isnan(field.depth[window])
    small = ~empty & (ways_to(field, options.radius)[window] < ONE_PIXEL)
    tops = highest_from(field)
    edges = band_edges(field)
    for done, (start, stop) in enumerate(pairwise(edges)):
        if progress is not None:
            progress(done, len(edges) - 1)
        kernel(
            lines.near,
            lines.pad,
            field.depth.shape,
            field.normal,
            field.rays,
            field.perspective,
            (row0 + start, row0 + stop, column0, column1),
            *lines.samples,
            *cells,
            GROWTH,
            *options.shares,
            last,
            *options.weights().numbers,
            empty[start:stop],
            tops,
            occlusion[start:stop],
            confidence[start:stop],
            bent[:, start:stop],
            given_up[start:stop],
        )
    if progress is not None:
        progress(len(edges) - 1, len(edges) - 1)
    if options.gather:
        occlusion, confidence, bent = _gathered(field, options.tile, occlusion, confidence, bent)
    skipped = {"small_radius": int(small.sum()), "directions": int(given_up.sum())}
    return Estimate(occlusion, confidence, bent, skipped)


def _gathered(
    field: Field, tile: int, *layers: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Means of occlusion, confidence and bent normals over squares, where the surface is alike."""
    ax, bx, ay, by = field.rays
    rows, columns = field.depth.shape
    x = (ax * np.arange(columns) + bx).astype(np.float32)
    y = (ay * np.arange(rows) + by).astype(np.float32)
    occlusion, confidence, bent = (np.empty_like(layer) for layer in layers)
    gather(
        field.depth,
        field.normal,
        x,
        y,
        field.perspective,
        field.frame,
        tile,
        *layers,
        occlusion,
        confidence,
        bent,
    )
    return occlusion, confidence, bent
