"""Sweeps of lines of sight over a set of azimuths: lists of local horizons, or layers of sums."""

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, Required, TypedDict, Unpack

import numpy as np
from numpy.typing import NDArray

from adret._kernels import horizon_integrals
from adret._kernels import sight_rays as kernels
from adret.horizon import HorizonOptions
from adret.horizon_run import Progress
from adret.layer_sum import LayerSum
from adret.methods import MAX_AZIMUTH_ERROR
from adret.normals import surface_slopes
from adret.report import RunReport, remember
from adret.sight_frames import SightFrame, Work
from adret.sight_rays import SightMethod
from adret.slices import sine_cosine
from adret.sweep import Direction, Orientation
from adret.terrain import Terrain

__all__ = ["Reduction", "SightReport", "SightRun"]

Reduction = Literal[
    "visible_count",
    "visible_area",
    "sight_distance",
    "max_sight_distance",
    "horizon_count",
    "sky_view",
    "terrain_view",
]
Layer = NDArray[np.float32]

_QUANTITY = {
    "visible_count": kernels.SEEN,
    "visible_area": kernels.MOMENT,
    "sight_distance": kernels.WAY,
    "max_sight_distance": kernels.WAY,
    "horizon_count": kernels.HORIZONS,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class SightReport(RunReport):
    """Work done and work skipped by a run of lines of sight.

    Attributes
    ----------
    receivers : int
        Cells that walked their own ray, once an azimuth.
    samples_tested, samples_skipped : int
        Samples on own rays that were looked at, and those passed over because nothing near them is
        high enough to be seen; receivers walk in groups, and each counts.
    tree_checks : int
        Convexity checks made by the tree.
    tree_repairs_skipped : int
        Samples that took the place of the tree's root without a repair: in its safe zone.
    """

    receivers: int
    samples_tested: int
    samples_skipped: int
    tree_checks: int
    tree_repairs_skipped: int


class _Fill(TypedDict, total=False):
    """What `SightFrame.fill` can be told to fill."""

    quantity: Required[int]
    scale: float
    offsets: NDArray[np.int64]
    lists: NDArray[np.int32]


class SightRun:
    """One pass over a set of azimuths.

    Parameters
    ----------
    terrain : Terrain
    azimuths : ndarray, shape (K,), float64
    options : HorizonOptions
        Near field, range, curvature and observer.
    method : {"rays", "tree", "march"}
    progress : callable, optional
    """

    def __init__(
        self,
        terrain: Terrain,
        azimuths: NDArray[np.float64],
        options: HorizonOptions,
        method: SightMethod,
        progress: Progress | None = None,
    ) -> None:
        self.terrain = terrain
        self.azimuths = azimuths
        self.options = options
        self.method = method
        self.work = Work()
        self._progress = progress
        self._bands = terrain.latitude_bands(MAX_AZIMUTH_ERROR)
        self._start = time.perf_counter()
        size = terrain.cell_size  # of the whole raster: its windows go in the same order
        octants = [Direction.of(a, size).orientation for a in azimuths.tolist()]
        self._order = sorted(range(len(octants)), key=lambda k: (octants[k], k))
        self._frames: dict[Orientation, SightFrame] = {}

    def layer(self, reduce: Reduction) -> Layer:
        """One of the sums over azimuths, or the largest sight distance; see `intervisibility`."""
        quantity, largest = _QUANTITY[reduce], reduce == "max_sight_distance"
        total = np.zeros(self.terrain.shape)
        for done, k in enumerate(self._order):
            for band, direction in self._directions(k):
                frame = self._frame(direction.orientation, None if largest else total)
                scale = self._scale(reduce, direction)
                self._fill(frame, direction, band, quantity=quantity, scale=scale)
            if largest:
                for frame in self._frames.values():
                    np.maximum(total, frame.in_raster(frame.layer), out=total)
                    frame.layer[:] = 0.0
            self._tell(done + 1)
        for frame in self._frames.values():
            total += frame.in_raster(frame.layer)
        return self._finished(total.astype(np.float32))

    def sky_view(self) -> Layer:
        """Sky-view factor on the cells' own planes, from the highest lines of sight."""
        to_east, to_north = surface_slopes(self.terrain)
        total = LayerSum((1, *self.terrain.shape), len(self.azimuths))
        slope = np.empty(self.terrain.shape, np.float32)
        for done, k in enumerate(self._order):
            for band, direction in self._directions(k):
                frame = self._frame(direction.orientation, None)
                sight = frame.sight(direction, self.options, self.method)
                frame.add_slopes(sight, band=band, work=self.work)
                start, stop = band
                slope[start:stop] = frame.in_raster(frame.layer)[start:stop]
                frame.layer[:] = 0.0
            sine, cosine = sine_cosine(float(self.azimuths[k]))
            horizon_integrals.add_tilted(
                slope, to_east, to_north, sine, cosine, np.float32(0.0), total.layer[0]
            )
            total.added()
            self._tell(done + 1)
        mean = np.asarray(total.total()[0] / len(self.azimuths), dtype=np.float32)
        mean /= np.sqrt(1.0 + to_east * to_east + to_north * to_north)
        return self._finished(np.maximum(mean, 0.0))

    def lists(self) -> tuple[NDArray[np.int64], NDArray[np.int32], SightReport]:
        """All local horizons, counted first, then listed: offsets and steps of the lists."""
        cells = self.terrain.mask.size
        counts = np.zeros((len(self.azimuths), *self.terrain.shape), np.int32)
        steps = 2 * len(self._order)
        for done, k in enumerate(self._order):
            for (start, stop), direction in self._directions(k):
                frame = self._frame(direction.orientation, None)
                self._fill(frame, direction, (start, stop), quantity=kernels.HORIZONS)
                counts[k, start:stop] = frame.in_raster(frame.layer)[start:stop]
                frame.layer[:] = 0.0
            self._tell(done + 1, steps)
        offsets = np.zeros(len(self.azimuths) * cells + 1, np.int64)
        np.cumsum(counts.reshape(-1), out=offsets[1:])
        lists = np.empty(offsets[-1], np.int32)
        for done, k in enumerate(self._order):
            starts = offsets[k * cells : (k + 1) * cells].reshape(self.terrain.shape)
            for band, direction in self._directions(k):
                frame = self._frame(direction.orientation, None)
                places = np.ascontiguousarray(frame.in_frame(starts))
                self._fill(
                    frame, direction, band, quantity=kernels.LISTS, offsets=places, lists=lists
                )
            self._tell(len(self._order) + done + 1, steps)
        return offsets, lists, self._report()

    def _directions(self, k: int) -> Iterator[tuple[tuple[int, int], Direction]]:
        for band in self._bands:
            direction = Direction.of(float(self.azimuths[k]), band.cell_size)
            yield (band.start, band.stop), direction

    def _frame(self, orientation: Orientation, total: NDArray[np.float64] | None) -> SightFrame:
        """The frame of an octant; one no longer needed is first added to `total`.

        Two are kept: latitude bands may straddle an octant's border.
        """
        if orientation not in self._frames:
            if len(self._frames) > 1:
                old = self._frames.pop(next(iter(self._frames)))
                if total is not None:
                    total += old.in_raster(old.layer)
            self._frames[orientation] = SightFrame(self.terrain, orientation)
        return self._frames[orientation]

    def _fill(
        self,
        frame: SightFrame,
        direction: Direction,
        band: tuple[int, int],
        **what: Unpack[_Fill],
    ) -> None:
        sight = frame.sight(direction, self.options, self.method)
        frame.fill(sight, band=band, work=self.work, **what)

    def _scale(self, reduce: Reduction, direction: Direction) -> float:
        """From steps to the unit of a reduction, for one azimuth."""
        if reduce == "visible_area":
            return 2.0 * math.pi / len(self.azimuths) * direction.step**2
        if reduce == "sight_distance":
            return direction.step / len(self.azimuths)
        return direction.step if reduce == "max_sight_distance" else 1.0

    def _tell(self, done: int, of: int | None = None) -> None:
        if self._progress is not None:
            self._progress(done, of or len(self._order))

    def _finished(self, layer: Layer) -> Layer:
        layer[self.terrain.mask] = np.nan
        self._report()
        return layer

    def _report(self) -> SightReport:
        checks, _, taken = self.work.lines.sum(axis=0).tolist()
        report = SightReport(
            method=self.method,
            near=self.options.near,
            azimuths_swept=len(self.azimuths),
            azimuths_skipped=0,
            cells=self.terrain.mask.size,
            cells_skipped=int(self.terrain.mask.sum()),
            bands=len(self._bands),
            seconds=time.perf_counter() - self._start,
            receivers=self.work.receivers,
            samples_tested=self.work.samples_tested,
            samples_skipped=self.work.samples_passed,
            tree_checks=checks,
            tree_repairs_skipped=taken,
        )
        remember(report)
        return report
