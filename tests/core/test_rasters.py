"""Rasters in and out: what is read, what is refused, and that files appear whole or not at all."""

import errno
import math
import os
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from affine import Affine
from PIL import Image

from adret import InputError, RasterError, Terrain, cogs, rasters
from raster_files import NORTH_UP, save

HEIGHTS = np.array([[10.0, 20.0, 30.0], [40.0, 50.0, 60.0]], dtype=np.float32)

VRT = """<VRTDataset rasterXSize="2" rasterYSize="2"><VRTRasterBand dataType="Float32" band="1">
<SimpleSource><SourceFilename>{}</SourceFilename></SimpleSource></VRTRasterBand></VRTDataset>"""


def refusal(path: Path | str, **options: Any) -> InputError:
    """The error that opening gives."""
    with pytest.raises(InputError) as caught:
        Terrain.open(path, **options)
    assert str(caught.value).count("\n") == 0
    return caught.value


# ---------------------------------------------------------------- reading


def test_heights_cell_size_and_place_are_those_of_the_file(tmp_path: Path) -> None:
    terrain = Terrain.open(save(tmp_path / "a.tif", HEIGHTS))
    np.testing.assert_array_equal(terrain.elevations(), HEIGHTS)
    assert terrain.cell_size == (10.0, 10.0)
    assert terrain.transform == NORTH_UP
    assert terrain.crs is not None
    assert terrain.crs.to_epsg() == 32633


@pytest.mark.parametrize("dtype", ["int16", "uint16", "int32", "float32", "float64", "uint8"])
def test_declared_nodata_becomes_nan_in_every_dtype(dtype: str, tmp_path: Path) -> None:
    path = save(tmp_path / "a.tif", HEIGHTS.astype(dtype), nodata=40)
    terrain = Terrain.open(path)
    want = HEIGHTS.copy()
    want[1, 0] = np.nan
    np.testing.assert_array_equal(terrain.elevations(), want)


def test_nan_stays_nodata_beside_a_declared_value(tmp_path: Path) -> None:
    heights = HEIGHTS.copy()
    heights[0, 0], heights[0, 1] = np.nan, -9999.0
    terrain = Terrain.open(save(tmp_path / "a.tif", heights, nodata=-9999.0))
    np.testing.assert_array_equal(terrain.mask, [[True, True, False], [False] * 3])


def test_int32_and_float64_keep_millimetres_at_great_heights(tmp_path: Path) -> None:
    heights = np.array([[10_000_000.001, 10_000_000.002]])
    terrain = Terrain.open(save(tmp_path / "a.tif", heights))
    np.testing.assert_allclose(np.diff(terrain.heights), [[1e-3]], atol=2e-9)
    whole = np.array([[2**24 + 1, 2**24 + 3]], dtype=np.int32)
    np.testing.assert_array_equal(Terrain.open(save(tmp_path / "b.tif", whole)).elevations(), whole)


def test_scale_offset_and_unit_of_the_band_are_applied(tmp_path: Path) -> None:
    stored = np.array([[0, 1000, 2000]], dtype=np.uint16)
    path = save(tmp_path / "a.tif", stored, scale=0.1, offset=-50.0, unit="ft", nodata=2000)
    np.testing.assert_allclose(
        Terrain.open(path).elevations(), np.array([[-50.0, 50.0, np.nan]]) * 0.3048, rtol=1e-6
    )
    np.testing.assert_allclose(
        Terrain.open(path, vertical_unit="m").elevations(), [[-50.0, 50.0, np.nan]], rtol=1e-6
    )


def test_a_vertical_axis_in_feet_is_converted(tmp_path: Path) -> None:
    path = save(tmp_path / "a.tif", HEIGHTS, crs="EPSG:26910+6360")  # NAVD88 height (ftUS)
    np.testing.assert_allclose(
        Terrain.open(path).elevations(), HEIGHTS * 1200.0 / 3937.0, rtol=1e-6
    )


def test_an_unknown_unit_of_heights_is_refused_until_it_is_said(tmp_path: Path) -> None:
    path = save(tmp_path / "a.tif", HEIGHTS, unit="furlong")
    error = refusal(path)
    assert (error.field, error.value) == ("vertical_unit", "furlong")
    assert Terrain.open(path, vertical_unit="m").elevations()[0, 0] == 10.0


