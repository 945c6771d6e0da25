"""Estimates at half the resolution, and filters of estimates: what methods share."""

from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adret._kernels.screen.denoise import upsampled
from adret.screen.denoise import box_4x4, cross_bilateral, gaussian
from adret.screen.field import Field

__all__ = ["DENOISERS", "Denoiser", "Halved", "denoised", "halved", "restored"]

Layer = NDArray[np.float32]
Denoiser = Literal["box", "bilateral", "gaussian"]
DENOISERS = ("box", "bilateral", "gaussian")
PUBLISHED_RADIUS = 7
"""Half the width of the published cross-bilateral filter, 15 x 15 pixels."""


class Halved(NamedTuple):
    """A field of every second row and column, and where it lies in the whole.

    Attributes
    ----------
    field : Field
    shift : (int, int)
        Rows and columns by which the first halved receiver lies before the frame: 0 or 1.
    """

    field: Field
    shift: tuple[int, int]


def halved(field: Field) -> Halved:
    """Every second row and column, from the image's corner on, normals included."""
    row0, row1, column0, column1 = field.frame
    ax, bx, ay, by = field.rays
    low = Field(
        depth=_every_second(field.depth),
        normal=_every_second(field.normal),
        rays=np.array([2.0 * ax, bx, 2.0 * ay, by]),
        perspective=field.perspective,
        frame=(row0 // 2, (row1 + 1) // 2, column0 // 2, (column1 + 1) // 2),
        origin=(field.origin[0] // 2, field.origin[1] // 2),
        second=_every_second(field.second),
    )
    return Halved(low, (row0 % 2, column0 % 2))


def restored(layer: Layer, low: Halved, field: Field, depth_tolerance: float) -> Layer:
    """A layer of the halved frame at the pixels of the whole frame.

    Joint bilateral upsampling: tents over distance times Gaussians over the difference in depth.
    Pixels with nothing about them, sky and holes become NaN.
    """
    row0, row1, column0, column1 = low.field.frame
    depth = _frame(field)
    out = np.empty(depth.shape, dtype=np.float32)
    upsampled(
        np.ascontiguousarray(layer, dtype=np.float32),
        np.ascontiguousarray(low.field.depth[row0:row1, column0:column1]),
        depth,
        0.5,
        0.5,
        0.5 * low.shift[0],
        0.5 * low.shift[1],
        np.float32(np.sqrt(0.5) / depth_tolerance),
        1,
        out,
    )
    out[np.isnan(depth)] = np.nan
    return out


def denoised(
    layer: Layer,
    field: Field,
    denoise: Denoiser,
    depth_tolerance: float,
    samples: NDArray[Any] | None = None,
) -> Layer:
    """A layer of the frame through one of the filters; sky and holes take no part."""
    row0, row1, column0, column1 = field.frame
    depth = _frame(field)
    known = np.where(np.isnan(depth), np.float32(np.nan), layer)
    if denoise == "box":
        return box_4x4(known, depth, depth_tolerance=depth_tolerance)
    if denoise == "gaussian":
        return gaussian(known)
    return cross_bilateral(
        known,
        depth,
        depth_tolerance=depth_tolerance,
        radius=PUBLISHED_RADIUS,
        samples=None if samples is None else samples[:, row0:row1, column0:column1],
    )


def _frame(field: Field) -> Layer:
    row0, row1, column0, column1 = field.frame
    return np.ascontiguousarray(field.depth[row0:row1, column0:column1])


def _every_second(layers: Layer) -> Layer:
    part = np.ascontiguousarray(layers[..., ::2, ::2])
    part.setflags(write=False)
    return part
