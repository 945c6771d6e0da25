"""The oracles against closed forms, numbers worked by hand, and a ray tracer nobody here wrote."""

import numpy as np
import pytest

import oracles
import scenes

AZIMUTHS_64 = np.arange(64) * 2.0 * np.pi / 64


def cells_of(scene: scenes.Scene, count: int = 6) -> list[tuple[int, int]]:
    at = np.argwhere(scene.where)
    return [tuple(c) for c in at[np.linspace(0, len(at) - 1, min(count, len(at))).astype(int)]]


# --- horizons worked by hand ---------------------------------------------------------------------


def test_horizon_of_a_profile_worked_by_hand() -> None:
    z = np.array([[0.0, -1.0, 1.0, 3.5, 2.0]])
    h, d = oracles.horizon(z, (2.0, 1.0), 0, 0, np.pi / 2)
    assert h == pytest.approx(np.arctan(3.5 / 6.0), abs=1e-15)
    assert d == 6.0
    h, d = oracles.horizon(z, (2.0, 1.0), 0, 3, 3 * np.pi / 2)
    # Looking down the farthest cell wins: -1.25, -1.125 and -0.583 at 2, 4 and 6 m.
    assert h == pytest.approx(np.arctan(-3.5 / 6.0), abs=1e-15)
    assert d == 6.0
    assert oracles.horizon(z, (2.0, 1.0), 0, 4, np.pi / 2)[0] == -np.pi / 2
    assert oracles.horizon(z, (2.0, 1.0), 0, 2, 0.0)[0] == -np.pi / 2
    assert oracles.horizon(z, (2.0, 1.0), 0, 2, 1.5)[0] == -np.pi / 2  # leaves at once


def test_oblique_ray_crosses_rows_and_columns_between_their_cells() -> None:
    z = np.zeros((3, 4))
    z[1, 1], z[1, 2], z[0, 2], z[0, 3] = 1.0, 4.0, 10.0, 2.0
    # From (2, 0) with two columns to a row: column 1 at row 1.5, (1, 2) itself, column 3 at 0.5.
    d, h = oracles.ray_crossings(z, (1.0, 1.0), 2, 0, np.arctan2(2.0, 1.0))
    np.testing.assert_allclose(d, np.sqrt(1.25) * np.array([1.0, 2.0, 2.0, 3.0]), atol=1e-12)
    np.testing.assert_allclose(h, [0.5, 4.0, 4.0, 1.0], atol=1e-12)


def test_rectangular_cells_turn_the_ray() -> None:
    z = np.zeros((5, 5))
    z[0, 1] = 7.0  # one column east, three rows north: 10 m and 60 m
    h, d = oracles.horizon(z, (10.0, 20.0), 3, 0, np.arctan2(10.0, 60.0))
    assert d == pytest.approx(np.hypot(10.0, 60.0))
    assert h == pytest.approx(np.arctan(7.0 / np.hypot(10.0, 60.0)))


def test_diagonal_touches_vertices_only_so_nodata_beside_it_is_harmless() -> None:
    z = np.full((3, 3), np.nan)
    z[2, 0], z[1, 1], z[0, 2] = 0.0, 1.0, 5.0
    h, d = oracles.horizon(z, (1.0, 1.0), 2, 0, np.pi / 4)
    assert h == pytest.approx(np.arctan(5.0 / np.sqrt(8.0)))
    assert d == pytest.approx(np.sqrt(8.0))
    h, _ = oracles.horizon(z, (1.0, 1.0), 2, 0, np.pi / 4 + 1e-3)
    assert h == -np.pi / 2  # every crossing now touches nodata
    assert np.isnan(oracles.horizon(z, (1.0, 1.0), 0, 0, 1.0)[0])


def test_max_distance_includes_its_own_end() -> None:
    z = np.array([[0.0, 1.0, 10.0, 100.0]])
    assert oracles.horizon(z, (1.0, 1.0), 0, 0, np.pi / 2, max_distance=2.0)[1] == 2.0
    assert oracles.horizon(z, (1.0, 1.0), 0, 0, np.pi / 2, max_distance=1.99)[1] == 1.0
    assert oracles.horizon(z, (1.0, 1.0), 0, 0, np.pi / 2, max_distance=0.5)[0] == -np.pi / 2


# --- closed forms --------------------------------------------------------------------------------


