"""An error asked for is an error kept."""

from pathlib import Path

import numpy as np
import pytest

import adret
import scenes

UNSEEN = {
    "alpine": "alpine_exploradores_aster_utm18s_30m_voids.tif",
    "urban": "urban_tatras_dsm_1m_voids.tif",
    "lunar": "moon_southpole_stere_474m.tif",
}


def achieved(terrain: adret.Terrain, max_error: float, directions: int) -> tuple[float, float]:
    """Mean of |error| [degrees] at cells that the choice was not made from, and the promise."""
    found = adret.horizon_map(terrain, directions, max_error=max_error)
    rng = np.random.default_rng(77)
    here = rng.choice(np.flatnonzero(~terrain.mask), 700)
    row, column = np.divmod(here, terrain.shape[1])
    truth = adret.horizon_at(terrain, row, column, directions)
    there = truth > -1.57
    off = np.abs(found.elevation[:, row, column] - truth)[there]
    promised = found.report.expected_error_deg
    assert promised is not None
    return float(np.degrees(off.mean())), promised


def test_the_report_says_what_was_chosen() -> None:
    z = scenes.fractal(np.random.default_rng(1), (150, 160), relief=900.0)
    terrain = adret.Terrain(z, (30.0, 30.0))
    nears = []
    for wanted in (1.0, 0.1, 0.01):
        found = adret.horizon_map(terrain, 16, max_error=wanted)
        assert found.report.near == found.options.near
        assert found.report.expected_error_deg is not None
        assert found.report.expected_error_deg <= wanted
        nears.append(found.options.near)
    assert nears == sorted(nears)
    assert nears[0] < nears[-1]
    assert adret.horizon_map(terrain, 4).report.expected_error_deg is None
    error, promised = achieved(terrain, 0.05, 16)
    assert error <= 1.5 * promised


@pytest.mark.slow
@pytest.mark.parametrize("kind", list(UNSEEN))
@pytest.mark.parametrize("wanted", [0.05, 0.01])
def test_promises_are_kept_on_unseen_terrain(kind: str, wanted: float, data_dir: Path) -> None:
    path = data_dir / "dem" / UNSEEN[kind]
    if not path.exists():
        pytest.skip(f"{path.name} is not there")
    terrain = adret.Terrain.open(path)
    terrain = terrain.window((0, min(900, terrain.shape[0])), (0, min(900, terrain.shape[1])))
    error, promised = achieved(terrain, wanted, 24)
    assert promised <= wanted
    assert error <= 1.5 * promised


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), 100.0])
def test_odd_errors_are_refused(value: float) -> None:
    terrain = adret.Terrain(np.zeros((4, 4)), (1.0, 1.0))
    with pytest.raises(adret.InputError, match="max_error"):
        adret.horizon_map(terrain, 4, max_error=value)


def test_other_methods_have_no_error_to_choose() -> None:
    terrain = adret.Terrain(np.zeros((4, 4)), (1.0, 1.0))
    with pytest.raises(adret.InputError, match="max_error"):
        adret.horizon_map(terrain, 4, method="exact", max_error=0.1)
