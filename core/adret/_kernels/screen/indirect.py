"""One bounce of colour in slices through the view ray: what is first hit sends its colour.

As `exact`, but sample by sample, for each has a colour of its own.
"""

import numpy as np

from adret._kernels.jit import greater, kernel, parallel_kernel, prange
from adret._kernels.screen.intervals import (
    add_line,
    advance,
    any_rose,
    close,
    lanes,
    slope_of,
    view_ray,
)
from adret._kernels.screen.slices import (
    BASE,
    CLOSED,
    COSINE_NEW,
    HALF,
    HARD,
    LANES,
    ONE,
    PER_SIDE,
    RAISED,
    SHORT,
    SINE_NEW,
    SIZE,
    SLOPE,
    TOTAL_WHOLE,
    TURN,
    WHOLE,
    ZERO,
    A,
    B,
    X,
    aim,
    farthest,
    place,
)

FADE = np.float32(-50.0)
LIGHT = SIZE  # three sums of colour follow the quantities of `slices`


@kernel
def raise_by_one(a, b, base, raised, p, q, lone, v):
    """Raise the horizon of receivers by one sample."""
    second = q > p
    for x in range(len(base)):
        t = slope_of(a[x], b[x], p, q, lone, second, base[x], v)
        raised[x] = greater(t, raised[x])


@kernel
def weigh_facing(n0, n1, n2, w, low, high, y, ex, ey):
    """Clear the intervals of receivers low to high - 1 that look at a surface from behind.

    They fade out over the last degree before, so that rounding decides nothing.
    """
    for i in range(low, high):
        short = w[SHORT + i]
        x = w[X + i]
        b = w[B + i]
        per_side = w[PER_SIDE + i]
        k = i - low
        across = n0[k] * (ex * per_side + b * x * short) + n1[k] * (ey * per_side + b * y * short)
        across -= n2[k] * b * short
        towards = (n2[k] - n0[k] * x - n1[k] * y) * short
        share = FADE * (w[SINE_NEW + i] * across + w[COSINE_NEW + i] * towards)
        share = share if share > ZERO else ZERO
        w[CLOSED + i] *= ONE if share > ONE else share


@kernel
def add_colour(a, b, share, w, low, high, band):
    """Add one band of colour of the intervals of receivers low to high - 1."""
    for i in range(low, high):
        k = i - low
        colour = a[k] + (b[k] - a[k]) * share
        w[LIGHT + band * LANES + i] += w[TURN + i] * w[CLOSED + i] * colour


@kernel
def gather(
    near, shape, colour, normal, facing, w, n, row, first, at, o, p, q, lone, v, s, start, stop,
    reach, y, ex, ey, cosine, uniform, tolerance, code, radius, scale, table,
):  # fmt: skip
    """Gather colour along one direction of the image."""
    before = ZERO
    for j in range(start, stop):
        low, high = lanes(shape, row, first, n, o, j)
        if s[j] > reach or high <= low:
            break
        size = high - low
        a, b = at + low + o[j, 0], at + low + o[j, 3]
        raise_by_one(
            near[a : a + size],
            near[b : b + size],
            w[BASE + low : BASE + high],
            w[RAISED + low : RAISED + high],
            p[j], q[j], lone[j], v[j],
        )  # fmt: skip
        now = s[j]
        if any_rose(w):
            w[CLOSED : CLOSED + LANES] = ZERO
            if close(w, before, now, cosine, uniform, tolerance, code, radius, scale, table):
                for x in range(low, high):
                    if w[HARD + x] > ZERO:
                        c0 = np.float64(w[A + x] * w[SLOPE + x] + w[B + x])
                        c1 = np.float64(w[A + x] * w[RAISED + x] + w[B + x])
                        rho, ku, kw = view_ray(w, x, np.float64(HALF * (before + now)))
                        add_line(
                            w, x, rho, ku, kw, c0, c1, cosine, uniform, code, radius, scale, table
                        )
            nearer = b if q[j] > p[j] else a
            if facing:
                weigh_facing(
                    normal[0, nearer : nearer + size],
                    normal[1, nearer : nearer + size],
                    normal[2, nearer : nearer + size],
                    w, low, high, y, ex, ey,
                )  # fmt: skip
            share = q[j] * now if now > ZERO else HALF
            for band in range(3):
                add_colour(
                    colour[band, a : a + size], colour[band, b : b + size], share, w, low, high,
                    band,
                )  # fmt: skip
            advance(w)
        before = now


@kernel
def indirect_row(
    row, near, pad, shape, normal, rays, perspective, frame, colour, normals, facing, o, p, q, lone,
    v, s, lines, along, cosine, uniform, tolerance, code, radius, scale, table, light,
):  # fmt: skip
    """One row of `indirect`."""
    tile, width = near.shape[1], near.shape[2]
    flat = near.reshape(near.size)
    ax, ay = np.float32(rays[0]), np.float32(rays[2])
    w = np.empty(SIZE + 3 * LANES, dtype=np.float32)
    for phase in range(tile):
        begin = (frame[2] - phase + tile - 1) // tile
        end = (frame[3] - phase + tile - 1) // tile
        for first in range(begin, end, LANES):
            n = min(LANES, end - first)
            column = phase + tile * first
            at = ((row + pad[0]) * tile + phase) * width + first + pad[1]
            y = place(flat, at, normal, row, column, tile, n, rays, perspective, radius, w)
            w[LIGHT:] = ZERO
            for k in range(lines.shape[2]):
                dc = np.float32(along[row % tile, phase, k, 0])
                dr = np.float32(along[row % tile, phase, k, 1])
                ex = ax * dc
                ey = ay * dr
                aim(w, y, ex, ey, dc, dr, perspective, cosine, uniform)
                gather(
                    flat, near.shape, colour, normals, facing, w, n, row + pad[0], first + pad[1],
                    at, o, p, q, lone, v, s, lines[row % tile, phase, k, 0],
                    lines[row % tile, phase, k, 1], farthest(w, perspective), y, ex, ey, cosine,
                    uniform, tolerance, code, radius, scale, table,
                )  # fmt: skip
                for x in range(LANES):
                    w[TOTAL_WHOLE + x] += w[TURN + x] * w[WHOLE + x]
            for band in range(3):
                for x in range(LANES):
                    w[LIGHT + band * LANES + x] /= w[TOTAL_WHOLE + x]
                out = light[band, row - frame[0], column - frame[2] :: tile]
                for x in range(n):
                    out[x] = w[LIGHT + band * LANES + x]


@parallel_kernel
def indirect(
    near, pad, shape, normal, rays, perspective, frame, colour, normals, facing, o, p, q, lone, v,
    s, lines, along, cosine, uniform, tolerance, code, radius, scale, table, light,
):  # fmt: skip
    """Colour that the surface sends to a frame by one bounce.

    Parameters
    ----------
    colour : (3, R * T * W) float32
        Colours, laid out as `near`.
    normals : (3, R * T * W) float32
        Normals, laid out so too; used if `facing`.
    facing : bool
        Whether surfaces send nothing to their backs.
    light : (3, row1 - row0, column1 - column0) float32
        Output.

    The rest is as for `exact.slices`.
    """
    for row in prange(frame[0], frame[1]):
        indirect_row(
            row, near, pad, shape, normal, rays, perspective, frame, colour, normals, facing, o, p,
            q, lone, v, s, lines, along, cosine, uniform, tolerance, code, radius, scale, table,
            light,
        )  # fmt: skip
