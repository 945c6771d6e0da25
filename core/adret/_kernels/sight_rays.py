"""What is seen along each cell's own ray: a walk of neighbouring receivers together.

For one azimuth the offsets and weights of a ray's crossings with the grid are the same for every
cell (see `adret.sweep` for the frame). A crossing with a row of the frame is a sample: it is seen
or not; one with a column can only hide. CHUNK receivers of a row walk together, BLOCK samples at a
time. A block that is nowhere as high as the lines of sight of any receiver is passed over; that
changes nothing.

A sample is seen if it is not lower than the line of sight over the highest crossing before it, by
more than heights in float32 and slopes computed from them are off by: on evenly sloping ground all
samples lie on one line. Arithmetic is rounded as written.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adret._kernels.jit import greater, index, inline, prange, strict_kernel, strict_parallel_kernel

HORIZONS = 0
SEEN = 1
MOMENT = 2
WAY = 3
SLOPE = 4
LISTS = 5
CHUNK = 128
GROUP = 4
BLOCK = 16
EVERY = 4  # rows of heights for one of the roof, of which so little is read that caches hold it
PAD = BLOCK + EVERY  # rows of NaN on the side that rays run to
LANES = 16  # chunks begin and end with whole groups of so many, which vector instructions take
SIDE = 48  # columns of NaN there: a group and a block are fewer
STRIP = 16  # rows of a task: they read nearly the same cells
COUNTERS = 3  # of each task: receivers, samples looked at, samples passed over
LOWEST = np.float32(-1e30)
ROUNDING = np.float32(1e-6)  # of slopes, for the bound of a block
LEEWAY = np.float32(2.0**-22)  # of heights and of slopes, as a share of them
STEEPEST = np.float32(1e30)  # no slope is
ZERO = np.float32(0.0)
# Where a chunk's state lies in its scratch array: one array needs few checks against aliasing.
HERE, BEST, WORD, OVER, TOTAL, OPEN = (index(i * CHUNK) for i in range(6))
ROUGH, LOOSE = index(6 * CHUNK), index(7 * CHUNK)
SCRATCH = 8 * CHUNK


class Ground(NamedTuple):
    """A raster turned for one octant, padded by PAD rows and SIDE columns."""

    z: NDArray[np.float32]  # (R * width,) heights, NaN where there is none
    width: int
    roof: NDArray[np.float32]  # (R / EVERY * width,) see `raise_roof`


class Steps(NamedTuple):
    """Crossings of a ray by distance, in blocks of BLOCK samples, those filled up to fours.

    The slope of a crossing is ``P (za - z) + Q (zb - z) + K``, NaN of one that fills up. BIT is
    what a sample that is seen adds to WORD: its bit in the word of its block, or for SEEN and
    MOMENT 1 and its distance; 0 for a crossing that only hides.
    """

    cells: NDArray[np.int64]  # (2 S,) A, B: offsets of the cells on either side
    numbers: NDArray[np.float32]  # (4 S,) P, Q, K, BIT
    starts: NDArray[np.int64]  # (blocks + 1,) first crossing of each block, and one after the last
    columns: NDArray[np.int64]  # (blocks * BLOCK + 1,) whole columns moved after 0, 1, ... rows
    bounds: NDArray[np.float32]  # (blocks, 3) PER_NEAR, PER_FAR, DROP
    count: int  # samples, without those of the filling
    rough: np.float32  # leeway of all heights [m]


# 1 over the distance of a block's first and last crossing [1/m]; and at the first, the surface's
# drop by curvature and the height of the eye [m].
PER_NEAR, PER_FAR, DROP = range(3)


@strict_parallel_kernel
def raise_roof(z, columns, wide, roof):
    """Fill `roof` with the highest cells that any block of a ray may lie between.

    Roof q is for blocks whose first sample lies in rows q·EVERY to q·EVERY + EVERY - 1 of the
    padded frame; its columns are those of rays in the last of these rows. `columns` are those that
    a ray has moved after 0, 1, ... PAD - 1 rows; its phase adds one, and the cell on the other side
    another. `wide` is scratch, as large as `z`.
    """
    rows, width = z.shape
    for r in prange(rows):
        row = z[r]
        out = wide[r]
        a = row[2:]
        b = row[1 : width - 1]
        c = row[: width - 2]
        out[:2] = LOWEST
        inner = out[2:]
        for x in range(len(inner)):
            inner[x] = greater(a[x], greater(b[x], greater(c[x], LOWEST)))
    for q in prange(PAD // EVERY, rows // EVERY):
        r = q * EVERY + EVERY - 1
        roof[q, :SIDE] = LOWEST
        out = roof[q, SIDE:]
        # A column crossed before the first sample has a cell of the row before.
        before = wide[min(r + 1, rows - 1), SIDE:]
        for x in range(len(out)):
            out[x] = before[x]
        for k in range(0, PAD, GROUP):
            s0, s1 = columns[k], columns[k + 1]
            s2, s3 = columns[k + 2], columns[k + 3]
            r0 = wide[r - k, SIDE - s0 : width - s0]
            r1 = wide[r - k - 1, SIDE - s1 : width - s1]
            r2 = wide[r - k - 2, SIDE - s2 : width - s2]
            r3 = wide[r - k - 3, SIDE - s3 : width - s3]
            for x in range(len(out)):
                top = greater(r0[x], greater(r1[x], out[x]))
                out[x] = greater(r2[x], greater(r3[x], top))


@strict_kernel
def loosen(per, start, stop, s):
    """Fill LOOSE with the leeway of slopes from this distance on."""
    for i in range(start, stop):
        x = index(i)
        off = abs(s[BEST + x]) * LEEWAY
        s[LOOSE + x] = s[ROUGH + x] * per + (off if off < STEEPEST else ZERO)


@strict_kernel
def can_rise(roof, at, drop, per_near, per_far, start, stop, s, bits):
    """Whether ground as high as the roof would be seen by any receiver, or could be a horizon.

    An infinite top gives an infinite difference, which is not negative.
    """
    for i in range(start, stop):
        x = index(i)
        top = s[BEST + x]
        up = roof[index(at) + x] - s[HERE + x]
        rise = up - drop
        bound = rise * (per_near if rise > ZERO else per_far)
        loose = s[ROUGH + x] * per_near + abs(top) * LEEWAY
        s[OVER + x] = bound + (abs(up) + drop) * per_near * ROUNDING + loose - top
    below = np.int32(-1)
    for i in range(start, stop):
        below &= bits[OVER + index(i)]
    return below >= 0  # not all of them are negative


@strict_kernel
def four_crossings(z, cells, numbers, c, base, start, stop, s):
    """Look at crossings c to c + 3 and add the bits of samples that are seen to WORD.

    The top rises to what it is for sure: it may be higher by the leeway.
    """
    f = index(base)
    u = index(2 * c)
    a0, b0 = f + index(cells[u]), f + index(cells[u + index(1)])
    a1, b1 = f + index(cells[u + index(2)]), f + index(cells[u + index(3)])
    a2, b2 = f + index(cells[u + index(4)]), f + index(cells[u + index(5)])
    a3, b3 = f + index(cells[u + index(6)]), f + index(cells[u + index(7)])
    u = index(4 * c)
    p0, q0, k0, bit0 = (
        numbers[u],
        numbers[u + index(1)],
        numbers[u + index(2)],
        numbers[u + index(3)],
    )
    u += index(4)
    p1, q1, k1, bit1 = (
        numbers[u],
        numbers[u + index(1)],
        numbers[u + index(2)],
        numbers[u + index(3)],
    )
    u += index(4)
    p2, q2, k2, bit2 = (
        numbers[u],
        numbers[u + index(1)],
        numbers[u + index(2)],
        numbers[u + index(3)],
    )
    u += index(4)
    p3, q3, k3, bit3 = (
        numbers[u],
        numbers[u + index(1)],
        numbers[u + index(2)],
        numbers[u + index(3)],
    )
    for i in range(start, stop):
        x = index(i)
        h = s[HERE + x]
        loose = s[LOOSE + x]
        top = s[BEST + x]
        slope = (z[a0 + x] - h) * p0 + (z[b0 + x] - h) * q0 + k0
        word = s[WORD + x] + (bit0 if slope + loose >= top else ZERO)
        top = greater(slope - loose, top)
        slope = (z[a1 + x] - h) * p1 + (z[b1 + x] - h) * q1 + k1
        word += bit1 if slope + loose >= top else ZERO
        top = greater(slope - loose, top)
        slope = (z[a2 + x] - h) * p2 + (z[b2 + x] - h) * q2 + k2
        word += bit2 if slope + loose >= top else ZERO
        top = greater(slope - loose, top)
        slope = (z[a3 + x] - h) * p3 + (z[b3 + x] - h) * q3 + k3
        s[WORD + x] = word + (bit3 if slope + loose >= top else ZERO)
        s[BEST + x] = greater(slope - loose, top)


@inline
def bits_of(word):
    """Number of bits set among the lower 16, in 32-bit arithmetic."""
    word = np.int32(word - np.int32((word >> 1) & 0x5555))
    word = np.int32(np.int32(word & 0x3333) + np.int32((word >> 2) & 0x3333))
    word = np.int32(np.int32(word + np.int32(word >> 4)) & 0x0F0F)
    return np.int32(np.int32(word + np.int32(word >> 8)) & 0x1F)


@strict_kernel
def keep_way(count, first, s, bits):
    """Distance of the last sample seen in a block [steps]."""
    for i in range(count):
        x = index(i)
        last = np.float32(first + (bits[WORD + x] >> 23) - 127)  # by the exponent
        s[TOTAL + x] = last if s[WORD + x] > ZERO else s[TOTAL + x]


@strict_kernel
def count_ends(count, length, s):
    """Number of runs of samples seen that end in a block of this length.

    OPEN tells whether the sample before the block is seen, and then that of the block's last one.
    """
    mask = np.int32((1 << length) - 1)
    for i in range(count):
        x = index(i)
        word = np.int32(np.int32(np.int32(s[WORD + x]) * np.int32(2)) + np.int32(s[OPEN + x]))
        s[OPEN + x] = np.float32(np.int32((word >> length) & 1))
        s[TOTAL + x] += np.float32(bits_of(np.int32(word & ~(word >> 1) & mask)))


@strict_kernel
def list_ends(count, first, length, s, start, lists):
    """As `count_ends`, and list the last steps of the runs, but not where `start` is negative."""
    for i in range(count):
        x = index(i)
        word = np.int64(s[WORD + x]) * 2 + np.int64(s[OPEN + x])
        s[OPEN + x] = np.float32((word >> length) & 1)
        ends = word & ~(word >> 1) & ((1 << length) - 1)
        step = first - 1
        while ends != 0 and start[i] >= 0:
            if ends & 1 == 1:
                lists[start[i] + np.int64(s[TOTAL + x])] = step
                s[TOTAL + x] += np.float32(1.0)
            ends >>= 1
            step += 1


@strict_kernel
def take_block(quantity, count, first, length, s, bits, start, lists):
    """Add what the words of a block say to TOTAL, and empty them; SEEN and MOMENT are sums."""
    if quantity in (SEEN, MOMENT, SLOPE):
        return
    if quantity == WAY:
        keep_way(count, first, s, bits)
    elif quantity == HORIZONS:
        count_ends(count, length, s)
    else:
        list_ends(count, first, length, s, start, lists)
    for i in range(count):
        s[WORD + index(i)] = ZERO


@strict_kernel
def walk(quantity, ground, steps, joined, i, lo, count, s, bits, start, lists, counters):
    """Walk the rays of `count` receivers from column `lo` of row i on."""
    z, width, roof = ground
    cells, numbers, starts, columns, bounds, last_sample, _ = steps
    base = (i + PAD) * width + SIDE + lo
    lanes = -(-count // LANES) * LANES
    blocks = len(bounds)
    pending = False  # whether runs may be open
    b = 0
    while b < blocks and b * BLOCK < i:
        first = 1 + b * BLOCK
        left = max(0, columns[first] - lo)  # receivers whose rays have left the raster
        if left >= count:
            break
        begin = left // LANES * LANES
        length = min(BLOCK, 1 + last_sample - first) if joined else BLOCK
        near, far, drop = bounds[b, PER_NEAR], bounds[b, PER_FAR], bounds[b, DROP]
        row = i + PAD - first
        aside = EVERY - 1 - row % EVERY
        at = row // EVERY * width + SIDE + lo - columns[max(first - aside, 0)]
        if b > 0 and not can_rise(roof, at, drop, near, far, begin, lanes, s, bits):
            counters[2] += BLOCK * (count - left)
            if pending:
                take_block(quantity, lanes, first, length, s, bits, start, lists)
                pending = False
        else:
            counters[1] += BLOCK * (count - left)
            if quantity != SLOPE:
                loosen(near, begin, lanes, s)
            for c in range(starts[b], starts[b + 1], GROUP):
                four_crossings(z, cells, numbers, c, base, begin, lanes, s)
            take_block(quantity, lanes, first, length, s, bits, start, lists)
            pending = quantity in (HORIZONS, LISTS)
        b += 1
    if pending and not (joined and b == blocks):
        take_block(quantity, lanes, 1 + b * BLOCK, BLOCK, s, bits, start, lists)


@strict_kernel
def _serve(
    task, quantity, ground, steps, joined, rows, columns, scale, out, best, open_run,
    offsets, lists, work,
):  # fmt: skip
    """One chunk of STRIP rows of `see_along_rays`; `work` is the task's."""
    chunks = (out.shape[1] + CHUNK - 1) // CHUNK
    chunk = task % chunks
    first = rows[0] + task // chunks * STRIP
    lo = max(chunk * CHUNK, columns[0])
    count = min((chunk + 1) * CHUNK, columns[1]) - lo
    s = np.zeros(SCRATCH, np.float32)
    bits = s.view(np.int32)
    start = np.full(CHUNK, -1, np.int64)
    for i in range(first, min(first + STRIP, rows[1]) if count > 0 else first):
        base = (i + PAD) * ground.width + SIDE + lo
        known = 0
        for x in range(CHUNK):
            h = ground.z[base + x] if x < count else np.float32(np.nan)
            here = h == h
            known += 1 if here else 0
            s[HERE + index(x)] = h if here else ZERO
            s[BEST + index(x)] = -np.inf if here else STEEPEST  # over which nothing is seen
            s[WORD + index(x)] = ZERO
            s[TOTAL + index(x)] = ZERO
            s[OPEN + index(x)] = ZERO
            s[LOOSE + index(x)] = ZERO
            s[ROUGH + index(x)] = abs(s[HERE + index(x)]) * LEEWAY + steps.rough
            if quantity == LISTS:
                start[x] = offsets[i, lo + x] if here else -1
        work[0] += known
        if known > 0:
            walk(
                quantity, ground, steps, joined, i, lo, count, s, bits, start, lists,
                work,
            )  # fmt: skip
        for x in range(count):
            total = s[TOTAL + index(x)]
            if quantity == SLOPE:
                total = s[BEST + index(x)]
            elif quantity in (SEEN, MOMENT):
                total = s[WORD + index(x)]
            if not joined:
                out[i, lo + x] += scale * total
            else:
                out[i, lo + x] = total
                best[i, lo + x] = s[BEST + index(x)]
                open_run[i, lo + x] = s[OPEN + index(x)] != ZERO


