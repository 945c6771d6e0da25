"""A batch from the first header to the last file: run what is not done, put it together, say so."""

import os
import shutil
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adret._gdal import GDAL_OPTIONS
from adret.cogs import write_windows
from adret.errors import RasterError
from adret.tiling import bounces
from adret.tiling.executors import Order, Outcome, TileExecutor
from adret.tiling.jobs import (
    FOLDER,
    FRAMES,
    Job,
    check_same,
    check_tile,
    digest,
    read_json,
    receipt,
    tile_path,
    write_json,
)
from adret.tiling.stores import file_of, store_digest, write_store
from adret.tiling.tasks import Span, Tile, Written, check_tiled, file_digest, overlap

__all__ = ["BatchReport", "ProductReport", "check_folder", "prepare", "run_batch"]

MANIFEST = "manifest.json"

Progress = Callable[[str, int, int], None]
Window = tuple[int, tuple[int, int], tuple[int, int], NDArray[Any]]


@dataclass(slots=True, kw_only=True)
class ProductReport:
    """What became of one product.

    Attributes
    ----------
    product : str
    file : str
        Name of the result in the output folder; empty if there is none.
    tiles, resumed : int
        Tiles in all, and those that were done before this run.
    errors : list of str
        One line a tile that failed.
    seconds : float
        Wall time of this run [s].
    tile_seconds : float
        Sum over the workers [s].
    peak_rss : int
        Largest resident memory of any worker [bytes].
    samples : int
        Cells times azimuths that were swept.
    """

    product: str
    file: str = ""
    tiles: int = 0
    resumed: int = 0
    errors: list[str] = field(default_factory=list)
    seconds: float = 0.0
    tile_seconds: float = 0.0
    peak_rss: int = 0
    samples: int = 0


@dataclass(slots=True)
class BatchReport:
    """What became of a batch."""

    products: list[ProductReport] = field(default_factory=list)

    @property
    def failed(self) -> bool:
        """Whether any tile is missing."""
        return any(each.errors for each in self.products)


def prepare(
    job: Job, out: Path, *, resume: bool = False, overwrite: bool = False, form: str = "cog"
) -> None:
    """Make the output folder of a job, or see that it holds this very job.

    Raises
    ------
    RasterError
        If the folder holds a job or a result, and neither `resume` nor `overwrite` is given.
    InputError
        If the job to resume is another one, or the format `form` (see `FORMATS`) is not known.
    """
    check_tiled(job)
    check_folder(out)
    path = out / FOLDER / "job.json"
    known = read_json(path)
    results = [out / file_of(name, form) for name in job.products]
    if known is not None and resume:
        check_same(known, job.document())
        return
    if resume and path.exists():
        raise RasterError("resume", "of a job that can be read (or overwrite)", str(path))
    if not overwrite and any(each.exists() for each in (path, *results)):
        raise RasterError("out", "a new folder (or resume, or overwrite)", str(out))
    out.mkdir(exist_ok=True)
    if overwrite:
        shutil.rmtree(out / FOLDER, ignore_errors=True)
        (out / MANIFEST).unlink(missing_ok=True)
    job.write(out)


def check_folder(out: Path) -> None:
    """Refuse a place that can be no output folder.

    Raises
    ------
    RasterError
        Saying why.
    """
    if not out.parent.is_dir():
        raise RasterError("out", "in a folder that exists", str(out))
    if out.exists() and not out.is_dir():
        raise RasterError("out", "a folder", str(out))
    if not os.access(out if out.exists() else out.parent, os.W_OK | os.X_OK):
        raise RasterError("out", "in a folder that can be written", str(out))


