"""Cameras: every convention of a depth value leads to the same points of view space."""

import itertools
import json
import math

import numpy as np
import pytest

from adret import Camera, InputError

CONVENTIONS = [
    (divide, direction, clip, hand, far)
    for divide, direction, clip, hand, far in itertools.product(
        (True, False), (False, True), ("0..1", "-1..1"), ("right", "left"), (1000.0, math.inf)
    )
    if divide or far < math.inf
]
DEPTHS = np.array([0.1, 0.35, 1.0, 7.3, 60.0, 320.0, 999.0])


def made(divide, direction, clip, hand, far, width=64, height=48):
    planes = {"near": 0.1, "far": far, "reversed": direction, "clip": clip, "handedness": hand}
    if divide:
        return Camera.perspective(width, height, fx=50, fy=51, cx=30, cy=20, **planes)
    return Camera.orthographic(width, height, extent=(4.0, 3.0), **planes)


def device_depth(z, divide, direction, clip, far, near=0.1):
    """Depth values as the textbooks have them: z/w of the standard matrices."""
    z = np.asarray(z, dtype=np.float64)
    if not divide:
        d = (z - near) / (far - near)
    elif math.isinf(far):
        d = 1.0 - near / z
    else:
        d = far / (far - near) * (1.0 - near / z)
    d = 1.0 - d if direction else d
    return 2.0 * d - 1.0 if clip == "-1..1" else d


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_depth_values_of_every_convention_become_the_same_depths(convention):
    divide, direction, clip, _, far = convention
    camera = made(*convention)
    stored = device_depth(DEPTHS, divide, direction, clip, far)
    # float64 carries 1 - near/z to 1e-16 of the range: at z = 999 that is 1e-11 in depth.
    assert np.allclose(camera.to_linear(stored), DEPTHS, rtol=2e-12, atol=2e-9)
    assert np.allclose(camera.to_device(DEPTHS), stored, rtol=0, atol=1e-15)
    assert np.allclose(camera.to_linear(camera.to_device(DEPTHS)), DEPTHS, rtol=2e-12)


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_a_stored_depth_comes_back_within_half_a_step_of_its_type(convention):
    divide, direction, clip, _, far = convention
    camera = made(*convention)
    z = np.geomspace(0.11, 990.0, 4001)
    stored = device_depth(z, divide, direction, clip, far).astype(np.float32)
    step = camera.depth_step(z, dtype=np.float32)
    error = np.abs(camera.to_linear(stored) - z) / step
    assert error.max() <= 0.51
    assert error.max() > 0.3  # and the bound is no idle one


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_the_matrix_of_a_camera_gives_the_camera_back(convention):
    divide, direction, clip, hand, far = convention
    camera = made(*convention)
    again = Camera.from_matrix(camera.matrix(), 64, 48, matrix_clip=clip, clip=clip)
    assert np.allclose(again.rays, camera.rays)
    assert again.near == pytest.approx(0.1)
    assert again.far == (math.inf if math.isinf(far) else pytest.approx(far))
    assert (again.perspective_divide, again.reversed, again.handedness) == (divide, direction, hand)


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_the_matrix_projects_a_point_to_its_pixel_and_to_its_depth_value(convention):
    divide, direction, clip, hand, far = convention
    camera = made(*convention)
    x, y, back = camera.position(5.0, 7.0, 3.0)
    clip_space = camera.matrix() @ [x, y, back if hand == "right" else -back, 1.0]
    right, up, value = clip_space[:3] / clip_space[3]
    assert (right + 1.0) * 32 == pytest.approx(7.5)  # centre of column 7
    assert (1.0 - up) * 24 == pytest.approx(5.5)
    assert value == pytest.approx(device_depth(3.0, divide, direction, clip, far))


