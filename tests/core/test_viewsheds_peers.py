"""Viewsheds against GDAL and GRASS: where they differ, it is by a rule that is written down."""

from pathlib import Path

import numpy as np
import pytest

import adret
import sight_peers
from raster_files import NORTH_UP, save

PLACE = (23, 31)
EYE = 1.625


def ground(name: str) -> np.ndarray:
    """A scene of 57 x 66 cells of 10 m."""
    rng = np.random.default_rng(4)
    shape = (57, 66)
    if name == "grazing":
        return rng.normal(0.0, 0.1, shape).astype(np.float32)
    if name == "post":
        z = np.zeros(shape, np.float32)
        z[PLACE[0] + 3, PLACE[1] + 7] = 10.0
        return z
    walk = rng.normal(0.0, 1.0, shape).cumsum(0).cumsum(1)
    z = (walk + rng.normal(0.0, 2.0, shape)).astype(np.float32)
    if name == "holes":
        z[10:16, 34:50] = np.nan
    return z


def seen_by(tool: str, z: np.ndarray, folder: Path) -> np.ndarray:
    """What a tool sees from the place."""
    reason = sight_peers.missing(tool)
    if reason is not None:
        pytest.skip(reason)
    dem = save(folder / "dem.tif", np.where(np.isnan(z), np.float32(-9999.0), z), nodata=-9999.0)
    x = NORTH_UP.c + NORTH_UP.a * (PLACE[1] + 0.5)
    y = NORTH_UP.f + NORTH_UP.e * (PLACE[0] + 0.5)
    if tool == "gdal":
        return sight_peers.gdal(dem, x, y, EYE)[0]
    (seen,), _ = sight_peers.grass(dem, [(x, y, EYE, 0.0)])
    return seen


def exact(z: np.ndarray) -> adret.Viewshed:
    terrain = adret.Terrain(z, (10.0, 10.0), datum=0.0)
    return adret.viewshed(terrain, PLACE, observer_height=EYE)


@pytest.mark.parametrize("scene", ["grazing", "post", "holes"])
def test_gdal_carries_needed_heights_from_ring_to_ring(scene: str, tmp_path: Path) -> None:
    z = ground(scene)
    gdal = seen_by("gdal", z, tmp_path)
    lowered = np.where(np.isnan(z), -9999.0, z)  # nodata is a deep hole to it
    rule = sight_peers.gdal_rule(lowered, PLACE, float(z[PLACE]) + EYE)
    np.testing.assert_array_equal(gdal, rule)
    own = exact(z).visible
    assert (own != gdal)[~np.isnan(z)].sum() > 0


def test_a_carried_shadow_of_a_post_spreads_and_sinks() -> None:
    # The need of one cell becomes that of two in the next ring, of three in the one after it: a
    # post that towers hides twice the ground that it should, one little above the eye a third.
    z = ground("post")
    terrain = adret.Terrain(z, (10.0, 10.0), datum=0.0)
    for eye, own, carried in ((1.625, 144, 332), (8.0, 73, 24)):
        seen = adret.viewshed(terrain, PLACE, observer_height=eye).visible
        assert (~seen).sum() == own
        assert (~sight_peers.gdal_rule(z, PLACE, eye)).sum() == carried


@pytest.mark.parametrize(
    "scene", ["holes", *(pytest.param(s, marks=pytest.mark.slow) for s in ("rough", "grazing"))]
)
def test_grass_looks_where_diamonds_cross_the_line(scene: str, tmp_path: Path) -> None:
    z = ground(scene)
    grass = seen_by("grass", z, tmp_path)
    known = ~np.isnan(z)
    known[PLACE] = False
    cells = np.argwhere(known)
    eye = float(np.float32(z[PLACE] + np.float32(EYE)))
    rule = sight_peers.grass_rule(z, PLACE, map(tuple, cells), eye, (10.0, 10.0))
    np.testing.assert_array_equal(grass[known], rule)
    assert (exact(z).visible != grass)[known].sum() > 0


def test_the_last_diamond_hides_with_a_cell_that_the_line_does_not_touch() -> None:
    # From (0, 0) to (3, 4) the line touches the cells (2, 2), (2, 3) and (3, 3) last. Just before
    # the target GRASS takes the mean of four cells, and (2, 4) is one of them.
    z = np.full((5, 6), -1.0, np.float32)
    z[2, 4] = 1.0
    terrain = adret.Terrain(z, (1.0, 1.0), datum=0.0)
    sight = adret.line_of_sight(terrain, (0, 0), (3, 4), observer_height=1.0)
    assert sight.visible
    assert sight.clearance[1:-1].min() > 0.2
    assert sight_peers.grass_rule(z, (0, 0), [(3, 4), (4, 4)], 0.0) == [False, True]
    z[2, 4] = -1.0
    assert sight_peers.grass_rule(z, (0, 0), [(3, 4)], 0.0) == [True]


def test_a_line_through_a_corner_slips_between_two_cells() -> None:
    # Half way to (3, 5) the line meets the fourth diamond in a corner of the post's cell.
    z = np.zeros((6, 8), np.float32)
    z[1, 3] = 4.0
    terrain = adret.Terrain(z, (1.0, 1.0), datum=0.0)
    sight = adret.line_of_sight(terrain, (0, 0), (3, 5), observer_height=1.0)
    assert not sight.visible
    assert sight.minimum_height == pytest.approx((0.2 * 4.0 - 1.0) / 0.6 + 1.0)
    assert sight_peers.grass_rule(z, (0, 0), [(3, 5), (2, 5)], 1.0) == [True, False]
