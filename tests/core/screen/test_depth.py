"""Depth buffers: what is sky, what is a hole, and what every way of storing depth comes to."""

import itertools
import math
import warnings

import numpy as np
import pytest

from adret import Camera, DepthBuffer, InputError, Terrain, ambient_occlusion
from adret.screen import DepthPrecisionWarning

WIDTH, HEIGHT = 24, 16


def plane(camera, normal=(0.3, -0.4, 0.8), distance=3.0):
    """Depth of a plane before a camera."""
    unit = np.asarray(normal) / np.linalg.norm(normal)
    rows, columns = np.mgrid[0 : camera.height, 0 : camera.width]
    ray = camera.position(rows, columns, 1.0)
    if camera.perspective_divide:
        return -distance / np.tensordot(unit, ray, 1)
    x, y, _ = ray
    return (distance + unit[0] * x + unit[1] * y) / unit[2]


@pytest.mark.parametrize(
    ("divide", "direction", "clip", "hand"),
    list(itertools.product((True, False), (False, True), ("0..1", "-1..1"), ("right", "left"))),
)
def test_every_convention_reaches_the_same_view_space(divide, direction, clip, hand):
    planes = {
        "near": 0.5,
        "far": 40.0,
        "reversed": direction,
        "clip": clip,
        "handedness": hand,
    }
    if divide:
        camera = Camera.perspective(WIDTH, HEIGHT, fov_y_deg=50.0, **planes)
    else:
        camera = Camera.orthographic(WIDTH, HEIGHT, extent=(3.0, 2.0), **planes)
    z = plane(camera)
    linear = DepthBuffer(z, camera)
    for stored, kind in (
        (camera.to_device(z).astype(np.float32), "device"),
        (z * camera.ray_lengths(), "distance"),
        (np.round(camera.to_device(z) * 65535).astype(np.uint16), "device"),
    ):
        if stored.dtype == np.uint16 and clip == "-1..1":
            stored = np.round((camera.to_device(z) + 1.0) / 2.0 * 65535).astype(np.uint16)
        buffer = DepthBuffer(stored, camera, kind=kind)
        assert not buffer.sky.any()
        bound = 0.51 * buffer.depth_step() + 3e-7 * z
        assert (np.abs(buffer.depth - z) <= bound).all()
        if stored.dtype != np.uint16:
            normal = np.array([0.3, -0.4, 0.8]) / np.linalg.norm([0.3, -0.4, 0.8])
            assert np.abs(buffer.field.normal - normal[:, None, None]).max() < 2e-4
            assert np.abs(linear.field.normal - normal[:, None, None]).max() < 2e-5


def test_sky_and_holes_are_told_apart():
    camera = Camera.perspective(4, 2, fov_y_deg=60.0, near=0.1, far=50.0)
    depth = [[np.inf, 50.0, 0.0, -3.0], [np.nan, 7.0, 49.0, 5.0]]
    mask = np.zeros((2, 4), bool)
    mask[1, 0] = mask[1, 3] = True
    buffer = DepthBuffer(depth, camera, sky=mask, hole=7.0)
    assert buffer.sky.tolist() == [[True] * 4, [False, False, False, True]]
    assert buffer.holes.tolist() == [[False] * 4, [True, True, False, False]]
    assert np.array_equal(np.isnan(buffer.depth), buffer.sky | buffer.holes)
    assert buffer.depth[1, 2] == 49.0


def test_the_far_plane_of_depth_values_is_sky():
    for direction, far in itertools.product((False, True), (30.0, math.inf)):
        camera = Camera.perspective(3, 1, fov_y_deg=60, near=0.5, far=far, reversed=direction)
        stored = np.array([[0.0, 0.5, 1.0]]) if direction else np.array([[1.0, 0.5, 0.0]])
        buffer = DepthBuffer(stored, camera, kind="device")
        assert buffer.sky.tolist() == [[True, False, False]]
        assert buffer.depth[0, 2] == np.float32(0.5)


def test_sky_neither_receives_nor_occludes_and_holes_stay_unknown():
    camera = Camera.orthographic(9, 9, extent=(9.0, 9.0))
    depth = np.full((9, 9), 10.0)
    depth[:, 5:] = np.inf
    depth[4, 2] = np.nan
    result = ambient_occlusion(DepthBuffer(depth, camera), method="raytraced", rays=32)
    assert (result.occlusion[:, 5:] == 0.0).all()
    assert (result.confidence[:, 5:] == 0.0).all()
    assert np.isnan(result.occlusion[4, 2])
    assert result.confidence[4, 2] == 0.0
    assert np.isnan(result.bent_normal[:, 4, 2]).all()
    assert np.nansum(result.occlusion) == 0.0
    assert result.report.skipped == {"sky": 36, "holes": 1}
    assert result.report.receivers == 44


