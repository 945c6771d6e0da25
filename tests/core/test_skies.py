"""Skies and environment maps: energy, orientation, files good and hostile."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import adret
from adret import environment_files
from adret.slices import NormalTableSlice, TableSlice

MAPS = [
    "royal_esplanade_1k.hdr",
    "immenstadter_horn_1k.hdr",
    "quarry_01_1k.hdr",
    "venice_sunset_cube256",
    "sky_512.exr",
]
# Axes of the y-up reference in (east, north): east = x, north = -z.
SIDES = {"+X": (1.0, 0.0), "-X": (-1.0, 0.0), "+Z": (0.0, -1.0), "-Z": (0.0, 1.0)}


def on_a_wall(sky: adret.Environment | adret.Sun, east: float, north: float, count: int) -> Any:
    """Irradiance of a vertical, unoccluded wall, from the slices' tables."""
    total = np.zeros(sky.bands)
    for each in sky.slices(count):
        assert isinstance(each, TableSlice)
        facing = east * np.sin(each.azimuth) + north * np.cos(each.azimuth)
        total += max(facing, 0.0) * each.horizontal[:, 0]
    return total


# --- suns -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("diameter_deg", [0.0, 0.533, 1.0, 1.2, 10.0, 60.0, 180.0])
@pytest.mark.parametrize("elevation_deg", [-20.0, 0.0, 35.0, 88.0, 90.0])
def test_a_sun_of_any_size_sends_its_irradiance_along_its_direction(
    diameter_deg: float, elevation_deg: float
) -> None:
    sun = adret.Sun(130.0, elevation_deg, irradiance=700.0, angular_diameter_deg=diameter_deg)
    slices = [s for s in sun.slices(64) if isinstance(s, TableSlice)]
    assert (len(slices) == 1) == (diameter_deg <= 1.0)
    beam = np.zeros(3)
    for s in slices:
        a = s.horizontal[0, 0]
        beam += a * np.sin(s.azimuth), a * np.cos(s.azimuth), s.vertical[0, 0]
    np.testing.assert_allclose(beam, 700.0 * sun.direction, atol=700.0 * 3e-3)
    np.testing.assert_allclose(beam @ sun.direction, 700.0, rtol=1e-6)
    share = sum(s.vertical[0, 0] for s in sun.share_slices(64))
    assert share == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("u", "want"), [(-1.0, 0.0), (-0.5, 0.195501), (0.0, 0.5), (0.8, 0.947956)]
)
def test_one_strip_fraction_is_the_circle_segment(u: float, want: float) -> None:
    assert (np.arccos(-u) + u * np.sqrt(1.0 - u * u)) / np.pi == pytest.approx(want, abs=1e-6)
    (strip,) = adret.Sun(0.0, 20.0).share_slices(64)
    entries = strip.first + strip.step * np.arange(strip.vertical.shape[1])
    edge = np.radians(20.0 - u * 0.533 / 2.0)
    assert np.interp(edge, entries, strip.vertical[0]) == pytest.approx(want, abs=2e-6)


def test_sun_direction_is_a_unit_vector_in_float64() -> None:
    sun = adret.Sun(725.0, 33.0)
    assert sun.azimuth_deg == pytest.approx(5.0)
    assert np.linalg.norm(sun.direction) == pytest.approx(1.0, abs=1e-15)
    np.testing.assert_allclose(
        sun.direction,
        [np.cos(0.5759586531581288) * np.sin(0.08726646259971647),
         np.cos(0.5759586531581288) * np.cos(0.08726646259971647),
         np.sin(0.5759586531581288)],
        atol=1e-14,
    )  # fmt: skip


