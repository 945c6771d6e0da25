"""Rays through a depth image in equal steps: what horizons stand for."""

import numpy as np

from adret._kernels.jit import kernel, parallel_kernel, prange
from adret._kernels.screen.containment import tangents
from adret._kernels.screen.falloffs import weight
from adret._kernels.screen.noise import uniform
from adret._kernels.screen.surface import behind, inside, spread, surface_at

ANGLE = 0  # counters of the noise
STEP = 1
GOLDEN = 0.6180339887498949


@kernel
def march_row(
    row,
    nearness,
    depth,
    normal,
    rays,
    perspective,
    frame,
    origin,
    seed,
    jitter,
    directions,
    per_direction,
    steps,
    code,
    radius,
    scale,
    table,
    occlusion,
    confidence,
):
    """One row of `marched_rays`."""
    ax, bx, ay, by = rays[0], rays[1], rays[2], rays[3]
    column0, column1 = frame[2], frame[3]
    turn = 2.0 * np.pi / directions
    radius2 = radius * radius
    for column in range(column0, column1):
        total = np.nan
        decided = 0
        z = np.float64(depth[row, column])
        if z == z:
            total = 0.0
            x = spread(perspective, z) * (ax * column + bx)
            y = spread(perspective, z) * (ay * row + by)
            n = (normal[0, row, column], normal[1, row, column], normal[2, row, column])
            first, second = tangents(n[0], n[1], n[2])
            for k in range(directions):
                a, b = 0.5, 0.5
                if jitter:
                    a = uniform(row + origin[0], column + origin[1], seed, 2 * k + ANGLE)
                    b = uniform(row + origin[0], column + origin[1], seed, 2 * k + STEP)
                cosine, sine = np.cos(turn * (k + a)), np.sin(turn * (k + a))
                for j in range(per_direction):
                    # Fractions shifted from ray to ray by the golden ratio.
                    fraction = b + GOLDEN * j
                    fraction -= np.floor(fraction)
                    up_normal = (j + fraction) / per_direction
                    across = np.sqrt(1.0 - up_normal * up_normal)
                    u, v = across * cosine, across * sine
                    right = u * first[0] + v * second[0] + up_normal * n[0]
                    up = u * first[1] + v * second[1] + up_normal * n[1]
                    back = u * first[2] + v * second[2] + up_normal * n[2]
                    left_image = False
                    for i in range(steps):
                        t = radius * (i + (fraction if jitter else 1.0)) / steps
                        depth_there = z - t * back
                        if not (depth_there > 0.0 or not perspective):
                            left_image = True
                            break
                        grow = spread(perspective, depth_there)
                        i_column = ((x + t * right) / grow - bx) / ax
                        i_row = ((y + t * up) / grow - by) / ay
                        if not inside(nearness, i_row, i_column):
                            left_image = True
                            break
                        surface = surface_at(nearness, i_row, i_column)
                        if behind(perspective, depth_there, surface):
                            z_hit = 1.0 / surface if perspective else -surface
                            grow = spread(perspective, z_hit)
                            d_right = grow * (ax * i_column + bx) - x
                            d_up = grow * (ay * i_row + by) - y
                            d_back = z - z_hit
                            d2 = d_right * d_right + d_up * d_up + d_back * d_back
                            if d2 <= radius2:
                                total += weight(code, radius, scale, table, np.sqrt(d2))
                                break
                    decided += not left_image
            total /= directions * per_direction
        occlusion[column - column0] = total
        confidence[column - column0] = decided / (directions * per_direction)


@parallel_kernel
def marched_rays(
    nearness,
    depth,
    normal,
    rays,
    perspective,
    frame,
    origin,
    seed,
    jitter,
    directions,
    per_direction,
    steps,
    code,
    radius,
    scale,
    table,
    occlusion,
    confidence,
):
    """Mean weight of the first samples along 3D rays that lie behind the surface.

    Rays are uniform over the hemisphere: `directions` azimuths round the normal, `per_direction`
    elevations of equally spaced sines. A ray takes `steps` equal steps to the distance `radius`.
    """
    for row in prange(frame[0], frame[1]):
        march_row(
            row,
            nearness,
            depth,
            normal,
            rays,
            perspective,
            frame,
            origin,
            seed,
            jitter,
            directions,
            per_direction,
            steps,
            code,
            radius,
            scale,
            table,
            occlusion[row - frame[0]],
            confidence[row - frame[0]],
        )
