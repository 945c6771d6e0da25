"""Images of positions, whose pixels know the world but not the way back from it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adret._kernels.screen.positions import trilinear
from adret.errors import InputError

__all__ = ["LookupMap", "PositionsBuffer", "WorldToImage"]

WorldToImage = Callable[[NDArray[np.float64]], ArrayLike]
"""World positions (3, n) -> column, row, depth (3, n); see `PositionsBuffer`."""

CHECKED = 10_000
OFF = 1.0
"""Pixels by which a map may miss the pixel that a position comes from."""


@dataclass(frozen=True, slots=True, eq=False)
class LookupMap:
    """A map from world to image, tabulated over a box and interpolated between.

    Attributes
    ----------
    low, high : ndarray, shape (3,), float64
        Corners of the box in the world; both are in the table.
    table : ndarray, shape (3, p, q, r), float64
        Column, row and depth at p x q x r points of the box, 2 or more along each axis.

    Examples
    --------
    >>> shift = LookupMap.of(lambda p: p + 1.0, (0, 0, 0), (2, 2, 2), (3, 3, 3))
    >>> shift(np.array([[0.5], [1.0], [3.0]])).T
    array([[nan, nan, nan]])
    >>> shift(np.array([[0.5], [1.0], [1.5]])).T
    array([[1.5, 2. , 2.5]])
    """

    low: NDArray[np.float64]
    high: NDArray[np.float64]
    table: NDArray[np.float64]

    def __post_init__(self) -> None:
        """Check shapes and order."""
        for name in ("low", "high"):
            corner = np.asarray(getattr(self, name), dtype=np.float64)
            if corner.shape != (3,) or not np.isfinite(corner).all():
                raise InputError(name, "three finite numbers", getattr(self, name))
            object.__setattr__(self, name, corner)
        if not (self.low < self.high).all():
            raise InputError("high", "above low on every axis", self.high)
        table = np.ascontiguousarray(self.table, dtype=np.float64)
        if table.ndim != 4 or len(table) != 3 or min(table.shape[1:]) < 2:
            raise InputError("table", "of shape (3, p, q, r), each 2 or more", table.shape)
        object.__setattr__(self, "table", table)

    @classmethod
    def of(
        cls,
        function: WorldToImage,
        low: ArrayLike,
        high: ArrayLike,
        shape: tuple[int, int, int],
    ) -> Self:
        """Tabulate a callable at `shape` points between two corners of the world."""
        first = np.asarray(low, dtype=np.float64)
        last = np.asarray(high, dtype=np.float64)
        if first.shape != (3,) or last.shape != (3,) or min(shape, default=0) < 2:
            raise InputError("shape", "three counts of 2 or more", shape)
        axes = [np.linspace(a, b, n) for a, b, n in zip(first, last, shape, strict=True)]
        points = np.stack([each.ravel() for each in np.meshgrid(*axes, indexing="ij")])
        return cls(first, last, asked(function, points).reshape(3, *shape))

    def __call__(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Column, row and depth of world positions, each (3, n)."""
        image = np.empty(points.shape, dtype=np.float64)
        per_step = (np.array(self.table.shape[1:]) - 1.0) / (self.high - self.low)
        trilinear(np.ascontiguousarray(points), self.low, per_step, self.table, image)
        return image


