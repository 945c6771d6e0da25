"""Azimuths side by side: each thread sweeps whole azimuths, and layers come out in their order.

Threads that share one azimuth wait for each other at the end of every kernel; whole azimuths of
their own they sweep without a word. Each then needs a frame and layers of its own, so that large
rasters, and few azimuths, are shared kernel by kernel instead. Bytes are the same either way.
"""

from collections import Counter, deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np

from adret import methods
from adret._kernels import jit
from adret.directions import Layer
from adret.horizon_options import HorizonOptions
from adret.terrain import Terrain

__all__ = ["Sweepers", "own_bytes"]

MEMORY = 64 * 2**20
"""What a thread may take for frames and layers of its own [bytes]."""
LEAST_SHARE = 0.75  # of the threads busy on average: 3 azimuths of 2 threads are as many as 4

Fill = Callable[[methods.Engine, int, Layer], None]


def own_bytes(cells: int, threads: int, bands: int = 1) -> int:
    """What threads take together that sweep azimuths of their own, 0 where they share kernels.

    An engine keeps a frame, or two where a geographic raster has latitude bands: turned heights and
    the layer that is swept in them. Of the layers that it hands out one waits and one is in use.
    """
    each = (2 * min(bands, 2) + 2) * 4 * cells
    return threads * each if threads > 1 and each <= MEMORY else 0


class Sweepers:
    """One engine a thread, or a single one whose kernels all threads share.

    Parameters
    ----------
    terrain : Terrain
    options : HorizonOptions
    count : int
        Azimuths to sweep.
    """

    def __init__(self, terrain: Terrain, options: HorizonOptions, count: int) -> None:
        threads = jit.threads()
        rounds = -(-count // threads)
        bands = len(terrain.latitude_bands(methods.MAX_AZIMUTH_ERROR))
        room = own_bytes(terrain.view.heights.size, threads, bands) and terrain.view.frames is None
        together = room and options.method == "sweep" and count >= LEAST_SHARE * threads * rounds
        self._shape = terrain.shape
        self._engines = [
            methods.ENGINES[options.method](terrain, options)
            for _ in range(threads if together else 1)
        ]

    @property
    def left_out(self) -> Counter[str]:
        """Receivers left out so far, by the names of `skips.SKIPS`."""
        return sum((engine.left_out for engine in self._engines), Counter[str]())

    def layers(
        self, numbers: Sequence[int], fill: Fill, targets: Sequence[Layer] | None = None
    ) -> Generator[tuple[int, Layer]]:
        """Yield (number, layer) in the order of `numbers`, swept by `fill`(engine, number, layer).

        Layers are those of `targets`, by number, else arrays that are used again: consume each
        before the next step.
        """
        if len(self._engines) == 1:
            own = np.empty(self._shape if targets is None else 0, np.float32)
            for number in numbers:
                layer = own if targets is None else targets[number]
                fill(self._engines[0], number, layer)
                yield number, layer
            return
        threads = [ThreadPoolExecutor(1, "adret-sweep", jit.threads, (1,)) for _ in self._engines]
        ahead = 2 * len(threads)  # a thread need not wait until its layer is consumed
        own = np.empty((ahead, *self._shape) if targets is None else 0, np.float32)
        waiting: deque[tuple[int, Layer, Future[None]]] = deque()

        def order(place: int) -> None:
            number, turn = numbers[place], place % len(threads)
            layer = own[place % ahead] if targets is None else targets[number]
            work = threads[turn].submit(fill, self._engines[turn], number, layer)
            waiting.append((number, layer, work))

        before = jit.threads()
        jit.threads(max(before // 4, 1))  # what consumes layers has the time of all sweeps for it
        try:
            for place in range(min(ahead, len(numbers))):
                order(place)
            for place in range(len(numbers)):
                number, layer, work = waiting.popleft()
                work.result()
                yield number, layer
                if place + ahead < len(numbers):
                    order(place + ahead)
        finally:
            jit.threads(before)
            for thread in threads:
                thread.shutdown(wait=True, cancel_futures=True)
