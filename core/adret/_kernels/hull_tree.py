"""The convex-hull tree of paper P2: the local horizons of every sample of a line, incrementally.

After Timonen 2012 (paper P2: sections 4, 5 and 7, algorithms 1 to 3; the thesis's appendix A.2).
Each convex stretch of a line starts a hull path that ends in the receiver, the tree's root; paths
share their nodes, and the root's children are the tangent points: from each of them the terrain is
seen until the next nearer one hides it. A new sample becomes the root over the old one, and paths
are made convex again from the root down.

- Nodes are sample numbers; `child` is the first (farthest, highest) child, `sibling` the next one.
- The repair is a walk on an explicit stack that appends the root's children from far to near.
- A node that starts a stretch (`leaf`) stays for good, any other goes with its last child.
- `zone` is the paper's safe zone: the height below which, between two distances, no grandchild of
  the root can rise over its parent. A sample in it that hides the old root takes its place.

Of collinear samples the farthest is the tangent point. A sample without data (NaN) is no node; the
one after a gap starts a stretch. Heights are whole numbers (see `sight_lines`), so that every
comparison but the zone's is exact, and the zone keeps a margin.
"""

import numpy as np

from adret._kernels.jit import index, kernel

ZONE = 32.0  # steps that a safe zone is long
MARGIN = 8.0  # quanta: far above the rounding of a line continued over a zone


@kernel
def seen_from_eye(e, sn, m, h, s, child, sibling, leaf, kids, stack, later, found, at):
    """Local horizons of an eye that is no sample: the repair that its tree would need, undone.

    The eye is at height `e` and step `sn`; `kids` are the m nodes to start at, far to near. Writes
    from found[at] on; returns the end.
    """
    for q in range(m):
        cur = index(kids[index(q)])
        hc = h[cur] - e
        dc = sn - s[cur]
        top = index(0)
        c = child[cur]
        while True:
            while c >= 0:
                k = index(c)
                hk = h[k] - e
                dk = sn - s[k]
                if hk * dc < hc * dk:
                    break
                if sibling[k] >= 0 or leaf[cur]:
                    stack[top] = cur
                    later[top] = sibling[k]
                    top += index(1)
                cur = k
                hc = hk
                dc = dk
                c = child[k]
            b = cur - index(1)
            beyond = (h[b] - e) * dc >= hc * (sn - s[b])
            if (c >= 0 or leaf[cur]) and not beyond:
                found[at] = cur
                at += index(1)
            if top == 0:
                break
            top -= index(1)
            cur = index(stack[top])
            c = later[top]
            hc = h[cur] - e
            dc = sn - s[cur]
    return at


