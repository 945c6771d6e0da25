"""Viewsheds and lines of sight: known heights, exact arithmetic, symmetry, limits, errors."""

import json
import math
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from affine import Affine

import adret
from adret import (
    InputError,
    Terrain,
    cells_at,
    intervisibility,
    line_of_sight,
    total_viewshed,
    viewshed,
)
from adret._kernels import jit
from adret.parameters import sights
from adret.viewsheds import BITS
from sight_oracle import seen_in_whole_numbers, sight


def terrain_of(heights: Any, cell_size: tuple[float, float] = (1.0, 1.0), **named: Any) -> Terrain:
    """Heights as they are: no datum is taken off."""
    return Terrain(np.asarray(heights, dtype=np.float32), cell_size, datum=0.0, **named)


def rough(rng: np.random.Generator, rows: int, columns: int) -> np.ndarray:
    walk = rng.normal(0.0, 1.0, (rows, columns)).cumsum(0).cumsum(1)
    return (3.0 * walk / (1.0 + np.abs(walk).max() / 30.0)).astype(np.float32)


# ---------------------------------------------------------------- known answers


def test_profiles_have_the_heights_worked_out_by_hand(data_dir: Path) -> None:
    cases = json.loads((data_dir / "truth" / "viewshed_small_cases.json").read_text())
    for case in cases["profiles"]:
        terrain = terrain_of([case["dem"]])
        observer = (0, case["observer"])
        seen = viewshed(terrain, observer, observer_height=0.0)
        np.testing.assert_array_equal(seen.minimum_height[0], np.float32(case["above_ground"]))
        for column, lowest in enumerate(case["min_visible_height"]):
            if abs(column - case["observer"]) < 2:
                continue  # nothing stands before a neighbour
            one = line_of_sight(terrain, observer, (0, column), observer_height=0.0)
            assert one.grazing_elevation == pytest.approx(lowest, abs=1e-12)
            assert one.minimum_height == pytest.approx(case["above_ground"][column], abs=1e-12)


def test_small_grid_agrees_where_rays_pass_through_cells_alone(data_dir: Path) -> None:
    case = json.loads((data_dir / "truth" / "viewshed_small_cases.json").read_text())[
        "simple_height"
    ]
    terrain = terrain_of(case["dem"])
    seen = viewshed(terrain, (2, 2), observer_height=0.0)
    for row, column in product(range(5), range(5)):
        across = (abs(row - 2), abs(column - 2))
        if max(across) == 2 and (0 in across or across[0] == across[1]):
            one = line_of_sight(terrain, (2, 2), (row, column), observer_height=0.0)
            assert one.grazing_elevation == case["observable"][row][column]
            assert seen.visible[row, column] == case["visible"][row][column]
    assert seen.visible[1:4, 1:4].all()


def test_a_tower_hides_the_ground_at_its_foot_as_far_as_its_rim_says() -> None:
    # T11: an eye 2 m above a platform 255 m high that ends after 15 m: 257 * 15 / 2 = 1927.5 m.
    heights = np.zeros((301, 301))
    heights[149:152, 149:152] = 255.0
    seen = viewshed(terrain_of(heights, (15.0, 15.0)), (150, 150), observer_height=2.0)
    away = 15.0 * np.maximum(*np.abs(np.mgrid[-150:151, -150:151]))
    np.testing.assert_array_equal(seen.visible, (away <= 15.0) | (away >= 1927.5))


def test_a_lone_post_hides_nothing_from_its_top() -> None:
    heights = np.zeros((41, 41))
    heights[20, 20] = 255.0
    seen = viewshed(terrain_of(heights, (15.0, 15.0)), (20, 20), observer_height=2.0)
    assert seen.visible.all()


def test_a_wall_throws_a_sight_shadow_of_the_height_that_similar_triangles_give() -> None:
    heights = np.zeros((61, 61))
    heights[:, 40] = 10.0
    seen = viewshed(terrain_of(heights, (5.0, 5.0)), (30, 30), observer_height=4.0)
    columns = np.arange(41, 61)
    want = np.tile(4.0 + 6.0 * (columns - 30) / 10.0, (61, 1))
    np.testing.assert_allclose(seen.minimum_height[:, 41:], want, rtol=1e-6)
    assert seen.visible[:, :41].all()
    assert not seen.visible[:, 41:].any()


