"""Volumetric ambient occlusion: the share of the tangent sphere that the surface cuts off.

A pipe runs along a view ray through a sample of the disk that the sphere covers: the plane of the
disk goes through the sphere's centre, at right angles to the ray there. The volume between the
distances t0 and t1 of a pipe is (t1³ - t0³) / 3 times its solid angle.
"""

import numpy as np

from adret._kernels.jit import inline, kernel, parallel_kernel, prange
from adret._kernels.screen.containment import tangents
from adret._kernels.screen.surface import inside, spread, surface_at

# Largest squared sine of the angle under which the eye sees the sphere's radius.
WIDEST = 0.9


@inline
def volume(start, stop):
    """Three times the volume of a pipe of unit solid angle between two distances."""
    return (stop - start) * (stop * stop + stop * start + start * start)


@kernel
def pipes_of_row(
    row,
    nearness,
    normal,
    depth,
    rays,
    perspective,
    frame,
    origin,
    radius,
    samples,
    weighted,
    occlusion,
    confidence,
):
    """One row of `pipes`."""
    ax, bx, ay, by = rays[0], rays[1], rays[2], rays[3]
    column0, column1 = frame[2], frame[3]
    tile = np.int64(np.sqrt(samples.shape[0]) + 0.5)
    count = samples.shape[1]
    radius2 = radius * radius
    for column in range(column0, column1):
        share = np.nan
        seen = 0
        z = np.float64(depth[row, column])
        if z == z:
            grow = spread(perspective, z)
            c_right = grow * (ax * column + bx) + radius * normal[0, row, column]
            c_up = grow * (ay * row + by) + radius * normal[1, row, column]
            c_back = -z + radius * normal[2, row, column]
            far2 = c_right * c_right + c_up * c_up + c_back * c_back
            far = np.sqrt(far2)
            first, second = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
            across = radius
            if perspective:
                first, second = tangents(c_right / far, c_up / far, c_back / far)
                across = radius / np.sqrt(1.0 - min(radius2 / far2, WIDEST))
            points = samples[(row + origin[0]) % tile * tile + (column + origin[1]) % tile]
            free = 0.0
            whole = 0.0
            for i in range(count):
                u = across * points[i, 0]
                v = across * points[i, 1]
                right = c_right + u * first[0] + v * second[0]
                up = c_up + u * first[1] + v * second[1]
                back = c_back + u * first[2] + v * second[2]
                if perspective:
                    long2 = right * right + up * up + back * back
                    long = np.sqrt(long2)
                    along = (right * c_right + up * c_up + back * c_back) / long
                    half2 = along * along - far2 + radius2
                    per_area = far / (long2 * long)
                    ahead = -back / long  # depth per distance
                    i_column = (-right / back - bx) / ax
                    i_row = (-up / back - by) / ay
                    known = back < 0.0 and inside(nearness, i_row, i_column)
                else:
                    along = -c_back
                    half2 = radius2 - u * u - v * v
                    per_area = 1.0
                    ahead = 1.0
                    i_column = (right - bx) / ax
                    i_row = (up - by) / ay
                    known = inside(nearness, i_row, i_column)
                half = np.sqrt(max(half2, 0.0))
                stop = along + half
                start = along - half
                if perspective:
                    start = max(start, 0.0)
                    stop = max(stop, 0.0)
                end = stop
                if known:
                    seen += 1
                    surface = surface_at(nearness, i_row, i_column)
                    if surface == surface:
                        hit = 1.0 / (surface * ahead) if perspective else -surface
                        end = min(max(hit, start), stop)
                if perspective:
                    free += per_area * volume(start, end) / 3.0
                    whole += per_area * volume(start, stop) / 3.0
                else:
                    free += end - start
                    whole += stop - start
            if not weighted:
                whole = 4.0 / 3.0 * radius2 * radius * count / (across * across)
            share = 1.0 - free / whole if whole > 0.0 else 0.0
        occlusion[column - column0] = share
        confidence[column - column0] = seen / count


@parallel_kernel
def pipes(
    nearness,
    normal,
    depth,
    rays,
    perspective,
    frame,
    origin,
    radius,
    samples,
    weighted,
    occlusion,
    confidence,
):
    """Occluded share of the sphere of a radius that touches the surface.

    `samples` are points of the unit disk for each pixel of a tile, (tile², samples, 2). `weighted`
    divides by the volume of the same pipes in the whole sphere instead of by the sphere's.
    """
    for row in prange(frame[0], frame[1]):
        pipes_of_row(
            row,
            nearness,
            normal,
            depth,
            rays,
            perspective,
            frame,
            origin,
            radius,
            samples,
            weighted,
            occlusion[row - frame[0]],
            confidence[row - frame[0]],
        )