@kernel
def list_by_tree(
    place,
    count,
    gap,
    eye,
    eyes,
    h,
    s,
    child,
    sibling,
    leaf,
    kids,
    stack,
    later,
    state,
    zone,
    found,
    bounds,
    work,
):
    """List the local horizons of receivers from `place` on, until `found` may not hold more.

    Written out in one piece: a call with arrays in the loop over samples costs as much as the loop.

    Parameters
    ----------
    place, count : int
        First receiver to do, from 1; last sample of the line.
    gap : int
        0: receivers are the samples. Otherwise a receiver sees samples from `gap` steps on, and its
        eye is at the height that `eyes` has for its place, NaN for no receiver.
    eye : float
        Height of the eye above the sample [quanta], if there is no gap.
    eyes : (count + 1,) float64
        Heights [quanta], if there is a gap.
    h, s : float64
        Heights [quanta], NaN for none, also at place 0; steps.
    child, sibling, kids, stack, later : int32; leaf : uint8
        The tree, the root's children (far to near), and the stack.
    state : (4,) int64
        Root; whether its stretch is concave; number of its children.
    zone : (4,) float64
        Safe zone: from, to, height at its start, rise a step.
    found, bounds : int32, int64
        Output: samples that are local horizons, far to near; those of receiver n are
        found[bounds[n]] to found[bounds[n + 1]].
    work : (3,) int64
        Raised by the convexity checks made, by the children of every root, and by the roots that
        took the old one's place.

    Returns
    -------
    int
        First receiver that is not done.
    """
    if place == 1:
        state[:] = 0
    r = index(state[0])
    concave = state[1]
    m = index(state[2])
    zone_from = zone[0]
    zone_to = zone[1]
    zone_height = zone[2]
    zone_rise = zone[3]
    nearest = np.empty(1, np.int32)
    checks = 0
    children = 0
    taken = 0
    at = index(0)
    room = index(len(found) - count)
    receiver = place
    while receiver <= count and at <= room:
        bounds[receiver] = at
        n = index(max(receiver - gap, 0))
        hn = h[n]
        if hn == hn:
            child[n] = -1
            leaf[n] = 0
        if hn == hn and r == 0:
            r = n
        elif hn == hn:
            # Is the old root convex, and does it begin a stretch?
            sn = s[n]
            hr = h[r] - hn
            dr = sn - s[r]
            b = r - index(1)
            turn = hr * (sn - s[b]) - (h[b] - hn) * dr
            stays = False
            if turn != 0.0:
                # A sample behind a gap turns by NaN: it begins one.
                stays = (concave == 1 and turn > 0.0) or turn != turn
                leaf[r] = 1 if stays else 0
                concave = 1 if turn < 0.0 else 0
            # Does the new root just take the old one's place?
            replaced = False
            if sn <= zone_to and m > 0 and not stays:
                k = index(kids[m - index(1)])
                checks += 1
                replaced = (h[k] - hn) * dr >= hr * (sn - s[k]) and (
                    hn < zone_height + zone_rise * (sn - zone_from)
                )
            if replaced:
                child[n] = child[r]
                taken += 1
            else:
                m = index(0)
                low = np.inf
                low_later = np.inf
                cur = r
                hc = hr
                dc = dr
                top = index(0)
                last = n
                c = child[r]
                while True:
                    # Children that rise over their parent go to the root before it, and
                    # so do theirs.
                    while c >= 0:
                        k = index(c)
                        hk = h[k] - hn
                        dk = sn - s[k]
                        checks += 1
                        if hk * dc < hc * dk:
                            # The line from here over the parent, at the root and a zone further on.
                            rise = (hc - hk) / (dk - dc)
                            line = hc + rise * dc
                            low = min(low, line)
                            low_later = min(low_later, line + rise * ZONE)
                            break
                        after = sibling[k]
                        if after >= 0 or leaf[cur]:
                            stack[top] = cur
                            later[top] = after
                            top += index(1)
                        cur = k
                        hc = hk
                        dc = dk
                        c = child[k]
                    child[cur] = c
                    if c >= 0 or leaf[cur]:
                        if last == n:
                            child[n] = cur
                        else:
                            sibling[last] = cur
                        last = cur
                        kids[m] = cur
                        m += index(1)
                    if top == 0:
                        break
                    top -= index(1)
                    cur = index(stack[top])
                    c = later[top]
                    hc = h[cur] - hn
                    dc = sn - s[cur]
                sibling[last] = -1
                zone_from = sn
                zone_to = sn + ZONE
                zone_height = hn + low - MARGIN
                zone_rise = (low_later - low) / ZONE if low < np.inf else 0.0
            r = n
            children += m
        if gap > 0:
            e = eyes[index(receiver)]
            if e == e and r > 0:
                # The root is seen at any rate: is the sample beyond it seen, too?
                place_of_eye = s[index(receiver)]
                b = r - index(1)
                over = (h[b] - e) * (place_of_eye - s[r]) >= (h[r] - e) * (place_of_eye - s[b])
                kept = leaf[r]
                leaf[r] = 0 if over else 1
                nearest[0] = r
                at = seen_from_eye(
                    e, place_of_eye, 1, h, s, child, sibling, leaf, nearest, stack, later, found, at
                )
                leaf[r] = kept
        elif hn == hn and eye > 0.0:
            at = seen_from_eye(
                hn + eye, s[n], m, h, s, child, sibling, leaf, kids, stack, later, found, at
            )
        elif hn == hn:
            # Those from which the terrain beyond is not seen too; in rough terrain, every other
            # one, so without branches.
            for q in range(m):
                k = index(kids[index(q)])
                b = k - index(1)
                found[at] = k
                beyond = (h[b] - hn) * (s[n] - s[k]) >= (h[k] - hn) * (s[n] - s[b])
                at += index(0) if beyond else index(1)
        receiver += 1
    bounds[receiver] = at
    state[0] = r
    state[1] = concave
    state[2] = m
    zone[0] = zone_from
    zone[1] = zone_to
    zone[2] = zone_height
    zone[3] = zone_rise
    work[0] += checks
    work[1] += children
    work[2] += taken
    return np.int64(receiver)