def test_beyond_the_sea_horizon_heights_grow_with_the_square_of_the_way() -> None:
    # The hidden height is c (d - a)², a = sqrt(eye / c); no step anywhere on the way (R11).
    radius, refraction, eye, size = 6_371_000.0, 0.13, 20.0, 100.0
    bend = (1.0 - refraction) / (2.0 * radius)
    seen = viewshed(
        terrain_of(np.zeros((1, 8001)), (size, size)),
        (0, 0),
        observer_height=eye,
        radius=radius,
        refraction=refraction,
    )
    way = size * np.arange(8001)
    horizon = math.sqrt(eye / bend)
    want = np.where(way > horizon, bend * (way - horizon) ** 2, 0.0)
    # The surface touches the line between two samples: c (size/2)² at most, seen from afar.
    np.testing.assert_allclose(
        seen.minimum_height[0], want, rtol=2e-7, atol=bend * size**2 * 8001 * size / horizon
    )
    np.testing.assert_array_equal(seen.visible[0, way < horizon - size], True)
    np.testing.assert_array_equal(seen.visible[0, way > horizon + size], False)
    assert (np.diff(seen.minimum_height[0][way > horizon + size]) > 0.0).all()


def test_distance_alone_hides_nothing() -> None:
    # R11: what is seen hangs on the shape, however long the cells are.
    heights = np.zeros((1, 400))
    heights[0, 200] = 1.0
    want = None
    for size in (1.0, 750_366.0 / 399, 750_367.0 / 399, 1e7):
        seen = viewshed(terrain_of(heights, (size, size)), (0, 0), observer_height=3.0)
        hidden = np.flatnonzero(~seen.visible[0])
        assert (hidden.min(), hidden.max()) == (201, 299)  # the eye is 3 times as high: to 300
        want = seen.minimum_height if want is None else want
        np.testing.assert_array_equal(seen.minimum_height, want)


# ---------------------------------------------------------------- the slow twin


