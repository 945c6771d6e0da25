"""Large jobs tile by tile: the same bytes, and nothing that is done is done again.

Runs in the computing process. The library's own batch does the work: a tile appears whole or not
at all and counts once its receipt with a SHA-256 lies beside it, so that several attempts may meet
in one folder, and a damaged tile is made anew. Results are those of the whole raster to the byte.
"""

import errno
import math
import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from numpy.typing import NDArray

from adret._gdal import GDAL_OPTIONS
from adret.errors import InputError
from adret.geodesy import parse_crs
from adret.grids import RasterGrid
from adret.horizon import HorizonOptions
from adret.parameters import BodyParameters, BounceParameters, Parameters
from adret.previews import preview
from adret.tiling import Job, Surface, jobs, plan, prepare, run_batch
from adret.tiling.batches import MANIFEST
from adret.tiling.executors import Order, Outcome
from adret.tiling.surfaces import Piece
from adret.tiling.tasks import check_tiled

__all__ = ["Tiles", "compute_tiled", "tiled_job"]

MOST = 3  # tiles a side without a range: each sweeps its lines from the raster's edge
EVEN = 16  # cells that a tile's side is a multiple of
FULL_DISK = (errno.ENOSPC, errno.EDQUOT)
PASSES = 8  # of bounces until they converge, a guess for the progress
# Shadows are one sweep and viewsheds follow observers, not tiles: both are computed whole.
DUSK = {"colours": "dusk"}
LIGHT = {"low": 0.0, "gamma": 1.5}
PICTURES: dict[str, dict[str, Any]] = {
    "horizon": DUSK,
    "sky-view": {},
    "openness": {},
    "light": LIGHT,
    "bounce": LIGHT,
    "visibility": DUSK,
}
"""Products that are computed in tiles, and how their pictures look; see `adret.products`."""

Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Tiles:
    """How an attempt at a job went: tiles in all, found done, and made by it."""

    tiles: int
    found: int
    made: int


def tiled_job(
    process: str, parameters: Parameters, raster: Path, info: dict[str, Any], order: dict[str, Any]
) -> Job | None:
    """Return the job as tiles; None if it cannot be cut, or the disk has no room for that.

    Parameters
    ----------
    process : str
    parameters : Parameters
        Of the process.
    raster : Path
        The dataset's raster.
    info : dict
        What the service knows of it.
    order : dict
        folder of the job, size of its tiles [cells], room [bytes] that they may take in all.
    """
    if process not in PICTURES or not isinstance(parameters, BodyParameters):
        return None
    grid = _grid(info)
    try:
        size = _side(int(order["size"]), grid, parameters)
    except InputError:
        return None
    if max(grid.shape) <= size:
        return None
    surface = Surface((Piece(str(raster), 0, 0, grid.shape),), grid, 1, "m", 4, info["datum"])
    try:
        job = Job(surface, {process: parameters}, size)
        check_tiled(job)
    except InputError:
        return None  # cannot be cut, or is wrong, which the run of the whole says
    return job if plan(job, 1, 1).disk_bytes <= int(order["room"]) else None


def compute_tiled(
    job: Job,
    folder: Path,
    result: Path,
    picture: Path,
    progress: Progress,
    say: Callable[[str], None],
) -> Tiles:
    """Make what is missing of a job, and put it together.

    Parameters
    ----------
    job : Job
        Of one product.
    folder : Path
        Of the job. Every form of it has a folder in there: after an upgrade tiles begin again.
    result, picture : Path
        Files to write. The folder keeps the result, too, until it is dropped.
    progress : callable
        Called as progress(done, total) between tiles; what it raises ends the run.
    say : callable
        Gets a line about what was found done.

    Raises
    ------
    AdretError, OSError
        As the library raises them. Tiles that are done stay.
    """
    out = folder / jobs.digest(job.document())[:16]
    here = Here(job, out, progress, say)
    try:
        made = _made(job, out, here)
    except (InputError, OSError) as error:
        if getattr(error, "errno", None) in FULL_DISK or not _finished(out):
            raise
        made = _made(job, out, here)  # another attempt put the result together, and took the tiles
    finally:
        jobs._frames.cache_clear()  # else its maps keep the disk from being freed
    if not here.began:
        say("resumed: the result was there")
    result.unlink(missing_ok=True)
    try:
        os.link(made, result)
    except OSError:  # a file system without links
        shutil.copyfile(made, result)
    _draw(made, picture, job)
    return Tiles(tiles=len(job.tiles), found=here.found, made=here.made)


