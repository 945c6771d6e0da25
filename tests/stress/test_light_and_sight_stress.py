"""Light, sight and bounces on hard fields, against long double and exact fractions."""

import itertools
import math
from typing import Any

import numpy as np
import pytest
import stress_references as references
from numpy.typing import NDArray

import adret
import sight_oracle

UNIT = 2.0**-24
LIGHT, BOUNCE = 3e-6, 2e-6
"""What light may be off by, as a share of the brightest there could be."""
K = 8
AZIMUTHS = np.arange(K) * (2.0 * math.pi / K)
SHAPE = (9, 11)
NAMES = list(references.fields())
CASES: list[tuple[float, float, tuple[float, float]]] = [
    (1e-6, 0.0, (1.0, 1.0)),
    (1e-3, 1e7, (1.0, 1.0)),
    (1.0, 1e4, (1e-3, 1e-3)),
    (2.0, 1e4, (1.0, 100.0)),
    (1.0, 0.0, (1e5, 1e3)),
    (1e3, 0.0, (1e5, 1e5)),
    (1e6, 0.0, (1.0, 1.0)),
]
"""Relief [smaller cells], offset [m], cell [m]."""
EVERY = [
    case
    for case in itertools.product(
        (1e-6, 1e-3, 1.0, 1e3, 1e6),
        (0.0, 1e4, 1e7),
        ((1.0, 1.0), (1e-3, 1e-3), (1e5, 1e5), (1.0, 100.0), (50.0, 0.5)),
    )
    if case[0] * min(case[2]) < 1e9  # heights beyond are refused
]
CHOSEN = [CASES, pytest.param(EVERY, marks=pytest.mark.slow)]
IDS = ["some", "all"]
Cases = list[tuple[float, float, tuple[float, float]]]
HOLES = [(2, 3), (5, 8), (8, 0)]


def heights(
    name: str, relief: float, offset: float, cell: tuple[float, float], holes: bool = False
) -> NDArray[np.float64]:
    z = references.fields(*SHAPE)[name] * (relief * min(cell)) + offset
    if holes:
        z[tuple(np.transpose(HOLES))] = np.nan
    return z


def rounding(terrain: adret.Terrain) -> float:
    """What the heights' rounding does to a slope."""
    return 2.0 * UNIT * float(np.nanmax(np.abs(terrain.heights))) / min(terrain.cell_size)


def light_error(name: str, case: tuple[float, float, tuple[float, float]]) -> float:
    """Largest error of overcast light, as a share of open flat ground's."""
    z, cell = heights(name, *case, holes=True), case[2]
    terrain = adret.Terrain(z, cell)
    got = adret.direct_light(terrain, adret.OvercastSky(), directions=K, near=64).irradiance
    east, north = references.plane_slopes(z, cell)
    up = 1.0 / np.sqrt(1.0 + east**2 + north**2)
    total = np.zeros_like(z, dtype=np.longdouble)
    for azimuth, horizon in zip(AZIMUTHS, references.slopes(z, cell, AZIMUTHS), strict=True):
        plane = east * math.sin(azimuth) + north * math.cos(azimuth)
        t = np.fmax(np.fmax(horizon, plane), 0.0)
        zenith = np.arctan2(np.ones_like(t), t)
        sine, cosine = np.cos(zenith), np.sin(zenith)
        # Of L = (1 + 2 sin e)/3: the part by the cosine of the plane, and by sin e.
        total += (references.moment(t, plane) + 2.0 * _cubes(sine, cosine, plane)) / 3.0
    want = np.maximum(total * up * (2.0 * math.pi / K), 0.0)
    np.testing.assert_array_equal(np.isnan(got), np.isnan(z))
    off = np.nanmax(np.abs(got - want)) / (7.0 * math.pi / 9.0)
    return float(off)


def _cubes(sine: Any, cosine: Any, plane: Any) -> Any:
    """∫ (sin e - plane·cos e) cos e sin e de up to the zenith."""
    # 1 - sin³ e without the cancellation near the zenith.
    left = cosine**2 / (1.0 + sine) * (1.0 + sine + sine**2)
    return (left - plane * cosine**3) / 3.0


@pytest.mark.parametrize("cases", CHOSEN, ids=IDS)
@pytest.mark.parametrize("name", NAMES)
def test_overcast_light_is_off_by_roundings_alone(name: str, cases: Cases) -> None:
    for case in cases:
        assert light_error(name, case) <= LIGHT, case


