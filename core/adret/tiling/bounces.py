"""Bounces tile by tile: one pass over the raster for each, as exact as the whole.

Pass 0 is the light of sun and sky on every tile. Pass k takes what the cells in range sent after
the one before it, and leaves what the tile's own cells then send. A halo as deep as all bounces
together would need no passes, but grows with every bounce and cannot know when the light has
converged; passes read each cell's neighbourhood once a bounce, whatever their number. Between the
passes the client adds up the bounds of what is left, which decide whether there is another one.

Groups of receivers and blocks of senders are counted from the raster's edges, from both sides
since sweeps run both ways. A tile's window is therefore cut where the whole raster's are.

Files of a pass: ``.adret-tiles/bounce/<pass>/<tile>.npz`` with

- pass 0: ``direct`` irradiance, and ``sent``;
- pass 1 and later: ``sent``, and ``total`` irradiance of all bounces so far;
- pass 1 also: what the first bounce found out about the terrain (`Transport.memory`).
"""

import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from adret._gdal import atomic
from adret.bounce_bounds import Maxima, Rest, left_out
from adret.parameters import BounceParameters
from adret.tiling.tasks import FOLDER, Tile, Written, around, halo, meter, overlap, tile_path

if TYPE_CHECKING:
    from adret.products import Result
    from adret.terrain import Terrain
    from adret.tiling.jobs import Job

__all__ = ["LAST", "Passes", "make_pass", "pass_name", "result", "window"]

PRODUCT = "bounce"
CHUNK = 128  # receivers that walk together; a multiple of the senders' blocks
MARGIN = 3 * CHUNK  # beyond the range: those that walk along, twice, and blocks they look at
LAST = "last.json"

Span = tuple[int, int]
Layers = NDArray[Any]


def pass_name(number: int) -> str:
    """Of the orders of a pass, and of its folder.

    Examples
    --------
    >>> pass_name(2)
    'bounce/2'
    """
    return f"{PRODUCT}/{number}"


def window(job: "Job", tile: Tile) -> tuple[Span, Span]:
    """Rows and columns that a tile's bounces see, cut at multiples of CHUNK from both edges.

    A tile must have a range.
    """
    rows, columns = job.surface.grid.shape
    wide = Tile(
        (max(tile.rows[0] - CHUNK, 0), min(tile.rows[1] + CHUNK, rows)),
        (max(tile.columns[0] - CHUNK, 0), min(tile.columns[1] + CHUNK, columns)),
    )
    reach = halo(job, job.products[PRODUCT], wide)
    assert reach is not None
    return _aligned(tile.rows, reach + MARGIN, rows), _aligned(
        tile.columns, reach + MARGIN, columns
    )


def _aligned(span: Span, reach: int, length: int) -> Span:
    """A span and `reach` on both sides, on multiples of CHUNK from the edge that lies there.

    Examples
    --------
    >>> _aligned((1000, 1100), 300, 3000)
    (640, 1464)
    """
    before = max(span[0] - reach, 0) // CHUNK * CHUNK
    after = max(length - span[1] - reach, 0) // CHUNK * CHUNK
    return before, length - after


def make_pass(job: "Job", number: int, tile: Tile, out: Path, path: Path) -> Written:
    """Make a tile of a pass; its file appears whole or not at all."""
    measured = meter()
    made: dict[str, Any]
    made, maxima, azimuths = (_first if number == 0 else _next)(job, number, tile, out)
    with atomic(path) as unfinished, unfinished.open("wb") as file:
        np.savez(file, allow_pickle=False, **made)
    rows, columns = tile.shape
    about = {"maxima": list(maxima)}
    return measured(path, cells=rows * columns, azimuths=azimuths, about=about)


def result(job: "Job", tile: Tile, out: Path) -> tuple["Result", "Terrain"]:
    """What a tile's file holds when all passes are done."""
    from adret.bounces import irradiance_of
    from adret.products import sun
    from adret.tiling.jobs import read_json

    parameters = _parameters(job)
    last = read_json(out / tile_folder() / LAST) or {}
    terrain = job.surface.tile(tile.rows, tile.columns, 0)
    with _opened(out, 0, tile) as first:
        direct = first["direct"]
        total = np.zeros(first["sent"].shape)
    if last["made"]:
        with _opened(out, last["made"], tile) as latest:
            total = latest["total"]
    ground = sun.grounds(terrain, parameters)
    indirect = irradiance_of(terrain, total)
    made, residual = last["made"], float(last["residual"])
    found = sun.bounced(terrain, parameters, ground, indirect, direct, made, residual)
    return found, terrain


def tile_folder() -> Path:
    """Of the product's tiles, in an output folder."""
    return Path(FOLDER) / PRODUCT


class Passes:
    """Decides, from what the tiles of each pass report, whether there is another.

    Parameters
    ----------
    job : Job
        With the product "bounce".

    Attributes
    ----------
    made : int
        Bounces that were counted.
    residual : float
    done : bool
        Whether there is no further one.
    """

    def __init__(self, job: "Job") -> None:
        from adret.bounces import bounce_limit

        parameters = _parameters(job)
        converge = parameters.bounces == "converge"
        self._limit = bounce_limit(parameters.bounces)
        self._rest = Rest(parameters.tolerance if converge else None)
        self.made, self.residual, self.done = 0, 0.0, False

    def count(self, number: int, tiles: list[list[float]]) -> dict[str, Any]:
        """Take in the maxima of the tiles of a pass; return what the next one must know."""
        found = Maxima(*(max(values) for values in zip(*tiles, strict=True)))
        if number == 0:
            self._rest.sent = found.sent
        else:
            self.made = number
            self.residual = self._rest.after(found)
        tolerance = self._rest.tolerance
        converged = tolerance is not None and number > 0 and self.residual <= tolerance
        self.done = self.made >= self._limit or found.sent == 0.0 or converged
        # Infinity is no JSON that everybody reads.
        return {"rest": asdict(self._rest), "made": self.made, "residual": str(self.residual)}


