"""Filters over occlusion, against loops and by what they do to noise and to edges."""

import math

import numpy as np
import pytest
from screen_buffers import rough

import screen_scenes
from adret import Camera, DepthBuffer, InputError
from adret.screen import ambient_occlusion
from adret.screen.denoise import (
    box_4x4,
    cross_bilateral,
    edge_leakage,
    gaussian,
    joint_bilateral_upsample,
)


def noisy_planes(shape=(23, 31)):
    """Values with holes over two tilted planes with a step between, and some sky."""
    draw = np.random.default_rng(5)
    row, column = np.mgrid[0 : shape[0], 0 : shape[1]]
    depth = 4.0 + 0.02 * row + 0.01 * column + 1.5 * (column > 0.6 * row + 8)
    depth[18:, 5:9] = np.nan
    values = draw.random(shape)
    values[4, 7] = np.nan
    return values, depth


def by_loops(values, depth, steps, weight):
    """Weighted mean over neighbours, one by one."""
    out = np.full(values.shape, np.nan)
    for row, column in np.ndindex(values.shape):
        if np.isnan(values[row, column]):
            continue
        top = bottom = 0.0
        for (i, j), place in steps.items():
            r, c = row + i, column + j
            if 0 <= r < values.shape[0] and 0 <= c < values.shape[1]:
                w = place * weight(depth[r, c] - depth[row, column])
                if not np.isnan(values[r, c]) and not np.isnan(w):
                    top += w * values[r, c]
                    bottom += w
        out[row, column] = top / bottom if bottom > 0.0 else values[row, column]
    return out


def bell(radius):
    line = np.exp(-0.5 * (np.arange(-radius, radius + 1) / (0.5 * radius)) ** 2)
    return dict(zip(range(-radius, radius + 1), line / line.sum(), strict=True))


def test_the_box_equals_a_loop():
    values, depth = noisy_planes()
    steps = {(i, j): 1.0 for i in range(-1, 3) for j in range(-1, 3)}

    def same(d):
        return math.nan if np.isnan(d) else float(abs(d) < 0.3)

    expected = by_loops(values, depth, steps, same)
    found = box_4x4(values, depth, depth_tolerance=0.3)
    assert np.allclose(found, expected, atol=1e-6, equal_nan=True)


@pytest.mark.parametrize("separable", [True, False])
def test_the_cross_bilateral_filter_equals_a_loop(separable):
    values, depth = noisy_planes()
    line = bell(3)
    found = cross_bilateral(values, depth, depth_tolerance=0.2, radius=3, separable=separable)

    def like(d):
        return math.exp(-0.5 * (d / 0.2) ** 2)

    if separable:
        expected = by_loops(values, depth, {(0, j): w for j, w in line.items()}, like)
        expected = by_loops(expected, depth, {(i, 0): w for i, w in line.items()}, like)
    else:
        steps = {(i, j): v * w for i, v in line.items() for j, w in line.items()}
        expected = by_loops(values, depth, steps, like)
    # The weight over depth is a power that follows the exponential to 3e-4.
    assert np.allclose(found, expected, atol=2e-3, equal_nan=True)


def test_the_gaussian_equals_a_loop():
    values, _ = noisy_planes()
    line = bell(2)
    expected = by_loops(values, 0.0 * values, {(0, j): w for j, w in line.items()}, lambda d: 1.0)
    expected = by_loops(
        expected, np.zeros(values.shape), {(i, 0): w for i, w in line.items()}, lambda d: 1.0
    )
    # NaN in the loop's depth is NaN in its weight only where the value is NaN as well.
    assert np.allclose(gaussian(values), expected, atol=1e-5, equal_nan=True)


