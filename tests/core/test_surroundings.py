"""A coarser raster round a fine one: what the far field sees of it, and how far off it may be."""

from pathlib import Path

import numpy as np
import pytest
from affine import Affine

import adret
import raster_files
import scenes
from adret.errors import InputError, RasterError
from adret.products import PRODUCTS
from adret.tiling import Job, Surface, prepare

CELL, COARSE = 10.0, 5
ORIGIN = (400_000.0, 6_000_000.0)


@pytest.fixture
def world(rng: np.random.Generator, tmp_path: Path) -> tuple[np.ndarray, Path, Path]:
    """Fine ground of 150 x 150 cells, its middle 50 x 50 in a file, a coarse mean of all of it."""
    z = scenes.fractal(rng, (150, 150), relief=300.0).astype(np.float32)
    coarse = z.reshape(30, COARSE, 30, COARSE).mean(axis=(1, 3))
    middle = Affine(CELL, 0, ORIGIN[0] + 50 * CELL, 0, -CELL, ORIGIN[1] - 50 * CELL)
    around = Affine(CELL * COARSE, 0, ORIGIN[0], 0, -CELL * COARSE, ORIGIN[1])
    fine = raster_files.save(tmp_path / "fine.tif", z[50:100, 50:100], transform=middle)
    wide = raster_files.save(tmp_path / "wide.tif", coarse.astype(np.float32), transform=around)
    return z, fine, wide


def test_the_error_is_bounded_by_height_over_distance(
    world: tuple[np.ndarray, Path, Path],
) -> None:
    z, fine, wide = world
    options = {"azimuths": np.radians([0.0, 33.0, 90.0, 135.0, 222.0, 301.0]), "method": "exact"}
    surface = Surface.open([fine], surroundings=wide)
    tile = surface.tile((0, 50), (0, 50), halo=40)
    seen = tile.view.heights.astype(np.float64) + tile.datum
    truth = z[10:140, 10:140].astype(np.float64)
    np.testing.assert_allclose(seen[40:90, 40:90], truth[40:90, 40:90], atol=1e-3)
    error = np.abs(seen - truth)
    error[40:90, 40:90] = 0.0
    whole = adret.Terrain(truth, (CELL, CELL), datum=tile.datum).tile((40, 90), (40, 90))
    found = np.tan(adret.horizon_map(tile, **options).elevation.astype(np.float64))
    wanted = np.tan(adret.horizon_map(whole, **options).elevation.astype(np.float64))
    row, column = np.mgrid[0:50, 0:50]
    away = CELL * (1 + np.minimum.reduce([row, column, 49 - row, 49 - column]))
    off = np.abs(found - wanted)
    assert (off <= error.max() / away + 1e-5).all()
    alone = np.tan(adret.horizon_map(adret.Terrain.open(fine), **options).elevation)
    assert off.mean() < 0.2 * np.abs(np.maximum(alone, -9.0) - wanted).mean()


def test_tiles_with_surroundings_do_not_hang_on_their_size(
    world: tuple[np.ndarray, Path, Path],
) -> None:
    _, fine, wide = world
    surface = Surface.open([fine], surroundings=wide)
    options = {"max_distance": 300.0, "near": 4}
    halo = adret.HorizonOptions(max_distance=300.0).halo_of(surface.grid, 0, 50)
    one = adret.horizon_map(surface.tile((0, 50), (0, 50), halo), 12, **options).elevation
    for rows, columns in [((0, 20), (0, 31)), ((20, 50), (31, 50)), ((7, 9), (40, 50))]:
        part = adret.horizon_map(surface.tile(rows, columns, halo), 12, **options).elevation
        assert part.tobytes() == one[:, slice(*rows), slice(*columns)].tobytes()


def test_surroundings_need_a_range_and_the_same_reference_system(
    world: tuple[np.ndarray, Path, Path], tmp_path: Path
) -> None:
    _, fine, wide = world
    surface = Surface.open([fine], surroundings=wide)
    with pytest.raises(InputError, match="max_distance: must be given with surroundings"):
        surface.tile((0, 9), (0, 9), None)
    job = Job(surface, {"sky-view": PRODUCTS["sky-view"].parameters()}, 32)
    with pytest.raises(InputError, match="max_distance: must be given with surroundings"):
        prepare(job, tmp_path / "out")
    other = raster_files.save(tmp_path / "other.tif", np.zeros((9, 9), "f4"), crs="EPSG:32634")
    with pytest.raises(RasterError, match="in the raster's reference system"):
        Surface.open([fine], surroundings=other)
