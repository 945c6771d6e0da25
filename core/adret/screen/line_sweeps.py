"""Where lines that sweep over an image run: directions, samples, and the way back to pixels.

Everything is said for a frame in which a direction's larger component (in pixels) is along the
rows: the image, or its transpose (`swap`). There, a line's sample i is on row `rows[i]` at column
``start + shift[i] + blend[i]``: all lines of a direction move sideways together.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from adret.errors import InputError

__all__ = ["Direction", "Lattice", "box_directions", "even_directions", "lattice"]

Indices = NDArray[np.int64]
SNAP = 1e-9  # pixels: a line this near to a pixel centre passes it


@dataclass(frozen=True, slots=True, kw_only=True)
class Direction:
    """A direction of sweeps, from the occluder to the receiver.

    Attributes
    ----------
    row, column : float
        In pixels; of any length, but see `period`.
    view : (float, float)
        The same in view space (right, up), unit.
    share : float
        Share of the full circle that it stands for, in view space.
    period : int
        Rows (in the frame) from a pixel centre to the next on the same line; 0 where lines pass
        between pixels.
    """

    row: float
    column: float
    view: tuple[float, float]
    share: float
    period: int

    @property
    def swap(self) -> bool:
        """Whether the frame is transposed."""
        return abs(self.column) > abs(self.row)

    @property
    def down(self) -> bool:
        """Whether the frame's rows increase along the sweep."""
        return (self.column if self.swap else self.row) > 0

    @property
    def slant(self) -> float:
        """Columns that a line moves a row, in the frame."""
        return self.row / self.column if self.swap else self.column / self.row

    @property
    def stretch(self) -> float:
        """Pixels along the line a row."""
        return math.hypot(1.0, self.slant)


