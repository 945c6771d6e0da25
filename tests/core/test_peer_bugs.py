"""Mistakes that other tools shipped, R1 to R17: each is a test here.

R3 and R11 of the viewshed kind, and R13 (polar day and night), belong to modules that answer those
questions; what of them touches horizons and shadows is tested here.
"""

import numpy as np
import pytest

import adret
import scenes

METHODS = ["exact", "sweep", "march", "hull"]
TRUE = ["exact", "sweep", "march"]  # P1 as published blurs by half a cell: not for single spires
RANGED = TRUE  # those that take max_distance


@pytest.mark.parametrize("method", METHODS)
def test_r1_slopes_are_per_metre_not_per_cell(method: str, rng: np.random.Generator) -> None:
    z = scenes.fractal(rng, (30, 30))
    views = {
        step: adret.sky_view_factor(
            adret.Terrain(z, (step, step)), kind="visible", directions=16, method=method
        )
        for step in (1.0, 50.0)
    }
    assert views[50.0].mean() > 0.9 > 0.7 > views[1.0].mean()
    step_up = adret.Terrain(np.array([[0.0, 30.0]]), (30.0, 30.0))
    got = adret.horizon_map(step_up, azimuths=[np.pi / 2], method=method)
    assert got.elevation[0, 0, 0] == pytest.approx(np.pi / 4, abs=1e-6)
    slope = scenes.plane(np.radians(20), 0.0, cell_size=(30.0, 30.0))
    normals = adret.surface_normals(adret.Terrain(slope.heights, slope.cell_size))
    np.testing.assert_allclose(normals[2][slope.where], np.cos(np.radians(20)), atol=1e-6)


@pytest.mark.parametrize("method", TRUE)
def test_r2_azimuths_are_on_the_ground_not_in_the_array(method: str) -> None:
    """A spire two columns east and two rows north of the receiver, on cells of 10 m by 40 m."""
    z = np.zeros((9, 9))
    z[2, 4] = 50.0
    terrain = adret.Terrain(z, (10.0, 40.0))
    azimuths = [np.arctan2(20.0, 80.0), np.pi / 4]
    on_ground, in_array = adret.horizon_map(terrain, azimuths=azimuths, method=method).elevation[
        :, 4, 2
    ]
    assert on_ground == pytest.approx(np.arctan(50.0 / np.hypot(20.0, 80.0)), abs=1e-5)
    assert in_array == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("method", TRUE)
def test_r3_a_cell_never_hides_itself(method: str) -> None:
    z = np.zeros((11, 11))
    for height in (0.0, 5.0, 500.0):
        z[5, 5] = height
        got = adret.horizon_map(adret.Terrain(z, (1.0, 1.0)), 16, method=method).elevation[:, 5, 5]
        # Level ground out to the raster's edge, 5 cells along an axis and 5 root 2 in a corner.
        assert (got >= np.arctan(-height / 5.0) - 1e-6).all()
        assert (got <= np.arctan(-height / (5.0 * np.sqrt(2.0))) + 1e-6).all()


@pytest.mark.parametrize("method", METHODS)
def test_r4_the_lit_strip_behind_a_ridge_keeps_its_width(method: str) -> None:
    """A ridge of 100.05 m at 5 degrees of sun shades 1143.6 m: to the metre."""
    z = np.zeros((3, 1400))
    z[:, 0] = 100.05
    terrain = adret.Terrain(z, (1.0, 1.0))
    sun = adret.Sun(270.0, 5.0, angular_diameter_deg=0.0)
    lit = adret.shadow(terrain, sun, method=method).lit[1]
    length = 100.05 / np.tan(np.radians(5.0))
    shade = np.flatnonzero(lit == 0.0)
    shade = shade[(shade > 1) & (shade < 1398)]  # the edge and the ridge's foot are tilted
    assert shade.min() == 2
    assert shade.max() == int(length) == 1143
    np.testing.assert_array_equal(lit[1144:1398], 1.0)


@pytest.mark.parametrize("method", METHODS)
def test_r5_azimuth_360_is_azimuth_0(method: str, rng: np.random.Generator) -> None:
    terrain = adret.Terrain(scenes.fractal(rng, (25, 31)), (2.0, 3.0))
    turns = [0.0, 2.0 * np.pi, -2.0 * np.pi, 4.0 * np.pi]
    cube = adret.horizon_map(terrain, azimuths=turns, method=method).elevation
    for layer in cube[1:]:
        assert layer.tobytes() == cube[0].tobytes()
    for azimuth in (360.0, 720.0):
        first = adret.shadow(terrain, adret.Sun(0.0, 20.0), method=method)
        again = adret.shadow(terrain, adret.Sun(azimuth, 20.0), method=method)
        assert first.lit.tobytes() == again.lit.tobytes()