def test_the_guard_band_is_cut_off_but_occludes():
    camera = Camera.orthographic(20, 20, extent=(20.0, 20.0))
    depth = np.full((20, 20), 10.0)
    depth[:, :4] = 4.0
    whole = ambient_occlusion(DepthBuffer(depth, camera), method="raytraced", rays=200)
    framed = DepthBuffer(depth, camera, guard_band=(1, 2, 3, 4))
    part = ambient_occlusion(framed, method="raytraced", rays=200)
    assert framed.frame == (1, 17, 4, 18)
    assert part.occlusion.shape == (16, 14)
    assert np.array_equal(part.occlusion, whole.occlusion[1:17, 4:18])
    assert part.occlusion[:, 0].mean() > 0.2


def test_a_depth_too_coarse_for_the_radius_warns_with_both_numbers():
    camera = Camera.perspective(8, 8, fov_y_deg=60.0, near=0.1, far=1000.0)
    stored = camera.to_device(np.full((8, 8), 300.0)).astype(np.float32)
    buffer = DepthBuffer(stored, camera, kind="device")
    step = float(camera.depth_step(300.0, dtype="f4"))
    assert buffer.depth_step()[0, 0] == pytest.approx(step, rel=1e-3)
    options = {"method": "raytraced", "rays": 4}
    with pytest.warns(DepthPrecisionWarning, match=rf"{step:.3g} at depth 300.*radius 1 .100.00%"):
        ambient_occlusion(buffer, radius=1.0, **options)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ambient_occlusion(buffer, radius=21 * step, **options)
        ambient_occlusion(buffer, **options)
        reverse = Camera.perspective(8, 8, fov_y_deg=60, near=0.1, far=1000.0, reversed=True)
        fine = reverse.to_device(np.full((8, 8), 300.0)).astype(np.float32)
        ambient_occlusion(DepthBuffer(fine, reverse, kind="device"), radius=1.0, **options)


@pytest.mark.parametrize(
    ("dtype", "kind", "step"),
    [("f2", "linear", 0.0078125), ("u2", "linear", 0.002), ("u2", "device", 1.01 / 65535)],
)
def test_steps_follow_the_stored_type(dtype, kind, step):
    camera = Camera.orthographic(2, 2, extent=(1.0, 1.0), near=0.0, far=1.01)
    if kind == "linear":
        camera = Camera.perspective(2, 2, fov_y_deg=60)
    scale = 0.002 if dtype == "u2" and kind == "linear" else 1.0
    stored = np.full((2, 2), 5000 if dtype == "u2" else 10, dtype=dtype)
    buffer = DepthBuffer(stored, camera, kind=kind, scale=scale)
    assert buffer.depth_step() == pytest.approx(np.full((2, 2), step))


def test_of_several_samples_the_first_is_estimated_and_all_are_kept():
    camera = Camera.orthographic(6, 5, extent=(6.0, 5.0))
    stack = np.random.default_rng(1).uniform(2.0, 4.0, (3, 5, 6))
    stack[1, 0, 0] = np.inf
    many, one = DepthBuffer(stack, camera), DepthBuffer(stack[0], camera)
    assert many.samples.shape == (3, 5, 6)
    assert np.array_equal(many.samples[2], stack[2].astype(np.float32))
    assert np.isnan(many.samples[1, 0, 0])
    assert one.samples is None
    options = {"method": "raytraced", "rays": 16}
    assert np.array_equal(
        ambient_occlusion(many, **options).occlusion, ambient_occlusion(one, **options).occlusion
    )


def test_a_terrain_is_seen_from_straight_above():
    heights = np.random.default_rng(2).uniform(0.0, 30.0, (7, 9))
    heights[3, 3] = np.nan
    terrain = Terrain(heights, (10.0, 20.0))
    buffer = DepthBuffer.from_terrain(terrain)
    assert not buffer.camera.perspective_divide
    assert buffer.holes[3, 3]
    position = buffer.camera.position(*np.mgrid[0:7, 0:9], buffer.depth)
    up = position[2] - np.nanmax(position[2])
    assert np.allclose(up, heights - np.nanmax(heights), atol=1e-4, equal_nan=True)
    assert np.allclose(np.diff(position[0], axis=1), 10.0)
    assert np.allclose(np.diff(position[1], axis=0), -20.0)


