"""Horizon maps: worked profiles, the slow twin on random fields, options, errors."""

import hypothesis.strategies as st
import numpy as np
import pytest
from affine import Affine
from hypothesis import assume, given
from numpy.typing import NDArray

import adret
import oracles
import scenes

METHODS = ["exact", "sweep", "march", "hull"]
RANGED = ["exact", "sweep", "march"]  # those that take max_distance
LOCATED = ["exact", "sweep"]  # those that return the distance
AXES = np.arange(4) * np.pi / 2
DIAGONALS = np.pi / 4 + AXES


def row_terrain(*heights: float, step: float = 1.0) -> adret.Terrain:
    return adret.Terrain(np.array([heights]), (step, step), datum=0.0)


# --- known answers -------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_profile_worked_by_hand(method: str) -> None:
    terrain = row_terrain(0.0, -1.0, 1.0, 3.5, 2.0, step=2.0)
    got = adret.horizon_map(terrain, azimuths=[np.pi / 2, 3 * np.pi / 2], method=method)
    east = [3.5 / 6, 4.5 / 4, 2.5 / 2, -1.5 / 2]
    west = [1.0 / 2, -1.0 / 4, -3.5 / 6, 1.5 / 2]
    want = np.arctan([[*east, -np.inf], [-np.inf, *west]])
    # From 1.0 westwards: -1 at 2 m is -1.0, 0 at 4 m is -0.25. From 3.5: -1.25, -1.125, -0.583.
    np.testing.assert_allclose(got.elevation[:, 0, :], want, atol=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_outside_the_raster_is_nothing(method: str) -> None:
    terrain = adret.Terrain(np.zeros((3, 4)), (1.0, 1.0))
    cube = adret.horizon_map(terrain, azimuths=AXES, method=method).elevation
    down = np.float32(-np.pi / 2)
    edges = [cube[0, 0], cube[1, :, -1], cube[2, -1], cube[3, :, 0]]
    for edge in edges:
        assert (edge == down).all()
    np.testing.assert_array_equal(cube[0, 1:], 0.0)
    np.testing.assert_array_equal(cube[1, :, :-1], 0.0)
    np.testing.assert_array_equal(cube[2, :-1], 0.0)
    np.testing.assert_array_equal(cube[3, :, 1:], 0.0)


@pytest.mark.parametrize("method", METHODS)
def test_one_cell_sees_nothing_anywhere(method: str) -> None:
    cube = adret.horizon_map(row_terrain(5.0), directions=16, method=method).elevation
    np.testing.assert_array_equal(cube, np.float32(-np.pi / 2))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    "cell_size", [(1.0, 1.0), (20.0, 35.0), (12.0, 1.0)], ids=["square", "tall", "wide"]
)
def test_plane_horizon_off_the_edge(method: str, cell_size: tuple[float, float]) -> None:
    """Exact but for the float32 heights; the sweep's far field mixes two lines' vertices.

    Its lines lie f and 1 - f cells aside, so vertices beyond `near` steps, of different distances,
    leave up to f(1 - f)/near of the cross slope: a quarter of tan S / near.
    """
    scene = scenes.plane(np.radians(40), np.radians(70), cell_size=cell_size)
    assert scene.horizon is not None
    terrain = adret.Terrain(scene.heights, scene.cell_size)
    result = adret.horizon_map(terrain, directions=24, method=method)
    want = np.array([scene.horizon(float(a)) for a in result.azimuth])[:, None]
    np.testing.assert_allclose(
        result.elevation[:, scene.where],
        np.broadcast_to(want, (24, scene.where.sum())),
        atol=0.25 * np.tan(np.radians(40)) / 16 if method == "sweep" else 3e-5,
    )


@pytest.mark.parametrize("method", METHODS)
def test_canyon_walls_are_met_where_they_stand(method: str) -> None:
    # P1 works on samples as far apart as the smaller side of a cell: no long cells for it.
    cell_size = (1.0, 20.0) if method == "hull" else (1.0, 200.0)
    scene = scenes.canyon(np.radians(20), np.radians(60), cell_size=cell_size)
    assert scene.horizon is not None
    result = adret.horizon_map(
        adret.Terrain(scene.heights, scene.cell_size), directions=32, method=method
    )
    want = [scene.horizon(float(a)) for a in result.azimuth]
    bound = 0.06 if method == "hull" else 2e-5  # P1 looks half a cell past the wall's face
    np.testing.assert_allclose(result.elevation[:, scene.where][:, 0], want, atol=bound)