@pytest.mark.parametrize("method", TRUE)
def test_r6_diagonal_of_a_pyramid(method: str) -> None:
    east, north = scenes.metres((41, 41), (1.0, 1.0))
    diagonals = np.pi / 4 + np.arange(4) * np.pi / 2
    hollow = adret.Terrain(np.maximum(abs(east), abs(north)), (1.0, 1.0))
    got = adret.horizon_map(hollow, azimuths=diagonals, method=method).elevation[:, 20, 20]
    np.testing.assert_allclose(np.degrees(got), 35.2644, atol=1e-4)
    standing = adret.Terrain(-np.maximum(abs(east), abs(north)), (1.0, 1.0))
    got = adret.horizon_map(standing, azimuths=diagonals, method=method).elevation[:, 20, 20]
    np.testing.assert_allclose(np.degrees(got), -35.2644, atol=1e-4)


@pytest.mark.parametrize("method", METHODS)
def test_r7_looking_down_a_lower_cell_may_be_the_horizon(method: str) -> None:
    z = np.full((1, 11), -50.0)
    z[0, 0], z[0, 1], z[0, 10] = 0.0, -1.0, -1.5
    got = adret.horizon_map(adret.Terrain(z, (1.0, 1.0)), azimuths=[np.pi / 2], method=method)
    assert np.degrees(got.elevation[0, 0, 0]) == pytest.approx(-8.53, abs=1e-3)


@pytest.mark.parametrize("method", ["exact", "sweep"])
def test_r8_distance_is_metres_to_the_horizon_point(method: str) -> None:
    z = np.zeros((9, 9))
    z[1, 7] = 40.0  # four columns and four rows away: 20 m east, 28 m north
    terrain = adret.Terrain(z, (5.0, 7.0))
    got = adret.horizon_map(
        terrain, azimuths=[np.arctan2(20.0, 28.0)], method=method, distance=True
    )
    assert got.distance is not None
    assert got.elevation[0, 5, 3] == pytest.approx(np.arctan(40.0 / np.hypot(20, 28)), abs=1e-5)
    assert got.distance[0, 5, 3] == pytest.approx(np.hypot(20.0, 28.0), rel=1e-5)


@pytest.mark.parametrize("method", METHODS)
def test_r9_nodata_on_the_row_or_the_edge_spoils_only_itself(
    method: str, rng: np.random.Generator
) -> None:
    z = scenes.fractal(rng, (30, 40), relief=200.0)
    z[:, 0] = z[:, -1] = z[0] = z[-1] = np.nan
    z[15, 10] = np.nan
    cube = adret.horizon_map(adret.Terrain(z, (10.0, 10.0)), 16, method=method).elevation
    assert np.isnan(cube[:, np.isnan(z)]).all()
    inner = np.zeros(z.shape, dtype=bool)
    inner[3:-3, 3:-3] = True
    inner[13:18, 8:13] = False
    assert np.isfinite(cube[:, inner]).all()
    assert (cube[:, inner] > -np.pi / 2).all()  # no azimuth lost
    whole = np.isfinite(z)
    view = adret.sky_view_factor(adret.Terrain(z, (10.0, 10.0)), directions=16, method=method)
    assert np.isfinite(view[whole]).all()
    assert np.isnan(view[~whole]).all()


@pytest.mark.parametrize("method", RANGED)
@pytest.mark.parametrize("limit", [23.0, 25.0, 26.9])
def test_r10_a_reach_that_is_no_multiple_of_the_cell_shifts_nothing(
    method: str, limit: float, rng: np.random.Generator
) -> None:
    z = scenes.fractal(rng, (40, 40))
    terrain = adret.Terrain(z, (5.0, 5.0))
    whole = adret.horizon_map(terrain, 12, method=method, max_distance=limit).elevation
    part = terrain.window((11, 23), (7, 30), halo=8)
    tile = adret.horizon_map(part, 12, method=method, max_distance=limit).elevation
    np.testing.assert_array_equal(tile[(slice(None), *part.core)], whole[:, 11:23, 7:30])


