"""xarray: the same numbers as the library, eager and lazy, and a place on the map that stays."""

from pathlib import Path

import numpy as np
import pytest

import adret
import scenes
from adret.errors import InputError

xr = pytest.importorskip("xarray", reason="the extra adret[xarray] is not here")
pytest.importorskip("dask.array", reason="the extra adret[xarray] is not here")

import adret.xarray  # noqa: E402


@pytest.fixture
def heights(rng: np.random.Generator) -> "xr.DataArray":
    z = scenes.fractal(rng, (60, 70), relief=300.0)
    z[20:25, 30:33] = np.nan
    return xr.DataArray(
        z,
        dims=("y", "x"),
        coords={
            "y": 5000.0 - 10.0 * np.arange(60),
            "x": 300.0 + 10.0 * np.arange(70),
            "spatial_ref": xr.DataArray(0, attrs={"crs_wkt": "EPSG:32633"}),
        },
    )


@pytest.mark.parametrize("reach", [None, 150.0])
def test_lazy_chunks_are_the_eager_result(heights: "xr.DataArray", reach: float | None) -> None:
    options = {"near": 4, "max_distance": reach}
    terrain = heights.adret.terrain()
    eager = heights.adret.horizon_map(20, **options)
    wanted = adret.horizon_map(terrain, 20, **options).elevation
    assert eager.values.tobytes() == wanted.tobytes()
    chunked = heights.chunk({"y": 25, "x": 33})
    lazy = chunked.adret.horizon_map(20, **options)
    assert lazy.chunks == ((20,), (25, 25, 10), (33, 33, 4))
    assert lazy.values.tobytes() == wanted.tobytes()
    sun = adret.Sun(250.0, 12.0)
    lit = chunked.adret.shadow(sun, **options)
    assert lit.values.tobytes() == adret.shadow(terrain, sun, **options).lit.tobytes()


def test_rows_may_run_north(heights: "xr.DataArray") -> None:
    one = heights.adret.openness(directions=12, near=4)
    other = heights[::-1].adret.openness(directions=12, near=4)
    np.testing.assert_array_equal(other.values, one.values[::-1])
    xr.testing.assert_equal(one, other.sortby("y", ascending=False))


def test_place_units_and_coordinates_come_along(heights: "xr.DataArray") -> None:
    horizons = heights.adret.horizon_map(20, near=4)
    assert horizons.dims == ("azimuth", "y", "x")
    assert horizons.attrs["units"] == "rad"
    np.testing.assert_allclose(horizons.azimuth, np.radians(18.0 * np.arange(20)))
    assert horizons.spatial_ref.attrs["crs_wkt"] == "EPSG:32633"
    np.testing.assert_array_equal(horizons.x, heights.x)


def test_uneven_coordinates_are_refused(heights: "xr.DataArray") -> None:
    with pytest.raises(InputError, match="coordinates of an even grid"):
        heights.isel(x=[0, 1, 3, 4]).adret.terrain()
    with pytest.raises(InputError, match="two-dimensional"):
        heights.expand_dims("time").adret.terrain()


@pytest.mark.filterwarnings("ignore")  # those of rioxarray and of the projection itself
def test_a_file_through_rioxarray_is_the_file(example_dem: Path) -> None:
    rioxarray = pytest.importorskip("rioxarray")
    with rioxarray.open_rasterio(example_dem, masked=True) as opened:
        found = opened.squeeze("band", drop=True).adret.terrain()
    terrain = adret.Terrain.open(example_dem)
    assert found.heights.tobytes() == terrain.heights.tobytes()
    assert found.cell_size == pytest.approx(terrain.cell_size)
    assert found.crs == terrain.crs
