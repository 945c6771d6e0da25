"""What a run leaves out changes no byte, and is counted."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

import adret
from adret import skips


def plateau() -> adret.Terrain:
    """Low ground within a rim: the raster's edge is high, but far below most near horizons."""
    z = np.random.default_rng(2).random((90, 120)) * 30.0
    z[:, 0] = 35.0
    return adret.Terrain(z, (10.0, 10.0), datum=0.0)


def level() -> adret.Terrain:
    """Holes of one cell: what stands round them is near."""
    z = np.zeros((60, 70))
    z[::7, ::9] = -5.0
    return adret.Terrain(z, (10.0, 10.0), datum=0.0)


def sea() -> adret.Terrain:
    return adret.Terrain(np.zeros((60, 70)), (10.0, 10.0), datum=0.0)


def coast() -> adret.Terrain:
    """Rough land in the south-west, nodata beyond a slanting coast, a level lake and a gap."""
    z = np.random.default_rng(3).random((150, 170)) * 40.0
    z[60:135, 20:120] = 17.0
    z[100, 70] = 20.0
    y, x = np.mgrid[:150, :170]
    z[x - y > 30] = np.nan
    z[3, 5] = np.nan
    return adret.Terrain(z, (10.0, 10.0), datum=0.0)


def horizons(terrain: adret.Terrain) -> bytes:
    return adret.horizon_map(terrain, 12, near=4).elevation.tobytes()


def ranged(terrain: adret.Terrain) -> bytes:
    found = adret.horizon_map(terrain, 12, near=4, max_distance=300.0, distance=True)
    assert found.distance is not None
    return found.elevation.tobytes() + found.distance.tobytes()


def within(terrain: adret.Terrain) -> bytes:
    return adret.horizon_map(terrain, 12, near=4, max_distance=500.0).elevation.tobytes()


def rounded(terrain: adret.Terrain) -> bytes:
    return adret.horizon_map(terrain, 12, near=4, radius=2e5).elevation.tobytes()


def bent(terrain: adret.Terrain) -> bytes:
    found = adret.horizon_map(terrain, 12, near=4, radius=2e5, observer_height=2.0)
    return found.elevation.tobytes()


def exact(terrain: adret.Terrain) -> bytes:
    found = adret.horizon_map(terrain, 12, method="exact", distance=True)
    assert found.distance is not None
    return found.elevation.tobytes() + found.distance.tobytes()


def exact_bent(terrain: adret.Terrain) -> bytes:
    options = {"max_distance": 400.0, "radius": 2e5, "observer_height": 2.0}
    return adret.horizon_map(terrain, 12, method="exact", **options).elevation.tobytes()


def repeated(terrain: adret.Terrain) -> bytes:
    azimuths = [0.3, 2.0, 0.3, 0.4, 2.0, 0.3]
    found = adret.horizon_map(terrain, azimuths=azimuths, near=4, distance=True)
    assert found.distance is not None
    return found.elevation.tobytes() + found.distance.tobytes()


def lit(terrain: adret.Terrain) -> bytes:
    sky = np.zeros((4, 8, 3), np.float32)
    sky[:2, 2] = 1.0
    light = adret.direct_light(terrain, adret.Environment(sky), directions=16, near=4)
    return light.irradiance.tobytes()


def dusk(terrain: adret.Terrain) -> bytes:
    shade = adret.shadow(terrain, adret.Sun(200.0, -89.0), near=4)
    return shade.code.tobytes() + shade.lit.tobytes()


@pytest.mark.parametrize(
    ("name", "ground", "run"),
    [
        ("ends of rays", plateau, exact),
        ("ends of rays", level, exact),
        ("ends of rays", plateau, exact_bent),
        ("far edge", plateau, horizons),
        ("far edge", plateau, bent),
        ("far edge", plateau, ranged),
        ("far field", level, horizons),
        ("far field", sea, rounded),
        ("far field", level, ranged),
        ("level ground", coast, horizons),
        ("level ground", coast, bent),
        ("level ground", sea, rounded),
        ("nodata", coast, horizons),
        ("nodata", coast, bent),
        ("nodata", coast, within),
        ("same azimuths", plateau, repeated),
        ("dark azimuths", plateau, lit),
        ("dark azimuths", plateau, dusk),
    ],
)
def test_a_skip_changes_no_byte(
    name: str,
    ground: Callable[[], adret.Terrain],
    run: Callable[[adret.Terrain], bytes],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("ADRET_SKIP", "none")
    whole = run(ground())
    report = adret.last_run_report()
    assert report is not None
    assert report.skipped == {}
    monkeypatch.setenv("ADRET_SKIP", "all")
    assert run(ground()) == whole
    report = adret.last_run_report()
    assert report is not None
    assert report.skipped[name] > 0


def test_a_flat_far_field_is_left_out_at_every_receiver() -> None:
    z: NDArray[np.float64] = np.zeros((50, 60))
    adret.horizon_map(adret.Terrain(z, (1.0, 1.0)), 8, near=2)
    report = adret.last_run_report()
    assert report is not None
    assert set(report.skipped) == {"far field", "level ground"}
    assert report.skipped["far field"] == 8 * z.size
    assert 0 < report.skipped["level ground"] < 8 * z.size  # not at the raster's edge


def test_every_skip_is_told_apart_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    assert all(skips.wanted(name) for name in skips.SKIPS)
    monkeypatch.setenv("ADRET_SKIP", "none")
    assert not any(skips.wanted(name) for name in skips.SKIPS)
    monkeypatch.setenv("ADRET_SKIP", "some")
    with pytest.raises(adret.InputError, match="ADRET_SKIP"):
        skips.wanted("far edge")
    with pytest.raises(adret.InputError, match="skip"):
        skips.wanted("night")
