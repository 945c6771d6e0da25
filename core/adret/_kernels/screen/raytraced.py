"""Rays through a depth image, each followed cell by cell (the reference; float64 throughout)."""

import numpy as np

from adret._kernels.jit import kernel, parallel_kernel, prange
from adret._kernels.screen.depth_cells import (
    BLOCK,
    depth_of,
    enter_patch,
    enter_quarters,
    is_broken,
)
from adret._kernels.screen.falloffs import weight
from adret._kernels.screen.noise import uniform


@kernel
def hit_in_cell(
    q, slopes, i, j, perspective, thickness, row, column, owned, dc, dr, at, to, qa, qb
):
    """Share of the way from s = at to s = to at which a ray comes into the solid of cell (i, j).

    -1 if it does not. `owned` says whether the ray starts on this surface.
    """
    q00 = q[i, j]
    q01 = q[i, j + 1]
    q10 = q[i + 1, j]
    q11 = q[i + 1, j + 1]
    ua = column + dc * at - j
    va = row + dr * at - i
    ub = column + dc * to - j
    vb = row + dr * to - i
    if is_broken(q00, q01, q10, q11, slopes[i, j], perspective, thickness):
        own = -1
        if owned and row - 1 <= i <= row and column - 1 <= j <= column:
            own = 2 * (row - i) + (column - j)
        return enter_quarters(
            q00, q01, q10, q11, own, ua, va, ub, vb, qa, qb, perspective, thickness
        )
    fa = 0.0
    if at > 0.0 or not owned:
        twist = q00 - q01 - q10 + q11
        fa = q00 + ua * (q01 - q00) + va * (q10 - q00) + ua * va * twist - qa
    return enter_patch(q00, q01, q10, q11, ua, va, ub, vb, fa, qa, qb, perspective, thickness)


@kernel
def first_hit(q, bounds, perspective, thickness, row, column, q0, dc, dr, dq, stop):
    """Parameter s at which a ray enters the solid; -1 if it ends before, -2 if it leaves the image.

    The ray is (column + dc s, row + dr s, q0 + dq s), 0 <= s <= stop, from a pixel's centre, row
    and column counted in the padded array. `bounds` are those of cells and of blocks of cells, and
    the surface's slopes in cells.
    """
    top, low, block_top, block_low, highest, lowest, slopes = bounds
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
    elif dq < 0.0:  # nor behind the farthest one's back
        end = min(end, (lowest - q0) / dq)
    owned = q[row, column] == q0
    right = dc > 0.0
    below = dr > 0.0
    j = column if right else column - 1
    i = row if below else row - 1
    across = 1.0 / abs(dc) if dc != 0.0 else np.inf
    down = 1.0 / abs(dr) if dr != 0.0 else np.inf
    # The k-th line between columns is crossed at k across, the k-th between rows at k down.
    k = 1
    m = 1
    at = 0.0
    qa = q0
    # A line may be crossed by rounding before the image is left along it: nothing lies beyond.
    while 1 <= i <= q.shape[0] - 3 and 1 <= j <= q.shape[1] - 3:
        inner_j = j % BLOCK
        inner_i = i % BLOCK
        k_out = k + (BLOCK - 1 - inner_j if right else inner_j)
        m_out = m + (BLOCK - 1 - inner_i if below else inner_i)
        to = min(min(k_out * across, m_out * down), end)
        qb = q0 + dq * to
        block_i = i // BLOCK
        block_j = j // BLOCK
        if min(qa, qb) < block_top[block_i, block_j] and max(qa, qb) > block_low[block_i, block_j]:
            while i // BLOCK == block_i and j // BLOCK == block_j:
                next_column = k * across
                next_row = m * down
                to = min(min(next_column, next_row), end)
                qb = q0 + dq * to
                if min(qa, qb) < top[i, j] and max(qa, qb) > low[i, j]:
                    tau = hit_in_cell(
                        q, slopes, i, j, perspective, thickness, row, column, owned, dc, dr, at, to,
                        qa, qb,
                    )  # fmt: skip
                    if tau >= 0.0:
                        return at + tau * (to - at)
                if to >= end:
                    return missed
                if next_column <= next_row:
                    k += 1
                    j += 1 if right else -1
                if next_row <= next_column:
                    m += 1
                    i += 1 if below else -1
                at = to
                qa = qb
                if not (1 <= i <= q.shape[0] - 3 and 1 <= j <= q.shape[1] - 3):
                    return missed
            continue
        if to >= end:
            return missed
        # On to the block's border: count the lines crossed up to there.
        past = max(k, np.int64(to * abs(dc)))
        while past * across <= to:
            past += 1
        j += past - k if right else k - past
        k = past
        past = max(m, np.int64(to * abs(dr)))
        while past * down <= to:
            past += 1
        i += past - m if below else m - past
        m = past
        at = to
        qa = qb
    return missed


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
    bounds,
    second,
    second_bounds,
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
    codes,
    radii,
    scales,
    tables,
    seed,
    halves,
    decided,
    bent,
):
    """Occlusion of the listed pixels by stratified rays, in two independent halves.

    Each half draws one ray in each of strata x around equal cells of the unit square. Rays end at
    the largest of the radii; `halves` has one layer a falloff. `decided` gets the share of rays
    that did not leave the image, `bent` the sum of open directions by the first falloff. `second`
    is empty where there is one layer of depth.
    """
    reach = radii.max()
    for n in prange(len(rows)):
        row = rows[n]
        column = columns[n]
        grow = row + origin[0]
        gcolumn = column + origin[1]
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
            for k in range(strata * around):
                draw = 2 * (half * strata * around + k)
                u = (k // around + uniform(grow, gcolumn, seed, draw)) / strata
                v = (k % around + uniform(grow, gcolumn, seed, draw + 1)) / around
                up = np.sqrt(1.0 - u) if cosine else 1.0 - u
                out = np.sqrt(max(0.0, 1.0 - up * up))
                a = out * np.cos(2.0 * np.pi * v)
                b = out * np.sin(2.0 * np.pi * v)
                wx = a * tx + b * sx + up * nx
                wy = a * ty + b * sy + up * ny
                wz = a * tz + b * sz + up * nz
                dc, dr, dq, stop = ray_of(perspective, rays, row, column, z0, wx, wy, wz, reach)
                s = first_hit(
                    q, bounds, perspective, thickness, row + 1, column + 1, q0, dc, dr, dq, stop
                )
                if len(second) > 0 and thickness != np.inf:
                    limit = s if s >= 0.0 else stop
                    behind = first_hit(
                        second,
                        second_bounds,
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
                known += s != -2.0
                free = 1.0
                if s >= 0.0:
                    d = s * z0 / (1.0 + s * wz) if perspective else s
                    for f in range(len(codes)):
                        w = weight(codes[f], radii[f], scales[f], tables[f], d)
                        halves[f, half, n] += w
                        if f == 0:
                            free = 1.0 - w
                open_x += free * wx
                open_y += free * wy
                open_z += free * wz
        halves[:, :, n] /= strata * around
        decided[n] = known / (2.0 * strata * around)
        length = np.sqrt(open_x * open_x + open_y * open_y + open_z * open_z)
        unit = 1.0 / length if length > 0.0 else np.nan
        bent[0, n] = open_x * unit
        bent[1, n] = open_y * unit
        bent[2, n] = open_z * unit
