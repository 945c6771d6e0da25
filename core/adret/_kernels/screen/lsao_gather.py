"""Line-sweep ambient obscurance: from the lines' samples to pixels (P3, section 5)."""

from typing import Any

import numpy as np

from adret._kernels.jit import index, kernel, shared_kernel
from adret._kernels.screen.falloffs import TABLE, in_singles, weight
from adret._kernels.vectors import turn_eight

FAR = np.float32(1e18)  # its square is a float32, too
BAND = 8  # rows a task: neighbouring rows have the same nearest samples
TURNED = 16  # rows a task of what is transposed back: a line of the cache
ONE = np.float32(1.0)
NONE = np.float32(0.0)


@kernel
def _look_up(depth, value, starts, shift, near, found, at_depth):
    """The nearest line's obscurance and depth for each pixel of a row."""
    last = len(depth) - 1
    for x in range(len(found)):
        line = index(near[x])
        column = starts[line] + shift
        inside = min(max(column, 0), last)
        found[x] = value[line] if inside == column else np.float32(np.nan)
        at_depth[x] = depth[index(inside)]


@kernel
def _take_nearest(z, nearest, at_depth, edge, perspective, apart, found):
    """Copy the nearest samples; mark those of another surface, and missing ones, where one is due.

    `apart` is as long as the row rounded up to a multiple of 8.
    """
    limit = np.float32(edge)
    one = np.float32(1.0)
    for x in range(len(z)):
        near = abs(at_depth[x] - z[x]) <= limit * (z[x] if perspective else one)
        apart[x] = (z[x] == z[x]) & (not (near & (nearest[x] == nearest[x])))
        found[x] = nearest[x]


@kernel
def _repair(
    z, apart, depth, values, starts, sample_rows, shifts, samples, near_lines, lowest, first, found
):
    """Where marked, take of the nearest four samples the one that is nearest in depth."""
    last = depth.shape[1] - 1
    eights = apart.view(np.uint64)
    for eight in range(len(eights)):
        if eights[eight] == 0:
            continue
        for x in range(8 * eight, min(8 * eight + 8, len(z))):
            if apart[x] == 0:
                continue
            best = np.float32(np.inf)
            taken = np.float32(np.nan)
            for i in samples:
                shift = shifts[i]
                for line in near_lines[:, first + x - shift - lowest]:
                    column = starts[line] + shift
                    if 0 <= column <= last and values[i, line] == values[i, line]:
                        gap = abs(depth[sample_rows[i], column] - z[x])
                        if gap < best:
                            best = gap
                            taken = values[i, line]
            found[x] = taken


@kernel
def _steps_to_edge(n, m, row, column, down, slant):
    """Major steps against the sweep to the edge of an n by m image: at most; at first; a pixel."""
    most = row + 0.5 if down else n - row - 0.5
    back = -slant if down else slant
    some = most
    more = 0.0
    if back > 0.0:
        some = (m - column - 0.5) / back
        more = -1.0 / back
    elif back < 0.0:
        some = -(column + 0.5) / back
        more = -1.0 / back
    return np.float32(most), np.float32(some), np.float32(more)


@kernel
def _weigh_by_table(z, places, steps, per_step, perspective, falloff, table, at_edge):
    """W at the distance where each pixel's way against the sweep leaves the image."""
    most, some, more = steps
    for x in range(len(z)):
        way = min(some + more * places[x], most) * per_step
        way = min(way * (z[x] if perspective else ONE), FAR)
        at_edge[x] = weight(TABLE, falloff[1], falloff[0], table, np.float64(way))


@kernel
def _weigh(z, places, steps, per_step, perspective, falloff, at_edge):
    """The same by the falloff's formula, in float32."""
    most, some, more = steps
    a, b, c, e, limit = falloff
    for x in range(len(z)):
        way = some + more * places[x]
        way = (way if way < most else most) * per_step * (z[x] if perspective else ONE)
        way = way if way < FAR else FAR
        d2 = way * way
        w = (a + b * d2) / (c + e * d2)
        at_edge[x] = w if d2 < limit else NONE


@kernel
def _add(found, places, at_edge, share, across, across_per_column, total, undecided, weights):
    """Add a direction's obscurance, and what it left undecided, by the azimuth that it stands for.

    Seen from a pixel, directions of the image crowd where they point away from its middle: by
    1 + p², p being their line's distance from there on the plane at depth 1.
    """
    for x in range(len(found)):
        p = across + across_per_column * places[x]
        w = share / (ONE + p * p)
        v = found[x]
        w = w if v == v else NONE
        v = v if v == v else NONE
        total[x] += w * v
        undecided[x] += w * (ONE - v) * at_edge[x]
        weights[x] += w


