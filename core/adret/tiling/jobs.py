"""A batch job on disk: what to compute of which rasters, and the receipts of what is done.

Layout of the output folder::

    <product>.tif             the result: what the product's own command writes
    manifest.json             files, checksums, times; written anew whenever a product is done
    .adret-tiles/job.json     the job; workers read it
    .adret-tiles/frames/      the raster turned for the sweeps, if no range is given
    .adret-tiles/<product>/   one GeoTIFF a tile, and beside it a receipt with its checksum;
                              of bounces also a folder for each pass

All files appear whole or not at all. A tile is done when its receipt is there.
"""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Self

from adret._gdal import atomic
from adret.errors import InputError, RasterError
from adret.grids import RasterGrid
from adret.parameters import Parameters, specifications
from adret.tiling.frames import StoredFrames
from adret.tiling.surfaces import Piece, Surface
from adret.tiling.surroundings import Surroundings
from adret.tiling.tasks import (
    FOLDER,
    Tile,
    Written,
    cut,
    file_digest,
    make_tile,
    tile_path,
    tiled_product,
)

__all__ = ["FOLDER", "Job", "run_tile", "tile_path"]

FRAMES = "frames"
VERSION = 1


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """Products of a surface, cut into tiles.

    Attributes
    ----------
    surface : Surface
    products : mapping of str to Parameters
        Names in `adret.products.PRODUCTS`.
    tile_size : int
        Cells a side.

    Raises
    ------
    InputError
        If a product's azimuths are to be chosen: each tile would choose its own.
    """

    surface: Surface
    products: Mapping[str, Parameters]
    tile_size: int

    def __post_init__(self) -> None:
        """Refuse what makes a tile differ from the whole."""
        for parameters in self.products.values():
            if getattr(parameters, "directions", None) == "auto":
                raise InputError("directions", "a number in tiles", "auto")

    @property
    def tiles(self) -> list[Tile]:
        """All tiles, row by row."""
        return cut(self.surface.grid.shape, self.tile_size)

    def document(self) -> dict[str, Any]:
        """The job as JSON; equal jobs of equal files give equal documents."""
        import adret

        surface, grid = self.surface, self.surface.grid
        return {
            "format": VERSION,
            "version": adret.__version__,
            "pieces": [asdict(piece) | _stamp(piece.path) for piece in surface.pieces],
            "surroundings": _surroundings(surface),
            "band": surface.band,
            "vertical_unit": surface.vertical_unit,
            "item_size": surface.item_size,
            "datum": surface.datum,
            "crs": None if grid.crs is None else grid.crs.to_wkt(),
            "transform": None if grid.transform is None else list(grid.transform)[:6],
            "shape": list(grid.shape),
            "cell_size": list(grid.cell_size),
            "products": {name: asdict(given) for name, given in self.products.items()},
            "tile_size": self.tile_size,
            "files": self._files(),
        }

    def _files(self) -> dict[str, Any]:
        """Other files that the products read."""
        found = {}
        for name, given in self.products.items():
            for spec in specifications(type(given)):
                path = getattr(given, spec.name) if spec.form == "path" else None
                if path is None:
                    continue
                try:
                    found[f"{name}.{spec.name}"] = _stamp(path)
                except OSError as error:
                    limit = f"a file that can be read ({error.strerror})"
                    raise RasterError(spec.name, limit, path) from None
        return found

    def write(self, out: Path) -> None:
        """Put the job into an output folder, where workers find it."""
        folder = out / FOLDER
        folder.mkdir(parents=True, exist_ok=True)
        write_json(folder / "job.json", self.document())

    @classmethod
    def read(cls, out: Path) -> Self:
        """The job of an output folder.

        Raises
        ------
        RasterError
            If there is none, or one that another version wrote.
        """
        path = out / FOLDER / "job.json"
        known = read_json(path)
        if known is None:
            raise RasterError("out", "a folder with a job", str(out))
        if known.get("format") != VERSION:
            raise RasterError("job", f"of format {VERSION}", known.get("format"))
        transform, crs = known["transform"], known["crs"]
        if transform is not None:
            from affine import Affine

            transform = Affine(*transform)
        from adret.geodesy import parse_crs

        grid = RasterGrid(
            parse_crs(crs), transform, _pair(known["shape"]), _pair(known["cell_size"])
        )
        pieces = tuple(
            Piece(each["path"], each["row"], each["column"], _pair(each["shape"]))
            for each in known["pieces"]
        )
        border = known["surroundings"]
        surface = Surface(
            pieces,
            grid,
            known["band"],
            known["vertical_unit"],
            known["item_size"],
            known["datum"],
            None if border is None else Surroundings.open(border["path"], grid, border["band"]),
        )
        products = {
            name: tiled_product(name).parameters(**_lists(given))
            for name, given in known["products"].items()
        }
        return cls(surface, products, known["tile_size"])


