"""What the sampled methods have in common: threads, frames, sky, holes, odd sizes."""

import math

import numpy as np
import pytest
from screen_buffers import rough

from adret import Camera, Cancelled, DepthBuffer, InputError
from adret._kernels.jit import threads
from adret.screen import ambient_occlusion

METHODS = [
    ("crytek", {}),
    ("crytek", {"domain": "hemisphere", "radius_in": "frame", "radius": 0.1}),
    ("hbao", {"radius": 0.7}),
    ("hbao", {"form": "rays", "radius": 0.7}),
    ("vao", {}),
    ("vao", {"estimator": "containment"}),
    ("lightfield", {"radii": 3}),
]
ids = ["-".join([name, *map(str, options.values())]) for name, options in METHODS]
each_method = pytest.mark.parametrize(("method", "options"), METHODS, ids=ids)


@each_method
@pytest.mark.parametrize("perspective", [True, False])
def test_one_thread_and_two_give_the_same_bytes(method, options, perspective):
    buffer = rough(perspective)
    before = threads()
    try:
        results = []
        for count in (1, min(2, before)):
            threads(count)
            results.append(ambient_occlusion(buffer, method=method, **options))
    finally:
        threads(before)
    assert results[0].occlusion.tobytes() == results[1].occlusion.tobytes()
    assert results[0].confidence.tobytes() == results[1].confidence.tobytes()


@each_method
def test_a_frame_is_the_same_window_of_the_whole(method, options):
    whole = ambient_occlusion(rough(True), method=method, **{**options, "seed": 4})
    if options.get("radius_in") == "frame":
        options = {**options, "radius": options["radius"] * 17 / 10}
    inner = ambient_occlusion(
        rough(True, guard_band=(3, 5, 1, 2)), method=method, **{**options, "seed": 4}
    )
    assert inner.occlusion.shape == (9, 10)
    assert np.allclose(inner.occlusion, whole.occlusion[3:12, 2:12], atol=1e-6, equal_nan=True)
    assert np.allclose(inner.confidence, whole.confidence[3:12, 2:12], atol=1e-6)


@each_method
def test_sky_is_open_and_holes_stay_holes_and_neither_occludes(method, options):
    result = ambient_occlusion(rough(True), method=method, **options)
    assert np.isnan(result.occlusion[1, 2])
    assert np.isnan(result.occlusion).sum() == 1
    assert np.all(result.occlusion[10:, 3:5] == 0.0)
    assert np.all(result.confidence[10:, 3:5] == 0.0)
    assert result.confidence[1, 2] == 0.0
    assert result.report.skipped["sky"] == 6
    assert result.report.skipped["holes"] == 1
    assert result.occlusion.dtype == result.confidence.dtype == np.float32
    shown = result.confidence[~np.isnan(rough(True).depth)]
    assert 0.0 <= shown.min() < shown.max() <= 1.0


@each_method
@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (2, 2)])
def test_images_of_any_size(method, options, shape):
    for camera in (
        Camera.perspective(shape[1], shape[0], fov_y_deg=50.0),
        Camera.orthographic(shape[1], shape[0], extent=(1.0, 1.0)),
    ):
        flat = DepthBuffer(np.full(shape, 2.0), camera)
        result = ambient_occlusion(flat, method=method, **options)
        assert result.occlusion.shape == shape
        assert np.isfinite(result.occlusion).all()
        sky = ambient_occlusion(DepthBuffer(np.full(shape, np.inf), camera), method=method)
        assert np.all(sky.occlusion == 0.0)


@each_method
@pytest.mark.parametrize("radius", [1e-6, 1e6])
@pytest.mark.parametrize("perspective", [True, False])
def test_tiny_and_huge_radii_give_numbers_between_0_and_1(method, options, radius, perspective):
    result = ambient_occlusion(rough(perspective), method=method, **{**options, "radius": radius})
    known = result.occlusion[~np.isnan(result.occlusion)]
    assert known.size == 13 * 17 - 1
    assert 0.0 <= known.min() <= known.max() <= 1.0


def test_only_horizons_take_an_infinite_radius():
    result = ambient_occlusion(rough(True), method="hbao", radius=math.inf, falloff="none")
    assert np.nanmax(result.occlusion) > 0.2
    for method in ("crytek", "vao", "lightfield"):
        with pytest.raises(InputError, match="radius: must be a number between 0 and"):
            ambient_occlusion(rough(True), method=method, radius=math.inf)


@each_method
def test_a_run_can_be_watched_and_stopped(method, options):
    steps = []
    ambient_occlusion(
        rough(True), method=method, progress=lambda *each: steps.append(each), **options
    )
    assert steps[0][0] == 0
    assert steps[-1][0] == steps[-1][1]
    assert [done for done, _ in steps] == sorted(done for done, _ in steps)

    def stop(done, total):
        raise Cancelled("enough")

    with pytest.raises(Cancelled):
        ambient_occlusion(rough(True), method=method, progress=stop, **options)


def test_unknown_options_are_refused_with_those_that_are_known():
    with pytest.raises(InputError, match="directions: must be an option of 'vao': one of radius"):
        ambient_occlusion(rough(True), method="vao", directions=4)