def run_batch(
    job: Job,
    out: Path,
    executor: TileExecutor,
    progress: Progress | None = None,
    *,
    form: str = "cog",
) -> BatchReport:
    """Run the tiles of a prepared job that are not done, and write the results.

    Parameters
    ----------
    job : Job
    out : Path
        Folder that `prepare` made.
    executor : TileExecutor
        Where the tiles run; it stays open.
    progress : callable, optional
        Called as progress(product, tiles done, tiles).
    form : str
        Format of the results: "cog"; "zarr", in whole shards; "zarr2", of version 2.

    Returns
    -------
    BatchReport
        A product with a tile that failed has no result; its other tiles are kept for a resumption.
    """
    found = BatchReport()
    for product in job.products:
        found.products.append(_run_product(job, out.absolute(), product, executor, progress, form))
    if not found.failed:
        shutil.rmtree(out / FOLDER / FRAMES, ignore_errors=True)
    return found


def _run_product(
    job: Job,
    out: Path,
    product: str,
    executor: TileExecutor,
    progress: Progress | None,
    form: str,
) -> ProductReport:
    start = time.perf_counter()
    tiles = job.tiles
    report = ProductReport(product=product, tiles=len(tiles))
    file = file_of(product, form)
    if _is_written(out, product, job, form):
        report.file, report.resumed = file, len(tiles)
        return report
    orders = _Orders(out, executor, report, progress)
    if product == "bounce" and len(tiles) > 1:
        _run_passes(job, orders)
    if not report.errors:
        orders.run(product, tiles)
        report.resumed = orders.resumed
    if not report.errors:
        receipts = [_receipt(out, product, tile) for tile in tiles]
        _assemble(job, out, product, receipts[0], form)
        report.file = file
        _remember(out, job, product, receipts, report, form)
        shutil.rmtree(out / FOLDER / product)
    report.seconds = time.perf_counter() - start
    return report


class _Orders:
    """Has tiles of one product made, and counts them."""

    def __init__(
        self, out: Path, executor: TileExecutor, report: ProductReport, progress: Progress | None
    ) -> None:
        self.out = out
        self.report = report
        self._executor = executor
        self._progress = progress
        self.resumed = 0

    def run(self, product: str, tiles: list[Tile]) -> None:
        """Make those tiles of a product, or of one of its passes, that are not done."""
        waiting = [tile for tile in tiles if not check_tile(self.out, product, tile)]
        self.resumed = done = len(tiles) - len(waiting)
        orders = [Order(str(self.out), product, tile.rows[0], tile.columns[0]) for tile in waiting]
        for outcome in self._executor.map(orders):
            _count(self.report, outcome)
            done += 1
            if self._progress is not None:
                self._progress(product, done, len(tiles))


def _run_passes(job: Job, orders: _Orders) -> None:
    """Make the passes of bounces, until one of them is the last."""
    folder, tiles = orders.out / FOLDER / bounces.PRODUCT, job.tiles
    passes, number = bounces.Passes(job), 0
    # Of the passes that are done, the first two and the latest are still needed.
    known = sorted(int(path.stem) for path in folder.glob("[0-9]*.json"))
    needed = [k for k in known if k in (0, 1, known[-1])]
    names = [bounces.pass_name(k) for k in needed]
    if not all(check_tile(orders.out, name, tile) for name in names for tile in tiles):
        shutil.rmtree(folder)
        known = []
    while True:
        name, state = bounces.pass_name(number), folder / f"{number}.json"
        if number in known:
            found = read_json(state) or {}
        else:
            orders.run(name, tiles)
            if orders.report.errors:
                return
            found = {"tiles": [list(_maxima(orders.out, name, tile)) for tile in tiles]}
        found |= passes.count(number, found["tiles"])
        write_json(state, found)
        if passes.done:
            write_json(folder / bounces.LAST, found)
        if number > 2:
            shutil.rmtree(folder / str(number - 1), ignore_errors=True)
        if passes.done:
            return
        number += 1


def _maxima(out: Path, name: str, tile: Tile) -> list[float]:
    return list(_receipt(out, name, tile).about["maxima"])


def _count(report: ProductReport, outcome: Outcome) -> None:
    written = outcome.written
    if written is None:
        place = f"row {outcome.order.row} column {outcome.order.column}"
        report.errors.append(f"{report.product} at {place}: {outcome.error}")
        return
    report.tile_seconds += written.seconds
    report.peak_rss = max(report.peak_rss, written.peak_rss)
    report.samples += written.cells * written.azimuths


