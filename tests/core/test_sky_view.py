"""Sky-view factors and openness: closed forms, the two routes, long sums, errors."""

from typing import Any

import numpy as np
import pytest

import adret
import oracles
import scenes
from adret._kernels import horizon_integrals
from adret.layer_sum import LayerSum

KINDS = ["visible", "horizontal", "normal"]
CELL = (2.0, 3.0)


@pytest.fixture(scope="module")
def rough() -> adret.Terrain:
    rng = np.random.default_rng(7)
    z = scenes.fractal(rng, (40, 33), relief=60.0)
    z[rng.random(z.shape) < 0.05] = np.nan
    return adret.Terrain(z, CELL)


# --- closed forms ---------------------------------------------------------------------------------


@pytest.mark.parametrize("slope_deg", [0.0, 10.0, 30.0, 60.0, 80.0])
def test_planes(slope_deg: float) -> None:
    scene = scenes.plane(np.radians(slope_deg), np.radians(77.0))
    terrain = adret.Terrain(scene.heights, scene.cell_size)
    for kind, limit in (("visible", 5e-4), ("horizontal", 1e-4), ("normal", 1e-5)):
        got = adret.sky_view_factor(terrain, kind, 64)[scene.where]
        np.testing.assert_allclose(got, scene.values[kind], atol=limit)
    unclipped = adret.sky_view_factor(terrain, "normal", 64, clip=False)[scene.where]
    np.testing.assert_allclose(unclipped, 1.0, atol=2e-5)
    for sign in (1, -1):
        np.testing.assert_allclose(adret.openness(terrain, sign)[scene.where], 90.0, atol=5e-3)


def test_bowl_has_the_same_sky_for_every_tilted_cell() -> None:
    scene = scenes.bowl(np.radians(50.0), size=129)
    terrain = adret.Terrain(scene.heights, scene.cell_size)
    for kind in ("horizontal", "normal"):
        got = adret.sky_view_factor(terrain, kind, 32, method="exact")[scene.where]
        assert abs(got - scene.values[kind]).max() < 0.02
        assert abs(got - scene.values[kind]).mean() < 0.003


def test_tip_of_a_cone_and_bottom_of_a_funnel() -> None:
    cone, funnel = scenes.cone(np.radians(40.0)), scenes.funnel(np.radians(40.0))
    peak = adret.Terrain(cone.heights, cone.cell_size)
    hole = adret.Terrain(funnel.heights, funnel.cell_size)
    middle = peak.shape[0] // 2, peak.shape[1] // 2
    for kind in KINDS:
        assert adret.sky_view_factor(peak, kind)[middle] == 1.0
        got = adret.sky_view_factor(hole, kind)[middle]
        assert got == pytest.approx(funnel.values[kind], abs=2e-4)
    assert adret.openness(peak)[middle] == pytest.approx(130.0, abs=0.01)
    assert adret.openness(hole)[middle] == pytest.approx(50.0, abs=0.02)
    assert adret.openness(hole, -1)[middle] == pytest.approx(90.0, abs=1e-3)  # its foot is flat
    turned = adret.Terrain(-funnel.heights, funnel.cell_size)
    assert adret.openness(turned, -1)[middle] == pytest.approx(50.0, abs=0.02)


# --- slow twin, both routes -----------------------------------------------------------------------


def test_every_kind_is_the_quadrature_of_its_definition(rough: adret.Terrain) -> None:
    map_ = adret.horizon_map(rough, 12)
    seen = {kind: adret.sky_view_factor(map_, kind) for kind in KINDS}
    open_ = adret.sky_view_factor(map_, "normal", clip=False)
    for row, column in np.argwhere(~rough.mask)[::60]:
        h = map_.elevation[:, row, column]
        n = oracles.normal(rough.elevations(), CELL, row, column)
        for kind in KINDS:
            want = oracles.sky_view(h, map_.azimuth, kind, n)
            assert seen[kind][row, column] == pytest.approx(want, abs=2e-6)
        want = oracles.sky_view(h, map_.azimuth, "normal", n, clip=False)
        assert open_[row, column] == pytest.approx(want, abs=2e-6)
        assert adret.openness(map_)[row, column] == pytest.approx(oracles.openness(h), abs=3e-5)


@pytest.mark.parametrize("kind", KINDS)
def test_fused_sweep_equals_the_horizon_map(rough: adret.Terrain, kind: str) -> None:
    options: dict[str, Any] = {"near": 6, "radius": 6.371e6, "refraction": 0.13}
    fused = adret.sky_view_factor(rough, kind, 16, **options)
    mapped = adret.sky_view_factor(adret.horizon_map(rough, 16, **options), kind)
    np.testing.assert_allclose(fused, mapped, atol=1e-6)
    np.testing.assert_array_equal(np.isnan(fused), rough.mask)
    assert fused.dtype == np.float32


