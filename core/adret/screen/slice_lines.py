"""Where slices through view rays look at the image: lines of samples, the same for all pixels."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from adret._kernels.screen.exact import GROUP
from adret.screen.field import Field

__all__ = ["SliceLines", "highest_from", "ways_to", "widest_way"]

SNAP = 1e-9
"""Pixels: a crossing this near to a pixel centre is the centre."""

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class _Samples(NamedTuple):
    """Samples of a line: shifts (row, column) of their two pixels, share of the second, way.

    `cells` is the number of samples, from the second one on, that follow each other at successive
    crossings with the grid.
    """

    first: Integers
    second: Integers
    share: Floats
    way: Floats
    cells: int


@dataclass(frozen=True, slots=True, kw_only=True)
class SliceLines:
    """Lines of samples for each pixel of a tile, and nearness laid out for them.

    Attributes
    ----------
    near : ndarray, shape (R, T, W), float32
        Nearness, NaN at sky and holes, -inf outside: beside the border there is no nearer pixel.
    pad : (int, int)
    samples : tuple of ndarray
        o, p, q, lone, v, s, lines, along: see `adret._kernels.screen.exact.slices`.
    cells : tuple of ndarray
        corners, pieces, cuts: see `adret._kernels.screen.shells.shell_slices`.
    """

    near: NDArray[np.float32]
    pad: tuple[int, int]
    samples: tuple[NDArray[np.generic], ...]
    cells: tuple[NDArray[np.generic], ...]

    @classmethod
    def of(
        cls,
        field: Field,
        radius: float,
        directions: int,
        near: int,
        growth: float,
        *,
        tile: int = 1,
        seed: int = 0,
    ) -> "SliceLines":
        """Lines round the pixels of a field.

        Parameters
        ----------
        field : Field
        radius : float
            Lines are as long as this needs.
        directions : int
            Lines of a pixel.
        near : int
            Up to this distance [pixels along the larger component] lines are sampled wherever
            they cross the pixel grid, beyond it where they cross its lines along the smaller
            component ...
        growth : float
            ... and at distances of at least this share of the way.
        tile : int
            Side of the square of pixels that share ``tile² · directions`` directions.
        seed : int
            Deals these to the pixels of the square.
        """
        major = _steps(widest_way(field, radius), near, growth)
        deal = np.random.default_rng(seed).permutation(tile * tile) if tile > 1 else np.zeros(1)
        along = np.empty((tile, tile, directions, 2))
        lines = np.empty((tile, tile, directions, 2), dtype=np.int64)
        parts: list[tuple[int, _Samples, Floats]] = []
        count = 0
        for row, column, k in np.ndindex(tile, tile, directions):
            turn = deal[(row + field.origin[0]) % tile * tile + (column + field.origin[1]) % tile]
            angle = 2.0 * math.pi * (k + (turn + 0.5) / (tile * tile)) / directions
            dc, dr = (0.0 if abs(c) < SNAP else c for c in (math.cos(angle), math.sin(angle)))
            samples = _line(dc, dr, major, near)
            along[row, column, k] = dc, dr
            lines[row, column, k] = count, count + len(samples.way)
            count += len(samples.way)
            parts.append((column, samples, along[row, column, k]))
        s = np.concatenate([samples.way for _, samples, _ in parts])
        # As wide as a group is long: a group is then left out only where all of it lies outside.
        span = math.ceil((s[GROUP - 1 :: GROUP] - s[::GROUP]).max()) + 2
        columns = field.depth.shape[1]
        pad = (span, -(-span // tile))
        width = -(-columns // tile) + 2 * pad[1]
        flat = _Flat(tile, width)
        o = np.concatenate([flat.samples(column, each) for column, each, _ in parts])
        weights = np.concatenate([_weights(each, way) for _, each, way in parts], axis=1)
        return cls(
            near=_laid_out(nearness_of(field), pad, tile, width, -np.inf),
            pad=pad,
            samples=(o, *weights.astype(np.float32), s.astype(np.float32), lines, along),
            cells=_joined([_cells(column, each, way, flat) for column, each, way in parts]),
        )

    def laid_out(self, layers: NDArray[np.float32]) -> NDArray[np.float32]:
        """Layers of the image in the same order as `near`, each one flat, 0 around."""
        _, tile, width = self.near.shape
        laid = [_laid_out(each, self.pad, tile, width, 0.0) for each in layers]
        return np.stack(laid).reshape(len(laid), -1)


def _laid_out(
    layer: NDArray[np.float32], pad: tuple[int, int], tile: int, width: int, outside: float
) -> NDArray[np.float32]:
    """A padded layer, columns in the order (c % tile, c // tile); (rows, tile, width)."""
    rows, columns = layer.shape
    padded = np.full((rows + 2 * pad[0], width * tile), outside, dtype=np.float32)
    left = pad[1] * tile
    padded[pad[0] : pad[0] + rows, left : left + columns] = layer
    ordered = padded.reshape(len(padded), width, tile).transpose(0, 2, 1)
    return np.ascontiguousarray(ordered)


@dataclass(frozen=True, slots=True)
class _Flat:
    """Counts shifts through the laid-out nearness."""

    tile: int
    width: int

    def shift(self, column: int, pixels: Integers) -> tuple[Integers, Integers]:
        """Flat shifts of (row, column) shifts from a column of the tile, and shifts in W."""
        across, phase = np.divmod(column + pixels[..., 1], self.tile)
        return (pixels[..., 0] * self.tile + phase - column) * self.width + across, across

    def samples(self, column: int, samples: _Samples) -> Integers:
        """Flat shift, shift in rows and in W of both pixels."""
        parts = []
        for pixels in (samples.first, samples.second):
            flat, across = self.shift(column, pixels)
            parts += [flat, pixels[:, 0], across]
        return np.stack(parts, axis=1)


def _joined(parts: list[tuple[NDArray[np.generic], ...]]) -> tuple[NDArray[np.generic], ...]:
    return tuple(np.concatenate(each) for each in zip(*parts, strict=True))


def widest_way(field: Field, radius: float) -> float:
    """Upper bound of the way in the image [pixels] between points that are within a radius."""
    whole = math.hypot(*field.depth.shape)
    if math.isinf(radius) or np.isnan(field.depth).all():
        return whole
    return min(whole, float(np.nanmax(ways_to(field, radius))))


def ways_to(field: Field, radius: float) -> Floats:
    """Upper bound of the way in the image [pixels] to what is within a radius, for every pixel."""
    ax, bx, ay, by = field.rays
    rows, columns = field.depth.shape
    pixel = min(ax, -ay)
    if math.isinf(radius):
        return np.full((rows, columns), np.inf)
    if not field.perspective:
        return np.full((rows, columns), radius / pixel)
    # A point within R of (x, y) z has a depth above z - R and lies less than R (1 + |x, y|) aside.
    x = ax * np.arange(columns) + bx
    y = ay * np.arange(rows) + by
    aside = 1.0 + np.hypot(x[None, :], y[:, None])
    above = field.depth.astype(np.float64) - radius
    with np.errstate(divide="ignore", invalid="ignore"):
        ways: Floats = np.where(above <= 0.0, np.inf, radius * aside / above) / pixel
    return ways


def nearness_of(field: Field) -> NDArray[np.float32]:
    """1/z or -z."""
    z = field.depth.astype(np.float64)
    near: NDArray[np.float32] = (1.0 / z if field.perspective else -z).astype(np.float32)
    return near


def highest_from(field: Field) -> NDArray[np.float32]:
    """Largest nearness up to and from each row, up to and from each column; -inf for none.

    Shape (4, max(rows, columns)).
    """
    near = nearness_of(field)
    near = np.where(np.isnan(near), np.float32(-np.inf), near)
    tops = np.full((4, max(near.shape)), -np.inf, dtype=np.float32)
    for axis in (0, 1):
        line = near.max(axis=1 - axis)
        tops[2 * axis, : line.size] = np.maximum.accumulate(line)
        tops[2 * axis + 1, : line.size] = np.maximum.accumulate(line[::-1])[::-1]
    return tops


def _steps(way: float, near: int, growth: float) -> Floats:
    """Where a line is sampled along its larger component [pixels]."""
    steps = list(range(1, near + 2))
    while steps[-1] <= way:
        steps.append(steps[-1] + max(1, round(growth * steps[-1])))
    return np.array(steps, dtype=np.float64)


def _line(dc: float, dr: float, major: Floats, near: int) -> _Samples:
    """Samples of the line towards (columns dc, rows dr), as many as a multiple of `GROUP`.

    The first one stands for the surface right beside the pixel: a plane through its two
    neighbours on the line's sides.
    """
    swap = abs(dr) > abs(dc)
    main, other = (dr, dc) if swap else (dc, dr)
    ways = [major / abs(main)]
    axes = [np.zeros(major.size, dtype=bool)]
    if other != 0.0:
        minor = np.arange(1.0, math.floor(near * abs(other / main)) + 1.0)
        along = minor * abs(main / other)
        minor = minor[np.abs(along - np.round(along)) > SNAP]
        ways.append(minor / abs(other))
        axes.append(np.ones(minor.size, dtype=bool))
    way = np.concatenate(ways)
    crossed_other = np.concatenate(axes)
    order = np.argsort(way, kind="stable")
    way, crossed_other = way[order], crossed_other[order]
    at = np.stack([way * main, way * other])
    whole = np.round(at)
    base = np.floor(at + SNAP)
    share = at - base
    onto = np.where(crossed_other, 1, 0)
    between = 1 - onto
    each = np.arange(way.size)
    share = np.where(share[between, each] < SNAP, 0.0, share[between, each])
    first = np.empty((way.size, 2), dtype=np.int64)
    first[each, onto] = whole[onto, each]
    first[each, between] = base[between, each]
    second = first.copy()
    second[each, between] += share > 0.0
    if not swap:  # from (main, other) to (row, column)
        first, second = first[:, ::-1], second[:, ::-1]
    beside = np.array([[0, np.sign(dc)], [np.sign(dr), 0]], dtype=np.int64)
    if dc == 0.0 or dr == 0.0:
        beside[:] = np.sign(dr), np.sign(dc)
    spare = -(way.size + 1) % GROUP
    last = np.full(spare, way.size - 1)
    keep = np.concatenate([each, last])
    return _Samples(
        np.vstack([beside[:1], first[keep]]),
        np.vstack([beside[1:], second[keep]]),
        np.concatenate([[0.0], share[keep]]),
        np.concatenate([[0.0], way[keep]]),
        int(np.count_nonzero(way <= near / abs(main) + SNAP)),
    )


def _cells(
    column: int, samples: _Samples, along: Floats, flat: _Flat
) -> tuple[Integers, Integers, NDArray[np.float32]]:
    """Corners, quarters and cuts of the cells between samples."""
    count = len(samples.way)
    before = np.maximum(np.arange(count) - 1, 0)
    pixels = np.stack(
        [samples.first[before], samples.second[before], samples.first, samples.second], axis=1
    )
    cuts = np.empty((count, 4))
    cuts[:] = samples.way[:, None]
    cuts[:, 0] = samples.way[before]
    quarters = np.zeros((count, 3, 2), dtype=np.int64)
    inner = slice(1, 1 + samples.cells)
    towards = along[::-1]  # (row, column)
    start, stop = cuts[inner, 0], cuts[inner, 3]
    corner = np.floor(0.5 * (start + stop)[:, None] * towards).astype(np.int64)
    # A line along the grid looks at its own two pixels only.
    pixels[inner] = corner[:, None] + np.array([[0, 0], [0, 1], [1, 0], [1, 1]]) * (towards != 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        halves = (corner + 0.5) / towards
    halves = np.where((halves > start[:, None]) & (halves < stop[:, None]), halves, stop[:, None])
    halves.sort(axis=1)
    cuts[inner, 1:3] = halves
    middles = 0.5 * (cuts[inner, :-1] + cuts[inner, 1:])
    beyond = middles[..., None] * towards > corner[:, None] + 0.5
    quarters[inner] = corner[:, None] + beyond.astype(np.int64)
    shifts, _ = flat.shift(column, pixels)
    pieces, _ = flat.shift(column, quarters)
    return shifts, pieces, cuts.astype(np.float32)


def _weights(samples: _Samples, along: Floats) -> Floats:
    """p, q, lone and v of each sample, shape (4, samples)."""
    dc, dr = np.abs(along)
    weights = np.empty((4, samples.way.size))
    per_way = 1.0 / samples.way[1:]
    weights[:, 1:] = (
        (1.0 - samples.share[1:]) * per_way,
        samples.share[1:] * per_way,
        per_way,
        per_way,
    )
    weights[:, 0] = dc, dr, np.nan, dc + dr
    return weights
