"""How sight is followed in one azimuth: along each cell's own ray, and on swept lines beyond it."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from adret._kernels import sight_rays as kernels
from adret.directions import SNAP, Direction
from adret.horizon_options import NEAR_DEFAULT, NEAR_MAX, HorizonOptions

__all__ = ["NEAR", "Sight", "SightMethod", "seen_on_ray"]

SightMethod = Literal["rays", "tree", "march"]
Numbers = NDArray[np.float64]
NEAR: dict[SightMethod, int] = {"rays": NEAR_MAX, "tree": NEAR_DEFAULT, "march": NEAR_DEFAULT}
"""Near radius of each method, unless another is asked for."""
ROUGH = 2.0**-19
"""Cells by which a sample on a ray may at least be lower than the line of sight, and be seen."""


@dataclass(frozen=True, eq=False)
class Sight:
    """Sight of all cells in one azimuth.

    Attributes
    ----------
    direction : Direction
    options : HorizonOptions
        near, max_distance, radius, refraction and observer_height.
    method : {"rays", "tree", "march"}
    rows : int
        Of the sweep frame.
    """

    direction: Direction
    options: HorizonOptions
    method: SightMethod
    rows: int

    @property
    def reach(self) -> float:
        """Range [steps]: a whole number, or infinity."""
        return float(np.floor(self.options.range / self.direction.step + SNAP))

    @property
    def own(self) -> int:
        """Steps that are followed on each cell's own ray."""
        own = self.rows - 1 if self.method == "rays" else min(self.options.near, self.rows - 1)
        return int(min(own, self.reach))

    @property
    def joined(self) -> bool:
        """Whether swept lines take over beyond."""
        return self.own < min(self.reach, self.rows - 1)

    def columns(self, rows: int) -> NDArray[np.int64]:
        """Whole columns that a ray has moved after 0, 1, ... rows - 1 rows."""
        return _parts(np.arange(float(rows)) * self.direction.shear)[0].astype(np.int64)

    def column_at(self, steps: NDArray[np.int32]) -> NDArray[np.int64]:
        """Columns between a cell and the ones nearest to its samples."""
        column, weight = _parts(steps.astype(np.float64) * self.direction.shear)
        return np.asarray(column + (weight > 0.5), dtype=np.int64)

    def steps(self, width: int, quantity: int = kernels.LISTS) -> kernels.Steps:
        """Crossings of own rays; `width` is that of the padded frame."""
        block, four, shear = kernels.BLOCK, kernels.GROUP, self.direction.shear
        blocks = -(-self.own // block)
        j = np.arange(1.0, blocks * block + 1.0)
        column, weight = _parts(j * shear)
        samples = np.stack(
            [
                -j * width - column,
                -j * width - column - (weight > 0.0),
                weight,
                j,
                _sum_of(quantity, j),
            ]
        )[:, j <= self.own]
        # The columns crossed between two rows; where the ray passes a cell, that is a sample.
        before = np.ceil(j * shear - SNAP) - 1.0
        crossed = (before > (j - 1.0) * shear + SNAP) & (j <= min(self.options.near, self.own))
        j, before = j[crossed], before[crossed]
        row = before / shear if shear > 0.0 else before
        sides = np.stack(
            [
                -(j - 1.0) * width - before,
                -j * width - before,
                row - (j - 1.0),
                row,
                np.zeros_like(j),
            ]
        )
        both = np.concatenate([samples, sides], axis=1)
        of_block = np.ceil(both[3] / block).astype(np.int64) - 1
        filling = -np.bincount(of_block, minlength=blocks) % four
        missing = np.repeat(np.arange(blocks), filling)
        both = np.append(both, np.full((5, missing.size), np.nan), axis=1)
        of_block = np.append(of_block, missing)
        both = both[:, np.lexsort((both[3], of_block))]
        starts = np.searchsorted(np.sort(of_block), np.arange(blocks + 1))
        distance = both[3] * self.direction.step
        options = self.options
        numbers = [
            (1.0 - both[2]) / distance,
            both[2] / distance,
            -options.observer_height / distance - options.bend * distance,
            both[4],
        ]
        first = distance[starts[:-1]]
        last = block * self.direction.step * np.arange(1.0, blocks + 1.0)
        drop = options.observer_height + options.bend * first**2
        return kernels.Steps(
            np.nan_to_num(both[:2]).T.astype(np.int64).ravel(),
            np.stack(numbers, axis=1).astype(np.float32).ravel(),
            starts,
            self.columns(blocks * block + 1),
            np.stack([1.0 / first, 1.0 / last, drop], axis=1).astype(np.float32),
            self.own,
            np.float32(ROUGH * min(self.direction.cell_size)),
        )


def seen_on_ray(
    steps: kernels.Steps, z: NDArray[np.float32], row: int, column: int
) -> tuple[NDArray[np.int32], np.float32]:
    """Samples that one cell of a padded frame sees on its own ray, near to far; highest slope.

    The arithmetic is that of the kernel, and so is the result.
    """
    heights = z.ravel()
    receiver = (row + kernels.PAD) * z.shape[1] + column + kernels.SIDE
    cells, numbers = steps.cells.reshape(-1, 2), steps.numbers.reshape(-1, 4)
    rough = abs(heights[receiver]) * kernels.LEEWAY + steps.rough
    top = np.float32(-np.inf)
    found = []
    for b in range(len(steps.bounds)):
        first = b * kernels.BLOCK + 1
        if steps.columns[first] > column or first > row:
            break
        off = abs(top) * kernels.LEEWAY if abs(top) < np.inf else np.float32(0.0)
        loose = rough * steps.bounds[b, kernels.PER_NEAR] + off
        some = slice(steps.starts[b], steps.starts[b + 1])
        p, q, k, bit = numbers[some].T
        rise = heights[receiver + cells[some]] - heights[receiver]
        slope = rise[:, 0] * p + rise[:, 1] * q + k
        tops = np.fmax.accumulate(np.r_[top, slope - loose])
        seen = (slope + loose >= tops[:-1]) & (bit > 0.0)
        found.append(np.log2(bit[seen]) + first)
        top = tops[-1]
    return np.concatenate([*found, ()]).astype(np.int32), top


def _sum_of(quantity: int, j: Numbers) -> Numbers:
    """What samples add when they are seen: to a sum, or else to the words of bits."""
    if quantity == kernels.SEEN:
        return np.ones_like(j)
    return j if quantity == kernels.MOMENT else 2.0 ** ((j - 1.0) % kernels.BLOCK)


def _parts(position: Numbers) -> tuple[Numbers, Numbers]:
    """Whole cells and the rest."""
    cell = np.floor(position + SNAP)
    weight = position - cell
    return cell, np.where(weight < SNAP, 0.0, weight)
