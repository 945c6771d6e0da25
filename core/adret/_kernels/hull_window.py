"""Far field within a limited range: the sweep of `hull_sweep` over a sliding window of each line.

A hull cannot forget a vertex: what it hid would have to come back. So each line is cut, on the
global grid, into blocks as long as the reach. The samples in reach of a receiver are then the tail
of one block and the head of the next. The head's hull grows as in `hull_sweep`. The tail's hull is
built once a block, from its near end outwards, with a log of what each insertion overwrote; as the
receiver moves on, the farthest samples fall out of reach and their insertions are undone, each in
O(1). A cell's result depends on nothing beyond its reach, so that a window of the raster with a
halo as wide gives the same bytes as the whole.
"""

import numpy as np

from adret._kernels.hull_sweep import (
    NOTHING,
    first_line,
    gather_rows,
    pool_samples,
    strips,
)
from adret._kernels.jit import helper, shared_kernel


@helper
def _build_tail(heights, positions, count, bend, tail_z, tail_s, sizes, log_slot, log_z, log_s):
    """Hull of a finished block, nearest sample in slot 0, logging what each insertion overwrote."""
    for line in range(heights.shape[1]):
        k = 0
        for back in range(count):
            pool = count - 1 - back
            z = heights[pool, line]
            log_slot[pool, line] = -1
            if z == NOTHING:
                continue
            s = positions[pool, line]
            z -= bend * s * s
            while k > 1:
                # The last vertex goes when it lies on or below the line from the one before.
                run = tail_s[k - 2, line] - s
                part = tail_s[k - 2, line] - tail_s[k - 1, line]
                rise = z - tail_z[k - 2, line]
                if (tail_z[k - 1, line] - tail_z[k - 2, line]) * run > rise * part:
                    break
                k -= 1
            log_slot[pool, line] = k
            log_z[pool, line] = tail_z[k, line]
            log_s[pool, line] = tail_s[k, line]
            tail_z[k, line] = z
            tail_s[k, line] = s
            k += 1
            sizes[pool, line] = k


@helper
def _query(
    heights,
    positions,
    last,
    reach,
    near,
    observer,
    bend,
    shift,
    head_z,
    head_s,
    head_size,
    tail_z,
    tail_s,
    tail_sizes,
    log_slot,
    log_z,
    log_s,
    oldest,
    tail_count,
    vertex_z,
    vertex_s,
):
    """Forget what is out of reach, find the tangent over tail and head, push onto the head."""
    for line in range(len(heights)):
        z = heights[line]
        # Undo the tail's farthest insertions, in the order opposite to theirs.
        j = oldest[line]
        while j < tail_count:
            slot = log_slot[j, line]
            if slot >= 0:
                if last - tail_s[slot, line] <= reach:
                    break
                tail_z[slot, line] = log_z[j, line]
                tail_s[slot, line] = log_s[j, line]
            j += 1
        oldest[line] = j
        if z == NOTHING:
            vertex_z[line] = NOTHING
            continue
        s = positions[line]
        z -= bend * s * s
        eye = z + observer
        found = NOTHING
        away = np.float32(1.0)
        at = np.float32(-1.0)
        top = NOTHING
        k = tail_sizes[j, line] if j < tail_count else 0
        if k > 0:
            # The first vertex beyond the near field from which the next one is no higher.
            q = 0
            high = k - 1
            while q < high:
                middle = (q + high) // 2
                if s - tail_s[middle, line] <= near or (tail_z[middle + 1, line] - eye) * (
                    s - tail_s[middle, line]
                ) >= (tail_z[middle, line] - eye) * (s - tail_s[middle + 1, line]):
                    q = middle + 1
                else:
                    high = middle
            if s - tail_s[q, line] > near:
                top = tail_z[q, line]
                at = tail_s[q, line]
                found = top - eye
                away = s - at
        k = head_size[line]
        if k > 0:
            rise = head_z[k - 1, line] - z
            run = s - head_s[k - 1, line]
            while k > 1:
                next_rise = head_z[k - 2, line] - z
                next_run = s - head_s[k - 2, line]
                if next_rise * run < rise * next_run:
                    break
                k -= 1
                rise = next_rise
                run = next_run
            q = k - 1
            if observer > 0.0:
                while q > 0 and (head_z[q - 1, line] - eye) * (s - head_s[q, line]) >= (
                    head_z[q, line] - eye
                ) * (s - head_s[q - 1, line]):
                    q -= 1
            while q >= 0 and s - head_s[q, line] <= near:
                q -= 1
            if q >= 0 and (head_z[q, line] - eye) * away > found * (s - head_s[q, line]):
                top = head_z[q, line]
                at = head_s[q, line]
        vertex_z[line] = top + bend * at * at
        vertex_s[line] = at + shift
        head_s[k, line] = s
        head_z[k, line] = z
        head_size[line] = k + 1


