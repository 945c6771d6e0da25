"""Counter-based noise: a hash of (row, column, seed, count), never of the thread or the tile.

Rows and columns count from the whole buffer's corner (`Field.origin` plus the index), so that a
tile draws what the whole draws.
"""

import numpy as np

from adret._kernels.jit import inline

# Odd constants of the splitmix64 sequence and its finaliser (Steele, Lea and Flood 2014).
GOLDEN = np.uint64(0x9E3779B97F4A7C15)
FIRST = np.uint64(0xBF58476D1CE4E5B9)
SECOND = np.uint64(0x94D049BB133111EB)
S30 = np.uint64(30)
S27 = np.uint64(27)
S31 = np.uint64(31)
S32 = np.uint64(32)
S11 = np.uint64(11)


@inline
def mix(h):
    """Finaliser of splitmix64: every input bit reaches every output bit."""
    h = (h ^ (h >> S30)) * FIRST
    h = (h ^ (h >> S27)) * SECOND
    return h ^ (h >> S31)


@inline
def hash64(row, column, seed, count):
    """64 bits from four whole numbers, none negative."""
    place = (np.uint64(row) << S32) | np.uint64(column)
    h = mix(place + GOLDEN)
    h = mix(h ^ (np.uint64(seed) * GOLDEN + FIRST))
    return mix(h ^ (np.uint64(count) * GOLDEN + SECOND))


@inline
def hash32(row, column, seed, count):
    """32 bits from four whole numbers, none negative."""
    return np.uint32(hash64(row, column, seed, count) >> S32)


@inline
def uniform(row, column, seed, count):
    """A float64 in [0, 1)."""
    return np.float64(hash64(row, column, seed, count) >> S11) * 1.1102230246251565e-16
