"""What must not change: raising the datum, turning the map, cutting it, fusing the steps."""

import numpy as np
import pytest
from numpy.typing import NDArray

import adret
import oracles
import scenes
from adret.horizon import HorizonOptions

METHODS = ["exact", "sweep", "march", "hull"]
RANGED = ["exact", "sweep", "march"]  # those that take max_distance
KINDS = ["visible", "horizontal", "normal"]
CELL = (10.0, 14.0)


@pytest.fixture
def heights(rng: np.random.Generator) -> NDArray[np.float64]:
    """Rough terrain with a void and scattered nodata, exact in float32."""
    z = scenes.fractal(rng, (48, 60), relief=250.0)
    z[rng.random(z.shape) < 0.005] = np.nan
    z[20:26, 30:41] = np.nan
    return z


# --- horizons ------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_raising_the_whole_terrain_changes_no_byte(
    method: str, heights: NDArray[np.float64]
) -> None:
    first = adret.horizon_map(adret.Terrain(heights, CELL, datum=100.0), 24, method=method)
    raised = adret.Terrain(heights + 1e7, CELL, datum=1e7 + 100.0)
    np.testing.assert_array_equal(
        adret.horizon_map(raised, 24, method=method).elevation, first.elevation
    )


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("scale", [4.0, 1.0 / 1024.0, 3.7])
def test_scaling_everything_changes_nothing(
    method: str, scale: float, heights: NDArray[np.float64]
) -> None:
    first = adret.horizon_map(adret.Terrain(heights, CELL, datum=0.0), 12, method=method)
    scaled = adret.Terrain(heights * scale, (CELL[0] * scale, CELL[1] * scale), datum=0.0)
    again = adret.horizon_map(scaled, 12, method=method)
    # float32 slopes of heights up to 250 m over 10 m: 4e-6 when the scale is no power of two.
    np.testing.assert_allclose(again.elevation, first.elevation, atol=6e-6, rtol=0)


@pytest.mark.parametrize(
    ("method", "near"),
    [("exact", 0), ("march", 0), ("sweep", 64), ("sweep", 16)],
    ids=["exact", "march", "near field", "sweep"],
)
@pytest.mark.parametrize("turn", ["east-west", "north-south", "quarter", "transpose"])
def test_turning_the_map_turns_the_horizon(
    method: str, near: int, turn: str, heights: NDArray[np.float64]
) -> None:
    options = {"method": method, "near": near}
    azimuths = np.concatenate([np.arange(8) * np.pi / 4, [0.2, 1.3, 2.2, 3.5, 4.1, 5.9]])
    first = adret.horizon_map(
        adret.Terrain(heights, CELL, datum=100.0), azimuths=azimuths, **options
    ).elevation
    if turn == "east-west":
        turned, cell, mapped = heights[:, ::-1], CELL, -azimuths
        first = first[:, :, ::-1]
    elif turn == "north-south":
        turned, cell, mapped = heights[::-1], CELL, np.pi - azimuths
        first = first[:, ::-1]
    elif turn == "quarter":  # counter-clockwise
        turned, cell, mapped = np.rot90(heights), CELL[::-1], azimuths - np.pi / 2
        first = np.rot90(first, axes=(1, 2))
    else:  # mirror on the north-west diagonal: east becomes south
        turned, cell, mapped = heights.T, CELL[::-1], 3 * np.pi / 2 - azimuths
        first = first.transpose(0, 2, 1)
    second = adret.horizon_map(
        adret.Terrain(turned.copy(), cell, datum=100.0), azimuths=mapped, **options
    ).elevation
    if (method, near) == ("sweep", 16):
        # Pools of samples start at the raster's first row, so a turned far field pools otherwise.
        assert np.nanmean(np.abs(second - first)) < 1e-3
    else:
        np.testing.assert_allclose(second, first, atol=1e-5, rtol=0)


