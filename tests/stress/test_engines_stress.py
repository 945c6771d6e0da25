"""Sky view, light, intervisibility, bounces: worst errors and exact invariances on hard fields."""

import itertools
import math

import numpy as np
import pytest
import stress_references as references
from numpy.typing import NDArray

import adret

DIRECTIONS = 16
AZIMUTHS = np.arange(DIRECTIONS) * (2.0 * np.pi / DIRECTIONS)
UNIT = 2.0**-24
SHARE = 2e-6
"""Sums of float32 terms: what a share of the sky may be off by, beside the heights' rounding."""
CASES = [
    (1e-3, 1e7, 1.0),
    (1.0, 1e4, 1e-3),
    (1.0, 0.0, 1e5),
    (1e6, 0.0, 1.0),
]  # relief, offset, cell
SHAPES = [(1, 1), (1, 2), (2, 1), (2, 2), (1, 9), (9, 1)]


def slopes(z: NDArray[np.float64], cell: float) -> NDArray[np.float64]:
    """Plane through a cell's neighbours, towards east and north: what the definitions say."""
    padded = np.pad(z, 1, mode="edge")
    wide = np.ones_like(z) * 2.0
    high = np.ones_like(z) * 2.0
    wide[:, [0, -1]] -= 1.0
    high[[0, -1]] -= 1.0
    east = (padded[1:-1, 2:] - padded[1:-1, :-2]) / np.maximum(wide, 1.0) / cell
    north = (padded[:-2, 1:-1] - padded[2:, 1:-1]) / np.maximum(high, 1.0) / cell
    return np.stack([east, north])


def truths(z: NDArray[np.float64], cell: float) -> dict[str, NDArray[np.float64]]:
    """Sky views and overcast light by the definitions, in double precision."""
    t = np.asarray(references.slopes(z, (cell, cell), AZIMUTHS), dtype=np.float64)
    t = np.where(np.isneginf(t), -1e30, t)
    east, north = slopes(z, cell)
    up = 1.0 / np.sqrt(1.0 + east**2 + north**2)
    h = np.arctan(np.maximum(t, 0.0))
    towards = (np.sin(AZIMUTHS), np.cos(AZIMUTHS))
    own = np.stack([east * s + north * c for s, c in zip(*towards, strict=True)])
    e = np.arctan(np.maximum(np.maximum(t, own), 0.0))
    tilted = -own * (np.pi / 2 - e - 0.5 * np.sin(2 * e)) + np.cos(e) ** 2
    return {
        "visible": (1.0 - np.sin(h)).mean(axis=0),
        "horizontal": (np.cos(h) ** 2).mean(axis=0),
        "normal": np.maximum(tilted.mean(axis=0) * up, 0.0),
    }


def heights(name: str, relief: float, offset: float, cell: float) -> NDArray[np.float64]:
    return references.fields(12, 14)[name] * (relief * cell) + offset


@pytest.mark.parametrize("name", list(references.fields()))
def test_sky_views_are_off_by_roundings_alone(name: str) -> None:
    for relief, offset, cell in CASES:
        z = heights(name, relief, offset, cell)
        terrain = adret.Terrain(z, (cell, cell))
        # A share of the sky moves by no more than its horizons do.
        rounding = 4.0 * UNIT * float(np.abs(terrain.heights).max()) / cell
        for kind, want in truths(z, cell).items():
            got = adret.sky_view_factor(terrain, kind=kind, directions=DIRECTIONS)
            bound = SHARE + min(rounding, 1e-4 if relief < 1e3 else 2e-6)
            assert np.abs(got - want).max() <= bound, (kind, relief, offset, cell)


@pytest.mark.parametrize("name", list(references.fields()))
def test_uniform_light_is_pi_times_the_sky_view(name: str) -> None:
    for relief, offset, cell in CASES:
        terrain = adret.Terrain(heights(name, relief, offset, cell), (cell, cell))
        light = adret.direct_light(terrain, adret.UniformSky(), directions=DIRECTIONS).irradiance
        view = adret.sky_view_factor(terrain, "normal", directions=DIRECTIONS)
        np.testing.assert_allclose(light, np.pi * view, atol=4e-6, rtol=0)


@pytest.mark.parametrize("name", ["flat", "plane"])
@pytest.mark.parametrize("offset", [0.0, 1e7])
def test_no_speckle_on_even_ground(name: str, offset: float) -> None:
    """Every cell of a plane has the same light and no shadow, whatever its height."""
    z = heights(name, 1.0, offset, 1.0)
    terrain = adret.Terrain(z, (1.0, 1.0))
    east, north = slopes(z, 1.0)
    sun = adret.Sun(200.0, 60.0)
    shade = adret.shadow(terrain, sun)
    assert (shade.code == 0).all()
    assert (shade.lit == 1.0).all()
    light = adret.direct_light(terrain, sun).irradiance
    assert np.ptp(light) <= 1e-6 * light.max()
    view = adret.sky_view_factor(terrain, "normal")
    slope = math.atan(math.hypot(east[4, 4], north[4, 4]))
    np.testing.assert_allclose(view, (1.0 + math.cos(slope)) / 2.0, atol=2e-6, rtol=0)


