"""Viewsheds and bounces tile by tile: the bytes of the product's own file."""

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio

import adret
import raster_files
import scenes
from adret import products
from adret.errors import InputError
from adret.tiling import Job, Surface, bounces, plan, prepare, run_batch
from adret.tiling.jobs import FOLDER
from adret.tiling.tasks import tile_path
from tile_runs import Here


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def check(path: Path, folder: Path, name: str, size: int, **given: Any) -> Here:
    """Compare the file of a batch with that of the product's own command."""
    product = products.PRODUCTS[name]
    parameters = product.parameters(**given)
    job = Job(Surface.open([path]), {name: parameters}, size)
    executor = Here()
    out = folder / f"out-{size}"
    prepare(job, out)
    report = run_batch(job, out, executor)
    assert not report.failed, report
    whole = folder / "whole.tif"
    products.run(product, adret.Terrain.open(path), parameters, whole)
    with rasterio.open(whole) as one, rasterio.open(out / f"{name}.tif") as other:
        assert one.tags() == other.tags()
        np.testing.assert_array_equal(one.read(), other.read())
    assert digest(out / f"{name}.tif") == digest(whole)
    return executor


@pytest.fixture
def small(example_dem: Path, tmp_path: Path) -> Path:
    """A part of the example with a void, 140 x 150 cells of 200 m."""
    return raster_files.crop(example_dem, tmp_path / "small.tif", 140, 150, void=(60, 75, 20, 50))


# --- viewsheds -----------------------------------------------------------------------------------

# In a corner, in the middle, in reach of few tiles, by coordinates.
OBSERVERS = {"observer": ((2, 3), (80, 77), (139, 149)), "at": ((2_658_100.0, 1_165_000.0),)}


@pytest.mark.parametrize("layer", ["visible", "count", "seen-by", "minimum-height"])
def test_tiles_of_a_viewshed_are_the_file_of_the_command(
    layer: str, small: Path, tmp_path: Path
) -> None:
    with rasterio.open(small) as dataset:
        at = (dataset.xy(20, 100),)
    places = {"observer": OBSERVERS["observer"], "at": at}
    given = {"max_distance": 6100.0, "curvature": True, "azimuth_range_deg": (300.0, 220.0)}
    check(small, tmp_path, "viewshed", 60, layer=layer, **places, **given)


def test_observers_that_cannot_be_are_refused_before_anything_starts(
    small: Path, tmp_path: Path
) -> None:
    product = products.PRODUCTS["viewshed"]
    surface = Surface.open([small])

    def begin(**given: Any) -> None:
        job = Job(surface, {"viewshed": product.parameters(**given)}, 64)
        prepare(job, tmp_path / "out")

    with pytest.raises(InputError, match="max_distance: must be given for viewshed in tiles"):
        begin(observer=((2, 3),))
    with pytest.raises(InputError, match="observer: must be a cell that is not nodata"):
        begin(observer=((2, 3), (65, 30)), max_distance=500.0)
    with pytest.raises(InputError, match=r"observer: must be a cell between \(0, 0\)"):
        begin(observer=((140, 3),), max_distance=500.0)
    with pytest.raises(InputError, match="at: must be inside the raster"):
        begin(at=((0.0, 0.0),), max_distance=500.0)
    assert not (tmp_path / "out").exists()


# --- bounces -------------------------------------------------------------------------------------

SUN = {"sun_deg": (250.0, 12.0), "directions": 8, "near": 8, "albedo": 0.7}


@pytest.mark.parametrize(
    ("tall", "given"), [(True, {"bounces": 2, "layer": "total"}), (False, {"bounces": "converge"})]
)
def test_tiles_of_bounces_are_the_file_of_the_command(
    tall: bool, given: dict[str, Any], rng: np.random.Generator, tmp_path: Path
) -> None:
    """A raster longer than the windows that tiles see; lakes, and shadows that send nothing."""
    z = scenes.fractal(rng, (36, 2000), relief=900.0)
    z = np.maximum(z, np.quantile(z, 0.3)).astype(np.float32)
    z[10:14, 700:710] = np.nan
    path = raster_files.save(tmp_path / "long.tif", z.T if tall else z, nodata=np.nan)
    executor = check(path, tmp_path, "bounce", 400, max_distance=100.0, **SUN, **given)
    passes = {order.product for order in executor.orders}
    assert {"bounce/0", "bounce/1", "bounce/2", "bounce"} <= passes
    assert len(executor.orders) == 5 * len(passes)
    job = Job.read(tmp_path / "out-400")
    seen = bounces.window(job, job.tiles[2])[0 if tall else 1]
    assert seen == (384, 1616)