@pytest.mark.parametrize("seed", range(12))
def test_every_target_gets_the_verdict_and_height_of_exact_arithmetic(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows, columns = (int(n) for n in rng.integers(1, 19, 2))
    if seed % 2:  # ties everywhere
        heights = rng.integers(0, 3, (rows, columns)).astype(np.float32)
        radius, eye, target = None, (0.0, 0.5)[seed % 4 == 1], 0.0
    else:
        heights = rough(rng, rows, columns)
        radius, eye, target = (None, 3000.0)[seed % 4 == 0], 1.5, (0.0, 2.25)[seed % 3 == 0]
    heights[rng.random(heights.shape) < 0.08] = np.nan
    heights[0, 0] = 1.0
    cell_size = ((1.0, 1.0), (1.0, 0.75))[seed % 3 == 1]
    terrain = terrain_of(heights, cell_size)
    observers = rng.permutation(np.argwhere(~np.isnan(heights)))[:6]
    for row, column in observers.tolist():
        here = (row, column)
        seen = viewshed(terrain, here, observer_height=eye, target_height=target, radius=radius)
        for there in np.ndindex(rows, columns):
            if here == there:
                want = (True, 0.0)
            elif np.isnan(heights[there]):
                want = (False, math.nan)
            else:
                way2 = ((there[0] - row) * cell_size[1]) ** 2
                way2 += ((there[1] - column) * cell_size[0]) ** 2
                fall = 0.0 if radius is None else way2 / (2.0 * radius)
                want = sight(heights, here, there, eye, target, fall)
            assert seen.visible[there] == want[0], (here, there)
            np.testing.assert_allclose(seen.minimum_height[there], want[1], rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(("target", "radius"), [(0.0, None), (0.1, None), (0.1, 4000.0)])
def test_on_level_ground_at_the_height_of_the_eye_touching_is_seeing(
    target: float, radius: float | None, rng: np.random.Generator
) -> None:
    # A lake: all crossings tie there, and only the first is looked at. Islands, a gap, a shore.
    heights = np.where(rng.random((23, 26)) < 0.04, rng.choice([-0.5, 0.25, 3.0], (23, 26)), 0.0)
    heights[9, 14] = np.nan
    heights[:, 24:] = 0.5 + rng.random((23, 2))
    heights = (heights + 117.3).astype(np.float32)
    for here in ((11, 12), (0, 0)):
        heights[here] = np.float32(117.3)
        terrain = terrain_of(heights)
        seen = viewshed(
            terrain, here, observer_height=0.0, target_height=target, radius=radius
        ).visible
        for row, column in rng.permutation(np.argwhere(~np.isnan(heights)))[:120].tolist():
            fall = 0.0
            if radius is not None:
                fall = ((row - here[0]) ** 2 + (column - here[1]) ** 2) / (2.0 * radius)
            want = (
                here == (row, column) or sight(heights, here, (row, column), 0.0, target, fall)[0]
            )
            assert seen[row, column] == want, (here, row, column)


def test_ten_thousand_pairs_on_a_real_mountain_agree_with_whole_numbers(example_dem: Path) -> None:
    terrain = Terrain.open(example_dem)
    rng = np.random.default_rng(7)
    scale = 2.0**24  # heights become whole numbers without rounding
    whole = (terrain.heights.astype(np.float64) * scale).astype(np.int64)
    assert (whole / scale == terrain.heights).all()
    pairs = 0
    for eye, target in ((0.0, 0.0), (1.75, 0.0), (30.5, 2.25)):
        cells = [np.unravel_index(i, terrain.shape) for i in rng.integers(whole.size, size=20)]
        for cell in cells:
            here = (int(cell[0]), int(cell[1]))
            seen = viewshed(terrain, here, observer_height=eye, target_height=target)
            ends = [np.unravel_index(i, terrain.shape) for i in rng.integers(whole.size, size=170)]
            aims = np.argwhere(seen.visible)  # the visible are few: half of the pairs
            ends += [tuple(aims[i]) for i in rng.integers(len(aims), size=170)]
            for end in ends:
                there = (int(end[0]), int(end[1]))
                if there != here:
                    want = seen_in_whole_numbers(
                        whole,
                        here,
                        there,
                        int(whole[here] + eye * scale),
                        int(whole[there] + target * scale),
                    )
                    assert seen.visible[there] == want, (here, there, eye, target)
                    pairs += 1
    assert pairs >= 10_000


def test_a_line_of_sight_says_what_the_viewshed_says(example_dem: Path) -> None:
    terrain = Terrain.open(example_dem)
    rng = np.random.default_rng(5)
    options: dict[str, Any] = {"observer_height": 1.7, "target_height": 0.3}
    options |= {"radius": terrain.body_radius, "refraction": 0.13}
    here = (155, 170)
    seen = viewshed(terrain, here, **options)
    for index in rng.integers(terrain.mask.size, size=150):
        there = divmod(int(index), terrain.shape[1])
        one = line_of_sight(terrain, here, there, **options)
        assert one.visible == seen.visible[there]
        assert one.minimum_height == pytest.approx(seen.minimum_height[there], rel=1e-6)
        assert one.visible == (one.obstruction is None)
        assert (np.diff(one.distance) > 0.0).all()
        clear = one.clearance[1:-1]
        if one.visible:
            assert clear.min(initial=np.inf) > -1e-9
        else:
            assert one.obstruction == 1 + np.flatnonzero(clear < 0.0)[0]


# ---------------------------------------------------------------- what must hold anywhere


@pytest.mark.parametrize("kind", ["rough", "plane", "steps"])
@pytest.mark.parametrize("height", [0.0, 1.6])
def test_seeing_is_mutual_to_the_last_bit(
    kind: str, height: float, rng: np.random.Generator
) -> None:
    rows, columns = np.mgrid[0:11, 0:12]
    heights = {
        "rough": rough(rng, 11, 12),
        "plane": (0.1 * rows + 0.3 * columns).astype(np.float32),  # ties that rounding decides
        "steps": rng.integers(0, 2, (11, 12)) * np.float32(0.1),
    }[kind]
    heights[4, 5] = np.nan
    terrain = terrain_of(heights, (0.7, 1.1))
    places = np.argwhere(~np.isnan(heights))
    for radius in (None, 500.0):
        table = np.stack(
            [
                viewshed(
                    terrain, place, observer_height=height, target_height=height, radius=radius
                ).visible[tuple(places.T)]
                for place in places
            ]
        )
        np.testing.assert_array_equal(table, table.T)
        assert table.diagonal().all()


def test_seeing_is_mutual_across_latitudes(rng: np.random.Generator) -> None:
    heights = 400.0 * rng.random((60, 20))
    terrain = Terrain(
        heights, crs="EPSG:4326", transform=Affine(0.05, 0.0, 10.0, 0.0, -0.05, 62.0), datum=0.0
    )
    assert len(terrain.latitude_bands(2e-4)) > 10
    options: dict[str, Any] = {"observer_height": 900.0, "target_height": 900.0}
    options |= {"radius": terrain.body_radius}
    places = [(0, 0), (7, 13), (30, 10), (59, 19), (45, 2)]
    table = [[viewshed(terrain, a, **options).visible[b] for b in places] for a in places]
    np.testing.assert_array_equal(table, np.transpose(table))
    assert 0 < np.sum(table) < 25


def test_neighbours_are_always_seen(rng: np.random.Generator) -> None:
    heights = 1000.0 * rng.random((9, 9))
    terrain = terrain_of(heights)
    for row, column in product(range(1, 8), range(1, 8)):
        seen = viewshed(terrain, (row, column), observer_height=0.0)
        assert seen.visible[row - 1 : row + 2, column - 1 : column + 2].all()
        assert (seen.minimum_height[row - 1 : row + 2, column - 1 : column + 2] == 0.0).all()


def test_what_is_seen_never_lies_below_ground(example_dem: Path) -> None:
    # R12: elevation = ground + height above it, and nothing is negative.
    terrain = Terrain.open(example_dem)
    seen = viewshed(terrain, [(100, 100), (200, 300)])
    assert (seen.minimum_height >= 0.0).all()
    np.testing.assert_array_equal(
        seen.minimum_elevation, terrain.elevations() + seen.minimum_height
    )
    np.testing.assert_array_equal(seen.visible, seen.minimum_height == 0.0)
    assert 0.01 < seen.visible.mean() < 0.5


@pytest.mark.parametrize("target", [0.0, 0.1, 20.0])
def test_a_target_is_seen_exactly_from_its_minimum_height_on(
    target: float, example_dem: Path
) -> None:
    terrain = Terrain.open(example_dem)
    seen = viewshed(terrain, (155, 170), target_height=target)
    np.testing.assert_array_equal(seen.visible, seen.minimum_height <= target)
    ground = viewshed(terrain, (155, 170))
    np.testing.assert_allclose(seen.minimum_height, ground.minimum_height, rtol=1e-6, atol=1e-6)


def test_nodata_hides_nothing_and_is_not_seen() -> None:
    heights = np.zeros((3, 9))
    heights[:, 4] = np.nan
    seen = viewshed(terrain_of(heights), (1, 1))
    np.testing.assert_array_equal(seen.visible, ~np.isnan(heights))
    np.testing.assert_array_equal(np.isnan(seen.minimum_height), np.isnan(heights))
    wall = np.zeros((1, 9))
    wall[0, 3:6] = (50.0, np.nan, 0.0)
    assert viewshed(terrain_of(wall), (0, 0)).minimum_height[0, 8] > 100.0


def test_turned_and_mirrored_terrain_has_the_turned_and_mirrored_viewshed(
    rng: np.random.Generator,
) -> None:
    heights = rough(rng, 17, 23)
    index = np.zeros(heights.shape, np.bool_)
    index[6, 15] = True
    options: dict[str, Any] = {"observer_height": 1.6, "radius": 2e4}
    want = viewshed(terrain_of(heights, (2.0, 3.0)), (6, 15), **options)
    for turn in (np.flipud, np.fliplr, np.transpose, np.rot90):
        size = (3.0, 2.0) if turn in (np.transpose, np.rot90) else (2.0, 3.0)
        place = tuple(int(i) for i in np.argwhere(turn(index))[0])
        got = viewshed(terrain_of(turn(heights), size), place, **options)
        np.testing.assert_array_equal(got.visible, turn(want.visible))
        np.testing.assert_allclose(got.minimum_height, turn(want.minimum_height), rtol=1e-6)


def test_a_window_as_large_as_the_range_has_the_bytes_of_the_whole(example_dem: Path) -> None:
    terrain = Terrain.open(example_dem)
    options: dict[str, Any] = {"max_distance": 5000.0, "radius": 6.4e6}
    whole = viewshed(terrain, (120, 140), **options)
    part = terrain.window((95, 146), (115, 166))
    inside = viewshed(part, (25, 25), **options)
    for name in ("visible", "count", "seen_by", "minimum_height"):
        np.testing.assert_array_equal(
            getattr(inside, name), getattr(whole, name)[95:146, 115:166], err_msg=name
        )
    assert whole.count.sum() == inside.count.sum()


def test_one_thread_gives_the_bytes_of_many(example_dem: Path) -> None:
    terrain = Terrain.open(example_dem)
    many = viewshed(terrain, (120, 140))
    before = jit.threads()
    try:
        jit.threads(1)
        one = viewshed(terrain, (120, 140))
    finally:
        jit.threads(before)
    assert one.minimum_height.tobytes() == many.minimum_height.tobytes()
    assert one.visible.tobytes() == many.visible.tobytes()


# ---------------------------------------------------------------- limits of the view


def test_only_targets_within_distance_azimuth_and_pitch_are_seen(rng: np.random.Generator) -> None:
    size = (2.0, 3.0)
    terrain = terrain_of(rough(rng, 31, 41), size)
    row, column = 14, 22
    rows, columns = np.mgrid[0:31, 0:41]
    east, north = (columns - column) * size[0], (row - rows) * size[1]
    way = np.hypot(east, north)
    azimuth = np.arctan2(east, north) % math.tau
    top = terrain.heights.astype(float) + 0.5 - terrain.heights[row, column] - 1.6
    pitch = np.arctan2(top, way)
    everything = viewshed(terrain, (row, column), target_height=0.5)
    own = way == 0.0
    for options, inside in [
        ({"max_distance": 18.0}, way <= 18.0),
        ({"azimuth_range": (1.0, 2.5)}, (azimuth >= 1.0) & (azimuth <= 2.5)),
        ({"azimuth_range": (5.5, 0.5)}, (azimuth >= 5.5) | (azimuth <= 0.5)),
        ({"azimuth_range": (-0.7, 0.2)}, (azimuth >= math.tau - 0.7) | (azimuth <= 0.2)),
        ({"azimuth_range": (0.3, 0.3 + math.tau)}, way >= 0.0),
    ]:
        got = viewshed(terrain, (row, column), target_height=0.5, **options)
        inside = inside | own
        np.testing.assert_array_equal(got.visible, everything.visible & inside)
        np.testing.assert_array_equal(
            got.minimum_height, np.where(inside, everything.minimum_height, np.nan)
        )
        assert got.report.cells_skipped == (~inside).sum()
    got = viewshed(terrain, (row, column), target_height=0.5, pitch_range=(-0.2, 0.1))
    level = ((pitch >= -0.2) & (pitch <= 0.1)) | own
    np.testing.assert_array_equal(got.visible, everything.visible & level)
    np.testing.assert_array_equal(got.minimum_height, everything.minimum_height)
    assert got.visible.sum() < everything.visible.sum()


@pytest.mark.parametrize("size", [(1.0, 1.0), (3.0, 1.3), (0.5, 2.0)])
@pytest.mark.parametrize("width", [0.01, 0.8, 5.0])
def test_sectors_are_cut_out_of_the_whole_view(
    width: float, size: tuple[float, float], rng: np.random.Generator
) -> None:
    terrain = terrain_of(rough(rng, 90, 120), size)
    row, column = 50, 33
    rows, columns = np.mgrid[0:90, 0:120]
    azimuth = np.arctan2((columns - column) * size[0], (row - rows) * size[1])
    whole = viewshed(terrain, (row, column))
    for first in np.arange(0.05, math.tau, 0.37):
        part = viewshed(terrain, (row, column), azimuth_range=(first, first + width))
        inside = (azimuth - first) % math.tau <= width
        inside[row, column] = True
        np.testing.assert_array_equal(part.visible, whole.visible & inside)
        np.testing.assert_array_equal(
            part.minimum_height, np.where(inside, whole.minimum_height, np.nan)
        )


def test_sectors_of_a_geographic_raster_make_up_the_circle(rng: np.random.Generator) -> None:
    terrain = Terrain(
        rough(rng, 90, 120),
        crs="EPSG:4326",
        transform=Affine(0.02, 0.0, 10.0, 0.0, -0.03, 61.0),
        datum=0.0,
    )
    options: dict[str, Any] = {"observer_height": 2.0, "radius": terrain.body_radius}
    whole = viewshed(terrain, (50, 33), **options)
    least = np.full(terrain.shape, np.nan, np.float32)
    edges = np.linspace(0.0, math.tau, 30)
    for first, last in pairwise(edges):
        part = viewshed(terrain, (50, 33), azimuth_range=(first, last), **options)
        least = np.fmin(least, part.minimum_height)
    np.testing.assert_array_equal(least, whole.minimum_height)


def test_many_observers_are_the_sum_of_each(rng: np.random.Generator) -> None:
    terrain = terrain_of(rough(rng, 20, 25))
    places = [(3, 4), (18, 20), (10, 0), (3, 4)]
    together = viewshed(terrain, places, max_distance=15.0)
    alone = [viewshed(terrain, place, max_distance=15.0) for place in places]
    np.testing.assert_array_equal(together.count, sum(v.visible.astype(int) for v in alone))
    np.testing.assert_array_equal(together.visible, together.count > 0)
    assert together.seen_by is not None
    for i, each in enumerate(alone):
        np.testing.assert_array_equal((together.seen_by >> np.uint64(i)) & np.uint64(1), each.count)
    lowest = alone[0].minimum_height
    for each in alone[1:]:
        lowest = np.fmin(lowest, each.minimum_height)
    np.testing.assert_array_equal(together.minimum_height, lowest)
    assert together.observers == tuple(places)


def test_the_last_of_64_observers_has_the_last_bit_and_the_65th_none() -> None:
    terrain = terrain_of(np.zeros((2, 40)))
    places = [(0, i % 40) for i in range(64)]
    seen = viewshed(terrain, places, max_distance=2.0).seen_by
    assert seen is not None
    assert seen.dtype == np.uint64
    assert seen[0, 23] >> np.uint64(63) == 1  # observer 63 stands on column 23
    assert seen[0, 30] >> np.uint64(63) == 0
    assert BITS == sights.BITS == 64
    more = viewshed(terrain, [*places, (0, 0)], max_distance=2.0)
    assert more.seen_by is None
    assert more.count[0, 0] == sum(i % 40 <= 2 for i in range(64)) + 1


def test_progress_counts_observers_and_can_stop_the_run() -> None:
    terrain = terrain_of(np.zeros((5, 5)))
    told: list[tuple[int, int]] = []
    viewshed(
        terrain, [(0, 0), (1, 1), (2, 2)], progress=lambda done, total: told.append((done, total))
    )
    assert told == [(1, 3), (2, 3), (3, 3)]

    def stop(done: int, total: int) -> None:
        raise adret.Cancelled("enough")

    with pytest.raises(adret.Cancelled, match="enough"):
        viewshed(terrain, (0, 0), progress=stop)


def test_the_callers_heights_and_the_report_are_left_whole(rng: np.random.Generator) -> None:
    heights = rough(rng, 8, 9)
    heights[2, 3] = np.nan
    before = heights.copy()
    seen = viewshed(terrain_of(heights), (0, 0))
    np.testing.assert_array_equal(heights, before)
    assert adret.last_run_report() is seen.report
    assert (seen.report.method, seen.report.cells, seen.report.cells_skipped) == ("exact", 72, 1)


# ---------------------------------------------------------------- places and errors


def test_cells_hold_the_points_of_the_map(example_dem: Path) -> None:
    terrain = Terrain.open(example_dem)
    transform = terrain.transform
    assert transform is not None
    rows, columns = np.array([0, 309, 12]), np.array([0, 357, 200])
    x = transform.c + transform.a * (columns + 0.5)
    y = transform.f + transform.e * (rows + 0.5)
    assert cells_at(terrain, x, y) == [(0, 0), (309, 357), (12, 200)]
    assert cells_at(terrain, transform.c, transform.f) == [(0, 0)]
    with pytest.raises(InputError, match="coordinates: must be inside the raster"):
        cells_at(terrain, transform.c + 358.0 * transform.a, float(y[2]))
    for point in (("a", 1.0), (None, 1.0), (1j, 1.0), ([1.0, 2.0, 3.0], [1.0, 2.0]), ([[1.0]], 2)):
        with pytest.raises(InputError, match="coordinates: must be numbers x and y"):
            cells_at(terrain, *point)
    with pytest.raises(InputError, match=r"coordinates: must be inside the raster, got \(nan"):
        cells_at(terrain, math.nan, float(y[2]))
    with pytest.raises(InputError, match="terrain: must be georeferenced"):
        cells_at(terrain_of(np.zeros((2, 2))), 0.0, 0.0)


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (2, 2)])
def test_the_smallest_rasters_have_a_viewshed(shape: tuple[int, int]) -> None:
    heights = np.arange(float(np.prod(shape))).reshape(shape) ** 2  # a bowl: nothing hides
    terrain = terrain_of(heights)
    for options in ({}, {"radius": 6e6}, {"max_distance": math.inf}, {"max_distance": 1e300}):
        seen = viewshed(terrain, (0, 0), observer_height=0.0, **options)
        assert seen.visible.all()
        np.testing.assert_array_equal(seen.minimum_height, np.zeros(shape))
    behind = viewshed(terrain, (0, 0), azimuth_range=(-1.0, 1.0), pitch_range=(-1.5, 1.5))
    assert behind.visible.sum() == 1