def _parameters(job: "Job") -> BounceParameters:
    parameters = job.products[PRODUCT]
    assert isinstance(parameters, BounceParameters)
    return parameters


def _first(job: "Job", number: int, tile: Tile, out: Path) -> tuple[dict[str, Layers], Maxima, int]:
    """Direct light, and what the cells send of it."""
    from adret.bounces import first_sent, shares
    from adret.products import sun

    parameters = _parameters(job)
    terrain = job.surface.tile(tile.rows, tile.columns, halo(job, parameters, tile))
    albedo, emission = sun.grounds(terrain, parameters)
    direct = sun.bounce_light(terrain, parameters)
    share = shares(albedo, terrain)
    sent = first_sent(terrain, sun.reflected(albedo, direct), emission, share)
    maxima = Maxima(float(sent.max()), 0.0, 0.0, 0.0, float(share.max()), 0.0)
    return {"direct": direct, "sent": sent}, maxima, parameters.directions


def _next(job: "Job", number: int, tile: Tile, out: Path) -> tuple[dict[str, Layers], Maxima, int]:
    """One bounce from what was sent in the pass before."""
    from adret.azimuths import azimuth_set
    from adret.bounces import PER_PI, shares
    from adret.horizon import HorizonOptions
    from adret.products import sun
    from adret.tiling.jobs import read_json
    from adret.transport import Transport

    parameters = _parameters(job)
    rows, columns = window(job, tile)
    core = tuple(
        slice(own[0] - seen[0], own[1] - seen[0])
        for own, seen in ((tile.rows, rows), (tile.columns, columns))
    )
    sight = around(job.surface.tile(rows, columns, 0))
    options = HorizonOptions(**sun.bounce_options(sight, parameters))
    transport = Transport(sight, azimuth_set(parameters.directions), options)
    asked = np.zeros(sight.shape, np.bool_)
    # Receivers that walk along with the tile's own: the last of a group decides for all of it.
    asked[tuple(slice(max(s.start - CHUNK, 0), s.stop + CHUNK) for s in core)] = True
    missing = 0.0
    if number > 1:
        with _opened(out, 1, tile) as first:
            transport.recall(first)
        state = (read_json(out / tile_folder() / f"{number - 1}.json") or {})["rest"]
        needed, bound = Rest(**state).needed(transport.view)
        missing = left_out(bound[core], needed[core])
        asked &= needed
    sent = _sent(job, number - 1, rows, columns, out)
    received = np.nan_to_num(transport(sent, asked))[:, *core]
    terrain = job.surface.tile(tile.rows, tile.columns, 0)
    share = shares(sun.grounds(terrain, parameters)[0], terrain)
    total = np.zeros(received.shape)
    if number > 1:
        with _opened(out, number - 1, tile) as before:
            total = before["total"]
    total += received
    passed_on = share * received * PER_PI
    made = {"sent": passed_on, "total": total}
    if number == 1:
        made |= transport.memory()
    maxima = Maxima.of(passed_on, total, transport.view[core], share, missing)
    return made, maxima, parameters.directions


def _sent(job: "Job", number: int, rows: Span, columns: Span, out: Path) -> Layers:
    """Radiance that a window's cells sent in a pass, shape (bands, rows, columns)."""
    found: Layers | None = None
    shape = rows[1] - rows[0], columns[1] - columns[0]
    for tile in job.tiles:
        down, across = overlap(tile.rows, rows), overlap(tile.columns, columns)
        if down[0] >= down[1] or across[0] >= across[1]:
            continue
        with _opened(out, number, tile) as file:
            part = file["sent"]
        if found is None:
            found = np.zeros((len(part), *shape), np.float32)
        target = _slices((down, across), (rows[0], columns[0]))
        found[:, *target] = part[:, *_slices((down, across), (tile.rows[0], tile.columns[0]))]
    assert found is not None
    return found


def _slices(spans: tuple[Span, Span], corner: tuple[int, int]) -> tuple[slice, ...]:
    return tuple(
        slice(span[0] - first, span[1] - first) for span, first in zip(spans, corner, strict=True)
    )


def _opened(out: Path, number: int, tile: Tile) -> Any:
    return np.load(tile_path(out, pass_name(number), tile))


def bands(parameters: BounceParameters) -> int:
    """Bands of the light, at the most."""
    return 3 if parameters.albedo_map or parameters.emission or parameters.environment else 1


def cell_bytes(parameters: BounceParameters) -> int:
    """Memory of a bounce [bytes a cell]: frames, sums and light."""
    reach = math.ceil(parameters.directions * 4 / CHUNK)
    return 80 + 40 * bands(parameters) + 2 * reach


def window_bytes(job: "Job", tile: Tile) -> int:
    """Memory of a pass [bytes]."""
    rows, columns = window(job, tile)
    return (rows[1] - rows[0]) * (columns[1] - columns[0]) * cell_bytes(_parameters(job))