def test_the_matrices_of_opengl_and_of_direct3d_are_read():
    f, near, far = 1.0 / math.tan(math.radians(30.0)), 0.5, 50.0
    opengl = [
        [f / 1.5, 0, 0, 0],
        [0, f, 0, 0],
        [0, 0, (far + near) / (near - far), 2 * far * near / (near - far)],
        [0, 0, -1, 0],
    ]
    direct3d = [
        [f / 1.5, 0, 0, 0],
        [0, f, 0, 0],
        [0, 0, far / (far - near), -near * far / (far - near)],
        [0, 0, 1, 0],
    ]
    expected = Camera.perspective(60, 40, fov_y_deg=60.0, near=near, far=far)
    for matrix, range_, hand in ((opengl, "-1..1", "right"), (direct3d, "0..1", "left")):
        camera = Camera.from_matrix(matrix, 60, 40, matrix_clip=range_)
        assert np.allclose(camera.rays, expected.rays)
        assert (camera.near, camera.far) == (pytest.approx(near), pytest.approx(far))
        assert (camera.handedness, camera.reversed, camera.clip) == (hand, False, "0..1")


def test_pixels_look_where_the_angle_and_the_focal_length_say():
    camera = Camera.perspective(400, 300, fov_y_deg=90.0)
    # The top edge of row 0 is 45° above the axis; its centre half a pixel below.
    assert camera.position(-0.5, 199.5, 2.0) == pytest.approx([0.0, 2.0, -2.0])
    assert camera.position(299.5, 199.5, 2.0) == pytest.approx([0.0, -2.0, -2.0])
    same = Camera.perspective(400, 300, fx=150.0, fy=150.0, cx=200.0, cy=150.0)
    assert np.allclose(camera.rays, same.rays)
    flat = Camera.orthographic(400, 300, extent=(8.0, 6.0))
    assert flat.position(-0.5, -0.5, 5.0) == pytest.approx([-4.0, 3.0, -5.0])
    corner = camera.position(0, 0, 1.0)
    assert camera.ray_lengths()[0, 0] == pytest.approx(np.linalg.norm(corner))


def test_steps_of_depth_are_those_of_the_literature():
    # near 0.1, far 1000: 24 bits, and float32 in the reversed and in the usual direction.
    usual = Camera.perspective(4, 4, fov_y_deg=60, near=0.1, far=1000.0)
    turned = Camera.perspective(4, 4, fov_y_deg=60, near=0.1, far=1000.0, reversed=True)
    assert usual.depth_step([10.0, 100.0, 900.0], bits=24) == pytest.approx(
        [6e-5, 6e-3, 0.48], rel=0.02
    )
    assert usual.depth_step(900.0, bits=16) == pytest.approx(124.0, rel=0.01)
    assert usual.depth_step(900.0, dtype="f4") == pytest.approx(0.48, rel=0.02)
    assert turned.depth_step([10.0, 900.0], dtype="f4") == pytest.approx([9e-7, 7e-6], rel=0.2)
    assert turned.depth_step([10.0, 100.0, 900.0], dtype="f2", device=False) == pytest.approx(
        [0.0078, 0.0625, 0.5], rel=0.01
    )


def test_a_camera_file_is_read_in_its_several_forms(tmp_path):
    def read(**members):
        path = tmp_path / "camera.json"
        path.write_text(json.dumps(members))
        return Camera.from_json(path)

    plain = read(width=64, height=48, fov_y_deg=90, near=0.1, far=100)
    assert (plain.near, plain.far) == (0.1, 100.0)
    # Beside fx_px, near and far are what was measured, and clip_near the plane.
    measured = read(width=64, height=48, fx_px=24, near=2.0, far=7.0)
    assert (measured.near, measured.far) == (0.0, math.inf)
    assert measured.rays == pytest.approx(plain.rays)
    assert read(width=64, height=48, fx_px=24, near=2, clip_near=0.5).near == 0.5
    integer = read(width=64, height=48, fx=24, cx=31.5, cy=23.5, pixel_centre="integer (OpenCV)")
    assert integer.rays == pytest.approx(plain.rays)
    flat = read(width=64, height=48, projection="orthographic", extent=[4, 3], far="inf")
    assert not flat.perspective_divide
    assert flat.far == math.inf
    again = read(width=64, height=48, matrix=plain.matrix().tolist(), matrix_clip="0..1")
    assert np.allclose(again.rays, plain.rays)