@pytest.mark.parametrize("method", ["exact", "sweep", "march"])
def test_parabola_on_the_ground_is_curvature(method: str) -> None:
    """A flat sea over a sphere is a paraboloid over a plane, seen from its vertex."""
    sea = adret.Terrain(np.zeros((41, 41)), (1000.0, 1000.0), datum=0.0)
    east, north = scenes.metres((41, 41), (1000.0, 1000.0))
    drop = (east**2 + north**2) / (2 * 6_371_000.0)
    round_earth = adret.horizon_map(sea, 16, method=method, radius=6_371_000.0, observer_height=2.0)
    paraboloid = adret.horizon_map(
        adret.Terrain(-drop, (1000.0, 1000.0), datum=0.0), 16, method=method, observer_height=2.0
    )
    np.testing.assert_allclose(
        round_earth.elevation[:, 20, 20], paraboloid.elevation[:, 20, 20], atol=6e-6, rtol=0
    )


def test_adding_terrain_never_raises_the_sky_view_elsewhere(
    heights: NDArray[np.float64], rng: np.random.Generator
) -> None:
    more = heights.copy()
    tower = rng.random(heights.shape) < 0.01
    more[tower] += 60.0
    before = adret.horizon_map(adret.Terrain(heights, CELL, datum=0.0), 24, method="exact")
    after = adret.horizon_map(adret.Terrain(more, CELL, datum=0.0), 24, method="exact")
    elsewhere = ~tower & np.isfinite(heights)
    assert (after.elevation[:, elsewhere] >= before.elevation[:, elsewhere]).all()
    for kind in ("visible", "horizontal"):
        lower = adret.sky_view_factor(after, kind=kind)[elsewhere]
        assert (lower <= adret.sky_view_factor(before, kind=kind)[elsewhere] + 1e-6).all()


def test_nodata_only_ever_opens_the_horizon(
    heights: NDArray[np.float64], rng: np.random.Generator
) -> None:
    fewer = heights.copy()
    fewer[rng.random(heights.shape) < 0.05] = np.nan
    for method in ("exact", "march"):
        full = adret.horizon_map(adret.Terrain(heights, CELL, datum=0.0), 24, method=method)
        holed = adret.horizon_map(adret.Terrain(fewer, CELL, datum=0.0), 24, method=method)
        left = np.isfinite(fewer)
        assert (holed.elevation[:, left] <= full.elevation[:, left]).all()
        assert np.isnan(holed.elevation[:, ~left]).all()


# --- sky views -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "clip"), [("visible", True), ("horizontal", True), ("normal", True), ("normal", False)]
)
def test_sky_view_is_the_quadrature_of_its_definition(
    kind: str, clip: bool, heights: NDArray[np.float64], rng: np.random.Generator
) -> None:
    terrain = adret.Terrain(heights, CELL, datum=100.0)
    result = adret.horizon_map(terrain, 24)
    got = adret.sky_view_factor(result, kind=kind, clip=clip)
    assert got.dtype == np.float32
    np.testing.assert_array_equal(np.isnan(got), np.isnan(heights))
    cells = np.argwhere(np.isfinite(heights))
    for row, column in cells[rng.choice(len(cells), 60, replace=False)]:
        n = oracles.normal(heights, CELL, row, column)
        h = result.elevation[:, row, column]
        want = oracles.sky_view(h, result.azimuth, kind, n, clip)
        assert got[row, column] == pytest.approx(want, abs=3e-6)


def test_openness_is_the_mean_zenith_angle(heights: NDArray[np.float64]) -> None:
    terrain = adret.Terrain(heights, CELL, datum=100.0)
    cube = adret.horizon_map(terrain, 24)
    upside_down = adret.horizon_map(adret.Terrain(-heights, CELL, datum=-100.0), 24)
    for sign, source in [(1, cube), (-1, upside_down)]:
        want = np.mean(90.0 - np.degrees(source.elevation.astype(np.float64)), axis=0)
        got = adret.openness(terrain, sign=sign, directions=24)
        np.testing.assert_allclose(got, want, atol=2e-4, rtol=0)
    np.testing.assert_allclose(
        adret.openness(cube), adret.openness(terrain, directions=24), atol=1e-4, rtol=0
    )


