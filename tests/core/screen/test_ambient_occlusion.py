"""What all methods share: options, strength, masks, reports, noise."""

import numpy as np
import pytest
from screen_buffers import rough

from adret import Camera, DepthBuffer, InputError, ambient_occlusion
from adret._kernels.jit import kernel
from adret._kernels.screen.noise import hash32, hash64, uniform
from adret.screen import METHODS
from adret.screen.occlusion import method_module, strengthened

MASK = (1 << 64) - 1


def slow_hash(row, column, seed, count):
    """splitmix64's finaliser over whole Python numbers."""
    golden, first, second = 0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB

    def mix(h):
        h = ((h ^ (h >> 30)) * first) & MASK
        h = ((h ^ (h >> 27)) * second) & MASK
        return h ^ (h >> 31)

    h = mix((((row << 32) | column) + golden) & MASK)
    h = mix(h ^ ((seed * golden + first) & MASK))
    return mix(h ^ ((count * golden + second) & MASK))


@kernel
def draw(rows, columns, seed, count, whole, half, floats):
    for row in range(rows):
        for column in range(columns):
            for k in range(count):
                whole[row, column, k] = hash64(row, column, seed, k)
                half[row, column, k] = hash32(row, column, seed, k)
                floats[row, column, k] = uniform(row, column, seed, k)


def drawn(rows, columns, seed, count):
    shape = (rows, columns, count)
    arrays = np.empty(shape, np.uint64), np.empty(shape, np.uint32), np.empty(shape)
    draw(rows, columns, seed, count, *arrays)
    return arrays


def test_noise_is_the_published_mixer_of_place_seed_and_count():
    whole, half, floats = drawn(3, 4, 7, 5)
    for row, column, k in np.ndindex(whole.shape):
        value = slow_hash(row, column, 7, k)
        assert int(whole[row, column, k]) == value
        assert int(half[row, column, k]) == value >> 32
        assert floats[row, column, k] == (value >> 11) / 2.0**53


def test_noise_is_even_and_neighbours_have_nothing_in_common():
    _, _, floats = drawn(128, 128, 1, 4)
    _, _, others = drawn(128, 128, 2, 4)
    n = floats.size
    counts = np.histogram(floats, bins=64, range=(0, 1))[0]
    assert ((counts - n / 64) ** 2 / (n / 64)).sum() < 120  # chi², 63 degrees: 120 is 1e-5
    centred = floats - 0.5
    for product in (
        centred[1:] * centred[:-1],
        centred[:, 1:] * centred[:, :-1],
        centred[:, :, 1:] * centred[:, :, :-1],
        centred * (others - 0.5),
    ):
        assert abs(product.mean()) < 4.5 / 12.0 / np.sqrt(product.size)


def test_options_that_a_method_does_not_know_are_refused_with_those_it_knows():
    buffer = rough(True)
    with pytest.raises(InputError, match=r"slices: must be an option of 'raytraced': one of rays,"):
        ambient_occlusion(buffer, method="raytraced", slices=3)
    with pytest.raises(InputError, match=r"method: must be one of .*raytraced.*got 'ssao'"):
        ambient_occlusion(buffer, method="ssao")
    with pytest.raises(InputError, match="buffer: must be a DepthBuffer"):
        ambient_occlusion(np.ones((3, 3)), method="raytraced")
    for name, value in (("power", 0.0), ("intensity", -1.0), ("power", "2"), ("power", np.nan)):
        with pytest.raises(InputError, match=f"{name}: must be a number above 0"):
            ambient_occlusion(buffer, method="raytraced", **{name: value})


@pytest.mark.parametrize("method", sorted(METHODS))
def test_every_method_has_options_with_words_and_an_estimator(method):
    module = method_module(method)
    for name, entry in module.Options.__dataclass_fields__.items():
        assert entry.metadata["description"], name
    assert callable(module.estimate)


def test_strength_is_a_factor_and_then_a_power_of_the_visibility():
    values = np.array([0.0, 0.2, 0.5, 1.0, np.nan], dtype=np.float32)
    assert strengthened(values, 1.0, 1.0) == pytest.approx(values, nan_ok=True)
    assert strengthened(values, 2.0, 1.0) == pytest.approx([0, 0.36, 0.75, 1, np.nan], nan_ok=True)
    assert strengthened(values, 1.0, 3.0) == pytest.approx([0, 0.6, 1, 1, np.nan], nan_ok=True)
    buffer = rough(False)
    plain = ambient_occlusion(buffer, method="raytraced", rays=64)
    strong = ambient_occlusion(buffer, method="raytraced", rays=64, power=2.0, intensity=0.8)
    expected = 1.0 - (1.0 - 0.8 * plain.occlusion.astype(np.float64)) ** 2
    assert np.allclose(strong.occlusion, expected, atol=1e-6, equal_nan=True)


def test_the_report_says_what_was_done():
    buffer = rough(True)
    result = ambient_occlusion(buffer, method="raytraced", rays=32, radius=1.5)
    report = result.report
    assert report.method == "raytraced"
    assert report.options["radius"] == 1.5
    assert report.options["thickness"] == np.inf
    assert report.receivers == np.isfinite(buffer.depth).sum()
    assert report.skipped["holes"] == buffer.holes.sum()
    assert report.measured["rays"] == 32
    assert report.seconds > 0.0
    assert "raytraced" in repr(result)


def test_progress_ends_at_the_total_and_may_stop_the_run():
    buffer = rough(True)
    seen = []
    ambient_occlusion(buffer, method="raytraced", rays=8, progress=lambda *at: seen.append(at))
    assert seen[-1][0] == seen[-1][1] > 0

    def stop(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ambient_occlusion(buffer, method="raytraced", rays=8, progress=stop)


def test_a_second_layer_is_refused_where_it_would_be_ignored():
    camera = Camera.orthographic(4, 4, extent=(4.0, 4.0))
    buffer = DepthBuffer(np.ones((4, 4)), camera, second_layer=np.full((4, 4), 2.0))
    refused = [m for m in METHODS if not getattr(method_module(m), "SECOND_LAYER", False)]
    for method in refused:
        with pytest.raises(InputError, match="second_layer: must be None for the method"):
            ambient_occlusion(buffer, method=method)
    assert ambient_occlusion(buffer, method="raytraced", rays=8).occlusion.max() == 0.0