def test_a_south_up_file_is_turned(tmp_path: Path) -> None:
    south_up = Affine(10.0, 0.0, 500_000.0, 0.0, 10.0, 4_999_980.0)
    terrain = Terrain.open(save(tmp_path / "a.tif", HEIGHTS[::-1], transform=south_up))
    np.testing.assert_array_equal(terrain.elevations(), HEIGHTS)
    assert terrain.transform == NORTH_UP
    part = Terrain.open(tmp_path / "a.tif", window=((1, 2), (1, 3)))
    np.testing.assert_array_equal(part.elevations(), HEIGHTS[1:2, 1:3])


@pytest.mark.parametrize(
    ("transform", "field"),
    [
        (Affine(9, 2, 0, 2, -9, 0), "transform"),
        (Affine(0, 10, 0, 10, 0, 0), "cell size"),
        (Affine(-10, 0, 0, 0, -10, 0), "transform"),
        (Affine(math.nan, 0, 0, 0, -10, 0), "cell size"),
    ],
    ids=["sheared", "transposed", "mirrored", "nan"],
)
def test_other_geotransforms_are_refused_by_name(
    transform: Affine, field: str, tmp_path: Path
) -> None:
    assert refusal(save(tmp_path / "a.tif", HEIGHTS, transform=transform)).field == field


def test_a_window_of_a_file_is_that_part_of_the_whole(tmp_path: Path) -> None:
    path = save(tmp_path / "a.tif", np.arange(120.0).reshape(10, 12))
    whole = Terrain.open(path)
    for window in [((2, 5), (3, 9)), (slice(2, 5), slice(3, 9))]:
        part = Terrain.open(path, window=window)
        np.testing.assert_array_equal(part.elevations(), whole.elevations()[2:5, 3:9])
        assert part.transform == Affine(10.0, 0.0, 500_030.0, 0.0, -10.0, 4_999_980.0)


@pytest.mark.parametrize("window", [((0, 3), (0, 1)), ((1, 1), (0, 1)), 5, ((0, 1), "x")])
def test_windows_outside_the_file_are_refused(window: Any, tmp_path: Path) -> None:
    path = save(tmp_path / "a.tif", HEIGHTS)
    assert refusal(path, window=window).field in ("rows", "columns", "window")


def test_bands_are_counted_from_one(tmp_path: Path) -> None:
    path = save(tmp_path / "a.tif", np.stack([HEIGHTS, HEIGHTS + 1.0]))
    assert Terrain.open(path, 2).elevations()[0, 0] == 11.0
    error = refusal(path, band=3)
    assert (error.field, error.limit, error.value) == ("band", "between 1 and 2", 3)
    assert refusal(path, band=0).value == 0


def test_an_ascii_grid_is_read(tmp_path: Path) -> None:
    path = tmp_path / "grid.asc"
    path.write_text(
        "ncols 3\nnrows 2\nxllcorner 100\nyllcorner 200\ncellsize 25\nNODATA_value -9999\n"
        "1.5 2 3\n4 -9999 6\n"
    )
    terrain = Terrain.open(path)
    np.testing.assert_array_equal(terrain.elevations(), [[1.5, 2.0, 3.0], [4.0, np.nan, 6.0]])
    assert terrain.cell_size == (25.0, 25.0)
    assert terrain.crs is None


def test_a_png_needs_its_cell_size(tmp_path: Path) -> None:
    path = tmp_path / "heights.png"
    Image.fromarray(np.arange(6, dtype=np.uint16).reshape(2, 3) * 1000).save(path)
    error = refusal(path)
    assert error.field == "cell_size"
    terrain = Terrain.open(path, cell_size=(2.0, 3.0))
    np.testing.assert_array_equal(terrain.elevations(), [[0, 1000, 2000], [3000, 4000, 5000]])
    assert terrain.cell_size == (2.0, 3.0)


def test_cells_that_look_like_degrees_need_a_crs(tmp_path: Path) -> None:
    path = save(tmp_path / "a.tif", HEIGHTS, crs=None, transform=Affine(1e-3, 0, 8, 0, -1e-3, 46))
    assert refusal(path).field == "crs"
    assert Terrain.open(path, cell_size=(78.0, 111.0)).cell_size == (78.0, 111.0)