def box_directions(count: int, pixel: tuple[float, float]) -> list[Direction]:
    """Directions to the pixels on the border of a (2n + 1)² box, count = 8n (P3, section 5.2).

    Parameters
    ----------
    count : int
        A multiple of 8.
    pixel : (float, float)
        Width and height of a pixel on the plane at depth 1 [view units]; the height is negative.
    """
    n = count // 8
    if count != 8 * n or n < 1:
        raise InputError("directions", "a multiple of 8 for the pattern 'box'", count)
    steps = [(n, j) for j in range(-n, n)] + [(-j, n) for j in range(-n, n)]
    steps += [(-row, -column) for row, column in steps]
    return _with_shares([(r, c, n // math.gcd(r, c)) for r, c in steps], pixel)


def even_directions(count: int, pixel: tuple[float, float]) -> list[Direction]:
    """An even number of directions, evenly spread in view space."""
    if count % 2 or count < 2:
        raise InputError("directions", "an even number for the pattern 'even'", count)
    found = []
    for k in range(count):
        angle = 2.0 * math.pi * k / count
        right, up = math.cos(angle), math.sin(angle)
        row, column = up / pixel[1], right / pixel[0]
        large = max(abs(row), abs(column))
        row, column = (0.0 if abs(v) < 1e-12 * large else v / large for v in (row, column))
        if abs(abs(row) - abs(column)) < 1e-12:
            row, column = math.copysign(1.0, row), math.copysign(1.0, column)
        # Along rows, columns and diagonals lines pass pixel centres only.
        aligned = row == 0.0 or column == 0.0 or abs(row) == abs(column)
        found.append((row, column, 1 if aligned else 0))
    return _with_shares(found, pixel)


def _with_shares(
    steps: list[tuple[float, float, int]], pixel: tuple[float, float]
) -> list[Direction]:
    views = [(column * pixel[0], row * pixel[1]) for row, column, _ in steps]
    angles = np.array([math.atan2(up, right) for right, up in views])
    order = np.argsort(angles)
    ahead = np.diff(angles[order], append=angles[order[0]] + 2.0 * math.pi)
    shares = np.empty(len(steps))
    shares[order] = 0.5 * (ahead + np.roll(ahead, 1)) / (2.0 * math.pi)
    return [
        Direction(
            row=row,
            column=column,
            view=(right / math.hypot(right, up), up / math.hypot(right, up)),
            share=float(share),
            period=period,
        )
        for (row, column, period), (right, up), share in zip(steps, views, shares, strict=True)
    ]


@dataclass(frozen=True, slots=True, kw_only=True)
class Lattice:
    """Samples of one direction over a frame of R rows and C columns.

    Attributes
    ----------
    rows, shifts : ndarray, shape (samples,), int64
        In the order of the sweep.
    blends : ndarray, shape (samples,), float64
        0 where lines pass pixel centres.
    starts : ndarray, shape (lines,), int64
        Ascending; every column of every row has a line near.
    near_shifts : ndarray, shape (samples,), int64
        `shifts`, to the nearest column.
    near_samples : ndarray, shape (2, R), int64
        Nearest sample to each row, and the nearest on its other side.
    near_lines : ndarray, shape (2, offsets), int64
        Nearest line to each column less its row's near shift, from `lowest` on, and the next.
    lowest : int
    dense : bool
        Whether every pixel has a sample of its own (at most half a pixel away).
    """

    rows: Indices
    shifts: Indices
    blends: NDArray[np.float64]
    starts: Indices
    near_shifts: Indices
    near_samples: Indices
    near_lines: Indices
    lowest: int
    dense: bool


def lattice(
    direction: Direction, shape: tuple[int, int], step: float, line_spacing: float
) -> Lattice:
    """Samples about `step` pixels apart on lines about `line_spacing` pixels apart.

    Parameters
    ----------
    direction : Direction
    shape : (int, int)
        R, C of the frame.
    step, line_spacing : float
        D_S and D_L [pixels]. The step is rounded so that lines of a box direction pass pixel
        centres; the spacing then keeps the product, the pixels that a sample stands for. Neither
        is less than a row or a column.
    """
    height, width = shape
    slant = direction.slant
    rows_apart = max(1.0, step / direction.stretch)
    if direction.period and slant != 0.0:
        rows_apart = direction.period * max(1.0, round(rows_apart / direction.period))
    columns_apart = max(1.0, step * line_spacing / rows_apart)
    places = np.round(np.arange(math.ceil(height / rows_apart)) * rows_apart)
    rows: Indices = places[places < height].astype(np.int64)
    if not direction.down:
        rows = rows[::-1].copy()
    along = rows * slant
    shifts = np.floor(along + SNAP).astype(np.int64)
    blends = np.maximum(along - shifts, 0.0)
    blends[blends < SNAP] = 0.0
    nearest = shifts + (blends >= 0.5)
    lowest, highest = -int(nearest.max()), width - 1 - int(nearest.min())
    first, last = math.floor(lowest / columns_apart), math.ceil(highest / columns_apart)
    starts = np.round(np.arange(first, last + 1) * columns_apart).astype(np.int64)
    return Lattice(
        rows=rows,
        shifts=shifts,
        blends=blends,
        starts=starts,
        near_shifts=nearest,
        near_samples=_nearest_two(np.arange(height), rows),
        near_lines=_nearest_two(np.arange(lowest, highest + 1), starts),
        lowest=lowest,
        dense=len(rows) == height and columns_apart == 1.0,
    )


def _nearest_two(places: Indices, points: Indices) -> Indices:
    """Indices of the point nearest to each place, and of the one on the place's other side."""
    falling = points[0] > points[-1]
    ascending = points[::-1] if falling else points
    right = np.searchsorted(ascending, places).clip(0, len(points) - 1)
    left = (right - 1).clip(0)
    nearer = np.abs(ascending[right] - places) <= np.abs(places - ascending[left])
    found = np.stack([np.where(nearer, right, left), np.where(nearer, left, right)])
    return (len(points) - 1 - found if falling else found).astype(np.int64)
