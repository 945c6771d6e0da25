"""Shadow codes and the visible share of the disc."""

import numpy as np
import pytest

import adret
import oracles
import scenes
from adret.shadows import ShadowCode


def wall(height: float = 10.0, cells: int = 60) -> adret.Terrain:
    z = np.zeros((3, cells))
    z[:, 0] = height
    return adret.Terrain(z, (1.0, 1.0), datum=0.0)


def test_codes_of_a_ridge() -> None:
    column = np.abs(np.arange(-20.0, 21.0))
    z = np.tile(np.maximum(10.0 - column, 0.0), (3, 1))
    z[1, 3] = np.nan
    code = adret.shadow(adret.Terrain(z, (1.0, 1.0)), adret.Sun(90.0, 20.0)).code[1]
    assert code.dtype == np.uint8
    assert code[3] == ShadowCode.MASKED
    assert (code[21:30] == ShadowCode.LIT).all()  # faces the sun
    assert (code[11:20] == ShadowCode.SELF_SHADOWED).all()
    assert (code[4:9] == ShadowCode.CAST).all()
    assert (code[32:] == ShadowCode.LIT).all()


@pytest.mark.parametrize(("azimuth_deg", "elevation_deg"), [(33.0, 30.0), (250.0, 15.0)])
def test_bowl_has_the_shadow_of_its_closed_form(azimuth_deg: float, elevation_deg: float) -> None:
    half_angle = np.radians(60.0)
    scene = scenes.bowl(half_angle, size=129)
    sun = adret.Sun(azimuth_deg, elevation_deg, angular_diameter_deg=0.0)
    code = adret.shadow(adret.Terrain(scene.heights, (1.0, 1.0)), sun, method="exact").code
    want = scenes.bowl_lit(half_angle, sun.direction, size=129)
    assert scene.horizon is not None
    with np.errstate(divide="ignore", invalid="ignore"):
        far = abs(scene.horizon(np.radians(azimuth_deg)) - np.radians(elevation_deg)) > 0.02
    sure = scene.where & far
    assert sure.sum() > 0.8 * scene.where.sum()
    np.testing.assert_array_equal((code == ShadowCode.LIT)[sure], want[sure])


@pytest.mark.parametrize("diameter_deg", [0.1, 0.533, 1.0])
def test_penumbra_is_the_share_of_the_disc_above_the_edge(diameter_deg: float) -> None:
    terrain = wall()
    radius = np.radians(diameter_deg) / 2.0
    cell = 20
    edge = np.arctan(10.0 / cell)
    for u in np.linspace(-1.2, 1.2, 13):
        sun = adret.Sun(270.0, np.degrees(edge + u * radius), angular_diameter_deg=diameter_deg)
        result = adret.shadow(terrain, sun, method="exact")
        c = np.clip(u, -1.0, 1.0)
        want = (np.arccos(-c) + c * np.sqrt(1.0 - c * c)) / np.pi
        assert result.lit[1, cell] == pytest.approx(want, abs=3e-4 if diameter_deg < 0.5 else 1e-4)
        assert want == pytest.approx(oracles.disc_share(u * radius, radius), abs=1e-4)
        if abs(u) > 0.01:
            assert result.code[1, cell] == (ShadowCode.LIT if u > 0 else ShadowCode.CAST)


def test_wide_disc_agrees_with_the_narrow_form_and_with_a_straight_edge() -> None:
    z = np.zeros((401, 60))
    z[:, 0] = 10.0
    terrain = adret.Terrain(z, (1.0, 1.0), datum=0.0)
    middle = (200, 20)
    edge = np.degrees(np.arctan(0.5))
    for above in (-1.5, 0.0, 1.5):
        wide = adret.shadow(
            terrain, adret.Sun(270.0, edge + above, angular_diameter_deg=6.0), method="exact"
        )
        assert wide.report.azimuths_swept == 7
        # The edge of the wall sinks away from the sun's azimuth: integrate it.
        aside = np.radians(np.linspace(-4.0, 4.0, 4001))
        rows = np.radians(np.linspace(-4.5, 4.5, 3001))[:, None] + np.radians(edge + above)
        centre = np.radians(edge + above)
        cosine = np.sin(rows) * np.sin(centre) + np.cos(rows) * np.cos(centre) * np.cos(aside)
        disc = np.cos(rows) * (cosine >= np.cos(np.radians(3.0)))
        seen = disc * (np.tan(rows) > 0.5 * np.cos(aside))
        assert wide.lit[middle] == pytest.approx(seen.sum() / disc.sum(), abs=2e-3)


def test_sun_below_every_plane_sweeps_nothing() -> None:
    result = adret.shadow(wall(), adret.Sun(270.0, -88.0))
    assert result.report.azimuths_swept == 0
    assert result.report.azimuths_skipped == 1
    assert (result.code == ShadowCode.SELF_SHADOWED).all()
    assert (result.lit == 0.0).all()


def test_sun_at_the_zenith_lights_all_that_is_not_vertical(rng: np.random.Generator) -> None:
    terrain = adret.Terrain(scenes.fractal(rng, (20, 30), relief=500.0), (1.0, 1.0))
    for azimuth_deg in (0.0, 123.0):
        result = adret.shadow(terrain, adret.Sun(azimuth_deg, 90.0))
        assert (result.code == ShadowCode.LIT).all()
        np.testing.assert_allclose(result.lit, 1.0, atol=1e-6)


def test_azimuth_360_is_azimuth_0(rng: np.random.Generator) -> None:
    terrain = adret.Terrain(scenes.fractal(rng, (30, 30)), (1.0, 1.0))
    one, other = (adret.shadow(terrain, adret.Sun(a, 12.0)) for a in (0.0, 360.0))
    assert one.lit.tobytes() == other.lit.tobytes()
    assert one.code.tobytes() == other.code.tobytes()
    one, other = (adret.shadow(terrain, adret.Sun(a, 12.0)) for a in (-45.0, 315.0))
    assert one.lit.tobytes() == other.lit.tobytes()


def test_one_cell_and_all_nodata() -> None:
    lone = adret.Terrain(np.array([[1.0]]), (1.0, 1.0))
    assert adret.shadow(lone, adret.Sun(10.0, 30.0)).code.tolist() == [[0]]
    assert adret.shadow(lone, adret.Sun(10.0, 30.0)).lit[0, 0] == pytest.approx(1.0)
    hole = adret.Terrain(np.array([[1.0, np.nan]]), (1.0, 1.0)).window((0, 1), (1, 2))
    result = adret.shadow(hole, adret.Sun(10.0, 30.0))
    assert result.code.tolist() == [[3]]
    assert np.isnan(result.lit).all()


def test_errors_name_the_field() -> None:
    with pytest.raises(adret.InputError, match=r"^sun"):
        adret.shadow(wall(), adret.UniformSky())  # type: ignore[arg-type]
    with pytest.raises(adret.InputError, match=r"^terrain"):
        adret.shadow(np.zeros((3, 3)), adret.Sun(0.0, 1.0))  # type: ignore[arg-type]
    with pytest.raises(adret.InputError, match=r"^refraction"):
        adret.shadow(wall(), adret.Sun(0.0, 1.0), refraction=3.0)