@pytest.mark.slow
@pytest.mark.parametrize("size", [200, 333, 512])
@pytest.mark.parametrize(
    "name",
    [
        "alpine_exploradores_aster_utm18s_30m_voids.tif",
        "geo_grenoble_copdem_epsg4326_decimated.tif",
        "moon_gld100_eqc_118m_4096.tif",
    ],
)
def test_bounces_and_viewsheds_of_real_rasters_in_tiles(
    name: str, size: int, data_dir: Path, tmp_path: Path
) -> None:
    part = raster_files.crop(data_dir / "dem" / name, tmp_path / "part.tif", 1400, 1000)
    light = {"sun_deg": (250.0, 12.0), "directions": 6, "near": 8, "albedo": 0.7}
    given = {"bounces": "converge", "max_distance": 1500.0, "layer": "radiance", "curvature": True}
    check(part, tmp_path, "bounce", size, **light, **given)
    with rasterio.open(part) as dataset:
        known = np.argwhere(dataset.read_masks(1))
    places = tuple(map(tuple, known[:: len(known) // 12].tolist()))
    for layer in ("count", "minimum-height"):
        given = {"layer": layer, "max_distance": 9000.0, "curvature": True}
        folder = tmp_path / layer
        folder.mkdir()
        check(part, folder, "viewshed", size, observer=places, **given)


def test_lava_and_a_map_of_albedo_are_read_by_windows(example_dem: Path, tmp_path: Path) -> None:
    small = raster_files.crop(example_dem, tmp_path / "dem.tif", 90, 100)
    with rasterio.open(small) as dataset:
        place = {"crs": dataset.crs, "transform": dataset.transform}
    rng = np.random.default_rng(3)
    albedo = rng.random((90, 100)).astype("f4")
    lava = np.zeros((3, 90, 100), "f4")
    lava[0, 40:50, 30:60] = 10.0
    lava[1, 40:44, 30:60] = 3.0
    maps = {
        "albedo_map": str(raster_files.save(tmp_path / "albedo.tif", albedo, **place)),
        "emission": str(raster_files.save(tmp_path / "lava.tif", lava, **place)),
    }
    given = {"layer": "radiance", "max_distance": 3000.0, "directions": 8, "near": 8}
    check(small, tmp_path, "bounce", 60, bounces=2, **given, **maps)


def test_passes_go_on_where_they_were_stopped(example_dem: Path, tmp_path: Path) -> None:
    small = raster_files.crop(example_dem, tmp_path / "dem.tif", 90, 100)
    parameters = products.PRODUCTS["bounce"].parameters(
        bounces=4, max_distance=2000.0, **SUN | {"directions": 4}
    )
    job = Job(Surface.open([small]), {"bounce": parameters}, 50)
    calm, out = tmp_path / "calm", tmp_path / "out"
    prepare(job, calm)
    run_batch(job, calm, Here())
    prepare(job, out)
    stopped = Here(stop_after=4 * 3 + 2)  # in the pass of the third bounce
    with pytest.raises(KeyboardInterrupt):
        run_batch(job, out, stopped)
    again = Here()
    prepare(job, out, resume=True)
    assert not run_batch(job, out, again).failed
    assert [order.product for order in again.orders] == (
        ["bounce/3"] * 2 + ["bounce/4"] * 4 + ["bounce"] * 4
    )
    assert digest(out / "bounce.tif") == digest(calm / "bounce.tif")
    assert not (out / FOLDER / "bounce").exists()


def test_a_damaged_pass_is_made_anew(example_dem: Path, tmp_path: Path) -> None:
    small = raster_files.crop(example_dem, tmp_path / "dem.tif", 90, 100)
    parameters = products.PRODUCTS["bounce"].parameters(bounces=2, max_distance=2000.0, **SUN)
    job = Job(Surface.open([small]), {"bounce": parameters}, 50)
    out = tmp_path / "out"
    prepare(job, out)
    with pytest.raises(KeyboardInterrupt):
        run_batch(job, out, Here(stop_after=9))
    damaged = tile_path(out, "bounce/1", job.tiles[2])
    data = bytearray(damaged.read_bytes())
    data[-200] ^= 0xFF
    damaged.write_bytes(data)
    prepare(job, out, resume=True)
    assert not run_batch(job, out, Here()).failed
    whole = tmp_path / "whole.tif"
    products.run(products.PRODUCTS["bounce"], adret.Terrain.open(small), parameters, whole)
    assert digest(out / "bounce.tif") == digest(whole)


def test_bounces_without_a_range_are_refused_in_tiles(small: Path, tmp_path: Path) -> None:
    parameters = products.PRODUCTS["bounce"].parameters(**SUN)
    job = Job(Surface.open([small]), {"bounce": parameters}, 64)
    with pytest.raises(InputError, match="max_distance: must be given for bounce in tiles"):
        prepare(job, tmp_path / "out")
    whole = Job(job.surface, {"bounce": parameters}, 256)
    assert plan(whole, 1, 1).products[0].halo is None
