"""Filters that take the noise out of occlusion and leave the edges of depth in it."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adret._kernels.screen import denoise as kernels
from adret.errors import InputError

__all__ = [
    "box_4x4",
    "cross_bilateral",
    "edge_leakage",
    "gaussian",
    "joint_bilateral_upsample",
]

Layer = NDArray[np.float32]
PLAIN, THRESHOLD, SOFT = range(3)
MAX_RADIUS = 64


def box_4x4(values: ArrayLike, depth: ArrayLike, *, depth_tolerance: float) -> Layer:
    """Mean over 4 x 4 pixels, leaving out those at another depth.

    It takes away the pattern of methods whose samples repeat every 4 x 4 pixels: any window of
    that size holds each of the 16 sets once.

    Parameters
    ----------
    values : array_like, shape (rows, columns)
        Occlusion, or anything else per pixel; NaN takes no part and stays.
    depth : array_like, shape (rows, columns)
        Depth along the viewing axis [view units]; NaN (sky, holes) takes no part.
    depth_tolerance : float
        Neighbours whose depth differs by this or more are left out [view units], above 0.

    Returns
    -------
    ndarray, shape (rows, columns), float32
        From one row above and one column left of the pixel to two below and right of it.

    Raises
    ------
    InputError
        For arrays that do not fit each other and numbers out of range.

    References
    ----------
    V. Kajalin, "Screen-Space Ambient Occlusion", ShaderX7, 2009, "Edge-Preserving Blur";
    L. Szirmay-Kalos et al., "Volumetric Ambient Occlusion ...", 2010, "Noise Reduction with
    Interleaved Sampling".

    Examples
    --------
    >>> stripes = np.tile([0.0, 0.0, 1.0, 1.0], (4, 2))
    >>> box_4x4(stripes, np.ones((4, 8)), depth_tolerance=0.1)[2, 2:5]
    array([0.5, 0.5, 0.5], dtype=float32)
    """
    v, d = _pair(values, depth)
    steps = [(i, j) for i in range(-1, 3) for j in range(-1, 3)]
    weights = np.ones(16, dtype=np.float32)
    return _filtered(v, d, steps, weights, _tolerance(depth_tolerance), THRESHOLD)


def gaussian(values: ArrayLike, *, radius: int = 2, sigma: float | None = None) -> Layer:
    """Gaussian blur, a horizontal and a vertical pass; depth plays no part.

    Parameters
    ----------
    values : array_like, shape (rows, columns)
        NaN takes no part and stays.
    radius : int
        Half the width of the kernel [pixels], 1 to 64.
    sigma : float, optional
        Standard deviation [pixels], above 0; half the radius by default.

    Returns
    -------
    ndarray, shape (rows, columns), float32

    Raises
    ------
    InputError
        For anything but a plane of numbers and for numbers out of range.

    References
    ----------
    O. Doronin et al., "Screen-Space Ambient Occlusion for Light Field Displays", 2017, section 6,
    "Additional blur pass".

    Examples
    --------
    >>> dot = np.zeros((5, 5))
    >>> dot[2, 2] = 1.0
    >>> gaussian(dot, radius=1).round(3)[1:4, 1:4]
    array([[0.011, 0.084, 0.011],
           [0.084, 0.619, 0.084],
           [0.011, 0.084, 0.011]], dtype=float32)
    """
    v = _plane("values", values)
    return _two_passes(v, np.zeros_like(v), _bell(radius, sigma), 1.0, PLAIN)


def cross_bilateral(
    values: ArrayLike,
    depth: ArrayLike,
    *,
    depth_tolerance: float,
    radius: int = 7,
    sigma: float | None = None,
    separable: bool = True,
    samples: ArrayLike | None = None,
) -> Layer:
    """Gaussian blur weighted by how near neighbours are in depth.

    Parameters
    ----------
    values : array_like, shape (rows, columns)
        NaN takes no part and stays.
    depth : array_like, shape (rows, columns)
        Depth along the viewing axis [view units]; NaN (sky, holes) takes no part.
    depth_tolerance : float
        Standard deviation of the weight over the difference in depth [view units], above 0.
    radius : int
        Half the width of the kernel [pixels], 1 to 64; published are kernels of 9 x 9 to 21 x 21.
    sigma : float, optional
        Standard deviation over distance [pixels], above 0; half the radius by default.
    separable : bool
        A horizontal and a vertical pass, as published, which is not quite the filter itself; or
        one pass over the whole square.
    samples : array_like, shape (samples, rows, columns), optional
        Depths of several samples a pixel. At edges, where they differ by more than the tolerance,
        the whole square is filtered once about each of them, and averaged.

    Returns
    -------
    ndarray, shape (rows, columns), float32

    Raises
    ------
    InputError
        For arrays that do not fit each other and numbers out of range.

    References
    ----------
    L. Bavoil and M. Sainz, "Image-Space Horizon-Based Ambient Occlusion", ShaderX7, 2009,
    "Cross-Bilateral Filter" and "Multisample Antialiasing"; E. Eisemann and F. Durand, "Flash
    Photography Enhancement via Intrinsic Relighting", 2004.

    Examples
    --------
    >>> depth = np.where(np.arange(8) < 4, 1.0, 9.0) * np.ones((8, 1))
    >>> noisy = (depth > 5.0) + 0.1 * (-1.0) ** np.arange(8)[:, None]
    >>> cross_bilateral(noisy, depth, depth_tolerance=0.5, radius=3)[4].round(1) + 0.0
    array([0., 0., 0., 0., 1., 1., 1., 1.], dtype=float32)
    """
    v, d = _pair(values, depth)
    line = _bell(radius, sigma)
    sharp = math.sqrt(0.5) / _tolerance(depth_tolerance)
    if separable:
        result = _two_passes(v, d, line, sharp, SOFT)
    else:
        square = np.outer(line, line)
        steps = [(i, j) for i in range(-radius, radius + 1) for j in range(-radius, radius + 1)]
        result = _filtered(v, d, steps, square.ravel(), 1.0 / sharp, SOFT)
    if samples is not None:
        result = _per_sample(result, v, d, samples, line, sharp, depth_tolerance)
    return result


def joint_bilateral_upsample(
    values: ArrayLike,
    low_depth: ArrayLike,
    depth: ArrayLike,
    *,
    depth_tolerance: float,
    reach: int = 1,
) -> Layer:
    """Values of a smaller image at the pixels of a larger one, along its edges of depth.

    Parameters
    ----------
    values : array_like, shape (m, n)
        NaN takes no part.
    low_depth : array_like, shape (m, n)
        Depth that belongs to the values [view units].
    depth : array_like, shape (rows, columns)
        Depth of the larger image of the same view [view units].
    depth_tolerance : float
        Standard deviation of the weight over the difference in depth [view units], above 0.
    reach : int
        Low pixels on each side, 1 to 8; 1 weighs like bilinear interpolation.

    Returns
    -------
    ndarray, shape (rows, columns), float32
        Where all low pixels about are far off in depth, the value of the one nearest in depth; NaN
        where `depth` is, or nothing is about.

    Raises
    ------
    InputError
        For arrays that do not fit each other and numbers out of range.

    References
    ----------
    J. Kopf et al., "Joint Bilateral Upsampling", SIGGRAPH 2007.

    Examples
    --------
    >>> depth = np.where(np.arange(8) < 3, 1.0, 9.0) * np.ones((8, 1))
    >>> low = depth[::2, ::2]
    >>> joint_bilateral_upsample(low > 5.0, low, depth, depth_tolerance=0.5)[3]
    array([0., 0., 0., 1., 1., 1., 1., 1.], dtype=float32)
    """
    v, low = _pair(values, low_depth, "low_depth")
    d = _plane("depth", depth)
    if isinstance(reach, bool) or not isinstance(reach, int) or not 1 <= reach <= 8:
        raise InputError("reach", "a whole number from 1 to 8", reach)
    sharp = math.sqrt(0.5) / _tolerance(depth_tolerance)
    out = np.empty_like(d)
    rows, columns = v.shape[0] / d.shape[0], v.shape[1] / d.shape[1]
    kernels.upsampled(
        v,
        low,
        d,
        rows,
        columns,
        0.5 * rows - 0.5,
        0.5 * columns - 0.5,
        np.float32(sharp),
        reach,
        out,
    )
    out[np.isnan(d)] = np.nan
    return out


def edge_leakage(
    before: ArrayLike,
    after: ArrayLike,
    depth: ArrayLike,
    *,
    depth_step: float,
    distance: int = 2,
) -> float:
    """Mean change that a filter makes beside edges of depth.

    Parameters
    ----------
    before, after, depth : array_like, shape (rows, columns)
        Values without noise, what the filter made of them, and depth [view units].
    depth_step : float
        What makes an edge: a larger difference in depth between neighbours [view units].
    distance : int
        Pixels on each side of an edge that count.

    Returns
    -------
    float
        Mean of |after - before| there; NaN where there is no edge.

    Examples
    --------
    >>> depth = np.where(np.arange(8) < 4, 1.0, 9.0) * np.ones((8, 1))
    >>> dark = (depth > 5.0).astype(float)
    >>> round(edge_leakage(dark, gaussian(dark), depth, depth_step=1.0), 3)
    0.177
    """
    a, d = _pair(before, depth)
    b = _plane("after", after)
    if b.shape != a.shape:
        raise InputError("after", f"of shape {a.shape}", b.shape)
    edge = np.zeros(d.shape, dtype=bool)
    for axis in (0, 1):
        jump = np.abs(np.diff(d, axis=axis)) > _tolerance(depth_step, "depth_step")
        low, high = [slice(None)] * 2, [slice(None)] * 2
        low[axis], high[axis] = slice(None, -1), slice(1, None)
        for k in range(distance):
            ahead, behind = [slice(None)] * 2, [slice(None)] * 2
            ahead[axis] = slice(k, None)
            behind[axis] = slice(None, d.shape[axis] - k)
            marks = np.zeros(d.shape, dtype=bool)
            marks[tuple(high)] = jump
            edge[tuple(ahead)] |= marks[tuple(behind)]
            marks = np.zeros(d.shape, dtype=bool)
            marks[tuple(low)] = jump
            edge[tuple(behind)] |= marks[tuple(ahead)]
    change = np.abs(b - a)[edge & np.isfinite(a) & np.isfinite(b)]
    return float(change.mean()) if change.size else math.nan


def _bell(radius: int, sigma: float | None) -> Layer:
    if isinstance(radius, bool) or not isinstance(radius, int) or not 1 <= radius <= MAX_RADIUS:
        raise InputError("radius", f"a whole number from 1 to {MAX_RADIUS}", radius)
    width = 0.5 * radius if sigma is None else sigma
    if not (isinstance(width, int | float) and 0.0 < width < math.inf):
        raise InputError("sigma", "a number above 0", sigma)
    line = np.exp(-0.5 * (np.arange(-radius, radius + 1) / width) ** 2)
    return np.asarray(line / line.sum(), dtype=np.float32)


def _two_passes(v: Layer, d: Layer, line: Layer, sharp: float, kind: int) -> Layer:
    radius = len(line) // 2
    along = [(0, j) for j in range(-radius, radius + 1)]
    down = [(i, 0) for i in range(-radius, radius + 1)]
    return _filtered(
        _filtered(v, d, along, line, 1.0 / sharp, kind), d, down, line, 1.0 / sharp, kind
    )


def _filtered(
    v: Layer,
    d: Layer,
    steps: list[tuple[int, int]],
    weights: Layer,
    tolerance: float,
    kind: int,
) -> Layer:
    rows, columns = (np.array(each, dtype=np.int64) for each in zip(*steps, strict=True))
    pad = int(max(np.abs(rows).max(), np.abs(columns).max()))
    out = np.empty_like(v)
    kernels.filtered(
        np.pad(v, pad, constant_values=np.nan),
        np.pad(d, pad, constant_values=np.nan),
        pad,
        rows,
        columns,
        np.ascontiguousarray(weights, dtype=np.float32),
        np.float32(1.0 / tolerance),
        kind,
        out,
    )
    return out


def _per_sample(
    result: Layer,
    v: Layer,
    d: Layer,
    samples: ArrayLike,
    line: Layer,
    sharp: float,
    tolerance: float,
) -> Layer:
    each = np.asarray(samples)
    if each.ndim != 3 or each.shape[1:] != v.shape or each.dtype.kind not in "iuf":
        raise InputError("samples", f"real, of shape (samples, {v.shape[0]}, {v.shape[1]})", each)
    with np.errstate(invalid="ignore"):
        known = np.where(np.isnan(each), d, each)
        edge = (known.max(axis=0) - known.min(axis=0) > tolerance) & ~np.isnan(v)
    edge |= np.isnan(each).any(axis=0) & ~np.isnan(v)
    rows, columns = np.nonzero(edge)
    kernels.filtered_at(
        rows,
        columns,
        v,
        d,
        np.ascontiguousarray(each[:, rows, columns], dtype=np.float32),
        len(line) // 2,
        np.outer(line, line),
        np.float32(sharp),
        result,
    )
    return result


def _plane(name: str, values: ArrayLike) -> Layer:
    array: NDArray[Any] = np.asarray(values)
    if array.dtype.kind not in "biuf" or array.ndim != 2 or not array.size:
        raise InputError(name, "real, of shape (rows, columns)", f"{array.dtype} {array.shape}")
    return np.ascontiguousarray(array, dtype=np.float32)


def _pair(values: ArrayLike, depth: ArrayLike, name: str = "depth") -> tuple[Layer, Layer]:
    v, d = _plane("values", values), _plane(name, depth)
    if v.shape != d.shape:
        raise InputError(name, f"of shape {v.shape}, as the values", d.shape)
    return v, np.where(np.isfinite(d), d, np.float32(np.nan))


def _tolerance(value: float, name: str = "depth_tolerance") -> float:
    if isinstance(value, bool) or not (isinstance(value, int | float) and 0.0 < value < math.inf):
        raise InputError(name, "a number above 0", value)
    return float(value)
