"""Means over pixels whose slices are turned against each other, where they show like surface."""

import numpy as np

from adret._kernels.jit import kernel, parallel_kernel, prange

NORMAL_LIMIT = np.float32(0.98)
PLANE_LIMIT = np.float32(0.5)
ZERO = np.float32(0.0)
HALF = np.float32(0.5)
ONE = np.float32(1.0)


@kernel
def mark_like(z, n0, n1, n2, x, y, other_z, m0, m1, m2, other_x, other_y, perspective, limit, like):
    """1 where two pixels' normals are alike and each lies in the other's tangent plane, else 0.

    `limit` is a distance at depth 1 or, in orthographic projection, at any.
    """
    for i in range(len(like)):
        scale = z[i] if perspective else ONE
        other = other_z[i] if perspective else ONE
        dx = other * other_x[i] - scale * x[i]
        dy = other * other_y - scale * y
        dz = z[i] - other_z[i]
        above = abs(dx * n0[i] + dy * n1[i] + dz * n2[i])
        below = abs(dx * m0[i] + dy * m1[i] + dz * m2[i])
        along = n0[i] * m0[i] + n1[i] * m1[i] + n2[i] * m2[i]
        flat = (above < limit * scale) & (below < limit * scale)
        like[i] = ONE if flat & (along > NORMAL_LIMIT) else ZERO


@kernel
def add_where(values, like, share, total):
    """Add a share of what is of like surface, and no NaN."""
    for i in range(len(total)):
        known = (like[i] > ZERO) & (values[i] == values[i])
        total[i] += share * values[i] if known else ZERO


@kernel
def add_likeness(like, share, total):
    """Add the share itself."""
    for i in range(len(total)):
        total[i] += share * like[i]


@kernel
def take_means(sums, weights, means):
    """Divide sums by their weights; what has none is 0."""
    for x in range(len(means)):
        means[x] = sums[x] / weights[x] if weights[x] > ZERO else ZERO


@kernel
def take_units(x, y, z, bent):
    """Scale sums of vectors to unit length."""
    for i in range(len(x)):
        per = ONE / np.sqrt(x[i] * x[i] + y[i] * y[i] + z[i] * z[i])
        bent[0, i] = x[i] * per
        bent[1, i] = y[i] * per
        bent[2, i] = z[i] * per


@parallel_kernel
def gather(
    depth, normal, x, y, perspective, frame, tile, occlusion, confidence, bent, mean_occlusion,
    mean_confidence, mean_bent,
):  # fmt: skip
    """Means over squares of `tile` pixels a side, of pixels that show the surface of their middle.

    Each pixel of the square that repeats over the image counts alike: for an even side the window
    is one pixel wider, with halves at its ends. Left out is what is beyond the frame, whose normal
    is turned by more than 11° (cosine `NORMAL_LIMIT`), and what lies `PLANE_LIMIT` pixels or more
    beside the tangent plane.

    Parameters
    ----------
    depth, normal, perspective
        As in `Field`.
    x, y : (columns,) and (rows,) float32
        Places of pixels, on the plane at depth 1 in perspective projection.
    frame : (int, int, int, int)
        row0, row1, column0, column1.
    tile : int
        Side of the square.
    occlusion, confidence : (row1 - row0, column1 - column0) float32
    bent : (3, row1 - row0, column1 - column0) float32
    mean_occlusion, mean_confidence, mean_bent
        Outputs: as the three before.
    """
    row0, row1, column0, column1 = frame
    width = column1 - column0
    reach = tile // 2
    limit = PLANE_LIMIT * abs(x[1] - x[0]) if len(x) > 1 else PLANE_LIMIT * abs(y[1] - y[0])
    for row in prange(row0, row1):
        like = np.empty(width, dtype=np.float32)
        sums = np.zeros((5, width), dtype=np.float32)
        weights = np.zeros(width, dtype=np.float32)
        for down in range(-reach, reach + 1):
            r = row + down
            if not row0 <= r < row1:
                continue
            for side in range(-reach, reach + 1):
                share = HALF if 2 * abs(down) == tile else ONE
                share *= HALF if 2 * abs(side) == tile else ONE
                start = min(width, max(0, -side))
                stop = max(start, width - max(0, side))
                here = slice(column0 + start, column0 + stop)
                there = slice(column0 + start + side, column0 + stop + side)
                mark_like(
                    depth[row, here], normal[0, row, here], normal[1, row, here],
                    normal[2, row, here], x[here], y[row], depth[r, there], normal[0, r, there],
                    normal[1, r, there], normal[2, r, there], x[there], y[r], perspective, limit,
                    like[start:stop],
                )  # fmt: skip
                i, other = r - row0, slice(start + side, stop + side)
                add_likeness(like[start:stop], share, weights[start:stop])
                add_where(occlusion[i, other], like[start:stop], share, sums[0, start:stop])
                add_where(confidence[i, other], like[start:stop], share, sums[1, start:stop])
                for k in range(3):
                    values = bent[k, i, other]
                    add_where(values, like[start:stop], share, sums[2 + k, start:stop])
        take_means(sums[0], weights, mean_occlusion[row - row0])
        take_means(sums[1], weights, mean_confidence[row - row0])
        take_units(sums[2], sums[3], sums[4], mean_bent[:, row - row0])
