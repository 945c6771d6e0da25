"""Tiles: what is computed of a part is, byte for byte, what the whole has there."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from affine import Affine
from numpy.typing import NDArray

import adret
import scenes
from adret.errors import InputError

Layers = NDArray[Any]
Product = Callable[..., Layers]


def environment() -> adret.Environment:
    """A sky with light below and above the horizontal, so that some slices are dark for some."""
    picture = np.zeros((32, 64, 3), np.float32)
    picture[14:19, 5:40] = [3.0, 2.0, 1.0]
    picture[17:22, 50:60] = 4.0
    return adret.Environment(picture)


PRODUCTS: dict[str, Product] = {
    "horizon": lambda t, **o: adret.horizon_map(t, 20, **o).elevation,
    "distance": lambda t, **o: adret.horizon_map(t, 5, distance=True, **o).distance,
    "sky": lambda t, **o: adret.sky_view_factor(t, "normal", directions=40, **o),
    "openness": lambda t, **o: adret.openness(t, -1, directions=12, **o),
    "shadow": lambda t, **o: adret.shadow(t, adret.Sun(250.0, 12.0), **o).code,
    "lit": lambda t, **o: adret.shadow(t, adret.Sun(250.0, 2.0, 1.0, 6.0), **o).lit,
    "light": lambda t, **o: adret.direct_light(t, environment(), 48, **o).irradiance,
}


@pytest.fixture
def plane_raster(rng: np.random.Generator) -> adret.Terrain:
    z = scenes.fractal(rng, (90, 121), relief=400.0)
    z[rng.random(z.shape) < 0.003] = np.nan
    z[40:55, 60:80] = np.nan
    return adret.Terrain(z, (10.0, 12.5), datum=200.0)


@pytest.fixture
def geographic_raster(rng: np.random.Generator) -> adret.Terrain:
    z = scenes.fractal(rng, (90, 121), relief=4000.0)
    return adret.Terrain(z, None, "EPSG:4326", Affine(0.2, 0.0, 7.1, 0.0, -0.2, 81.3))


def cut(terrain: adret.Terrain, size: int) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Windows of a size that cover a raster."""
    rows, columns = terrain.shape
    return [
        ((top, min(top + size, rows)), (left, min(left + size, columns)))
        for top in range(0, rows, size)
        for left in range(0, columns, size)
    ]


def check(
    terrain: adret.Terrain, product: Product, size: int, reach: float | None, **options: Any
) -> None:
    """Compare every tile's bytes with the whole's."""
    options["max_distance"] = reach
    whole = product(terrain, **options)
    place = (slice(None),) if whole.ndim == 3 and whole.shape[0] != terrain.shape[0] else ()
    halo = None
    if reach is not None:
        halo = adret.HorizonOptions(max_distance=reach).halo(terrain)
    for rows, columns in cut(terrain, size):
        tile = product(terrain.tile(rows, columns, halo), **options)
        wanted = whole[(*place, slice(*rows), slice(*columns))]
        assert tile.shape == wanted.shape
        assert tile.tobytes() == wanted.tobytes(), (rows, columns)


@pytest.mark.parametrize("reach", [None, 265.0])
@pytest.mark.parametrize("name", list(PRODUCTS))
def test_tiles_are_the_whole_byte_for_byte(
    name: str, reach: float | None, plane_raster: adret.Terrain
) -> None:
    check(plane_raster, PRODUCTS[name], 37, reach, near=4, radius=6_371_000.0)


@pytest.mark.parametrize("reach", [None, 90_000.0])
@pytest.mark.parametrize("name", ["horizon", "sky", "light"])
def test_tiles_of_a_geographic_raster_are_the_whole(
    name: str, reach: float | None, geographic_raster: adret.Terrain
) -> None:
    """Bands of latitude are cut, and azimuths ordered, as in the whole raster."""
    assert len(geographic_raster.latitude_bands(np.radians(0.5))) > 3
    check(geographic_raster, PRODUCTS[name], 37, reach, near=4, radius=6_371_000.0)


@pytest.mark.parametrize("method", ["march", "exact"])
@pytest.mark.parametrize("reach", [None, 265.0])
def test_tiles_by_other_methods_are_the_whole(
    method: str, reach: float | None, plane_raster: adret.Terrain
) -> None:
    check(plane_raster, PRODUCTS["horizon"], 50, reach, method=method)


def test_a_tile_of_a_tile_refuses_the_published_hull(plane_raster: adret.Terrain) -> None:
    with pytest.raises(InputError, match="method"):
        adret.horizon_map(plane_raster.tile((0, 9), (0, 9)), 4, method="hull")


def test_a_tile_is_a_window_that_sees_more(plane_raster: adret.Terrain) -> None:
    tile = plane_raster.tile((10, 30), (5, 17), halo=8)
    window = plane_raster.window((10, 30), (5, 17))
    assert tile.heights.tobytes() == window.heights.tobytes()
    assert tile.origin == window.origin == (10, 5)
    assert tile.view.heights.shape == (36, 25)
    assert (tile.view.top, tile.view.left) == (8, 5)


def test_light_that_skips_dark_slices_is_the_same_light(
    plane_raster: adret.Terrain, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sums are cut by the number of the slice, not by how many were swept."""
    sky = environment()
    skipping = adret.direct_light(plane_raster, sky, 48, near=4)
    monkeypatch.setattr("adret.light.lit_slices", lambda slices, receivers: slices)
    swept = adret.direct_light(plane_raster, sky, 48, near=4)
    assert skipping.report.azimuths_swept < swept.report.azimuths_swept
    assert skipping.irradiance.tobytes() == swept.irradiance.tobytes()