# --- environments ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", MAPS)
def test_reference_irradiance_on_six_axes(name: str, data_dir: Path) -> None:
    """Upright normals through the whole light path within 0.01 %, walls by tables 0.25 %."""
    reference = json.loads((data_dir / "hdr" / "reference_irradiance.json").read_text())
    want = {axis: np.array(e) for axis, e in reference["maps"][name].items()}
    sky = adret.Environment.open(data_dir / "hdr" / name)
    flat = adret.Terrain(np.zeros((2, 3)), (1.0, 1.0))
    light = adret.direct_light(flat, sky, 64).irradiance
    assert light.shape == (2, 3, 3)
    np.testing.assert_allclose(light[1, 1], want["+Y"], rtol=1.2e-4)
    down = sum(s.vertical[:, s.vertical.shape[1] // 2] - s.vertical[:, 0] for s in sky.slices(64))  # type: ignore[attr-defined]
    np.testing.assert_allclose(down, want["-Y"], rtol=1e-4)
    for count, limit in ((64, 2.5e-3), (256, 5e-4)):
        for axis, (east, north) in SIDES.items():
            np.testing.assert_allclose(on_a_wall(sky, east, north, count), want[axis], rtol=limit)


def spot(rows: int, columns: int, row: int, column: int) -> NDArray[np.float32]:
    picture = np.zeros((rows, columns), dtype=np.float32)
    picture[row, column] = 1.0
    return picture


@pytest.mark.parametrize(
    ("column", "azimuth_deg"),
    [(0, 270.0 + 360 / 128), (16, 0.0 + 360 / 128), (32, 90.0 + 360 / 128)],
)
@pytest.mark.parametrize("rotation_deg", [0.0, 45.0, -400.0])
def test_columns_run_clockwise_from_the_west(
    column: int, azimuth_deg: float, rotation_deg: float
) -> None:
    sky = adret.Environment(spot(32, 64, 10, column), rotation_deg=rotation_deg)
    lit = [s for s in sky.slices(128) if not s.dark_above(-np.pi / 2)]
    assert 2 <= len(lit) <= 3  # a pixel of two swaths, over three when borders cut it
    weights = np.array([s.vertical[0, 0] for s in lit])  # type: ignore[attr-defined]
    azimuths = np.array([s.azimuth for s in lit])
    mean = np.degrees(np.angle(np.sum(weights * np.exp(1j * azimuths))))
    assert (mean - azimuth_deg - rotation_deg + 180.0) % 360.0 == pytest.approx(180.0, abs=1e-6)


def test_energy_is_the_same_for_any_number_of_swaths(rng: np.random.Generator) -> None:
    sky = adret.Environment(rng.random((7, 13, 3)), rotation_deg=11.0)
    totals = [
        sum(s.vertical[:, 0] - 2 * s.vertical[:, s.vertical.shape[1] // 2] for s in sky.slices(k))  # type: ignore[attr-defined]
        for k in (1, 2, 3, 5, 13, 64, 1000)
    ]
    np.testing.assert_allclose(totals, np.broadcast_to(totals[0], (7, 3)), rtol=1e-12)


def test_swaths_of_black_pixels_are_exactly_dark() -> None:
    picture = np.zeros((8, 16))
    picture[:4, 5:7] = 0.1  # columns 5 and 6: azimuths 22.5 to 67.5 degrees
    lit = [k for k, s in enumerate(adret.Environment(picture).slices(16)) if not s.dark_above(0.0)]
    assert lit == [1, 2, 3]


def test_swath_azimuth_is_that_of_its_light() -> None:
    even = adret.Environment(np.ones((16, 32))).slices(8)
    np.testing.assert_allclose([s.azimuth for s in even], np.arange(8) * np.pi / 4, atol=1e-12)
    one = adret.Environment(spot(64, 128, 20, 66)).slices(8)
    lit = [s.azimuth for s in one if not s.dark_above(0.0)]
    np.testing.assert_allclose(np.degrees(lit), [66.5 / 128 * 360 - 90], atol=1e-9)


def test_normal_table_is_exact_at_its_own_normals(rng: np.random.Generator) -> None:
    sky = adret.Environment(rng.random((64, 32, 3)), normal_angles=5)
    each = sky.slices(4)[1]
    assert isinstance(each, NormalTableSlice)
    table = each.table()
    assert table.shape == (5, 513, 3)
    upright = each.moments.vertical.T
    np.testing.assert_allclose(table[2][256:], upright[256:], rtol=1e-6, atol=1e-7)
    assert (table[2][:256] == table[2][256]).all()  # it sees nothing below its own plane
    leaning = (each.moments.vertical + each.moments.horizontal).T * np.sqrt(0.5)
    np.testing.assert_allclose(table[3][128:], leaning[128:], rtol=1e-6, atol=1e-7)


# --- files ----------------------------------------------------------------------------------------


def write_hdr(path: Path, rgbe: NDArray[np.uint8], header: str = "", packed: bool = False) -> Path:
    rows, columns, _ = rgbe.shape
    body = b""
    for line in rgbe:
        if packed:
            body += bytes((2, 2, columns >> 8, columns & 255))
            for part in line.T:
                for at in range(0, columns, 100):
                    few = part[at : at + 100]
                    same = (few == few[0]).all()
                    body += bytes((128 + len(few), few[0])) if same else bytes((len(few), *few))
        else:
            body += line.tobytes()
    text = f"#?RADIANCE\n{header}FORMAT=32-bit_rle_rgbe\n\n-Y {rows} +X {columns}\n"
    path.write_bytes(text.encode() + body)
    return path


@pytest.mark.parametrize("packed", [False, True])
def test_rgbe_round_trip(packed: bool, tmp_path: Path, rng: np.random.Generator) -> None:
    rgbe = rng.integers(0, 255, (5, 300, 4), dtype=np.uint8)
    rgbe[1, :, 2] = 7
    rgbe[2, :, 3] = 0
    rgbe[:, :, 3] = np.clip(rgbe[:, :, 3], 0, 180)
    rgbe[0, 0] = (10, 20, 30, 130)
    file = write_hdr(tmp_path / "a.hdr", rgbe, "EXPOSURE=2.0\nEXPOSURE=0.25\n", packed)
    got = environment_files.read_radiance(file)
    want = rgbe[:, :, :3] * np.exp2(rgbe[:, :, 3:].astype(float) - 136.0) / 0.5
    want[rgbe[:, :, 3] == 0] = 0.0
    np.testing.assert_allclose(got, want, rtol=1e-6)
    assert got.dtype == np.float32


def test_npy_and_exr_and_cube_files(tmp_path: Path, rng: np.random.Generator) -> None:
    openexr = pytest.importorskip("OpenEXR")
    picture = rng.random((6, 12, 3)).astype(np.float32)
    np.save(tmp_path / "a.npy", picture)
    np.testing.assert_array_equal(adret.Environment.open(tmp_path / "a.npy").radiance, picture)
    np.save(tmp_path / "b.npy", picture[:, :, 0].astype(np.float64))
    assert adret.Environment.open(tmp_path / "b.npy").bands == 1
    header = {"compression": openexr.ZIP_COMPRESSION, "type": openexr.scanlineimage}
    openexr.File(header, {"RGB": picture}).write(str(tmp_path / "a.exr"))
    np.testing.assert_array_equal(adret.Environment.open(tmp_path / "a.exr").radiance, picture)
    for face in ("px", "nx", "py", "ny", "pz", "nz"):
        np.save(tmp_path / f"{face}.npy", np.full((4, 4), {"py": 2.0}.get(face, 1.0)))
    cube = adret.Environment.open(tmp_path)
    assert cube.radiance.shape == (8, 16, 1)
    assert (cube.radiance[0], cube.radiance[-1]) == (pytest.approx(2.0), pytest.approx(1.0))


HOSTILE: list[tuple[str, bytes]] = [
    ("empty.hdr", b""),
    ("text.hdr", b"hello"),
    ("no_end.hdr", b"#?RADIANCE\n" + b"a" * 100_000),
    ("long_header.hdr", b"#?RADIANCE\n" + b"A=1\n" * 40_000 + b"\n-Y 1 +X 8\n"),
    ("xyz.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 8\n" + bytes(32)),
    ("turned.hdr", b"#?RADIANCE\n\n+X 8 -Y 1\n" + bytes(32)),
    ("huge.hdr", b"#?RADIANCE\n\n-Y 999999999 +X 999999999\n"),
    ("bomb.hdr", b"#?RADIANCE\n\n-Y 8192 +X 8192\n" + bytes((2, 2, 32, 0))),
    ("zero.hdr", b"#?RADIANCE\n\n-Y 0 +X 8\n"),
    ("exposure.hdr", b"#?RADIANCE\nEXPOSURE=0\n\n-Y 1 +X 8\n" + bytes(32)),
    ("nan_exposure.hdr", b"#?RADIANCE\nEXPOSURE=dark\n\n-Y 1 +X 8\n" + bytes(32)),
    ("short.hdr", b"#?RADIANCE\n\n-Y 2 +X 8\n" + bytes(50)),
    ("overrun.hdr", b"#?RADIANCE\n\n-Y 1 +X 8\n" + bytes((2, 2, 0, 8)) + b"\xff\x01" * 20),
    ("stuck.hdr", b"#?RADIANCE\n\n-Y 1 +X 8\n" + bytes((2, 2, 0, 8)) + bytes(40)),
    ("cut.hdr", b"#?RADIANCE\n\n-Y 1 +X 8\n" + bytes((2, 2, 0, 8, 127)) + bytes(20)),
    ("mixed.hdr", b"#?RADIANCE\n\n-Y 2 +X 8\n" + bytes((2, 2, 0, 8)) + b"\x88\x01" * 4 + bytes(40)),
    ("cut.exr", b"\x76\x2f\x31\x01\x02\x00\x00\x00channels"),
    ("cut.npy", b"\x93NUMPY\x01\x00\xff\xff{"),
    ("pickle.npy", b"\x93NUMPY\x01\x00v\x00" + b"{'descr': '|O', 'fortran_order': False, "
     b"'shape': (2, 2), }".ljust(117) + b"\n" + bytes(64)),
    ("large.npy", b"\x93NUMPY\x01\x00v\x00" + b"{'descr': '<f4', 'fortran_order': False, "
     b"'shape': (30000, 30000), }".ljust(117) + b"\n" + bytes(64)),
    ("promise.npy", b"\x93NUMPY\x01\x00v\x00" + b"{'descr': '<f4', 'fortran_order': False, "
     b"'shape': (4000, 4000), }".ljust(117) + b"\n" + bytes(64)),
]  # fmt: skip


@pytest.mark.parametrize(("name", "content"), HOSTILE, ids=[name for name, _ in HOSTILE])
def test_damaged_and_hostile_files_are_refused(name: str, content: bytes, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(adret.RasterError) as caught:
        adret.Environment.open(tmp_path / name)
    assert caught.value.field.startswith("environment")


def test_missing_files_faces_and_infinite_values_are_refused(tmp_path: Path) -> None:
    with pytest.raises(adret.RasterError):
        adret.Environment.open(tmp_path / "none.hdr")
    with pytest.raises(adret.RasterError):
        adret.Environment.open(tmp_path)
    for face in ("px", "nx", "py", "ny", "pz", "nz"):
        np.save(tmp_path / f"{face}.npy", np.ones((4, 4 if face != "nz" else 5)))
    with pytest.raises(adret.RasterError, match="nz"):
        adret.Environment.open(tmp_path)
    np.save(tmp_path / "bad.npy", np.array([[1.0, np.inf]]))
    with pytest.raises(adret.RasterError, match="finite"):
        adret.Environment.open(tmp_path / "bad.npy")


def test_errors_name_the_field() -> None:
    grey = np.ones((4, 8))
    cases: list[tuple[str, Any]] = [
        ("radiance", lambda: adret.UniformSky(-1.0)),
        ("radiance", lambda: adret.UniformSky(float("nan"))),
        ("zenith_radiance", lambda: adret.OvercastSky(float("inf"))),
        ("azimuth_deg", lambda: adret.Sun(float("nan"), 10.0)),
        ("elevation_deg", lambda: adret.Sun(0.0, 90.5)),
        ("elevation_deg", lambda: adret.Sun(0.0, float("nan"))),
        ("irradiance", lambda: adret.Sun(0.0, 10.0, irradiance=-1.0)),
        ("angular_diameter_deg", lambda: adret.Sun(0.0, 10.0, angular_diameter_deg=181.0)),
        ("radiance", lambda: adret.Environment(np.ones((4, 8, 2)))),
        ("radiance", lambda: adret.Environment(np.ones(4))),
        ("radiance", lambda: adret.Environment(grey * np.nan)),
        ("radiance", lambda: adret.Environment([["a"]])),
        ("rotation_deg", lambda: adret.Environment(grey, rotation_deg=float("inf"))),
        ("normal_angles", lambda: adret.Environment(grey, normal_angles=2)),
        ("normal_angles", lambda: adret.Environment(grey, normal_angles=7.5)),  # type: ignore[arg-type]
    ]
    for field, call in cases:
        with pytest.raises(adret.InputError) as caught:
            call()
        assert caught.value.field == field
