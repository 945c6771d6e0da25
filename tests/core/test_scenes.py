"""The library on surfaces whose light is known in closed form (T1 to T10 and the bowl's shadow)."""

import numpy as np
import pytest

import adret
import oracles
import scenes

KINDS = ["visible", "horizontal", "normal"]
METHODS = ["exact", "sweep"]


def terrain_of(scene: scenes.Scene) -> adret.Terrain:
    return adret.Terrain(scene.heights, scene.cell_size)


def off(scene: scenes.Scene, layer: np.ndarray, name: str) -> float:
    """Largest distance of a layer from the scene's value, where it holds."""
    want = np.broadcast_to(np.asarray(scene.values[name]), layer.shape)
    return float(np.abs(layer.astype(np.float64) - want)[scene.where].max())


# --- T1, T2: flat ground and planes --------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_flat_ground_sees_all_of_the_sky(method: str) -> None:
    scene = scenes.flat()
    for kind in KINDS:
        layer = adret.sky_view_factor(terrain_of(scene), kind=kind, directions=16, method=method)
        assert off(scene, layer, kind) < 1e-6
    for sign, name in [(1, "openness+"), (-1, "openness-")]:
        layer = adret.openness(terrain_of(scene), sign=sign, directions=16, method=method)
        assert off(scene, layer, name) < 1e-5


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("cell_size", [(1.0, 1.0), (20.0, 35.0)], ids=["square", "rectangular"])
@pytest.mark.parametrize(("slope_deg", "aspect_deg"), [(10, 0), (45, 180), (45, 223), (70, 70)])
def test_plane_sees_its_share_of_the_sky(
    method: str, cell_size: tuple[float, float], slope_deg: float, aspect_deg: float
) -> None:
    scene = scenes.plane(np.radians(slope_deg), np.radians(aspect_deg), cell_size=cell_size)
    # 64 azimuths alone leave 3e-4 of VSF; the sweep's far field mixes two lines' vertices.
    bounds = {"visible": 4e-4, "horizontal": 3e-5, "normal": 3e-5, "openness": 1e-3}
    if method == "sweep":
        bounds = {"visible": 5e-4, "horizontal": 5e-4, "normal": 5e-4, "openness": 0.06}
    for kind in KINDS:
        layer = adret.sky_view_factor(terrain_of(scene), kind=kind, directions=64, method=method)
        assert off(scene, layer, kind) < bounds[kind]
    unclipped = adret.sky_view_factor(
        terrain_of(scene), kind="normal", directions=64, method=method, clip=False
    )
    np.testing.assert_allclose(unclipped[scene.where], 1.0, atol=bounds["normal"])
    for sign, name in [(1, "openness+"), (-1, "openness-")]:
        layer = adret.openness(terrain_of(scene), sign=sign, directions=64, method=method)
        assert off(scene, layer, name) < bounds["openness"]


def test_visible_sky_of_the_45_degree_plane_at_64_azimuths() -> None:
    scene = scenes.plane(np.radians(45), 0.0)
    layer = adret.sky_view_factor(terrain_of(scene), kind="visible", directions=64)
    assert off(scene, layer, "visible") < 5e-4
    # With every crossing, what is left is the azimuth count's own error, +0.00026, to float32.
    layer = adret.sky_view_factor(terrain_of(scene), kind="visible", directions=64, method="exact")
    np.testing.assert_allclose(layer[scene.where] - 0.75, 0.00026, atol=6e-6)


def test_diagonal_of_the_45_degree_plane() -> None:
    scene = scenes.plane(np.radians(45), np.pi)
    result = adret.horizon_map(terrain_of(scene), azimuths=[np.pi / 4])
    np.testing.assert_allclose(np.degrees(result.elevation[0][scene.where]), 35.2644, atol=1e-4)


# --- T3: walls, canyons, valleys -----------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("west_deg", "east_deg"), [(0, 50), (20, 60), (45, 45)])
def test_canyon_floor(method: str, west_deg: float, east_deg: float) -> None:
    scene = scenes.canyon(np.radians(west_deg), np.radians(east_deg))
    for kind in KINDS:
        layer = adret.sky_view_factor(terrain_of(scene), kind=kind, directions=128, method=method)
        assert off(scene, layer, kind) < 2e-4


