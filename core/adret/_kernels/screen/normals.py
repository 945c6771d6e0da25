"""Normals from depth: on each axis the slope towards the side that is the straighter one."""

import numpy as np

from adret._kernels.jit import inline, parallel_kernel, prange


@inline
def side_slope(before2, before, here, after, after2):
    """Difference to one neighbour: of the side whose second difference is the smaller one.

    NaN where neither neighbour exists.
    """
    backward = here - before
    forward = after - here
    bend_backward = abs(here - 2.0 * before + before2)
    bend_forward = abs(after2 - 2.0 * after + here)
    slope = backward
    if backward != backward:
        slope = forward
    elif forward == forward:
        if bend_forward < bend_backward or bend_backward != bend_backward:
            slope = forward
        if bend_backward != bend_backward and bend_forward != bend_forward:
            # Neither side reaches two pixels: the flatter one.
            slope = backward if abs(backward) <= abs(forward) else forward
    return slope


@parallel_kernel
def normals(depth, w, rays, perspective, out, degenerate):
    """Unit normals (right, up, back) that face the eye; NaN where depth is.

    `w` is what the surface is linear in, padded by two NaN on every side: 1/z (perspective) or
    z. `degenerate[row]` counts pixels with no neighbour on an axis.
    """
    rows, columns = depth.shape
    ax, bx, ay, by = rays
    for row in prange(rows):
        count = 0
        for column in range(columns):
            here = w[row + 2, column + 2]
            if here != here:
                for k in range(3):
                    out[k, row, column] = np.nan
                continue
            across = side_slope(
                w[row + 2, column],
                w[row + 2, column + 1],
                here,
                w[row + 2, column + 3],
                w[row + 2, column + 4],
            )
            down = side_slope(
                w[row, column + 2],
                w[row + 1, column + 2],
                here,
                w[row + 3, column + 2],
                w[row + 4, column + 2],
            )
            if across != across or down != down:
                count += 1
                across = 0.0 if across != across else across
                down = 0.0 if down != down else down
            if perspective:
                # The plane n·p = -1 has 1/z = -(n_x X + n_y Y - n_z).
                nx = -across / ax
                ny = -down / ay
                nz = here + nx * (ax * column + bx) + ny * (ay * row + by)
            else:
                nx = across / ax
                ny = down / ay
                nz = 1.0
            scale = 1.0 / np.sqrt(nx * nx + ny * ny + nz * nz)
            out[0, row, column] = nx * scale
            out[1, row, column] = ny * scale
            out[2, row, column] = nz * scale
        degenerate[row] = count
