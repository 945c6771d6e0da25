"""Line-sweep ambient obscurance: from the lines' samples to pixels (P3, section 5)."""

import numpy as np

from adret._kernels.jit import kernel, parallel_kernel, prange
from adret._kernels.screen.falloffs import TABLE, weight

FAR = np.float32(1e18)  # its square is a float32, too
BAND = 8  # rows a task: neighbouring rows have the same nearest samples
TILE = 32


@kernel
def _look_up(depth, value, starts, shift, near, found, at_depth):
    """The nearest line's obscurance and depth for each pixel of a row."""
    last = len(depth) - 1
    for x in range(len(found)):
        line = near[x]
        column = starts[line] + shift
        inside = min(max(column, 0), last)
        found[x] = value[line] if inside == column else np.float32(np.nan)
        at_depth[x] = depth[inside]


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
def _weigh_edge(z, steps, per_step, perspective, falloff, table, at_edge):
    """W at the distance where each pixel's way against the sweep leaves the image."""
    most, some, more = steps
    a, b, c, e, limit = (
        np.float32(falloff[0]),
        np.float32(falloff[1]),
        np.float32(falloff[2]),
        np.float32(falloff[3]),
        np.float32(falloff[4]),
    )
    one = np.float32(1.0)
    none = np.float32(0.0)
    for x in range(len(z)):
        way = some + more * np.float32(x)
        way = (way if way < most else most) * per_step * (z[x] if perspective else one)
        way = way if way < FAR else FAR
        d2 = way * way
        w = (a + b * d2) / (c + e * d2)
        at_edge[x] = w if d2 < limit else none
    if len(table) > 0:
        for x in range(len(z)):
            way = min(some + more * np.float32(x), most) * per_step
            way = min(way * (z[x] if perspective else one), FAR)
            at_edge[x] = weight(TABLE, falloff[1], falloff[0], table, np.float64(way))


@kernel
def _add(found, at_edge, share, across, across_per_column, total, undecided, weights):
    """Add a direction's obscurance, and what it left undecided, by the azimuth that it stands for.

    Seen from a pixel, directions of the image crowd where they point away from its middle: by
    1 + p², p being their line's distance from there on the plane at depth 1.
    """
    one = np.float32(1.0)
    none = np.float32(0.0)
    for x in range(len(found)):
        p = across + across_per_column * np.float32(x)
        w = share / (one + p * p)
        v = found[x]
        w = w if v == v else none
        v = v if v == v else none
        total[x] += w * v
        undecided[x] += w * (one - v) * at_edge[x]
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
        _weigh_edge(z, steps, np.float32(step), perspective, falloff, table, at_edge)
        _add(
            found,
            at_edge,
            np.float32(shares),
            np.float32(across[2] + across[0] * y + across[1] * column0),
            np.float32(across[1]),
            sums[0, y - row0],
            sums[1, y - row0],
            sums[2, y - row0],
        )


@parallel_kernel
def gather(
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
    for band in prange((row1 - row0 + BAND - 1) // BAND):
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
def _finish_tile(by_rows, by_columns, turned, y0, y1, x0, x1, occlusion, confidence):
    """Means over all directions in a tile."""
    one = np.float32(1.0)
    none = np.float32(0.0)
    for k in range(3):
        for x in range(x0, x1):
            of_column = by_columns[k, x, y0:y1]
            for y in range(y1 - y0):
                turned[k, y, x - x0] = of_column[y]
    for y in range(y0, y1):
        for x in range(x1 - x0):
            weights = by_rows[2, y, x0 + x] + turned[2, y - y0, x]
            total = (by_rows[0, y, x0 + x] + turned[0, y - y0, x]) / weights
            decided = one - (by_rows[1, y, x0 + x] + turned[1, y - y0, x]) / weights
            total = total if total > none else none
            occlusion[y, x0 + x] = total if total < one else one
            decided = decided if decided > none else none
            confidence[y, x0 + x] = decided if decided < one else one


@parallel_kernel
def finish(by_rows, by_columns, occlusion, confidence):
    """Means over all directions; the sums of the transposed frame are transposed back.

    Both are 0 where no direction has a sample near.
    """
    rows, columns = occlusion.shape
    for band in prange((rows + TILE - 1) // TILE):
        y0 = band * TILE
        y1 = min(rows, y0 + TILE)
        turned = np.empty((3, TILE, TILE), np.float32)
        for x0 in range(0, columns, TILE):
            x1 = min(columns, x0 + TILE)
            _finish_tile(by_rows, by_columns, turned, y0, y1, x0, x1, occlusion, confidence)
