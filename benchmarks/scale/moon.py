"""A lunar raster of any size: the real 4096² map mirrored side by side, with detail of its own.

Every mosaic tile gets another share of relief and every cell a few metres of its own, both from a
hash of the place, so that no two tiles are the same ground. The file is sparse: only the rows that
are asked for take room.
"""

import os
from pathlib import Path

import numpy as np
import rasterio
from affine import Affine
from numpy.typing import NDArray

REPOSITORY = Path(__file__).resolve().parents[2]
NAME = "moon_gld100_eqc_118m_4096.tif"
STRIP = 512
DETAIL = 4  # metres that a cell may lie higher or lower


def source_path() -> Path:
    """The real map: in $ADRET_DATA, else in ../shared/data."""
    folder = os.environ.get("ADRET_DATA", REPOSITORY.parent / "shared" / "data")
    return Path(folder) / "dem" / NAME


def _hash(row: NDArray[np.uint32], column: NDArray[np.uint32]) -> NDArray[np.uint32]:
    mixed = row * np.uint32(0x9E3779B1) ^ column * np.uint32(0x85EBCA77)
    mixed ^= mixed >> np.uint32(15)
    mixed *= np.uint32(0xC2B2AE3D)
    return np.asarray(mixed ^ (mixed >> np.uint32(13)))


def rows_of(real: NDArray[np.int16], size: int, start: int, stop: int) -> NDArray[np.int16]:
    """Rows start..stop of the raster of `size` cells a side."""
    side = len(real)
    row = np.arange(start, stop)
    column = np.arange(size)

    def mirrored(index: NDArray[np.int64]) -> NDArray[np.int64]:
        turn, place = index // side, index % side
        return np.where(turn % 2 == 0, place, side - 1 - place)

    ground = real[np.ix_(mirrored(row), mirrored(column))].astype(np.float32)
    tile = _hash((row // side).astype(np.uint32)[:, None], (column // side).astype(np.uint32))
    share = 0.7 + 0.6 * (tile & np.uint32(1023)).astype(np.float32) / 1023.0
    own = _hash(row.astype(np.uint32)[:, None], column.astype(np.uint32))
    detail = (own & np.uint32(1023)).astype(np.float32) / 1023.0 * 2.0 * DETAIL - DETAIL
    return np.rint(ground * share + detail).astype(np.int16)


def write(path: Path, size: int, bands: list[tuple[int, int]]) -> None:
    """Write the raster with these spans of rows filled; all others stay holes in the file."""
    with rasterio.open(source_path()) as dataset:
        real, crs, cell = dataset.read(1), dataset.crs, dataset.transform.a
    profile = {
        "driver": "GTiff",
        "height": size,
        "width": size,
        "count": 1,
        "dtype": "int16",
        "nodata": -32768,
        "crs": crs,
        "transform": Affine(cell, 0.0, 0.0, 0.0, -cell, 0.5 * size * cell),
        "tiled": True,
        "blockxsize": STRIP,
        "blockysize": STRIP,
        "compress": "zstd",
        "zstd_level": 1,
        "predictor": 2,
        "sparse_ok": True,
        "bigtiff": "if_safer",
        "num_threads": "all_cpus",
    }
    with rasterio.open(path, "w", **profile) as dataset:
        for start, stop in bands:
            first = start // STRIP * STRIP
            for top in range(first, min(stop, size), STRIP):
                bottom = min(top + STRIP, size)
                dataset.write(
                    rows_of(real, size, top, bottom), 1, window=((top, bottom), (0, size))
                )