@kernel
def _gather_band(
    depth,
    perspective,
    frame,
    begin,
    end,
    values,
    dense,
    sample_rows,
    shifts,
    starts,
    near_samples,
    near_lines,
    lowest,
    ways,
    across,
    shares,
    edge,
    falloff,
    table,
    sums,
):
    """Add one direction to some rows of the frame."""
    n, m = depth.shape
    row0, _, column0, column1 = frame
    width = column1 - column0
    nearest = np.empty(width, np.float32)
    at_depth = np.empty(width, np.float32)
    repaired = np.empty(width, np.float32)
    at_edge = np.empty(width, np.float32)
    apart = np.zeros((width + 7) // 8 * 8, np.uint8)
    # A column as float32 is loaded: int64, as counters are, does not become float32 in vectors.
    places = np.empty(width, np.float32)
    for x in range(width):
        places[x] = np.float32(x)
    short = in_singles(falloff)
    looked_up = -1
    down, slant, step = ways
    for y in range(begin, end):
        z = depth[y, column0:column1]
        i = near_samples[0, y]
        offset = column0 - shifts[i] - lowest
        if dense:
            found = values[i, offset : offset + width]
        else:
            if i != looked_up:
                near = near_lines[0, offset : offset + width]
                row = depth[sample_rows[i]]
                _look_up(row, values[i], starts, shifts[i], near, nearest, at_depth)
                looked_up = i
            found = repaired
            _take_nearest(z, nearest, at_depth, edge, perspective, apart, found)
            _repair(
                z,
                apart,
                depth,
                values,
                starts,
                sample_rows,
                shifts,
                near_samples[:, y],
                near_lines,
                lowest,
                column0,
                found,
            )
        steps = _steps_to_edge(n, m, y, column0, down > 0.0, slant)
        per_step = np.float32(step)
        if len(table) == 0:
            _weigh(z, places, steps, per_step, perspective, short, at_edge)
        else:
            _weigh_by_table(z, places, steps, per_step, perspective, falloff, table, at_edge)
        _add(
            found,
            places,
            at_edge,
            np.float32(shares),
            np.float32(across[2] + across[0] * y + across[1] * column0),
            np.float32(across[1]),
            sums[0, y - row0],
            sums[1, y - row0],
            sums[2, y - row0],
        )


def _bands(depth: Any, perspective: Any, frame: Any, *_: Any) -> int:
    return int(frame[1] - frame[0] + BAND - 1) // BAND


@shared_kernel(_bands)
def gather(
    start,
    stop,
    depth,
    perspective,
    frame,
    values,
    dense,
    sample_rows,
    shifts,
    starts,
    near_samples,
    near_lines,
    lowest,
    ways,
    across,
    shares,
    edge,
    falloff,
    table,
    sums,
):
    """Add some directions' obscurance to the pixels of the frame.

    Parameters
    ----------
    depth, perspective, edge, falloff, table, sample_rows, starts
        As for `lsao.sweep_lines`.
    frame : (4,) int64
        First and last rows and columns (exclusive) of the receivers.
    values : (B, samples, lines) float32
        Of `lsao.sweep_lines`.
    dense : (B,) bool
        Whether every pixel has its own sample.
    shifts : (B, samples) int64
        To the nearest column.
    near_samples : (B, 2, R) int64
        For every row the sample that lies nearest, and the nearest on the other side.
    near_lines : (B, 2, most offsets) int64
        For columns less a row's shift, from `lowest` on, the nearest line, and the next.
    ways : (B, 3) float64
        Whether rows increase along the sweep; columns that a line moves a row; the length of that
        step on the plane at depth 1.
    across : (B, 3) float64
        Place across the sweep per row, per column, at (0, 0); zeros weigh all pixels equally.
    shares : (B,) float64
        Weight of each direction.
    sums : (3, rows, columns) float32
        Raised: obscurance, undecided share, weight.
    """
    row0, row1 = frame[0], frame[1]
    for band in range(start, stop):
        begin = row0 + band * BAND
        for b in range(len(shares)):
            _gather_band(
                depth,
                perspective,
                frame,
                begin,
                min(begin + BAND, row1),
                values[b],
                dense[b],
                sample_rows[b],
                shifts[b],
                starts[b],
                near_samples[b],
                near_lines[b],
                lowest[b],
                (ways[b, 0], ways[b, 1], ways[b, 2]),
                (across[b, 0], across[b, 1], across[b, 2]),
                shares[b],
                edge,
                falloff,
                table,
                sums,
            )


@kernel
def _finish_row(by_rows, by_columns, y, row):
    """Means over all directions in a row; `row` is its place among those that are turned."""
    a, b, c = by_rows[0, y], by_rows[1, y], by_rows[2, y]
    d, e, f = by_columns[0, row], by_columns[1, row], by_columns[2, row]
    for x in range(len(a)):
        weights = c[x] + f[x]
        total = (a[x] + d[x]) / weights
        decided = ONE - (b[x] + e[x]) / weights
        total = total if total > NONE else NONE
        a[x] = total if total < ONE else ONE
        decided = decided if decided > NONE else NONE
        b[x] = decided if decided < ONE else ONE


@kernel
def _turn(source, y0, count, target):
    """Columns of `source` from `y0` on become rows of `target`."""
    columns = len(source)
    eights = columns // 8 * 8
    whole = count // 8 * 8
    for x in range(0, eights, 8):
        for y in range(0, whole, 8):
            turn_eight(source, x, 1, y0 + y, target, y, 1, x)
    for x in range(columns):
        for y in range(whole if x < eights else 0, count):
            target[y, x] = source[x, y0 + y]


def _turned(by_rows: Any, by_columns: Any) -> int:
    return -(-by_rows.shape[1] // TURNED)


@shared_kernel(_turned)
def finish(start, stop, by_rows, by_columns):
    """Means over all directions, in the place of the first two sums: occlusion and confidence.

    The sums of the transposed frame are transposed back. Both are 0 where no direction has a
    sample near.
    """
    _, rows, columns = by_rows.shape
    for band in range(start, stop):
        first = band * TURNED
        count = min(rows - first, TURNED)
        turned = np.empty((3, TURNED, columns), np.float32)
        for k in range(3):
            _turn(by_columns[k], first, count, turned[k])
        for y in range(count):
            _finish_row(by_rows, turned, first + y, y)
