"""One bounce of colour between the surfaces that an image shows."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adret._kernels.screen.indirect import indirect
from adret.errors import InputError
from adret.screen.depth import DepthBuffer
from adret.screen.options import make_options, option
from adret.screen.slice_options import TOLERANCE, SliceOptions, band_edges

if TYPE_CHECKING:
    from adret.screen.field import Field

__all__ = ["Options", "indirect_color"]

Layers = NDArray[np.float32]


@dataclass(frozen=True, kw_only=True)
class Options(SliceOptions):
    """Options of one bounce of colour."""

    facing: bool = option(
        True, "Surfaces send their colour to the side that the image shows, nothing to their backs"
    )


def indirect_color(
    buffer: DepthBuffer,
    color: ArrayLike,
    *,
    progress: Callable[[int, int], None] | None = None,
    **options: Any,
) -> Layers:
    """Light that each pixel receives from the surfaces around it, by their colours in the image.

    Parameters
    ----------
    buffer : DepthBuffer
    color : array_like, shape (3, rows, columns)
        Radiance of every pixel of the image, guard band included [any unit], finite where there is
        a surface. Surfaces are taken to send it into all directions.
    progress : callable, optional
        Called as progress(done, total); it may raise `Cancelled`.
    **options
        radius, falloff, falloff_scale, directions, weight, near, growth, tile and seed as for the
        method "exact", and facing: whether surfaces are black from behind (default) or have the
        same colour on both sides.

    Returns
    -------
    ndarray, shape (3, rows, columns), float32
        Mean radiance over the (weighted) hemisphere, directions that hit nothing counting as black;
        of the frame's shape, 0 at sky, NaN at holes. Times the pixel's albedo it is the light that
        the pixel sends on. White surroundings give the occlusion.

    Raises
    ------
    InputError
        If the colour does not fit the buffer or is not finite, for an unknown option, or a value
        out of range.

    Notes
    -----
    The same slices as in `adret.screen.exact`: each interval by which a horizon rises is weighted
    by cosine and falloff, times the colour of the sample that raised it. So of several occluders in
    a direction the first one counts.

    References
    ----------
    The idea of a bounce from what screen-space occlusion hits: V. Kajalin, "Screen-Space Ambient
    Occlusion", ShaderX7, 2009; T. Ritschel et al., "Approximating Dynamic Global Illumination in
    Image Space", 2009. The integral is ours.

    Examples
    --------
    >>> from adret import Camera, DepthBuffer
    >>> from adret.screen import indirect_color
    >>> groove = DepthBuffer(
    ...     100.0 - np.abs(np.arange(64) - 31.5) * np.ones((64, 1)),
    ...     Camera.orthographic(64, 64, extent=(64.0, 64.0)),
    ... )
    >>> red = np.zeros((3, 64, 64)); red[0] = 1.0
    >>> indirect_color(groove, red, radius=20.0)[:, 32, 34].round(1)
    array([0.4, 0. , 0. ], dtype=float32)
    """
    if not isinstance(buffer, DepthBuffer):
        raise InputError("buffer", "a DepthBuffer", type(buffer).__name__)
    chosen = cast(Options, make_options(Options, "indirect_color", options))
    field = buffer.field
    radiance = _checked(color, field)
    light = _gathered(field, radiance, chosen, progress)
    row0, row1, column0, column1 = buffer.frame
    frame = (slice(row0, row1), slice(column0, column1))
    light[:, buffer.sky[frame]] = 0.0
    light[:, buffer.holes[frame]] = np.nan
    return light


def _checked(color: ArrayLike, field: "Field") -> Layers:
    """The colours as float32, 0 where there is no surface."""
    try:
        given = np.asarray(color, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError("color", "numbers", type(color).__name__) from error
    if given.shape != (3, *field.depth.shape):
        raise InputError("color", f"of shape {(3, *field.depth.shape)}", given.shape)
    surface = np.isfinite(field.depth)
    wrong = surface & ~(np.abs(given) <= np.finfo(np.float32).max).all(axis=0)
    if wrong.any():
        row, column = np.argwhere(wrong)[0]
        raise InputError("color", "finite where there is a surface", given[:, row, column].tolist())
    return _spread(np.where(surface, given, 0.0).astype(np.float32), surface)


def _spread(radiance: Layers, surface: NDArray[np.bool_]) -> Layers:
    """Give pixels beside a surface the mean colour of its pixels, as its edge has it."""
    total = np.zeros_like(radiance)
    count = np.zeros(surface.shape, dtype=np.float32)
    rows, columns = surface.shape
    for row, column in ((0, 1), (1, 0), (1, 2), (2, 1)):
        window = (slice(row, row + rows), slice(column, column + columns))
        total += np.pad(radiance, ((0, 0), (1, 1), (1, 1)))[:, *window]
        count += np.pad(surface, 1)[window]
    return np.where(surface, radiance, total / np.maximum(count, 1.0))


def _gathered(
    field: "Field",
    radiance: Layers,
    options: Options,
    progress: Callable[[int, int], None] | None,
) -> Layers:
    lines = options.lines(field)
    normals = lines.laid_out(field.normal) if options.facing else np.zeros((3, 0), np.float32)
    laid = lines.laid_out(radiance)
    light = np.empty((3, *field.shape), dtype=np.float32)
    row0, _, column0, column1 = field.frame
    edges = band_edges(field)
    for done, (start, stop) in enumerate(pairwise(edges)):
        if progress is not None:
            progress(done, len(edges) - 1)
        indirect(
            lines.near,
            lines.pad,
            field.depth.shape,
            field.normal,
            field.rays,
            field.perspective,
            (row0 + start, row0 + stop, column0, column1),
            laid,
            normals,
            options.facing,
            *lines.samples,
            *options.shares,
            np.float32(TOLERANCE),
            *options.weights().numbers,
            light[:, start:stop],
        )
    if progress is not None:
        progress(len(edges) - 1, len(edges) - 1)
    return light