@pytest.mark.parametrize("shape", SHAPES)
def test_smallest_rasters_have_light_and_sight(shape: tuple[int, int]) -> None:
    z = np.random.default_rng(1).random(shape)
    terrain = adret.Terrain(z, (1.0, 1.0))
    for kind in ("visible", "horizontal", "normal"):
        view = adret.sky_view_factor(terrain, kind=kind, directions=8)
        assert view.shape == shape
        assert ((view >= 0.0) & (view <= 1.0 + 1e-6)).all()
    assert np.isfinite(
        adret.direct_light(terrain, adret.UniformSky(), directions=8).irradiance
    ).all()
    bounced = adret.indirect_light(terrain, adret.UniformSky(), 0.5, directions=8)
    assert (bounced.irradiance >= 0.0).all()
    seen = adret.intervisibility(terrain, directions=8)
    assert seen.offsets.size == 8 * z.size + 1


def test_nodata_in_every_position_is_nodata_there_alone() -> None:
    z = references.fields()["noise"][:4, :5]
    for row, column in np.ndindex(z.shape):
        holed = z.copy()
        holed[row, column] = np.nan
        terrain = adret.Terrain(holed, (1.0, 1.0))
        where = np.isnan(holed)
        sky = adret.direct_light(terrain, adret.UniformSky(), directions=8)
        bounced = adret.indirect_light(terrain, adret.UniformSky(), 0.5, directions=8)
        for layer in (
            adret.sky_view_factor(terrain, directions=8),
            adret.openness(terrain, directions=8),
            sky.irradiance,
            bounced.irradiance,
            adret.shadow(terrain, adret.Sun(30.0, 20.0)).lit,
        ):
            np.testing.assert_array_equal(np.isnan(layer), where)
        seen = adret.intervisibility(terrain, directions=8)
        hole = (np.arange(8) * z.size) + row * z.shape[1] + column
        assert (seen.offsets[hole + 1] == seen.offsets[hole]).all()


@pytest.mark.parametrize("power", [-15, 9])
def test_powers_of_two_change_no_byte_of_any_engine(power: int) -> None:
    z = references.fields()["rough"].astype(np.float32).astype(np.float64) * 8.0
    found = []
    for scale in (1.0, 2.0**power):
        terrain = adret.Terrain(z * scale, (scale, scale), datum=0.0)
        sky = adret.direct_light(terrain, adret.UniformSky(), directions=8)
        bounced = adret.indirect_light(terrain, adret.UniformSky(), 0.5, directions=8)
        seen = adret.intervisibility(terrain, directions=8)
        found.append(
            [
                each.tobytes()
                for each in (
                    adret.sky_view_factor(terrain, "normal", directions=8),
                    adret.openness(terrain, directions=8),
                    sky.irradiance,
                    bounced.irradiance,
                    seen.steps,
                    seen.offsets,
                )
            ]
        )
    assert found[0] == found[1]


@pytest.mark.parametrize("offset", [1e4, 1e7])
def test_lifting_the_ground_changes_no_byte_of_any_engine(offset: float) -> None:
    """Millimetres of relief that float32 could not hold at that height."""
    z = np.round(references.fields()["rough"] * 50.0) * 2.0**-10
    found = []
    for lift in (0.0, offset):
        terrain = adret.Terrain(z + lift, (1.0, 1.0), datum=lift)
        sky = adret.direct_light(terrain, adret.UniformSky(), directions=8)
        bounced = adret.indirect_light(terrain, adret.UniformSky(), 0.5, directions=8)
        seen = adret.intervisibility(terrain, directions=8)
        arrays = (sky.irradiance, bounced.irradiance, seen.steps, seen.offsets)
        found.append([each.tobytes() for each in arrays])
    assert found[0] == found[1]


@pytest.mark.parametrize("name", ["rough", "towers", "comb", "stairs", "cliff"])
def test_bounces_keep_energy(name: str) -> None:
    """No cell receives more by bounces than all the ground together could send it."""
    for relief, offset, cell in CASES:
        terrain = adret.Terrain(heights(name, relief, offset, cell), (cell, cell))
        sky = adret.direct_light(terrain, adret.UniformSky(), directions=8)
        bounced = adret.indirect_light(terrain, adret.UniformSky(), 0.5, directions=8)
        light = bounced.irradiance
        assert np.isfinite(light).all()
        assert (light >= 0.0).all()
        assert light.max() <= sky.irradiance.max() * (1.0 + 1e-5)


@pytest.mark.slow
def test_neighbours_along_an_axis_always_see_each_other() -> None:
    for name, (relief, offset, cell) in itertools.product(references.fields(), CASES):
        terrain = adret.Terrain(heights(name, relief, offset, cell), (cell, cell))
        seen = adret.intervisibility(terrain, directions=4)
        rows, columns = terrain.shape
        for row, column in itertools.product(range(1, rows - 1), range(1, columns - 1)):
            for k in range(4):
                assert seen.visible(row, column, k)[0].size > 0
