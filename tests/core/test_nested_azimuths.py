"""Azimuths are doubled until the result settles, and it lies as near to the truth as was asked."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

import adret
import scenes

Product = Callable[..., NDArray[np.float32]]


def hills() -> adret.Terrain:
    z = scenes.fractal(np.random.default_rng(5), (90, 110), relief=600.0)
    z[40:44, 50:60] = np.nan
    return adret.Terrain(z, (30.0, 30.0))


def craters() -> adret.Terrain:
    y, x = np.mgrid[:90, :100]
    z = np.zeros(y.shape)
    for row, column, size in ((20, 30, 9.0), (60, 70, 17.0), (70, 20, 6.0)):
        away = np.hypot(y - row, x - column) / size
        z += 40.0 * size * (np.exp(-((away - 1.0) ** 2) * 12.0) - np.exp(-(away**4)))
    return adret.Terrain(z, (100.0, 100.0))


def streets() -> adret.Terrain:
    z = np.zeros((90, 90))
    for top in range(5, 85, 16):
        for left in range(3, 80, 13):
            z[top : top + 9, left : left + 8] = 6.0 + (top * 7 + left * 3) % 17
    return adret.Terrain(z, (1.0, 1.0))


def light(terrain: adret.Terrain, **how: object) -> NDArray[np.float32]:
    return adret.direct_light(terrain, adret.OvercastSky(), **how).irradiance  # type: ignore[arg-type]


PRODUCTS: dict[str, tuple[Product, float | None]] = {
    "sky view": (adret.sky_view_factor, 1.0),
    "openness": (adret.openness, 90.0),
    "light": (light, None),
}


@pytest.mark.parametrize("ground", [hills, craters, streets])
@pytest.mark.parametrize("product", PRODUCTS)
def test_an_automatic_number_of_azimuths_errs_by_no_more_than_was_asked(
    product: str, ground: Callable[[], adret.Terrain]
) -> None:
    make, scale = PRODUCTS[product]
    terrain = ground()
    truth = make(terrain, directions=512, near=8)
    scale = float(np.nanmean(truth)) if scale is None else scale
    chosen = []
    for tolerance in (0.02, 0.002):
        found = make(terrain, directions="auto", tolerance=tolerance, near=8)
        report = adret.last_run_report()
        assert report is not None
        assert report.directions == report.azimuths_swept
        assert report.change is not None
        assert report.change <= tolerance
        assert np.nanmean(np.abs(found - truth)) <= tolerance * scale
        assert (np.isnan(found) == np.isnan(truth)).all()
        chosen.append(report.directions)
        plain = make(terrain, directions=report.directions, near=8)
        np.testing.assert_allclose(found, plain, rtol=2e-6, atol=2e-6 * scale)
    assert chosen[0] <= chosen[1]


def test_pictures_settle_too_and_a_narrow_sun_is_one_azimuth() -> None:
    terrain = hills()
    sky = np.random.default_rng(3).random((16, 32, 3)).astype(np.float32)
    found = adret.direct_light(terrain, adret.Environment(sky), "auto", tolerance=0.01, near=8)
    assert found.report.directions is not None
    plain = adret.direct_light(terrain, adret.Environment(sky), found.report.directions, near=8)
    np.testing.assert_allclose(found.irradiance, plain.irradiance, rtol=2e-6, atol=1e-6)
    sun = adret.direct_light(terrain, adret.Sun(100.0, 20.0), "auto", near=8)
    assert sun.report.azimuths_swept == 1
    plain = adret.direct_light(terrain, adret.Sun(100.0, 20.0), 8, near=8)
    assert sun.irradiance.tobytes() == plain.irradiance.tobytes()


def test_open_ground_needs_two_sets() -> None:
    flat = adret.Terrain(np.zeros((8, 9)), (1.0, 1.0))
    assert adret.sky_view_factor(flat, directions="auto").min() == 1.0
    report = adret.last_run_report()
    assert report is not None
    assert (report.directions, report.change) == (16, 0.0)


def test_what_makes_no_sense_is_refused() -> None:
    flat = adret.Terrain(np.zeros((4, 4)), (1.0, 1.0))
    with pytest.raises(adret.InputError, match="directions"):
        adret.sky_view_factor(flat, directions="many")  # type: ignore[arg-type]
    with pytest.raises(adret.InputError, match="tolerance"):
        adret.openness(flat, directions=8, tolerance=0.1)
    with pytest.raises(adret.InputError, match="tolerance"):
        adret.direct_light(flat, adret.UniformSky(), "auto", tolerance=-0.1)