@pytest.mark.parametrize("method", METHODS)
def test_r11_a_far_wall_sinks_smoothly(method: str) -> None:
    z = np.zeros((3, 2500))
    z[:, -1] = 300.0
    got = adret.horizon_map(
        adret.Terrain(z, (30.0, 30.0)), azimuths=[np.pi / 2], method=method
    ).elevation[0, 1, :-1]
    want = np.arctan(300.0 / (30.0 * np.arange(2499, 0, -1)))
    np.testing.assert_allclose(got, want, rtol=2e-6)


def test_r13_sun_below_the_ground_lights_nothing() -> None:
    terrain = adret.Terrain(np.zeros((5, 5)), (1.0, 1.0))
    for elevation_deg in (-0.5, -30.0):
        sun = adret.Sun(10.0, elevation_deg)
        inner = (slice(1, -1), slice(1, -1))
        np.testing.assert_array_equal(adret.direct_light(terrain, sun).irradiance[inner], 0.0)
        np.testing.assert_array_equal(adret.shadow(terrain, sun).lit[inner], 0.0)


@pytest.mark.parametrize("method", RANGED)
def test_r14_tiles_show_no_seam(method: str, rng: np.random.Generator) -> None:
    terrain = adret.Terrain(scenes.fractal(rng, (40, 60)), (5.0, 5.0))
    whole = adret.sky_view_factor(terrain, directions=12, method=method, max_distance=40.0)
    tiles = []
    for start in (0, 20, 40):
        part = terrain.window((0, 40), (start, start + 20), halo=9)
        tile = adret.sky_view_factor(part, directions=12, method=method, max_distance=40.0)
        tiles.append(tile[part.core])
    np.testing.assert_array_equal(np.concatenate(tiles, axis=1), whole)


def test_r15_the_callers_array_is_left_alone(rng: np.random.Generator) -> None:
    z = scenes.fractal(rng, (20, 20)).astype(np.float32)
    z[3, 4] = np.nan
    before = z.tobytes()
    terrain = adret.Terrain(z, (1.0, 1.0), datum=0.0)
    kept = terrain.heights.tobytes()
    cube = adret.horizon_map(terrain, 8)
    elevation = cube.elevation.tobytes()
    for kind in ("visible", "horizontal", "normal"):
        adret.sky_view_factor(cube, kind=kind)
        adret.sky_view_factor(terrain, kind=kind, directions=8)
    adret.openness(cube)
    adret.openness(terrain, sign=-1, directions=8)
    adret.shadow(terrain, adret.Sun(100.0, 30.0))
    adret.direct_light(terrain, adret.OvercastSky(), 8)
    assert z.tobytes() == before
    assert terrain.heights.tobytes() == kept
    assert cube.elevation.tobytes() == elevation
    z[:] = 99.0  # and the terrain does not follow the caller's later changes
    assert terrain.heights.tobytes() == kept


@pytest.mark.parametrize("method", METHODS)
def test_r16_peaks_and_pillars_have_a_horizon_below_any_limit(method: str) -> None:
    z = np.zeros((41, 41))
    z[20, 20] = 1e6
    pillar = adret.horizon_map(adret.Terrain(z, (1.0, 1.0)), 16, method=method)
    down = pillar.elevation[:, 20, 20]
    assert np.isfinite(down).all()
    assert (np.degrees(down) < -89.99).all()
    assert (down > -np.pi / 2).all()
    cone = scenes.cone(np.radians(85), size=41)
    tip = adret.horizon_map(
        adret.Terrain(cone.heights, cone.cell_size), 8, method=method
    ).elevation[:, cone.where]
    np.testing.assert_allclose(np.degrees(tip), -85.0, atol=1e-3)


@pytest.mark.parametrize("options", [{}, {"radius": 1_737_400.0, "observer_height": 2.0}])
def test_r17_a_point_is_the_raster(rng: np.random.Generator, options: dict[str, float]) -> None:
    z = scenes.fractal(rng, (40, 50), relief=200.0)
    z[rng.random(z.shape) < 0.01] = np.nan
    terrain = adret.Terrain(z, (10.0, 14.0))
    rows, columns = rng.integers(0, 40, 200), rng.integers(0, 50, 200)
    raster = adret.horizon_map(terrain, 20, method="exact", **options)
    points = adret.horizon_at(terrain, rows, columns, directions=20, **options)
    np.testing.assert_array_equal(
        np.asarray(getattr(points, "elevation", points)), raster.elevation[:, rows, columns]
    )