def test_a_mask_band_hides_cells(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=True):
        save(path, HEIGHTS)
        with rasterio.open(path, "r+") as target:
            target.write_mask(np.array([[True, False, True], [True] * 3]))
    np.testing.assert_array_equal(Terrain.open(path).mask, [[False, True, False], [False] * 3])


# ---------------------------------------------------------------- refusals


def test_what_is_no_raster_is_refused_by_name(tmp_path: Path) -> None:
    text = tmp_path / "notes.tif"
    text.write_text("not a raster")
    empty = tmp_path / "empty.tif"
    empty.touch()
    broken = tmp_path / "broken.tif"
    broken.write_bytes(b"II*\0" + b"\xff" * 40)
    for path, limit in [
        (tmp_path / "missing.tif", "an existing file"),
        (tmp_path, "a regular file"),
        (text, "a GeoTIFF, an Arc/Info ASCII grid or a PNG"),
        (empty, "a raster file that is not empty"),
        (broken, "a readable GTiff file"),
    ]:
        error = refusal(path)
        assert isinstance(error, RasterError)
        assert (error.field, error.value) == ("path", str(path))
        assert error.limit.startswith(limit)


@pytest.mark.parametrize(
    "path",
    [
        "/vsicurl/http://127.0.0.1:9/x.tif",
        "/vsizip/a.zip/b.tif",
        "//vsimem/x.tif",
        "http://127.0.0.1:9/x.tif",
        "file:///etc/hostname",
        "zip://a.zip!b.tif",
        "a\0b.tif",
    ],
)
def test_urls_and_virtual_paths_never_reach_gdal(path: str) -> None:
    error = refusal(path)
    assert (error.field, error.value) == ("path", path)
    assert error.limit == "a plain file path (no URL, no /vsi path)" or path.startswith("//")


@pytest.mark.parametrize("text", [VRT, "<GDAL_WMS><Service name='TMS'/></GDAL_WMS>", "\n " + VRT])
def test_a_virtual_raster_is_refused_under_any_name(text: str, tmp_path: Path) -> None:
    secret = save(tmp_path / "secret.tif", HEIGHTS)
    path = tmp_path / "harmless.tif"
    path.write_text(text.format(secret))
    assert refusal(path).limit == "a GeoTIFF, an Arc/Info ASCII grid or a PNG"


