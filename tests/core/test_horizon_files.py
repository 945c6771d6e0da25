"""Horizon maps in files: the same angles within half a step, for Adret and for others."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio

import adret
from adret.horizon_files import ANGLES

KINDS = ["tif", "zarr"]


@pytest.fixture(scope="module")
def found() -> adret.HorizonMap:
    z = np.random.default_rng(8).random((30, 41)) * 40.0
    z[3:6, 7:12] = np.nan
    terrain = adret.Terrain(z, (10.0, 10.0))
    return adret.horizon_map(terrain, azimuths=[0.0, 0.7, 2.5], near=8, observer_height=1.5)


def place(folder: Path, kind: str) -> Path:
    if kind == "zarr":
        pytest.importorskip("zarr", reason="the package zarr is not installed")
    return folder / f"horizon.{kind}"


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("dtype", list(ANGLES))
def test_angles_come_back_within_half_a_step(
    kind: str, dtype: Any, found: adret.HorizonMap, tmp_path: Path
) -> None:
    path = place(tmp_path, kind)
    found.save(path, dtype=dtype)
    again = adret.HorizonMap.open(path, found.terrain)
    off = np.abs(np.degrees(again.elevation.astype(np.float64) - found.elevation))
    step = ANGLES[dtype].step
    assert np.nanmax(off) <= (1e-5 if step is None else step / 2 + 1e-5)
    np.testing.assert_array_equal(np.isnan(again.elevation), np.isnan(found.elevation))
    np.testing.assert_array_equal(again.azimuth, found.azimuth)
    assert again.options == found.options
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


def test_rasterio_reads_degrees(found: adret.HorizonMap, tmp_path: Path) -> None:
    found.save(tmp_path / "horizon.tif", dtype="uint8")
    with rasterio.open(tmp_path / "horizon.tif") as dataset:
        assert dataset.descriptions[1] == "azimuth 40.10704566 deg"
        numbers = dataset.read(2, masked=True)
        degrees = numbers * dataset.scales[1] + dataset.offsets[1]
    np.testing.assert_array_equal(degrees.mask, found.terrain.mask)
    want = np.degrees(found.elevation[1])[~found.terrain.mask]
    assert np.abs(degrees.compressed() - want).max() <= 180.0 / 508.0 + 1e-4


# affine warns of rioxarray's use of it.
@pytest.mark.filterwarnings("ignore:Use `@`:PendingDeprecationWarning")
@pytest.mark.parametrize("kind", KINDS)
def test_xarray_reads_degrees(kind: str, found: adret.HorizonMap, tmp_path: Path) -> None:
    xarray = pytest.importorskip("xarray", reason="the package xarray is not installed")
    path = place(tmp_path, kind)
    found.save(path)
    if kind == "zarr":
        with xarray.open_zarr(path) as dataset:
            got, azimuth = dataset["horizon"].values, dataset["azimuth"].values
            assert dataset["x"].values[:2].tolist() == [5.0, 15.0]
        np.testing.assert_allclose(azimuth, np.degrees(found.azimuth))
    else:
        rioxarray = pytest.importorskip("rioxarray", reason="the package rioxarray is missing")
        with rioxarray.open_rasterio(path, mask_and_scale=True) as dataset:
            got = dataset.values
    np.testing.assert_allclose(got, np.degrees(found.elevation), atol=0.0014, equal_nan=True)


@pytest.mark.parametrize("kind", KINDS)
def test_files_are_replaced_only_when_asked(
    kind: str, found: adret.HorizonMap, tmp_path: Path
) -> None:
    path = place(tmp_path, kind)
    found.save(path)
    with pytest.raises(adret.RasterError, match="a new file"):
        found.save(path)
    found.save(path, dtype="uint8", overwrite=True)
    again = adret.HorizonMap.open(path, found.terrain)
    assert np.nanmax(np.abs(again.elevation - found.elevation)) > 1e-3


def test_what_is_no_horizon_map_is_refused(found: adret.HorizonMap, tmp_path: Path) -> None:
    path = tmp_path / "horizon.tif"
    found.save(path)
    with pytest.raises(adret.InputError, match="terrain"):
        adret.HorizonMap.open(path, adret.Terrain(np.zeros((3, 3)), (1.0, 1.0)))
    with pytest.raises(adret.InputError, match="dtype"):
        found.save(path, dtype="int8")  # type: ignore[arg-type]
    with pytest.raises(adret.RasterError, match="path"):
        adret.HorizonMap.open(tmp_path / "none.tif", found.terrain)
    with pytest.raises(adret.RasterError, match="Zarr"):
        adret.HorizonMap.open(tmp_path / "none.zarr", found.terrain)
