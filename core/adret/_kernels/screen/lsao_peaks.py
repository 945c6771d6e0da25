"""Line-sweep ambient obscurance: high points that are looked at beside the hulls.

A hull loses a point once one behind it casts more, though the point may be the largest occluder of
a receiver that comes later. Such points stand out of what is about them, so each line also keeps
the highest point of each of its latest blocks of samples. Blocks begin in the same rows for all
lines of a strip: nothing branches.
"""

import numpy as np

from adret._kernels.jit import kernel
from adret._kernels.screen.lsao_hulls import (
    HERE,
    HX,
    HY,
    LONG,
    SEEN_C,
    SEEN_S,
    SINE,
    ZERO,
    cast,
    cast_by_table,
)
from adret._kernels.screen.lsao_strips import LENGTH, STRIP, TANGENT, C, S, X, Y

SHORT, SHORTS = 4, 9  # samples of a short block, and how many are kept, the running one included
LONGER, LONGERS = 32, 5
FARTHER = 8  # times as long are blocks where the latest samples are looked at one by one
KEPT = (SHORTS + LONGERS) * 2 * STRIP


@kernel
def begin_blocks(i, times, peaks):
    """Forget the oldest block where a new one begins with sample i; blocks are `times` as long."""
    short, longer = SHORT * times, LONGER * times
    if i % short == 0:
        at = i // short % SHORTS * 2 * STRIP
        peaks[at : at + 2 * STRIP] = np.nan
    if i % longer == 0:
        at = (SHORTS + i // longer % LONGERS) * 2 * STRIP
        peaks[at : at + 2 * STRIP] = np.nan


@kernel
def keep_highest(w, low, count, slot, peaks):
    """Put the points of this row where they are higher than what a block has."""
    v = w[low:]
    at = peaks[slot * 2 * STRIP + low :]
    for j in range(count):
        x, y = v[X + j], v[Y + j]
        px, py = at[j], at[STRIP + j]
        over = (y >= py) | ((py != py) & (y == y))
        at[j] = x if over else px
        at[STRIP + j] = y if over else py


@kernel
def keep(w, low, count, i, times, peaks):
    """Note the points of sample i."""
    keep_highest(w, low, count, i // (SHORT * times) % SHORTS, peaks)
    keep_highest(w, low, count, SHORTS + i // (LONGER * times) % LONGERS, peaks)


@kernel
def raise_to(f, low, count, falloff, value):
    """Raise obscurances to that of a point, whose places from this row's are in `f`."""
    g = f[low:]
    for j in range(count):
        s, c, length, sine = g[SEEN_S + j], g[SEEN_C + j], g[LONG + j], g[SINE + j]
        n, m = cast(g[HX + j], g[HY + j], s, c, sine * length, falloff, ZERO)
        found = sine + n / (m * length)
        value[j] = found if found > value[j] else value[j]


@kernel
def look_at_peaks(w, f, low, count, falloff, short, table, peaks, value):
    """Raise the obscurances of this row's points to those of all kept points.

    `short` is `falloff` in float32; `f` is as `lsao_hulls.look` leaves it, its first places used.
    """
    v = w[low:]
    g = f[low:]
    for slot in range(SHORTS + LONGERS):
        at = peaks[slot * 2 * STRIP + low :]
        for j in range(count):
            g[HX + j] = np.float32(at[j] - v[X + j])
            g[HY + j] = np.float32(at[STRIP + j] - v[Y + j])
        if len(table) == 0:
            raise_to(f, low, count, short, value)
            continue
        for j in range(count):
            if g[HX + j] == g[HX + j] and g[HERE + j] == g[HERE + j]:
                sine, length = v[TANGENT + j], v[LENGTH + j]
                hx, hy = at[j] - v[X + j], at[STRIP + j] - v[Y + j]
                n, m = cast_by_table(
                    hx, hy, v[S + j], v[C + j], sine * length, falloff, table
                )  # fmt: skip
                found = sine + n / (m * length)
                value[j] = found if found > value[j] else value[j]