def test_subdataset_names_are_files_or_nothing(tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.chdir(tmp_path)
    save(tmp_path / "a.tif", HEIGHTS)
    assert refusal("GTIFF_DIR:1:a.tif").limit == "an existing file"


def test_sidecar_files_are_not_read(tmp_path: Path) -> None:
    path = save(tmp_path / "a.tif", HEIGHTS, crs=None, transform=None)
    (tmp_path / "a.tfw").write_text("10\n0\n0\n-10\n500000\n5000000\n")
    (tmp_path / "a.tif.aux.xml").write_text(
        "<PAMDataset><GeoTransform>1, 2, 0, 3, 0, -2</GeoTransform></PAMDataset>"
    )
    assert refusal(path).field == "cell_size"
    grid = tmp_path / "b.asc"
    grid.write_text("ncols 1\nnrows 1\nxllcorner 0\nyllcorner 0\ncellsize 5\n1\n")
    (tmp_path / "b.prj").write_text('GEOGCS["WGS 84",DATUM["WGS_1984"]]')
    assert Terrain.open(grid).crs is None


def test_complex_numbers_are_refused(tmp_path: Path) -> None:
    error = refusal(save(tmp_path / "a.tif", HEIGHTS.astype(np.complex64)))
    assert (error.field, error.limit, error.value) == ("dtype", "real numbers", "complex64")


def test_a_raster_of_nodata_alone_is_refused(tmp_path: Path) -> None:
    error = refusal(save(tmp_path / "a.tif", np.full((3, 3), -9999.0), nodata=-9999.0))
    assert (error.field, error.value) == ("heights", "all nodata")


def test_declared_sizes_are_held_against_limits_before_decoding(tmp_path: Path) -> None:
    path = tmp_path / "huge.tif"
    save(path, np.zeros((1, 1), np.uint8))
    # The header alone declares 150,000 x 150,000 cells; the file holds a few hundred bytes.
    profile = {
        "driver": "GTiff",
        "width": 150_000,
        "height": 150_000,
        "count": 1,
        "dtype": "float32",
    }
    with rasterio.open(
        path, "w", **profile, tiled=True, sparse_ok=True, transform=NORTH_UP, bigtiff=True
    ):
        pass
    error = refusal(path)
    assert (error.field, error.value) == ("size", 150_000**2)
    part = Terrain.open(path, window=((0, 2), (0, 2)))
    assert part.shape == (2, 2)
    with pytest.raises(RasterError, match="size: must be 1 to 100 rows and columns"):
        rasters.open_heights(path, limits=rasters.ReadLimits(max_side=100))
    with pytest.raises(RasterError, match="block: must be at most 1000 bytes"):
        rasters.open_heights(path, limits=rasters.ReadLimits(max_block_bytes=1000))


def test_an_unknown_unit_of_the_crs_is_refused(tmp_path: Path) -> None:
    engineering = (
        'LOCAL_CS["site",LOCAL_DATUM["site",0],UNIT["unknown",0],AXIS["E",EAST],AXIS["N",NORTH]]'
    )
    with pytest.raises(InputError) as caught:
        Terrain(HEIGHTS, (1.0, 1.0), crs=engineering)
    assert caught.value.field in ("crs unit", "crs")


# ---------------------------------------------------------------- writing


@pytest.fixture
def terrain() -> Terrain:
    return Terrain(np.zeros((700, 1100)), crs="EPSG:32633", transform=NORTH_UP)


@pytest.fixture
def layers(rng: np.random.Generator) -> np.ndarray:
    made = rng.uniform(-90.0, 90.0, (3, 700, 1100)).astype(np.float32)
    made[0, :20, :30] = np.nan
    return made


NAMES = ("azimuth 0.0 deg", "azimuth 120.0 deg", "azimuth 240.0 deg")
ANGLES = {"dtype": "uint16", "scale": 180.0 / 65534, "offset": -90.0, "nodata": 65535}


def test_a_written_raster_says_what_it_holds(
    terrain: Terrain, layers: np.ndarray, tmp_path: Path
) -> None:
    path = tmp_path / "out.tif"
    rasters.write(
        path, layers, terrain, names=NAMES, unit="degree", tags={"ADRET_DEFINITION": "<1 - sin h>"}
    )
    with rasterio.open(path) as source:
        np.testing.assert_array_equal(source.read(), layers)
        assert source.descriptions == NAMES
        assert set(source.units) == {"degree"}
        assert source.tags()["ADRET_DEFINITION"] == "<1 - sin h>"
        assert math.isnan(source.nodata)
        assert source.crs.to_epsg() == 32633
        assert source.transform == NORTH_UP
    assert sorted(os.listdir(tmp_path)) == ["out.tif"]


def test_angles_on_sixteen_bits_are_within_half_a_step(
    terrain: Terrain, layers: np.ndarray, tmp_path: Path
) -> None:
    path = tmp_path / "out.tif"
    layers[1, 0, 0], layers[1, 0, 1] = -90.0, 90.0
    rasters.write(path, layers, terrain, names=NAMES, unit="degree", tags={}, **ANGLES)
    with rasterio.open(path) as source:
        stored = source.read()
        assert stored.dtype == np.uint16
        assert set(source.scales) == {180.0 / 65534}
        assert set(source.offsets) == {-90.0}
        assert source.nodata == 65535
    np.testing.assert_array_equal(stored == 65535, np.isnan(layers))
    assert (stored[1, 0, 0], stored[1, 0, 1]) == (0, 65534)
    angles = stored * (180.0 / 65534) - 90.0
    assert np.nanmax(np.abs(angles - layers)) <= 0.5 * 180.0 / 65534 + 2e-5
    # Read back as a terrain, scale and offset are applied.
    again = Terrain.open(path, band=1, vertical_unit="m")
    np.testing.assert_array_equal(again.mask, np.isnan(layers[0]))


@pytest.mark.parametrize("in_memory", [True, False])
def test_the_file_is_a_cloud_optimised_geotiff(
    in_memory: bool, terrain: Terrain, layers: np.ndarray, tmp_path: Path, monkeypatch: Any
) -> None:
    if not in_memory:
        monkeypatch.setattr(cogs, "IN_MEMORY", 0)
    path = tmp_path / "out.tif"
    rasters.write(path, layers, terrain, names=NAMES, unit="1", tags={})
    with rasterio.open(path) as source:
        assert source.profile["tiled"]
        assert source.block_shapes[0] == (512, 512)
        assert source.compression.value == "ZSTD"
        assert source.overviews(1) == [2, 4]
        np.testing.assert_array_equal(source.read(), layers)
    with rasterio.open(path, overview_level=0) as half:
        want = layers[2, 100:102, 200:202].mean()
        assert half.read(3)[50, 100] == pytest.approx(want, abs=1e-4)
    # Directories first, then data from the coarsest overview to the full resolution.
    directories = list(tiff_directories(path.read_bytes()))
    assert [width for _, width, _ in directories] == [1100, 550, 275]
    first_data = [min(offsets) for _, _, offsets in directories]
    assert max(place for place, _, _ in directories) < min(first_data)
    assert first_data == sorted(first_data, reverse=True)


def tiff_directories(data: bytes) -> Iterator[tuple[int, int, list[int]]]:
    """(place, width, tile offsets) of each directory of a classic little-endian TIFF."""
    assert data[:4] == b"II*\0"
    (place,) = struct.unpack_from("<I", data, 4)
    while place:
        (count,) = struct.unpack_from("<H", data, place)
        width, offsets = 0, []
        for entry in range(count):
            tag, kind, number, value = struct.unpack_from("<HHII", data, place + 2 + 12 * entry)
            if tag == 256:
                width = value & 0xFFFF if kind == 3 else value
            if tag == 324:
                offsets = (
                    [value] if number == 1 else list(struct.unpack_from(f"<{number}I", data, value))
                )
        yield place, width, offsets
        (place,) = struct.unpack_from("<I", data, place + 2 + 12 * count)


def test_the_same_input_gives_the_same_bytes_on_any_way(
    terrain: Terrain, layers: np.ndarray, tmp_path: Path
) -> None:
    for name in ("a.tif", "b.tif"):
        rasters.write(tmp_path / name, layers, terrain, names=NAMES, unit="1", tags={"X": "1"})
    assert (tmp_path / "a.tif").read_bytes() == (tmp_path / "b.tif").read_bytes()


def test_layers_may_come_in_any_order_from_one_buffer(tmp_path: Path) -> None:
    terrain = Terrain(np.zeros((4, 5)), (10.0, 20.0))
    done: list[tuple[int, int]] = []

    def layers() -> Iterator[tuple[int, np.ndarray]]:
        buffer = np.empty((4, 5), np.float32)
        for k in (2, 0, 1):
            buffer[:] = k
            yield k, buffer

    rasters.write(
        tmp_path / "a.tif",
        layers(),
        terrain,
        names=NAMES,
        unit="1",
        tags={},
        progress=lambda k, n: done.append((k, n)),
    )
    with rasterio.open(tmp_path / "a.tif") as source:
        np.testing.assert_array_equal(source.read()[:, 0, 0], [0, 1, 2])
        # Without a transform the file lies in metres from its south-west corner.
        assert source.transform == Affine(10.0, 0.0, 0.0, 0.0, -20.0, 80.0)
    assert done == [(1, 3), (2, 3), (3, 3)]


@pytest.mark.parametrize("failure", [RuntimeError("no"), KeyboardInterrupt(), MemoryError()])
def test_a_failure_on_the_way_leaves_no_file(failure: BaseException, tmp_path: Path) -> None:
    terrain = Terrain(np.zeros((4, 5)), (10.0, 10.0))

    def layers() -> Iterator[tuple[int, np.ndarray]]:
        yield 0, np.zeros((4, 5), np.float32)
        raise failure

    with pytest.raises(type(failure)):
        rasters.write(tmp_path / "a.tif", layers(), terrain, names="ab", unit="1", tags={})
    assert os.listdir(tmp_path) == []


def test_a_failure_leaves_the_older_file_as_it_was(tmp_path: Path) -> None:
    terrain = Terrain(np.zeros((4, 5)), (10.0, 10.0))
    path = tmp_path / "a.tif"
    path.write_bytes(b"older")
    with pytest.raises(InputError, match="layers: must be one a name"):
        rasters.write(path, iter(()), terrain, names=("one",), unit="1", tags={})
    assert path.read_bytes() == b"older"
    assert os.listdir(tmp_path) == ["a.tif"]


FULL_DISK = """
import os, resource, signal, sys
import numpy as np
from adret import Terrain, cogs, rasters
cogs.IN_MEMORY = int(sys.argv[2])
terrain = Terrain(np.zeros((600, 600)), (10.0, 10.0))
layer = np.random.default_rng(0).random((600, 600), dtype=np.float32)
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
for limit in (20_000, 700_000, 1_200_000):
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    try:
        rasters.write(sys.argv[1] + "/a.tif", layer, terrain, names="a", unit="1", tags={})
    except OSError as error:
        print(error.errno, os.listdir(sys.argv[1]))
"""


@pytest.mark.parametrize("in_memory", [0, 1 << 30])
def test_a_full_disk_is_reported_and_leaves_no_file(in_memory: int, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", FULL_DISK, str(tmp_path), str(in_memory)],
        capture_output=True,
        text=True,
        check=True,
    )
    code = errno.EFBIG if in_memory else errno.EIO
    assert done.stdout.splitlines() == [f"{code} []"] * 3


@pytest.mark.parametrize(
    ("out", "limit"),
    [
        ("missing/a.tif", "in a folder that exists"),
        ("folder", "a file name, not a folder"),
        ("there.tif", "a new file (or ask to overwrite)"),
        ("/vsimem/a.tif", "a plain file path (no URL, no /vsi path)"),
    ],
)
def test_places_that_cannot_be_written_are_named(out: str, limit: str, tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "there.tif").touch()
    place = out if out.startswith("/") else str(tmp_path / out)
    with pytest.raises(RasterError) as caught:
        rasters.write(
            place,
            np.zeros((1, 1), np.float32),
            Terrain([[1.0]], (1.0, 1.0)),
            names="a",
            unit="1",
            tags={},
            overwrite=False,
        )
    assert (caught.value.field, caught.value.limit, caught.value.value) == ("out", limit, place)


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"dtype": "int64"}, "dtype"),
        ({"scale": 2.0}, "scale"),
        ({"names": ("a", "b")}, "layers"),
        ({"layers": np.zeros((3, 3), np.float32)}, "layers"),
        ({"layers": iter([(5, np.zeros((2, 2), np.float32))])}, "layers"),
    ],
)
def test_layers_that_do_not_fit_are_refused(
    options: dict[str, Any], field: str, tmp_path: Path
) -> None:
    given = {"layers": np.zeros((2, 2), np.float32), "names": ("a",), "unit": "1", "tags": {}}
    given |= options
    with pytest.raises(InputError) as caught:
        rasters.write(
            tmp_path / "a.tif", given.pop("layers"), Terrain(np.zeros((2, 2)), (1, 1)), **given
        )
    assert caught.value.field == field
    assert os.listdir(tmp_path) == []


