"""Line-Sweep Ambient Obscurance: the largest occluder of each direction, whatever the radius."""

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from adret._kernels.frames import copy_oriented
from adret._kernels.screen import lsao as kernels
from adret._kernels.screen import lsao_gather as gathering
from adret._kernels.screen.falloffs import QUADRATIC, TABLE, TIMONEN
from adret._kernels.screen.lsao_strips import STRIP
from adret.errors import InputError
from adret.screen.falloffs import Falloff
from adret.screen.field import Field
from adret.screen.line_sweeps import (
    Direction,
    Lattice,
    box_directions,
    even_directions,
    lattice,
)
from adret.screen.occlusion import Estimate, Progress
from adret.screen.options import FalloffOptions, option
from adret.skips import wanted

__all__ = ["Options", "estimate"]

HELD = 1 << 24
"""Samples that are held before they are gathered, unless one direction has more."""
TANGENTS = {"fixed": kernels.FIXED, "receiver": kernels.RECEIVER, "mixed": kernels.MIXED}


@dataclass(frozen=True, kw_only=True)
class Options(FalloffOptions):
    """Options of Line-Sweep Ambient Obscurance."""

    falloff: Literal["none", "hard", "quadratic", "timonen"] = option(
        "timonen", "Weight of an occluder by its distance; in Python also a callable d -> W"
    )
    directions: int = option(16, "Directions of the sweeps", minimum=2, maximum=512)
    pattern: Literal["even", "box"] = option(
        "even",
        "Directions evenly spread (an even number), with depth interpolated between pixels; or to "
        "the pixels on the border of a box (a multiple of 8), whose lines pass pixel centres",
    )
    step: float = option(
        1.0, "Distance of samples along a line", unit="pixels", minimum=1.0, maximum=64.0
    )
    line_spacing: float = option(1.0, "Distance of lines", unit="pixels", minimum=1.0, maximum=64.0)
    tangent: Literal["fixed", "receiver", "mixed"] = option(
        "fixed",
        "Tangent plane below which nothing counts: one elevation for all; the receiver's own; or "
        "fixed to find the largest occluder and the receiver's own to weigh it",
    )
    tangent_sine: float = option(
        -0.85, "Sine of the elevation of the fixed tangent plane", minimum=-1.0, maximum=0.0
    )
    edge: float = option(
        10.0,
        "Change of depth from pixel to pixel that separates two surfaces",
        unit="pixel widths",
        above=0.0,
    )
    peaks: bool = option(
        False,
        "Whether the highest points of the latest blocks of samples, 8 of 4 and 4 of 32, are "
        "looked at beside the hull, and each of the latest 128 samples where the falloff is hard: "
        "fewer missed occluders, for more time; not for tangent 'mixed'",
    )
    published: bool = option(
        False,
        "As published: lines in planes along the viewing axis, not through the eye, and hulls that "
        "do not look past what lies below the tangent plane",
    )

    def __post_init__(self) -> None:
        """Directions must fit the pattern; what is weighed anew is the hull's."""
        super().__post_init__()
        if self.peaks and self.tangent == "mixed":
            raise InputError("peaks", "false for tangent 'mixed'", self.peaks)
        _directions(self, (1.0, -1.0))