def _receipt(out: Path, product: str, tile: Tile) -> Written:
    written = receipt(out, product, tile)
    if written is None:
        raise RasterError("tile", "on the disk that the workers write to", tile.name)
    return written


def _assemble(job: Job, out: Path, product: str, written: Written, form: str) -> None:
    """Write the result from the tiles: the file that the product's own command writes, or Zarr."""
    about = written.about
    if form != "cog":

        def read(band: int, rows: Span, columns: Span) -> NDArray[Any]:
            return _part(job, out, product, band, rows, columns)

        version = 2 if form == "zarr2" else 3
        target, grid = out / file_of(product, form), job.surface.grid
        write_store(target, read, grid, name=product, about=about, version=version)
        return
    write_windows(
        out / f"{product}.tif",
        _windows(job, out, product, len(about["names"])),
        job.surface.grid,
        names=about["names"],
        unit=about["unit"],
        tags=about["tags"],
        **about["encoding"],
    )


def _windows(job: Job, out: Path, product: str, bands: int) -> Iterator[Window]:
    """The numbers of all tiles, band by band."""
    import rasterio

    for index in range(bands):
        for tile in job.tiles:
            path = tile_path(out, product, tile)
            with rasterio.Env(**GDAL_OPTIONS), rasterio.open(path, driver="GTiff") as dataset:
                numbers = np.asarray(dataset.read(index + 1))
            yield index, tile.rows, tile.columns, numbers


def _part(job: Job, out: Path, product: str, band: int, rows: Span, columns: Span) -> NDArray[Any]:
    """The stored numbers of a window, from the tiles that it touches."""
    import rasterio

    found: NDArray[Any] | None = None
    for tile in job.tiles:
        down, across = overlap(tile.rows, rows), overlap(tile.columns, columns)
        if down[0] >= down[1] or across[0] >= across[1]:
            continue
        path, corner = tile_path(out, product, tile), (tile.rows[0], tile.columns[0])
        with rasterio.Env(**GDAL_OPTIONS), rasterio.open(path, driver="GTiff") as dataset:
            window = tuple(
                (span[0] - first, span[1] - first)
                for span, first in zip((down, across), corner, strict=True)
            )
            numbers = np.asarray(dataset.read(band + 1, window=window))
        if found is None:
            found = np.empty((rows[1] - rows[0], columns[1] - columns[0]), numbers.dtype)
        found[
            down[0] - rows[0] : down[1] - rows[0], across[0] - columns[0] : across[1] - columns[0]
        ] = numbers
    assert found is not None
    return found


def _remember(
    out: Path,
    job: Job,
    product: str,
    receipts: list[Written],
    report: ProductReport,
    form: str,
) -> None:
    """Enter a result into the manifest."""
    manifest = {"products": {}} | (read_json(out / MANIFEST) or {})
    manifest["job"] = digest(job.document())
    path = out / report.file
    manifest["products"][product] = {
        "file": report.file,
        "format": form,
        "bytes": sum(each.stat().st_size for each in _files(path)),
        "sha256": _digest(path),
        "tiles": {
            tile.name: written.sha256 for tile, written in zip(job.tiles, receipts, strict=True)
        },
        "tile_seconds": sum(written.seconds for written in receipts),
        "peak_rss": max(written.peak_rss for written in receipts),
    }
    write_json(out / MANIFEST, manifest)


def _files(path: Path) -> list[Path]:
    return [path] if path.is_file() else [each for each in path.rglob("*") if each.is_file()]


def _digest(path: Path) -> str:
    return file_digest(path) if path.is_file() else store_digest(path)


def _is_written(out: Path, product: str, job: Job, form: str) -> bool:
    """Whether the manifest has the product's file, and the file is that one."""
    manifest = read_json(out / MANIFEST)
    if manifest is None or manifest.get("job") != digest(job.document()):
        return False
    known = manifest.get("products", {}).get(product)
    path = out / file_of(product, form)
    if known is None or known.get("format", "cog") != form or not path.exists():
        return False
    return bool(_digest(path) == known["sha256"])