def sun_errors(name: str, case: tuple[float, float, tuple[float, float]]) -> tuple[float, int, int]:
    """Largest error of direct light in units of what is allowed; cells compared; wrong codes."""
    z, cell = heights(name, *case, holes=True), case[2]
    terrain = adret.Terrain(z, cell)
    east, north = references.plane_slopes(z, cell)
    up = 1.0 / np.sqrt(1.0 + east**2 + north**2)
    worst, compared, wrong = 0.0, 0, 0
    for azimuth, elevation in ((0.0, 0.02), (math.pi / 4, 0.6), (2.2, 0.3), (4.0, 1.2)):
        sun = adret.Sun(
            math.degrees(azimuth), math.degrees(elevation), 1000.0, angular_diameter_deg=0.0
        )
        got = adret.direct_light(terrain, sun, near=64).irradiance
        code = adret.shadow(terrain, sun, near=64).code
        s = sun.direction
        facing = up * (s[2] - east * s[0] - north * s[1])
        crest = np.arctan(references.slopes(z, cell, [azimuth])[0])
        plane = np.arctan(east * math.sin(azimuth) + north * math.cos(azimuth))
        radius = math.radians(1e-4) / 2.0  # of what is called a point
        doubt = 3e-7 + radius + rounding(terrain)
        clear = ~np.isnan(z) & (abs(crest - elevation) > doubt) & (abs(plane - elevation) > doubt)
        want = np.where((crest < elevation) & (facing > 0.0), 1000.0 * facing, 0.0)
        expected = np.where(facing <= 0.0, 1, np.where(crest >= elevation, 2, 0))
        # The cosine moves by the plane's tilt times what slopes are off by.
        allowed = 1000.0 * (1e-6 + rounding(terrain) * np.minimum(up, 1.0))
        worst = max(worst, float(np.max((abs(got - want) / allowed)[clear], initial=0.0)))
        wrong += int((code != expected)[clear].sum())
        assert (code[np.isnan(z)] == 3).all()
        compared += int(clear.sum())
    return worst, compared, wrong


@pytest.mark.parametrize("cases", CHOSEN, ids=IDS)
@pytest.mark.parametrize("name", NAMES)
def test_a_sun_lights_what_it_reaches_and_nothing_else(name: str, cases: Cases) -> None:
    for case in cases:
        worst, compared, wrong = sun_errors(name, case)
        assert wrong == 0, case
        assert worst <= 1.0, case
        assert compared > 250 or len(cases) > 9, case


def bounce_error(name: str, case: tuple[float, float, tuple[float, float]]) -> float:
    """Largest error of one bounce, as a share of π times the brightest ground."""
    z, cell = heights(name, *case, holes=True), case[2]
    terrain = adret.Terrain(z, cell)
    sent = np.random.default_rng(3).random(SHAPE).astype(np.float32)
    got = adret.indirect_light(terrain, None, 1.0, radiance=sent, directions=K, near=64)
    want = references.bounced(z, sent, cell, AZIMUTHS)
    np.testing.assert_array_equal(np.isnan(got.irradiance), np.isnan(z))
    off = float(np.nanmax(np.abs(got.irradiance - want))) / math.pi
    return off


@pytest.mark.parametrize("cases", CHOSEN, ids=IDS)
@pytest.mark.parametrize("name", NAMES)
def test_a_bounce_is_off_by_roundings_alone(name: str, cases: Cases) -> None:
    for case in cases:
        assert bounce_error(name, case) <= BOUNCE, case


@pytest.mark.parametrize("cases", CHOSEN, ids=IDS)
@pytest.mark.parametrize("name", NAMES)
def test_all_that_can_be_seen_is_seen_and_nothing_that_is_hidden_by_more_than_is_stated(
    name: str, cases: Cases
) -> None:
    for case in cases:
        z, cell = heights(name, *case, holes=True), case[2]
        terrain = adret.Terrain(z, cell)
        got = adret.intervisibility(terrain, directions=K, reduce="visible_count")
        least, most = references.seen_counts(z, cell, AZIMUTHS)
        there = ~np.isnan(z)
        assert (got[there] >= least[there]).all(), case
        assert (got[there] <= most[there]).all(), case


@pytest.mark.parametrize(
    "cases", [CASES[1:4:2], pytest.param(EVERY, marks=pytest.mark.slow)], ids=IDS
)
@pytest.mark.parametrize("name", NAMES)
def test_viewsheds_are_those_of_fractions(name: str, cases: Cases) -> None:
    """Every verdict on the heights that are held; least heights to float32's rounding."""
    for case in cases:
        z, cell = heights(name, *case, holes=True), case[2]
        terrain = adret.Terrain(z, cell)
        held = terrain.heights
        size = float(np.nanmax(np.abs(held)))
        eye = min(0.25 * size, 1e6)
        for observer in ((4, 5),) if len(cases) < 9 else ((4, 5), (0, 10)):
            seen = adret.viewshed(terrain, observer, observer_height=eye)
            for target in np.ndindex(SHAPE):
                if target == observer or np.isnan(held[target]):
                    assert seen.visible[target] == (target == observer)
                    continue
                want, least = sight_oracle.sight(held, observer, target, eye)
                assert seen.visible[target] == want, (case, observer, target)
                assert abs(seen.minimum_height[target] - least) <= 4.0 * UNIT * max(size, least)