@pytest.mark.parametrize("method", METHODS)
def test_valley_walls(method: str) -> None:
    scene = scenes.valley(np.radians(35))
    for kind in KINDS:
        layer = adret.sky_view_factor(terrain_of(scene), kind=kind, directions=128, method=method)
        assert off(scene, layer, kind) < 1.5e-3


# --- T4: the spherical bowl ----------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_bowl_has_one_sky_view_everywhere(method: str) -> None:
    scene = scenes.bowl(np.radians(60), size=257)
    for kind in ("horizontal", "normal"):
        layer = adret.sky_view_factor(terrain_of(scene), kind=kind, directions=32, method=method)
        assert off(scene, layer, kind) < 0.006


@pytest.mark.slow
@pytest.mark.parametrize("half_angle_deg", [40.0, 60.0, 70.0])
def test_large_bowl_has_one_sky_view_everywhere(half_angle_deg: float) -> None:
    scene = scenes.bowl(np.radians(half_angle_deg), size=1025)
    layer = adret.sky_view_factor(terrain_of(scene), kind="normal", directions=64)
    assert off(scene, layer, "normal") < 0.002


def test_bowl_bottom() -> None:
    scene = scenes.bowl(np.radians(60), size=257)
    middle = 257 // 2
    result = adret.horizon_map(terrain_of(scene), directions=64)
    bottom = result.elevation[:, middle, middle]
    # The rim is some 110 cells away: half a cell there is 0.0024, a whole one 0.0047.
    np.testing.assert_allclose(bottom, np.radians(30), atol=0.006)
    view = adret.sky_view_factor(result, kind="visible")[middle, middle]
    assert view == pytest.approx(1.0 - np.sin(np.radians(30)), abs=0.004)


def test_hemisphere_has_openness_45() -> None:
    """The raster's rim stands up to 1.5 cells behind the true one; each lowers h by sin 2h/2d."""
    scene = scenes.bowl(np.radians(90), size=257)
    layer = adret.openness(terrain_of(scene), directions=32)
    rim = 0.8 * 257 / 2
    away = np.hypot(*scenes.metres((257, 257), (1.0, 1.0)))
    inner = away < 0.7 * rim
    excess = (layer - 45.0)[inner]
    assert excess.min() > -0.05
    assert (excess < np.degrees(0.75 / (rim - away[inner]))).all()


@pytest.mark.parametrize(
    ("azimuth_deg", "elevation_deg"), [(20.0, 25.0), (135.0, 40.0), (287.0, 12.0), (0.0, 60.0)]
)
def test_bowl_shadow(azimuth_deg: float, elevation_deg: float) -> None:
    half_angle = np.radians(70)
    scene = scenes.bowl(half_angle, size=257)
    assert scene.horizon is not None
    sun = oracles.sun_vector(np.radians(azimuth_deg), np.radians(elevation_deg))
    want = scenes.bowl_lit(half_angle, sun, size=257)
    point = adret.Sun(azimuth_deg, elevation_deg, angular_diameter_deg=0.0)
    result = adret.shadow(terrain_of(scene), point)
    lit = result.code == 0
    # A ray meets the raster's rim at full height up to 2.4 cells behind the true one, measured
    # across it, and so up to 5.5 cells along a ray that meets it at a slant.
    h = np.asarray(scene.horizon(np.radians(azimuth_deg)))
    depth = scene.heights.max() - scene.heights
    with np.errstate(divide="ignore", invalid="ignore"):
        lowest = np.arctan(depth / (depth / np.tan(h) + 5.5))
    elevation = np.radians(elevation_deg)
    sure = scene.where & ((elevation > h + 1e-4) | (elevation < lowest - 1e-4))
    assert sure.sum() > 0.85 * scene.where.sum()
    np.testing.assert_array_equal(lit[sure], want[sure])
    # A facet that faces away is told apart from one that is hidden.
    away = (result.code == 1) & scene.where
    east, north = scenes.metres((257, 257), (1.0, 1.0))
    towards = -(east * sun[0] + north * sun[1] + scene.heights * sun[2])
    assert (towards[away] < 1.5).all()
    assert (result.code[scene.where & (towards < -1.5)] == 1).all()
    np.testing.assert_array_equal(result.lit[sure & lit], 1.0)
    np.testing.assert_array_equal(result.lit[sure & ~lit], 0.0)