def run_tile(out: str, product: str, row: int, column: int) -> Written:
    """Make one tile of the job in a folder, unless it is done, and leave its receipt.

    The one function that every executor runs, on whichever machine sees the folder.

    Parameters
    ----------
    out : str
        Output folder of the job.
    product : str
        Or a pass of it: ``bounce/2``.
    row, column : int
        First cell of the tile.
    """
    from adret.tiling import bounces

    folder = Path(out)
    stamp = (folder / FOLDER / "job.json").stat().st_mtime_ns
    job = _job(out, stamp)
    rows, columns = job.surface.grid.shape
    size = job.tile_size
    tile = Tile((row, min(row + size, rows)), (column, min(column + size, columns)))
    done = receipt(folder, product, tile)
    if done is not None:
        return done
    path = tile_path(folder, product, tile)
    path.parent.mkdir(parents=True, exist_ok=True)
    frames = None if len(job.tiles) == 1 else _frames(out, stamp)
    name, _, number = product.partition("/")
    if number:
        written = bounces.make_pass(job, int(number), tile, folder, path)
    else:
        written = make_tile(job, name, tile, path, frames, folder)
    write_json(path.with_suffix(".json"), asdict(written))
    return written


@lru_cache(maxsize=1)
def _job(out: str, stamp: int) -> Job:
    return Job.read(Path(out))


@lru_cache(maxsize=1)
def _frames(out: str, stamp: int) -> StoredFrames:
    return StoredFrames(_job(out, stamp).surface, Path(out) / FOLDER / FRAMES)


def receipt(out: Path, product: str, tile: Tile) -> Written | None:
    """What is known of a tile, if it is done and its file has the length that it should have."""
    path = tile_path(out, product, tile)
    try:
        written = Written(**json.loads(path.with_suffix(".json").read_text()))
        whole = path.stat().st_size == written.bytes
    except (OSError, ValueError, TypeError):
        return None
    return written if whole else None


def check_tile(out: Path, product: str, tile: Tile) -> bool:
    """Whether a tile is done and its bytes are those that were written; else it is forgotten."""
    path = tile_path(out, product, tile)
    written = receipt(out, product, tile)
    if written is not None and file_digest(path) == written.sha256:
        return True
    path.with_suffix(".json").unlink(missing_ok=True)
    return False


def write_json(path: Path, document: Any) -> None:
    """Write a JSON file, whole or not at all, and see it on the disk."""
    with atomic(path) as unfinished, unfinished.open("w") as file:
        json.dump(document, file, indent=1, sort_keys=True)
        file.write("\n")
        file.flush()
        os.fsync(file.fileno())


def read_json(path: Path) -> dict[str, Any] | None:
    """The object that a JSON file holds; None where there is none."""
    try:
        found = json.loads(path.read_text())
    except (OSError, ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None


def known_datum(out: Path) -> float | None:
    """The datum of the job that was begun in a folder; its files are compared with it later."""
    known = read_json(out / FOLDER / "job.json")
    datum = None if known is None else known.get("datum")
    return float(datum) if isinstance(datum, int | float) else None


def digest(document: Mapping[str, Any]) -> str:
    """SHA-256 of a document."""
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()


def _stamp(path: str) -> dict[str, Any]:
    status = os.stat(path)
    return {"bytes": status.st_size, "modified": status.st_mtime_ns}


def _surroundings(surface: Surface) -> dict[str, Any] | None:
    border = surface.surroundings
    if border is None:
        return None
    return {"path": border.path, "band": border.band} | _stamp(border.path)


def _pair(values: Any) -> Any:
    one, other = values
    return (one, other)


def _lists(given: Mapping[str, Any]) -> dict[str, Any]:
    return {name: tuple(v) if isinstance(v, list) else v for name, v in given.items()}


def check_same(old: Mapping[str, Any], new: Mapping[str, Any]) -> None:
    """Refuse to go on with a job that is not the one that was begun.

    Raises
    ------
    InputError
        Naming what differs.
    """
    for name in new:
        here, there = json.loads(json.dumps(new[name])), old.get(name)
        path = name
        while here != there:
            # Down to the first thing that differs: an option of a product, the size of a file.
            pair = _first_difference(here, there)
            if pair is None:
                limit = f"of the same job (its {path} was {_short(there)})"
                raise InputError("resume", limit, _short(here))
            key, here, there = pair
            path = f"{path} {key}"


def _first_difference(here: Any, there: Any) -> tuple[str, Any, Any] | None:
    if isinstance(here, dict) and isinstance(there, dict):
        keys = [key for key in (*here, *there) if here.get(key) != there.get(key)]
        return keys[0], here.get(keys[0]), there.get(keys[0])
    lists = isinstance(here, list) and isinstance(there, list) and len(here) == len(there)
    if lists and any(isinstance(each, dict) for each in here):
        number = next(
            i for i, (one, other) in enumerate(zip(here, there, strict=True)) if one != other
        )
        return str(number), here[number], there[number]
    return None


def _short(value: Any) -> str:
    text = str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