def test_given_normals_are_used_bent_or_rebuilt():
    camera = Camera.perspective(5, 5, fov_y_deg=40.0)
    given = np.zeros((3, 5, 5))
    given[2] = 2.0
    given[:, 0, 0] = 0.0  # missing
    given[:, 4, 4] = (0.6, 0.0, -0.8)  # faces away
    buffer = DepthBuffer(np.full((5, 5), 3.0), camera, normals=given)
    normal = buffer.field.normal
    assert buffer.normal_counts == {"degenerate": 0, "bent": 1, "missing": 1}
    assert normal[:, 2, 2].tolist() == [0.0, 0.0, 1.0]
    assert normal[:, 0, 0] == pytest.approx([0.0, 0.0, 1.0])
    to_eye = -camera.position(4, 4, 1.0)
    to_eye /= np.linalg.norm(to_eye)
    assert normal[:, 4, 4] @ to_eye == pytest.approx(1e-3, abs=1e-6)
    assert np.linalg.norm(normal[:, 4, 4]) == pytest.approx(1.0)
    left = Camera.perspective(5, 5, fov_y_deg=40.0, handedness="left")
    turned = DepthBuffer(np.full((5, 5), 3.0), left, normals=given * [[[1]], [[1]], [[-1]]])
    assert np.array_equal(turned.field.normal, normal)


def test_the_callers_arrays_are_neither_kept_nor_changed():
    camera = Camera.orthographic(4, 4, extent=(1.0, 1.0))
    depth = np.full((4, 4), 2.0, dtype=np.float32)
    depth[0, 0] = np.inf
    before = depth.copy()
    buffer = DepthBuffer(depth, camera)
    assert np.array_equal(depth, before)
    depth[:] = 9.0
    assert buffer.depth[1, 1] == 2.0
    with pytest.raises(ValueError, match="read-only"):
        buffer.depth[0, 0] = 1.0


def test_a_masked_array_has_holes_under_its_mask():
    camera = Camera.orthographic(2, 1, extent=(2.0, 1.0))
    depth = np.ma.masked_array(np.array([[5, 6]], dtype=np.uint16), mask=[[False, True]])
    buffer = DepthBuffer(depth, camera)
    assert buffer.holes.tolist() == [[False, True]]


@pytest.mark.parametrize(
    ("field", "depth", "options"),
    [
        ("depth", np.zeros((3, 4)), {}),
        ("depth", np.zeros(4), {}),
        ("depth", np.zeros((0, 4, 4)), {}),
        ("depth", np.full((4, 4), 1j), {}),
        ("depth", np.full((4, 4), "far"), {}),
        ("depth", np.full((4, 4), 1.5), {"kind": "device"}),
        ("kind", np.ones((4, 4)), {"kind": "z"}),
        ("scale", np.ones((4, 4)), {"scale": 0.0}),
        ("guard_band", np.ones((4, 4)), {"guard_band": 2}),
        ("guard_band", np.ones((4, 4)), {"guard_band": (1, 1)}),
        ("guard_band", np.ones((4, 4)), {"guard_band": -1}),
        ("guard_band", np.ones((4, 4)), {"guard_band": (0, 0, 0.5, 0)}),
        ("normals", np.ones((4, 4)), {"normals": np.ones((4, 4, 3))}),
        ("sky", np.ones((4, 4)), {"sky": np.ones((4, 4))}),
        ("second_layer", np.ones((4, 4)), {"second_layer": np.full((4, 4), 0.5)}),
        ("second_layer", np.ones((4, 4)), {"second_layer": np.ones((3, 4))}),
    ],
)
def test_what_is_no_depth_buffer_is_refused_by_name(field, depth, options):
    camera = Camera.perspective(4, 4, fov_y_deg=60.0, near=0.1)
    with pytest.raises(InputError, match=f"^{field}: must be "):
        DepthBuffer(depth, camera, **options)


def test_a_camera_is_asked_for():
    with pytest.raises(InputError, match="camera: must be a Camera"):
        DepthBuffer(np.ones((4, 4)), "camera.json")
