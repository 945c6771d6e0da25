"""A block of receivers side by side, and one direction of the image from each of them (P4).

In the slice through a receiver's view ray and a direction of the image, a direction of view space
is known by the cotangent c of its angle from the view ray: +inf towards the eye, -inf away from it.
Where its image gains m of nearness (1/z or -z) a row, c = A m + B: what raises m raises the
horizon. The frame is that of the direction: the major axis runs down the rows, the minor axis along
the columns. The numbers of a block stand in one flat float32 array `w`, quantity after quantity,
`LANES` apart: with constant distances nothing can alias, and loops vectorise.
"""

import numpy as np

from adret._kernels.angles import HALF_PI, atan_slope
from adret._kernels.jit import inline, kernel

LANES = 240  # a multiple of 3, and no power of 2: those would share a few sets of the cache
# Of the receiver:
NEAR = 0 * LANES  # nearness, raised by the rounding of float32 depths
MINOR = 1 * LANES  # of the view ray (major, minor, -1); 0 in orthographic projection
LENGTH = 2 * LANES  # of the view ray
SPREAD = 3 * LANES  # depth (perspective) or 1
NORMAL_A = 4 * LANES  # along the major axis
NORMAL_B = 5 * LANES  # along the minor axis
NORMAL_V = 6 * LANES  # along the view ray
RISE = 23 * LANES  # nearness that the tangent plane gains a column
# Of the direction:
A = 7 * LANES
B = 8 * LANES
SIDE = 9 * LANES  # distance from the view ray of a point a row away, at depth 1
NORMAL_U = 10 * LANES  # across the view ray
TURN = 11 * LANES  # angle round the view ray that the direction stands for
FLAT = 12 * LANES  # c of the tangent plane
# The horizon as far as it is known:
START = 13 * LANES  # c where the part at hand began
TOP = 14 * LANES  # c
CLOSED = 15 * LANES  # obscurance below it
# A point of each receiver:
HEIGHT = 17 * LANES  # nearness
PLACE = 18 * LANES  # row, then rows away
SHARE = 19 * LANES  # of the sector that it stands for
SEEN = 20 * LANES  # c
FROM = 21 * LANES  # c from which on its slab is seen
ASIDE = 22 * LANES  # columns between a point and the direction's ray
LIST = 24 * LANES  # receivers whose point raises the horizon
SCRATCH = 25 * LANES
SIZE = 43 * LANES

ZERO = np.float32(0.0)
HALF = np.float32(0.5)
ONE = np.float32(1.0)
HUGE = np.float32(1e18)
TINY = np.float32(1e-18)
ROUNDING = np.float32(2.0**-21)


@inline
def below(c, nu, nv):
    """Cosine-weighted part of a slice between the plane across the view ray and cotangent c."""
    s = ONE / (ONE + c * c)
    return HALF * (nv * (ONE - s) + nu * (c * s + atan_slope(c)))


@kernel
def load(w, near, normal, rays, perspective, level, row, first, step, count):
    """Set the receivers: `count` columns of a row, `step` apart; returns their major component.

    `rays` are am, bm, an, bn: a pixel's view ray is (am row + bm, an column + bn, -1).
    """
    am, bm, an, bn = rays
    major = np.float32(am * row + bm) if perspective else ZERO
    last = first + step * (count - 1) + 1
    q = near[row, first:last]
    na = normal[0, row, first:last]
    nb = normal[1, row, first:last]
    nc = normal[2, row, first:last]
    for i in range(count):
        w[NEAR + i] = q[step * i]
        w[NORMAL_A + i] = na[step * i]
        w[NORMAL_B + i] = nb[step * i]
        w[NORMAL_V + i] = nc[step * i]
    per = np.float32(an * step)
    begin = np.float32(an * first + bn)
    tilt = level * np.float32(-an)
    for i in range(count):
        minor = begin + per * np.float32(i) if perspective else ZERO
        height = w[NEAR + i]
        length = np.sqrt(ONE + major * major + minor * minor)
        spread = ONE / height if perspective else ONE
        nv = (w[NORMAL_V + i] - w[NORMAL_A + i] * major - w[NORMAL_B + i] * minor) / length
        w[NEAR + i] = height + abs(height) * ROUNDING
        w[MINOR + i] = minor
        w[LENGTH + i] = length
        w[SPREAD + i] = spread
        w[NORMAL_V + i] = nv
        w[RISE + i] = tilt * w[NORMAL_B + i] / (nv * length * spread)
    return major


