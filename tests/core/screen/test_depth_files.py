"""Depth files: every format gives the same numbers, hostile ones are refused."""

import io
import json
import struct
import zipfile
import zlib

import numpy as np
import pytest

from adret import Camera, DepthBuffer, RasterError
from adret.screen.depth_files import read_depth

SHAPE = (5, 7)
CAMERA = Camera.perspective(7, 5, fov_y_deg=60.0, near=0.5, far=20.0)


@pytest.fixture
def depth():
    return np.random.default_rng(3).uniform(1.0, 9.0, SHAPE).astype(np.float32)


def save_tiff(path, array, **options):
    import rasterio

    bands = array if array.ndim == 3 else array[None]
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        height=bands.shape[1],
        width=bands.shape[2],
        count=len(bands),
        dtype=bands.dtype,
        **options,
    ) as target:
        target.write(bands)


def save_exr(path, channels):
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))


def save_png(path, array):
    """A 16-bit greyscale PNG by hand."""

    def chunk(kind, data):
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    bits = 8 * array.itemsize
    lines = b"".join(b"\0" + row.astype(array.dtype.newbyteorder(">")).tobytes() for row in array)
    head = struct.pack(">IIBBBBB", array.shape[1], array.shape[0], bits, 0, 0, 0, 0)
    parts = chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(lines)) + chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + parts)


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_every_format_gives_the_same_depths(tmp_path, depth):
    np.save(tmp_path / "a.npy", depth)
    np.save(tmp_path / "fortran.npy", np.asfortranarray(depth))
    np.savez(tmp_path / "one.npz", z=depth)
    np.savez_compressed(tmp_path / "named.npz", other=np.zeros(3), depth=depth)
    save_tiff(tmp_path / "a.tif", depth, compress="deflate", predictor=3)
    save_exr(tmp_path / "z.exr", {"Z": depth})
    save_exr(tmp_path / "y.exr", {"Y": depth})
    save_exr(tmp_path / "only.exr", {"whatever": depth})
    for path in sorted(tmp_path.iterdir()):
        found = DepthBuffer.open(path, CAMERA)
        assert np.array_equal(found.depth, depth), path.name
        assert found.kind == "linear"


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_half_precision_and_whole_numbers_keep_their_type_and_so_their_step(tmp_path, depth):
    half = depth.astype(np.float16)
    save_exr(tmp_path / "half.exr", {"Z": half})
    np.save(tmp_path / "half.npy", half)
    for name in ("half.exr", "half.npy"):
        buffer = DepthBuffer.open(tmp_path / name, CAMERA)
        assert np.array_equal(buffer.depth, half.astype(np.float32))
        assert np.allclose(buffer.depth_step(), np.spacing(half).astype(np.float64))
    whole = np.round(depth * 1000.0).astype(np.uint16)
    whole[0, 0] = 0
    save_png(tmp_path / "mm.png", whole)
    save_tiff(tmp_path / "mm.tif", whole)
    for name in ("mm.png", "mm.tif"):
        buffer = DepthBuffer.open(tmp_path / name, CAMERA, scale=0.001, hole=0)
        assert buffer.holes.sum() == 1
        assert np.allclose(buffer.depth.flat[1:], whole.flat[1:] * 0.001)
        assert buffer.depth_step()[1, 1] == pytest.approx(0.001)
    stored = np.round(CAMERA.to_device(depth) * 65535).astype(np.uint16)
    save_png(tmp_path / "device.png", stored)
    device = DepthBuffer.open(tmp_path / "device.png", CAMERA, kind="device")
    assert (np.abs(device.depth - depth) <= 0.51 * device.depth_step() + 1e-5).all()


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_nodata_of_a_tiff_is_a_hole_and_bands_are_samples(tmp_path, depth):
    holed = depth.copy()
    holed[2, 3] = -9999.0
    save_tiff(tmp_path / "a.tif", np.stack([holed, depth + 1.0]), nodata=-9999.0)
    buffer = DepthBuffer.open(tmp_path / "a.tif", CAMERA)
    assert buffer.holes.sum() == 1
    assert buffer.holes[2, 3]
    assert buffer.samples.shape == (2, *SHAPE)


def test_a_camera_file_says_how_depth_is_stored(tmp_path, depth):
    stored = CAMERA.to_device(depth)
    stored[0, 0] = 0.25
    np.save(tmp_path / "d.npy", stored)
    camera = {"width": 7, "height": 5, "fov_y_deg": 60, "near": 0.5, "far": 20.0}
    says = {"kind": "device", "hole": 0.25, "guard_band": [0, 1, 2, 3]}
    path = tmp_path / "camera.json"
    path.write_text(json.dumps({**camera, **says}))
    buffer = DepthBuffer.open(tmp_path / "d.npy", path)
    assert buffer.kind == "device"
    assert buffer.holes[0, 0]
    assert buffer.guard_band == (0, 1, 2, 3)
    assert np.allclose(buffer.depth.flat[1:], depth.flat[1:])
    # What is asked for goes before what the file says.
    assert DepthBuffer.open(tmp_path / "d.npy", path, guard_band=1).guard_band == (1, 1, 1, 1)
    frame = {"frame": {"x0": 1, "y0": 2, "width": 3, "height": 2}}
    path.write_text(json.dumps({**camera, **frame}))
    assert DepthBuffer.open(tmp_path / "d.npy", path).frame == (2, 4, 1, 4)


