"""Crytek's ambient occlusion: how much of a ball is solid."""

import math

import numpy as np
import pytest
from screen_buffers import depth_at, framed, measured, pixel, point, rough

import screen_scenes
from adret import Camera, DepthBuffer, InputError
from adret.screen import ambient_occlusion, color_bleeding
from adret.screen.crytek import published_kernel
from adret.screen.samples import rotations

PROJECTIONS = ("orthographic", "perspective")


def solid_share_beside_a_wall(distance: np.ndarray) -> np.ndarray:
    """Mean over the kernel's spheres: half, and a quarter of what the wall cuts off above."""
    lengths = np.linalg.norm(published_kernel(16), axis=1)[:, None]
    return 0.5 + 0.25 * np.maximum(0.0, 1.0 - distance / lengths).mean(axis=0)


def test_the_kernel_is_made_of_cube_corners_whose_distance_grows_as_published():
    lengths = np.linalg.norm(published_kernel(16), axis=1)
    assert np.allclose(lengths[1:] / lengths[:-1], 1.15)
    assert lengths[-1] == pytest.approx(1.0)
    assert np.allclose(np.abs(published_kernel(24)).T, lengths_of(24) / math.sqrt(3.0))
    # In texture coordinates, where published, the last one lies at 0.0936.
    assert pytest.approx(0.0936, abs=5e-5) == 0.01 * 1.15**16


def lengths_of(count: int) -> np.ndarray:
    scale, lengths = 0.01, []
    for _ in range(count):
        scale *= 1.0 + 2.4 / count
        lengths.append(scale)
    return np.array(lengths) / lengths[-1]


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("lean", [0.0, 0.6])
def test_a_plane_is_one_half_at_any_tilt_and_zero_with_the_hemisphere(projection, lean):
    view = screen_scenes.look(screen_scenes.plane(), projection, 60, lean=lean, pitch=0.3)
    for domain, value in (("sphere", 0.5), ("hemisphere", 0.0)):
        found, rows, columns, result = measured(view, method="crytek", radius=0.8, domain=domain)
        confidence = result.confidence[rows - rows.min(), columns - columns.min()]
        inside = confidence == 1.0
        assert inside.sum() > 500
        assert np.array_equal(found[inside], np.full(inside.sum(), value, np.float32))


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_beside_a_wall_it_is_the_solid_share_of_the_kernels_spheres(projection):
    errors = []
    for pixels in (120, 240):
        view = screen_scenes.look(screen_scenes.wall(reach=(0.05, 1.5)), projection, pixels)
        options = {"radius": 2.0, "tile": 16, "range_check": "none"}
        found, rows, columns, _ = measured(view, method="crytek", **options)
        truth = solid_share_beside_a_wall(-view.points[0, rows, columns] / 2.0)
        errors.append(abs((found - truth).mean()))
    assert max(errors) < 0.004
    # At the foot of the wall it is 3/4, or it would not be Crytek's.
    assert solid_share_beside_a_wall(np.zeros(1)) == pytest.approx(0.75)


def test_an_edge_is_brighter_than_a_wall_and_a_foot_darker():
    depth = np.where(np.arange(200) < 100, 5.0, 4.0) * np.ones((100, 1))
    buffer = DepthBuffer(depth, Camera.orthographic(200, 100, extent=(2.5, 1.25)), guard_band=42)
    result = ambient_occlusion(
        buffer, method="crytek", radius=0.5, tile=16, range_check="none"
    ).occlusion.mean(axis=0)
    # The step lies between columns 99 and 100, of 0.0125 each.
    away = np.array([0.5, 40.5]) * 0.0125 / 0.5
    foot, far = solid_share_beside_a_wall(away)
    assert foot == pytest.approx(0.74, abs=0.01)
    assert result[99 - 42] == pytest.approx(foot, abs=0.02)
    assert result[100 - 42] == pytest.approx(1.0 - foot, abs=0.02)
    assert result[[59 - 42, 140 - 42]] == pytest.approx([far, 1.0 - far], abs=1e-6)


