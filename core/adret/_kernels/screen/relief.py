"""Containment test against the depth buffer and a height field on the surface together."""

import numpy as np

from adret._kernels.jit import inline, kernel, parallel_kernel, prange
from adret._kernels.screen.containment import tangents
from adret._kernels.screen.surface import behind, inside, spread, surface_at

SHORT = 1e-6  # a direction nearer to the normal than this is no tangent


@inline
def height_at(heights, v, u):
    """Bilinear height of a texture that repeats, at texel coordinates; texel centres are whole."""
    top = np.int64(np.floor(v))
    left = np.int64(np.floor(u))
    down = v - top
    across = u - left
    rows, columns = heights.shape
    a = heights[top % rows, left % columns]
    b = heights[top % rows, (left + 1) % columns]
    c = heights[(top + 1) % rows, left % columns]
    d = heights[(top + 1) % rows, (left + 1) % columns]
    upper = a + across * (b - a)
    lower = c + across * (d - c)
    return upper + down * (lower - upper)


@kernel
def contain_row_over_relief(
    row,
    nearness,
    normal,
    depth,
    rays,
    perspective,
    frame,
    origin,
    radius,
    offsets,
    heights,
    texels,
    along,
    per_texel,
    occlusion,
    confidence,
):
    """One row of `containment_over_relief`."""
    ax, bx, ay, by = rays[0], rays[1], rays[2], rays[3]
    column0, column1 = frame[2], frame[3]
    tile = np.int64(np.sqrt(offsets.shape[0]) + 0.5)
    count = offsets.shape[1]
    for column in range(column0, column1):
        total = np.nan
        seen = 0
        z = np.float64(depth[row, column])
        if z == z:
            total = 0.0
            x = spread(perspective, z) * (ax * column + bx)
            y = spread(perspective, z) * (ay * row + by)
            n = (normal[0, row, column], normal[1, row, column], normal[2, row, column])
            place_u = np.float64(texels[0, row, column])
            place_v = np.float64(texels[1, row, column])
            first, second = tangents(n[0], n[1], n[2])
            t = (along[0, row, column], along[1, row, column], along[2, row, column])
            slant = t[0] * n[0] + t[1] * n[1] + t[2] * n[2]
            t = (t[0] - slant * n[0], t[1] - slant * n[1], t[2] - slant * n[2])
            length = np.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2])
            relief = np.isfinite(place_u) and np.isfinite(place_v) and length > SHORT
            if relief:
                first = (t[0] / length, t[1] / length, t[2] / length)
                second = (
                    n[1] * first[2] - n[2] * first[1],
                    n[2] * first[0] - n[0] * first[2],
                    n[0] * first[1] - n[1] * first[0],
                )
            here = height_at(heights, place_v, place_u) if relief else 0.0
            points = offsets[(row + origin[0]) % tile * tile + (column + origin[1]) % tile]
            for i in range(count):
                u = radius * points[i, 0]
                v = radius * points[i, 1]
                w = radius * points[i, 2]
                right = u * first[0] + v * second[0] + w * n[0]
                up = u * first[1] + v * second[1] + w * n[1]
                back = u * first[2] + v * second[2] + w * n[2]
                closed = relief and here + w < height_at(
                    heights, place_v + v / per_texel, place_u + u / per_texel
                )
                depth_there = z - back
                if depth_there > 0.0 or not perspective:
                    across = spread(perspective, depth_there)
                    i_column = ((x + right) / across - bx) / ax
                    i_row = ((y + up) / across - by) / ay
                    if inside(nearness, i_row, i_column):
                        seen += 1
                        surface = surface_at(nearness, i_row, i_column)
                        closed = closed or behind(perspective, depth_there, surface)
                total += closed
        occlusion[column - column0] = total / count
        confidence[column - column0] = seen / count


@parallel_kernel
def containment_over_relief(
    nearness,
    normal,
    depth,
    rays,
    perspective,
    frame,
    origin,
    radius,
    offsets,
    heights,
    texels,
    along,
    per_texel,
    occlusion,
    confidence,
):
    """Share of the points that lie behind the surface or inside the height field on it.

    `offsets` are (tile², samples, 3) in units of the radius: along the direction in which the
    texture's columns count, `along` (3, rows, columns), along its rows', and along the normal.
    `texels` is each pixel's place on the texture, (2, rows, columns), column first.
    """
    for row in prange(frame[0], frame[1]):
        contain_row_over_relief(
            row,
            nearness,
            normal,
            depth,
            rays,
            perspective,
            frame,
            origin,
            radius,
            offsets,
            heights,
            texels,
            along,
            per_texel,
            occlusion[row - frame[0]],
            confidence[row - frame[0]],
        )