def test_upsampling_equals_a_loop():
    values, depth = noisy_planes((24, 32))
    low, low_depth = values[::2, ::2], depth[::2, ::2]
    found = joint_bilateral_upsample(low, low_depth, depth, depth_tolerance=0.2, reach=2)
    for row, column in np.ndindex(depth.shape):
        y, x = (row + 0.5) / 2.0 - 0.5, (column + 0.5) / 2.0 - 0.5
        top = bottom = 0.0
        for i, j in np.ndindex(low.shape):
            tent = max(0.0, 1.0 - abs(i - y) / 2.0) * max(0.0, 1.0 - abs(j - x) / 2.0)
            w = tent * math.exp(-0.5 * ((low_depth[i, j] - depth[row, column]) / 0.2) ** 2)
            if w > 0.0 and not np.isnan(low[i, j]):
                top += w * low[i, j]
                bottom += w
        if np.isnan(depth[row, column]):
            assert np.isnan(found[row, column])
        elif bottom > 1e-3:
            assert found[row, column] == pytest.approx(top / bottom, abs=3e-3)


def test_filters_leave_constants_and_their_arguments_alone():
    values, depth = noisy_planes()
    constant = np.where(np.isnan(values), np.nan, 0.3)
    before = depth.copy()
    for result in (
        box_4x4(constant, depth, depth_tolerance=0.1),
        gaussian(constant, radius=5),
        cross_bilateral(constant, depth, depth_tolerance=0.1),
        cross_bilateral(constant, depth, depth_tolerance=0.1, radius=2, separable=False),
    ):
        assert np.allclose(result[~np.isnan(values)], 0.3, atol=1e-6)
        assert np.array_equal(np.isnan(result), np.isnan(values))
    assert np.array_equal(depth, before, equal_nan=True)


def test_the_box_takes_away_a_pattern_that_repeats_every_4_x_4_pixels_whole():
    view = screen_scenes.look(screen_scenes.plane(), "perspective", 40, lean=0.2)
    camera = Camera.perspective(40, 40, **view.lens)
    buffer = DepthBuffer(view.depth, camera, normals=view.normals)
    raw = ambient_occlusion(
        buffer, method="vao", radius=1.0, samples=4, normalisation="analytic", seed=3
    ).occlusion
    filtered = box_4x4(raw, buffer.depth, depth_tolerance=10.0)
    assert filtered[6:-6, 6:-6].std() < 1e-5
    pattern = np.tile(np.random.default_rng(0).random((4, 4)), (5, 6))
    smooth = box_4x4(pattern, np.ones(pattern.shape), depth_tolerance=1.0)
    assert np.allclose(smooth[1:-2, 1:-2], pattern[:4, :4].mean(), atol=1e-6)


def step_with_noise():
    """True occlusion that differs across a step in depth, the same with noise, and the depth."""
    draw = np.random.default_rng(1)
    row, column = np.mgrid[0:64, 0:96]
    depth = np.where(column + 0.3 * row < 60, 2.0, 6.0)
    truth = np.where(depth < 4.0, 0.1, 0.6) + 0.05 * np.sin(0.1 * row)
    return truth, truth + 0.1 * draw.standard_normal(truth.shape), depth


def test_filters_that_know_depth_take_out_noise_and_leak_nothing_across_edges():
    truth, noisy, depth = step_with_noise()
    options = {"depth_tolerance": 0.5}
    error = np.abs(noisy - truth).mean()
    found = {
        "gaussian": (gaussian(noisy), gaussian(truth)),
        "box": (box_4x4(noisy, depth, **options), box_4x4(truth, depth, **options)),
        "separable": (
            cross_bilateral(noisy, depth, **options),
            cross_bilateral(truth, depth, **options),
        ),
        "whole": (
            cross_bilateral(noisy, depth, radius=4, separable=False, **options),
            cross_bilateral(truth, depth, radius=4, separable=False, **options),
        ),
    }
    leak = {
        name: edge_leakage(truth, clean, depth, depth_step=1.0)
        for name, (_, clean) in found.items()
    }
    left = {name: np.abs(result - truth).mean() / error for name, (result, _) in found.items()}
    assert left["box"] < 0.35
    assert left["separable"] < 0.2
    assert left["whole"] < 0.3
    assert leak["gaussian"] > 0.07
    assert max(leak[name] for name in ("box", "separable", "whole")) < 0.006


