"""Horizon-based ambient occlusion, and the ray march that it stands for.

`draws` are cosine and sine of an angle and a fraction of a step for each pixel.
"""

import numpy as np

from adret._kernels.jit import index, inline, kernel, parallel_kernel, prange
from adret._kernels.screen.containment import tangents
from adret._kernels.screen.falloffs import weight
from adret._kernels.screen.noise import uniform
from adret._kernels.screen.surface import behind, inside, spread, surface_at

ANGLE = 0  # counters of the noise
STEP = 1
SHIFT = 1 << 20  # pixels; makes places positive, so that the conversion rounds down


@inline
def tangent_sine(right, up, n_right, n_up, n_back, cos_bias, sin_bias):
    """Sine of the surface's own elevation towards (right, up), raised by the angle bias."""
    fall = -(n_right * right + n_up * up)
    run = n_back * np.sqrt(right * right + up * up)
    long = np.sqrt(run * run + fall * fall)
    sine = 1.0
    if long > 0.0:
        raised = run * cos_bias - fall * sin_bias  # cosine of the raised elevation
        sine = (fall * cos_bias + run * sin_bias) / long if raised > 0.0 else 1.0
    return sine


@inline
def rounded(place):
    """Nearest whole number of a place on the image or beside it."""
    return np.int64(place + (0.5 + SHIFT)) - SHIFT


@kernel
def horizons_of_row(
    row,
    depth,
    normal,
    rays,
    perspective,
    frame,
    origin,
    seed,
    jitter,
    directions,
    steps,
    spacing,
    per_sample,
    bias,
    code,
    radius,
    scale,
    table,
    occlusion,
    confidence,
):
    """One row of `horizons`."""
    ax, bx, ay, by = rays[0], rays[1], rays[2], rays[3]
    column0, column1 = frame[2], frame[3]
    rows, columns = depth.shape
    turn = 2.0 * np.pi / directions
    cosines = np.cos(turn * np.arange(directions))
    sines = np.sin(turn * np.arange(directions))
    diagonal = np.hypot(rows * ay, columns * ax)
    cos_bias, sin_bias = np.cos(bias), np.sin(bias)
    radius2 = radius * radius
    for column in range(column0, column1):
        total = np.nan
        seen = 0
        taken = 0
        z = np.float64(depth[row, column])
        if z == z:
            total = 0.0
            grow = spread(perspective, z)
            x = grow * (ax * column + bx)
            y = grow * (ay * row + by)
            n_right = np.float64(normal[0, row, column])
            n_up = np.float64(normal[1, row, column])
            n_back = max(np.float64(normal[2, row, column]), 1e-4)
            # Half axes of the projected radius [pixels]; the image bounds what can be met.
            reach = min(radius, diagonal * grow)
            wide = reach / (grow * ax)
            high = reach / (grow * -ay)
            long = max(wide, high)
            count = np.int64(long / spacing) if spacing > 0.0 else min(steps, np.int64(long))
            first_cosine, first_sine, shift = 1.0, 0.0, 0.0
            if jitter:
                angle = turn * uniform(row + origin[0], column + origin[1], seed, ANGLE)
                first_cosine, first_sine = np.cos(angle), np.sin(angle)
                shift = uniform(row + origin[0], column + origin[1], seed, STEP)
            for k in range(directions):
                if count == 0:
                    break
                cosine = cosines[k] * first_cosine - sines[k] * first_sine
                sine = sines[k] * first_cosine + cosines[k] * first_sine
                step_columns = cosine * wide / (count + 1)
                step_rows = sine * high / (count + 1)
                top = -2.0  # sine of the highest elevation so far, squared with its sign
                ground = 0.0  # by how much it stands above the surface's own
                sine_tangent = -2.0
                taken += count
                for i in range(1, count + 1):
                    i_row = rounded(row + (i + shift) * step_rows)
                    i_column = rounded(column + (i + shift) * step_columns)
                    if i_row < 0 or i_column < 0 or i_row >= rows or i_column >= columns:
                        break
                    seen += 1
                    if i_row == row and i_column == column:
                        continue
                    z_there = np.float64(depth[index(i_row), index(i_column)])
                    grow_there = spread(perspective, z_there)
                    right = grow_there * (ax * i_column + bx) - x
                    up = grow_there * (ay * i_row + by) - y
                    rise = z - z_there
                    distance2 = right * right + up * up + rise * rise
                    # False for NaN; no root and no quotient before they are needed.
                    if distance2 <= radius2 and rise * abs(rise) > top * distance2:
                        distance = np.sqrt(distance2)
                        elevation = rise / distance
                        if per_sample or sine_tangent == -2.0:
                            sine_tangent = tangent_sine(
                                right, up, n_right, n_up, n_back, cos_bias, sin_bias
                            )
                        above = elevation - sine_tangent
                        if top > -2.0 or above > 0.0:
                            w = weight(code, radius, scale, table, distance)
                            total += w * (above - ground)
                            top = elevation * abs(elevation)
                            ground = above
            total /= directions
        occlusion[column - column0] = total
        confidence[column - column0] = seen / taken if taken > 0 else 1.0


@parallel_kernel
def horizons(
    depth,
    normal,
    rays,
    perspective,
    frame,
    origin,
    seed,
    jitter,
    directions,
    steps,
    spacing,
    per_sample,
    bias,
    code,
    radius,
    scale,
    table,
    occlusion,
    confidence,
):
    """Equation 9 with `steps` samples a direction, or one every `spacing` pixels where above 0.

    Samples are pixels; a direction of less than one pixel a step gets fewer steps. `per_sample`
    false grounds all samples of a direction on one tangent, equation 8.
    """
    for row in prange(frame[0], frame[1]):
        horizons_of_row(
            row,
            depth,
            normal,
            rays,
            perspective,
            frame,
            origin,
            seed,
            jitter,
            directions,
            steps,
            spacing,
            per_sample,
            bias,
            code,
            radius,
            scale,
            table,
            occlusion[row - frame[0]],
            confidence[row - frame[0]],
        )


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
                    fraction = b + 0.6180339887498949 * j
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