# ---------------------------------------------------------------- previews


def pixels(path: Path) -> np.ndarray:
    with Image.open(path) as picture:
        assert picture.mode == "RGBA"
        return np.asarray(picture)


def test_a_grey_preview_runs_from_black_to_white_and_hides_nodata(tmp_path: Path) -> None:
    layer = np.array([[0.0, 5.0], [10.0, np.nan]], np.float32)
    rasters.preview(tmp_path / "a.png", layer, low=0.0, high=10.0)
    np.testing.assert_array_equal(
        pixels(tmp_path / "a.png"),
        [[[0, 0, 0, 255], [128, 128, 128, 255]], [[255, 255, 255, 255], [0, 0, 0, 0]]],
    )


def test_a_preview_stretches_between_percentiles(tmp_path: Path) -> None:
    layer = np.linspace(100.0, 200.0, 10_001, dtype=np.float32).reshape(73, 137)
    layer[0, 0], layer[-1, -1] = -1e6, 1e6  # two outliers do not darken the rest
    rasters.preview(tmp_path / "a.png", layer)
    grey = pixels(tmp_path / "a.png")[..., 0]
    assert grey[36, 68] == pytest.approx(128, abs=1)
    assert (grey[0, 0], grey[-1, -1]) == (0, 255)


def test_light_is_shown_with_gamma_and_one_stretch_for_all_colours(tmp_path: Path) -> None:
    layer = np.zeros((1, 3, 3), np.float32)
    layer[0, 0], layer[0, 1], layer[0, 2] = (4.0, 2.0, 1.0), (0.0, 0.0, 4.0), (np.nan, 1.0, 1.0)
    rasters.preview(tmp_path / "a.png", layer, high=4.0, gamma=2.0)
    half, quarter = round(255 * math.sqrt(0.5)), round(255 * math.sqrt(0.25))
    np.testing.assert_array_equal(
        pixels(tmp_path / "a.png")[0], [[255, half, quarter, 255], [0, 0, 255, 255], [0, 0, 0, 0]]
    )