class Here:
    """Makes tiles in this process, one after another; an executor of the library's.

    Parameters
    ----------
    job : Job
    out : Path
        Folder of this form of it.
    progress, say : callable
        See `compute_tiled`.
    """

    def __init__(self, job: Job, out: Path, progress: Progress, say: Callable[[str], None]) -> None:
        (name,) = job.products
        given = job.products[name]
        passes = 1
        if isinstance(given, BounceParameters):
            passes = 2 + (PASSES if given.bounces == "converge" else int(given.bounces))
        self.tiles = len(job.tiles)
        self.began = False
        self.found = self.made = 0
        self._progress, self._say = progress, say
        self._total = passes * self.tiles
        self._receipts = len(list((out / jobs.FOLDER / name).glob("r*.json")))

    def map(self, orders: Sequence[Order]) -> Iterator[Outcome]:
        """Make those tiles that are missing, of a product or of one of its passes."""
        there = self.tiles - len(orders)
        if not self.began and (there or self._receipts):
            of = f" of {orders[0].product}" if orders and "/" in orders[0].product else ""
            damaged = self._receipts - there
            again = f"; {damaged} more were damaged" if damaged > 0 else ""
            self._say(f"resumed: {there} of {self.tiles} tiles{of} were there{again}")
        self.began = True
        self.found += there
        for order in orders:
            self._progress(min(self.found + self.made, self._total - 1), self._total)
            written = jobs.run_tile(order.out, order.product, order.row, order.column)
            self.made += 1
            yield Outcome(order, written)
        self._progress(min(self.found + self.made, self._total - 1), self._total)

    def close(self) -> None:
        """Nothing is held."""


def _made(job: Job, out: Path, here: Here) -> Path:
    """Run the batch in its folder; returns the result."""
    try:
        prepare(job, out, resume=True)
    except InputError:  # its note of the job is damaged
        prepare(job, out, overwrite=True)
    (report,) = run_batch(job, out, here).products
    return out / report.file


def _finished(out: Path) -> bool:
    """Whether a result was put together here."""
    return (out / MANIFEST).exists()


def _grid(info: dict[str, Any]) -> RasterGrid:
    """Where a dataset lies, as the decoder said; its file cannot carry every reference system."""
    from affine import Affine

    transform = info["transform"]
    return RasterGrid(
        parse_crs(info["crs"]),
        None if transform is None else Affine(*transform),
        (info["rows"], info["columns"]),
        (info["cell_size"][0], info["cell_size"][1]),
    )


def _side(least: int, grid: RasterGrid, parameters: BodyParameters) -> int:
    """Cells a side of a tile: as set, or more where smaller ones would cost too much."""
    rows, _ = grid.shape
    if parameters.max_distance is None:
        enough = math.ceil(max(grid.shape) / MOST)
    else:
        enough = HorizonOptions(max_distance=parameters.max_distance).halo_of(grid, 0, rows)
    return max(least, math.ceil(enough / EVEN) * EVEN)


def _draw(raster: Path, picture: Path, job: Job) -> None:
    """Draw the picture that the product's own run draws, from the numbers in its file.

    Only of horizons that are stored in 16 bits it may be off, by less than a step of 0.003 degrees.
    """
    (name,) = job.products
    with rasterio.Env(**GDAL_OPTIONS), rasterio.open(raster, driver="GTiff") as source:
        if name == "horizon":
            layer = np.zeros(source.shape, np.float32)
            for band in source.indexes:
                layer += np.maximum(_values(source, band), np.float32(0.0))
            layer /= np.float32(source.count)
        elif source.count == 1:
            layer = _values(source, 1)
        else:
            layer = np.stack([_values(source, band) for band in source.indexes], axis=-1)
    preview(picture, layer, cell_size=job.surface.grid.cell_size, **PICTURES[name])


def _values(source: Any, band: int) -> NDArray[np.float32]:
    """The numbers of a band, NaN at nodata."""
    stored = source.read(band)
    values: NDArray[np.float32] = stored.astype(np.float32)
    scale, offset = source.scales[band - 1], source.offsets[band - 1]
    if (scale, offset) != (1.0, 0.0):
        values = (stored * scale + offset).astype(np.float32)
    if stored.dtype.kind != "f":
        values[stored == source.nodata] = np.nan
    return values
