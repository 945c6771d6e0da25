"""Line-sweep ambient obscurance: the latest points of every line, each looked at.

For falloffs that end abruptly. The steepest point within the radius need not be on the hull: a
nearer surface that covers it may be beyond the radius. The latest points of a strip's lines are
kept four samples a group, so that four are compared in one loop with constant distances.
"""

import math

import numpy as np

from adret._kernels.jit import kernel
from adret._kernels.screen.lsao_hulls import HX, LONG, SEEN_C, SEEN_S, SINE
from adret._kernels.screen.lsao_strips import STRIP, X, Y, Z

GROUP = 4
GROUPS = 33  # the running one included: at least 128 samples
SIZE = GROUP * 2 * STRIP
KEPT = GROUPS * SIZE
BEYOND = np.float32(-4.0)  # less than any signed square of a sine
BEST = HX  # in the strip's float32 numbers, what the hulls no longer need


@kernel
def begin_groups(i, here, latest, places):
    """Forget the oldest group where a new one begins with sample i; `places` says where groups end.

    Samples that show no surface count as well: results do not depend on passing over them.
    """
    group = i // GROUP % GROUPS
    if i % GROUP == 0:
        latest[group * SIZE : (group + 1) * SIZE] = np.nan
    places[group] = here


@kernel
def keep_latest(w, low, count, i, latest):
    """Note the points of sample i; a line that is not in the image there has none."""
    at = i // GROUP % GROUPS * SIZE + i % GROUP * 2 * STRIP + low
    for x in range(count):
        latest[at + x] = w[X + low + x]
    at += STRIP
    for x in range(count):
        latest[at + x] = w[Y + low + x]


@kernel
def compare_four(w, f, low, count, group, latest, limit):
    """Raise the signed squares of sines to those of a group's points within the radius."""
    v = w[low:]
    g = f[low:]
    p = latest[group * SIZE + low :]
    never = BEYOND
    for i in range(count):
        x, y = v[X + i], v[Y + i]
        s, c = g[SEEN_S + i], g[SEEN_C + i]
        ax, ay = np.float32(p[i] - x), np.float32(p[STRIP + i] - y)
        bx, by = np.float32(p[2 * STRIP + i] - x), np.float32(p[3 * STRIP + i] - y)
        dx, dy = np.float32(p[4 * STRIP + i] - x), np.float32(p[5 * STRIP + i] - y)
        ex, ey = np.float32(p[6 * STRIP + i] - x), np.float32(p[7 * STRIP + i] - y)
        a2, at = ax * ax + ay * ay, c * ay - s * ax
        b2, bt = bx * bx + by * by, c * by - s * bx
        d2, dt = dx * dx + dy * dy, c * dy - s * dx
        e2, et = ex * ex + ey * ey, c * ey - s * ex
        a = at * abs(at) / a2 if a2 < limit else never
        b = bt * abs(bt) / b2 if b2 < limit else never
        d = dt * abs(dt) / d2 if d2 < limit else never
        e = et * abs(et) / e2 if e2 < limit else never
        a = a if a > b else b
        d = d if d > e else e
        a = a if a > d else d
        best = g[BEST + i]
        g[BEST + i] = a if a > best else best


@kernel
def nearest_depth(w, low, count):
    """Least depth of a row's points; infinite without one."""
    least = np.inf
    v = w[Z + low :]
    for i in range(count):
        least = v[i] if v[i] < least else least
    return least


@kernel
def search_latest(
    w, f, low, count, sample, here, steepest, falloff, perspective, latest, places, value
):
    """Raise the obscurances of a row's points to those of kept points within the radius.

    Groups are passed over from the first on whose rays all pass every point of the row at more
    than the radius. `steepest` is the largest tangent of an angle between a ray and the axis.
    """
    limit = np.float32(falloff[4])
    g = f[low:]
    for i in range(count):
        g[BEST + i] = BEYOND
    radius = math.sqrt(falloff[4])
    if perspective:
        radius *= math.sqrt(1.0 + steepest * steepest) / nearest_depth(w, low, count)
    last = sample - 1
    groups = min(last // GROUP + 1, GROUPS)
    for k in range(groups):
        group = (last // GROUP - k) % GROUPS
        if abs(here - places[group]) > radius:
            break
        compare_four(w, f, low, count, group, latest, limit)
    for i in range(count):
        square = g[BEST + i]
        length = g[LONG + i]
        sine = math.sqrt(abs(square)) / length
        sine = sine if square > np.float32(0.0) else -sine
        sine = sine if sine > g[SINE + i] else g[SINE + i]
        value[i] = sine if sine > value[i] else value[i]