@pytest.mark.parametrize("method", METHODS)
def test_curvature_lowers_far_targets(method: str) -> None:
    for distance, degrees in scenes.CURVATURE_DEG.items():
        scene = scenes.target(distance)
        terrain = adret.Terrain(scene.heights, scene.cell_size)
        for options, want in zip(
            [{}, {"radius": 6_371_000.0}, {"radius": 6_371_000.0, "refraction": 0.13}],
            degrees,
            strict=True,
        ):
            got = adret.horizon_map(terrain, azimuths=[np.pi / 2], method=method, **options)
            assert np.degrees(got.elevation[0, 0, 0]) == pytest.approx(want, abs=6e-5)


@pytest.mark.parametrize("method", METHODS)
def test_ring_wall_on_the_sphere(method: str) -> None:
    scene = scenes.ring()
    terrain = adret.Terrain(scene.heights, scene.cell_size)
    for name, options in [
        ("flat", {}),
        ("sphere", {"radius": 6_371_000.0}),
        ("refracted", {"radius": 6_371_000.0, "refraction": 1 / 7}),
    ]:
        got = adret.horizon_map(terrain, azimuths=AXES, method=method, **options)
        np.testing.assert_allclose(
            got.elevation[:, scene.where], scenes.RING_HORIZON[name], atol=1e-6
        )


@pytest.mark.parametrize("method", METHODS)
def test_sea_horizon_dips_below_the_eye(method: str) -> None:
    located = method in LOCATED
    scene = scenes.sea()
    got = adret.horizon_map(
        adret.Terrain(scene.heights, scene.cell_size),
        azimuths=[np.pi / 2],
        method=method,
        radius=6_371_000.0,
        observer_height=100.0,
        distance=located,
    )
    assert got.elevation[0, 0, 0] == pytest.approx(-scenes.SEA_DIP, abs=1e-6)
    assert (got.distance is not None) is located
    # The dip is flat round its lowest point: 36 km on 100 m cells is known to a few cells.
    if got.distance is not None:
        assert got.distance[0, 0, 0] == pytest.approx(np.sqrt(2 * 100.0 * 6_371_000.0), abs=600.0)


@pytest.mark.parametrize("method", LOCATED)
def test_distance_is_that_of_the_horizon_point(method: str) -> None:
    terrain = row_terrain(0.0, -1.0, 1.0, 3.5, 2.0, step=2.0)
    got = adret.horizon_map(
        terrain, azimuths=[np.pi / 2, 3 * np.pi / 2], method=method, distance=True
    )
    assert got.distance is not None
    np.testing.assert_array_equal(got.distance[0, 0, :4], [6.0, 4.0, 2.0, 2.0])
    np.testing.assert_array_equal(got.distance[1, 0, 1:], [2.0, 4.0, 6.0, 2.0])
    assert not np.isfinite(got.distance[0, 0, 4])
    assert adret.horizon_map(terrain, directions=4, method=method).distance is None


# --- the slow twin -------------------------------------------------------------------------------

azimuth_values = st.one_of(
    st.sampled_from([k * np.pi / 4 for k in range(9)]),
    st.tuples(st.integers(-4, 4), st.integers(-4, 4))
    .filter(lambda v: v != (0, 0))
    .map(lambda v: float(np.arctan2(*v))),
    st.integers(0, 6283).map(lambda milli: milli / 1000.0),
)


@st.composite
def fields(draw: st.DrawFn, nodata: bool = True, largest: int = 11) -> NDArray[np.float64]:
    """Small fields of quarter metres, some with nodata: all of them exact in float32."""
    shape = draw(st.integers(1, largest)), draw(st.integers(1, largest))
    rng = np.random.default_rng(draw(st.integers(0, 2**31)))
    relief = draw(st.sampled_from([0, 1, 8, 100, 2000]))
    z = rng.integers(-relief, relief + 1, shape) / 4.0
    share = draw(st.sampled_from([0.0, 0.0, 0.1, 0.5])) if nodata else 0.0
    z[rng.random(shape) < share] = np.nan
    assume(np.isfinite(z).any())
    return z


cell_sizes = st.sampled_from([(1.0, 1.0), (30.0, 30.0), (2.0, 3.0), (0.5, 20.0), (90.0, 61.3)])
horizon_options = st.fixed_dictionaries(
    {},
    optional={
        "body": st.fixed_dictionaries(
            {"radius": st.sampled_from([6_371_000.0, 1_737_400.0, 5_000.0])},
            optional={"refraction": st.sampled_from([0.0, 0.13, 1 / 7])},
        ),
        "observer_height": st.sampled_from([0.0, 1.75, 40.0]),
        "max_distance": st.integers(0, 400).map(lambda n: 0.137 + n * 0.731),
    },
).map(lambda found: found.pop("body", {}) | found)


