"""A raster on disk, turned as the sweeps need it: for tiles that see all of it, however far.

Without a range a tile's horizon may be anywhere, and the lines that pass the tile begin at the
raster's edge. The heights then lie in files, one for each octant of azimuths that is asked for, and
are mapped: a sweep touches the lines of its tile and no others, and what it touched is let go
afterwards. Memory is bounded by the lines of one tile, 4 bytes a sample; disk by 36 bytes a cell.
"""

import contextlib
import fcntl
import mmap
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from adret._gdal import atomic
from adret.grids import TerrainView
from adret.sweep import RIGHT, Orientation, padding
from adret.terrain import Terrain
from adret.tiling.surfaces import Surface

__all__ = ["StoredFrames"]

ROWS = 512  # rows that are written at once

Layer = NDArray[np.float32]


class StoredFrames:
    """Turned copies of a surface's heights, made when they are first asked for.

    Parameters
    ----------
    surface : Surface
    folder : Path
        Where the files are; shared by all workers.
    sign : int
        1, or -1 for the surface turned upside down.
    """

    def __init__(self, surface: Surface, folder: Path, sign: int = 1) -> None:
        self.surface = surface
        self.folder = folder
        self.sign = sign
        self._maps: dict[Path, tuple[mmap.mmap, Layer]] = {}

    def upside_down(self) -> "StoredFrames":
        """The same of the surface upside down."""
        return StoredFrames(self.surface, self.folder, -self.sign)

    def tile(self, rows: tuple[int, int], columns: tuple[int, int]) -> Terrain:
        """The tile of the surface that sees all of it."""
        surface = self.surface
        view = TerrainView(self.heights(), rows[0], columns[0], self)
        shape = (rows[1] - rows[0], columns[1] - columns[0])
        return Terrain.of_view(
            view, shape, (0, 0), surface.grid, surface.datum, surface.vertical_unit
        )

    def heights(self) -> Layer:
        """The whole raster [m above the datum], north-up and mapped."""
        path = self.folder / f"heights{self._ending()}"
        shape = self.surface.grid.shape

        def rows() -> Iterator[Layer]:
            for top in range(0, shape[0], ROWS):
                strip = self.surface.heights((top, min(top + ROWS, shape[0])), (0, shape[1]))
                yield strip if self.sign > 0 else -strip

        return self._mapped(path, shape, rows)

    def frame(self, orientation: Orientation, near: int) -> Layer:
        """The padded raster that `SweepFrame` would make for an octant, mapped."""
        name = "".join(
            "ny"[flag]
            for flag in (orientation.swap, orientation.flip_rows, orientation.flip_columns)
        )
        path = self.folder / f"frame-{name}-{near}{self._ending()}"
        north_up = self.surface.grid.shape
        shape = north_up[::-1] if orientation.swap else north_up
        above, left = padding((shape[0], shape[1]), near)

        def rows() -> Iterator[Layer]:
            source = self.heights()
            turned = source.T if orientation.swap else source
            if orientation.flip_rows:
                turned = turned[::-1]
            if orientation.flip_columns:
                turned = turned[:, ::-1]
            for top in range(-above, shape[0], ROWS):
                bottom = min(top + ROWS, shape[0])
                block = np.full((bottom - top, left + shape[1] + RIGHT), np.nan, np.float32)
                first = max(top, 0)
                if bottom > first:
                    block[first - top :, left:-RIGHT] = turned[first:bottom]
                yield block
                self.drop()

        return self._mapped(path, (above + shape[0], left + shape[1] + RIGHT), rows)

    def drop(self) -> None:
        """Let go of the memory of what was touched; the files stay."""
        for mapped, _ in self._maps.values():
            mapped.madvise(mmap.MADV_DONTNEED)

    def _ending(self) -> str:
        return ".f32" if self.sign > 0 else "-upside-down.f32"

    def _mapped(
        self, path: Path, shape: tuple[int, int], rows: Callable[[], Iterator[Layer]]
    ) -> Layer:
        if path not in self._maps:
            if not path.exists():
                self._make(path, rows)
            with path.open("rb") as file:
                # Private, so that the array may be written, though it never is: kernels are
                # compiled apart for arrays that may not.
                mapped = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY)
            self._maps[path] = mapped, np.frombuffer(mapped, np.float32).reshape(shape)
        return self._maps[path][1]

    def _make(self, path: Path, rows: Callable[[], Iterator[Layer]]) -> None:
        """Write a file, whole or not at all; of several workers here one writes, others wait."""
        path.parent.mkdir(parents=True, exist_ok=True)
        with _lock(path.with_suffix(".lock")):
            if path.exists():
                return
            with atomic(path) as unfinished, unfinished.open("wb") as file:
                for block in rows():
                    file.write(np.ascontiguousarray(block).data)


@contextlib.contextmanager
def _lock(path: Path) -> Iterator[None]:
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)