def test_shadow_codes_have_their_colours(tmp_path: Path) -> None:
    codes = np.array([[0, 1], [2, 3]], np.uint8)
    rasters.preview(tmp_path / "a.png", codes)
    shown = pixels(tmp_path / "a.png")
    lightness = shown[..., :3].sum(axis=2)
    assert lightness[0, 0] > lightness[0, 1] > lightness[1, 0]
    np.testing.assert_array_equal(shown[..., 3], [[255, 255], [255, 0]])


def test_colours_grow_lighter_all_the_way(tmp_path: Path) -> None:
    rasters.preview(
        tmp_path / "a.png", np.arange(200.0)[np.newaxis], colours="dusk", low=0.0, high=199.0
    )
    linear = (pixels(tmp_path / "a.png")[0, :, :3] / 255.0) ** 2.2
    luminance = linear @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(luminance) >= -1e-3).all()
    assert luminance[-1] - luminance[0] > 0.85


def test_pixels_are_square_on_the_ground(tmp_path: Path) -> None:
    layer = np.zeros((100, 60), np.float32)
    rasters.preview(tmp_path / "a.png", layer, cell_size=(50.0, 100.0))
    assert pixels(tmp_path / "a.png").shape == (100, 30, 4)
    rasters.preview(tmp_path / "b.png", layer, cell_size=(100.0, 50.0))
    assert pixels(tmp_path / "b.png").shape == (50, 60, 4)


