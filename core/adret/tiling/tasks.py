"""Products that can be cut into tiles, the cut itself, and the one function that makes a tile."""

import hashlib
import resource
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from adret._gdal import GDAL_OPTIONS, atomic
from adret.errors import InputError
from adret.parameters import (
    BodyParameters,
    Parameters,
    ViewshedParameters,
    VisibilityParameters,
)

if TYPE_CHECKING:
    from adret.products import Product, Result
    from adret.terrain import Terrain
    from adret.tiling.frames import StoredFrames
    from adret.tiling.jobs import Job

__all__ = ["TILED", "Tile", "Written", "check_tiled", "cut", "make_tile", "tiled_product"]

TILED = {
    "horizon": "horizon",
    "sky": "sky-view",
    "sky-view": "sky-view",
    "openness": "openness",
    "shadow": "shadow",
    "light": "light",
    "visibility": "visibility",
    "viewshed": "viewshed",
    "bounce": "bounce",
}
"""Names that a batch takes, and the products that they stand for."""

WINDOWED = ("visibility",)
"""Products that are computed of a tile's halo as well, and then cut."""

RANGED = ("visibility", "viewshed", "bounce")
"""Products that can be cut only with a range."""

FOLDER = ".adret-tiles"
"""Of an output folder, where job and tiles are."""

TILE_CACHE = 64  # MiB of GDAL's block cache in a worker
BLOCK = 512  # cells a side of a block in a tile's file

Span = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Tile:
    """Rows and columns of a surface that are computed together."""

    rows: Span
    columns: Span

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.rows[1] - self.rows[0], self.columns[1] - self.columns[0]

    @property
    def name(self) -> str:
        """Of its file, without an ending."""
        return f"r{self.rows[0]:06d}-c{self.columns[0]:06d}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Written:
    """What is known of a tile that was made: its receipt.

    Attributes
    ----------
    sha256 : str
        Of the tile's file.
    bytes : int
        Length of the file.
    cells, azimuths : int
        Of the tile, and swept for it.
    seconds, cpu_seconds : float
        Wall time, and time of all threads together [s].
    peak_rss : int
        Largest resident memory of the worker so far [bytes].
    about : dict
        Names, unit, tags and encoding of the bands.
    """

    sha256: str
    bytes: int
    cells: int
    azimuths: int
    seconds: float
    cpu_seconds: float
    peak_rss: int
    about: dict[str, Any]


def tiled_product(name: str) -> "Product":
    """The product of that name, if it can be tiled.

    Raises
    ------
    InputError
        Naming those that can.
    """
    from adret.products import PRODUCTS

    if name not in TILED:
        raise InputError("product", f"one of {', '.join(TILED)}", name)
    return PRODUCTS[TILED[name]]


def check_tiled(job: "Job") -> None:
    """Refuse what cannot be cut without a trace.

    Raises
    ------
    InputError
        For surroundings, or products that need one, without a range; for observers that cannot
        be; or where sums of lengths would be rounded in another order.
    """
    from adret.methods import MAX_AZIMUTH_ERROR
    from adret.tiling import sights

    for name, parameters in job.products.items():
        assert isinstance(parameters, BodyParameters)
        if job.surface.surroundings is not None and parameters.max_distance is None:
            raise InputError("max_distance", "given with surroundings", None)
        if name not in RANGED or len(job.tiles) == 1:
            continue
        if parameters.max_distance is None:
            raise InputError("max_distance", f"given for {name} in tiles", None)
        if job.surface.surroundings is not None and name != "visibility":
            raise InputError("surroundings", f"left out for {name}", job.surface.surroundings.path)
        if isinstance(parameters, ViewshedParameters):
            sights.check_observers(job.surface, parameters)
        if not isinstance(parameters, VisibilityParameters):
            continue
        grid = job.surface.grid
        counts = parameters.measure in ("visible-count", "horizon-count", "max-sight-distance")
        if not counts and len(grid.bands(0, grid.shape[0], MAX_AZIMUTH_ERROR)) > 1:
            limit = "a count, or max-sight-distance, in tiles across bands of latitude"
            raise InputError("measure", limit, parameters.measure)


def cut(shape: tuple[int, int], size: int) -> list[Tile]:
    """Tiles of `size` cells a side, the last ones smaller, row by row.

    Examples
    --------
    >>> [tile.name for tile in cut((3, 4), 2)]
    ['r000000-c000000', 'r000000-c000002', 'r000002-c000000', 'r000002-c000002']
    """
    return [
        Tile((top, min(top + size, shape[0])), (left, min(left + size, shape[1])))
        for top in range(0, shape[0], size)
        for left in range(0, shape[1], size)
    ]


def make_tile(
    job: "Job",
    product: str,
    tile: Tile,
    path: Path,
    frames: "StoredFrames | None" = None,
    out: Path | None = None,
) -> Written:
    """Compute one tile of one product and write its numbers as they will be stored.

    The result hangs on nothing but the job's file and the rasters that it names: any process on
    any machine that sees them writes the same bytes.

    Parameters
    ----------
    job : Job
    product : str
        Of `PRODUCTS`.
    tile : Tile
    path : Path
        GeoTIFF to write; it appears whole or not at all.
    frames : StoredFrames, optional
        Where a tile that sees the whole raster finds it; without them it is read into memory.
    out : Path, optional
        Output folder, for products that are made in passes.
    """
    from adret.report import last_run_report

    measured = meter()
    result, terrain = _computed(job, product, tile, frames, out)
    _write(path, terrain, result)
    report = last_run_report()
    return measured(
        path,
        cells=terrain.mask.size,
        azimuths=0 if report is None else report.azimuths_swept,
        about={
            "names": list(result.names),
            "unit": result.unit,
            "tags": result.tags,
            "encoding": result.encoding,
        },
    )