@strict_parallel_kernel
def see_along_rays(
    quantity, ground, steps, joined, rows, columns, scale, out, best, open_run, offsets, lists, work
):
    """Add scale·quantity of every cell to `out`, or write its local horizons to `lists`.

    Parameters
    ----------
    quantity : int
        HORIZONS: number of local horizons; SEEN: of samples seen; MOMENT: sum of their distances
        [steps]; WAY: to the farthest one [steps]; SLOPE: of the highest crossing, -inf without
        one; LISTS: distances of the local horizons, near to far [steps], and their number.
    ground, steps
        `Ground`, `Steps`.
    joined : bool
        Whether a far field follows. Then a run that holds the last step is not yet at its end,
        `out` is filled with the quantity instead, and `best` and `open_run` are filled.
    rows, columns : (2,) int64
        Receivers to serve, start and stop.
    scale : float
    out, best : (n, m) float32
        Output; `best` is the slope of the highest crossing, -inf without one.
    open_run : (n, m) bool
        Output of HORIZONS and LISTS: whether the sample of the last step is seen.
    offsets, lists : (n, m) int64, (total,) int32
        Where each cell's list starts; empty unless LISTS.
    work : (tasks, COUNTERS) int64
        Raised by receivers, samples looked at, and samples passed over.
    """
    for task in prange(len(work)):
        _serve(
            task, quantity, ground, steps, joined, rows, columns, scale, out, best, open_run,
            offsets, lists, work[task],
        )  # fmt: skip
