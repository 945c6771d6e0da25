"""The naive walk: from every sample back along its line to its end, O(N) a sample (P2, section 1).

A sample is seen if no nearer one rises above the line of sight to it; one that just touches it does
not hide it. The comparison is that of `hull_tree`, exact, and so the results are the same.
"""

import numpy as np

from adret._kernels.jit import index, kernel


@kernel
def list_by_walk(place, count, gap, eye, eyes, wall, reach, h, s, found, bounds):
    """List the local horizons of receivers from `place` on; as `hull_tree.list_by_tree`.

    `reach` is the range [steps]: the walk ends there. `wall` is the slope [quanta a step] that it
    starts with, if there is a gap.
    """
    nearest = max(gap, 1)
    at = index(0)
    room = index(len(found) - count)
    n = index(place)
    while n <= count and at <= room:
        bounds[n] = at
        e = eyes[n] if gap > 0 else h[n] + eye
        if e == e:
            sn = s[n]
            steps = index(min(sn - s[1], reach))
            best = wall[n] if gap > 0 else -np.inf
            away = 1.0
            seen = False
            begin = at
            for back in range(nearest, steps + index(1)):
                j = n - index(back)
                hj = h[j] - e
                dj = sn - s[j]
                if hj * away >= best * dj:
                    best = hj
                    away = dj
                    seen = True
                elif seen:
                    found[at] = j + index(1)
                    at += index(1)
                    seen = False
            if seen and steps >= index(nearest):
                found[at] = n - steps
                at += index(1)
            # Far to near, as the tree has them.
            for q in range((at - begin) // index(2)):
                k = found[begin + index(q)]
                found[begin + index(q)] = found[at - index(1 + q)]
                found[at - index(1 + q)] = k
        n += index(1)
    bounds[n] = at
    return np.int64(n)


@kernel
def count_by_walk(count, eye, reach, h, s, value):
    """Number of samples that each sample of a line sees."""
    for p in range(1, count + 1):
        n = index(p)
        total = index(0)
        if h[n] == h[n]:
            e = h[n] + eye
            sn = s[n]
            steps = index(min(sn - s[1], reach))
            best = -np.inf
            away = 1.0
            for back in range(1, steps + index(1)):
                j = n - index(back)
                hj = h[j] - e
                dj = sn - s[j]
                if hj * away >= best * dj:
                    best = hj
                    away = dj
                    total += index(1)
        value[n] = total