def _computed(
    job: "Job", product: str, tile: Tile, frames: "StoredFrames | None", out: Path | None
) -> tuple["Result", "Terrain"]:
    """A tile's layers, and the tile."""
    from adret.tiling import bounces, sights

    parameters = job.products[product]
    if len(job.tiles) > 1 and isinstance(parameters, ViewshedParameters):
        return sights.result(job, parameters, tile)
    if len(job.tiles) > 1 and product == "bounce":
        assert out is not None
        return bounces.result(job, tile, out)
    margin = halo(job, parameters, tile)
    if margin is None and frames is not None:
        terrain = frames.tile(tile.rows, tile.columns)
    else:
        terrain = job.surface.tile(tile.rows, tile.columns, margin)
    if product in WINDOWED:
        result = tiled_product(product).compute(around(terrain), parameters, None)
        return replace(result, layers=np.asarray(result.layers)[core(terrain)]), terrain
    return tiled_product(product).compute(terrain, parameters, None), terrain


class Meter(Protocol):
    """Ends a measurement of time, and writes the receipt of what was made meanwhile."""

    def __call__(
        self, path: Path, *, cells: int, azimuths: int, about: dict[str, Any]
    ) -> Written: ...


def meter() -> Meter:
    """Begin to measure what a file costs."""
    start, cpu = time.perf_counter(), time.process_time()

    def measured(path: Path, *, cells: int, azimuths: int, about: dict[str, Any]) -> Written:
        return Written(
            sha256=file_digest(path),
            bytes=path.stat().st_size,
            cells=cells,
            azimuths=azimuths,
            seconds=time.perf_counter() - start,
            cpu_seconds=time.process_time() - cpu,
            peak_rss=peak_rss(),
            about=about,
        )

    return measured


def tile_path(out: Path, product: str, tile: Tile) -> Path:
    """The file of a tile of a product, or of a pass of one (``bounce/2``)."""
    return out / FOLDER / product / f"{tile.name}.{'npz' if '/' in product else 'tif'}"


def overlap(one: Span, other: Span) -> Span:
    """What two spans share; its end is not after its start if that is nothing."""
    return max(one[0], other[0]), min(one[1], other[1])


def halo(job: "Job", parameters: Parameters, tile: Tile) -> int | None:
    """Cells round a tile that it sees; None for all there are."""
    from adret.horizon import HorizonOptions

    assert isinstance(parameters, BodyParameters)
    if parameters.max_distance is None:
        return None
    options = HorizonOptions(max_distance=parameters.max_distance)
    return options.halo_of(job.surface.grid, *tile.rows)


def encoded(result: "Result") -> Iterator[tuple[int, NDArray[Any]]]:
    """The layers of a result as the numbers that are stored."""
    from adret.cogs import encoder

    encoding = result.encoding
    encode = encoder(
        encoding.get("dtype", "float32"),
        encoding.get("scale"),
        encoding.get("offset"),
        encoding.get("nodata", np.nan),
    )
    layers: Any = result.layers
    if isinstance(layers, np.ndarray):
        layers = enumerate(layers[np.newaxis] if layers.ndim == 2 else layers)
    for index, layer in layers:
        yield index, encode(layer)


def core(terrain: "Terrain") -> tuple[slice, slice]:
    """A tile's own cells in all that it sees."""
    top, left = terrain.view[1:3]
    return slice(top, top + terrain.shape[0]), slice(left, left + terrain.shape[1])


def around(terrain: "Terrain") -> "Terrain":
    """All that a tile sees, as a terrain."""
    view, (row, column) = terrain.view, terrain.origin
    return terrain.of_view(
        view._replace(top=0, left=0),
        view.heights.shape,
        (row - view.top, column - view.left),
        terrain.grid,
        terrain.datum,
        terrain.vertical_unit,
    )


def _write(path: Path, terrain: "Terrain", result: "Result") -> None:
    """Write a tile's file, whole or not at all."""
    import rasterio

    from adret.cogs import describe, geotransform

    rows, columns = terrain.shape
    dtype = result.encoding.get("dtype", "float32")
    profile = {
        "driver": "GTiff",
        "height": rows,
        "width": columns,
        "count": len(result.names),
        "dtype": dtype,
        "nodata": result.encoding.get("nodata", np.nan),
        "crs": None if terrain.crs is None else terrain.crs.to_wkt(),
        "transform": geotransform(terrain),
        "tiled": True,
        "blockxsize": min(BLOCK, -(-columns // 16) * 16),
        "blockysize": min(BLOCK, -(-rows // 16) * 16),
        "interleave": "band",
        "compress": "zstd",
        "zstd_level": 1,
        "predictor": 3 if dtype == "float32" else 2,
        "bigtiff": "if_safer",
    }
    options = GDAL_OPTIONS | {"GDAL_CACHEMAX": TILE_CACHE}
    with (
        atomic(path) as unfinished,
        rasterio.Env(**options),
        rasterio.open(unfinished, "w", **profile) as dataset,
    ):
        describe(
            dataset,
            result.names,
            result.unit,
            result.tags,
            result.encoding.get("scale"),
            result.encoding.get("offset"),
        )
        for index, layer in encoded(result):
            dataset.write(layer, index + 1)


def file_digest(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def peak_rss() -> int:
    """Largest resident memory of this process so far [bytes]."""
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
