"""Depth buffers through the service: uploaded with their camera, lit like in the library."""

import hashlib
import io
import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
import rasterio
from servers import ADRET, Server

from adret.products import PRODUCTS, run
from adret.screen import Camera, DepthBuffer

LENS = {"width": 48, "height": 32, "fov_y_deg": 60.0, "guard_band": 4}
ORDER = {"method": "hbao", "radius": 2.0, "directions": 4, "steps": 4}


def scene() -> np.ndarray:
    """A floor that runs to the sky, with a box on it and a hole in the data."""
    camera = Camera.perspective(48, 32, fov_y_deg=60.0)
    up = camera.position(np.arange(32)[:, None], 0, np.ones((32, 1)))[1]
    depth = np.where(up < -0.02, 1.5 / np.maximum(-up, 1e-3), np.inf) * np.ones((1, 48))
    depth[14:24, 20:30] = np.minimum(depth[14:24, 20:30], 3.0)
    depth[20, 8] = np.nan
    return depth.astype(np.float32)


@pytest.fixture(scope="module")
def depth_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("depth") / "depth.npy"
    np.save(path, scene())
    return path


@pytest.fixture(scope="module")
def buffer(server: Server, depth_file: Path) -> str:
    answer = server.upload(depth_file, camera=json.dumps(LENS))
    assert answer.status_code == 201, answer.text
    return str(answer.json()["id"])


def test_a_depth_buffer_says_what_it_is(server: Server, buffer: str) -> None:
    told = server.http.get(f"/datasets/{buffer}").json()
    assert (told["kind"], told["rows"], told["columns"]) == ("depth", 32, 48)
    assert told["camera"] == {"width": 48, "height": 32, "fov_y_deg": 60.0}
    assert (told["guard_band"], told["hole_pixels"]) == ([4, 4, 4, 4], 1)
    assert told["sky_pixels"] == int(np.isinf(scene()).sum())
    assert told["farthest"] == float(scene()[np.isfinite(scene())].max())


def test_the_result_has_the_bytes_that_the_library_writes(
    server: Server, buffer: str, depth_file: Path, tmp_path: Path
) -> None:
    job = server.submit("ssao", dataset=buffer, **ORDER)
    assert server.wait(job)["status"] == "successful", server.status(job)
    served = server.http.get(f"/jobs/{job}/results/result").content
    own = tmp_path / "own.tif"
    product = PRODUCTS["ssao"]
    camera = Camera.perspective(48, 32, fov_y_deg=60.0)
    source = DepthBuffer(np.load(depth_file), camera, guard_band=4)
    run(product, source, product.parameters(**ORDER), own)
    digests = [hashlib.sha256(data).hexdigest() for data in (served, own.read_bytes())]
    assert digests[0] == digests[1]
    with rasterio.open(own) as raster:
        occlusion = raster.read(1)
        assert raster.descriptions == ("occlusion",)
        assert raster.tags()["ADRET_OPTION_DIRECTIONS"] == "4"
    assert occlusion.shape == (24, 40)
    assert np.isnan(occlusion).sum() == 1
    assert 0.0 < np.nanmean(occlusion[12:]) < 0.5
    assert not occlusion[0].any(), "the sky is open"


def test_every_camera_file_and_kind_gives_the_same_dataset_numbers(server: Server) -> None:
    finite = np.where(np.isfinite(scene()), scene(), 50.0)
    camera = Camera.perspective(48, 32, fov_y_deg=60.0, near=0.1, far=100.0)
    lens = LENS | {"near": 0.1, "far": 100.0}
    stored = {
        "linear": finite.astype(np.float32),
        "device": camera.to_device(finite).astype(np.float32),
        "distance": (finite * camera.ray_lengths()).astype(np.float32),
    }
    for kind, numbers in stored.items():
        file = io.BytesIO()
        np.savez_compressed(file, depth=numbers)
        answer = server.http.post(
            "/uploads",
            files={"file": ("depth.npz", file.getvalue())},
            params={"camera": json.dumps(lens | {"kind": kind})},
        )
        assert answer.status_code == 201, answer.text
        told = answer.json()
        assert told["source"]["kind"] == kind
        assert abs(told["nearest"] - finite.min()) < 1e-3
        assert abs(told["farthest"] - finite.max()) < 0.05


@pytest.mark.parametrize(
    ("camera", "field"),
    [
        ("{", "camera"),
        ("[]", "camera"),
        ('{"width": 48}', "height"),
        ('{"width": 48, "height": 32}', "fov_y_deg"),
        ('{"width": 4800, "height": 32, "fov_y_deg": 60}', "depth"),
        ('{"width": 1e9, "height": 1e9, "fov_y_deg": 60}', "width"),
        ('{"width": 48, "height": 32, "fov_y_deg": NaN}', "fov_y_deg"),
        ('{"width": 48, "height": 32, "fov_y_deg": 60, "kind": "odd"}', "kind"),
        ('{"width": 48, "height": 32, "fov_y_deg": 60, "guard_band": 99}', "guard_band"),
        ('{"a":' * 1000 + "1" + "}" * 1000, "camera"),
    ],
)
def test_a_camera_that_is_none_is_refused_by_name(
    server: Server, depth_file: Path, camera: str, field: str
) -> None:
    answer = server.upload(depth_file, camera=camera)
    assert answer.status_code in (400, 413), answer.text
    assert field in answer.json()["errors"][0]["field"], answer.text


def test_exr_is_read_only_where_the_operator_allows_it(server: Server, tmp_path: Path) -> None:
    path = tmp_path / "depth.exr"
    path.write_bytes(b"\x76\x2f\x31\x01" + bytes(100))
    answer = server.upload(path, camera=json.dumps(LENS))
    assert answer.status_code in (400, 415)
    assert "must be a .npy, .npz, .tif or 16-bit .png file" in answer.json()["detail"]


def test_terrain_and_depth_do_not_take_each_others_place(
    server: Server, buffer: str, dataset: str
) -> None:
    for process, wrong in (("ssao", dataset), ("horizon", buffer)):
        answer = server.http.post(
            f"/processes/{process}/execution", json={"inputs": {"dataset": wrong}}
        )
        assert answer.status_code == 400
        assert "a dataset of kind" in answer.json()["errors"][0]["limit"]


def test_an_option_that_the_method_does_not_know_fails_the_job_by_name(
    server: Server, buffer: str
) -> None:
    job = server.submit("ssao", dataset=buffer, method="hbao", rays=3, thickness=1.0)
    status = server.wait(job)
    assert status["status"] == "failed"
    assert "thickness: must be an option of 'hbao'" in status["message"]


def test_run_sends_a_depth_buffer_with_its_camera(
    server: Server, depth_file: Path, tmp_path: Path
) -> None:
    camera, out = tmp_path / "camera.json", tmp_path / "ao.tif"
    camera.write_text(json.dumps(LENS))
    command = [ADRET, "run", "ssao", depth_file, "--camera", camera]
    command += ["-i", 'method="hbao"', "-i", "radius=2", "--out", out, "--url", server.url]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    with rasterio.open(out) as raster:
        assert raster.shape == (24, 40)