def test_edge_leakage_is_the_mean_change_beside_edges():
    depth = np.ones((5, 8))
    depth[:, 4:] = 3.0
    after = np.zeros((5, 8))
    after[:, 3], after[:, 5], after[:, 0] = 0.4, 0.2, 9.0
    leak = edge_leakage(np.zeros((5, 8)), after, depth, depth_step=1.0)
    assert leak == pytest.approx((0.4 + 0.2) / 4.0)
    assert np.isnan(edge_leakage(after, after, np.ones((5, 8)), depth_step=1.0))


def test_samples_of_a_pixel_at_an_edge_are_filtered_one_by_one():
    truth, _, depth = step_with_noise()
    # A second sample that lies on the other side in the pixels just before the step.
    other = depth.copy()
    edge = (depth < 4.0) & (np.roll(depth, -1, axis=1) > 4.0)
    edge[:, -1] = False
    other[edge] = 6.0
    plain = cross_bilateral(truth, depth, depth_tolerance=0.5, radius=3)
    resolved = cross_bilateral(
        truth, depth, depth_tolerance=0.5, radius=3, samples=np.stack([depth, other])
    )
    assert np.array_equal(resolved[~edge], plain[~edge])
    # Half of such a pixel shows the far side, whose occlusion is larger by 0.5.
    row, column = np.nonzero(edge)
    assert np.allclose(resolved[row, column] - plain[row, column], 0.25, atol=0.02)


def test_upsampling_keeps_the_sides_of_an_edge_apart():
    truth, _, depth = step_with_noise()
    low, low_depth = truth[::2, ::2], depth[::2, ::2]
    aware = joint_bilateral_upsample(low, low_depth, depth, depth_tolerance=0.5)
    blind = joint_bilateral_upsample(
        low, np.ones(low.shape), np.ones(depth.shape), depth_tolerance=1
    )
    assert np.abs(aware - truth).max() < 0.03
    assert edge_leakage(truth, aware, depth, depth_step=1.0) < 0.01
    assert edge_leakage(truth, blind, depth, depth_step=1.0) > 0.04


def test_sizes_of_any_kind():
    for shape in ((1, 1), (1, 9), (9, 1), (2, 3)):
        v, d = np.full(shape, 0.4), np.ones(shape)
        for result in (
            box_4x4(v, d, depth_tolerance=1.0),
            gaussian(v, radius=6),
            cross_bilateral(v, d, depth_tolerance=1.0),
            joint_bilateral_upsample(v[:1, :1], d[:1, :1], d, depth_tolerance=1.0),
        ):
            assert np.allclose(result, 0.4)
    dark = np.full((3, 4), np.nan)
    assert np.isnan(box_4x4(dark, np.ones((3, 4)), depth_tolerance=1.0)).all()
    buffer = rough(True)
    assert np.isfinite(gaussian(np.nan_to_num(buffer.depth))).all()


def test_what_cannot_be_used_is_refused_by_name():
    v, d = np.zeros((4, 5)), np.ones((4, 5))
    with pytest.raises(InputError, match="depth: must be of shape"):
        box_4x4(v, d[:3], depth_tolerance=1.0)
    with pytest.raises(InputError, match="depth_tolerance: must be a number above 0, got 0"):
        cross_bilateral(v, d, depth_tolerance=0)
    with pytest.raises(InputError, match="radius: must be a whole number from 1 to 64"):
        gaussian(v, radius=0)
    with pytest.raises(InputError, match="sigma: must be a number above 0"):
        gaussian(v, sigma=-1.0)
    with pytest.raises(InputError, match="reach: must be a whole number from 1 to 8"):
        joint_bilateral_upsample(v, d, d, depth_tolerance=1.0, reach=9)
    with pytest.raises(InputError, match="values: must be real, of shape"):
        gaussian(np.zeros(3))
    with pytest.raises(InputError, match="samples: must be real, of shape"):
        cross_bilateral(v, d, depth_tolerance=1.0, samples=d)
    with pytest.raises(InputError, match="after: must be of shape"):
        edge_leakage(v, v[:2], d, depth_step=1.0)
