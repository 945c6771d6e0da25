"""The solid between four pixel centres, for the ray-traced reference (float64 throughout).

Nearness q is 1/z (perspective) or -z (orthographic): the surface is bilinear in it, and a straight
line of view space is a straight line in (column, row, q). So inside a cell surface minus ray is a
quadratic, whose root is the crossing. Arrays are padded by one pixel of NaN; cell (i, j) has the
pixel (i - 1, j - 1) at its upper left.

Solid is what lies behind the surface, by up to `thickness` in depth. A cell with a missing corner,
or whose depths differ by more than the thickness and the surface's own slope there, is broken: each
quarter has the depth of its corner. A receiver's own quarters are empty, as its tangent plane would
have it.
"""

import numpy as np

from adret._kernels.jit import kernel, parallel_kernel, prange

BISECTIONS = 50
BLOCK = 16


@kernel
def depth_of(perspective, q):
    """Depth of a nearness; infinite at and beyond the horizon."""
    if perspective:
        return 1.0 / q if q > 0.0 else np.inf
    return -q


@parallel_kernel
def cell_bounds(q, perspective, thickness, top, low):
    """Nearness between which a cell can be solid: float32, rounded outwards.

    A ray that stays at or above `top`, or at or below `low`, cannot hit it.
    """
    for i in prange(top.shape[0]):
        for j in range(top.shape[1]):
            nearest = -np.inf
            farthest = np.inf
            for k in range(4):
                value = q[i + k // 2, j + k % 2]
                if value > nearest:
                    nearest = value
                if value < farthest:
                    farthest = value
            if farthest < np.inf:
                farthest = nearness_behind(perspective, farthest, thickness)
            top[i, j] = np.nextafter(np.float32(nearest), np.float32(np.inf))
            low[i, j] = np.nextafter(np.float32(farthest), np.float32(-np.inf))


@kernel
def block_bounds(top, low, block_top, block_low):
    """Bounds of squares of `BLOCK` cells a side."""
    block_top[:] = -np.inf
    block_low[:] = np.inf
    for i in range(top.shape[0]):
        for j in range(top.shape[1]):
            block_top[i // BLOCK, j // BLOCK] = max(block_top[i // BLOCK, j // BLOCK], top[i, j])
            block_low[i // BLOCK, j // BLOCK] = min(block_low[i // BLOCK, j // BLOCK], low[i, j])


@kernel
def nearness_behind(perspective, q, thickness):
    """Nearness of what lies `thickness` behind a point; -inf for an endless solid."""
    if thickness == np.inf:
        return -np.inf
    depth = depth_of(perspective, q) + thickness
    return 1.0 / depth if perspective else -depth


@kernel
def slope_along(perspective, a, b, c, d, e):
    """Change of depth a pixel along the surface at c, of five pixels in a line.

    The smaller one of the changes to both sides; 0 if these have two signs. If one side is missing,
    the other one is held against the plane through the two pixels there.
    """
    depth = depth_of(perspective, c)
    if b == b and d == d:
        one = depth - depth_of(perspective, b)
        two = depth_of(perspective, d) - depth
    elif d == d and e == e:
        one = depth_of(perspective, d) - depth
        two = depth_of(perspective, d) - depth_of(perspective, d + (d - e))
    elif b == b and a == a:
        one = depth_of(perspective, b) - depth
        two = depth_of(perspective, b) - depth_of(perspective, b + (b - a))
    else:
        return 0.0
    if one > 0.0 and two > 0.0:
        return min(one, two)
    if one < 0.0 and two < 0.0:
        return -max(one, two)
    return 0.0


@parallel_kernel
def cell_slopes(q, perspective, slopes):
    """The surface's change of depth a pixel, both axes together, at each cell's steepest corner.

    The same size as the cells of `q`, which has one pixel of NaN around.
    """
    rows, columns = q.shape
    at = np.zeros((rows, columns))
    for i in prange(1, rows - 1):
        for j in range(1, columns - 1):
            if q[i, j] == q[i, j]:
                left = q[i, j - 2] if j > 1 else np.nan
                right = q[i, j + 2] if j < columns - 2 else np.nan
                up = q[i - 2, j] if i > 1 else np.nan
                down = q[i + 2, j] if i < rows - 2 else np.nan
                own = q[i, j]
                at[i, j] = slope_along(perspective, left, q[i, j - 1], own, q[i, j + 1], right)
                at[i, j] += slope_along(perspective, up, q[i - 1, j], own, q[i + 1, j], down)
    for i in prange(slopes.shape[0]):
        for j in range(slopes.shape[1]):
            slopes[i, j] = max(max(at[i, j], at[i, j + 1]), max(at[i + 1, j], at[i + 1, j + 1]))


@kernel
def is_broken(q00, q01, q10, q11, slope, perspective, thickness):
    """Whether a cell has a missing corner or a step beyond the surface's slope."""
    total = q00 + q01 + q10 + q11
    if total != total:
        return True
    if thickness == np.inf:
        return False
    near = depth_of(perspective, max(max(q00, q01), max(q10, q11)))
    far = depth_of(perspective, min(min(q00, q01), min(q10, q11)))
    return far - near > thickness + slope


@kernel
def enter_patch(q00, q01, q10, q11, ua, va, ub, vb, fa, qa, qb, perspective, thickness):
    """Where between 0 and 1 a ray comes into the solid of an unbroken cell; -1 if it does not.

    The ray goes from (ua, va, qa) to (ub, vb, qb); `fa` is surface minus ray at its start.
    """
    twist = q00 - q01 - q10 + q11
    fb = q00 + ub * (q01 - q00) + vb * (q10 - q00) + ub * vb * twist - qb
    e = twist * (ub - ua) * (vb - va)
    b = fb - fa - e
    if fa <= 0.0:
        # The root of fa + b τ + e τ² at which it turns positive.
        square = b * b - 4.0 * e * fa
        if not square > 0.0:
            return -1.0
        root = np.sqrt(square)
        tau = -2.0 * fa / (b + root) if b >= 0.0 else (root - b) / (2.0 * e)
        return tau if 0.0 <= tau <= 1.0 else -1.0
    if thickness == np.inf:
        return 0.0
    # Behind the front: inside, or behind the back as well.
    low = 0.0
    high = -1.0
    for k in range(5):
        tau = 0.25 * k
        q = qa + tau * (qb - qa)
        surface = q + fa + tau * (b + e * tau)
        if depth_of(perspective, surface) + thickness > depth_of(perspective, q):
            high = tau
            break
        low = tau
    if high <= 0.0:
        return high
    for _ in range(BISECTIONS):
        tau = 0.5 * (low + high)
        q = qa + tau * (qb - qa)
        surface = q + fa + tau * (b + e * tau)
        if depth_of(perspective, surface) + thickness > depth_of(perspective, q):
            high = tau
        else:
            low = tau
    return high


@kernel
def enter_quarters(q00, q01, q10, q11, own, ua, va, ub, vb, qa, qb, perspective, thickness):
    """As `enter_patch`, for a broken cell; `own` is the receiver's corner, -1 for none."""
    across = (0.5 - ua) / (ub - ua) if ub != ua else np.inf
    down = (0.5 - va) / (vb - va) if vb != va else np.inf
    first = min(across, down)
    second = max(across, down)
    start = 0.0
    for k in range(3):
        stop = 1.0
        if k == 0:
            stop = first
        elif k == 1:
            stop = second
        stop = min(stop, 1.0)
        if not stop > start:
            continue
        middle = 0.5 * (start + stop)
        lower = va + middle * (vb - va) > 0.5
        right = ua + middle * (ub - ua) > 0.5
        corner = 2 * lower + right
        front = q00
        if corner == 1:
            front = q01
        elif corner == 2:
            front = q10
        elif corner == 3:
            front = q11
        if front == front and corner != own:
            back = nearness_behind(perspective, front, thickness)
            q = qa + start * (qb - qa)
            last = qa + stop * (qb - qa)
            if back < q < front:
                return start
            if q >= front > last:
                return min(max((front - qa) / (qb - qa), start), stop)
            if q <= back < last:
                return min(max((back - qa) / (qb - qa), start), stop)
        start = stop
    return -1.0
