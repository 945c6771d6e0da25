"""Half resolution and filters as options of every method."""

import numpy as np
import pytest
from screen_buffers import camera_of, rough

import screen_scenes
from adret import Camera, DepthBuffer, InputError
from adret.screen import PositionsBuffer, ambient_occlusion
from adret.screen.denoise import box_4x4, cross_bilateral, edge_leakage, gaussian
from adret.screen.halved import halved


def scene(pixels: int = 120, guard_band: int = 11) -> DepthBuffer:
    view = screen_scenes.look(screen_scenes.trench(), "perspective", pixels)
    return DepthBuffer(view.depth, camera_of(view), normals=view.normals, guard_band=guard_band)


def test_the_halved_field_shows_the_same_points():
    buffer = rough(True, guard_band=(3, 2, 0, 1))
    low, shift = halved(buffer.field)
    assert shift == (1, 1)
    assert low.frame == (1, 7, 0, 8)
    assert np.array_equal(low.depth, buffer.depth[::2, ::2], equal_nan=True)
    for i, j in ((0, 0), (3, 5)):
        by_low = (low.rays[0] * j + low.rays[1], low.rays[2] * i + low.rays[3])
        ax, bx, ay, by = buffer.field.rays
        assert np.allclose(by_low, (ax * 2 * j + bx, ay * 2 * i + by))


def test_half_the_resolution_is_the_whole_one_on_every_second_pixel():
    buffer = scene(guard_band=10)
    options = {"method": "vao", "radius": 1.0, "tile": 1}
    whole = ambient_occlusion(buffer, **options)
    half = ambient_occlusion(buffer, half_res=True, **options)
    assert half.occlusion.shape == whole.occlusion.shape
    # Where samples fall between pixels the surface of every second pixel is another one.
    assert np.abs(half.occlusion - whole.occlusion)[::2, ::2].mean() < 0.01
    assert np.abs(half.occlusion - whole.occlusion).mean() < 0.02
    assert half.report.receivers == whole.report.receivers


@pytest.mark.parametrize("guard_band", [0, (1, 2, 3, 4), 7])
def test_half_resolution_keeps_edges_sky_and_holes(guard_band):
    depth = np.full((41, 50), 4.0)
    depth[:, 21:] = 2.0
    depth[5:9, 5:9] = np.inf
    depth[20, 30] = np.nan
    buffer = DepthBuffer(depth, Camera.perspective(50, 41, fov_y_deg=50.0), guard_band=guard_band)
    result = ambient_occlusion(buffer, method="crytek", radius=0.05, half_res=True)
    row0, row1, column0, column1 = buffer.frame
    shown = depth[row0:row1, column0:column1]
    assert np.array_equal(np.isnan(result.occlusion), np.isnan(shown))
    assert np.all(result.occlusion[np.isinf(shown)] == 0.0)
    assert np.all(result.confidence[np.isinf(shown)] == 0.0)
    flat = result.occlusion[np.isfinite(shown)]
    assert abs(np.median(flat) - 0.5) < 1e-6


def test_a_thin_thing_that_half_the_rows_miss_is_open_and_not_a_hole():
    depth = np.full((12, 12), np.inf)
    depth[:, 5] = 2.0  # every second column, from 0 on, shows sky
    buffer = DepthBuffer(depth, Camera.perspective(12, 12, fov_y_deg=50.0))
    result = ambient_occlusion(buffer, method="hbao", radius=0.5, half_res=True)
    assert np.all(result.occlusion == 0.0)
    assert np.all(result.confidence == 0.0)


def test_filters_are_those_of_the_module_before_power_and_intensity():
    buffer = scene()
    row0, row1, column0, column1 = buffer.frame
    depth = buffer.depth[row0:row1, column0:column1]
    options = {"method": "vao", "radius": 1.0, "samples": 4}
    raw = ambient_occlusion(buffer, **options).occlusion
    for name, expected in (
        ("box", box_4x4(raw, depth, depth_tolerance=0.5)),
        ("bilateral", cross_bilateral(raw, depth, depth_tolerance=0.5)),
        ("gaussian", gaussian(raw)),
    ):
        found = ambient_occlusion(buffer, denoise=name, power=2.0, **options).occlusion
        assert np.allclose(found, 1.0 - (1.0 - np.clip(expected, 0, 1)) ** 2, atol=1e-6)


def test_several_samples_a_pixel_are_filtered_one_by_one_at_edges():
    depth = np.where(np.arange(40) < 20, 2.0, 4.0) * np.ones((30, 1))
    second = depth.copy()
    second[:, 19] = 4.0
    camera = Camera.perspective(40, 30, fov_y_deg=50.0)
    single = DepthBuffer(depth, camera)
    multi = DepthBuffer(np.stack([depth, second]), camera)
    options = {"method": "crytek", "radius": 0.3, "denoise": "bilateral", "range_check": "none"}
    plain = ambient_occlusion(single, **options).occlusion
    resolved = ambient_occlusion(multi, **options).occlusion
    changed = np.abs(plain - resolved).max(axis=0) > 1e-6
    assert changed[19]
    assert changed.sum() == 1


def test_noise_falls_and_edges_stay():
    buffer = scene()
    row0, row1, column0, column1 = buffer.frame
    depth = buffer.depth[row0:row1, column0:column1]
    options = {"method": "vao", "radius": 1.0}
    truth = ambient_occlusion(buffer, samples=512, disk="stratified", **options).occlusion
    raw = ambient_occlusion(buffer, samples=4, **options).occlusion
    box = ambient_occlusion(buffer, samples=4, denoise="box", **options).occlusion
    blurred = ambient_occlusion(buffer, samples=4, denoise="gaussian", **options).occlusion
    assert np.abs(box - truth).mean() < 0.6 * np.abs(raw - truth).mean()
    leaks = [edge_leakage(truth, each, depth, depth_step=0.6) for each in (box, blurred)]
    assert leaks[0] < leaks[1]


def test_what_cannot_be_used_is_refused_by_name():
    buffer = rough(True)
    for options, limit in (
        ({"half_res": 1}, "half_res: must be true or false, got 1"),
        ({"denoise": "median"}, "denoise: must be one of box, bilateral, gaussian, or None"),
        ({"denoise": "box", "depth_tolerance": 0.0}, "depth_tolerance: must be a number above 0"),
        ({"denoise": "box"}, "depth_tolerance: must be given to filter or upsample"),
    ):
        with pytest.raises(InputError, match=limit):
            ambient_occlusion(buffer, method="hbao", **options)
    row, column = np.mgrid[0:4, 0:6] + 0.5
    floor = np.stack([column, row, np.zeros((4, 6))])
    positions = PositionsBuffer(floor, lambda p: np.stack([p[0], p[1], -p[2]]))
    with pytest.raises(InputError, match="denoise: must be left out for images of positions"):
        ambient_occlusion(positions, method="lightfield", denoise="box")