@pytest.mark.parametrize(
    ("field", "arguments"),
    [
        ("width", {"width": 0, "height": 4, "fov_y_deg": 60}),
        ("width", {"width": True, "height": 4, "fov_y_deg": 60}),
        ("height", {"width": 4, "height": 40_000, "fov_y_deg": 60}),
        ("fov_y_deg", {"width": 4, "height": 4, "fov_y_deg": 180}),
        ("fov_y_deg", {"width": 4, "height": 4}),
        ("fov_y_deg", {"width": 4, "height": 4, "fov_y_deg": 60, "fx": 3}),
        ("fx", {"width": 4, "height": 4, "fx": -3.0}),
        ("fy", {"width": 4, "height": 4, "fx": 3.0, "fy": math.nan}),
        ("cx", {"width": 4, "height": 4, "fx": 3.0, "cx": math.inf}),
        ("near", {"width": 4, "height": 4, "fov_y_deg": 60, "near": -1.0}),
        ("far", {"width": 4, "height": 4, "fov_y_deg": 60, "near": 1.0, "far": 1.0}),
        ("clip", {"width": 4, "height": 4, "fov_y_deg": 60, "clip": "0-1"}),
        ("handedness", {"width": 4, "height": 4, "fov_y_deg": 60, "handedness": "up"}),
        ("reversed", {"width": 4, "height": 4, "fov_y_deg": 60, "reversed": "yes"}),
    ],
)
def test_what_no_camera_can_be_is_refused_by_name(field, arguments):
    with pytest.raises(InputError, match=f"^{field}: must be "):
        Camera.perspective(**arguments)


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        (np.eye(3), "4 x 4"),
        ("no matrix", "4 x 4"),
        (np.full((4, 4), np.nan), "finite"),
        (np.zeros((4, 4)), "last row"),
        (np.eye(4)[::-1], "last row"),
        (np.diag([1.0, -1.0, 1.0, 1.0]), "y up"),
        (np.eye(4) + np.eye(4, k=1), "without shear"),
    ],
)
def test_what_is_no_projection_is_refused(matrix, words):
    with pytest.raises(InputError, match=words):
        Camera.from_matrix(matrix, 4, 4)


def test_a_transposed_and_an_oblique_matrix_are_told_apart():
    matrix = Camera.perspective(4, 4, fov_y_deg=60, near=1.0, far=9.0).matrix()
    with pytest.raises(InputError, match="transpose"):
        Camera.from_matrix(matrix.T, 4, 4)
    matrix[2, 0] = 0.1
    with pytest.raises(InputError, match="oblique"):
        Camera.from_matrix(matrix, 4, 4)


def test_depth_values_outside_their_range_tell_of_a_wrong_convention():
    camera = Camera.perspective(4, 4, fov_y_deg=60, near=0.1, far=10.0)
    with pytest.raises(InputError, match=r"depth: must be between 0 and 1 .*got -0.3"):
        camera.to_linear([0.5, -0.3])
    with pytest.raises(InputError, match="near: must be above 0"):
        Camera.perspective(4, 4, fov_y_deg=60).to_linear(0.5)
    with pytest.raises(InputError, match="far: must be finite"):
        Camera.orthographic(4, 4, extent=(1, 1)).to_linear(0.5)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "JSON file"),
        ("[1, 2]", "JSON object"),
        ("[" * 100_000, "JSON file"),
        ('{"width": 4.5, "height": 4, "fov_y_deg": 60}', "width: must be a whole number"),
        ('{"width": 4, "height": 4, "fov_y_deg": "wide"}', "fov_y_deg: must be a number"),
        ('{"width": 4, "height": 4, "projection": "fisheye"}', "projection: must be"),
        ('{"width": 4, "height": 1e400, "fov_y_deg": 60}', "height: must be a whole number"),
        ('{"width": 4, "height": 4, "projection": "orthographic"}', "extent: must be"),
        ('{"width": 4, "height": 4, "matrix": [[1]]}', "matrix: must be"),
        (" " * (1 << 20) + "{}", "at most"),
    ],
)
def test_a_hostile_camera_file_is_refused(tmp_path, text, words):
    path = tmp_path / "camera.json"
    path.write_text(text)
    with pytest.raises(InputError, match=words):
        Camera.from_json(path)
    with pytest.raises(InputError, match="a file that can be read"):
        Camera.from_json(tmp_path / "missing.json")
