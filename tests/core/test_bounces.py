"""Indirect light: closed forms, slow twins, energy, what is skipped, errors."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import adret
import scenes
from adret import bounces, transport
from adret._kernels.jit import threads
from adret.horizon import HorizonOptions

Array = NDArray[np.float64]
CELL = (2.0, 3.0)


def terrain_of(scene: scenes.Scene) -> adret.Terrain:
    return adret.Terrain(scene.heights, scene.cell_size)


def rough(shape: tuple[int, int], holes: float = 0.04, relief: float = 40.0) -> adret.Terrain:
    rng = np.random.default_rng(5)
    z = scenes.fractal(rng, shape, relief=relief)
    z[rng.random(shape) < holes] = np.nan
    return adret.Terrain(z, CELL)


# --- slow twins: plain loops in float64 -----------------------------------------------------------


def slope_at(z: Array, row: int, column: int, cell: tuple[float, float]) -> tuple[float, float]:
    """Rise towards east and north: central differences, one-sided beside nodata and the edge."""

    def step(before: float, after: float) -> float:
        known = [d for d in (before, after) if not math.isnan(d)]
        return sum(known) / len(known) if known else 0.0

    def height(r: int, c: int) -> float:
        inside = 0 <= r < z.shape[0] and 0 <= c < z.shape[1]
        return float(z[r, c]) if inside else math.nan

    here = height(row, column)
    east = step(here - height(row, column - 1), height(row, column + 1) - here) / cell[0]
    north = step(here - height(row + 1, column), height(row - 1, column) - here) / cell[1]
    return east, north


def crossings(
    z: Array, light: Array, row: int, column: int, azimuth: float, cell: tuple[float, float],
    near: float, bend: float,
) -> list[tuple[float, float, float]]:  # fmt: skip
    """(distance, height, radiance) where the ray meets grid lines, from the receiver outwards."""
    down, right = -math.cos(azimuth) / cell[1], math.sin(azimuth) / cell[0]
    down, right = (0.0 if abs(d) < 1e-12 else d for d in (down, right))
    major = max(abs(down), abs(right))
    found: dict[float, tuple[float, float]] = {}
    for along_rows, pace in ((True, down), (False, right)):
        if pace == 0.0:
            continue
        for line in range(1, sum(z.shape)):
            way = line / abs(pace)
            if abs(pace) < major * (1.0 - 1e-9) and way * major > near + 1e-9:
                continue
            r, c = row + down * way, column + right * way
            r, c = (round(r), c) if along_rows else (r, round(c))
            r, c = (round(v) if abs(v - round(v)) < 1e-7 else v for v in (r, c))
            if not (0 <= r <= z.shape[0] - 1 and 0 <= c <= z.shape[1] - 1):
                continue
            one, other = (math.floor(r), math.floor(c)), (math.ceil(r), math.ceil(c))
            w = (c - math.floor(c)) if along_rows else (r - math.floor(r))
            height = float((1 - w) * z[one] + w * z[other])
            sent = float((1 - w) * light[one] + w * light[other])
            found.setdefault(round(way, 9), (height - bend * way * way, sent))
    profile = [(0.0, float(z[row, column]), float(light[row, column]))]
    return profile + [(way, *found[way]) for way in sorted(found)]


def moment(slope: float, plane: float) -> float:
    e = math.atan(slope)
    along = (math.pi / 2 - e - math.sin(e) * math.cos(e)) / 2
    return math.cos(e) ** 2 / 2 - plane * along


def slow_bounce(
    z: Array, light: Array, directions: int, cell: tuple[float, float] = CELL,
    near: float = math.inf, bend: float = 0.0,
) -> Array:  # fmt: skip
    """Irradiance by bands of rising slope."""
    out = np.full(z.shape, np.nan)
    for row, column in zip(*np.nonzero(~np.isnan(z)), strict=True):
        east, north = slope_at(z, row, column, cell)
        total = whole = 0.0
        for k in range(directions):
            azimuth = 2 * math.pi * k / directions
            plane = east * math.sin(azimuth) + north * math.cos(azimuth)
            top = plane
            whole += moment(plane, plane)
            profile = crossings(z, light, row, column, azimuth, cell, near, bend)
            for before, (way, height, sent) in pairwise(profile):
                slope = (height - profile[0][1]) / way
                if not slope > top:  # also where the height is NaN
                    continue
                over = height - profile[0][1] - top * way
                under = max(top * before[0] - (before[1] - profile[0][1]), 0.0)
                share = over / (over + under) if over > 0.0 else 0.0
                share = 0.0 if math.isnan(share) else share  # beside nodata
                sight = (1 - share) * sent + (share * before[2] if share else 0.0)
                total += (sent + sight) / 2 * (moment(top, plane) - moment(slope, plane))
                top = slope
        out[row, column] = math.pi * total / whole
    return out


def ray_by_ray(z: Array, light: Array, directions: int, cell: tuple[float, float]) -> Array:
    """Irradiance by rays at many elevations, each with its own point of the surface."""
    steps = 1500
    elevation = (np.arange(steps) + 0.5) * math.pi / steps - math.pi / 2
    out = np.zeros(z.shape)
    for row, column in np.ndindex(z.shape):
        east, north = slope_at(z, row, column, cell)
        up = 1 / math.sqrt(1 + east**2 + north**2)
        for k in range(directions):
            azimuth = 2 * math.pi * k / directions
            plane = east * math.sin(azimuth) + north * math.cos(azimuth)
            facing = np.maximum(up * (np.sin(elevation) - plane * np.cos(elevation)), 0.0)
            profile = np.array(crossings(z, light, row, column, azimuth, cell, math.inf, 0.0))
            way, height, sent = profile.T
            line = z[row, column] + np.tan(elevation)[:, None] * way[None, 1:]
            hit = line < height[None, 1:]
            if not hit.any():
                continue
            first = hit.argmax(axis=1)
            seen = hit[np.arange(steps), first]
            j = first[seen]
            gap0 = line[seen, np.maximum(j - 1, 0)] - height[j]
            gap0[j == 0] = 0.0
            gap1 = height[j + 1] - line[seen, j]
            t = np.maximum(gap0, 0.0) / (np.maximum(gap0, 0.0) + gap1)
            radiance = np.zeros(steps)
            radiance[seen] = (1 - t) * sent[j] + t * sent[j + 1]
            # On its own facet the ray leaves along the surface: half its radiance is the cell's.
            own = np.flatnonzero(seen)[j == 0]
            radiance[own] = (sent[0] + sent[1]) / 2
            weight = facing * np.cos(elevation) * (math.pi / steps)
            out[row, column] += (radiance * weight).sum() * 2 * math.pi / directions
    return out


def one_bounce(terrain: adret.Terrain, light: Any, directions: int, **more: Any) -> Any:
    return adret.indirect_light(
        terrain, None, 0.5, radiance=light, directions=directions, **more
    ).irradiance


@pytest.mark.parametrize(("directions", "near"), [(8, 0), (12, 5), (10, 4096)])
def test_one_bounce_is_the_slow_twin(directions: int, near: int) -> None:
    terrain = rough((15, 37))
    light = np.random.default_rng(1).random(terrain.shape)
    got = one_bounce(terrain, light, directions, near=near)
    want = slow_bounce(terrain.heights.astype(float), np.nan_to_num(light), directions, near=near)
    np.testing.assert_array_equal(np.isnan(got), terrain.mask)
    np.testing.assert_allclose(got, want, rtol=2e-4, atol=2e-5)


def test_planets_are_round() -> None:
    terrain = rough((15, 27), holes=0.0)
    light = np.random.default_rng(2).random(terrain.shape)
    got = one_bounce(terrain, light, 12, radius=500.0, refraction=0.2, near=9)
    want = slow_bounce(terrain.heights.astype(float), light, 12, near=9, bend=0.8 / (2.0 * 500.0))
    np.testing.assert_allclose(got, want, rtol=3e-4, atol=2e-5)
    assert abs(got - one_bounce(terrain, light, 12, near=9)).max() > 0.01


def test_bands_are_the_sum_over_single_rays() -> None:
    scene = scenes.bowl(np.radians(70), size=21, fill=0.9)
    light = 1.0 + 0.5 * np.sin(np.arange(441.0).reshape(21, 21) / 40.0)
    got = one_bounce(terrain_of(scene), light, 16)
    want = ray_by_ray(scene.heights, light, 16, scene.cell_size)
    assert abs(got - want).mean() < 0.004 * want.mean()
    assert abs(got - want).max() < 0.02 * want.max()


# --- closed forms ---------------------------------------------------------------------------------

BOWL = np.radians(70.0)
BOWL_VIEW = (1.0 - np.cos(BOWL)) / 2.0
SUN_ONE, SUN_ALL = 0.055977, 0.069744  # albedo 0.6, sun 25 degrees high


@pytest.mark.parametrize(
    ("size", "directions", "mean", "most"),
    [
        (129, 64, 0.01, 0.025),
        pytest.param(513, 64, 0.002, 0.012, marks=pytest.mark.slow),
    ],
)
def test_bowl_has_the_same_indirect_light_everywhere(
    size: int, directions: int, mean: float, most: float
) -> None:
    scene = scenes.bowl(BOWL, size=size)
    terrain = terrain_of(scene)
    sun = adret.Sun(30.0, 25.0)
    first = adret.direct_light(terrain, sun).radiance(0.6)
    for count, want in ((1, SUN_ONE), ("converge", SUN_ALL)):
        light = adret.indirect_light(
            terrain, None, 0.6, radiance=first, bounces=count, directions=directions
        )
        off = light.irradiance[scene.where] / want - 1.0
        assert abs(off.mean()) < mean
        assert np.quantile(abs(off), 0.99) < (0.01 if size > 500 else 0.015)
        assert abs(off).max() < most
    assert light.bounces >= 5
    assert light.residual <= 1e-3


@pytest.mark.parametrize("size", [129, pytest.param(513, marks=pytest.mark.slow)])
def test_bowl_under_a_uniform_sky(size: int) -> None:
    """E_s (1 - f) / (1 - albedo f) in all."""
    scene = scenes.bowl(BOWL, size=size)
    picture = adret.render(terrain_of(scene), adret.UniformSky(), 0.6, "converge", directions=64)
    want = np.pi * (1.0 - BOWL_VIEW) / (1.0 - 0.6 * BOWL_VIEW)
    got = picture.direct.irradiance + picture.indirect.irradiance
    off = got[scene.where] / want - 1.0
    assert abs(off.mean()) < (0.002 if size > 500 else 0.006)
    assert abs(off).max() < (0.01 if size > 500 else 0.015)
    np.testing.assert_allclose(picture.radiance, 0.6 / np.pi * got, rtol=1e-5)


def test_planes_see_no_terrain() -> None:
    for slope in (0.0, 35.0, 65.0):
        plane = terrain_of(scenes.plane(np.radians(slope), 2.0, cell_size=CELL))
        light = adret.indirect_light(plane, adret.UniformSky(), 0.9, bounces=3, directions=16)
        assert abs(light.irradiance).max() < 2e-5
        assert light.residual < 1e-4


def test_facing_walls_send_half() -> None:
    """Foot of an endless V valley of slope S: terrain of radiance 1 sends π (1 - cos S)."""
    slope = np.radians(50.0)
    scene = scenes.valley(slope)
    got = one_bounce(terrain_of(scene), 1.0, 256)
    floor = scene.heights.shape[0] // 2, scene.heights.shape[1] // 2
    assert got[floor] == pytest.approx(np.pi * (1.0 - np.cos(slope)), rel=0.01)


# --- energy ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("directions", [3, 8, 32])
def test_energy_never_grows(directions: int) -> None:
    """The largest row sum is below 1, and so is the spectral radius, even of white ground."""
    z = np.random.default_rng(4).random((40, 40)) * 60.0
    terrain = adret.Terrain(z, (1.0, 1.0))
    bounce = transport.Transport(terrain, adret.azimuth_set(directions), HorizonOptions())
    light = np.ones((1, *terrain.shape), np.float32)
    norms = []
    for _ in range(60):
        received = bounce(light) / np.float32(np.pi)
        assert received.max() <= light.max() * (1.0 + 1e-6)
        norms.append(float(np.linalg.norm(received) / np.linalg.norm(light)))
        light = received / received.max()
    assert 0.3 < norms[-1] < 1.0
    assert bounce.view.max() <= 1.0


def test_sky_and_terrain_share_the_view() -> None:
    terrain = rough((60, 70))
    light = one_bounce(terrain, 1.0, 64, near=4096)
    sky = adret.sky_view_factor(terrain, "normal", 64, clip=False, method="exact")
    np.testing.assert_allclose((light / np.pi + sky)[~terrain.mask], 1.0, atol=2e-5)


def test_bounces_add_up() -> None:
    terrain = rough((40, 50))
    first = np.random.default_rng(3).random(terrain.shape)
    want = np.zeros(terrain.shape)
    sent = first
    for count in range(1, 4):
        light = adret.indirect_light(
            terrain, None, 0.7, radiance=first, bounces=count, directions=16
        )
        add = one_bounce(terrain, np.nan_to_num(sent), 16)
        want += add
        sent = 0.7 / np.pi * add
        np.testing.assert_allclose(light.irradiance, want, rtol=1e-5)
        assert light.bounces == count


def test_residual_bounds_what_is_left() -> None:
    terrain = rough((40, 50))
    runs = {
        n: adret.indirect_light(terrain, adret.OvercastSky(), 0.8, bounces=n, directions=8)
        for n in (1, 2, 4, 40)
    }
    final = runs[40].irradiance
    for n in (1, 2, 4):
        left = np.nanmax(final - runs[n].irradiance) / np.nanmax(runs[n].irradiance)
        assert 0.0 < left <= runs[n].residual
    residuals = [light.residual for light in runs.values()]
    assert residuals == sorted(residuals, reverse=True)


# --- albedo, emission, colour ---------------------------------------------------------------------


def test_colours_are_independent() -> None:
    terrain = rough((30, 40))
    albedo = np.array([0.2, 0.5, 0.9], np.float32)
    colour = adret.indirect_light(terrain, adret.UniformSky(), albedo, bounces=2, directions=12)
    assert colour.irradiance.shape == (*terrain.shape, 3)
    for band, share in enumerate(albedo):
        grey = adret.indirect_light(terrain, adret.UniformSky(), share, bounces=2, directions=12)
        np.testing.assert_allclose(colour.irradiance[..., band], grey.irradiance, rtol=1e-5)


def test_cells_have_their_own_albedo() -> None:
    terrain = rough((30, 40))
    rng = np.random.default_rng(6)
    albedo = rng.random((*terrain.shape, 3))
    albedo[3, 4] = np.nan
    light = adret.indirect_light(terrain, adret.UniformSky(), albedo, directions=12)
    first = adret.direct_light(terrain, adret.UniformSky(), 12).irradiance / np.pi
    for band in range(3):
        sent = np.nan_to_num(first * albedo[..., band])
        np.testing.assert_allclose(
            light.irradiance[..., band], one_bounce(terrain, sent, 12), rtol=1e-5, atol=1e-7
        )


def test_lava_lights_its_valley_at_night() -> None:
    scene = scenes.bowl(BOWL, size=65)
    terrain = terrain_of(scene)
    lava = np.zeros(terrain.shape)
    lava[30:35, 30:35] = 100.0
    night = adret.Sun(0.0, -30.0)
    one = adret.indirect_light(terrain, night, 0.3, emission=lava, directions=64)
    np.testing.assert_allclose(one.irradiance, one_bounce(terrain, lava, 64), rtol=1e-6, atol=1e-7)
    # Every point of a bowl sees an equal share of a small patch: E = L area / (4 r²).
    area = 25.0
    radius = 0.4 * 65.0 / np.sin(BOWL)
    away = np.hypot(*scenes.metres(terrain.shape, (1.0, 1.0)))
    ring = (away > 12.0) & (away < 22.0)
    want = 100.0 * area / (4.0 * radius**2)
    assert one.irradiance[ring].mean() == pytest.approx(want, rel=0.05)
    picture = adret.render(terrain, night, 0.3, 2, emission=lava, directions=16)
    assert picture.radiance[32, 32] >= 100.0
    assert (picture.direct.irradiance == 0.0).all()


def test_render_is_direct_and_indirect() -> None:
    terrain = rough((30, 40))
    sky = adret.OvercastSky(2.0)
    albedo = np.full(terrain.shape, 0.4)
    picture = adret.render(terrain, sky, albedo, 2, directions=16, emission=0.25)
    direct = adret.direct_light(terrain, sky, 16)
    indirect = adret.indirect_light(terrain, sky, albedo, bounces=2, directions=16, emission=0.25)
    np.testing.assert_allclose(picture.direct.irradiance, direct.irradiance)
    np.testing.assert_allclose(picture.indirect.irradiance, indirect.irradiance, rtol=1e-6)
    want = 0.4 / np.pi * (direct.irradiance + indirect.irradiance) + 0.25
    np.testing.assert_allclose(picture.radiance, want, rtol=1e-5)
    bare = adret.render(terrain, sky, albedo, 0, directions=16)
    np.testing.assert_array_equal(bare.radiance, direct.radiance(albedo))
    assert (bare.indirect.irradiance[~terrain.mask] == 0.0).all()
    colour = adret.render(terrain, sky, [0.1, 0.2, 0.3], 1, directions=8)
    assert colour.radiance.shape == (*terrain.shape, 3)


# --- symmetries, threads, bands -------------------------------------------------------------------


def test_turned_terrain_has_turned_light() -> None:
    z = scenes.fractal(np.random.default_rng(8), (37, 150), relief=30.0)
    light = np.random.default_rng(9).random(z.shape)
    want = one_bounce(adret.Terrain(z, (1.0, 1.0)), light, 24)
    for turn in (np.flipud, np.fliplr, np.rot90, np.transpose):
        got = one_bounce(adret.Terrain(turn(z), (1.0, 1.0)), turn(light), 24)
        np.testing.assert_allclose(got, turn(want), rtol=2e-5, atol=2e-6)
    scaled = one_bounce(adret.Terrain(3.0 * z, (3.0, 3.0)), light, 24)
    np.testing.assert_allclose(scaled, want, rtol=1e-4, atol=1e-5)


def test_threads_do_not_change_a_byte() -> None:
    terrain = rough((50, 300))
    count = threads()
    many = adret.indirect_light(terrain, adret.UniformSky(), 0.5, bounces=2, directions=8)
    try:
        threads(1)
        one = adret.indirect_light(terrain, adret.UniformSky(), 0.5, bounces=2, directions=8)
    finally:
        threads(count)
    assert one.irradiance.tobytes() == many.irradiance.tobytes()


def test_latitude_bands_meet(monkeypatch: pytest.MonkeyPatch) -> None:
    from affine import Affine

    z = scenes.fractal(np.random.default_rng(10), (80, 60), relief=2000.0)
    where = Affine(0.02, 0.0, 7.0, 0.0, -0.02, 61.0)
    terrain = adret.Terrain(z, crs=4326, transform=where)
    one = adret.indirect_light(terrain, adret.UniformSky(), 0.5, directions=12)
    assert one.report.bands == 2
    monkeypatch.setattr("adret.transport.MAX_AZIMUTH_ERROR", math.radians(0.05))
    many = adret.indirect_light(terrain, adret.UniformSky(), 0.5, directions=12)
    assert many.report.bands > 3
    off = abs(many.irradiance - one.irradiance)
    assert off.mean() < 0.02 * one.irradiance.mean()
    assert off.max() > 0.0


# --- what is skipped ------------------------------------------------------------------------------


def test_later_bounces_know_where_nothing_is_visible() -> None:
    terrain = rough((60, 260))
    light = np.random.default_rng(11).random((1, *terrain.shape)).astype(np.float32)
    azimuths = adret.azimuth_set(12)
    known = transport.Transport(terrain, azimuths, HorizonOptions())
    known(np.ones_like(light))
    tested = known.work.crossings_tested
    again = known(light)
    assert known.work.crossings_tested - tested < 0.9 * tested
    fresh = transport.Transport(terrain, azimuths, HorizonOptions())
    assert fresh(light).tobytes() == again.tobytes()


def test_blocks_that_nobody_sees_change_no_byte(monkeypatch: pytest.MonkeyPatch) -> None:
    terrain = rough((90, 300))
    light = np.random.default_rng(13).random(terrain.shape)

    def run() -> tuple[bytes, bounces.BounceReport]:
        found = adret.indirect_light(terrain, None, 0.5, radiance=light, directions=12)
        assert isinstance(found.report, bounces.BounceReport)
        return found.irradiance.tobytes(), found.report

    some, report = run()
    assert report.crossings_hidden > 0.1 * report.crossings_tested
    monkeypatch.setattr(transport.kernels, "tile_tops", lambda z, tops: tops.fill(np.inf))
    every, full = run()
    assert full.crossings_hidden < 1e-3 * report.crossings_hidden  # blocks of nodata receivers
    assert full.crossings_tested > 1.3 * report.crossings_tested
    assert full.crossings_weighed == report.crossings_weighed
    assert every == some


def test_dark_senders_are_not_added_up(monkeypatch: pytest.MonkeyPatch) -> None:
    terrain = rough((90, 300))
    lava = np.zeros(terrain.shape)
    lava[40:44, 150:154] = 9.0
    some = adret.indirect_light(terrain, None, 0.0, radiance=lava, directions=12)
    monkeypatch.setattr(transport.kernels, "tile_lights", lambda light, lit: lit.fill(True))
    every = adret.indirect_light(terrain, None, 0.0, radiance=lava, directions=12)
    assert isinstance(some.report, bounces.BounceReport)
    assert isinstance(every.report, bounces.BounceReport)
    assert every.report.crossings_dark == 0
    assert some.report.crossings_weighed < 0.3 * every.report.crossings_weighed
    both = some.report.crossings_weighed + some.report.crossings_dark
    assert both == pytest.approx(every.report.crossings_weighed, rel=1e-3)
    # A slope is rounded one way where it is only compared and another where light is added.
    np.testing.assert_allclose(some.irradiance, every.irradiance, rtol=1e-5, atol=1e-6)


def test_no_light_walks_no_ray() -> None:
    terrain = rough((30, 40))
    light = adret.indirect_light(terrain, adret.Sun(0.0, -40.0), 0.5, bounces=4)
    assert (light.irradiance[~terrain.mask] == 0.0).all()
    assert np.isnan(light.irradiance[terrain.mask]).all()
    assert (light.bounces, light.residual) == (0, 0.0)
    assert (light.report.azimuths_swept, light.report.azimuths_skipped) == (0, 32)
    black = adret.indirect_light(terrain, adret.UniformSky(), 0.0, bounces="converge")
    assert (black.irradiance[~terrain.mask] == 0.0).all()


def plain_and_mountains() -> adret.Terrain:
    z = np.zeros((120, 400))
    z[:, 300:] = scenes.fractal(np.random.default_rng(12), (120, 100), relief=60.0)
    z[:, 300:310] *= np.linspace(0.0, 1.0, 10)
    return adret.Terrain(z, (1.0, 1.0))


def test_converged_cells_walk_no_ray() -> None:
    terrain = plain_and_mountains()
    some = adret.indirect_light(
        terrain, adret.UniformSky(), 0.7, bounces="converge", tolerance=1e-3, directions=12
    )
    every = adret.indirect_light(terrain, adret.UniformSky(), 0.7, bounces=40, directions=12)
    assert isinstance(some.report, bounces.BounceReport)
    assert some.report.receivers_skipped > 0.1 * some.report.receivers
    off = np.nanmax(abs(every.irradiance - some.irradiance)) / np.nanmax(some.irradiance)
    assert off <= some.residual <= 1e-3


def test_cells_that_see_no_terrain_walk_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a plain whose mountains are out of reach."""
    terrain = plain_and_mountains()
    options: dict[str, Any] = {"bounces": 3, "directions": 12, "max_distance": 100.0}
    some = adret.indirect_light(terrain, adret.UniformSky(), 0.7, **options)
    assert isinstance(some.report, bounces.BounceReport)
    blind = terrain.mask.size // 4  # the half of the plain that is 150 cells or more away
    assert some.report.receivers_skipped > 2 * 12 * blind
    monkeypatch.setattr(
        bounces.Rest, "needed", lambda self, view: (np.ones(view.shape, np.bool_), view)
    )
    every = adret.indirect_light(terrain, adret.UniformSky(), 0.7, **options)
    assert isinstance(every.report, bounces.BounceReport)
    assert every.report.receivers_skipped == 0
    assert every.irradiance.tobytes() == some.irradiance.tobytes()