def test_sky_views_are_ordered(heights: NDArray[np.float64]) -> None:
    result = adret.horizon_map(adret.Terrain(heights, CELL), 32)
    visible = adret.sky_view_factor(result, kind="visible")
    horizontal = adret.sky_view_factor(result, kind="horizontal")
    here = np.isfinite(heights)
    assert (visible[here] <= horizontal[here] + 1e-6).all()
    assert (horizontal[here] <= 1.0 + 1e-6).all()
    assert (visible[here] >= 0.0).all()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("method", METHODS)
def test_fused_sky_view_is_that_of_the_map(
    kind: str, method: str, heights: NDArray[np.float64]
) -> None:
    terrain = adret.Terrain(heights, CELL, datum=100.0)
    options = {"radius": 50_000.0, "observer_height": 1.5}
    cube = adret.horizon_map(terrain, 24, method=method, **options)
    from_map = adret.sky_view_factor(cube, kind=kind)
    fused = adret.sky_view_factor(terrain, kind=kind, directions=24, method=method, **options)
    np.testing.assert_allclose(fused, from_map, atol=2e-6, rtol=0)


# --- tiles ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", RANGED)
@pytest.mark.parametrize("limit", [60.0, 83.1])
def test_window_with_its_halo_is_the_whole_byte_for_byte(
    method: str, limit: float, heights: NDArray[np.float64]
) -> None:
    terrain = adret.Terrain(heights, CELL, datum=100.0)
    whole = adret.horizon_map(terrain, 20, method=method, max_distance=limit).elevation
    views = {
        kind: adret.sky_view_factor(
            terrain, kind=kind, directions=20, method=method, max_distance=limit
        )
        for kind in KINDS
    }
    for rows, columns in [((0, 17), (0, 23)), ((17, 40), (23, 51)), ((40, 48), (51, 60))]:
        part = terrain.window(rows, columns, halo=12)
        core = (slice(None), *part.core)
        wanted = (slice(None), slice(*rows), slice(*columns))
        tile = adret.horizon_map(part, 20, method=method, max_distance=limit).elevation
        assert tile[core].tobytes() == whole[wanted].tobytes()
        for kind, view in views.items():
            cut = adret.sky_view_factor(
                part, kind=kind, directions=20, method=method, max_distance=limit
            )
            assert cut[part.core].tobytes() == view[wanted[1:]].tobytes()


@pytest.mark.parametrize("near", [0, 4, 16])
def test_far_field_of_a_window_is_the_whole_byte_for_byte(
    near: int, rng: np.random.Generator
) -> None:
    """A range beyond the near field: the hull sweep must not see where the raster was cut."""
    z = scenes.fractal(rng, (130, 150), relief=500.0)
    z[rng.random(z.shape) < 0.002] = np.nan
    terrain = adret.Terrain(z, CELL, datum=250.0)
    options = HorizonOptions(near=near, max_distance=317.0, radius=6_371_000.0)
    keywords = {"near": near, "max_distance": 317.0, "radius": 6_371_000.0}
    halo = options.halo(terrain)
    whole = adret.horizon_map(terrain, 20, distance=True, **keywords)
    view = adret.sky_view_factor(terrain, directions=20, **keywords)
    assert whole.distance is not None
    assert np.nanmax(whole.distance) <= 317.0 + 3.0 * max(CELL)
    for rows, columns in [((0, 40), (0, 50)), ((47, 90), (61, 104)), ((90, 130), (104, 150))]:
        part = terrain.window(rows, columns, halo=halo)
        tile = adret.horizon_map(part, 20, distance=True, **keywords)
        assert tile.distance is not None
        cut = (slice(None), *part.core)
        wanted = (slice(None), slice(*rows), slice(*columns))
        assert tile.elevation[cut].tobytes() == whole.elevation[wanted].tobytes()
        assert tile.distance[cut].tobytes() == whole.distance[wanted].tobytes()
        tile_view = adret.sky_view_factor(part, directions=20, **keywords)
        assert tile_view[part.core].tobytes() == view[wanted[1:]].tobytes()


# --- shadow and light ----------------------------------------------------------------------------


