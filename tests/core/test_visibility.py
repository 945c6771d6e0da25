"""Intervisibility: closed answers, slow twins, methods equal to each other, invariants."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import adret
import paper_fields
import ray_oracle
from adret._kernels import jit
from adret.sight_frames import SightFrame
from adret.sight_sweep import SightReport

EAST = [np.pi / 2]
METHODS = ("rays", "tree", "march")
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


@pytest.mark.parametrize("slope", [0.0, 0.3, -0.2])
def test_even_ground_is_seen_though_heights_are_rounded(slope: float) -> None:
    i, j = np.mgrid[0:80, 0:90]
    even = adret.Terrain(30.0 * (slope * j + 0.7 * slope * i), (30.0, 30.0))
    flat = adret.Terrain(np.zeros((80, 90)), (30.0, 30.0))
    seen = adret.intervisibility(even, 16, reduce="visible_count")
    every = adret.intervisibility(flat, 16, reduce="visible_count")
    assert seen.sum() > 0.99 * every.sum()
    assert (seen <= every).all()


# --- slow twins, and one method against the other ---------------------------------------------

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
    near = data.draw(st.sampled_from([0, 1, 2, 5, 16, 17]))
    terrain = line(z.tolist())
    for method in METHODS:
        east = adret.intervisibility(
            terrain,
            azimuths=EAST,
            method=method,  # type: ignore[arg-type]
            near=near,
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


@pytest.mark.parametrize("near", [0, 5, 23, 4096])
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"max_distance": 0.4},
        {"observer_height": 0.003, "radius": 30.0},
    ],
    ids=["plain", "range", "bent"],
)
def test_own_rays_agree_with_every_crossing_in_double_precision(
    near: int, options: dict[str, float], rng: np.random.Generator
) -> None:
    z = paper_fields.fractal_terrain(70)[:, :60]
    z[rng.random(z.shape) < 0.01] = np.nan
    terrain = adret.Terrain(z, (1 / 64, 1.3 / 64))
    azimuths = np.radians([0.0, 11.0, 45.0, 77.0, 158.0, 213.0, 299.0, 325.3])
    sight = adret.intervisibility(terrain, azimuths=azimuths, near=near, **options)
    oracle = {k: v for k, v in options.items() if k != "radius"}
    oracle["bend"] = 0.5 / options["radius"] if "radius" in options else 0.0
    compared = 0
    for row in range(0, 70, 9):
        for column in range(0, 60, 7):
            for k, azimuth in enumerate(azimuths):
                steps, step, margin = ray_oracle.seen_samples(
                    terrain.heights, terrain.cell_size, row, column, azimuth, near=near, **oracle
                )
                assert sight.step_length(row, k) == pytest.approx(step)
                if abs(margin).min(initial=1.0) < 3e-5:
                    continue  # a tie, within what heights of this size and cells of 1/64 are off by
                compared += 1
                assert sight.of(row, column, k).tolist() == ray_oracle.runs(steps).tolist()
                rows, columns = sight.visible(row, column, k)
                away = np.maximum(abs(rows - row), abs(columns - column))
                assert len(rows) == len(steps)
                assert (away <= steps).all()
    assert compared > 500


def test_the_near_field_takes_the_error_away(example_dem: Path, rng: np.random.Generator) -> None:
    terrain = adret.Terrain.open(example_dem).window((40, 240), (60, 260))
    cells = np.argwhere(~terrain.mask)
    cells = cells[rng.choice(len(cells), 40, replace=False)]
    azimuths = np.arange(12) * (2.0 * np.pi / 12.0) + 0.1
    exact = np.zeros(len(cells))
    for i, (row, column) in enumerate(cells):
        for azimuth in azimuths:
            steps, step, _ = ray_oracle.seen_samples(
                terrain.heights, terrain.cell_size, row, column, azimuth, observer_height=2.0
            )
            exact[i] += 2.0 * np.pi / 12.0 * step**2 * steps.sum()

    def error(method: str, near: int | None) -> float:
        area = adret.intervisibility(
            terrain,
            azimuths=azimuths,
            method=method,  # type: ignore[call-overload]
            near=near,
            reduce="visible_area",
            observer_height=2.0,
        )
        return float(abs(area[tuple(cells.T)] - exact).mean() / exact.mean())

    assert error("rays", None) < 1e-3
    assert error("rays", 0) < 0.06
    lines = [error("tree", near) for near in (0, 8, 32, 128)]
    assert lines[0] > lines[1] > lines[2] > lines[3]
    assert lines[0] < 0.15
    assert lines[2] < 0.06


def test_lines_with_a_near_field_as_long_as_the_raster_are_own_rays() -> None:
    terrain = adret.Terrain(paper_fields.fractal_terrain(60), (0.02, 0.02))
    rays = adret.intervisibility(terrain, 12, near=100)
    tree = adret.intervisibility(terrain, 12, near=100, method="tree")
    np.testing.assert_array_equal(rays.offsets, tree.offsets)
    np.testing.assert_array_equal(rays.steps, tree.steps)


def both(terrain: adret.Terrain, directions: int, near: int, **options: float) -> None:
    tree = adret.intervisibility(terrain, directions, method="tree", near=near, **options)
    march = adret.intervisibility(terrain, directions, method="march", near=near, **options)
    np.testing.assert_array_equal(tree.offsets, march.offsets)
    np.testing.assert_array_equal(tree.steps, march.steps)
    assert tree.steps.size > terrain.mask.size


@pytest.mark.parametrize("kind", [*paper_fields.KINDS, "random"])
@pytest.mark.parametrize("near", [0, 9])
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"max_distance": 300.0},
        {"observer_height": 0.15},
        {"radius": 50_000.0, "observer_height": 0.02, "max_distance": 777.0},
    ],
    ids=["plain", "range", "eye", "bent"],
)
def test_tree_and_walk_agree_on_fields(kind: str, near: int, options: dict[str, float]) -> None:
    make = paper_fields.KINDS.get(kind, paper_fields.random_heights)
    both(adret.Terrain(make(128), (10.0, 12.5)), 12, near, **options)


def test_tree_and_walk_agree_on_a_real_field(example_dem: Path) -> None:
    whole = adret.Terrain.open(example_dem)
    part = whole.window((60, 180), (80, 230))
    for near in (0, 16):
        both(part, 16, near, radius=6_371_000.0, refraction=0.13)
        both(part, 8, near, observer_height=20.0, max_distance=9_000.0)


def test_tree_and_walk_agree_with_gaps(rng: np.random.Generator) -> None:
    z = np.round(rng.normal(size=(60, 70)).cumsum(0).cumsum(1), 1)
    z[rng.random(z.shape) < 0.05] = np.nan
    z[20:30, 25:40] = np.nan
    for near in (0, 7):
        both(adret.Terrain(z, (5.0, 5.0)), 16, near)
        both(adret.Terrain(z, (5.0, 5.0)), 8, near, observer_height=3.0, max_distance=100.0)


@pytest.mark.parametrize("near", [0, 20])
@pytest.mark.parametrize("reduce", REDUCTIONS)
def test_reductions_agree(reduce: str, near: int, rng: np.random.Generator) -> None:
    z = paper_fields.fractal_terrain(64)
    z[rng.random(z.shape) < 0.02] = np.nan
    terrain = adret.Terrain(z, (0.03, 0.02))
    found = [
        adret.intervisibility(terrain, 10, method=m, near=near, reduce=reduce)  # type: ignore[call-overload]
        for m in ("tree", "march")
    ]
    np.testing.assert_array_equal(*found)
    np.testing.assert_array_equal(np.isnan(found[0]), terrain.mask)


@pytest.mark.parametrize(("method", "near"), [("rays", None), ("tree", 0), ("tree", 6)])
def test_reductions_are_those_of_the_lists(method: str, near: int | None) -> None:
    terrain = adret.Terrain(paper_fields.fractal_terrain(40), (0.03, 0.02))
    k = 9
    sight = adret.intervisibility(terrain, k, method=method, near=near)  # type: ignore[call-overload]
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
        layer = adret.intervisibility(
            terrain,
            k,
            method=method,  # type: ignore[call-overload]
            near=near,
            reduce=reduce,
        )
        np.testing.assert_allclose(layer[some], expected[some], rtol=1e-5)


@pytest.mark.parametrize(("radius", "eye"), [(None, 0.0), (6_371_000.0, 5.0)])
def test_sky_view_is_that_of_the_horizons(
    radius: float | None, eye: float, example_dem: Path
) -> None:
    terrain = adret.Terrain.open(example_dem).window((60, 160), (80, 200))
    options = {"radius": radius, "observer_height": eye}
    exact = adret.sky_view_factor(terrain, "normal", 16, method="exact", **options)
    ours = adret.intervisibility(terrain, 16, reduce="sky_view", **options)
    np.testing.assert_allclose(ours, exact, atol=2e-6)
    lines = adret.intervisibility(terrain, 16, reduce="sky_view", method="tree", **options)
    known = ~terrain.mask
    assert abs(lines - exact)[known].mean() < 5e-4
    ground = adret.intervisibility(terrain, 16, reduce="terrain_view", **options)
    np.testing.assert_array_equal(ground, np.float32(1.0) - ours)


# --- what is skipped -----------------------------------------------------------------------------


@pytest.mark.parametrize("reduce", REDUCTIONS[:-1])
def test_what_is_passed_over_is_not_seen(
    reduce: str, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    z = paper_fields.fractal_terrain(150)
    z[rng.random(z.shape) < 0.01] = np.nan
    terrain = adret.Terrain(z, (0.01, 0.01))

    def layer(near: int) -> tuple[NDArray[np.float32], SightReport]:
        found = adret.intervisibility(terrain, 12, near=near, reduce=reduce)  # type: ignore[call-overload]
        report = adret.last_run_report()
        assert isinstance(report, SightReport)
        return found, report

    some = [layer(near) for near in (8, 4096)]
    fill = SightFrame._fill_by_rays

    def with_a_high_roof(frame: SightFrame, *arguments: object) -> None:
        frame._ground[2][:] = 1e29
        fill(frame, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(SightFrame, "_fill_by_rays", with_a_high_roof)
    monkeypatch.setattr("adret._kernels.sight_rays.raise_roof", lambda *arguments: None)
    everything = [layer(near) for near in (8, 4096)]
    for (found, report), (want, slow) in zip(some, everything, strict=True):
        np.testing.assert_array_equal(found, want)
        assert slow.samples_skipped == 0
        assert report.samples_skipped > 0.1 * slow.samples_tested
        assert report.samples_tested + report.samples_skipped == slow.samples_tested
        assert report.receivers == 12 * (~terrain.mask).sum()


def test_the_tree_reports_its_repairs() -> None:
    terrain = adret.Terrain(paper_fields.KINDS["sine grid"](128), (1.0, 1.0))
    report = adret.intervisibility(terrain, 8, method="tree", near=0).report
    assert report.tree_checks > 0
    assert report.tree_repairs_skipped > 0.25 * 2 * 8 * terrain.mask.size  # counted, then listed
    assert (report.receivers, report.samples_tested, report.samples_skipped) == (0, 0, 0)


# --- other views of the lists --------------------------------------------------------------------


def test_compressed_rows_hold_distances() -> None:
    terrain = adret.Terrain(paper_fields.fractal_terrain(12), (2.0, 3.0))
    sight = adret.intervisibility(terrain, 8)
    for k in (0, 3):
        rows = sight.cells(k)
        assert (rows.indptr.size, rows.indptr[0], rows.indptr[-1]) == (145, 0, rows.data.size)
        for i in (0, 70, 143):
            row = slice(rows.indptr[i], rows.indptr[i + 1])
            cells, steps = rows.indices[row], sight.of(i // 12, i % 12, k)
            east, north = cells % 12 - i % 12, i // 12 - cells // 12
            np.testing.assert_allclose(
                rows.data[row], steps * np.float32(sight.step_length(0, k)), rtol=1e-6
            )
            if k == 0:
                np.testing.assert_array_equal(north, steps)
            assert (np.hypot(2.0 * east, 3.0 * north) < rows.data[row] + 3.0).all()


def test_awkward_arrays_are_the_lists() -> None:
    awkward = pytest.importorskip("awkward", reason="Awkward Array is optional")
    terrain = adret.Terrain(paper_fields.fractal_terrain(12)[:, :9], (1.0, 1.0))
    sight = adret.intervisibility(terrain, 3)
    lists = sight.to_awkward()
    assert str(lists.type) == "3 * 12 * 9 * var * int32"
    assert lists[2, 5, 7].tolist() == sight.of(5, 7, 2).tolist()
    assert awkward.max(lists) == sight.steps.max()


# --- symmetries and invariants -------------------------------------------------------------------


def test_opposite_azimuths_see_each_other() -> None:
    # A cell sees another along an axis if and only if it is seen by it.
    z = np.round(paper_fields.fractal_terrain(48) * 64.0) / 64.0
    terrain = adret.Terrain(z, (1.0, 1.0))
    azimuths = [np.pi / 2, 1.5 * np.pi]
    sight = adret.intervisibility(terrain, azimuths=azimuths, method="tree", near=0)
    for row in (3, 20):
        seen = np.zeros((2, 48, 48), bool)
        for k in (0, 1):
            for column in range(48):
                seen[k, column, sight.visible(row, column, k)[1]] = True
        np.testing.assert_array_equal(seen[0], seen[1].T)


@pytest.mark.parametrize(
    ("method", "near", "aside"),
    [("rays", None, 0.5), ("tree", 0, 1.0)],  # of lines, half a cell at either end
)
def test_every_cell_has_its_own_sample(method: str, near: int | None, aside: float) -> None:
    # On one azimuth no cell sees a cell twice, and its horizons lie beside the ray.
    azimuth = np.radians(33.0)
    terrain = adret.Terrain(paper_fields.fractal_terrain(50), (1.0, 1.0))
    sight = adret.intervisibility(terrain, azimuths=[azimuth], method=method, near=near)  # type: ignore[call-overload]
    _, cells, offsets = sight.cells(0)
    receiver = np.repeat(np.arange(2500), np.diff(offsets))
    row, column = np.divmod(receiver, 50)
    to_row, to_column = np.divmod(cells, 50)
    north, east = row - to_row, to_column - column
    np.testing.assert_array_equal(north, sight.steps)
    assert abs(east - north * np.tan(azimuth)).max() <= aside + 1e-9
    assert np.unique(receiver * 2500 + cells).size == cells.size


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_a_quarter_turn_turns_the_result(turns: int) -> None:
    z = paper_fields.fractal_terrain(40)
    straight = adret.intervisibility(adret.Terrain(z, (1.0, 1.0)), 8, reduce="visible_count")
    turned = adret.intervisibility(
        adret.Terrain(np.rot90(z, turns), (1.0, 1.0)), 8, reduce="visible_count"
    )
    np.testing.assert_array_equal(turned, np.rot90(straight, turns))


@pytest.mark.parametrize(("method", "near"), [("rays", None), ("tree", 0), ("tree", 11)])
def test_heights_times_a_power_of_two_change_nothing(method: str, near: int | None) -> None:
    z = paper_fields.fractal_terrain(64)
    low, high = (
        adret.intervisibility(
            adret.Terrain(by * z, (by, by), datum=0.0),
            12,
            method=method,  # type: ignore[call-overload]
            near=near,
            reduce="visible_count",
        )
        for by in (1.0, 8.0)
    )
    np.testing.assert_array_equal(low, high)


@pytest.mark.parametrize(("method", "near"), [("rays", None), ("tree", 0), ("tree", 5)])
def test_a_window_with_a_halo_is_the_whole(method: str, near: int | None) -> None:
    terrain = adret.Terrain(paper_fields.fractal_terrain(96), (1.0, 1.0))
    part = terrain.window((37, 61), (20, 50), halo=14)
    whole, own = (
        adret.intervisibility(
            place,
            16,
            method=method,  # type: ignore[call-overload]
            near=near,
            reduce="visible_count",
            max_distance=12.0,
        )
        for place in (terrain, part)
    )
    np.testing.assert_array_equal(own[part.core], whole[37:61, 20:50])


def test_one_thread_gives_the_same_bytes() -> None:
    terrain = adret.Terrain(paper_fields.fractal_terrain(100), (1.0, 1.0))
    before = jit.threads()

    def products() -> list[bytes]:
        return [
            adret.intervisibility(terrain, 8, method=method).steps.tobytes()
            for method in ("rays", "tree")
        ] + [adret.intervisibility(terrain, 8, reduce="sky_view").tobytes()]

    many = products()
    jit.threads(1)
    try:
        assert products() == many
    finally:
        jit.threads(before)


def test_bands_of_a_geographic_raster_are_joined() -> None:
    from affine import Affine

    z = paper_fields.fractal_terrain(64) * 20_000.0
    terrain = adret.Terrain(z, crs="EPSG:4326", transform=Affine(0.25, 0.0, 5.0, 0.0, -0.25, 70.0))
    assert len(terrain.latitude_bands(0.01)) > 1
    both(terrain, 12, 0)
    both(terrain, 12, 8)
    rays = adret.intervisibility(terrain, 12, reduce="visible_count")
    long = adret.intervisibility(terrain, 12, reduce="visible_count", method="march", near=100)
    np.testing.assert_array_equal(rays, long)


def test_progress_counts_to_the_end_and_may_stop() -> None:
    terrain = adret.Terrain(paper_fields.fractal_terrain(32), (1.0, 1.0))
    told: list[tuple[int, int]] = []
    adret.intervisibility(terrain, 8, progress=lambda done, of: told.append((done, of)))
    assert told == [(i + 1, 16) for i in range(16)]  # counted first, then listed

    def stop(done: int, of: int) -> None:
        raise adret.Cancelled

    with pytest.raises(adret.Cancelled):
        adret.intervisibility(terrain, 8, reduce="sky_view", progress=stop)
    report = adret.intervisibility(terrain, 8).report
    assert (report.method, report.near, report.azimuths_swept) == ("rays", 4096, 8)


# --- errors --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"method": "hull"}, "method"),
        ({"reduce": "mean"}, "reduce"),
        ({"max_distance": 0.0}, "max_distance"),
        ({"near": -1}, "near"),
        ({"near": 4097}, "near"),
        ({"observer_height": -1.0}, "observer_height"),
        ({"directions": 0}, "directions"),
    ],
)
def test_wrong_options_are_refused(options: dict[str, object], field: str) -> None:
    with pytest.raises(adret.InputError) as caught:
        adret.intervisibility(line([0, 1]), **options)  # type: ignore[call-overload]
    assert caught.value.field == field


def test_only_a_terrain_is_taken() -> None:
    with pytest.raises(adret.InputError) as caught:
        adret.intervisibility(np.zeros((3, 3)))  # type: ignore[call-overload]
    assert caught.value.field == "terrain"


def test_a_cell_outside_is_refused() -> None:
    sight = adret.intervisibility(line([0, 1]), azimuths=EAST)
    for place in ((1, 0, 0), (0, 2, 0), (0, 0, 1), (-1, 0, 0)):
        with pytest.raises(adret.InputError):
            sight.of(*place)