# --- edges and errors -----------------------------------------------------------------------------


def test_small_and_empty_terrains() -> None:
    for z in (np.zeros((1, 1)), np.array([[0.0, 5.0]]), np.array([[0.0], [np.nan], [3.0]])):
        light = adret.indirect_light(adret.Terrain(z, (1.0, 1.0)), adret.UniformSky(), 0.5)
        np.testing.assert_array_equal(np.isnan(light.irradiance), np.isnan(z))
    hole = adret.Terrain(np.array([[1.0, np.nan]]), (1.0, 1.0)).window((0, 1), (1, 2))
    assert np.isnan(adret.indirect_light(hole, adret.UniformSky(), 0.5).irradiance).all()


def test_range_is_a_limit() -> None:
    wall = np.zeros((3, 60))
    wall[:, 40] = 30.0
    terrain = adret.Terrain(wall, (1.0, 1.0))
    light = one_bounce(terrain, 1.0, 4, max_distance=15.0)
    assert (light[1, :25] == 0.0).all()
    assert (light[1, 26:40] > 0.0).all()


def test_progress_counts_and_cancels() -> None:
    terrain = rough((20, 30))
    calls: list[tuple[int, int]] = []
    adret.indirect_light(
        terrain, None, 0.5, radiance=1.0, bounces=3, directions=8,
        progress=lambda done, total: calls.append((done, total)),
    )  # fmt: skip
    assert calls == [(k + 1, 24) for k in range(24)]

    def stop(done: int, total: int) -> None:
        raise adret.Cancelled

    with pytest.raises(adret.Cancelled):
        adret.indirect_light(terrain, adret.UniformSky(), 0.5, progress=stop)


