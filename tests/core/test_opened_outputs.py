"""What a batch writes, opened with the tools that people use: place, scale, nodata, units."""

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio

import adret
import raster_files
from adret.cli import main

SYSTEM_PYTHON = Path("/usr/bin/python3")  # what a distribution's QGIS is installed for


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory, example_dem: Path) -> Path:
    """Horizons in uint16 and a sky view in float32, of a raster with a void."""
    folder = tmp_path_factory.mktemp("written")
    small = raster_files.crop(example_dem, folder / "dem.tif", 90, 110, void=(60, 75, 20, 50))
    options = ["--directions", "4", "--max-distance", "5000", "--tile-size", "64"]
    assert (
        main(["batch", str(small), str(folder / "out"), "--product", "horizon,sky", *options]) == 0
    )
    return folder


def horizons(written: Path) -> Any:
    terrain = adret.Terrain.open(written / "dem.tif")
    return np.degrees(adret.horizon_map(terrain, 4, max_distance=5000.0).elevation)


def test_rasterio_reads_degrees_and_their_place(written: Path) -> None:
    terrain = adret.Terrain.open(written / "dem.tif")
    with rasterio.open(written / "out" / "horizon.tif") as dataset:
        assert dataset.crs.to_epsg() == 2056
        assert dataset.transform == terrain.transform
        assert dataset.dtypes == ("uint16",) * 4
        assert dataset.units == ("degree",) * 4
        assert dataset.nodata == 65535
        assert dataset.descriptions[1] == "azimuth 90.0 deg"
        stored = dataset.read(masked=True)
        degrees = stored * dataset.scales[0] + dataset.offsets[0]
    assert (degrees.mask == np.isnan(horizons(written))).all()
    off = np.abs(degrees.filled(np.nan) - horizons(written))
    assert np.nanmax(off) <= 0.5 * 180.0 / 65534.0 + 1e-4


@pytest.mark.filterwarnings("ignore")  # those of rioxarray and of the projection itself
def test_rioxarray_reads_the_same_degrees(written: Path) -> None:
    rioxarray = pytest.importorskip("rioxarray")
    path = written / "out" / "horizon.tif"
    with rioxarray.open_rasterio(path, mask_and_scale=True) as opened:
        values = opened.values
        assert opened.rio.crs.to_epsg() == 2056
        assert opened.rio.transform() == adret.Terrain.open(written / "dem.tif").transform
    np.testing.assert_allclose(values, horizons(written), atol=0.0015)


@pytest.mark.filterwarnings("ignore")
def test_odc_geo_and_xarray_find_the_grid(written: Path) -> None:
    rioxarray = pytest.importorskip("rioxarray")
    pytest.importorskip("odc.geo.xr")
    terrain = adret.Terrain.open(written / "dem.tif")
    with rioxarray.open_rasterio(written / "out" / "sky-view.tif", masked=True) as opened:
        box = opened.odc.geobox
        assert box.shape == terrain.shape
        assert box.affine == terrain.transform
        assert box.crs.epsg == 2056
        assert opened.attrs["ADRET_PRODUCT"] == "sky-view"
        view = adret.sky_view_factor(terrain, directions=4, max_distance=5000.0)
        assert opened.values[0].tobytes() == view.tobytes()


def test_qgis_reads_degrees_and_their_place(written: Path) -> None:
    command = [str(SYSTEM_PYTHON), str(Path(__file__).with_name("qgis_reader.py"))]
    known = [str(SYSTEM_PYTHON), "-c", "import qgis.core"]
    if not SYSTEM_PYTHON.exists() or subprocess.run(known, capture_output=True).returncode:
        pytest.skip("QGIS is not installed for the system's Python")
    path = written / "out" / "horizon.tif"
    answer = subprocess.run([*command, str(path)], capture_output=True, check=True, timeout=120)
    found = json.loads(answer.stdout)
    wanted = horizons(written)
    with rasterio.open(path) as dataset:
        np.testing.assert_allclose(found["bounds"], dataset.bounds, rtol=1e-12)
    assert found["valid"]
    assert found["crs"] == "EPSG:2056"
    assert found["shape"] == list(wanted.shape[1:])
    assert found["bands"] == 4
    assert "azimuth 0.0 deg" in found["name"]
    assert found["degrees"]
    degrees = np.array(found["values"], dtype=np.float64)
    assert (np.isnan(degrees) == np.isnan(wanted[0])).all()
    np.testing.assert_allclose(degrees, wanted[0], atol=0.0015)