@given(
    z=fields(),
    cell_size=cell_sizes,
    azimuths=st.lists(azimuth_values, min_size=1, max_size=4),
    options=horizon_options,
)
def test_exact_is_its_slow_twin(
    z: NDArray[np.float64],
    cell_size: tuple[float, float],
    azimuths: list[float],
    options: dict[str, float],
) -> None:
    terrain = adret.Terrain(z, cell_size, datum=0.0)
    result = adret.horizon_map(terrain, azimuths=azimuths, method="exact", distance=True, **options)
    want = oracles.horizon_cube(z, cell_size, azimuths, **options)
    np.testing.assert_allclose(result.elevation, want, atol=1e-5, rtol=0)
    assert result.distance is not None
    # The distance leads back to the horizon: the point there has the horizon's elevation.
    curve = 0.0
    if "radius" in options:
        curve = (1.0 - options.get("refraction", 0.0)) / (2.0 * options["radius"])
    for k, row, column in np.argwhere(want > -np.pi / 2):
        limit = options.get("max_distance", np.inf)
        d, h = oracles.ray_crossings(z, cell_size, row, column, azimuths[k], limit)
        i = int(np.argmin(np.abs(d - result.distance[k, row, column])))
        assert d[i] == pytest.approx(result.distance[k, row, column], rel=1e-5)
        eye = z[row, column] + options.get("observer_height", 0.0)
        slope = (h[i] - eye - curve * d[i] ** 2) / d[i]
        assert np.arctan(slope) == pytest.approx(want[k, row, column], abs=1e-5)


@given(z=fields(largest=14), cell_size=cell_sizes, azimuth=azimuth_values, options=horizon_options)
def test_sweep_whose_near_field_covers_the_raster_is_exact(
    z: NDArray[np.float64],
    cell_size: tuple[float, float],
    azimuth: float,
    options: dict[str, float],
) -> None:
    terrain = adret.Terrain(z, cell_size, datum=0.0)
    got = adret.horizon_map(terrain, azimuths=[azimuth], method="sweep", near=16, **options)
    want = oracles.horizon_cube(z, cell_size, [azimuth], **options)
    np.testing.assert_allclose(got.elevation, want, atol=2e-5, rtol=0)


@pytest.mark.parametrize("method", ["sweep", "march"])
@given(
    z=fields(),
    azimuth=st.sampled_from([k * np.pi / 4 for k in range(9)]),
    options=horizon_options,
)
def test_sweep_and_march_are_exact_along_axes_and_diagonals(
    method: str, z: NDArray[np.float64], azimuth: float, options: dict[str, float]
) -> None:
    terrain = adret.Terrain(z, (2.5, 2.5), datum=0.0)
    got = adret.horizon_map(terrain, azimuths=[azimuth], method=method, **options)
    want = oracles.horizon_cube(z, (2.5, 2.5), [azimuth], **options)
    np.testing.assert_allclose(got.elevation, want, atol=2e-5, rtol=0)


def test_exact_on_rough_terrain_with_voids(rng: np.random.Generator) -> None:
    z = scenes.fractal(rng, (70, 90), relief=300.0)
    z[rng.random(z.shape) < 0.01] = np.nan
    z[30:40, 50:70] = np.nan
    cell_size = (10.0, 14.0)
    cells = np.argwhere(np.isfinite(z))
    cells = cells[rng.choice(len(cells), 150, replace=False)]
    azimuths = np.concatenate([AXES, DIAGONALS, rng.uniform(0, 2 * np.pi, 8)])
    result = adret.horizon_map(
        adret.Terrain(z, cell_size, datum=150.0), azimuths=azimuths, method="exact"
    )
    want = oracles.horizons(z, cell_size, cells, azimuths)
    np.testing.assert_allclose(
        result.elevation[:, cells[:, 0], cells[:, 1]], want, atol=1e-5, rtol=0
    )


