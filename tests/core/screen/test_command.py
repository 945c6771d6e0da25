"""`adret ssao`: from a depth file and a camera to a raster and a picture."""

import json
from pathlib import Path

import numpy as np
import pytest
import rasterio
from PIL import Image

import adret
from adret.cli import main
from adret.pictures import linear, read_picture

LENS = {"width": 32, "height": 24, "fov_y_deg": 60.0}


@pytest.fixture
def files(tmp_path: Path) -> dict[str, str]:
    depth = np.full((24, 32), 4.0, dtype=np.float32)
    depth[8:, 12:20] = 3.0
    depth[:4] = np.inf
    np.save(tmp_path / "depth.npy", depth)
    (tmp_path / "camera.json").write_text(json.dumps(LENS))
    grey = np.full((24, 32, 3), 188, dtype=np.uint8)
    Image.fromarray(grey).save(tmp_path / "view.png")
    return {p.stem: str(p) for p in tmp_path.iterdir()}


def ssao(files: dict[str, str], *options: str) -> int:
    out = str(Path(files["depth"]).with_name("ao.tif"))
    order = ["ssao", files["depth"], out, "--camera", files["camera"], "--method", "hbao"]
    return main([*order, *options])


def test_the_raster_holds_what_the_library_computes(files: dict[str, str]) -> None:
    assert ssao(files, "--radius", "2", "--directions", "4", "--steps", "4") == 0
    buffer = adret.DepthBuffer.open(files["depth"], files["camera"])
    own = adret.ambient_occlusion(buffer, method="hbao", radius=2.0, directions=4, steps=4)
    with rasterio.open(Path(files["depth"]).with_name("ao.tif")) as raster:
        np.testing.assert_array_equal(raster.read(1), own.occlusion)
        tags = raster.tags()
    assert tags["ADRET_METHOD"] == "hbao"
    assert tags["ADRET_OPTION_RADIUS"] == "2.0"
    assert own.occlusion.max() > 0.2


def test_the_preview_shows_a_given_picture_shaded(files: dict[str, str]) -> None:
    shaded = str(Path(files["depth"]).with_name("lit.png"))
    assert ssao(files, "--radius", "2", "--color", files["view"], "--preview", shaded) == 0
    pixels = np.asarray(Image.open(shaded).convert("L")).astype(int)
    assert abs(pixels[0, 0] - 188) <= 2, "the sky keeps its colour"
    assert pixels[16, 11] < 170, "the wall is darker beside the box"


def test_srgb_is_undone_as_the_standard_says(files: dict[str, str]) -> None:
    assert read_picture(files["view"]).shape == (24, 32, 3)
    for stored, light in ((0, 0.0), (10, 0.0030353), (188, 0.5028865), (255, 1.0)):
        assert linear(np.array([stored], dtype=np.uint8))[0] == pytest.approx(light, abs=1e-6)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--camera", "nowhere.json"], "camera: must be a file that can be read"),
        (["--method", "magic"], "method: must be one of"),
        (["--radius", "-1"], "radius: must be a number above 0"),
        (["--thickness", "1"], "thickness: must be an option of 'hbao'"),
        (["--guard-band", "12"], "guard_band: must be pixels"),
        (["--guard-band", "x"], "guard_band: must be a whole number"),
        (["--kind", "odd"], "kind: must be one of"),
        (["--color", "nowhere.png"], "color: must be a file that can be read"),
        (["--layer", "bent-normal"], "layer: must be one that 'hbao' gives"),
    ],
)
def test_wrong_input_is_named_and_leaves_no_file(
    files: dict[str, str], options: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = sorted(Path(files["depth"]).parent.iterdir())
    assert ssao(files, *options) == 2
    assert message in capsys.readouterr().err
    assert sorted(Path(files["depth"]).parent.iterdir()) == before


def test_a_depth_too_coarse_for_the_radius_is_one_line_with_both_numbers(
    files: dict[str, str], capfd: pytest.CaptureFixture[str]
) -> None:
    counts = np.full((24, 32), 40_000, dtype=np.uint16)
    counts[8:, 12:20] = 30_000
    Image.fromarray(counts).save(files["depth"].replace(".npy", ".png"))
    lens = {**LENS, "near": 0.1, "far": 1000.0}
    Path(files["camera"]).write_text(json.dumps(lens))
    coarse = {**files, "depth": files["depth"].replace(".npy", ".png")}
    assert ssao(coarse, "--kind", "device", "--radius", "0.0001") == 0
    lines = capfd.readouterr().err.splitlines()
    assert len(lines) == 1, lines
    # 65535 steps of d = (1/0.1 - 1/z)/(1/0.1 - 1/1000): the step at a depth is z² 9.999/65535.
    depth = 1.0 / (10.0 - 9.999 * 40_000 / 65_535)
    step = depth**2 * 9.999 / 65_535
    expected = (
        f"adret: warning: depth: one step of the stored values is {step:.3g} at depth "
        f"{depth:.3g}, more than a twentieth of the radius 0.0001"
    )
    assert lines[0].startswith(expected), lines[0]
    # A radius that the depth can carry says nothing.
    (Path(files["depth"]).with_name("ao.tif")).unlink()
    assert ssao(coarse, "--kind", "device", "--radius", "2") == 0
    assert capfd.readouterr().err == ""


def test_a_picture_of_another_size_is_refused(
    files: dict[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    Image.new("RGB", (31, 24)).save(files["view"])
    assert ssao(files, "--color", files["view"]) == 2
    assert "color: must be of (24, 32) pixels" in capsys.readouterr().err
