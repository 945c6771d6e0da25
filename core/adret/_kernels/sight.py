"""Lines of sight from a cell: exact crossings with the grid, and bounds that leave few to look at.

A segment between two cell centres crosses grid lines at fractions of whole numbers. Multiplied by
the denominator, the height of a crossing is a sum of two products that float64 holds exactly, and
the verdict is the same, bit for bit, from both ends of the segment.

Rays are walked by octant: x counts steps along the major axis and y along the minor one, both from
the observer, 0 <= y <= x. Two strides lead from (x, y) into the flat, row-major array of heights.
"""

import math

import numpy as np

from adret._kernels.jit import prange, strict_kernel, strict_parallel_kernel

SNAP = 1e-9  # cells by which the edges of a wedge are moved outwards


@strict_kernel
def surface(before, after, share, count):
    """Height between two vertices, `share`/`count` of the way, times `count`.

    A crossing in a vertex does not touch the other one, which may be nodata.
    """
    if share == 0:
        return count * np.float64(before)
    return (count - share) * np.float64(before) + share * np.float64(after)


@strict_kernel
def judge(height, along, way, bent, eye, aim):
    """Judge a crossing `along`/`way` of the way to the target, `height`/`way` high.

    `bent` is what curvature takes from the target. Returns whether the crossing rises above the
    line of sight, and the height that the target would need to be seen above it.
    """
    sag = bent * (along * (way - along)) / way
    start = (way - along) * eye
    return height > start + along * aim - sag, (height + sag - start) / along


@strict_kernel
def wedge_bounds(z, home, major, minor, side, n, low, top, eye, drop_least, drop_most):
    """Bounds over the rays low <= y/x <= top of their highest crossing with n - 1 < x <= n.

    Crossings are ranked by (height - eye)/x - drop x, as the observer sees them. Returns the upper
    and the lower bound; the latter is -inf where some ray may meet nothing.
    """
    # The grid line x = n: the surface is linear between vertices.
    line = home + n * major
    y1 = n * low
    y2 = n * top
    first = np.int64(y1 + SNAP)
    last = np.int64(y2 + SNAP)
    highest = -np.inf
    lowest = np.inf
    for y in range(first, min(last, side) + 1):
        at = line + y * minor
        height = np.float64(z[at])
        if y == first and y1 - first > SNAP:
            if y == side:
                break
            height += (y1 - first) * (np.float64(z[at + minor]) - height)
        if height > highest:
            highest = height
        if not height >= lowest:
            lowest = height if lowest == lowest else lowest
    inside = last <= side
    if y2 - last > SNAP:
        inside = last < side
        if inside:
            at = line + last * minor
            height = np.float64(z[at])
            height += (y2 - last) * (np.float64(z[at + minor]) - height)
            if height > highest:
                highest = height
            if not height >= lowest:
                lowest = height if lowest == lowest else lowest
    high = (highest - eye) / n - drop_least * n
    sure = -np.inf
    if inside and lowest == lowest:
        sure = (lowest - eye) / n - drop_most * n
    # Grid lines of whole y between x = n - 1 and x = n: no maximum lies within.
    start = n - 1.0
    if n > 1:
        end = min(np.int64(math.ceil(y2 - SNAP)) - 1, side)
        for y in range(np.int64(start * low + SNAP) + 1, end + 1):
            nearer = max(start, y / top)
            farther = np.float64(n)
            if y < n * low:
                farther = y / low
            at = line - major + y * minor
            height = np.float64(z[at])
            rise = np.float64(z[at + major]) - height
            one = (height + rise * (nearer - start) - eye) / nearer
            other = (height + rise * (farther - start) - eye) / farther
            most = (one if one > other else other) - drop_least * nearer
            if most > high:
                high = most
            if start < nearer and farther < n:
                least = (other if one > other else one) - drop_most * farther
                if least > sure:
                    sure = least
    return high, sure


@strict_kernel
def is_level(z, home, major, minor, side, n, low, top, eye):
    """Whether all vertices of the crossings of `wedge_bounds` are exactly as high as the eye."""
    last = np.int64(math.ceil(n * top - SNAP))
    if last > side:
        return False
    for y in range(np.int64((n - 1) * low + SNAP), last + 1):
        at = home + n * major + y * minor
        if z[at] != eye or z[at - major] != eye:
            return False
    return True


