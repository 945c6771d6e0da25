"""Points that may raise the horizon of a block of receivers: near samples and virtual points."""

import numpy as np

from adret._kernels.jit import greater, inline, kernel
from adret._kernels.screen.far_field_block import (
    ASIDE,
    FROM,
    HEIGHT,
    LANES,
    NEAR,
    ONE,
    PLACE,
    RISE,
    SEEN,
    SHARE,
    TOP,
    ZERO,
    A,
    B,
)
from adret._kernels.screen.far_field_lines import between, shift_of
from adret._kernels.screen.far_field_slabs import add_plain, add_weighted

SCARCE = 1e-3
"""Share of a sector below which its mean is all rounding."""


@inline
def foot_of(height, thickness, perspective):
    """Nearness of what lies `thickness` behind."""
    return height / (ONE + thickness * height) if perspective else height - thickness


@kernel
def near_samples(w, count, view, row, first, sign, slope, last, thickness, lean, table):
    """Raise the horizon by the surface on the rows up to `last` away, along one line each."""
    near = view.near
    perspective = view.perspective
    rows, columns = near.shape
    plain = len(table.values) == 0
    thick = thickness == np.inf
    t = np.float32(thickness)
    for k in range(1, last + 1):
        there = row + sign * k
        if there < 0 or there >= rows:
            break
        shift, share = shift_of(sign * k * slope, thick)
        more = 1 if share > ZERO else 0
        start = min(max(0, -(first + shift)), count)
        stop = max(min(count, columns - more - first - shift), start)
        left = near[there, first + shift + start : first + shift + stop]
        right = near[there, first + shift + start + more : first + shift + stop + more]
        per = ONE / np.float32(k)
        v = w[start:]
        if plain and thick:
            for i in range(stop - start):
                height = between(left[i], right[i], share)
                c = v[A + i] * (height - v[NEAR + i]) * per + v[B + i]
                v[TOP + i] = greater(c, v[TOP + i])
            continue
        for i in range(stop - start):
            height = between(left[i], right[i], share)
            c = v[A + i] * (height - v[NEAR + i]) * per + v[B + i]
            foot = c
            if not thick:
                bottom = foot_of(height, t, perspective)
                foot = v[A + i] * (bottom - v[NEAR + i]) * per + v[B + i]
            v[SEEN + i] = c
            v[HEIGHT + i] = height
            v[PLACE + i] = np.float32(k)
            v[SHARE + i] = ONE
            v[FROM + i] = v[TOP + i] if thick or foot < v[TOP + i] else foot
        if plain:
            add_plain(v, stop - start, thick)
        else:
            add_weighted(v, stop - start, np.float32(k - 1), lean, perspective, table)


@kernel
def border(sums, f, at, first, step, count):
    """Fill f with a row of prefix sums at lines ``at + first + step i``."""
    lines = len(sums) - 1
    whole = int(np.floor(at))
    share = at - whole
    k = whole + first
    start = min(max(0, -(k // step)), count)  # k + step i >= 0
    stop = max(min(count, (lines - 1 - k) // step + 1), start)
    for i in range(start):
        f[i] = 0.0
    if step == 1:
        a = sums[k + start : k + stop]
        b = sums[k + start + 1 : k + stop + 1]
        g = f[start:stop]
        for i in range(stop - start):
            g[i] = a[i] + share * (b[i] - a[i])
    else:
        for i in range(start, stop):
            a1 = sums[k + step * i]
            f[i] = a1 + share * (sums[k + step * i + 1] - a1)
    for i in range(stop, count):
        f[i] = sums[lines]


@kernel
def sector_means(w, f, lines, row, low, high, first, step, count):
    """Mean points of an interval between two lines, counted from each receiver's column.

    Row `row` of the prefix sums; receiver i looks from column ``first + step i``.
    """
    n = LANES
    border(lines.heights[row], f[0:n], low, first, step, count)
    border(lines.heights[row], f[n : 2 * n], high, first, step, count)
    border(lines.places[row], f[2 * n : 3 * n], low, first, step, count)
    border(lines.places[row], f[3 * n : 4 * n], high, first, step, count)
    border(lines.counts[row], f[4 * n : 5 * n], low, first, step, count)
    border(lines.counts[row], f[5 * n : 6 * n], high, first, step, count)
    per_width = 1.0 / (high - low)
    for i in range(count):
        number = f[5 * LANES + i] - f[4 * LANES + i]
        share = number * per_width
        per = 1.0 / number
        per = np.nan if share < SCARCE else per
        w[HEIGHT + i] = np.float32((f[LANES + i] - f[i]) * per)
        w[PLACE + i] = np.float32((f[3 * LANES + i] - f[2 * LANES + i]) * per)
        w[SHARE + i] = np.float32(share)
        w[ASIDE + i] = ZERO


@kernel
def line_points(w, lines, row, middle, spread, jitter, first, step, count):
    """Points of an interval on the line `middle`, shifted by `spread` times each jitter."""
    number = lines.height.shape[1]
    for i in range(count):
        column = first + step * i
        line = int(np.floor(middle + column + spread * jitter[column] + 0.5))
        w[ASIDE + i] = np.float32(line - middle - column)
        w[SHARE + i] = ONE
        if 0 <= line < number:
            w[HEIGHT + i] = lines.height[row, line]
            w[PLACE + i] = lines.place[row, line]
        else:
            w[HEIGHT + i] = -np.inf
            w[PLACE + i] = np.nan


@kernel
def add_points(w, count, row, sign, start, ahead, skew, thickness, lean, perspective, table):
    """Raise the horizon by points whose interval begins `start` rows away."""
    here = np.float32(row)
    facing = np.float32(sign)
    thick = thickness == np.inf
    t = np.float32(thickness)
    middle = np.float32(ahead)
    drift = np.float32(skew)
    for i in range(count):
        away = (w[PLACE + i] - here) * facing
        per = ONE / away
        w[PLACE + i] = away
        under = w[NEAR + i] + w[RISE + i] * ((middle - away) * drift + w[ASIDE + i])
        w[SEEN + i] = w[A + i] * (w[HEIGHT + i] - under) * per + w[B + i]
        w[FROM + i] = w[TOP + i]
        if not thick:
            bottom = foot_of(w[HEIGHT + i], t, perspective)
            foot = w[A + i] * (bottom - under) * per + w[B + i]
            w[FROM + i] = foot if foot > w[TOP + i] else w[TOP + i]
    if len(table.values) == 0:
        add_plain(w, count, thick)
    else:
        add_weighted(w, count, np.float32(start), lean, perspective, table)