def estimate(field: Field, options: Options, progress: Progress | None) -> Estimate:
    """Occlusion by the largest occluder in each of a few directions, found by sweeping lines.

    Parameters
    ----------
    field : Field
    options : Options
    progress : callable or None

    Returns
    -------
    Estimate
        No bent normal.

    Notes
    -----
    Occlusion is the mean over azimuths about the view ray of

        sin t + max(0, sin h - sin t) W(d),

    h and d being the elevation, above the plane across the view ray, and the distance of the
    occluder for which this is largest, and t the elevation of the tangent plane, sin t = -0.85 for
    all by default; the mean is clipped to 0..1. With W = 1 that is the uniformly weighted
    occlusion. With a falloff it is less than the integral of W over the hemisphere, since only one
    occluder counts, and less still by the fixed tangent plane, most on convex edges.

    Lines of each direction sweep over the image; on each a stack holds those of its points that can
    still be the largest occluder of a point to come, so the cost a sample does not depend on the
    radius. Two changes to the publication, without which the mean misses of the largest occluder
    are five times as many (`published` undoes them):

    - Distances and angles are taken in the plane that the line and the eye span, and directions
      are weighted by the azimuth about the view ray that they stand for. A line's points lie in
      that plane; in the published one, along the viewing axis, they do only in the image's middle.
    - A point below the receiver's tangent plane is popped for a higher one though neither
      obscures. Else it would hide all that is behind it from the receivers after. The last such
      point is kept aside.

    The hull still misses the largest occluder now and then, most where thin things stand before
    a far background and with falloffs that end abruptly (`tests/core/screen/test_lsao.py` has
    figures); with `peaks` half as often or less, and with a hard falloff hardly ever within 128
    samples. Where a line has nothing before a receiver, its
    own tangent plane is the horizon.

    With `step` (D_S) or `line_spacing` (D_L) above 1, a pixel takes the nearest sample of each
    direction, unless that is of another surface: then, of the nearest four, the one nearest in
    depth. Their product, the pixels that a sample stands for, is kept exactly, the step as nearly
    as lines allow that pass pixel centres. A direction of the box that is neither along an axis nor
    a diagonal has its samples at least the box's half width apart.

    Confidence is what no surface beyond the image's edge could change: 1 less the mean over the
    directions of (1 - obscurance) W(distance to the edge, across the view ray).

    References
    ----------
    V. Timonen, "Line-Sweep Ambient Obscurance", Computer Graphics Forum 32(4), 2013, equations 1
    and 2, algorithm 1, sections 4.1 (tangent planes), 5.1 (sparse sweeps) and 5.2 (box).

    Examples
    --------
    >>> from adret import Camera, DepthBuffer, ambient_occlusion
    >>> wall = DepthBuffer(np.full((8, 8), 3.0), Camera.perspective(8, 8, fov_y_deg=60.0))
    >>> ambient_occlusion(wall, method="lsao", falloff_scale=4.0).occlusion.max()
    np.float32(0.0)
    """
    directions = _directions(options, (float(field.rays[0]), float(field.rays[2])))
    done = skipped = 0
    held = np.empty(0, dtype=np.float32)
    frames = [_Frame(field, swap) for swap in (False, True)]
    for frame in frames:
        plans = [
            (each, lattice(each, frame.depth.shape, options.step, options.line_spacing))
            for each in directions
            if each.swap == frame.swap
        ]
        samples = max((plan.rows.size for _, plan in plans), default=0)
        lines = max((plan.starts.size for _, plan in plans), default=0)
        batch = max(1, min(len(plans), HELD // max(1, samples * lines)))
        size = batch * samples * lines
        if held.size < size:  # one piece of memory for both frames: new one is slow
            held = np.empty(size, dtype=np.float32)
        values = held[:size].reshape(batch, samples, lines)
        for first in range(0, len(plans), batch):
            chosen = plans[first : first + batch]
            skipped += _sweep(field, options, frame, chosen, values)
            done += len(chosen)
            if progress is not None:
                progress(done, len(directions))
    sums = frames[0].sums
    gathering.finish(sums, frames[1].sums)
    return Estimate(sums[0], sums[1], None, {"empty samples": skipped})


def _directions(options: Options, pixel: tuple[float, float]) -> list[Direction]:
    pattern = box_directions if options.pattern == "box" else even_directions
    return pattern(options.directions, pixel)


class _Frame:
    """The image, or its transpose, with the sums of the directions that run in it."""

    def __init__(self, field: Field, swap: bool) -> None:
        self.swap = swap
        row0, row1, column0, column1 = field.frame
        ax, bx, ay, by = (float(value) for value in field.rays)
        self.depth = field.depth
        self._of_row, self._of_column = (ay, by), (ax, bx)
        if swap:
            row0, row1, column0, column1 = column0, column1, row0, row1
            self.depth = np.empty(field.depth.shape[::-1], dtype=np.float32)
            copy_oriented(field.depth, self.depth, True, False, False)
            self.depth.setflags(write=False)  # as the image's: one compilation serves both
            self._of_row, self._of_column = self._of_column, self._of_row
        self.receivers = np.array([row0, row1, column0, column1])
        self.sums = np.zeros((3, row1 - row0, column1 - column0), dtype=np.float32)

    @property
    def pixel(self) -> float:
        """Distance of columns on the plane at depth 1 [view units]."""
        return abs(self._of_column[0])

    def along(self, view: tuple[float, float]) -> tuple[float, float, float]:
        """Place on the plane at depth 1 along a direction: per row, per column, at (0, 0)."""
        by_row, by_column = view if self.swap else view[::-1]
        (a, a0), (b, b0) = self._of_row, self._of_column
        return a * by_row, b * by_column, a0 * by_row + b0 * by_column

    def step(self, direction: Direction) -> float:
        """Length of a row's step along a line, on the plane at depth 1."""
        return math.hypot(self._of_row[0], direction.slant * self._of_column[0])


def _sweep(
    field: Field,
    options: Options,
    frame: _Frame,
    plans: list[tuple[Direction, Lattice]],
    values: NDArray[np.float32],
) -> int:
    """Sweep some directions and add what they find to the frame's sums.

    Returns how many samples were passed over.
    """
    directions = [direction for direction, _ in plans]
    lattices = [each for _, each in plans]
    geometry, across = [], []
    for direction in directions:
        right, up = direction.view
        crosswise = frame.along((-up, right))
        geometry.append((*frame.along(direction.view), *crosswise[1:], right, up))
        flat = options.published or not field.perspective
        across.append((0.0, 0.0, 0.0) if flat else crosswise)
    rows = _stacked([each.rows for each in lattices])
    starts = _stacked([each.starts for each in lattices])
    skipped = np.zeros((len(plans), -(-starts.shape[1] // STRIP)), dtype=np.int64)
    edge = options.edge * frame.pixel
    falloff, table = _formula(options.weights())
    kernels.sweep_lines(
        frame.depth,
        field.normal,
        frame.swap,
        field.perspective,
        np.array([each.rows.size for each in lattices]),
        rows,
        _stacked([each.shifts for each in lattices]),
        _stacked([each.blends for each in lattices]),
        np.array([each.starts.size for each in lattices]),
        starts,
        np.array(geometry),
        options.published,
        TANGENTS[options.tangent],
        options.tangent_sine,
        edge,
        falloff,
        table,
        wanted("empty samples"),
        _beside(options, falloff, table),
        values,
        skipped,
    )
    gathering.gather(
        frame.depth,
        field.perspective,
        frame.receivers,
        values,
        np.array([each.dense for each in lattices]),
        rows,
        _stacked([each.near_shifts for each in lattices]),
        starts,
        _stacked([each.near_samples for each in lattices]),
        _stacked([each.near_lines for each in lattices]),
        np.array([each.lowest for each in lattices]),
        np.array([(each.down, each.slant, frame.step(each)) for each in directions], np.float64),
        np.array(across),
        np.array([each.share for each in directions]),
        edge,
        falloff,
        table,
        frame.sums,
    )
    return int(skipped.sum())


def _formula(falloff: Falloff) -> tuple[tuple[float, ...], NDArray[np.float64]]:
    """A falloff as `_kernels.screen.lsao` takes it."""
    square = falloff.radius**2
    formulas = {
        TIMONEN: (1.0, 0.0, 1.0, 1.0 / falloff.scale, square),
        QUADRATIC: (1.0, -1.0 / square, 1.0, 0.0, square),
        TABLE: (falloff.scale, falloff.radius, 0.0, 0.0, 0.0),
    }
    return formulas.get(falloff.code, (1.0, 0.0, 1.0, 0.0, square)), falloff.table.copy()


def _beside(options: Options, falloff: tuple[float, ...], table: NDArray[np.float64]) -> int:
    """What is looked at beside the hulls, as `_kernels.screen.lsao` takes it."""
    if not options.peaks:
        return 0
    ends = falloff[1] == falloff[3] == 0.0 and math.isfinite(falloff[4])
    return kernels.LATEST_TOO if ends and len(table) == 0 else kernels.PEAKS


def _stacked(arrays: list[NDArray[Any]]) -> NDArray[Any]:
    """Arrays of unlike lengths as one, the last axis padded with zeros."""
    longest = max(each.shape[-1] for each in arrays)
    result = np.zeros((len(arrays), *arrays[0].shape[:-1], longest), arrays[0].dtype)
    for row, each in zip(result, arrays, strict=True):
        row[..., : each.shape[-1]] = each
    return result
