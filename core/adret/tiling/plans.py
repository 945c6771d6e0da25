"""What a batch will cost before it starts: tiles, passes, memory, bytes, time."""

import math
import os
import shutil
from dataclasses import dataclass
from pathlib import Path

from adret import methods
from adret.errors import InputError
from adret.parameters import (
    BodyParameters,
    BounceParameters,
    HorizonParameters,
    LightParameters,
    Parameters,
    RoundParameters,
    ShadowParameters,
    SkyViewParameters,
    SourceParameters,
    ViewshedParameters,
    VisibilityParameters,
)
from adret.sweepers import own_bytes
from adret.tiling import bounces
from adret.tiling.jobs import Job
from adret.tiling.tasks import TILE_CACHE, halo

__all__ = ["Plan", "ProductPlan", "check_memory", "plan", "worker_bytes"]

# Python, NumPy, Numba with its compiler, GDAL and PROJ, before any raster is read [bytes].
PROCESS = 400 << 20
# Nanoseconds of one core a cell and azimuth: what the near field does not do, and each of its
# cells; measured on 2 cores, see benchmarks/scale.
SWEEP_NS, NEAR_NS = 12.0, 0.25
BOUNCE_NS = 300.0  # of a bounce, see benchmarks/bounces.py
SWEPT_AGAIN = 0.15  # of a sweep, for each further time that a line is swept without a range
PAGE = 4096  # bytes
SIGHT_BYTES = 160  # a cell that a tile of visibility sees: frames of all octants
VIEWSHED_BYTES = 40  # a cell that a tile of viewsheds sees: counts, bits, heights
PASS_BYTES = 12  # a cell and band of a pass of bounces on disk
BOUNCES = 6  # until light has converged, a guess
DIRECTED = (RoundParameters, VisibilityParameters, BounceParameters)
# Compressed bytes a stored number, for want of a better guess.
STORED = 0.6


@dataclass(frozen=True, slots=True, kw_only=True)
class ProductPlan:
    """Cost of one product.

    Attributes
    ----------
    product : str
    tiles : int
    azimuths : int
        Swept for every tile.
    halo : int or None
        Widest halo of a tile [cells]; None for the whole raster.
    bands : int
        Layers of the result.
    worker_bytes : int
        Largest memory of a worker [bytes].
    disk_bytes : int
        Room for tiles and result together [bytes], a guess.
    core_seconds : float
        Time on one core [s], a guess.
    """

    product: str
    tiles: int
    azimuths: int
    halo: int | None
    bands: int
    worker_bytes: int
    disk_bytes: int
    core_seconds: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """Cost of a batch.

    Attributes
    ----------
    shape : (int, int)
        Rows and columns.
    tile_size : int
    workers, threads : int
        Processes, and threads in each.
    products : tuple of ProductPlan
    """

    shape: tuple[int, int]
    tile_size: int
    workers: int
    threads: int
    products: tuple[ProductPlan, ...]

    @property
    def worker_bytes(self) -> int:
        """Largest memory of a worker [bytes]."""
        return max(each.worker_bytes for each in self.products)

    @property
    def disk_bytes(self) -> int:
        """Room on disk at the most: all results, and the tiles of one product [bytes]."""
        return sum(each.disk_bytes for each in self.products)

    @property
    def seconds(self) -> float:
        """Time of the whole [s], a guess."""
        return sum(each.core_seconds for each in self.products) / (self.workers * self.threads)


def plan(job: Job, workers: int, threads: int) -> Plan:
    """Count what a job needs.

    Examples
    --------
    >>> from adret.parameters import SkyViewParameters
    >>> from adret.tiling.surfaces import Surface
    >>> surface = Surface.open(["examples/data/alpine_aletsch_dhm200_lv95_200m.tif"])
    >>> job = Job(surface, {"sky-view": SkyViewParameters(max_distance=20_000.0)}, 128)
    >>> found = plan(job, workers=1, threads=1)
    >>> found.products[0].tiles, found.products[0].halo
    (9, 105)
    """
    products = tuple(
        _product(job, name, parameters, threads) for name, parameters in job.products.items()
    )
    return Plan(
        shape=job.surface.grid.shape,
        tile_size=job.tile_size,
        workers=workers,
        threads=threads,
        products=products,
    )