def test_real_depth_buffers_are_read_with_their_cameras(data_dir):
    folder = data_dir / "depth"
    seen = {}
    for camera in sorted(folder.glob("*.json")):
        file = next(p for p in folder.glob(camera.stem + ".*") if p != camera)
        seen[camera.stem] = DepthBuffer.open(file, camera)
    assert len(seen) >= 8
    said = json.loads((folder / "tokyo_street.json").read_text())
    tokyo = seen["tokyo_street"]
    assert tokyo.frame == (128, 848, 128, 1408)
    assert tokyo.sky.mean() == pytest.approx(said["sky_share"], abs=1e-6)
    assert seen["sensor_tum_desk_kinect"].holes.mean() == pytest.approx(0.19189453125)
    # The same view twice: linear, and as a z-buffer whose far plane hides the distant floor.
    linear, stored = seen["bust_ground"], seen["bust_ground_zbuffer"]
    both = ~np.isnan(stored.depth)
    assert (linear.sky[~both] | (linear.depth[~both] > 95.0)).all()
    step = stored.depth_step()[both]
    assert (np.abs(linear.depth - stored.depth)[both] <= 1.1 * step).all()
    # Pixel centres at whole numbers: the principal ray of the sensor is at (319.5, 239.5).
    assert (
        np.abs(seen["sensor_tum_desk_kinect"].camera.position(239.5, 319.5, 1.0)[:2]).max() < 1e-12
    )


def huge_header(shape):
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        stream, {"descr": "<f4", "fortran_order": False, "shape": shape}
    )
    return stream.getvalue()


def pickled():
    stream = io.BytesIO()
    np.save(stream, np.array([[{}]], dtype=object), allow_pickle=True)
    return stream.getvalue()


def zipped(name, data, size=None):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        entry = zipfile.ZipInfo(name)  # dated 1980: tests are named by these bytes
        archive.writestr(entry, data, zipfile.ZIP_DEFLATED)
    return stream.getvalue()


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "a .npy, .npz"),
        (b"GIF89a......", "a .npy, .npz"),
        (b"<VRTDataset/>", "a .npy, .npz"),
        (b"\x93NUMPY", "readable NumPy"),
        (b"\x93NUMPY\x01\x00\xff\xff{", "readable NumPy"),
        (huge_header((100_000, 100_000)), "depth shape"),
        (huge_header((30_000, 30_000)), "depth shape"),
        (huge_header((4, 4, 4, 4)), "depth shape"),
        (huge_header((0, 4)), "depth shape"),
        (huge_header((40, 40)), "6400 bytes of numbers"),
        (pickled(), "depth dtype"),
        (zipped("notes.txt", b"nothing"), "one array"),
        (zipped("depth.npy", b"\x93NUMPY"), "readable NumPy"),
        (zipped("depth.npy", huge_header((20_000, 30_000)) + bytes(1000)), "depth shape"),
        (zipped("depth.npy", huge_header((40, 40)) + bytes(1000)), "6400 bytes"),
        (zipped("depth.npy", huge_header((5, 5)) + bytes(100))[:90], "npz"),
        (b"\x76\x2f\x31\x01" + bytes(40), "OpenEXR"),
        (b"II*\0" + bytes(60), "readable GTiff"),
        (b"\x89PNG\r\n\x1a\n" + bytes(30), "readable PNG"),
    ],
)
def test_hostile_files_are_refused_by_what_is_wrong(tmp_path, data, words):
    path = tmp_path / "depth"
    path.write_bytes(data)
    with pytest.raises(RasterError, match=words):
        read_depth(path)


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_eight_bits_are_too_few(tmp_path):
    save_png(tmp_path / "a.png", np.zeros(SHAPE, dtype=np.uint8))
    save_tiff(tmp_path / "a.tif", np.zeros(SHAPE, dtype=np.uint8))
    np.save(tmp_path / "a.npy", np.zeros(SHAPE, dtype=np.uint8))
    for name in ("a.png", "a.tif", "a.npy"):
        with pytest.raises(RasterError, match=r"depth dtype.*16 bits or more"):
            read_depth(tmp_path / name)


def test_several_channels_without_a_depth_are_refused(tmp_path, depth):
    save_exr(tmp_path / "rgb.exr", {"R2": depth, "G2": depth})
    with pytest.raises(RasterError, match=r"one channel, or one named Z"):
        read_depth(tmp_path / "rgb.exr")
    with pytest.raises(RasterError, match="a file that can be read"):
        read_depth(tmp_path / "missing.exr")
    with pytest.raises(RasterError, match="a file that can be read"):
        read_depth(tmp_path)
