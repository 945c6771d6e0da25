"""Rasters of reflectance and emission on a terrain's own grid, and the bounces made with them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from affine import Affine

import adret
from adret import RasterError, Terrain, cli, products
from adret.overlays import read_overlay
from adret.products import PRODUCTS
from raster_files import NORTH_UP, save

SHAPE = (30, 40)


@pytest.fixture
def terrain(rng: np.random.Generator) -> Terrain:
    """A rough bowl with a cell of nodata, in UTM."""
    rows, columns = np.mgrid[0:30, 0:40]
    heights = 0.8 * ((rows - 15) ** 2 + (columns - 20) ** 2) + rng.normal(0.0, 4.0, SHAPE)
    heights[3, 4] = np.nan
    return Terrain(heights, crs="EPSG:32633", transform=NORTH_UP)


def written(terrain: Terrain, path: Path, **options: Any) -> tuple[np.ndarray, dict]:
    """Bands and metadata of bounces that were written."""
    product = PRODUCTS["bounce"]
    products.run(product, terrain, product.parameters(directions=8, **options), path)
    with rasterio.open(path) as source:
        values = np.ma.filled(source.read(masked=True), np.nan)
        return values, source.tags() | {"names": source.descriptions}


# --- reading --------------------------------------------------------------------------------------


def test_one_band_and_three_are_read_as_they_are(
    terrain: Terrain, rng: np.random.Generator, tmp_path: Path
) -> None:
    bands = rng.random((3, *SHAPE)).astype(np.float32)
    bands[1, 2, 3] = -9999.0
    path = save(tmp_path / "three.tif", bands, nodata=-9999.0, unit="W m-2 sr-1")
    want = np.moveaxis(np.where(bands < 0.0, np.nan, bands), 0, 2)
    np.testing.assert_array_equal(read_overlay("albedo_map", path, terrain), want)
    path = save(tmp_path / "one.tif", np.full(SHAPE, 7, np.uint8), scale=0.1, offset=0.05)
    got = read_overlay("albedo_map", path, terrain, 1.0)
    assert got.shape == SHAPE
    np.testing.assert_allclose(got, 0.75, rtol=1e-6)


def test_files_that_run_south_or_say_no_place_are_read(terrain: Terrain, tmp_path: Path) -> None:
    values = np.arange(1200.0, dtype=np.float32).reshape(SHAPE)
    south_up = Affine(10.0, 0.0, NORTH_UP.c, 0.0, 10.0, NORTH_UP.f - 300.0)
    path = save(tmp_path / "south.tif", values[::-1].copy(), transform=south_up)
    np.testing.assert_array_equal(read_overlay("emission", path, terrain), values)
    path = save(tmp_path / "nowhere.tif", values, crs=None, transform=None)
    np.testing.assert_array_equal(read_overlay("emission", path, terrain), values)


def test_what_does_not_fit_is_named(terrain: Terrain, tmp_path: Path) -> None:
    zeros = np.zeros(SHAPE, np.float32)
    aside = Affine(10.0, 0.0, NORTH_UP.c + 5.0, 0.0, -10.0, NORTH_UP.f)
    wide = Affine(11.0, 0.0, NORTH_UP.c, 0.0, -10.0, NORTH_UP.f)
    text = tmp_path / "text.tif"
    text.write_text("hot\n")
    cases: list[tuple[Path, str]] = [
        (tmp_path / "no.tif", "emission: must be an existing file, got"),
        (text, "emission: must be a GeoTIFF, an Arc/Info ASCII grid or a PNG, got"),
        (save(tmp_path / "2.tif", np.zeros((2, *SHAPE))), "one band or three, got '2 bands'"),
        (save(tmp_path / "s.tif", zeros[1:]), "the terrain's 30 x 40 cells, got '29 x 40'"),
        (save(tmp_path / "c.tif", zeros, crs="EPSG:32632"), "WGS 84 / UTM zone 33N), got 'WGS 84"),
        (
            save(tmp_path / "a.tif", zeros, transform=aside),
            "on the terrain's grid (from 500000, 50",
        ),
        (save(tmp_path / "w.tif", zeros, transform=wide), "5000000; 11 x 10'"),
        (save(tmp_path / "n.tif", zeros - 1.0), "finite, 0 or more, in every cell, got -1.0"),
        (save(tmp_path / "i.tif", zeros + np.inf), "finite, 0 or more, in every cell, got inf"),
    ]
    for path, message in cases:
        with pytest.raises(RasterError) as caught:
            read_overlay("emission", path, terrain)
        assert caught.value.field == "emission"
        assert message in str(caught.value)
    dark = save(tmp_path / "b.tif", zeros + 1.5)
    with pytest.raises(
        RasterError, match=r"albedo_map: must be between 0 and 1 in every cell, got"
    ):
        read_overlay("albedo_map", dark, terrain, 1.0)


# --- bounces --------------------------------------------------------------------------------------


@pytest.mark.parametrize("layer", ["indirect", "total", "radiance"])
def test_bounces_take_reflectance_and_emission_from_files(
    layer: str, terrain: Terrain, rng: np.random.Generator, tmp_path: Path
) -> None:
    lava = np.zeros((3, *SHAPE), np.float32)
    lava[:, 14:17, 18:22] = np.array([9.0, 2.0, 0.3])[:, None, None]
    lava[:, 0, 0] = -1.0
    albedo = rng.random(SHAPE).astype(np.float32)
    options = {
        "emission": str(save(tmp_path / "lava.tif", lava, nodata=-1.0)),
        "albedo_map": str(save(tmp_path / "albedo.tif", albedo)),
    }
    got, facts = written(
        terrain, tmp_path / "a.tif", sky="uniform", bounces=2, layer=layer, **options
    )
    lava[:, 0, 0] = 0.0
    picture = adret.render(
        terrain,
        adret.UniformSky(),
        albedo,
        2,
        emission=np.moveaxis(lava, 0, 2),
        directions=8,
    )
    want = {
        "indirect": picture.indirect.irradiance,
        "total": picture.indirect.irradiance + picture.direct.irradiance[..., None],
        "radiance": picture.radiance,
    }[layer]
    np.testing.assert_allclose(got, np.moveaxis(want, 2, 0), rtol=1e-5, atol=1e-6)
    assert facts["names"] == ("red", "green", "blue")
    assert facts["ADRET_ALBEDO"] == "map albedo.tif"
    assert facts["ADRET_DEFINITION"].endswith("lit by uniform sky, emission map lava.tif")


def test_lava_alone_is_light_enough(terrain: Terrain, tmp_path: Path) -> None:
    lava = np.zeros(SHAPE, np.float32)
    lava[15, 20] = 40.0
    path = save(tmp_path / "lava.tif", lava)
    got, facts = written(terrain, tmp_path / "a.tif", emission=str(path), layer="total")
    want = adret.indirect_light(terrain, None, 0.3, radiance=lava, directions=8)
    np.testing.assert_allclose(got[0], want.irradiance, rtol=1e-6)
    assert np.nanmax(got) > 0.1
    assert facts["ADRET_DEFINITION"].endswith("lit by emission map lava.tif")
    assert facts["ADRET_ALBEDO"] == "0.3"


def test_the_command_takes_the_files_and_never_overwrites_them(
    terrain: Terrain, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dem = save(tmp_path / "dem.tif", np.nan_to_num(terrain.elevations()))
    lava = save(tmp_path / "lava.tif", np.eye(*SHAPE, dtype=np.float32))
    grey = save(tmp_path / "grey.tif", np.full(SHAPE, 0.4, np.float32))
    maps = ["--emission", str(lava), "--albedo-map", str(grey), "--directions", "4"]
    out = tmp_path / "out.tif"
    assert cli.main(["bounce", str(dem), str(out), *maps]) == 0
    with rasterio.open(out) as source:
        assert source.read(1).max() > 0.0
    capsys.readouterr()
    before = lava.read_bytes()
    assert cli.main(["bounce", str(dem), str(lava), *maps, "--overwrite"]) == 2
    assert "out: must be another file than the input" in capsys.readouterr().err
    assert lava.read_bytes() == before
    other = save(tmp_path / "other.tif", np.zeros((3, 3), np.float32))
    assert cli.main(["bounce", str(dem), str(tmp_path / "n.tif"), "--emission", str(other)]) == 2
    message = "adret: emission: must be of the terrain's 30 x 40 cells, got '3 x 3'\n"
    assert capsys.readouterr().err == message
    assert not (tmp_path / "n.tif").exists()
