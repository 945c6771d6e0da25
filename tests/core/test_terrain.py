"""Terrain: heights above a datum, metres a cell, bands of latitude, windows."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from affine import Affine
from pyproj import CRS, Geod, Transformer

from adret import InputError, RasterError, Terrain
from adret.geodesy import stretch_error
from raster_files import NORTH_UP, save

MOON = "+proj=longlat +R=1737400 +no_defs"
THREE_SECONDS = 1.0 / 1200.0


def degrees(north: float, west: float = 8.0, step: float = THREE_SECONDS) -> Affine:
    """North-up transform of a geographic raster."""
    return Affine(step, 0.0, west, 0.0, -step, north)


# ---------------------------------------------------------------- heights and datum


def test_an_offset_of_ten_thousand_kilometres_keeps_a_millimetre() -> None:
    millimetres = np.arange(12.0).reshape(3, 4) * 1e-3
    terrain = Terrain(millimetres + 1e7, (1.0, 1.0))
    assert terrain.datum == 1e7
    np.testing.assert_allclose(terrain.heights, millimetres, atol=2e-9)
    np.testing.assert_allclose(terrain.elevations(), millimetres + 1e7, atol=2e-9, rtol=0)


def test_the_datum_is_the_middle_of_the_range_in_whole_metres() -> None:
    terrain = Terrain([[100.2, 900.9], [np.nan, 300.0]], (1.0, 1.0))
    assert terrain.datum == 501.0  # (100.2 + 900.9) / 2 = 500.55
    np.testing.assert_array_equal(
        terrain.heights, np.array([[-400.8, 399.9], [np.nan, -201.0]], np.float32)
    )


def test_a_given_datum_is_subtracted_in_float64() -> None:
    terrain = Terrain(np.array([[16_777_217.0]]), (1.0, 1.0), datum=16_777_216.0)
    assert terrain.heights[0, 0] == 1.0


def test_the_callers_array_is_neither_changed_nor_shared() -> None:
    heights = np.array([[1.0, np.nan], [3.0, 4.0]], dtype=np.float32)
    before = heights.copy()
    terrain = Terrain(heights, (1.0, 1.0))
    np.testing.assert_array_equal(heights, before)
    heights[0, 0] = 77.0
    assert terrain.elevations()[0, 0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        terrain.heights[0, 0] = 5.0


def test_integers_masks_and_any_memory_order_are_understood() -> None:
    heights = np.asfortranarray(np.arange(6, dtype=np.int16).reshape(2, 3))
    masked = np.ma.MaskedArray(heights, mask=heights == 4)
    terrain = Terrain(masked, (1.0, 1.0))
    assert terrain.heights.flags.c_contiguous
    assert terrain.heights.dtype == np.float32
    np.testing.assert_array_equal(terrain.mask, [[False] * 3, [False, True, False]])
    np.testing.assert_array_equal(terrain.elevations()[0], [0.0, 1.0, 2.0])
    assert np.isnan(terrain.elevations()[1, 1])


def test_one_cell_is_a_terrain() -> None:
    terrain = Terrain([[5.0]], (2.0, 3.0))
    assert (terrain.shape, terrain.cell_size, terrain.datum) == ((1, 1), (2.0, 3.0), 5.0)


def test_feet_become_metres() -> None:
    feet = Terrain([[1000.0, 2000.0]], (1.0, 1.0), vertical_unit="ft")
    np.testing.assert_allclose(feet.elevations(), [[304.8, 609.6]], rtol=1e-7)
    survey = Terrain([[1000.0, 2000.0]], (1.0, 1.0), vertical_unit="US survey foot")
    np.testing.assert_allclose(survey.elevations(), [[304.8006096, 609.6012192]], rtol=1e-7)


@pytest.mark.parametrize(
    ("heights", "limit", "value"),
    [
        (np.zeros((0, 3)), "at least 1 x 1 cells", "shape (0, 3)"),
        (np.zeros(3), "two-dimensional (rows, columns)", "shape (3,)"),
        (np.zeros((2, 2, 2)), "two-dimensional (rows, columns)", "shape (2, 2, 2)"),
        (np.zeros((2, 2), complex), "real numbers", "complex128"),
        (np.zeros((2, 2), bool), "real numbers", "bool"),
        ([["a", "b"]], "real numbers", "str32"),
        (np.full((2, 2), np.nan), "a number in at least one cell", "all nodata"),
        (np.array([[0.0, np.inf]]), "finite or NaN", np.inf),
        (np.array([[0.0, -np.inf]]), "finite or NaN", -np.inf),
    ],
)
def test_heights_that_cannot_be_used_are_named(heights: Any, limit: str, value: Any) -> None:
    with pytest.raises(InputError) as caught:
        Terrain(heights, (1.0, 1.0))
    assert (caught.value.field, caught.value.limit, caught.value.value) == (
        "heights",
        limit,
        value,
    )


def test_an_undeclared_nodata_value_is_suspected() -> None:
    with pytest.raises(InputError, match=r"heights: must be within .* undeclared") as caught:
        Terrain(np.array([[1.0, -3.4028235e38]]), (1.0, 1.0))
    assert caught.value.value == -3.4028235e38


@pytest.mark.parametrize("side", [10, 10.0, np.float32(10.0), np.int16(10)])
def test_one_number_stands_for_square_cells(side: Any) -> None:
    assert Terrain(np.zeros((2, 3)), side).cell_size == (10.0, 10.0)


@pytest.mark.parametrize(
    ("cell_size", "value"),
    [
        ((math.nan, 1.0), math.nan),
        ((1.0, 0.0), 0.0),
        ((-5.0, 1.0), -5.0),
        ((math.inf, 1.0), math.inf),
        (None, None),
        (-3.0, -3.0),
        ("ab", "ab"),
        ((1.0, 2.0, 3.0), (1.0, 2.0, 3.0)),
    ],
)
def test_cell_sizes_that_cannot_be_used_are_named(cell_size: Any, value: Any) -> None:
    with pytest.raises(InputError) as caught:
        Terrain(np.zeros((2, 2)), cell_size)
    assert caught.value.field == "cell_size"
    assert caught.value.value == value or math.isnan(caught.value.value)


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"datum": math.nan}, "datum"),
        ({"vertical_unit": "cubit"}, "vertical_unit"),
        ({"crs": "EPSG:999999"}, "crs"),
        ({"crs": "EPSG:4978"}, "crs"),  # geocentric
        ({"crs": "EPSG:5773"}, "crs"),  # heights only
        ({"transform": Affine(1, 0, 0, 0, 1, 0)}, "transform"),
        ({"transform": Affine(1, 0.5, 0, 0, -1, 0)}, "transform"),
        ({"transform": "here"}, "transform"),
    ],
)
def test_other_options_that_cannot_be_used_are_named(options: dict[str, Any], field: str) -> None:
    with pytest.raises(InputError) as caught:
        Terrain(np.zeros((2, 2)), (1.0, 1.0), **options)
    assert caught.value.field == field


# ---------------------------------------------------------------- metres a cell


@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:4267", MOON, "EPSG:4171"])
@pytest.mark.parametrize("latitude", [-60.0, -10.0, 0.0, 46.0, 80.0])
def test_geographic_cells_have_the_size_that_geodesics_measure(crs: str, latitude: float) -> None:
    rows, columns = 120, 40
    transform = degrees(latitude + rows / 2 * THREE_SECONDS)
    terrain = Terrain(np.zeros((rows, columns)), crs=crs, transform=transform)
    geod = CRS(crs).get_geod()
    assert geod is not None
    half = THREE_SECONDS / 2.0
    _, _, across = geod.inv(8.0 - half, latitude, 8.0 + half, latitude)
    _, _, along = geod.inv(8.0, latitude - half, 8.0, latitude + half)
    assert terrain.cell_size == pytest.approx((across, along), rel=1e-7)


def test_a_moon_raster_knows_its_sphere() -> None:
    terrain = Terrain(np.zeros((2, 2)), crs=MOON, transform=degrees(0.0, step=1.0))
    assert terrain.body_radius == 1_737_400.0
    assert terrain.cell_size[1] == pytest.approx(math.radians(1.0) * 1_737_400.0)
    earth = Terrain(np.zeros((2, 2)), crs="EPSG:4326", transform=degrees(0.0))
    assert earth.body_radius == pytest.approx(6_371_008.77, abs=0.01)
    assert Terrain(np.zeros((2, 2)), (1.0, 1.0)).body_radius is None


def test_projected_cells_keep_the_size_of_their_grid() -> None:
    terrain = Terrain(np.zeros((5, 5)), crs="EPSG:32633", transform=NORTH_UP)
    assert terrain.cell_size == (10.0, 10.0)  # the ground is 0.04 % off and stays so
    assert terrain.azimuth_error == 0.0
    assert terrain.latitude_bands(1e-6) == [(0, 5, (10.0, 10.0))]


def test_a_grid_in_survey_feet_is_turned_into_metres() -> None:
    transform = Affine(100.0, 0.0, 6_000_000.0, 0.0, -50.0, 2_000_000.0)
    terrain = Terrain(np.zeros((4, 4)), crs="EPSG:2227", transform=transform)
    assert terrain.cell_size == pytest.approx((100 * 1200 / 3937, 50 * 1200 / 3937), rel=1e-12)


def test_web_mercator_cells_have_their_size_on_the_ground() -> None:
    to_grid = Transformer.from_crs("EPSG:4326", "EPSG:3857", always_xy=True)
    x, y = to_grid.transform(-122.4, 60.0)
    transform = Affine(100.0, 0.0, x, 0.0, -100.0, y + 1000.0)
    terrain = Terrain(np.zeros((20, 20)), crs="EPSG:3857", transform=transform)
    geod = Geod(ellps="WGS84")
    east = to_grid.transform(x + 100.0, y, direction="INVERSE")
    north = to_grid.transform(x, y + 100.0, direction="INVERSE")
    assert terrain.cell_size[0] == pytest.approx(geod.inv(-122.4, 60.0, *east)[2], rel=1e-4)
    assert terrain.cell_size[1] == pytest.approx(geod.inv(-122.4, 60.0, *north)[2], rel=1e-4)
    assert terrain.cell_size[0] == pytest.approx(50.0, rel=0.01)


# ---------------------------------------------------------------- azimuths


def test_the_azimuth_error_is_that_of_real_directions_at_the_edge() -> None:
    rows = 1200
    terrain = Terrain(np.zeros((rows, 40)), crs="EPSG:4326", transform=degrees(47.0))
    dx, dy = terrain.cell_size
    geod = Geod(ellps="WGS84")
    worst = 0.0
    for row in (0, rows - 1):
        latitude = 47.0 - (row + 0.5) * THREE_SECONDS
        for azimuth in np.radians(np.arange(0.0, 360.0, 1.0)):
            # What the grid takes for this azimuth, 10 cells away, measured on the ellipsoid.
            columns, lines = np.sin(azimuth) * 10 * dy / dx, np.cos(azimuth) * 10
            found, _, _ = geod.inv(
                8.0, latitude, 8.0 + columns * THREE_SECONDS, latitude + lines * THREE_SECONDS
            )
            # Meridians converge on the way; that share is documented apart.
            found -= math.degrees(
                math.radians(columns * THREE_SECONDS) * math.sin(math.radians(latitude)) / -2.0
            )
            error = (math.radians(found) - azimuth + math.pi) % (2.0 * math.pi) - math.pi
            worst = max(worst, abs(error))
    assert worst == pytest.approx(terrain.azimuth_error, rel=0.02)
    by_hand = math.log(math.cos(math.radians(46.5)) / math.cos(math.radians(47.0))) / 2.0
    assert terrain.azimuth_error == pytest.approx(by_hand, rel=0.01)


def test_far_targets_lie_off_the_geodesic_as_documented() -> None:
    geod = Geod(ellps="WGS84")
    found, _, _ = geod.inv(8.0, 46.0, 9.0, 46.0)  # due east by the grid
    documented = math.sin(math.radians(46.0)) * 1.0 / 2.0
    assert 90.0 - found == pytest.approx(documented, rel=0.01)


@pytest.mark.parametrize("north", [75.0, 3.0, -30.0])
@pytest.mark.parametrize("limit_deg", [0.02, 0.1, 0.5])
def test_latitude_bands_cover_all_rows_within_the_limit(north: float, limit_deg: float) -> None:
    step = 0.01
    rows = 700
    transform = degrees(north, step=step)
    terrain = Terrain(np.zeros((rows, 3)), crs="EPSG:4326", transform=transform)
    limit = math.radians(limit_deg)
    bands = terrain.latitude_bands(limit)
    assert [band.start for band in bands] == [0, *(band.stop for band in bands[:-1])]
    assert bands[-1].stop == rows
    geod = Geod(ellps="WGS84")
    for band in bands:
        for row in {band.start, (band.start + band.stop) // 2, band.stop - 1}:
            latitude = north - (row + 0.5) * step
            _, _, dx = geod.inv(8.0 - step / 2, latitude, 8.0 + step / 2, latitude)
            _, _, dy = geod.inv(8.0, latitude - step / 2, 8.0, latitude + step / 2)
            assert stretch_error((dx, dy), band.cell_size) <= limit * 1.001 + 1e-7
    wide = terrain.latitude_bands(0.5)
    assert wide == [(0, rows, terrain.cell_size)]


def test_an_equidistant_cylindrical_moon_is_cut_like_a_geographic_one() -> None:
    radius = 1_737_400.0
    step = math.radians(0.02) * radius
    transform = Affine(step, 0.0, 0.0, 0.0, -step, math.radians(20.0) * radius)
    plate = f"+proj=eqc +lat_ts=0 +lon_0=0 +R={radius} +units=m +no_defs"
    flat = Terrain(np.zeros((1000, 4)), crs=plate, transform=transform)
    globe = Terrain(np.zeros((1000, 4)), crs=MOON, transform=degrees(20.0, step=0.02))
    assert flat.cell_size == pytest.approx(globe.cell_size, rel=1e-6)
    assert flat.azimuth_error == pytest.approx(globe.azimuth_error, rel=1e-4)
    got, want = flat.latitude_bands(0.005), globe.latitude_bands(0.005)
    assert len(got) == len(want) > 2
    for one, other in zip(got, want, strict=True):
        assert abs(one.start - other.start) <= 1
        assert one.cell_size == pytest.approx(other.cell_size, rel=1e-5)


@pytest.mark.parametrize(("north", "rows"), [(90.0, 10), (-89.0, 100)])
def test_a_pole_on_a_geographic_raster_is_refused(north: float, rows: int) -> None:
    with pytest.raises(RasterError, match="latitude: must be within") as caught:
        Terrain(np.zeros((rows, 4)), crs="EPSG:4326", transform=degrees(north, step=0.01))
    assert caught.value.field == "latitude"


def test_grid_convergence_is_the_azimuth_of_grid_north() -> None:
    # UTM 33: 2 degrees east of the central meridian at 45.1 N, convergence atan(tan dL sin lat).
    to_grid = Transformer.from_crs("EPSG:4326", "EPSG:32633", always_xy=True)
    x, y = to_grid.transform(17.0, 45.1)
    terrain = Terrain(np.zeros((2, 2)), crs="EPSG:32633", transform=Affine(10, 0, x, 0, -10, y))
    expected = math.degrees(math.atan(math.tan(math.radians(2.0)) * math.sin(math.radians(45.1))))
    assert terrain.grid_convergence_deg == pytest.approx(expected, abs=2e-3)
    geographic = Terrain(np.zeros((2, 2)), crs="EPSG:4326", transform=degrees(45.0))
    assert geographic.grid_convergence_deg == 0.0
    assert Terrain(np.zeros((2, 2)), (1.0, 1.0)).grid_convergence_deg is None


@pytest.mark.parametrize("limit", [0.0, -1.0, 0.6, math.nan])
def test_a_limit_that_cannot_be_kept_is_refused(limit: float) -> None:
    with pytest.raises(InputError, match="max_azimuth_error"):
        Terrain(np.zeros((2, 2)), (1.0, 1.0)).latitude_bands(limit)


# ---------------------------------------------------------------- windows


def test_a_window_is_the_same_place_with_the_same_numbers(rng: np.random.Generator) -> None:
    whole = Terrain(rng.normal(0, 100, (40, 50)), crs="EPSG:32633", transform=NORTH_UP)
    part = whole.window((10, 20), slice(5, 12), halo=3)
    assert part.shape == (16, 13)
    assert part.core == (slice(3, 13), slice(3, 10))
    assert (part.datum, part.cell_size, part.crs) == (whole.datum, whole.cell_size, whole.crs)
    np.testing.assert_array_equal(part.heights[part.core], whole.heights[10:20, 5:12])
    assert part.transform is not None
    assert (part.transform.c, part.transform.f) == (500_000.0 + 2 * 10, 5_000_000.0 - 7 * 10)


def test_a_halo_ends_at_the_edge_of_the_raster() -> None:
    whole = Terrain(np.arange(30.0).reshape(5, 6), (1.0, 1.0))
    part = whole.window((0, 2), (4, 6), halo=2)
    assert part.shape == (4, 4)
    assert part.core == (slice(0, 2), slice(2, 4))
    np.testing.assert_array_equal(part.heights[part.core], whole.heights[0:2, 4:6])


def test_a_window_of_nodata_alone_is_a_terrain() -> None:
    heights = np.full((4, 4), np.nan)
    heights[3, 3] = 7.0
    part = Terrain(heights, (1.0, 1.0)).window((0, 2), (0, 2))
    assert part.mask.all()
    assert part.datum == 7.0


@pytest.mark.parametrize("limit", [0.002, 0.01])
def test_windows_of_windows_are_cut_into_the_bands_of_the_whole(limit: float) -> None:
    whole = Terrain(np.zeros((900, 4)), crs="EPSG:4326", transform=degrees(60.0, step=0.01))
    cells = {
        row: band.cell_size
        for band in whole.latitude_bands(limit)
        for row in range(band.start, band.stop)
    }
    for start, stop in [(0, 40), (333, 700), (899, 900)]:
        part = whole.window((start, stop), (0, 4), halo=10)
        inner = part.window(*part.core)
        for band in inner.latitude_bands(limit):
            for row in range(band.start, band.stop):
                assert cells[start + row] == pytest.approx(band.cell_size, rel=1e-12)


@pytest.mark.parametrize(
    ("rows", "cols", "halo", "field"),
    [
        ((0, 6), (0, 5), 0, "rows"),
        ((2, 2), (0, 5), 0, "rows"),
        ((0, 5), (-1, 2), 0, "columns"),
        (slice(0, 5, 2), (0, 5), 0, "rows"),
        (3, (0, 5), 0, "rows"),
        ((0, 5), (0, 5), -1, "halo"),
        ((0, 5), (0, 5), 1.5, "halo"),
    ],
)
def test_windows_outside_the_raster_are_refused(
    rows: Any, cols: Any, halo: Any, field: str
) -> None:
    with pytest.raises(InputError) as caught:
        Terrain(np.zeros((5, 5)), (1.0, 1.0)).window(rows, cols, halo)
    assert caught.value.field == field


# ---------------------------------------------------------------- real rasters


def test_the_example_mountain_has_the_published_numbers(example_dem: Path) -> None:
    terrain = Terrain.open(example_dem)
    assert terrain.shape == (310, 358)
    assert terrain.cell_size == pytest.approx((200.0, 200.0))
    assert terrain.crs is not None
    assert terrain.crs.to_epsg() == 2056
    assert np.nanmin(terrain.elevations()) == pytest.approx(502.0, abs=0.05)
    assert np.nanmax(terrain.elevations()) == pytest.approx(4216.3, abs=0.05)
    # Bessel 1841; Swiss grid north lies 0.35 degrees east of true north at 7.9 E.
    assert terrain.body_radius == pytest.approx((2 * 6377397.155 + 6356078.963) / 3, abs=0.01)
    assert terrain.grid_convergence_deg == pytest.approx(0.35, abs=0.01)


@pytest.mark.parametrize(
    ("name", "cell", "low", "high", "nodata"),
    [
        ("alpine_exploradores_aster_utm18s_30m_voids", (30.0, 30.0), 317.7, 3959.9, 0.0267),
        ("geo_pyrenees_srtm3_epsg4326_voids", (69.042, 92.561), -20.0, 3100.0, 0.0027),
        ("sea_nice_srtm3_epsg4326_voids", (67.397, 92.585), -11.0, 2064.0, 0.0011),
        ("urban_tatras_dsm_1m_voids", (1.0, 1.0), 987.3, 1026.2, 0.0265),
        ("moon_southpole_stere_474m", (473.8, 473.8), -6663.5, 7016.0, 0.0),
        ("sanfrancisco_webmercator_nonsquare", (5.318, 4.773), 0.4, 114.9, 0.0),
    ],
)
def test_real_rasters_are_read_as_their_manifest_says(
    name: str, cell: tuple[float, float], low: float, high: float, nodata: float, data_dir: Path
) -> None:
    terrain = Terrain.open(data_dir / "dem" / f"{name}.tif")
    assert terrain.cell_size == pytest.approx(cell, rel=1e-4)
    assert np.nanmin(terrain.elevations()) == pytest.approx(low, abs=0.06)
    assert np.nanmax(terrain.elevations()) == pytest.approx(high, abs=0.06)
    assert terrain.mask.mean() == pytest.approx(nodata, abs=6e-5)


def test_a_raster_in_degrees_is_read_in_metres(tmp_path: Path) -> None:
    path = save(tmp_path / "a.tif", np.eye(60), crs="EPSG:4326", transform=degrees(46.0))
    terrain = Terrain.open(path)
    geod = Geod(ellps="WGS84")
    middle = 46.0 - 30 * THREE_SECONDS
    assert terrain.cell_size[0] == pytest.approx(
        geod.inv(8.0, middle, 8.0 + THREE_SECONDS, middle)[2], rel=1e-7
    )