class PositionsBuffer:
    """World positions of what one or several views show, and how the world falls on their images.

    Parameters
    ----------
    positions : array_like, shape (3, rows, columns) or (views, 3, rows, columns), real
        World position of the surface at each pixel; NaN or infinite where there is none.
    world_to_image : callable, or a sequence of callables, one for each view
        From world positions, float64 (3, n), to column, row and depth on the image, (3, n). The
        centre of the pixel (row, column) is at (column + 0.5, row + 0.5). Depth grows away from
        the eye along every line of sight, in any unit. NaN: not on the image. The map need not be
        a matrix and need not have an inverse. A `LookupMap` is one too.

    Raises
    ------
    InputError
        If shapes do not fit, or a map does not take the positions to their own pixels.

    Notes
    -----
    Between pixel centres depth is bilinear. A flat surface stays flat where depth is linear over
    its image: minus one over the distance along the axis for a pinhole camera.

    References
    ----------
    O. Doronin et al., "Screen-Space Ambient Occlusion for Light Field Displays", 2017, section 5,
    the positions texture.

    Examples
    --------
    >>> rows, columns = np.mgrid[0:4, 0:6] + 0.5
    >>> floor = np.stack([columns, rows, np.zeros((4, 6))])
    >>> PositionsBuffer(floor, lambda p: np.stack([p[0], p[1], -p[2]])).shape
    (1, 4, 6)
    """

    def __init__(
        self, positions: ArrayLike, world_to_image: WorldToImage | Sequence[WorldToImage]
    ) -> None:
        try:
            given = np.asarray(positions)
        except (TypeError, ValueError):
            raise InputError("positions", "an array of real numbers", "a list") from None
        if given.dtype.kind not in "iuf" or given.ndim not in (3, 4) or given.shape[-3] != 3:
            limit = "real, of shape (3, rows, columns) or (views, 3, rows, columns)"
            raise InputError("positions", limit, f"{given.dtype} {given.shape}")
        if not given.size:
            raise InputError("positions", "at least one pixel", given.shape)
        views = given if given.ndim == 4 else given[None]
        self._positions = np.ascontiguousarray(views, dtype=np.float64)
        self._single = given.ndim == 3
        maps = [world_to_image] if callable(world_to_image) else list(world_to_image)
        if len(maps) != len(views) or not all(callable(each) for each in maps):
            raise InputError("world_to_image", f"{len(views)} callables, one a view", len(maps))
        self._maps = maps
        self._depth = np.stack([self._depth_of(view) for view in range(len(views))])

    @property
    def shape(self) -> tuple[int, int, int]:
        """Views, rows and columns."""
        views, _, rows, columns = self._positions.shape
        return views, rows, columns

    @property
    def single(self) -> bool:
        """Whether positions came without an axis of views."""
        return self._single

    @property
    def positions(self) -> NDArray[np.float64]:
        """World positions, (views, 3, rows, columns)."""
        return self._positions

    @property
    def depth(self) -> NDArray[np.float64]:
        """What the maps say of the positions' own depth, (views, rows, columns); NaN for none."""
        return self._depth

    def to_image(self, view: int, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Column, row and depth of world positions (3, ...) in a view."""
        flat = points.reshape(3, -1)
        return asked(self._maps[view], flat).reshape(points.shape)

    def _depth_of(self, view: int) -> NDArray[np.float64]:
        positions = self._positions[view]
        rows, columns = positions.shape[1:]
        seen = np.isfinite(positions).all(axis=0)
        depth = np.full((rows, columns), np.nan)
        if not seen.any():
            return depth
        image = self.to_image(view, positions[:, seen])
        depth[seen] = image[2]
        row, column = np.nonzero(seen)
        step = max(1, row.size // CHECKED)
        off = np.hypot(image[0] - column - 0.5, image[1] - row - 0.5)[::step]
        wrong = ~(off <= OFF)
        if wrong.mean() > 0.01:
            at = int(np.argmax(wrong)) * step
            limit = f"a map of view {view} that takes each position to its own pixel"
            found = f"({image[0, at]:g}, {image[1, at]:g}) for the pixel ({row[at]}, {column[at]})"
            raise InputError("world_to_image", limit, found)
        return depth


def asked(function: WorldToImage, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """What a map returns for points (3, n), checked."""
    try:
        answer: Any = np.asarray(function(points), dtype=np.float64)
    except Exception as error:
        limit = "a callable of world positions, float64 (3, n)"
        raise InputError("world_to_image", limit, repr(error)) from error
    if answer.shape != points.shape:
        limit = f"a callable that returns {points.shape} for {points.shape}"
        raise InputError("world_to_image", limit, answer.shape)
    return np.ascontiguousarray(answer)