# Planes and walls are met exactly; the chords across a cone or a rim stand off by what is given.
@pytest.mark.parametrize(
    ("scene", "bound"),
    [
        (scenes.flat(), 1e-15),
        (scenes.plane(np.radians(45), np.radians(180)), 1e-12),
        (scenes.plane(np.radians(30), np.radians(70), cell_size=(20.0, 35.0)), 1e-12),
        (scenes.canyon(0.0, np.radians(50)), 1e-12),
        (scenes.canyon(np.radians(20), np.radians(60)), 1e-12),
        (scenes.funnel(np.radians(25), size=97), 1.5e-4),
        (scenes.cone(np.radians(40), size=97), 3e-5),
        (scenes.bowl(np.radians(70), size=129), 0.03),
    ],
    ids=["flat", "plane45", "plane30-rectangular", "wall", "canyon", "funnel", "cone", "bowl"],
)
def test_horizon_oracle_meets_the_closed_horizon(scene: scenes.Scene, bound: float) -> None:
    assert scene.horizon is not None
    for row, column in cells_of(scene):
        for azimuth in AZIMUTHS_64[1::3]:
            want = np.asarray(scene.horizon(float(azimuth)))
            exact = float(want[row, column]) if want.ndim else float(want)
            got = oracles.horizon(scene.heights, scene.cell_size, row, column, azimuth)[0]
            assert got == pytest.approx(exact, abs=bound)


@pytest.mark.parametrize("slope_deg", [10.0, 45.0, 70.0])
def test_sky_views_of_a_plane(slope_deg: float) -> None:
    scene = scenes.plane(np.radians(slope_deg), 0.0)
    fine = np.arange(720) * 2.0 * np.pi / 720
    assert scene.horizon is not None
    h = np.array([scene.horizon(float(a)) for a in fine])
    n = oracles.normal(scene.heights, scene.cell_size, 5, 5)
    assert n == pytest.approx((0, np.sin(np.radians(slope_deg)), np.cos(np.radians(slope_deg))))
    # The azimuth count alone leaves an error of order K**-2 at the kink of max(h, 0).
    assert oracles.sky_view(h, fine, "visible") == pytest.approx(scene.values["visible"], abs=2e-5)
    for kind in ("horizontal", "normal"):
        assert oracles.sky_view(h, fine, kind, n) == pytest.approx(scene.values[kind], abs=2e-5)
    assert oracles.sky_view(h, fine, "normal", n, clip=False) == pytest.approx(1.0, abs=1e-12)
    assert oracles.openness(h) == pytest.approx(90.0, abs=1e-9)


def test_azimuth_count_alone_costs_what_the_definitions_say() -> None:
    for count, error in [(8, 0.0173), (16, 0.0041), (32, 0.0010), (64, 0.00026)]:
        azimuths = np.arange(count) * 2.0 * np.pi / count
        h = np.arctan(np.cos(azimuths))
        view = oracles.sky_view(h, azimuths, "visible")
        assert view - 0.75 == pytest.approx(error, rel=0.05)


@pytest.mark.parametrize("half_angle_deg", [40.0, 70.0])
def test_bowl_view_is_the_same_at_every_interior_point(half_angle_deg: float) -> None:
    scene = scenes.bowl(np.radians(half_angle_deg), size=129)
    assert scene.horizon is not None
    fine = np.arange(360) * 2.0 * np.pi / 360
    cube = np.array([scene.horizon(float(a)) for a in fine])
    middle = scene.heights.shape[0] // 2
    radius = 0.8 * 129 / 2 / np.sin(np.radians(half_angle_deg))
    for row, column in [(middle, middle), (middle + 20, middle - 15), (middle, middle + 40)]:
        h = cube[:, row, column]
        east, north = column - middle, middle - row
        n = np.array([-east, -north, -scene.heights[row, column]]) / radius
        assert oracles.sky_view(h, fine, "horizontal") == pytest.approx(scene.values["horizontal"])
        assert oracles.sky_view(h, fine, "normal", n) == pytest.approx(scene.values["normal"])
    bottom = cube[:, middle, middle]
    np.testing.assert_allclose(bottom, np.radians(half_angle_deg) / 2, atol=1e-12)


def test_hemisphere_has_openness_45_everywhere() -> None:
    scene = scenes.bowl(np.radians(90), size=129)
    assert scene.horizon is not None
    fine = np.arange(360) * 2.0 * np.pi / 360
    cube = np.degrees(np.array([scene.horizon(float(a)) for a in fine]))
    np.testing.assert_allclose((90.0 - cube.mean(axis=0))[scene.where], 45.0, atol=1e-3)