@pytest.mark.parametrize(("azimuth_deg", "elevation_deg"), [(315.0, 35.0), (77.0, 8.0)])
def test_direct_light_is_zero_exactly_in_shadow(
    azimuth_deg: float, elevation_deg: float, heights: NDArray[np.float64]
) -> None:
    terrain = adret.Terrain(heights, CELL, datum=100.0)
    for diameter in (0.0, 0.533):
        sun = adret.Sun(azimuth_deg, elevation_deg, angular_diameter_deg=diameter)
        dark = adret.shadow(terrain, sun).lit == 0.0
        light = adret.direct_light(terrain, sun).irradiance
        here = np.isfinite(heights)
        np.testing.assert_array_equal((light == 0.0)[here], dark[here])
        assert np.isnan(light[~here]).all()


def test_shadow_codes_by_the_oracle(heights: NDArray[np.float64], rng: np.random.Generator) -> None:
    azimuth, elevation = np.radians(290.0), np.radians(22.0)
    terrain = adret.Terrain(heights, CELL, datum=100.0)
    sun = adret.Sun(290.0, 22.0, angular_diameter_deg=0.0)
    result = adret.shadow(terrain, sun, method="exact")
    towards = oracles.sun_vector(azimuth, elevation)
    np.testing.assert_array_equal(result.code == 3, np.isnan(heights))
    assert {0, 1, 2, 3} == set(np.unique(result.code))
    cells = np.argwhere(np.isfinite(heights))
    for row, column in cells[rng.choice(len(cells), 300, replace=False)]:
        n = oracles.normal(heights, CELL, row, column)
        h = oracles.horizon(heights, CELL, row, column, azimuth)[0]
        if abs(np.dot(n, towards)) < 1e-5 or abs(h - elevation) < 1e-5:
            continue
        want = 1 if np.dot(n, towards) <= 0 else 2 if h > elevation else 0
        assert result.code[row, column] == want


def test_soft_sun_by_the_oracle(heights: NDArray[np.float64]) -> None:
    """A wall's penumbra: the share of the disc above the straight edge, of one height each."""
    wall = np.zeros((3, 400))
    wall[:, 0] = 20.0
    terrain = adret.Terrain(wall, (1.0, 1.0), datum=0.0)
    sun = adret.Sun(270.0, 5.0, angular_diameter_deg=0.533)
    result = adret.shadow(terrain, sun, method="exact")
    column = np.arange(1, 399)
    above = np.radians(5.0) - np.arctan(20.0 / column)
    want = [oracles.disc_share(float(a), np.radians(0.533 / 2)) for a in above]
    np.testing.assert_allclose(result.lit[1, 1:399], want, atol=3e-4)


def test_sun_agrees_with_the_beam_on_the_tilted_cell() -> None:
    scene = scenes.plane(np.radians(30), np.radians(200))
    terrain = adret.Terrain(scene.heights, scene.cell_size)
    n = np.array([np.sin(np.radians(30)) * np.sin(np.radians(200)),
                  np.sin(np.radians(30)) * np.cos(np.radians(200)),
                  np.cos(np.radians(30))])  # fmt: skip
    for azimuth_deg, elevation_deg in [(200.0, 20.0), (90.0, 40.0), (20.0, 60.0), (20.0, 10.0)]:
        sun = adret.Sun(azimuth_deg, elevation_deg, irradiance=800.0, angular_diameter_deg=0.0)
        s = oracles.sun_vector(np.radians(azimuth_deg), np.radians(elevation_deg))
        light = adret.direct_light(terrain, sun).irradiance[scene.where]
        np.testing.assert_allclose(light, 800.0 * max(float(n @ s), 0.0), rtol=1e-5, atol=1e-6)


def test_normals_are_central_differences(heights: NDArray[np.float64]) -> None:
    terrain = adret.Terrain(heights, CELL, datum=100.0)
    got = adret.surface_normals(terrain)
    assert got.shape == (3, *heights.shape)
    assert got.dtype == np.float32
    want = np.array([oracles.normal(heights, CELL, r, c) for r, c in np.ndindex(heights.shape)])
    np.testing.assert_allclose(got, want.T.reshape(got.shape), atol=2e-6)