def test_a_large_layer_is_shown_smaller_as_means(tmp_path: Path) -> None:
    layer = np.tile(np.array([0.0, 1.0], np.float32), (10, 2048))
    rasters.preview(tmp_path / "a.png", layer, low=0.0, high=1.0)
    shown = pixels(tmp_path / "a.png")
    assert shown.shape == (5, 2048, 4)
    assert (shown[..., 0] == 128).all()


def test_previews_that_cannot_be_made_are_refused(tmp_path: Path) -> None:
    for options, field in [
        ({"layer": np.zeros(4)}, "layer"),
        ({"layer": np.zeros((2, 2)), "colours": "plaid"}, "colours"),
    ]:
        with pytest.raises(InputError) as caught:
            rasters.preview(tmp_path / "a.png", **options)
        assert caught.value.field == field
    with pytest.raises(RasterError, match="preview: must be in a folder that exists"):
        rasters.preview(tmp_path / "no" / "a.png", np.zeros((2, 2)))
    assert os.listdir(tmp_path) == []


def test_words_in_an_ascii_grid_are_refused(tmp_path: Path) -> None:
    """GDAL reads them as zeros."""
    path = tmp_path / "words.asc"
    head = "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 10\nNODATA_value -9999\n"
    path.write_text(head + "1 2\n3 four\n")
    with pytest.raises(RasterError, match=r"path: must be an ASCII grid of numbers, got '3 four'"):
        Terrain.open(path)
    path.write_text(head + "1 2\n3 -4e1\n")
    assert Terrain.open(path).elevations()[1, 1] == -40.0
