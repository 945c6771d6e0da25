"""Lines of the sweep frame: sampled a strip at a time, results added to the cells.

Line L passes row i of the frame at column L + left[i] + weight[i]; its height there is interpolated
between the two cells beside it. The sample belongs to the nearer one, column L + cell[i], so that
every cell has one sample and every sample one cell. Where the other cell has no data, the nearer
one's height alone counts; where the nearer one has none, neither has the sample (NaN). Heights are
rounded to whole quanta, in float64: cross products of their differences with steps are then exact,
and so are ties.
"""

import numpy as np

from adret._kernels.jit import index, kernel, strict_kernel
from adret._kernels.sight_rays import LEEWAY

STRIP = 32  # lines sampled together: contiguous in the frame's rows, and 256 kB at 1024 samples


@kernel
def strip_count(cell, rows, columns):
    """Strips whose lines have a receiver among these rows and columns."""
    lowest = columns[0] - cell[rows[1] - 1]
    highest = columns[1] - 1 - cell[rows[0]]
    return (highest - lowest + STRIP) // STRIP


@kernel
def first_line(cell, strip, rows, columns):
    """The strip's first line."""
    return columns[0] - cell[rows[1] - 1] + strip * STRIP


@kernel
def strip_rows(cell, first, stop, width):
    """Rows before `stop`, from and to, in which a line of the strip has its cell."""
    begin = 0
    while begin < stop and first + STRIP - 1 + cell[begin] < 0:
        begin += 1
    end = stop
    while end > begin and first + cell[end - 1] >= width:
        end -= 1
    return begin, end


@strict_kernel
def sample_strip(z, left, weight, cell, first, begin, end, bend, quanta, heights):
    """Fill `heights` (line, 1 + row - begin) [quanta]; NaN where there is no sample.

    Place 0 is never a sample: the one before the first can be read. `z` has one column of NaN on
    either side. `bend` is the curvature's drop a step squared [m], counted from the middle row.
    """
    lines = heights.shape[0]
    width = z.shape[1] - 2
    of_row = np.empty(lines)
    heights[:, 0] = np.nan
    for i in range(begin, end):
        w = weight[i]
        right = cell[i] > left[i]
        away = i - 0.5 * z.shape[0]
        drop = bend * away * away
        lo = min(lines, max(0, -(first + cell[i])))
        hi = max(lo, min(lines, width - (first + cell[i])))
        column = first + left[i] + 1
        left_cells = z[i, column + lo : column + hi]
        right_cells = z[i, column + lo + 1 : column + hi + 1]
        out = of_row[lo:hi]
        of_row[:lo] = np.nan
        of_row[hi:] = np.nan
        for x in range(len(out)):
            a = np.float64(left_cells[x])
            b = np.float64(right_cells[x])
            near = b if right else a
            # Beside nodata the nearer cell's height alone counts.
            height = a + (b - a) * w
            height = height if height == height else near
            out[x] = np.rint((height - drop) * quanta)
        for line in range(lines):
            heights[index(line), index(1 + i - begin)] = of_row[index(line)]


@kernel
def add_strip(cell, first, begin, end, rows, columns, scale, values, out):
    """Add scale·values (line, 1 + row - begin) to the cells of `out`."""
    lines = values.shape[0]
    for i in range(max(begin, rows[0]), end):
        column = first + cell[i]
        lo = min(lines, max(0, columns[0] - column))
        hi = max(lo, min(lines, columns[1] - column))
        row = out[i, column + lo : column + hi]
        for x in range(len(row)):
            row[x] += scale * values[index(lo + x), index(1 + i - begin)]


@kernel
def place_lists(cell, first, begin, end, rows, columns, offsets, start):
    """First place in the lists of each sample, from those of the cells; -1 for no receiver."""
    lines = start.shape[0]
    start[:] = -1
    for i in range(max(begin, rows[0]), end):
        column = first + cell[i]
        lo = min(lines, max(0, columns[0] - column))
        hi = max(lo, min(lines, columns[1] - column))
        for line in range(lo, hi):
            start[line, 1 + i - begin] = offsets[i, column + line]


@strict_kernel
def take_near_field(
    cell, first, begin, end, rows, columns, bend, quanta, eye, rise, z, best, value, open_run,
    eyes, wall, values, open_runs,
):  # fmt: skip
    """Fill eyes, walls, values and open runs (line, 1 + row - begin) from those of the cells.

    An eye is at its own cell's height [quanta], NaN for no receiver. A wall is the slope `best`,
    less what it may be off by, in whole quanta a step; `rise` is quanta a step for a slope of 1.
    """
    lines = eyes.shape[0]
    eyes[:] = np.nan
    wall[:] = -np.inf
    open_runs[:] = False
    for i in range(max(begin, rows[0]), end):
        away = i - 0.5 * z.shape[0]
        # On the bent line a slope is that much steeper at this place.
        tilt = 2.0 * bend * quanta * away
        column = first + cell[i]
        lo = min(lines, max(0, columns[0] - column))
        hi = max(lo, min(lines, columns[1] - column))
        p = 1 + i - begin
        for line in range(lo, hi):
            x = column + line
            height = np.float64(z[i, x + 1]) - bend * away * away
            eyes[line, p] = np.rint(height * quanta) + eye
            top = np.float64(best[i, x])
            wall[line, p] = np.rint((top - abs(top) * LEEWAY) * rise + tilt)
            values[line, p] = value[i, x]
            open_runs[line, p] = open_run[i, x]
