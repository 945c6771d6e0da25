"""Line-sweep ambient obscurance: the lines of a strip on one row of the image, side by side.

The numbers of a strip stand in two flat arrays, quantity after quantity, `STRIP` apart: with
constant distances nothing can alias, and loops vectorise. Places are float64; what is seen of one
place from another is float32.
"""

import math

import numpy as np

from adret._kernels.jit import index, kernel

STRIP = 128  # lines a strip; their hulls' tops stay in the nearest caches
# In float64: the point of this row (along the sweep, towards the eye).
X = 0 * STRIP
Y = 1 * STRIP
# The direction towards the eye: its first component reversed, its second, and its length.
S = 2 * STRIP
C = 3 * STRIP
LENGTH = 4 * STRIP
Z = 5 * STRIP  # depth
ALONG = 6 * STRIP  # place along the sweep at column `start`, on the plane at depth 1
ACROSS = 7 * STRIP  # place across it
OWN = 8 * STRIP  # sine of the receiver's own tangent plane
TANGENT = 9 * STRIP  # sine of that in use
# The hull's three topmost points, and the one kept aside.
TOPS = 10 * STRIP
PLACES = 18 * STRIP


@kernel
def in_image(starts, shift, width):
    """First and last + 1 of a strip's lines that are at a column of the image."""
    low = 0
    high = len(starts)
    while low < high and starts[low] + shift < 0:
        low += 1
    while high > low and starts[high - 1] + shift >= width:
        high -= 1
    return low, high


@kernel
def sample_pixels(row, starts, shift, z):
    """Depths of lines that pass pixel centres; all are inside the image."""
    count = len(starts)
    if starts[count - 1] - starts[0] == count - 1:
        begin = starts[0] + shift
        here = row[begin : begin + count]
        for i in range(count):
            z[i] = np.float64(here[i])
    else:
        for i in range(count):
            z[i] = np.float64(row[index(starts[i] + shift)])


@kernel
def read(row, starts, shift, found):
    """Depths of lines at columns that may be outside the image: NaN there."""
    count = len(starts)
    low, high = in_image(starts, shift, len(row))
    for i in range(low):
        found[i] = np.float32(np.nan)
    for i in range(high, count):
        found[i] = np.float32(np.nan)
    if starts[count - 1] - starts[0] == count - 1:
        here = row[starts[0] + shift + low : starts[0] + shift + high]
        there = found[low:high]
        for i in range(high - low):
            there[i] = here[i]
    else:
        for i in range(low, high):
            found[i] = row[index(starts[i] + shift)]


@kernel
def sample_between(row, starts, shift, blend, edge, perspective, scratch, z):
    """Depths of lines that pass `blend` pixels right of the columns ``start + shift``.

    Those of the nearest pixel, which is inside the image, and its neighbour on the line's other
    side. Pixels whose depths differ by more than `edge` (over the depth if `perspective`) are not
    blended: then the nearest one's surface is continued from its other neighbour, if that is of it.
    """
    right = blend >= 0.5
    share = 1.0 - blend if right else blend
    near = shift + 1 if right else shift
    side = -1 if right else 1
    read(row, starts, near, scratch)
    read(row, starts, near + side, scratch[STRIP:])
    read(row, starts, near - side, scratch[2 * STRIP :])
    for i in range(len(starts)):
        a = np.float64(scratch[i])
        b = np.float64(scratch[STRIP + i])
        limit = edge * a if perspective else edge
        forwards = abs(a - b) <= limit
        d = b if forwards else np.float64(scratch[2 * STRIP + i])
        at = share if forwards else -share
        mixed = a * d / (d + (a - d) * at) if perspective else a + (d - a) * at
        z[i] = mixed if (abs(a - d) <= limit) & (mixed > 0.0) else a


@kernel
def shows_nothing(z, count):
    """Whether none of the first lines has a depth."""
    i = 0
    while i < count and z[i] != z[i]:
        i += 1
    return i == count


@kernel
def place(w, low, count, here, perspective):
    """Points of lines in the planes that they span with the eye, from their depths."""
    v = w[low:]
    if perspective:
        for i in range(count):
            z = v[Z + i]
            s = here + v[ALONG + i]
            c = v[C + i]
            v[S + i] = s
            v[LENGTH + i] = math.sqrt(s * s + c * c)
            v[X + i] = z * s
            v[Y + i] = -z * c
    else:
        for i in range(count):
            v[S + i] = 0.0
            v[LENGTH + i] = 1.0
            v[X + i] = here + v[ALONG + i]
            v[Y + i] = -v[Z + i]


@kernel
def sine_of_tangent(normal, swap, row, column, plane, w, j):
    """Sine of the elevation of a pixel's tangent plane, against the sweep."""
    y = column if swap else row
    x = row if swap else column
    right, up, back = normal[0, y, x], normal[1, y, x], normal[2, y, x]
    dx, dy = plane
    p = w[ACROSS + j]
    along = right * dx + up * dy
    out = (back - p * (up * dx - right * dy)) / math.sqrt(1.0 + p * p)
    size = math.sqrt(along * along + out * out) * w[LENGTH + j]
    return (out * w[S + j] + along * w[C + j]) / size


@kernel
def set_tangents(normal, swap, row, starts, shift, plane, w, low):
    """Sines of the receivers' own tangent planes; lines start at lane `low`."""
    for i in range(len(starts)):
        w[OWN + low + i] = sine_of_tangent(normal, swap, row, starts[i] + shift, plane, w, low + i)