@pytest.mark.parametrize("method", ["exact", "sweep", "march"])
def test_geographic_rows_use_their_own_metres(method: str, rng: np.random.Generator) -> None:
    """Ten degrees of latitude: every band of rows is swept with its own cell size."""
    z = scenes.fractal(rng, (80, 60), relief=20_000.0)
    transform = Affine(0.125, 0.0, 7.0, 0.0, -0.125, 68.0)
    terrain = adret.Terrain(z, crs="EPSG:4326", transform=transform, datum=10_000.0)
    bands = terrain.latitude_bands(np.radians(0.5))
    assert len(bands) > 3
    azimuths = [0.0, 0.4, np.pi / 2, 2.2, 4.0, 5.1]
    result = adret.horizon_map(
        terrain, azimuths=azimuths, method=method, near=128, radius=6_371_000.0
    )
    assert result.report.bands == len(bands)
    cells = np.stack([rng.integers(0, 80, 60), rng.integers(0, 60, 60)], axis=-1)
    at = adret.horizon_at(terrain, cells[:, 0], cells[:, 1], azimuths=azimuths, radius=6_371_000.0)
    for band in bands:
        start, stop, size = band.start, band.stop, band.cell_size
        inside = (cells[:, 0] >= start) & (cells[:, 0] < stop)
        want = oracles.horizons(z, size, cells[inside], azimuths, radius=6_371_000.0)
        got = result.elevation[:, cells[inside, 0], cells[inside, 1]]
        np.testing.assert_allclose(at[:, inside], want, atol=1e-5, rtol=0)
        if method == "march":
            assert (got <= want + 1e-5).all()
        else:
            np.testing.assert_allclose(got, want, atol=1e-5, rtol=0)
    # The metres of a degree of longitude do change.
    assert bands[-1].cell_size[0] > 1.3 * bands[0].cell_size[0]


# --- options -------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", RANGED)
def test_max_distance_includes_its_own_end(method: str) -> None:
    terrain = row_terrain(0.0, 1.0, 10.0, 100.0)
    for limit, want in [(3.0, 100 / 3), (2.0, 5.0), (1.5, 1.0), (0.5, -np.inf)]:
        got = adret.horizon_map(terrain, azimuths=[np.pi / 2], method=method, max_distance=limit)
        assert got.elevation[0, 0, 0] == pytest.approx(np.arctan(want), abs=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_nodata_receives_nan_and_never_occludes(method: str) -> None:
    terrain = row_terrain(0.0, np.nan, 2.0, np.nan, 9.0)
    got = adret.horizon_map(terrain, azimuths=[np.pi / 2], method=method).elevation[0, 0]
    np.testing.assert_allclose(
        got, [np.arctan(9 / 4), np.nan, np.arctan(7 / 2), np.nan, -np.pi / 2], atol=1e-6
    )


@pytest.mark.parametrize("method", METHODS)
def test_azimuths_keep_their_order_whatever_it_is(method: str, rng: np.random.Generator) -> None:
    terrain = adret.Terrain(scenes.fractal(rng, (20, 24)), (1.0, 1.0))
    azimuths = np.linspace(0.0, 6.0, 13)
    order = rng.permutation(13)
    straight = adret.horizon_map(terrain, azimuths=azimuths, method=method)
    mixed = adret.horizon_map(terrain, azimuths=azimuths[order], method=method)
    np.testing.assert_array_equal(mixed.azimuth, straight.azimuth[order])
    np.testing.assert_array_equal(mixed.elevation, straight.elevation[order])


def test_progress_counts_azimuths_and_can_stop_the_run() -> None:
    terrain = adret.Terrain(np.zeros((5, 5)), (1.0, 1.0))
    seen: list[tuple[int, int]] = []
    adret.horizon_map(terrain, 8, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (8, 8)
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)

    def stop(done: int, total: int) -> None:
        if done >= 3:
            raise adret.Cancelled

    with pytest.raises(adret.Cancelled):
        adret.horizon_map(terrain, 8, progress=stop)


def test_report_says_what_was_done() -> None:
    terrain = row_terrain(0.0, np.nan, 2.0)
    result = adret.horizon_map(terrain, 12, method="sweep", near=8)
    for report in (result.report, adret.last_run_report()):
        assert report is not None
        assert (report.method, report.near, report.azimuths_swept) == ("sweep", 8, 12)
        assert (report.cells, report.cells_skipped, report.azimuths_skipped) == (3, 1, 0)


# --- errors --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("field", "options"),
    [
        ("directions", {"directions": 0}),
        ("directions", {"directions": 100_000}),
        ("directions", {"directions": 2.5}),
        ("azimuths", {"azimuths": [0.0, np.nan]}),
        ("azimuths", {"azimuths": []}),
        ("method", {"method": "guess"}),
        ("near", {"near": -1}),
        ("near", {"near": 2.5}),
        ("max_distance", {"max_distance": 0.0}),
        ("max_distance", {"max_distance": np.nan}),
        ("radius", {"radius": 0.0}),
        ("radius", {"radius": -1.0}),
        ("radius", {"radius": np.nan}),
        ("refraction", {"refraction": np.inf}),
        ("refraction", {"refraction": np.nan}),
        ("refraction", {"refraction": 0.13}),
        ("observer_height", {"observer_height": np.nan}),
        ("observer_height", {"observer_height": -np.inf}),
        ("max_distance", {"method": "hull", "max_distance": 100.0}),
        ("distance", {"method": "hull", "distance": True}),
        ("distance", {"method": "march", "distance": True}),
    ],
)
def test_bad_options_are_named(field: str, options: dict[str, object]) -> None:
    terrain = adret.Terrain(np.zeros((3, 3)), (1.0, 1.0))
    with pytest.raises(adret.InputError) as caught:
        adret.horizon_map(terrain, **options)  # type: ignore[arg-type]
    assert caught.value.field == field
    assert str(caught.value).startswith(f"{field}: must be ")


