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
    SCRATCH,
    SEEN,
    SHARE,
    TOP,
    ZERO,
    A,
    B,
)
from adret._kernels.screen.far_field_lines import between, shift_of
from adret._kernels.screen.far_field_slabs import add_plain, add_weighted

NOTHING = np.float32(-1e30)
SCARCE = np.float32(1e-3)
"""Share of a sector below which its mean is all rounding."""


@inline
def foot_of(height, thickness, perspective):
    """Nearness of what lies `thickness` behind."""
    return height / (ONE + thickness * height) if perspective else height - thickness


@kernel
def near_samples(w, count, view, row, first, sign, slope, last, thickness, lean, weights):
    """Raise the horizon by the surface on the rows up to `last` away, along one line each."""
    near = view.near
    perspective = view.perspective
    rows, columns = near.shape
    plain = weights.plain
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
            add_weighted(v, stop - start, np.float32(k - 1), lean, perspective, weights, thick)


@kernel
def read_sums(sums, line, step, start, stop, level, f):
    """A row of prefix sums at lines ``line + step i``; at `level` instead where it is >= 0.

    Returns a view of `stop - start` numbers, as long as `sums` has phases of `step`.
    """
    if level < 0:
        at = line + step * start
        phase, k = at % step, at // step
        return sums[phase, k : k + stop - start]
    f[: stop - start] = sums[level % step, level // step]
    return f[: stop - start]


@inline
def whole_number(difference):
    """A difference of int32, which Numba takes for int64, as float32."""
    return np.float32(np.int32(difference))


@kernel
def sector_means(
    w, f, g, lines, interval, low, high, first, step, count, base, facing, middle, drift
):
    """Points of an interval, means between two lines that are counted from each receiver's column.

    Receiver i looks from column ``first + step i``; `base` is the way to the interval's first row.
    Returns the first and the last receiver + 1 whose sector meets lines that show a surface; of
    these, SEEN, HEIGHT, PLACE (rows away) and SHARE are set.
    """
    begin, end, full = lines.spans[interval]
    lower = int(np.floor(low))
    upper = int(np.floor(high))
    s0 = np.float32(low - lower)
    s1 = np.float32(high - upper)
    lower += first
    upper += first
    start = min(max(0, -((upper - begin) // step)), count)  # upper + step i >= begin
    stop = max(min(count, (end - 1 - lower) // step + 1), start)  # lower + step i < end
    inner = min(max(start, -((lower - begin) // step)), stop)  # lower + step i >= begin
    outer = max(min(stop, (end - 1 - upper) // step + 1), start)  # upper + step i < end
    wide = np.float32(high - low)
    per_width = ONE / wide
    per_row = np.float32(facing / lines.per_row)
    nearest = np.float32(base)
    at_middle = np.float32(middle)
    aside = np.float32(drift)
    heights, places = lines.heights[interval], lines.places[interval]
    counts, tops = lines.counts[interval], lines.tops[interval]
    for piece in range(3):
        a = start if piece == 0 else min(inner, outer) if piece == 1 else max(inner, outer)
        b = min(inner, outer) if piece == 0 else max(inner, outer) if piece == 1 else stop
        n = b - a
        if n <= 0:
            continue
        before = begin if a < inner else -1
        after = end if a >= outer else -1
        h0 = read_sums(heights, lower, step, a, b, before, f[0])
        h1 = read_sums(heights, upper, step, a, b, after, f[1])
        p0 = read_sums(places, lower, step, a, b, before, g[0])
        p1 = read_sums(places, upper, step, a, b, after, g[1])
        q0 = read_sums(places, lower + 1, step, a, b, before, g[2])
        q1 = read_sums(places, upper + 1, step, a, b, after, g[3])
        t0 = s0 if before < 0 else ZERO
        t1 = s1 if after < 0 else ZERO
        e0 = read_sums(tops, lower, step, a, b, -1 if before < 0 else begin, w[SCRATCH:])
        e1 = read_sums(tops, upper, step, a, b, -1 if after < 0 else begin, w[SCRATCH + LANES :])
        v = w[a:]
        # Few arrays a loop: with more, aliasing is not ruled out and nothing vectorises.
        for i in range(n):
            v[HEIGHT + i] = np.float32(h1[i] - h0[i]) + (t1 * e1[i] - t0 * e0[i])
        for i in range(n):
            rows = whole_number(p1[i] - p0[i])
            v[PLACE + i] = (
                rows + t1 * whole_number(q1[i] - p1[i]) - t0 * whole_number(q0[i] - p0[i])
            )
        if full and before < 0 and after < 0:
            for i in range(n):
                height = v[HEIGHT + i] * per_width
                away = nearest + per_row * (v[PLACE + i] * per_width)
                under = v[NEAR + i] + v[RISE + i] * ((at_middle - away) * aside)
                v[SEEN + i] = v[A + i] * (height - under) / away + v[B + i]
                v[HEIGHT + i] = height
                v[PLACE + i] = away
                v[SHARE + i] = ONE
            continue
        c0 = read_sums(counts, lower, step, a, b, before, g[4])
        c1 = read_sums(counts, upper, step, a, b, after, g[5])
        d0 = read_sums(counts, lower + 1, step, a, b, before, g[6])
        d1 = read_sums(counts, upper + 1, step, a, b, after, g[7])
        for i in range(n):
            number = whole_number(c1[i] - c0[i])
            v[SHARE + i] = (
                number + t1 * whole_number(d1[i] - c1[i]) - t0 * whole_number(d0[i] - c0[i])
            )
        for i in range(n):
            number = v[SHARE + i]
            share = number * per_width
            per = ONE / number
            height = v[HEIGHT + i] * per
            away = nearest + per_row * (v[PLACE + i] * per)
            under = v[NEAR + i] + v[RISE + i] * ((at_middle - away) * aside)
            seen = v[A + i] * (height - under) / away + v[B + i]
            v[SEEN + i] = seen if share > SCARCE else NOTHING
            v[HEIGHT + i] = height
            v[PLACE + i] = away
            v[SHARE + i] = share
    return start, stop


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
def add_points(w, count, row, sign, start, ahead, skew, thickness, lean, perspective, weights):
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
    if weights.plain:
        add_plain(w, count, thick)
    else:
        add_weighted(w, count, np.float32(start), lean, perspective, weights, thick)