@pytest.mark.parametrize("perspective", [True, False])
@pytest.mark.parametrize("check", ["none", "radius", "depth"])
@pytest.mark.parametrize("domain", ["sphere", "hemisphere"])
def test_the_kernel_equals_a_loop_written_from_the_paper(perspective, check, domain):
    buffer = rough(perspective)
    radius, seed, tile = 0.5, 3, 4
    result = ambient_occlusion(
        buffer, method="crytek", radius=radius, seed=seed, range_check=check, domain=domain
    )
    turns, kernel = rotations(tile * tile, seed), published_kernel(16)
    neutral = 0.5 if domain == "sphere" else 0.0
    for row in range(buffer.shape[0]):
        for column in range(buffer.shape[1]):
            if np.isnan(buffer.depth[row, column]):
                continue
            here = point(buffer, row, column)
            total, seen = 0.0, 0
            for offset in kernel:
                way = radius * (turns[row % tile * tile + column % tile] @ offset)
                if domain == "hemisphere" and way @ buffer.field.normal[:, row, column] < 0.0:
                    way = -way
                place = pixel(buffer, here + way)
                if place is None:
                    total += neutral
                    continue
                seen += 1
                surface = depth_at(buffer, *place)
                if np.isnan(surface):
                    continue
                closed = float(surface < -(here + way)[2])
                front = -here[2] - surface
                fade = {"none": 0.0, "radius": front / radius - 1.0, "depth": front / surface}
                share = min(max(fade[check], 0.0), 1.0)
                total += share * neutral + (1.0 - share) * closed
            assert result.occlusion[row, column] == pytest.approx(total / 16, abs=1e-6)
            assert result.confidence[row, column] == pytest.approx(seen / 16, abs=1e-6)


def test_the_published_contrast_turns_a_flat_wall_into_a_quarter():
    buffer = DepthBuffer(np.full((9, 9), 2.0), Camera.perspective(9, 9, fov_y_deg=40.0))
    result = ambient_occlusion(buffer, method="crytek", radius=0.1, amplify=True)
    assert np.all(result.occlusion[1:-1, 1:-1] == 0.25)


def test_a_radius_in_shares_of_the_frame_is_the_same_at_any_depth_and_size():
    small, large = (
        screen_scenes.look(screen_scenes.wall(reach=(0.5, 1.2)), "perspective", n)
        for n in (60, 120)
    )
    found = [
        ambient_occlusion(
            DepthBuffer(
                scale * view.depth, Camera.perspective(view.width, view.height, **view.lens)
            ),
            method="crytek",
            radius=0.1,
            radius_in="frame",
            tile=1,
        ).occlusion
        for view, scale in ((small, 1.0), (small, 7.0), (large, 1.0))
    ]
    assert np.abs(found[0] - found[1]).max() < 1e-6
    assert np.abs(found[2].reshape(60, 2, 60, 2).mean(axis=(1, 3)) - found[0]).mean() < 0.01


def test_samples_come_in_cubes():
    buffer, _, _ = framed(screen_scenes.look(screen_scenes.plane(), "orthographic", 12))
    with pytest.raises(InputError, match="samples: must be a multiple of 8, got 12"):
        ambient_occlusion(buffer, method="crytek", samples=12)


@pytest.mark.parametrize("perspective", [True, False])
def test_one_color_bleeds_as_much_as_it_occludes(perspective):
    buffer = rough(perspective, guard_band=(1, 0, 2, 3))
    options = {"radius": 0.5, "domain": "hemisphere", "seed": 3}
    occlusion = ambient_occlusion(buffer, method="crytek", **options).occlusion
    bled = color_bleeding(
        buffer, np.stack([np.full(buffer.shape, 0.5), np.ones(buffer.shape)]), **options
    )
    known = ~np.isnan(buffer.depth[1:-2, 3:])
    assert np.allclose(bled[1][known], occlusion[known], atol=1e-6)
    assert np.allclose(bled[0], 0.5 * bled[1], atol=1e-6)
    assert np.all(bled[:, ~known] == 0.0)


def test_a_red_wall_bleeds_on_a_floor_and_not_on_itself():
    depth = np.where(np.arange(60) < 30, 5.0, 4.0) * np.ones((40, 1))
    buffer = DepthBuffer(depth, Camera.orthographic(60, 40, extent=(6.0, 4.0)))
    red = (depth < 4.5).astype(float)
    bled = color_bleeding(buffer, red, radius=0.8, range_check="none")
    occlusion = ambient_occlusion(
        buffer, method="crytek", radius=0.8, range_check="none", domain="hemisphere"
    ).occlusion
    assert np.all(bled[:, 33:] == 0.0)
    # What occludes the floor is the step, and all but its lower half pixel is red.
    assert np.allclose(bled[12:28, 22:29], occlusion[12:28, 22:29], atol=0.07)
    assert bled[12:28, 29].mean() > 0.2
    assert np.all(color_bleeding(buffer, 1.0 - red, radius=0.8)[:, 45:58] == 0.0)


def test_a_color_that_does_not_fit_is_refused():
    buffer = rough(True)
    with pytest.raises(InputError, match="color: must be finite, of"):
        color_bleeding(buffer, np.zeros((3, 4, 5)))
    with pytest.raises(InputError, match="color: must be finite, of"):
        color_bleeding(buffer, np.full(buffer.shape, np.nan))
    with pytest.raises(InputError, match="color: must be real, of shape"):
        color_bleeding(buffer, np.zeros(4))
