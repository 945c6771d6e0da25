"""Results as Zarr: whole shards of the numbers that the COG holds, opened by the tools in use."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio

import raster_files
from adret.cli import main
from adret.errors import InputError, RasterError
from adret.tiling import prepare
from adret.tiling.stores import file_of
from tile_runs import batch, job_of

zarr = pytest.importorskip("zarr", reason="the extra adret[zarr] is not here")

FORMS = ("zarr", "zarr2")
GIVEN = {"directions": 4, "max_distance": 5000.0}
CHOSEN = {"horizon": {**GIVEN, "dtype": "uint16"}, "sky-view": GIVEN}


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory, example_dem: Path) -> Path:
    """The same products of a raster with a void in every format."""
    folder = tmp_path_factory.mktemp("stores")
    small = raster_files.crop(example_dem, folder / "dem.tif", 90, 110, void=(60, 75, 20, 50))
    for form in ("cog", *FORMS):
        batch(job_of([small], 64, CHOSEN), folder / form, form)
    return folder


def degrees(written: Path, product: str) -> np.ndarray:
    """What the COG says, NaN at nodata."""
    with rasterio.open(written / "cog" / f"{product}.tif") as dataset:
        stored = dataset.read(masked=True).astype(np.float64)
        return (stored * dataset.scales[0] + dataset.offsets[0]).filled(np.nan)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("form", FORMS)
def test_xarray_and_its_extensions_read_the_values_of_the_cog(form: str, written: Path) -> None:
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("rioxarray")
    pytest.importorskip("odc.geo.xr")
    with rasterio.open(written / "cog" / "horizon.tif") as dataset:
        transform, tags = dataset.transform, dataset.tags()
    store = xarray.open_zarr(written / form / "horizon.zarr", consolidated=False)
    store = store.set_coords("spatial_ref")
    horizon = store["horizon"]
    assert horizon.dims == ("band", "y", "x")
    assert horizon.attrs["units"] == "degree"
    assert horizon.attrs["band_names"][1] == "azimuth 90.0 deg"
    np.testing.assert_allclose(horizon.values, degrees(written, "horizon"), rtol=0, atol=1e-5)
    raw = xarray.open_zarr(
        written / form / "horizon.zarr", consolidated=False, mask_and_scale=False
    )
    assert raw["horizon"].dtype == np.uint16
    assert raw["horizon"].attrs["scale_factor"] == pytest.approx(180.0 / 65534.0)
    assert raw["horizon"].attrs["add_offset"] == -90.0
    assert raw["horizon"].attrs["_FillValue"] == 65535
    assert {name: store.attrs[name] for name in tags if name.startswith("ADRET")} == {
        name: text for name, text in tags.items() if name.startswith("ADRET")
    }
    assert horizon.rio.crs.to_epsg() == 2056
    assert horizon.rio.transform().almost_equals(transform, 1e-6)
    box = horizon.odc.geobox
    assert box.crs.epsg == 2056
    assert box.shape == (90, 110)
    assert box.affine.almost_equals(transform, 1e-6)
    sky = xarray.open_zarr(written / form / "sky-view.zarr", consolidated=False)["sky-view"]
    assert sky.dims == ("y", "x")
    assert sky.values.tobytes() == degrees(written, "sky-view")[0].astype("f4").tobytes()


@pytest.mark.filterwarnings("ignore")
def test_gdal_reads_the_older_version(written: Path) -> None:
    """QGIS reads rasters through this very driver."""
    with rasterio.Env() as environment:
        if "Zarr" not in environment.drivers():
            pytest.skip("this GDAL has no driver for Zarr")
    with rasterio.open(written / "cog" / "horizon.tif") as dataset:
        wanted, transform = dataset.read(), dataset.transform
    with rasterio.open(f'ZARR:"{written / "zarr2" / "horizon.zarr"}":/horizon') as dataset:
        assert dataset.crs.to_epsg() == 2056
        assert dataset.transform.almost_equals(transform, 1e-6)
        assert dataset.dtypes == ("uint16",) * 4
        assert dataset.nodata == 65535
        assert dataset.scales[0] == pytest.approx(180.0 / 65534.0)
        assert dataset.offsets == (-90.0,) * 4
        assert dataset.units == ("degree",) * 4
        assert dataset.read().tobytes() == wanted.tobytes()


def test_shards_are_whole_files(written: Path) -> None:
    """One file a band of 90 x 110 cells in version 3."""
    array = zarr.open_array(written / "zarr" / "horizon.zarr" / "horizon", mode="r")
    assert array.shards == (1, 90, 110)
    files = (written / "zarr" / "horizon.zarr" / "horizon" / "c").rglob("*")
    assert sum(path.is_file() for path in files) == 4


@pytest.mark.parametrize("form", FORMS)
def test_a_store_is_known_again_and_a_damaged_one_made_anew(form: str, written: Path) -> None:
    job = job_of([written / "dem.tif"], 64, CHOSEN)
    manifest = json.loads((written / form / "manifest.json").read_text())
    known = manifest["products"]["sky-view"]
    assert known["file"] == "sky-view.zarr"
    assert known["format"] == form
    data: list[Any] = [
        path
        for path in (written / form / "sky-view.zarr" / "sky-view").rglob("*")
        if path.is_file() and not path.name.startswith(("zarr.json", ".z"))
    ]
    before = data[0].read_bytes()
    data[0].write_bytes(before[:-1])
    executor = batch(job, written / form, form, resume=True)
    assert {order.product for order in executor.orders} == {"sky-view"}
    assert data[0].read_bytes() == before
    again = json.loads((written / form / "manifest.json").read_text())["products"]["sky-view"]
    assert again["sha256"] == known["sha256"]
    with pytest.raises(RasterError, match="a new folder"):
        prepare(job, written / form, form=form)
    assert not list(written.joinpath(form).glob(".adret-[!t]*"))


def test_a_format_that_is_not_known_is_refused(written: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="format: must be one of cog, zarr, zarr2"):
        file_of("sky-view", "png")
    arguments = ["batch", str(written / "dem.tif"), str(tmp_path / "out"), "--format", "png"]
    assert main(arguments) == 2
    assert not (tmp_path / "out").exists()