# --- T5, T6: funnels, cones, pits ----------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("angle_deg", [8.0, 25.0, 60.0])
def test_funnel_and_cone(method: str, angle_deg: float) -> None:
    funnel = scenes.funnel(np.radians(angle_deg), size=97)
    cube = adret.horizon_map(terrain_of(funnel), 32, method=method)
    for kind in KINDS:
        assert off(funnel, adret.sky_view_factor(cube, kind=kind), kind) < 3e-4
    assert off(funnel, adret.openness(cube), "openness+") < 0.02
    cone = scenes.cone(np.radians(angle_deg), size=97)
    cube = adret.horizon_map(terrain_of(cone), 32, method=method)
    for kind in KINDS:
        assert off(cone, adret.sky_view_factor(cube, kind=kind), kind) < 1e-6
    assert off(cone, adret.openness(cube), "openness+") < 0.02
    upside_down = adret.Terrain(-funnel.heights, funnel.cell_size)
    negative = adret.openness(upside_down, sign=-1, directions=32, method=method)
    assert off(funnel, negative, "openness+") < 0.02


@pytest.mark.parametrize("method", METHODS)
def test_pit_horizon_is_bracketed(method: str) -> None:
    scene = scenes.pit(25.0)
    result = adret.horizon_map(terrain_of(scene), directions=48, method=method)
    h = result.elevation[:, scene.where]
    assert h.max() <= np.arctan(25 / 40) + 1e-6
    assert h.min() >= np.arctan(25 / 42) - 1e-6
    for kind in KINDS:
        assert off(scene, adret.sky_view_factor(result, kind=kind), kind) < 0.02


# --- T9: overcast --------------------------------------------------------------------------------


def test_overcast_sky_over_plane_and_funnel() -> None:
    sky = adret.OvercastSky(zenith_radiance=1.0)
    flat = scenes.flat()
    open_sky = adret.direct_light(terrain_of(flat), sky, directions=64).irradiance
    np.testing.assert_allclose(open_sky[flat.where], scenes.OVERCAST_FLAT, rtol=2e-6)
    plane = scenes.plane(np.radians(30), np.radians(200))
    light = adret.direct_light(terrain_of(plane), sky, directions=64).irradiance
    np.testing.assert_allclose(
        light[plane.where] / scenes.OVERCAST_FLAT, scenes.OVERCAST_PLANE_30, atol=2e-5
    )
    for angle_deg in (15.0, 50.0):
        funnel = scenes.funnel(np.radians(angle_deg))
        light = adret.direct_light(terrain_of(funnel), sky, directions=64).irradiance
        want = scenes.overcast_ratio(np.radians(angle_deg))
        np.testing.assert_allclose(light[funnel.where] / scenes.OVERCAST_FLAT, want, atol=3e-4)


def test_uniform_sky_is_pi_times_the_view_of_the_normal() -> None:
    for scene in (
        scenes.plane(np.radians(50), np.radians(310), cell_size=(3.0, 2.0)),
        scenes.canyon(np.radians(20), np.radians(60)),
    ):
        light = adret.direct_light(
            terrain_of(scene), adret.UniformSky(radiance=2.0), directions=128
        ).irradiance
        want = 2.0 * np.pi * np.asarray(scene.values["normal"])
        np.testing.assert_allclose(light[scene.where], want, rtol=5e-4)


# --- T10: a day of sun ---------------------------------------------------------------------------


def test_day_of_sun_on_flat_ground() -> None:
    latitude, declination = np.radians(46.5), np.radians(23.44)
    terrain = adret.Terrain(np.zeros((3, 3)), (10.0, 10.0))
    steps = 96
    total = 0.0
    for hour_angle in (np.arange(steps) + 0.5) * 2.0 * np.pi / steps - np.pi:
        up = np.sin(latitude) * np.sin(declination) + (
            np.cos(latitude) * np.cos(declination) * np.cos(hour_angle)
        )
        if up <= 0.0:
            continue
        east = -np.cos(declination) * np.sin(hour_angle)
        north = np.cos(latitude) * np.sin(declination) - (
            np.sin(latitude) * np.cos(declination) * np.cos(hour_angle)
        )
        sun = adret.Sun(
            np.degrees(np.arctan2(east, north)) % 360.0,
            np.degrees(np.arcsin(up)),
            irradiance=1361.0,
            angular_diameter_deg=0.0,
        )
        total += float(adret.direct_light(terrain, sun).irradiance[1, 1]) * 86_400.0 / steps
    want = scenes.daily_extraterrestrial(latitude, declination, 1361.0)
    assert total == pytest.approx(want, rel=5e-4)