@strict_kernel
def walk_wedge(
    z,
    home,
    row,
    eye,
    target,
    bend,
    limit,
    slack,
    octant,
    drop,
    k,
    widths,
    norths,
    step,
    bound,
    visible,
    above,
):
    """Walk outwards along one wedge and judge its targets, at most one a step.

    `step` and `bound` are scratch: the crossings that may be the highest of some ray so far.
    """
    major, minor, reach, side = octant[0], octant[1], octant[2], octant[3]
    wedges, rows_x, rows_y = octant[4], octant[5], octant[6]
    diagonal, axis = octant[7], octant[8]
    # The wedge of the rays with k/wedges <= y/x < (k + 1)/wedges.
    low = k / wedges
    top = min((k + 1) / wedges, 1.0)
    drop_least = drop[0] + drop[1] * low * low
    drop_most = drop[2] + drop[3] * top * top
    listed = 0
    bar = -np.inf  # what the highest crossing of every ray reaches
    level = False  # whether crossings at the height of the eye are listed: more of them add nothing
    for n in range(1, reach + 1):
        y = (k * n + wedges - 1) // wedges
        if y > side:
            break
        if y * wedges < (k + 1) * n and y < n + diagonal and y + axis > 0:
            at = home + n * major + y * minor
            other = row + n * rows_x + y * rows_y
            across = n if rows_x == 0 else y
            far = norths[other] + across * across * widths[other]
            ground = np.float64(z[at])
            if far <= limit and ground == ground:
                aim = ground + target
                bent = bend * far
                per_step = 1.0 / n
                need = -np.inf
                free = True
                kept = 0
                for i in range(listed + 1):
                    s = n
                    q = y
                    m = np.int64(0)
                    if i < listed:
                        s = step[i]
                        highest = bound[i]
                        if highest < bar:
                            continue
                        step[kept] = s
                        bound[kept] = highest
                        kept += 1
                        if eye + bent + n * highest < need:
                            continue
                        # Where the ray meets the grid line x = s: at y = q + m/n.
                        q = np.int64(y * s * per_step)
                        m = y * s - q * n
                        if m < 0:
                            q -= 1
                            m += n
                        elif m >= n:
                            q += 1
                            m -= n
                        on = home + s * major + q * minor
                        height = surface(z[on], z[on + minor] if m > 0 else z[on], m, n)
                        over, must = judge(height, s, n, bent, eye, aim)
                        if over:
                            free = False
                        if must > need:
                            need = must
                    # The grid line of whole y that it met on the way there from x = s - 1.
                    r = q if m > 0 else q - 1
                    share = r * n - y * (s - 1)
                    if r > 0 and share > 0:
                        on = home + (s - 1) * major + r * minor
                        height = surface(z[on], z[on + major], share, y)
                        over, must = judge(height, r, y, bent, eye, aim)
                        if over:
                            free = False
                        if must > need:
                            need = must
                listed = kept
                visible[at] = free
                above[at] = np.float32(max(need - ground, 0.0))
        high, sure = wedge_bounds(
            z, home, major, minor, side, n, low, top, eye, drop_least, drop_most
        )
        margin = slack / n
        if sure - margin > bar:
            bar = sure - margin
        if high == 0.0 and sure == 0.0 and is_level(z, home, major, minor, side, n, low, top, eye):
            if level:
                continue
            level = True
        if high + margin >= bar:
            step[listed] = n
            bound[listed] = high + margin
            listed += 1


@strict_parallel_kernel
def see_from(
    z,
    home,
    row,
    eye,
    target,
    bend,
    limit,
    slack,
    octants,
    drops,
    tasks,
    widths,
    norths,
    visible,
    above,
):
    """All targets of one observer: whether seen, and the height above ground at which they are.

    `octants` holds, a row each: stride of x, stride of y, reach of x, reach of y, number of wedges,
    rows a step of x, rows a step of y, 1 if the diagonal belongs to it, 1 if the axis does. `drops`
    holds the fall by curvature [m a squared step] along the axis and what a step aside adds to it,
    smallest and largest, by octant; `tasks` (octant, first wedge, last wedge + 1). `widths` and
    `norths` are the squared width of a column and the squared way north [m²], by row. `limit` is
    the squared range, `slack` [m] more than any rounding error.
    """
    for t in prange(len(tasks)):
        o = tasks[t, 0]
        step = np.empty(octants[o, 2] + 1, np.int64)
        bound = np.empty(octants[o, 2] + 1, np.float64)
        for k in range(tasks[t, 1], tasks[t, 2]):
            walk_wedge(
                z,
                home,
                row,
                eye,
                target,
                bend,
                limit,
                slack,
                octants[o],
                drops[o],
                k,
                widths,
                norths,
                step,
                bound,
                visible,
                above,
            )


@strict_kernel
def profile(z, home, major, minor, n, y, bent, eye, aim, along, height, over, need):
    """All crossings of one line of sight in order; returns their number.

    Fills the share of the way, the height of the surface, whether it rises above the line, and the
    height that the target would need to be seen above it.
    """
    found = 0
    for s in range(1, n + 1):
        q = y * s // n
        m = y * s - q * n
        r = q if m > 0 else q - 1
        share = r * n - y * (s - 1)
        if r > 0 and share > 0:
            on = home + (s - 1) * major + r * minor
            raised = surface(z[on], z[on + major], share, y)
            along[found] = r / y
            height[found] = raised / y
            over[found], need[found] = judge(raised, r, y, bent, eye, aim)
            found += 1
        if s < n:
            on = home + s * major + q * minor
            raised = surface(z[on], z[on + minor] if m > 0 else z[on], m, n)
            along[found] = s / n
            height[found] = raised / n
            over[found], need[found] = judge(raised, s, n, bent, eye, aim)
            found += 1
    return found
