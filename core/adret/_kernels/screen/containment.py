"""Containment tests: how many points around a pixel's point lie behind the surface.

The estimator of Crytek's ambient occlusion, of the light-field variant and of the containment test
of volumetric ambient occlusion. `offsets` holds one set of points for each pixel of a square tile
that repeats over the image, (tile², 3, samples), in units of the pixel's radius.
"""

import numpy as np

from adret._kernels.jit import inline, kernel, parallel_kernel, prange
from adret._kernels.screen.surface import ROUNDING, inside, nearness_of, spread, surface_at

# What the offsets' axes are.
VIEW = 0  # right, up, back
MIRRORED = 1  # the same, mirrored at the surface to the normal's side
TANGENT = 2  # two tangents of the surface and its normal
# How a sample counts whose surface lies far in front of the pixel's point.
KEEP = 0
FADE_BY_RADIUS = 1  # ever less from one radius in front, not at all from two
FADE_BY_DEPTH = 2  # ever less, not at all from its own depth in front, as published


@inline
def tangents(a, b, c):
    """Two unit vectors at right angles to a unit vector and to each other (Duff et al. 2017)."""
    sign = 1.0 if c >= 0.0 else -1.0
    p = -1.0 / (sign + c)
    q = a * b * p
    return (1.0 + sign * a * a * p, sign * q, -sign * a), (q, sign + b * b * p, -b)


@inline
def basis(axes, normal):
    """Columns of the matrix that turns an offset into view space."""
    first, second, third = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    if axes == TANGENT:
        first, second = tangents(normal[0], normal[1], normal[2])
        third = normal
    return first, second, third


@inline
def fade_limit(check, perspective, z, radius):
    """Nearness above which a surface's verdict begins to fade."""
    limit = np.inf
    if check == FADE_BY_DEPTH:
        limit = nearness_of(perspective, z)
    elif check == FADE_BY_RADIUS and (z > radius or not perspective):
        limit = nearness_of(perspective, z - radius)
    return limit


@inline
def faded(check, perspective, z, radius, surface):
    """Share of a sample's verdict that is put aside by the depth check."""
    depth = 1.0 / surface if perspective else -surface
    share = z / depth if check == FADE_BY_DEPTH else (z - depth) / radius
    return min(max(share - 1.0, 0.0), 1.0)


@kernel
def contain_row(
    row,
    nearness,
    normal,
    depth,
    rays,
    perspective,
    frame,
    origin,
    radius,
    radius_grows,
    offsets,
    axes,
    neutral,
    check,
    color,
    occlusion,
    confidence,
    light,
):
    """One row of `containment`."""
    ax, bx, ay, by = rays[0], rays[1], rays[2], rays[3]
    column0, column1 = frame[2], frame[3]
    per_ax, per_ay = 1.0 / ax, 1.0 / ay
    first_column, first_row = bx / ax, by / ay
    tile = np.int64(np.sqrt(offsets.shape[0]) + 0.5)
    count = offsets.shape[2]
    mirrored = axes == MIRRORED
    nears, rows, columns = np.empty(count), np.empty(count), np.empty(count)
    for column in range(column0, column1):
        total = np.nan
        seen = 0
        z = np.float64(depth[row, column])
        if z == z:
            total = 0.0
            reach = radius * spread(perspective and radius_grows, z)
            x = spread(perspective, z) * (ax * column + bx)
            y = spread(perspective, z) * (ay * row + by)
            n = (
                np.float64(normal[0, row, column]),
                np.float64(normal[1, row, column]),
                np.float64(normal[2, row, column]),
            )
            limit = fade_limit(check, perspective, z, reach)
            points = offsets[(row + origin[0]) % tile * tile + (column + origin[1]) % tile]
            first, second, third = basis(axes, n)
            us, vs, ws = points[0], points[1], points[2]
            for i in range(count):  # places first: this loop vectorises, the next does not
                right = us[i] * first[0] + vs[i] * second[0] + ws[i] * third[0]
                up = us[i] * first[1] + vs[i] * second[1] + ws[i] * third[1]
                back = us[i] * first[2] + vs[i] * second[2] + ws[i] * third[2]
                side = right * n[0] + up * n[1] + back * n[2]
                way = -reach if mirrored and side < 0.0 else reach
                near = nearness_of(perspective, z - way * back)
                per_length = near if perspective else 1.0
                nears[i] = near
                columns[i] = (x + way * right) * per_length * per_ax - first_column
                rows[i] = (y + way * up) * per_length * per_ay - first_row
            for i in range(count):
                near = nears[i]
                term = neutral
                sent = 0.0
                if inside(nearness, rows[i], columns[i]) and (near > 0.0 or not perspective):
                    seen += 1
                    surface = surface_at(nearness, rows[i], columns[i])
                    term = 1.0 if near + ROUNDING * abs(surface) < surface else 0.0
                    sent = term
                    if surface > limit:
                        share = faded(check, perspective, z, reach, surface)
                        sent = (1.0 - share) * term
                        term = share * neutral + sent
                total += term
                for band in range(color.shape[0]):
                    if sent > 0.0:
                        of_sample = color[band, int(rows[i] + 0.5), int(columns[i] + 0.5)]
                        light[band, column - column0] += sent / count * of_sample
        occlusion[column - column0] = total / count
        confidence[column - column0] = seen / count


@parallel_kernel
def containment(
    nearness,
    normal,
    depth,
    rays,
    perspective,
    frame,
    origin,
    radius,
    radius_grows,
    offsets,
    axes,
    neutral,
    check,
    color,
    occlusion,
    confidence,
    light,
):
    """Share of the points that lie behind the surface, and share of them inside the image.

    A point outside the image, or whose surface is out of range, counts as `neutral`; one over sky
    or a hole is free. `radius_grows` multiplies the radius by the depth, in perspective. `color`
    (bands, rows, columns), which may have no bands, is what the surface sends to the points behind
    it: their sum over the number of points is added to `light` (bands, rows and columns of the
    frame).
    """
    for row in prange(frame[0], frame[1]):
        contain_row(
            row,
            nearness,
            normal,
            depth,
            rays,
            perspective,
            frame,
            origin,
            radius,
            radius_grows,
            offsets,
            axes,
            neutral,
            check,
            color,
            occlusion[row - frame[0]],
            confidence[row - frame[0]],
            light[:, row - frame[0]],
        )