def check_memory(found: Plan, job: Job, memory: int, out: Path) -> None:
    """Refuse a run that cannot keep to `memory` [bytes] a worker, or to the disk.

    Raises
    ------
    InputError
        Saying what would do.
    """
    if found.worker_bytes > memory:
        limit = f"at least {-(-found.worker_bytes // 2**20)}M for tiles of {job.tile_size} cells"
        size = job.tile_size
        while size > 64:
            size //= 2
            smaller = plan(Job(job.surface, job.products, size), found.workers, found.threads)
            if smaller.worker_bytes <= memory:
                limit += f" (or --tile-size {size})"
                break
        else:
            if any(each.halo is None for each in found.products):
                limit += " that see the whole raster (or a --max-distance)"
        raise InputError("memory", limit, f"{memory // 2**20}M")
    folder = out if out.exists() else out.parent
    free = shutil.disk_usage(folder).free
    if found.disk_bytes > free:
        raise InputError("out", f"on a disk with {-(-found.disk_bytes // 2**20)}M free", str(out))


def worker_bytes(job: Job, parameters: Parameters, threads: int) -> int:
    """Largest memory of the process that makes a job's tiles [bytes]."""
    rows, columns = job.surface.grid.shape
    core = min(job.tile_size, rows), min(job.tile_size, columns)
    margin = _widest_halo(job, parameters)
    near = getattr(parameters, "near", None) or 32
    if margin is None and len(job.tiles) > 1:
        seen = (rows, columns)
        swept = _mapped_bytes(core, seen)
    else:
        reach = max(rows, columns) if margin is None else margin
        seen = core[0] + 2 * reach, core[1] + 2 * reach
        if job.surface.surroundings is None:
            seen = min(seen[0], rows), min(seen[1], columns)
        view = seen[0] * seen[1]
        pad = min(max(near, 0 if margin is None else margin), max(seen))
        frame = (seen[0] + pad + 8) * (seen[1] + pad + 8)
        # Heights, and two frames: heights turned, and the layer that is raised.
        bands = len(job.surface.grid.bands(0, rows, methods.MAX_AZIMUTH_ERROR))
        swept = view * 4 + 2 * (frame * 4 + view * 4) + own_bytes(view, threads, bands)
    # A strip of rows as it is read: numbers, mask, metres in float64, and above the datum.
    strip = min(512, seen[0]) * seen[1] * (job.surface.item_size + 1 + 8 + 8)
    own = core[0] * core[1] * (1 + 4 + _own_bytes(parameters))
    # Hulls of the lines of a strip, of each thread.
    hulls = threads * 130 * (max(seen) // 4 + 2) * 48
    if isinstance(parameters, VisibilityParameters):
        own += seen[0] * seen[1] * SIGHT_BYTES
    if isinstance(parameters, ViewshedParameters):
        own += seen[0] * seen[1] * VIEWSHED_BYTES
    if isinstance(parameters, BounceParameters):
        if len(job.tiles) > 1 and margin is not None:
            own += max(bounces.window_bytes(job, tile) for tile in job.tiles)
        else:
            own += seen[0] * seen[1] * bounces.cell_bytes(parameters)
    return PROCESS + (TILE_CACHE << 20) + strip + swept + own + hulls


def _mapped_bytes(core: tuple[int, int], whole: tuple[int, int]) -> int:
    """What a tile touches of frames on disk: the lines that pass it, from edge to tile."""
    side, length = max(core), max(whole)
    lines = min(2 * side + 2 * PAGE // 4, length)
    edge = length * PAGE  # a page of each row, for the raster's edge, or while a frame is made
    layers = 3 * core[0] * (core[1] * 4 + 2 * PAGE)  # two that are raised, and the heights
    return lines * length * 4 + edge + layers


def _own_bytes(parameters: Parameters) -> int:
    """Bytes a cell of the tile that a product needs, besides the layer of slopes."""
    if isinstance(parameters, HorizonParameters):
        return 4 + 4 + 4 + 8  # mean, angle, numbers as they are encoded
    many = isinstance(parameters, RoundParameters) and parameters.directions > 32
    total = 4 + (8 if many else 0)
    if isinstance(parameters, SkyViewParameters):
        return total + 16 + (16 if parameters.kind == "normal" else 0)
    if isinstance(parameters, ShadowParameters):
        return 12 + 16 + 6
    if isinstance(parameters, SourceParameters):
        bands = _light_bands(parameters)
        return 16 + bands * (12 + 12)
    return total + 24


def _widest_halo(job: Job, parameters: Parameters) -> int | None:
    """Largest halo of any tile."""
    halos = {halo(job, parameters, tile) for tile in job.tiles[:: max(1, _across(job))]}
    return None if None in halos else max(h for h in halos if h is not None)


def _across(job: Job) -> int:
    return math.ceil(job.surface.grid.shape[1] / job.tile_size)


def _light_bands(parameters: SourceParameters) -> int:
    if isinstance(parameters, BounceParameters):
        return bounces.bands(parameters)
    return 3 if parameters.environment is not None else 1


def _azimuths(parameters: Parameters) -> int:
    if isinstance(parameters, HorizonParameters) and parameters.azimuths_deg is not None:
        return len(parameters.azimuths_deg)
    if isinstance(parameters, LightParameters):
        whole = parameters.sky != "none" or parameters.environment is not None
        return (int(parameters.directions) if whole else 0) + (parameters.sun_deg is not None)
    return parameters.directions if isinstance(parameters, DIRECTED) else 1


def _product(job: Job, name: str, parameters: Parameters, threads: int) -> ProductPlan:
    assert isinstance(parameters, BodyParameters)
    rows, columns = job.surface.grid.shape
    azimuths = _azimuths(parameters)
    horizons = isinstance(parameters, HorizonParameters)
    bands = azimuths if horizons else 1
    if isinstance(parameters, SourceParameters):
        bands = _light_bands(parameters)
    passes = 0
    if isinstance(parameters, BounceParameters):
        passes = BOUNCES if parameters.bounces == "converge" else int(parameters.bounces)
    if isinstance(parameters, ViewshedParameters):
        observers = len(parameters.observer or ()) + len(parameters.at or ())
        azimuths, bands = observers, observers if parameters.layer == "seen-by" else 1
    item = 2 if horizons and getattr(parameters, "dtype", "") == "uint16" else 4
    if isinstance(parameters, ShadowParameters) and parameters.layer == "code":
        item = 1
    near = getattr(parameters, "near", None) or 32
    return ProductPlan(
        product=name,
        tiles=len(job.tiles),
        azimuths=azimuths,
        halo=_widest_halo(job, parameters),
        bands=bands,
        worker_bytes=worker_bytes(job, parameters, threads),
        # Tiles, the result before its overviews are in order, and the result; frames.
        disk_bytes=round(3.4 * rows * columns * bands * item * STORED)
        + (rows * columns * bands * PASS_BYTES * 4 if passes and len(job.tiles) > 1 else 0)
        + (36 * rows * columns if parameters.max_distance is None and len(job.tiles) > 1 else 0),
        core_seconds=rows
        * columns
        * azimuths
        * ((SWEEP_NS + NEAR_NS * near) * _sweeps(job, parameters) + passes * BOUNCE_NS)
        * 1e-9,
    )


def _sweeps(job: Job, parameters: BodyParameters) -> float:
    """Time of all tiles over that of the untiled raster: without a range lines begin at its edge.

    Lines that pass a tile of T cells are T (1 + t), t being their shear, one half on average; each
    is swept from the edge, half of the raster on average.
    """
    if parameters.max_distance is not None:
        return 1.0
    return 1.0 + SWEPT_AGAIN * (1.5 * (_across(job) + 1) / 2.0 - 1.5)


def default_threads(workers: int) -> int:
    """Threads of each of so many workers."""
    return max(1, (os.cpu_count() or 1) // workers)
