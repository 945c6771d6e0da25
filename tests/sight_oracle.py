"""Lines of sight in exact arithmetic: fractions, or whole numbers; shares no code with adret."""

import math
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray


def crossings(
    z: NDArray[np.floating], a: tuple[int, int], b: tuple[int, int]
) -> list[tuple[Fraction, Fraction]]:
    """(share of the way, height) of every crossing of a line with grid rows and columns, exact."""
    (r0, c0), (r1, c1) = a, b
    shares = {Fraction(j, abs(c1 - c0)) for j in range(1, abs(c1 - c0))}
    shares |= {Fraction(j, abs(r1 - r0)) for j in range(1, abs(r1 - r0))}
    found = []
    for share in sorted(shares):
        row, column = r0 + (r1 - r0) * share, c0 + (c1 - c0) * share
        low_row, low_column = math.floor(row), math.floor(column)
        height = Fraction(0)
        for i, weight_i in ((low_row, 1 - (row - low_row)), (low_row + 1, row - low_row)):
            for j, weight_j in (
                (low_column, 1 - (column - low_column)),
                (low_column + 1, column - low_column),
            ):
                if weight_i and weight_j:
                    if np.isnan(z[i, j]):
                        break
                    height += weight_i * weight_j * Fraction(float(z[i, j]))
            else:
                continue
            break
        else:
            found.append((share, height))
    return found


def sight(
    z: NDArray[np.floating],
    a: tuple[int, int],
    b: tuple[int, int],
    observer_height: float = 0.0,
    target_height: float = 0.0,
    fall: float = 0.0,
) -> tuple[bool, float]:
    """Whether b is seen from a, and the least height above ground at which it is.

    `fall` is (1 - k) D² / (2 R): by how much curvature lowers the target.
    """
    eye = Fraction(float(z[a])) + Fraction(observer_height)
    ground = Fraction(float(z[b]))
    aim = ground + Fraction(target_height)
    seen, least = True, Fraction(0)
    for share, height in crossings(z, a, b):
        raised = height + Fraction(fall) * share * (1 - share)
        seen &= raised <= eye + (aim - eye) * share
        least = max(least, eye + (raised - eye) / share - ground)
    return seen, float(least)


def seen_in_whole_numbers(
    z: NDArray[np.int64], a: tuple[int, int], b: tuple[int, int], eye: int, aim: int
) -> bool:
    """Whether a target `aim` high at b is seen from an eye `eye` high at a; all are whole."""
    ways = np.array([b[0] - a[0], b[1] - a[1]])
    for axis in (0, 1):
        count = abs(int(ways[axis]))
        if count < 2:
            continue
        j = np.arange(1, count)
        along = a[axis] + j * int(np.sign(ways[axis]))
        aside, share = np.divmod(j * int(ways[1 - axis]), count)
        aside += a[1 - axis]
        beside = np.where(share > 0, aside + 1, aside)
        if axis == 0:
            first, second = z[along, aside], z[along, beside]
        else:
            first, second = z[aside, along], z[beside, along]
        surface = first * (count - share) + second * share
        if (surface > eye * (count - j) + aim * j).any():
            return False
    return True