@kernel
def aim(w, count, major, da, db, side, wedge):
    """Turn to a direction, and start the horizon at the tangent plane.

    A row along the direction adds `side` (da, db) to the view ray, (da, db) being a unit vector;
    `wedge` is the angle of the image plane that the direction stands for.
    """
    for i in range(count):
        length = w[LENGTH + i]
        along = major * da + w[MINOR + i] * db
        square = length * length - along * along
        width = np.sqrt(square)
        nv = w[NORMAL_V + i]
        nu = (w[NORMAL_A + i] * da + w[NORMAL_B + i] * db + along / length * nv) * length / width
        flat = -nu / nv
        w[A + i] = length * length * w[SPREAD + i] / (width * side)
        w[B + i] = -along / width
        w[SIDE + i] = width * side / length
        w[NORMAL_U + i] = nu
        w[TURN + i] = wedge * length / square
        w[FLAT + i] = flat
        w[START + i] = flat
        w[TOP + i] = flat
        w[CLOSED + i] = ZERO


@kernel
def thin(w, thinned, first, count):
    """Copy every third receiver, from lane `first` on; returns how many."""
    found = (count - first + 2) // 3
    for quantity in range(0, CLOSED + LANES, LANES):
        for m in range(found):
            thinned[quantity + m] = w[quantity + first + 3 * m]
    for m in range(found):
        thinned[RISE + m] = w[RISE + first + 3 * m]
    return found


@kernel
def finish(w, count, plain, step, closed, whole):
    """Add what the block found, and what there is, to every `step`-th of two rows."""
    for i in range(count):
        nu, nv = w[NORMAL_U + i], w[NORMAL_V + i]
        turn = w[TURN + i]
        done = w[CLOSED + i]
        if plain:
            done += below(w[TOP + i], nu, nv) - below(w[START + i], nu, nv)
        w[SEEN + i] = turn * done
        w[FROM + i] = turn * (HALF * (nv + nu * HALF_PI) - below(w[FLAT + i], nu, nv))
    for i in range(count):
        closed[step * i] += w[SEEN + i]
        whole[step * i] += w[FROM + i]


@kernel
def leave(w, count, step, first, border, slope, columns, per_radius, unknown):
    """Add to every `step`-th of a row the open directions that leave the image before the radius.

    The image ends `border` rows away, and at columns 0 and `columns` - 1, which a ray nears by
    `slope` a row; `first` is the first receiver's column. Where a ray leaves, one over its distance
    from the view ray is e0 + e1 c, so distances below the radius are an interval of angles.
    """
    per = np.float32(1.0 / max(abs(slope), 1e-12))
    here = np.float32(columns - 1 - first if slope > 0.0 else first) * per
    ahead = np.float32(-step if slope > 0.0 else step) * per
    most = np.float32(border)
    for i in range(count):
        rows = here + ahead * np.float32(i)
        rows = rows if rows < most else most
        rows = TINY if rows < TINY else rows
        side = w[SIDE + i]
        e1 = ONE / (w[A + i] * side)
        e0 = w[NEAR + i] / (side * rows) - w[B + i] * e1
        size = np.sqrt(e0 * e0 + e1 * e1)
        cosine = per_radius / size
        sine = np.sqrt(ONE - cosine * cosine) if cosine < ONE else ZERO
        # The rays are those within `cosine` of the angle whose cotangent is e1 / e0.
        low_sine = e0 * cosine + e1 * sine
        low = (e1 * cosine - e0 * sine) / low_sine
        high_sine = e0 * cosine - e1 * sine
        high = (e1 * cosine + e0 * sine) / high_sine
        high = high if high_sine > ZERO else HUGE
        low = low if low > w[TOP + i] else w[TOP + i]
        nu, nv = w[NORMAL_U + i], w[NORMAL_V + i]
        lost = w[TURN + i] * (below(high, nu, nv) - below(low, nu, nv))
        lost = lost if cosine < ONE else ZERO
        lost = lost if low_sine > ZERO else ZERO
        w[SEEN + i] = lost if high > low else ZERO
    for i in range(count):
        unknown[step * i] += w[SEEN + i]
