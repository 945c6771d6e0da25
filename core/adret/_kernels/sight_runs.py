"""What is seen, from the local horizons of samples: runs of samples that each end at one.

`found[bounds[n]]` to ``found[bounds[n + 1] - 1]`` are the local horizons of sample n, far to near.
A run is seen over the next nearer local horizon, the nearest one from the sample next to n on.
"""

import numpy as np

from adret._kernels.jit import index, kernel

BLOCK = 8


@kernel
def cut_at_reach(place, end, eye, reach, h, s, found, bounds):
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
            e = h[n] + eye
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
                near = n - index(1)
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
def sum_runs(place, end, eye, moment, h, s, found, bounds, value):
    """Number of samples seen, or with `moment` the sum of their distances [steps]."""
    for p in range(place, end):
        n = index(p)
        e = h[n] + eye
        total = 0.0
        stop = index(bounds[n + index(1)])
        for q in range(bounds[n], bounds[n + index(1)]):
            k = index(found[index(q)])
            far = s[n] - s[k]
            if q + 1 < stop:
                # From k on samples are seen, then hidden: a block is counted without branches.
                nearer = index(found[index(q + 1)])
                he = h[nearer] - e
                de = s[n] - s[nearer]
                length = index(1)
                k += index(1)
                while k < nearer:
                    # Beyond the nearer horizon, samples of its own run may be as high.
                    inside = nearer - k
                    seen = index(0)
                    for u in range(BLOCK):
                        v = k + index(u)
                        seen += index((h[v] - e) * de >= he * (s[n] - s[v])) & index(u < inside)
                    length += seen
                    if seen < index(BLOCK):
                        break
                    k += index(BLOCK)
            else:
                near = n - index(1)
                while h[near] != h[near]:
                    near -= index(1)
                length = near - k + index(1)
            total += length * (far - 0.5 * (length - 1.0)) if moment else length
        value[n] = total


@kernel
def farthest(place, end, eye, slope, h, s, found, bounds, value):
    """Way to the farthest sample seen [steps], 0 without one.

    With `slope`, the slope of the line of sight to it [quanta a step], -inf without one.
    """
    for p in range(place, end):
        n = index(p)
        if bounds[n] == bounds[n + index(1)]:
            value[n] = -np.inf if slope else 0.0
        else:
            k = index(found[bounds[n]])
            way = s[n] - s[k]
            value[n] = (h[k] - h[n] - eye) / way if slope else way


@kernel
def count_horizons(place, end, bounds, value):
    """Number of local horizons."""
    for p in range(place, end):
        n = index(p)
        value[n] = bounds[n + index(1)] - bounds[n]


@kernel
def copy_lists(place, end, found, bounds, start, lists):
    """Copy distances [steps] of the local horizons, near to far, to `start` of their sample.

    A sample whose start is -1 is no receiver to serve.
    """
    for p in range(place, end):
        n = index(p)
        size = bounds[n + index(1)] - bounds[n]
        if start[n] < 0:
            continue
        for q in range(size):
            lists[start[n] + q] = n - found[bounds[n] + size - 1 - q]