def test_negative_openness_is_that_of_the_terrain_upside_down(rough: adret.Terrain) -> None:
    turned = adret.Terrain(-rough.elevations(), CELL, datum=-rough.datum)
    np.testing.assert_array_equal(adret.openness(rough, -1, 8), adret.openness(turned, 1, 8))
    np.testing.assert_array_equal(np.isnan(adret.openness(rough, -1, 8)), rough.mask)


def test_no_terrain_in_sight_is_open_sky() -> None:
    lone = adret.Terrain(np.array([[5.0]]), (1.0, 1.0))
    for kind in KINDS:
        assert adret.sky_view_factor(lone, kind, 8).tolist() == [[1.0]]
    assert adret.sky_view_factor(lone, "normal", 8, clip=False)[0, 0] == pytest.approx(1.0)
    assert adret.openness(lone)[0, 0] == pytest.approx(180.0)
    vertical = adret.HorizonMap(
        np.full((4, 1, 1), np.pi / 2, dtype=np.float32),
        adret.azimuth_set(4),
        None,
        lone,
        adret.horizon_map(lone, 4).options,
        adret.horizon_map(lone, 4).report,
    )
    for kind in KINDS:
        assert adret.sky_view_factor(vertical, kind)[0, 0] == pytest.approx(0.0, abs=1e-12)
    assert adret.openness(vertical)[0, 0] == pytest.approx(0.0, abs=1e-5)


def test_all_nodata_window_stays_nodata() -> None:
    z = np.zeros((4, 8))
    z[:, 4:] = np.nan
    hole = adret.Terrain(z, (1.0, 1.0)).window((0, 4), (4, 8))
    for kind in KINDS:
        assert np.isnan(adret.sky_view_factor(hole, kind, 4)).all()
    assert np.isnan(adret.openness(hole, 1, 4)).all()
    assert np.isnan(adret.openness(hole, -1, 4)).all()


# --- sums, reports, progress ----------------------------------------------------------------------


@pytest.mark.parametrize("count", [31, 32, 33, 64, 7200])
def test_sums_of_many_equal_layers_are_exact_to_a_millionth(count: int) -> None:
    slope = np.array([[0.0, 0.3, 1.0, 7.0, np.nan]], dtype=np.float32)
    total = LayerSum((1, 1, 5), count)
    for _ in range(count):
        horizon_integrals.add_cosine_squared(slope, total.layer[0])
        total.added()
    want = 1.0 / (1.0 + slope.astype(np.float64) ** 2)
    np.testing.assert_allclose(total.total()[0] / count, want, rtol=1e-6)


def test_report_and_progress_of_a_fused_run(rough: adret.Terrain) -> None:
    calls: list[tuple[int, int]] = []
    adret.sky_view_factor(
        rough, directions=5, progress=lambda done, total: calls.append((done, total))
    )
    assert calls == [(k, 5) for k in range(1, 6)]
    report = adret.last_run_report()
    assert report is not None
    assert (report.azimuths_swept, report.cells_skipped) == (5, int(rough.mask.sum()))


def test_an_exception_from_progress_ends_the_run(rough: adret.Terrain) -> None:
    def stop(done: int, total: int) -> None:
        raise adret.Cancelled("stopped")

    for x in (rough, adret.horizon_map(rough, 3)):
        with pytest.raises(adret.Cancelled):
            adret.openness(x, directions=3, progress=stop)


# --- errors ---------------------------------------------------------------------------------------


def test_errors_name_the_field(rough: adret.Terrain) -> None:
    map_ = adret.horizon_map(rough, azimuths=[0.0, 1.0, 2.0])
    even = adret.horizon_map(rough, 3)
    cases: list[tuple[str, Any]] = [
        ("kind", lambda: adret.sky_view_factor(rough, "half")),  # type: ignore[arg-type]
        ("directions", lambda: adret.sky_view_factor(rough, directions=0)),
        ("near", lambda: adret.sky_view_factor(rough, near=-1)),
        ("sign", lambda: adret.openness(rough, 0)),  # type: ignore[arg-type]
        ("x", lambda: adret.openness(even, -1)),
        ("x", lambda: adret.sky_view_factor(np.zeros((3, 3)))),  # type: ignore[arg-type]
        ("azimuths", lambda: adret.sky_view_factor(map_)),
        ("near", lambda: adret.sky_view_factor(even, near=4)),
    ]
    for field, call in cases:
        with pytest.raises(adret.InputError) as caught:
            call()
        assert caught.value.field == field


def test_evenly_spaced_azimuths_may_start_anywhere(rough: adret.Terrain) -> None:
    turned = adret.horizon_map(rough, azimuths=np.radians([100.0, 340.0, 220.0]))
    assert np.isfinite(adret.sky_view_factor(turned)[~rough.mask]).all()