def test_a_range_of_azimuths_that_wraps_north_is_the_rest_of_the_circle() -> None:
    terrain = terrain_of(np.zeros((21, 21)))
    wide = viewshed(terrain, (10, 10), azimuth_range=(6.0, 0.5)).count
    rest = viewshed(terrain, (10, 10), azimuth_range=(0.5, 6.0)).count
    np.testing.assert_array_equal((wide + rest).ravel()[np.arange(441) != 220], 1)
    assert wide[:10, 10].all()
    for same in ((6.0 - math.tau, 0.5), (6.0, 0.5 + math.tau), (6.0 + 2 * math.tau, 0.5)):
        np.testing.assert_array_equal(viewshed(terrain, (10, 10), azimuth_range=same).count, wide)


@pytest.mark.parametrize(
    ("observers", "options", "message"),
    [
        ((5, 0), {}, r"observers: must be a cell between \(0, 0\) and \(3, 4\), got \(5, 0\)"),
        ((0, -1), {}, "observers: must be a cell between"),
        ((1, 1), {}, r"observers: must be a cell that is not nodata, got \(1, 1\)"),
        ((0.0, 1.0), {}, "observers: must be pairs of a row and a column"),
        ([], {}, "observers: must be pairs of a row and a column"),
        ([(0, 0), (1,)], {}, "observers: must be pairs of a row and a column"),
        ((0, 0, 0), {}, "observers: must be pairs of a row and a column"),
        ((True, False), {}, "observers: must be pairs of a row and a column"),
        ((2**70, 0), {}, "observers: must be pairs of a row and a column"),
        ([(0, 0), (math.nan, 1)], {}, "observers: must be pairs of a row and a column"),
        (np.ma.array([0, 0], mask=[0, 1]), {}, "observers: must be pairs of a row and a column"),
        ([(0, 0), (1, 1)], {}, r"observers: must be a cell that is not nodata, got \(1, 1\)"),
        ((0, 0), {"observer_height": -1.0}, "observer_height: must be between 0"),
        ((0, 0), {"target_height": math.nan}, "target_height: must be between 0"),
        ((0, 0), {"observer_height": math.nan}, "observer_height: must be between 0"),
        ((0, 0), {"target_height": "x"}, "target_height: must be between 0 and 1e6 m, got 'x'"),
        ((0, 0), {"target_height": -0.1}, "target_height: must be between 0 and 1e6 m, got -0.1"),
        ((0, 0), {"max_distance": 0.0}, "max_distance: must be a distance above 0"),
        ((0, 0), {"max_distance": -math.inf}, "max_distance: must be a distance above 0"),
        ((0, 0), {"max_distance": math.nan}, "max_distance: must be a distance above 0"),
        ((0, 0), {"radius": -5.0}, "radius: must be a radius"),
        ((0, 0), {"refraction": 2.0}, "refraction: must be between -1 and 1"),
        ((0, 0), {"refraction": 0.13}, "refraction: must be 0 without a radius, got 0.13"),
        ((0, 0), {"azimuth_range": (1.0, 1.0)}, "azimuth_range: must be two different"),
        ((0, 0), {"azimuth_range": (1.0,)}, "azimuth_range: must be two different"),
        ((0, 0), {"azimuth_range": (math.tau, 0.0)}, "azimuth_range: must be two different"),
        ((0, 0), {"azimuth_range": "12"}, "azimuth_range: must be two different"),
        ((0, 0), {"azimuth_range": (True, 2.0)}, "azimuth_range: must be two different"),
        ((0, 0), {"azimuth_range": (0.0, math.inf)}, "azimuth_range: must be two different"),
        ((0, 0), {"pitch_range": (0.5, 0.2)}, "pitch_range: must be two elevations"),
        ((0, 0), {"pitch_range": (0.5, 0.5)}, "pitch_range: must be two elevations"),
        ((0, 0), {"pitch_range": (math.nan, 0.2)}, "pitch_range: must be two elevations"),
        ((0, 0), {"pitch_range": (-2.0, 0.2)}, "pitch_range: must be two elevations"),
    ],
)
def test_what_cannot_be_used_is_named(observers: Any, options: Any, message: str) -> None:
    heights = np.zeros((4, 5))
    heights[1, 1] = np.nan
    with pytest.raises(InputError, match=message):
        viewshed(terrain_of(heights), observers, **options)