def test_bowl_mask_agrees_with_the_closed_horizon() -> None:
    half_angle = np.radians(70)
    scene = scenes.bowl(half_angle, size=129)
    assert scene.horizon is not None
    for azimuth, elevation in [(0.3, 0.4), (2.5, 0.7), (5.0, 0.15)]:
        lit = scenes.bowl_lit(half_angle, oracles.sun_vector(azimuth, elevation), size=129)
        expected = np.asarray(scene.horizon(azimuth)) <= elevation
        np.testing.assert_array_equal(lit[scene.where], expected[scene.where])


def test_valley_walls_tend_to_cos_squared() -> None:
    slope = np.radians(35)
    scene = scenes.valley(slope, shape=(3, 4001))
    view = np.asarray(scene.values["normal"])[1]
    middle = 2000
    assert view[middle] == pytest.approx(np.cos(slope))
    assert view[middle + 5] == pytest.approx(np.cos(slope) ** 2, abs=3e-3)


def test_valley_views_by_the_oracle() -> None:
    scene = scenes.valley(np.radians(35))
    row = scene.heights.shape[0] // 2
    fine = (np.arange(128) + 0.5) * 2.0 * np.pi / 128
    for column in (20, 40, 55):
        h = oracles.horizons(scene.heights, scene.cell_size, [(row, column)], fine)[:, 0]
        n = oracles.normal(scene.heights, scene.cell_size, row, column)
        for kind in ("visible", "horizontal", "normal"):
            exact = np.asarray(scene.values[kind])[row, column]
            assert oracles.sky_view(h, fine, kind, n) == pytest.approx(exact, abs=4e-4)


def test_ring_wall_and_curvature_numbers() -> None:
    scene = scenes.ring(20)
    middle = scene.heights.shape[0] // 2
    for name, options in [
        ("flat", {}),
        ("sphere", {"radius": oracles.EARTH_RADIUS}),
        ("refracted", {"radius": oracles.EARTH_RADIUS, "refraction": 1 / 7}),
    ]:
        for azimuth in (0.0, np.pi / 2, np.pi, 3 * np.pi / 2):
            h, d = oracles.horizon(
                scene.heights, scene.cell_size, middle, middle, azimuth, **options
            )
            assert h == pytest.approx(scenes.RING_HORIZON[name], abs=6e-7)
            assert d == pytest.approx(scenes.RING_DISTANCE)
    for distance, degrees in scenes.CURVATURE_DEG.items():
        target = scenes.target(distance)
        flat, sphere, refracted = (
            np.degrees(
                oracles.horizon(
                    target.heights, target.cell_size, 0, 0, np.pi / 2, radius=r, refraction=k
                )[0]
            )
            for r, k in [(None, 0.0), (oracles.EARTH_RADIUS, 0.0), (oracles.EARTH_RADIUS, 0.13)]
        )
        assert (flat, sphere, refracted) == pytest.approx(degrees, abs=6e-5)


def test_sea_horizon_dips() -> None:
    sea = scenes.sea()
    h, d = oracles.horizon(
        sea.heights, sea.cell_size, 0, 0, np.pi / 2,
        radius=oracles.EARTH_RADIUS, observer_height=100.0,
    )  # fmt: skip
    assert h == pytest.approx(-scenes.SEA_DIP, abs=1e-7)
    assert d == pytest.approx(np.sqrt(2 * 100.0 * oracles.EARTH_RADIUS), abs=100.0)


def test_pit_horizon_is_bracketed() -> None:
    scene = scenes.pit(25.0)
    middle = scene.heights.shape[0] // 2
    h = oracles.horizons(scene.heights, (1.0, 1.0), [(middle, middle)], AZIMUTHS_64)
    assert h.max() <= np.arctan(25 / 40) + 1e-12
    assert h.min() >= np.arctan(25 / 42)


# --- light ---------------------------------------------------------------------------------------


def test_overcast_closed_forms() -> None:
    azimuths = np.arange(720) * 2.0 * np.pi / 720
    open_sky = oracles.overcast_irradiance(np.zeros(720), azimuths)
    assert open_sky == pytest.approx(scenes.OVERCAST_FLAT, rel=1e-12)
    for h in (0.2, 0.9):
        e = oracles.overcast_irradiance(np.full(720, h), azimuths)
        assert e / open_sky == pytest.approx(scenes.overcast_ratio(h), rel=1e-9)
    n = np.array([0.0, np.sin(np.radians(30)), np.cos(np.radians(30))])
    plane = oracles.overcast_irradiance(oracles.own_plane_horizon(n, azimuths), azimuths, n)
    assert plane / open_sky == pytest.approx(scenes.OVERCAST_PLANE_30, abs=2e-6)


