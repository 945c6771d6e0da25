"""What is seen, from the local horizons of samples: runs of samples that each end at one.

`found[bounds[n]]` to ``found[bounds[n + 1] - 1]`` are the local horizons of receiver n, from far to
near. A run is seen over the next nearer local horizon. The nearest one is seen from the first
sample on, or over the wall: the line of sight that the near field leaves free, where one comes
before (gap > 0).
"""

import numpy as np

from adret._kernels.jit import index, kernel

BLOCK = 8


@kernel
def cut_at_reach(place, end, gap, eye, eyes, reach, h, s, found, bounds):
    """Drop horizons out of reach; a run that this cuts ends at its last sample within reach."""
    at = index(bounds[place])
    begin = index(bounds[place])
    for p in range(place, end):
        n = index(p)
        stop = index(bounds[n + index(1)])
        q = begin
        while q < stop and s[n] - s[index(found[q])] > reach:
            q += index(1)
        bounds[n] = at
        if q > begin:
            e = eyes[n] if gap > 0 else h[n] + eye
            limit = index(s[n] - reach)
            if s[n] - s[limit] > reach:
                limit += index(1)
            if q < stop:
                k = index(found[q])
                cut = k != limit and (h[limit] - e) * (s[n] - s[k]) >= (h[k] - e) * (
                    s[n] - s[limit]
                )
            else:
                # All is seen as far as the next gap, if the horizon dropped last is not beyond it.
                near = n - index(max(gap, 1))
                while near > limit and h[near] != h[near]:
                    near -= index(1)
                cut = h[near] == h[near] and near >= limit
            if cut:
                found[at] = limit
                at += index(1)
        begin = stop
        while q < stop:
            found[at] = found[q]
            at += index(1)
            q += index(1)
    bounds[end] = at


@kernel
def cut_at_wall(place, end, eyes, wall, h, s, found, bounds):
    """Drop horizons below the line of sight that rises by `wall` a step."""
    at = index(bounds[place])
    begin = index(bounds[place])
    for p in range(place, end):
        n = index(p)
        stop = index(bounds[n + index(1)])
        bounds[n] = at
        q = begin
        while q < stop:
            k = index(found[q])
            if h[k] - eyes[n] < wall[n] * (s[n] - s[k]):
                break
            found[at] = k
            at += index(1)
            q += index(1)
        begin = stop
    bounds[end] = at


@kernel
def seen_beyond(k, nearer, he, de, e, sn, h, s):
    """Number of samples from k on towards `nearer` that lie on or above the line of sight over
    height `he` at distance `de`.
    """
    length = index(1)
    k += index(1)
    while k < nearer:
        # From k on samples are seen, then hidden: a block is counted without branches. Beyond the
        # nearer horizon, samples of its own run may be as high.
        inside = nearer - k
        seen = index(0)
        for u in range(BLOCK):
            v = k + index(u)
            seen += index((h[v] - e) * de >= he * (sn - s[v])) & index(u < inside)
        length += seen
        if seen < index(BLOCK):
            break
        k += index(BLOCK)
    return length


@kernel
def sum_runs(place, end, gap, eye, eyes, wall, moment, h, s, found, bounds, value):
    """Add the number of samples seen, or with `moment` the sum of their distances [steps]."""
    for p in range(place, end):
        n = index(p)
        e = eyes[n] if gap > 0 else h[n] + eye
        total = 0.0
        stop = index(bounds[n + index(1)])
        for q in range(bounds[n], bounds[n + index(1)]):
            k = index(found[index(q)])
            far = s[n] - s[k]
            if q + 1 < stop:
                nearer = index(found[index(q + 1)])
                length = seen_beyond(k, nearer, h[nearer] - e, s[n] - s[nearer], e, s[n], h, s)
            elif gap > 0 and wall[n] > -np.inf:
                length = seen_beyond(k, n - index(gap - 1), wall[n], 1.0, e, s[n], h, s)
            else:
                near = n - index(max(gap, 1))
                while h[near] != h[near]:
                    near -= index(1)
                length = near - k + index(1)
            total += length * (far - 0.5 * (length - 1.0)) if moment else length
        value[n] += total


@kernel
def farthest(place, end, gap, eye, eyes, slope, h, s, found, bounds, value):
    """Put the way to the farthest sample seen [steps] where there is one.

    With `slope`, the slope of the line of sight to it [quanta a step].
    """
    for p in range(place, end):
        n = index(p)
        if bounds[n] < bounds[n + index(1)]:
            k = index(found[bounds[n]])
            e = eyes[n] if gap > 0 else h[n] + eye
            way = s[n] - s[k]
            value[n] = (h[k] - e) / way if slope else way


@kernel
def run_ends(n, gap, eyes, wall, open_run, h):
    """Whether the near field's last sample is seen and the far field's first one is not."""
    if not open_run[n]:
        return False
    return n <= index(gap) or not h[n - index(gap)] - eyes[n] >= wall[n] * gap


@kernel
def count_horizons(place, end, gap, eyes, wall, open_run, h, bounds, value):
    """Add the number of local horizons."""
    for p in range(place, end):
        n = index(p)
        value[n] += bounds[n + index(1)] - bounds[n]
        if gap > 0 and run_ends(n, gap, eyes, wall, open_run, h):
            value[n] += np.float32(1.0)


@kernel
def copy_lists(place, end, gap, eyes, wall, open_run, h, found, bounds, start, lists):
    """Copy distances [steps] of the local horizons, near to far, to `start` of their receiver.

    A receiver whose start is -1 is none to serve.
    """
    for p in range(place, end):
        n = index(p)
        size = bounds[n + index(1)] - bounds[n]
        at = start[n]
        if at < 0:
            continue
        if gap > 0 and run_ends(n, gap, eyes, wall, open_run, h):
            lists[at] = gap - 1
            at += 1
        for q in range(size):
            lists[at + q] = n - found[bounds[n] + size - 1 - q]
