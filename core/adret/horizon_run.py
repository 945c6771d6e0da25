"""One pass over a set of azimuths: the order they are swept in, their layers, and the report."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from adret import methods, skips
from adret.directions import Layer
from adret.horizon_options import HorizonOptions
from adret.report import RunReport, remember
from adret.sweepers import Sweepers
from adret.terrain import Terrain

__all__ = ["HorizonRun", "Progress", "horizon_slopes"]

Progress = Callable[[int, int], None]


class HorizonRun:
    """One pass over azimuths, or `only` some of them (indices); its report is for afterwards."""

    number = 0

    def __init__(
        self,
        terrain: Terrain,
        azimuths: NDArray[np.float64],
        options: HorizonOptions,
        progress: Progress | None = None,
        *,
        only: Sequence[int] | None = None,
    ) -> None:
        self.terrain = terrain
        self.azimuths = azimuths
        size = terrain.cell_size  # of the whole raster: its tiles go in the same order
        turns = [methods.Direction.of(a, size).orientation for a in azimuths.tolist()]
        first = {a: k for k, a in reversed(list(enumerate(azimuths.tolist())))}
        self._twin_of = [first[a] for a in azimuths.tolist()]
        every = sorted(range(len(turns)), key=lambda k: (turns[k], self._twin_of[k], k))
        wanted = range(len(turns)) if only is None else set(only)
        self._order = [(number, k) for number, k in enumerate(every) if k in wanted]
        self.options = options
        self._progress = progress
        self._bands = terrain.latitude_bands(methods.MAX_AZIMUTH_ERROR)
        self._start = time.perf_counter()
        self._same = 0
        self._left_out: Mapping[str, int] = {}
        self.expected_error_deg: float | None = None

    def layers(
        self, distances: Layer | None = None, elevations: Layer | None = None
    ) -> Iterator[tuple[int, Layer]]:
        """Yield (k, slope): tangent of the elevation towards azimuth k, shape (rows, columns).

        -inf where nothing lies that way, NaN at nodata. The array is reused: consume it before the
        next step. `distances`, shape (K, rows, columns), is filled along the way; `elevations`, as
        large, with angles [radians] that are then yielded instead. `number` counts the layers, with
        those that `only` leaves out. Azimuths come grouped by octant, their list decides the order.
        """
        same = skips.wanted("same azimuths")
        order = [k for _, k in self._order]
        again = {b: a for a, b in pairwise(order) if same and self._twin_of[a] == self._twin_of[b]}
        swept = [k for k in order if k not in again]

        def fill(engine: methods.Engine, k: int, layer: NDArray[np.float32]) -> None:
            way = None if distances is None else distances[k]
            for band in self._bands:
                direction = methods.Direction.of(float(self.azimuths[k]), band.cell_size)
                rows = band.start, band.stop
                target = methods.Target(layer, way, rows, angles=elevations is not None)
                engine.fill(direction, target)

        sweepers = Sweepers(self.terrain, self.options, len(swept))
        found = sweepers.layers(swept, fill, None if elevations is None else list(elevations))
        try:
            for done, (number, k) in enumerate(self._order):
                self.number = number
                if k in again:
                    self._same += 1
                    for stack in (s for s in (distances, elevations) if s is not None):
                        stack[k] = stack[again[k]]
                else:
                    latest = next(found)[1]
                yield k, latest if elevations is None else elevations[k]
                if self._progress is not None:
                    self._progress(done + 1, len(self._order))
        finally:
            found.close()
            self._left_out = sweepers.left_out  # now that no thread counts any more

    def _skipped(self, dark: int) -> dict[str, int]:
        counts = {"dark azimuths": dark, "same azimuths": self._same, **self._left_out}
        return {name: count for name, count in counts.items() if count}

    def report(self, skipped: int = 0) -> RunReport:
        """What was done, with `skipped` more azimuths that need not be; see `last_run_report`."""
        return remember(
            RunReport(
                method=self.options.method,
                near=self.options.near if self.options.method == "sweep" else 0,
                azimuths_swept=len(self._order),
                azimuths_skipped=len(self.azimuths) - len(self._order) + skipped,
                cells=self.terrain.mask.size,
                cells_skipped=int(self.terrain.mask.sum()),
                bands=len(self._bands),
                seconds=time.perf_counter() - self._start,
                expected_error_deg=self.expected_error_deg,
                skipped=self._skipped(len(self.azimuths) - len(self._order) + skipped),
            )
        )


def horizon_slopes(
    terrain: Terrain,
    azimuths: NDArray[np.float64],
    options: HorizonOptions,
    progress: Progress | None = None,
) -> Iterator[tuple[int, Layer]]:
    """Yield the layers of `HorizonRun`: for callers that need no report."""
    return HorizonRun(terrain, azimuths, options, progress).layers()