def test_disc_share_is_the_circular_segment() -> None:
    for u in (-1.2, -0.7, 0.0, 0.3, 1.0, 2.0):
        inside = min(max(u, -1.0), 1.0)
        exact = (np.arccos(-inside) + inside * np.sqrt(1 - inside**2)) / np.pi
        assert oracles.disc_share(u * 0.004, 0.004) == pytest.approx(exact, abs=1e-4)


def test_uniform_environment_gives_pi_times_the_sky_view() -> None:
    theta = (np.arange(180) + 0.5) / 180 * np.pi
    azimuth, polar = np.meshgrid((np.arange(360) + 0.5) * 2 * np.pi / 360, theta)
    weight = np.sin(polar) * (np.pi / 180) * (2 * np.pi / 360)
    got = oracles.environment_irradiance(
        np.ones((*azimuth.shape, 3)), azimuth, np.pi / 2 - polar, weight,
        lambda a: np.full(a.shape, np.radians(30.0)), (0.0, 0.0, 1.0),
    )  # fmt: skip
    np.testing.assert_allclose(got, np.pi * np.cos(np.radians(30)) ** 2, rtol=1e-4)


def test_daily_extraterrestrial_energy() -> None:
    day = scenes.daily_extraterrestrial(np.radians(46.5), np.radians(23.44), 1361.0)
    assert day / 1e6 == pytest.approx(43.117, abs=6e-4)
    assert scenes.daily_extraterrestrial(np.radians(80), np.radians(-23.44), 1361.0) == 0.0


# --- normals -------------------------------------------------------------------------------------


def test_normal_is_the_sum_of_the_four_quad_normals(rng: np.random.Generator) -> None:
    z = scenes.fractal(rng, (5, 5))
    dx, dy = 3.0, 5.0
    here = z[2, 2]
    east = np.array([dx, 0.0, z[2, 3] - here])
    north = np.array([0.0, dy, z[1, 2] - here])
    west = np.array([-dx, 0.0, z[2, 1] - here])
    south = np.array([0.0, -dy, z[3, 2] - here])
    total = sum(
        np.cross(a, b) for a, b in [(east, north), (north, west), (west, south), (south, east)]
    )
    np.testing.assert_allclose(
        oracles.normal(z, (dx, dy), 2, 2), total / np.linalg.norm(total), atol=1e-12
    )


# --- the ray tracer ------------------------------------------------------------------------------


@pytest.mark.parametrize("surface", ["rough", "planar quads"])
def test_embree_sees_the_same_horizon(rng: np.random.Generator, surface: str) -> None:
    pytest.importorskip("trimesh", reason="the ray tracer's mesh library is not installed")
    pytest.importorskip("embreex", reason="the ray tracer is not installed")
    cell_size = (2.0, 3.0)
    count = 2000
    z = scenes.fractal(rng, (48, 56), relief=40.0)
    if surface == "planar quads":  # z = f(column) + g(row): no quad rises between its edges
        z = z[20, :][None, :] + z[:, 30][:, None]
    cells = np.stack([rng.integers(2, 46, count), rng.integers(2, 54, count)], axis=-1)
    # Off the axes, where a ray leaves its own cell's fences behind.
    azimuths = rng.uniform(0.03, np.pi / 2 - 0.03, count) + rng.integers(0, 4, count) * np.pi / 2
    h = np.array(
        [
            oracles.horizon(z, cell_size, int(r), int(c), float(a))[0]
            for (r, c), a in zip(cells, azimuths, strict=True)
        ]
    )
    margin = 2e-4  # Embree works in float32
    rays = (z, cell_size, cells, azimuths)
    fences = oracles.fence_mesh(z, cell_size)
    triangles = oracles.surface_mesh(z, cell_size)
    for mesh in (fences, triangles):
        assert oracles.rays_hit(mesh, *rays, h - margin).all()
    assert not oracles.rays_hit(fences, *rays, h + margin).any()
    if surface == "planar quads":
        assert not oracles.rays_hit(triangles, *rays, h + margin, start=0.5).any()