@shared_kernel(strips)
def hull_sweep_within(
    first_strip,
    end_strip,
    z,
    pad,
    width,
    t,
    anchor,
    strip_width,
    pool,
    near,
    bend,
    limits,
    block,
    high,
    corner,
    rows,
    columns,
    best,
    distance,
):
    """Raise `best` by the far horizon within ``limits[4]`` steps.

    Parameters are those of `hull_sweep`, and `block`, the pools a block: block · pool steps are no
    fewer than the reach plus a pool.
    """
    reach = limits[4]
    height_of_block = block * pool
    for strip in range(first_strip, end_strip):
        first = first_line(t, anchor, strip_width, strip, rows, columns)
        lines = strip_width + 1
        heights = np.empty((block, lines), np.float32)
        positions = np.zeros((block, lines), np.float32)
        head_z = np.empty((block + 1, lines), np.float32)
        head_s = np.empty((block + 1, lines), np.float32)
        head_size = np.zeros(lines, np.int64)
        tail_z = np.empty((block + 1, lines), np.float32)
        tail_s = np.empty((block + 1, lines), np.float32)
        tail_sizes = np.zeros((block, lines), np.int64)
        log_slot = np.full((block, lines), -1)
        log_z = np.empty((block, lines), np.float32)
        log_s = np.empty((block, lines), np.float32)
        oldest = np.zeros(lines, np.int64)
        vertex_z = np.full(lines, NOTHING)
        vertex_s = np.full(lines, np.float32(-1.0))
        tail_count = 0
        # The first block that can be in reach of the first receiver.
        origin = (rows[0] + anchor) // height_of_block * height_of_block - anchor
        origin -= height_of_block
        while origin < rows[1]:
            # Positions count from the block before, so that they do not depend on the window.
            shift = np.float32(origin - height_of_block)
            head_size[:] = 0
            for j in range(block):
                begin = origin + j * pool
                start = max(begin, 0)
                stop = min(begin + pool, z.shape[0] - pad[0])
                pool_samples(z, pad, t, anchor, first, width, start, stop, heights[j], positions[j])
                for line in range(lines):
                    positions[j, line] -= shift
                _query(
                    heights[j],
                    positions[j],
                    np.float32(begin + pool - 1) - shift,
                    reach,
                    near,
                    limits[0],
                    bend,
                    shift,
                    head_z,
                    head_s,
                    head_size,
                    tail_z,
                    tail_s,
                    tail_sizes,
                    log_slot,
                    log_z,
                    log_s,
                    oldest,
                    tail_count,
                    vertex_z,
                    vertex_s,
                )
                gather_rows(
                    z,
                    pad,
                    t,
                    anchor,
                    first,
                    start,
                    stop,
                    high,
                    corner,
                    rows,
                    columns,
                    vertex_z,
                    vertex_s,
                    limits,
                    best,
                    distance,
                )
                if stop >= rows[1]:
                    break
            # The finished block becomes the tail; its positions now count from its own start.
            for j in range(block):
                for line in range(lines):
                    positions[j, line] -= np.float32(height_of_block)
            _build_tail(
                heights,
                positions,
                block,
                bend,
                tail_z,
                tail_s,
                tail_sizes,
                log_slot,
                log_z,
                log_s,
            )
            oldest[:] = 0
            tail_count = block
            origin += height_of_block