def test_a_line_of_sight_needs_two_cells_with_data() -> None:
    heights = np.zeros((4, 5))
    heights[1, 1] = np.nan
    terrain = terrain_of(heights)
    for a, b, message in [
        ((0, 0), (0, 0), r"b: must be another cell than \(0, 0\)"),
        ((0, 9), (0, 0), "a: must be a cell between"),
        ((0, 0), (1, 1), "b: must be a cell that is not nodata"),
        ((0, 0), [[2], [2, 3]], "b: must be a row and a column, whole numbers"),
    ]:
        with pytest.raises(InputError, match=message):
            line_of_sight(terrain, a, b)
    across = line_of_sight(terrain, (0, 0), (2, 2), observer_height=1.0)
    assert across.visible
    np.testing.assert_array_equal(np.isnan(across.ground), [False, True, False])
    neighbour = line_of_sight(terrain, (0, 0), (0, 1))
    assert (neighbour.minimum_height, neighbour.grazing_elevation) == (0.0, -math.inf)


# ---------------------------------------------------------------- for every cell


def test_the_total_viewshed_is_the_area_of_every_viewshed(example_dem: Path) -> None:
    terrain = Terrain.open(example_dem).window((100, 180), (120, 210))
    area = total_viewshed(terrain, 64, observer_height=20.0, max_distance=8000.0)
    assert area.dtype == np.float32
    cells = [(int(r), int(c)) for r, c in np.random.default_rng(2).integers(0, 80, (60, 2))]
    exact = [
        viewshed(terrain, cell, observer_height=20.0, max_distance=8000.0).count.sum() - 1
        for cell in cells
    ]
    want = np.array(exact) * 200.0**2
    got = np.array([area[cell] for cell in cells])
    # 64 azimuths against each pair's own line.
    assert got.sum() == pytest.approx(want.sum(), rel=0.03)
    assert np.abs(got - want).sum() < 0.08 * want.sum()
    assert np.corrcoef(got, want)[0, 1] > 0.99


def test_the_total_viewshed_takes_the_ways_of_intervisibility(example_dem: Path) -> None:
    terrain = Terrain.open(example_dem).window((100, 140), (120, 160))
    for options in ({"method": "tree"}, {"method": "tree", "near": 0}, {"near": 8}):
        got = total_viewshed(terrain, 8, observer_height=2.0, **options)
        want = intervisibility(terrain, 8, observer_height=2.0, reduce="visible_area", **options)
        np.testing.assert_array_equal(got, want)
