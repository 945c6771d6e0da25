"""Rays through a depth image, each followed cell by cell (the reference; float64 throughout).

A cell lies between four pixel centres. Nearness q is 1/z (perspective) or -z (orthographic): the
surface is bilinear in it, and a straight line of view space is a straight line in (column, row, q).
So inside a cell surface minus ray is a quadratic, whose root is the crossing. Arrays are padded by
one pixel of NaN; cell (i, j) has the pixel (i - 1, j - 1) at its upper left.

Solid is what lies behind the surface, by up to `thickness` in depth. A cell with a missing corner,
or whose depths differ by more than the thickness, is broken: each quarter has the depth of its
corner. A receiver's own quarters are empty, as its tangent plane would have it.
"""

import numpy as np

from adret._kernels.jit import kernel, parallel_kernel, prange
from adret._kernels.screen.falloffs import weight
from adret._kernels.screen.noise import uniform

BISECTIONS = 50


@parallel_kernel
def highest_corners(q, top):
    """Largest nearness among a cell's corners; -inf where all are missing."""
    for i in prange(top.shape[0]):
        for j in range(top.shape[1]):
            largest = -np.inf
            for k in range(4):
                value = q[i + k // 2, j + k % 2]
                if value > largest:
                    largest = value
            top[i, j] = largest


@kernel
def depth_of(perspective, q):
    """Depth of a nearness; infinite at and beyond the horizon."""
    if perspective:
        return 1.0 / q if q > 0.0 else np.inf
    return -q


@kernel
def is_broken(q00, q01, q10, q11, perspective, thickness):
    """Whether a cell has a missing corner or a step."""
    total = q00 + q01 + q10 + q11
    if total != total:
        return True
    if thickness == np.inf:
        return False
    near = depth_of(perspective, max(max(q00, q01), max(q10, q11)))
    far = depth_of(perspective, min(min(q00, q01), min(q10, q11)))
    return far - near > thickness


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
            back = -np.inf
            if thickness != np.inf:
                depth = depth_of(perspective, front) + thickness
                back = 1.0 / depth if perspective else -depth
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


@kernel
def first_hit(q, top, highest, perspective, thickness, row, column, q0, dc, dr, dq, stop):
    """Parameter s at which a ray enters the solid; -1 if it ends before, -2 if it leaves the image.

    The ray is (column + dc s, row + dr s, q0 + dq s), 0 <= s <= stop, from a pixel's centre, row
    and column counted in the padded array.
    """
    owned = q[row, column] == q0
    leave = np.inf
    if dc > 0.0:
        leave = (q.shape[1] - 2 - column) / dc
    elif dc < 0.0:
        leave = (1 - column) / dc
    if dr > 0.0:
        leave = min(leave, (q.shape[0] - 2 - row) / dr)
    elif dr < 0.0:
        leave = min(leave, (1 - row) / dr)
    missed = -1.0 if stop <= leave else -2.0
    end = min(stop, leave)
    if dq > 0.0:  # above the nearest point of the image nothing is hit
        end = min(end, (highest - q0) / dq)
    right = dc > 0.0
    below = dr > 0.0
    j = column if right else column - 1
    i = row if below else row - 1
    across = 1.0 / abs(dc) if dc != 0.0 else np.inf
    down = 1.0 / abs(dr) if dr != 0.0 else np.inf
    columns_crossed = 1
    rows_crossed = 1
    at = 0.0
    qa = q0
    while True:
        next_column = columns_crossed * across
        next_row = rows_crossed * down
        to = min(min(next_column, next_row), end)
        qb = q0 + dq * to
        if top[i, j] > min(qa, qb):
            q00 = q[i, j]
            q01 = q[i, j + 1]
            q10 = q[i + 1, j]
            q11 = q[i + 1, j + 1]
            ua = column + dc * at - j
            va = row + dr * at - i
            ub = column + dc * to - j
            vb = row + dr * to - i
            if is_broken(q00, q01, q10, q11, perspective, thickness):
                own = -1
                if owned and row - 1 <= i <= row and column - 1 <= j <= column:
                    own = 2 * (row - i) + (column - j)
                tau = enter_quarters(
                    q00, q01, q10, q11, own, ua, va, ub, vb, qa, qb, perspective, thickness
                )
            else:
                fa = 0.0
                if at > 0.0 or not owned:
                    twist = q00 - q01 - q10 + q11
                    fa = q00 + ua * (q01 - q00) + va * (q10 - q00) + ua * va * twist - qa
                tau = enter_patch(
                    q00, q01, q10, q11, ua, va, ub, vb, fa, qa, qb, perspective, thickness
                )
            if tau >= 0.0:
                return at + tau * (to - at)
        if to >= end:
            return missed
        if next_column <= next_row:
            columns_crossed += 1
            j += 1 if right else -1
        if next_row <= next_column:
            rows_crossed += 1
            i += 1 if below else -1
        at = to
        qa = qb


@kernel
def tangents(nx, ny, nz):
    """Two unit vectors that make a right-handed frame with a unit vector (Duff et al. 2017)."""
    sign = 1.0 if nz >= 0.0 else -1.0
    a = -1.0 / (sign + nz)
    b = nx * ny * a
    return 1.0 + sign * nx * nx * a, sign * b, -sign * nx, b, sign + ny * ny * a, -ny


@kernel
def ray_of(perspective, rays, row, column, z0, wx, wy, wz, radius):
    """Direction (dc, dr, dq) in the image of a view-space direction, and s at the radius.

    With s = t/z(t) (perspective; s = t otherwise) the image of a straight line is run through at
    constant speed; s of what is infinitely far is 1/-wz.
    """
    ax, bx, ay, by = rays
    if not perspective:
        return wx / ax, wy / ay, wz, radius
    x = ax * column + bx
    y = ay * row + by
    stop = np.inf
    if radius == np.inf:
        if wz < 0.0:
            stop = -1.0 / wz
    elif z0 - radius * wz > 0.0:
        stop = radius / (z0 - radius * wz)
    return (wx + x * wz) / ax, (wy + y * wz) / ay, wz / z0, stop


@parallel_kernel
def trace(
    q,
    second,
    top,
    top2,
    highest,
    normal,
    rays,
    perspective,
    thickness,
    origin,
    rows,
    columns,
    strata,
    around,
    cosine,
    code,
    radius,
    scale,
    table,
    seed,
    halves,
    decided,
    bent,
):
    """Occlusion of the listed pixels by stratified rays, in two independent halves.

    Each half draws one ray in each of strata x around equal cells of the unit square; `decided`
    gets the (weighted) share of rays that did not leave the image; `bent` the open directions'
    sum. `second` is empty where there is one layer.
    """
    for n in prange(len(rows)):
        row = rows[n]
        column = columns[n]
        q0 = q[row + 1, column + 1]
        z0 = depth_of(perspective, q0)
        nx = np.float64(normal[0, row, column])
        ny = np.float64(normal[1, row, column])
        nz = np.float64(normal[2, row, column])
        tx, ty, tz, sx, sy, sz = tangents(nx, ny, nz)
        known = 0
        open_x = 0.0
        open_y = 0.0
        open_z = 0.0
        for half in range(2):
            total = 0.0
            for k in range(strata * around):
                draw = 2 * (half * strata * around + k)
                grow, gcolumn = row + origin[0], column + origin[1]
                u = (k // around + uniform(grow, gcolumn, seed, draw)) / strata
                v = (k % around + uniform(grow, gcolumn, seed, draw + 1)) / around
                up = np.sqrt(1.0 - u) if cosine else 1.0 - u
                out = np.sqrt(max(0.0, 1.0 - up * up))
                a = out * np.cos(2.0 * np.pi * v)
                b = out * np.sin(2.0 * np.pi * v)
                wx = a * tx + b * sx + up * nx
                wy = a * ty + b * sy + up * ny
                wz = a * tz + b * sz + up * nz
                dc, dr, dq, stop = ray_of(perspective, rays, row, column, z0, wx, wy, wz, radius)
                s = first_hit(
                    q,
                    top,
                    highest,
                    perspective,
                    thickness,
                    row + 1,
                    column + 1,
                    q0,
                    dc,
                    dr,
                    dq,
                    stop,
                )
                if len(second) > 0 and thickness != np.inf:
                    limit = s if s >= 0.0 else stop
                    behind = first_hit(
                        second,
                        top2,
                        highest,
                        perspective,
                        thickness,
                        row + 1,
                        column + 1,
                        q0,
                        dc,
                        dr,
                        dq,
                        limit,
                    )
                    if behind >= 0.0:
                        s = behind
                w = 0.0
                if s >= 0.0:
                    d = s * z0 / (1.0 + s * wz) if perspective else s
                    w = weight(code, radius, scale, table, d)
                if s != -2.0:
                    known += 1
                total += w
                open_x += (1.0 - w) * wx
                open_y += (1.0 - w) * wy
                open_z += (1.0 - w) * wz
            halves[half, n] = total / (strata * around)
        decided[n] = known / (2.0 * strata * around)
        length = np.sqrt(open_x * open_x + open_y * open_y + open_z * open_z)
        unit = 1.0 / length if length > 0.0 else np.nan
        bent[0, n] = open_x * unit
        bent[1, n] = open_y * unit
        bent[2, n] = open_z * unit
