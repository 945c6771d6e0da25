"""Intervisibility: closed answers, a slow twin in fractions, both methods equal, invariants."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import adret
import paper_fields
from adret._kernels import jit

EAST = [np.pi / 2]
REDUCTIONS = (
    "visible_count",
    "visible_area",
    "sight_distance",
    "max_sight_distance",
    "horizon_count",
    "sky_view",
    "terrain_view",
)


def line(heights: list[float], step: float = 1.0) -> adret.Terrain:
    """One row, looked at eastwards: the samples are the cells."""
    return adret.Terrain(np.array([heights], dtype=np.float64), (step, step), datum=0.0)


def seen_by_hand(
    heights: NDArray[np.float64], receiver: int, reach: int, eye: int
) -> tuple[list[int], list[int]]:
    """Visible cells and local horizons east of a cell of a row of whole numbers, in fractions."""
    steepest: Fraction | None = None
    seen, ends = [], []
    for j in range(receiver + 1, min(len(heights), receiver + reach + 1)):
        visible = False
        if not np.isnan(heights[j]):
            slope = Fraction(int(heights[j] - heights[receiver] - eye), j - receiver)
            visible = steepest is None or slope >= steepest
            steepest = slope if visible else steepest
        if visible:
            seen.append(j)
        elif seen and seen[-1] == j - 1:
            ends.append(j - 1)
    if seen and seen[-1] == min(len(heights), receiver + reach + 1) - 1:
        ends.append(seen[-1])
    return seen, ends


# --- known answers -------------------------------------------------------------------------------


def test_a_plain_is_seen_to_its_end() -> None:
    flat = adret.Terrain(np.zeros((1, 9)), (2.0, 2.0))
    count = adret.intervisibility(flat, azimuths=EAST, reduce="visible_count")
    np.testing.assert_array_equal(count[0], np.arange(8, -1, -1))
    ends = adret.intervisibility(flat, azimuths=EAST, reduce="horizon_count")
    np.testing.assert_array_equal(ends[0], [1] * 8 + [0])
    way = adret.intervisibility(flat, azimuths=EAST, reduce="sight_distance")
    np.testing.assert_array_equal(way[0], 2.0 * np.arange(8, -1, -1))


def test_a_wall_hides_what_is_lower_and_shows_what_is_higher() -> None:
    east = adret.intervisibility(line([0, 0, 3, 0, 0, 9, 10, 0]), azimuths=EAST)
    assert east.of(0, 0, 0).tolist() == [2, 5]  # the cell behind is below the line over the rise
    assert east.visible(0, 0, 0)[1].tolist() == [1, 2, 5]
    assert east.of(0, 2, 0).tolist() == [3]  # from the wall down to its foot and up the rise
    assert east.visible(0, 2, 0)[1].tolist() == [3, 4, 5]
    assert east.of(0, 7, 0).tolist() == []


def test_area_of_a_plain_is_that_of_the_disc() -> None:
    flat = adret.Terrain(np.zeros((101, 101)), (10.0, 10.0))
    area = adret.intervisibility(flat, 64, reduce="visible_area", max_distance=400.0)
    np.testing.assert_allclose(area[50, 50], np.pi * 400.0**2, rtol=0.03)


def test_the_sea_ends_at_the_dip_of_its_horizon() -> None:
    sea = adret.Terrain(np.r_[100.0, np.zeros(800)][None, :], (100.0, 100.0))
    way = adret.intervisibility(sea, azimuths=EAST, reduce="max_sight_distance", radius=6_371_000.0)
    np.testing.assert_allclose(way[0, 0], np.sqrt(2.0 * 6_371_000.0 * 100.0), atol=100.0)


@pytest.mark.parametrize("angle", [20.0, 45.0])
def test_sky_view_of_a_plane(angle: float) -> None:
    z = np.tan(np.radians(angle)) * np.tile(np.arange(41.0), (41, 1))
    terrain = adret.Terrain(z, (1.0, 1.0))
    view = (1.0 + np.cos(np.radians(angle))) / 2.0
    sky = adret.intervisibility(terrain, 64, reduce="sky_view")
    np.testing.assert_allclose(sky[5:-5, 5:-5], view, atol=1e-3)
    ground = adret.intervisibility(terrain, 64, reduce="terrain_view")
    np.testing.assert_allclose(ground, 1.0 - sky, atol=1e-6)


# --- the slow twin, and one method against the other ---------------------------------------------

rows_of_heights = st.one_of(
    st.lists(st.integers(-3, 3), min_size=1, max_size=24),
    st.lists(st.integers(-1000, 1000), min_size=1, max_size=24),
    # Plateaus, and runs of equal slope.
    st.lists(st.tuples(st.integers(-3, 3), st.integers(1, 6)), min_size=1, max_size=8).map(
        lambda runs: np.cumsum(np.repeat(*np.array(runs).T)).tolist()
    ),
    st.lists(st.tuples(st.integers(-2, 4), st.integers(1, 6)), min_size=1, max_size=8).map(
        lambda runs: np.repeat(*np.array(runs).T).tolist()
    ),
)


@given(rows_of_heights, st.sets(st.integers(0, 23), max_size=8), st.integers(1, 30), st.data())
def test_small_lines_agree_with_fractions(
    heights: list[int], gaps: set[int], reach: int, data: st.DataObject
) -> None:
    z = np.array(heights, dtype=np.float64)
    z[[g for g in gaps if g < len(z)]] = np.nan
    if np.isnan(z).all():
        return
    eye = data.draw(st.sampled_from([0, 0, 1, 7]))
    terrain = line(z.tolist())
    for method in ("tree", "march"):
        east = adret.intervisibility(
            terrain,
            azimuths=EAST,
            method=method,  # type: ignore[arg-type]
            max_distance=float(reach),
            observer_height=float(eye),
        )
        for i in range(len(z)):
            if np.isnan(z[i]):
                assert east.of(0, i, 0).size == 0
                continue
            seen, ends = seen_by_hand(z, i, reach, eye)
            assert (east.of(0, i, 0) + i).tolist() == ends
            assert east.visible(0, i, 0)[1].tolist() == seen


def both(terrain: adret.Terrain, directions: int, **options: float) -> None:
    tree = adret.intervisibility(terrain, directions, method="tree", **options)
    march = adret.intervisibility(terrain, directions, method="march", **options)
    np.testing.assert_array_equal(tree.offsets, march.offsets)
    np.testing.assert_array_equal(tree.steps, march.steps)
    assert tree.steps.size > terrain.mask.size


@pytest.mark.parametrize("kind", [*paper_fields.KINDS, "random"])
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"max_distance": 300.0},
        {"observer_height": 0.15},
        {"radius": 50_000.0, "observer_height": 0.02, "max_distance": 777.0},
    ],
    ids=["plain", "near", "eye", "bent"],
)
def test_tree_and_walk_agree_on_fields(kind: str, options: dict[str, float]) -> None:
    make = paper_fields.KINDS.get(kind, paper_fields.random_heights)
    both(adret.Terrain(make(128), (10.0, 12.5)), 12, **options)


def test_tree_and_walk_agree_on_a_real_field(example_dem: Path) -> None:
    whole = adret.Terrain.open(example_dem)
    part = whole.window((60, 180), (80, 230))
    both(part, 16, radius=6_371_000.0, refraction=0.13)
    both(part, 8, observer_height=20.0, max_distance=9_000.0)


def test_tree_and_walk_agree_with_gaps(rng: np.random.Generator) -> None:
    z = np.round(rng.normal(size=(60, 70)).cumsum(0).cumsum(1), 1)
    z[rng.random(z.shape) < 0.05] = np.nan
    z[20:30, 25:40] = np.nan
    both(adret.Terrain(z, (5.0, 5.0)), 16)
    both(adret.Terrain(z, (5.0, 5.0)), 8, observer_height=3.0, max_distance=100.0)


@pytest.mark.parametrize("reduce", REDUCTIONS)
def test_reductions_agree(reduce: str, rng: np.random.Generator) -> None:
    z = paper_fields.fractal_terrain(64)
    z[rng.random(z.shape) < 0.02] = np.nan
    terrain = adret.Terrain(z, (0.03, 0.02))
    found = [
        adret.intervisibility(terrain, 10, method=m, reduce=reduce)  # type: ignore[call-overload]
        for m in ("tree", "march")
    ]
    np.testing.assert_array_equal(*found)
    np.testing.assert_array_equal(np.isnan(found[0]), terrain.mask)


def test_reductions_are_those_of_the_lists() -> None:
    terrain = adret.Terrain(paper_fields.fractal_terrain(40), (0.03, 0.02))
    k = 9
    sight = adret.intervisibility(terrain, k)
    count, ends, far = np.zeros((3, 40, 40))
    area, mean = np.zeros((2, 40, 40))
    for row in range(0, 40, 7):
        for column in range(0, 40, 3):
            for a in range(k):
                steps = sight.of(row, column, a)
                step = sight.step_length(row, a)
                seen = sight.visible(row, column, a)
                ends[row, column] += steps.size
                count[row, column] += seen[0].size
                # Cells are apart along the major axis by their distance in steps.
                away = np.maximum(abs(seen[0] - row), abs(seen[1] - column))
                area[row, column] += 2 * np.pi / k * step**2 * away.sum()
                if steps.size:
                    mean[row, column] += steps[-1] * step / k
                    far[row, column] = max(far[row, column], steps[-1] * step)
    some = (slice(None, None, 7), slice(None, None, 3))
    for reduce, expected in (
        ("visible_count", count),
        ("horizon_count", ends),
        ("visible_area", area),
        ("sight_distance", mean),
        ("max_sight_distance", far),
    ):
        layer = adret.intervisibility(terrain, k, reduce=reduce)  # type: ignore[call-overload]
        np.testing.assert_allclose(layer[some], expected[some], rtol=1e-5)


# --- symmetries and invariants -------------------------------------------------------------------


def test_opposite_azimuths_see_each_other() -> None:
    # A cell sees another along an axis if and only if it is seen by it.
    z = np.round(paper_fields.fractal_terrain(48) * 64.0) / 64.0
    sight = adret.intervisibility(adret.Terrain(z, (1.0, 1.0)), azimuths=[np.pi / 2, 1.5 * np.pi])
    for row in (3, 20):
        seen = np.zeros((2, 48, 48), bool)
        for k in (0, 1):
            for column in range(48):
                seen[k, column, sight.visible(row, column, k)[1]] = True
        np.testing.assert_array_equal(seen[0], seen[1].T)


def test_every_cell_has_its_own_sample() -> None:
    # On one azimuth no cell sees a cell twice, and its horizons lie within half a cell of the ray.
    azimuth = np.radians(33.0)
    terrain = adret.Terrain(paper_fields.fractal_terrain(50), (1.0, 1.0))
    sight = adret.intervisibility(terrain, azimuths=[azimuth])
    offsets, cells = sight.cells(0)
    receiver = np.repeat(np.arange(2500), np.diff(offsets))
    row, column = np.divmod(receiver, 50)
    to_row, to_column = np.divmod(cells, 50)
    north, east = row - to_row, to_column - column
    np.testing.assert_array_equal(north, sight.steps)
    assert abs(east - north * np.tan(azimuth)).max() <= 1.0 + 1e-9  # half a cell at either end
    assert np.unique(receiver * 2500 + cells).size == cells.size


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_a_quarter_turn_turns_the_result(turns: int) -> None:
    z = paper_fields.fractal_terrain(40)
    straight = adret.intervisibility(adret.Terrain(z, (1.0, 1.0)), 8, reduce="visible_count")
    turned = adret.intervisibility(
        adret.Terrain(np.rot90(z, turns), (1.0, 1.0)), 8, reduce="visible_count"
    )
    np.testing.assert_array_equal(turned, np.rot90(straight, turns))


def test_heights_times_a_power_of_two_change_nothing() -> None:
    z = paper_fields.fractal_terrain(64)
    low = adret.intervisibility(adret.Terrain(z, (1.0, 1.0)), 12, reduce="visible_count")
    high = adret.intervisibility(adret.Terrain(8.0 * z, (8.0, 8.0)), 12, reduce="visible_count")
    np.testing.assert_array_equal(low, high)


def test_a_window_with_a_halo_is_the_whole() -> None:
    terrain = adret.Terrain(paper_fields.fractal_terrain(96), (1.0, 1.0))
    whole = adret.intervisibility(terrain, 16, reduce="visible_count", max_distance=12.0)
    part = terrain.window((37, 61), (20, 50), halo=14)
    own = adret.intervisibility(part, 16, reduce="visible_count", max_distance=12.0)
    np.testing.assert_array_equal(own[part.core], whole[37:61, 20:50])


def test_one_thread_gives_the_same_bytes() -> None:
    terrain = adret.Terrain(paper_fields.fractal_terrain(100), (1.0, 1.0))
    before = jit.threads()
    many = adret.intervisibility(terrain, 8), adret.intervisibility(terrain, 8, reduce="sky_view")
    jit.threads(1)
    try:
        one = (
            adret.intervisibility(terrain, 8),
            adret.intervisibility(terrain, 8, reduce="sky_view"),
        )
    finally:
        jit.threads(before)
    assert many[0].steps.tobytes() == one[0].steps.tobytes()
    assert many[1].tobytes() == one[1].tobytes()


def test_bands_of_a_geographic_raster_are_joined() -> None:
    from affine import Affine

    z = paper_fields.fractal_terrain(64) * 20_000.0
    terrain = adret.Terrain(z, crs="EPSG:4326", transform=Affine(0.25, 0.0, 5.0, 0.0, -0.25, 70.0))
    assert len(terrain.latitude_bands(0.01)) > 1
    both(terrain, 12)
    tree = adret.intervisibility(terrain, 12, reduce="visible_count")
    march = adret.intervisibility(terrain, 12, reduce="visible_count", method="march")
    np.testing.assert_array_equal(tree, march)


def test_progress_counts_to_the_end_and_may_stop() -> None:
    terrain = adret.Terrain(paper_fields.fractal_terrain(32), (1.0, 1.0))
    told: list[tuple[int, int]] = []
    adret.intervisibility(terrain, 8, progress=lambda done, of: told.append((done, of)))
    assert told == [(i + 1, 16) for i in range(16)]  # counted first, then listed

    def stop(done: int, of: int) -> None:
        raise adret.Cancelled

    with pytest.raises(adret.Cancelled):
        adret.intervisibility(terrain, 8, reduce="sky_view", progress=stop)
    assert adret.intervisibility(terrain, 8).report.method == "tree"


# --- errors --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"method": "hull"}, "method"),
        ({"reduce": "mean"}, "reduce"),
        ({"max_distance": 0.0}, "max_distance"),
        ({"observer_height": -1.0}, "observer_height"),
        ({"directions": 0}, "directions"),
    ],
)
def test_wrong_options_are_refused(options: dict[str, object], field: str) -> None:
    with pytest.raises(adret.InputError) as caught:
        adret.intervisibility(line([0, 1]), **options)  # type: ignore[call-overload]
    assert caught.value.field == field


def test_a_cell_outside_is_refused() -> None:
    sight = adret.intervisibility(line([0, 1]), azimuths=EAST)
    for place in ((1, 0, 0), (0, 2, 0), (0, 0, 1), (-1, 0, 0)):
        with pytest.raises(adret.InputError):
            sight.of(*place)