@pytest.mark.parametrize("cell", [(1.0, 1.0), (2.0, 1.0)], ids=["square", "rectangular"])
@pytest.mark.parametrize("share", [0.9, 1.0, 1.2, 1.41, 2.0, 2.9])
def test_a_range_about_as_long_as_the_raster(
    cell: tuple[float, float], share: float, rng: np.random.Generator
) -> None:
    """A step is up to 1.4 cells: a range may be shorter than the raster in steps alone."""
    terrain = adret.Terrain(scenes.fractal(rng, (70, 70), relief=20.0), cell)
    azimuths = np.radians([20.0, 40.0, 45.0, 50.0, 80.0, 90.0, 135.0, 225.0, 270.0, 315.0])
    options = {"azimuths": azimuths, "max_distance": 70.0 * share}
    exact = adret.horizon_map(terrain, method="exact", **options).elevation
    for near in (4, 32):
        swept = adret.horizon_map(terrain, near=near, **options).elevation
        bound = np.radians(0.6 if near == 4 else 0.02)
        assert np.abs(swept - exact).mean() < bound


@pytest.mark.parametrize("near", [2, 4, 8])
def test_windows_of_a_banded_raster_are_the_whole(near: int, rng: np.random.Generator) -> None:
    from affine import Affine

    z = scenes.fractal(rng, (120, 60), relief=4000.0)
    terrain = adret.Terrain(z, None, "EPSG:4326", Affine(0.2, 0.0, 0.0, 0.0, -0.2, 84.0))
    assert len(terrain.latitude_bands(np.radians(0.5))) > 3
    azimuths = np.radians([10.0, 44.0, 46.0, 80.0, 135.0, 200.0, 261.0, 300.0])
    for reach in (30_000.0, 60_000.0, 120_000.0):
        options = adret.HorizonOptions(near=near, max_distance=reach)
        halo = options.halo(terrain)
        whole = adret.horizon_map(terrain, azimuths=azimuths, near=near, max_distance=reach)
        for top in (0, 40, 100):
            part = terrain.window((top, top + 20), (20, 40), halo=halo)
            tile = adret.horizon_map(part, azimuths=azimuths, near=near, max_distance=reach)
            cut = tile.elevation[(slice(None), *part.core)]
            assert cut.tobytes() == whole.elevation[:, top : top + 20, 20:40].tobytes()


def test_a_narrow_strip_needs_no_square_of_memory() -> None:
    terrain = adret.Terrain(np.zeros((2, 20_000), np.float32), (1.0, 1.0))
    found = adret.horizon_map(terrain, azimuths=[np.pi / 2], max_distance=15_000.0)
    assert found.elevation[0, 0, 0] == 0.0


@pytest.mark.parametrize(
    ("field", "options"),
    [
        ("directions", {"directions": "abc"}),
        ("directions", {"directions": 3.5}),
        ("directions", {"directions": float("nan")}),
        ("azimuths", {"azimuths": ["x"]}),
        ("azimuths", {"azimuths": [1j]}),
        ("near", {"near": "4"}),
        ("near", {"near": 4.5}),
        ("radius", {"radius": "6371000"}),
        ("max_distance", {"max_distance": float("nan")}),
    ],
)
def test_odd_options_are_refused_by_name(field: str, options: dict[str, object]) -> None:
    terrain = adret.Terrain(np.zeros((3, 3)), (1.0, 1.0))
    with pytest.raises(adret.InputError, match=field):
        adret.horizon_map(terrain, **options)
