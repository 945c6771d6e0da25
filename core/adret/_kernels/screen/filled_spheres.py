"""Solid share of spheres at the points that a depth image shows (the reference for volumes).

The solid is that of `depth_cells`: same arrays, same broken cells.
"""

import numpy as np

from adret._kernels.jit import kernel, parallel_kernel, prange
from adret._kernels.screen.depth_cells import depth_of, is_broken
from adret._kernels.screen.noise import uniform
from adret._kernels.screen.raytraced import tangents

BALL = 0
SURFACE = 1
HEMISPHERE = 2


@kernel
def contains(q, slopes, perspective, thickness, row, column, nearness, own_row, own_column):
    """Whether a point of the image's space is solid; row and column in the padded array."""
    i = np.int64(np.floor(row))
    j = np.int64(np.floor(column))
    v = row - i
    u = column - j
    q00 = q[i, j]
    q01 = q[i, j + 1]
    q10 = q[i + 1, j]
    q11 = q[i + 1, j + 1]
    if is_broken(q00, q01, q10, q11, slopes[i, j], perspective, thickness):
        i += v > 0.5
        j += u > 0.5
        if i == own_row and j == own_column:
            return False
        surface = q[i, j]
    else:
        surface = q00 + u * (q01 - q00) + v * (q10 - q00) + u * v * (q00 - q01 - q10 + q11)
    if not surface > nearness:
        return False
    return depth_of(perspective, nearness) < depth_of(perspective, surface) + thickness


@parallel_kernel
def fill_spheres(
    q,
    slopes,
    second,
    second_slopes,
    normal,
    rays,
    perspective,
    thickness,
    origin,
    rows,
    columns,
    strata,
    domain,
    lift,
    radius,
    seed,
    halves,
    decided,
):
    """Solid share of a sphere at the listed pixels, by stratified points, in two halves.

    The sphere of `radius` has its centre `lift` above the surface. Each half draws one point in
    each of strata³ cells of equal volume; or, for the sphere's surface (SURFACE), of strata² of
    equal area; or, in the hemisphere (HEMISPHERE) about the normal, directions by the cosine and
    distances by their cube.
    """
    shells = 1 if domain == SURFACE else strata
    points = shells * strata**2
    ax, bx, ay, by = rays
    for n in prange(len(rows)):
        row = rows[n]
        column = columns[n]
        z0 = depth_of(perspective, q[row + 1, column + 1])
        spread = z0 if perspective else 1.0
        nx = np.float64(normal[0, row, column])
        ny = np.float64(normal[1, row, column])
        nz = np.float64(normal[2, row, column])
        tx, ty, tz, sx, sy, sz = 1.0, 0.0, 0.0, 0.0, 1.0, 0.0
        ux, uy, uz = 0.0, 0.0, 1.0
        if domain == HEMISPHERE:
            tx, ty, tz, sx, sy, sz = tangents(nx, ny, nz)
            ux, uy, uz = nx, ny, nz
        cx = spread * (ax * column + bx) + lift * nx
        cy = spread * (ay * row + by) + lift * ny
        cz = -z0 + lift * nz
        known = 0
        for half in range(2):
            total = 0
            for k in range(points):
                draw = 3 * (half * points + k)
                grow, gcolumn = row + origin[0], column + origin[1]
                d = (k // strata**2 + uniform(grow, gcolumn, seed, draw)) / shells
                u = (k // strata % strata + uniform(grow, gcolumn, seed, draw + 1)) / strata
                v = (k % strata + uniform(grow, gcolumn, seed, draw + 2)) / strata
                d = radius if domain == SURFACE else radius * d ** (1.0 / 3.0)
                up = np.sqrt(1.0 - u) if domain == HEMISPHERE else 1.0 - 2.0 * u
                out = d * np.sqrt(max(0.0, 1.0 - up * up))
                up *= d
                p = out * np.cos(2.0 * np.pi * v)
                w = out * np.sin(2.0 * np.pi * v)
                depth = -(cz + p * tz + w * sz + up * uz)
                if perspective and depth <= 0.0:
                    continue
                spread = depth if perspective else 1.0
                c = ((cx + p * tx + w * sx + up * ux) / spread - bx) / ax
                r = ((cy + p * ty + w * sy + up * uy) / spread - by) / ay
                if not (0.0 <= c <= q.shape[1] - 3.0 and 0.0 <= r <= q.shape[0] - 3.0):
                    continue
                known += 1
                nearness = 1.0 / depth if perspective else -depth
                solid = contains(
                    q,
                    slopes,
                    perspective,
                    thickness,
                    r + 1.0,
                    c + 1.0,
                    nearness,
                    row + 1,
                    column + 1,
                )
                if not solid and len(second) > 0:
                    solid = contains(
                        second,
                        second_slopes,
                        perspective,
                        thickness,
                        r + 1.0,
                        c + 1.0,
                        nearness,
                        -1,
                        -1,
                    )
                total += solid
            halves[half, n] = total / points
        decided[n] = known / (2.0 * points)
