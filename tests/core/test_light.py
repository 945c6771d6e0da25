"""Direct light: closed forms, direct summation, the paper's claims, what is skipped."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import adret
import oracles
import scenes

CELL = (2.0, 3.0)


@pytest.fixture(scope="module")
def rough() -> adret.Terrain:
    rng = np.random.default_rng(11)
    z = scenes.fractal(rng, (36, 31), relief=50.0)
    z[rng.random(z.shape) < 0.05] = np.nan
    return adret.Terrain(z, CELL)


def terrain_of(scene: scenes.Scene) -> adret.Terrain:
    return adret.Terrain(scene.heights, scene.cell_size)


# --- closed forms ---------------------------------------------------------------------------------


def test_open_flat_ground() -> None:
    flat = adret.Terrain(np.zeros((3, 4)), (1.0, 1.0))
    for sky, want in (
        (adret.UniformSky(3.0), 3.0 * np.pi),
        (adret.OvercastSky(3.0), 7.0 * np.pi / 3.0),
        (adret.Sun(200.0, 30.0, irradiance=1361.0), 680.5),
        (adret.Environment(np.full((32, 64), 3.0)), 3.0 * np.pi),
    ):
        light = adret.direct_light(flat, sky)
        np.testing.assert_allclose(light.irradiance, want, rtol=1.5e-5)
        assert light.irradiance.dtype == np.float32
        assert light.irradiance.shape == (3, 4)


@pytest.mark.parametrize("slope_deg", [10.0, 30.0, 50.0, 70.0])
def test_planes_under_smooth_skies(slope_deg: float) -> None:
    slope, aspect = np.radians(slope_deg), np.radians(200.0)
    scene = scenes.plane(slope, aspect)
    uniform = adret.direct_light(terrain_of(scene), adret.UniformSky()).irradiance[scene.where]
    np.testing.assert_allclose(uniform, np.pi * (1.0 + np.cos(slope)) / 2.0, rtol=5e-5)
    azimuths = adret.azimuth_set(720)
    n = [np.sin(slope) * np.sin(aspect), np.sin(slope) * np.cos(aspect), np.cos(slope)]
    want = oracles.overcast_irradiance(np.full(720, -np.pi / 2), azimuths, n)
    overcast = adret.direct_light(terrain_of(scene), adret.OvercastSky()).irradiance[scene.where]
    np.testing.assert_allclose(overcast, want, rtol=5e-5)
    if slope_deg == 30.0:
        ratio = overcast / scenes.OVERCAST_FLAT
        np.testing.assert_allclose(ratio, scenes.OVERCAST_PLANE_30, rtol=1e-5)


def test_midpoint_rule_beats_the_swath_factor_of_equation_5() -> None:
    """The numbers in the docstring of `UniformSky`."""
    worst = {False: 0.0, True: 0.0}
    for slope_deg in range(10, 81, 10):
        slope = np.radians(slope_deg)
        for aspect in np.linspace(0.0, np.pi / 32, 5):
            a = adret.azimuth_set(32)
            tp = np.tan(slope) * np.cos(a - aspect)
            e = np.arctan(np.maximum(tp, 0.0))
            horizontal = -tp * (np.pi / 2 - e - np.sin(2 * e) / 2)
            for factor in worst:
                f = np.sin(np.pi / 32) / (np.pi / 32) if factor else 1.0
                got = np.cos(slope) * np.mean(np.cos(e) ** 2 + f * horizontal)
                off = abs(got / ((1.0 + np.cos(slope)) / 2.0) - 1.0)
                worst[factor] = max(worst[factor], off)
    assert worst[False] < 4.1e-5
    assert worst[True] > 1.3e-3


def test_uniform_light_is_pi_times_the_view_of_the_normal(rough: adret.Terrain) -> None:
    light = adret.direct_light(rough, adret.UniformSky(), 16).irradiance
    view = adret.sky_view_factor(rough, "normal", 16)
    np.testing.assert_allclose(light, np.pi * view, atol=3e-6)
    np.testing.assert_array_equal(np.isnan(light), rough.mask)


def test_even_environment_is_the_unclipped_view(rough: adret.Terrain) -> None:
    """Light from below the horizontal counts: an even sphere gives pi times V_d without clip."""
    light = adret.direct_light(rough, adret.Environment(np.ones((64, 128))), 16).irradiance
    view = adret.sky_view_factor(rough, "normal", 16, clip=False)
    np.testing.assert_allclose(light, np.pi * view, rtol=3e-5, atol=3e-5)


# --- against direct summation ---------------------------------------------------------------------


@pytest.mark.parametrize(("name", "mean", "most"), [
    ("royal_esplanade_1k.hdr", 2e-4, 1e-3),
    ("immenstadter_horn_1k.hdr", 2e-3, 1e-2),
])  # fmt: skip
def test_moments_are_the_sum_over_all_pixels(
    name: str, mean: float, most: float, data_dir: Path, example_dem: Path
) -> None:
    terrain = adret.Terrain.open(example_dem, window=((100, 200), (100, 200)))
    sky = adret.Environment.open(data_dir / "hdr" / name)
    picture = sky.radiance.astype(np.float64)
    rows, columns, _ = picture.shape
    rng = np.random.default_rng(3)
    r, c = rng.integers(2, 98, 25), rng.integers(2, 98, 25)
    horizons = adret.horizon_at(terrain, r, c, 1024).astype(np.float64)
    border = np.pi / 2 - np.arange(rows + 1) * np.pi / rows
    elevation = (border[:-1] + border[1:]) / 2.0
    azimuth = np.mod(2.0 * np.pi * (np.arange(columns) + 0.5) / columns - np.pi / 2.0, 2.0 * np.pi)
    nearest = np.round(azimuth / (2.0 * np.pi / 1024)).astype(int) % 1024
    solid = (np.sin(border[:-1]) - np.sin(border[1:])) * 2.0 * np.pi / columns
    n = adret.surface_normals(terrain).astype(np.float64)
    got = adret.direct_light(terrain, sky, 64, method="exact").irradiance[r, c]
    want = np.empty_like(got, dtype=np.float64)
    for i in range(len(r)):
        facing = oracles.cosine(n[:, r[i], c[i]], azimuth[None, :], elevation[:, None])
        above = np.clip((border[:-1, None] - horizons[nearest, i]) / (np.pi / rows), 0.0, 1.0)
        want[i] = np.einsum("hw,hwb->b", np.maximum(facing, 0.0) * above * solid[:, None], picture)
    assert abs(got - want).mean() / want.mean() < mean
    assert abs(got / want - 1.0).max() < most


def test_claims_for_normal_angles(data_dir: Path, example_dem: Path) -> None:
    """P1, figure 7: 8 normal angles 0.16 % mean error against 256, 16 angles 0.03 %."""
    terrain = adret.Terrain.open(example_dem, window=((60, 260), (60, 260)))
    path = data_dir / "hdr" / "royal_esplanade_1k.hdr"

    def light(angles: int | None) -> NDArray[np.float32]:
        sky = adret.Environment.open(path, normal_angles=angles)
        return adret.direct_light(terrain, sky, 16, near=4).irradiance

    reference = light(256)
    off = {n: abs(light(n) - reference).mean() / reference.mean() for n in (7, 8, 15, 16, None)}
    assert off[7] <= 0.002
    assert off[8] <= 0.002
    assert off[15] <= 0.0005
    assert off[16] <= 0.0005
    assert off[None] <= 1e-5  # the moments need no normal angles at all


def test_upright_normals_are_exact_with_an_odd_number_of_angles(rng: np.random.Generator) -> None:
    flat = adret.Terrain(np.zeros((2, 2)), (1.0, 1.0))
    picture = rng.random((32, 64, 3))
    exact = adret.direct_light(flat, adret.Environment(picture), 8).irradiance
    table = adret.direct_light(flat, adret.Environment(picture, normal_angles=7), 8).irradiance
    np.testing.assert_allclose(table, exact, rtol=2e-6)


# --- suns -----------------------------------------------------------------------------------------


def test_sun_is_zero_exactly_where_no_share_of_its_disc_is_seen(rough: adret.Terrain) -> None:
    for diameter_deg in (0.0, 0.533, 8.0):
        sun = adret.Sun(305.0, 25.0, angular_diameter_deg=diameter_deg)
        lit = adret.shadow(rough, sun).lit
        light = adret.direct_light(rough, sun).irradiance
        np.testing.assert_array_equal(light == 0.0, lit == 0.0)
        np.testing.assert_array_equal(np.isnan(light), rough.mask)
        assert 0.05 < np.mean(lit[~rough.mask] == 0.0) < 0.95


def test_lit_cells_get_the_cosine(rough: adret.Terrain) -> None:
    sun = adret.Sun(120.0, 40.0, irradiance=900.0)
    lit = adret.shadow(rough, sun).lit
    light = adret.direct_light(rough, sun).irradiance
    cosine = np.einsum("v,vrc->rc", sun.direction, adret.surface_normals(rough).astype(np.float64))
    whole = lit >= 1.0 - 1e-6
    assert whole.sum() > 100
    np.testing.assert_allclose(light[whole], 900.0 * cosine[whole], rtol=1e-4, atol=2e-3)


def test_a_sun_in_a_picture_is_a_sun() -> None:
    picture = np.zeros((512, 1024), dtype=np.float32)
    rows, columns = 512, 1024
    row, column = 200, 700
    picture[row, column] = 1.0
    border = np.pi / 2 - np.array([row, row + 1]) * np.pi / rows
    elevation = float(np.degrees(border.mean()))
    solid = float((np.sin(border[0]) - np.sin(border[1])) * 2 * np.pi / columns)
    azimuth = (column + 0.5) / columns * 360.0 - 90.0
    rng = np.random.default_rng(2)
    terrain = adret.Terrain(scenes.fractal(rng, (60, 60), relief=30.0), (1.0, 1.0))
    pixel = adret.direct_light(terrain, adret.Environment(picture), 32)
    assert pixel.report.azimuths_swept == 1
    sun = adret.Sun(azimuth, elevation, irradiance=solid, angular_diameter_deg=0.35)
    disc = adret.direct_light(terrain, sun).irradiance
    off = abs(pixel.irradiance - disc) / solid
    assert np.median(off) < 1e-4
    assert np.mean(off > 0.01) < 0.03  # penumbra of a square and of a disc


def test_disc_of_the_whole_upper_half_is_the_uniform_sky() -> None:
    """An area light of 180 degrees at the zenith: irradiance pi L on the flat."""
    scene = scenes.funnel(np.radians(35.0), size=81, flat_radius=12.0)
    terrain = terrain_of(scene)
    dome = adret.Sun(0.0, 90.0, irradiance=np.pi, angular_diameter_deg=180.0)
    one = adret.direct_light(terrain, dome, 32).irradiance
    other = adret.direct_light(terrain, adret.UniformSky(), 32).irradiance
    np.testing.assert_allclose(one, other, rtol=2e-4, atol=2e-4)


# --- what is skipped ------------------------------------------------------------------------------


def test_one_sun_is_one_azimuth(rough: adret.Terrain) -> None:
    report = adret.direct_light(rough, adret.Sun(10.0, 20.0), 64).report
    assert (report.azimuths_swept, report.azimuths_skipped) == (1, 63)
    assert report.cells_skipped == int(rough.mask.sum())
    night = adret.direct_light(rough, adret.Sun(10.0, -85.0), 64)
    assert (night.report.azimuths_swept, night.report.azimuths_skipped) == (0, 64)
    assert (night.irradiance[~rough.mask] == 0.0).all()
    assert np.isnan(night.irradiance[rough.mask]).all()


@pytest.mark.parametrize("normal_angles", [None, 7])
def test_dark_azimuths_are_not_swept_and_no_byte_changes(
    normal_angles: int | None, rough: adret.Terrain, monkeypatch: pytest.MonkeyPatch
) -> None:
    picture = np.zeros((64, 128, 3), dtype=np.float32)
    picture[5:25, 40:70] = [1.0, 2.0, 3.0]
    picture[62:, :] = 50.0  # the ground, that no cell is steep enough to see
    sky = adret.Environment(picture, normal_angles=normal_angles)
    some = adret.direct_light(rough, sky, 32)
    assert 0 < some.report.azimuths_swept < 12
    assert some.report.azimuths_swept + some.report.azimuths_skipped == 32
    monkeypatch.setattr("adret.light.lit_slices", lambda slices, receivers: slices)
    every = adret.direct_light(rough, sky, 32)
    assert every.report.azimuths_swept == 32
    assert some.irradiance.tobytes() == every.irradiance.tobytes()


def test_light_from_below_is_swept_where_a_plane_can_see_it() -> None:
    picture = np.zeros((64, 128), dtype=np.float32)
    picture[40:48] = 1.0  # -22.5 to -45 degrees
    sky = adret.Environment(picture)
    flat = adret.Terrain(np.zeros((5, 5)), (1.0, 1.0))
    assert adret.direct_light(flat, sky, 16).report.azimuths_swept == 0
    hill = adret.Terrain(scenes.cone(np.radians(60.0), size=31).heights, (1.0, 1.0))
    light = adret.direct_light(hill, sky, 16)
    assert light.report.azimuths_swept == 16
    assert (light.irradiance[3:-3, 3] > 0.0).any()


def test_no_light_at_all_sweeps_nothing(rough: adret.Terrain) -> None:
    for sky in (
        adret.UniformSky(0.0),
        adret.OvercastSky(0.0),
        adret.Sun(0.0, 45.0, irradiance=0.0),
    ):
        light = adret.direct_light(rough, sky, 8)
        assert light.report.azimuths_swept == 0
        assert (light.irradiance[~rough.mask] == 0.0).all()


# --- normals, albedo, edges, errors ---------------------------------------------------------------


def test_own_normals_light_another_surface(rough: adret.Terrain) -> None:
    sky = adret.OvercastSky()
    usual = adret.direct_light(rough, sky, 8)
    normals = adret.surface_normals(rough)
    given = adret.direct_light(rough, sky, 8, normals=3.0 * normals.astype(np.float64))
    np.testing.assert_allclose(given.irradiance, usual.irradiance, rtol=1e-5)
    upright = np.zeros_like(normals)
    upright[2] = 1.0
    flat = adret.direct_light(rough, sky, 8, normals=upright).irradiance
    np.testing.assert_array_equal(np.isnan(flat), rough.mask)
    bare = adret.direct_light(adret.Terrain(np.zeros((4, 4)), (1.0, 1.0)), sky, 8).irradiance
    assert (flat[~rough.mask] <= bare.max() + 1e-5).all()


def test_radiance_is_albedo_times_irradiance_over_pi() -> None:
    flat = adret.Terrain(np.zeros((2, 4)), (1.0, 1.0))
    grey = adret.direct_light(flat, adret.UniformSky(2.0), 8)
    colour = adret.direct_light(flat, adret.Environment(np.full((8, 8, 3), 2.0)), 8)
    np.testing.assert_allclose(grey.radiance(), 2.0, rtol=1e-5)
    np.testing.assert_allclose(grey.radiance([0.1, 0.2, 0.3])[1, 1], [0.2, 0.4, 0.6], rtol=1e-5)
    cells = np.linspace(0.0, 1.0, 8).reshape(2, 4)
    np.testing.assert_allclose(grey.radiance(cells), 2.0 * cells, rtol=1e-5)
    np.testing.assert_allclose(colour.radiance(cells)[:, :, 1], 2.0 * cells, rtol=1e-4)
    np.testing.assert_allclose(colour.radiance(0.5), 1.0, rtol=1e-4)
    each = np.zeros((2, 4, 3))
    each[..., 2] = 1.0
    np.testing.assert_allclose(colour.radiance(each), 2.0 * each, rtol=1e-4)
    holed = cells.copy()
    holed[0, 0] = np.nan
    assert np.isnan(grey.radiance(holed)[0, 0])
    for albedo in (-0.1, 1.5, np.nan, [0.1, 0.2], np.zeros((4, 2)), [0.1, 0.2, 7.0], "x"):
        with pytest.raises(adret.InputError, match=r"^albedo"):
            grey.radiance(albedo)


def test_one_cell_and_all_nodata() -> None:
    lone = adret.Terrain(np.array([[7.0]]), (1.0, 1.0))
    assert adret.direct_light(lone, adret.UniformSky()).irradiance[0, 0] == pytest.approx(np.pi)
    hole = adret.Terrain(np.array([[1.0, np.nan]]), (1.0, 1.0)).window((0, 1), (1, 2))
    for sky in (adret.UniformSky(), adret.Sun(0.0, 9.0), adret.Environment(np.ones((4, 4, 3)))):
        assert np.isnan(adret.direct_light(hole, sky, 4).irradiance).all()


def test_errors_name_the_field(rough: adret.Terrain) -> None:
    sky = adret.UniformSky()
    cases: list[tuple[str, Any]] = [
        ("terrain", lambda: adret.direct_light(np.zeros((3, 3)), sky)),  # type: ignore[arg-type]
        ("sky", lambda: adret.direct_light(rough, "sunny")),  # type: ignore[arg-type]
        ("directions", lambda: adret.direct_light(rough, sky, 0)),
        ("directions", lambda: adret.direct_light(rough, adret.Sun(0.0, 1.0), 2.5)),  # type: ignore[arg-type]
        ("method", lambda: adret.direct_light(rough, sky, method="rays")),  # type: ignore[arg-type]
        ("normals", lambda: adret.direct_light(rough, sky, normals=np.zeros((3, 2, 2)))),
        ("normals", lambda: adret.direct_light(rough, sky, normals=np.zeros((3, *rough.shape)))),
    ]
    for field, call in cases:
        with pytest.raises(adret.InputError) as caught:
            call()
        assert caught.value.field == field