def test_errors_name_the_field() -> None:
    terrain = rough((10, 12))
    sky = adret.UniformSky()
    cases: list[tuple[str, dict[str, Any]]] = [
        ("terrain", {"terrain": np.zeros((3, 3))}),
        ("sky", {"sky": None}),
        ("sky", {"sky": "sunny"}),
        ("albedo", {"albedo": 1.2}),
        ("albedo", {"albedo": np.zeros((4, 4))}),
        ("radiance", {"radiance": -1.0}),
        ("radiance", {"radiance": np.zeros((2, 2))}),
        ("emission", {"emission": np.inf}),
        ("emission", {"emission": "hot"}),
        ("bounces", {"bounces": 0}),
        ("bounces", {"bounces": True}),
        ("bounces", {"bounces": "many"}),
        ("directions", {"directions": 0}),
        ("tolerance", {"tolerance": 0.0}),
        ("tolerance", {"tolerance": "tight"}),
        ("near", {"near": -1}),
        ("max_distance", {"max_distance": 0.0}),
    ]
    for field, wrong in cases:
        given: dict[str, Any] = {"terrain": terrain, "sky": sky, "albedo": 0.5, **wrong}
        with pytest.raises(adret.InputError) as caught:
            adret.indirect_light(**given)
        assert caught.value.field == field
