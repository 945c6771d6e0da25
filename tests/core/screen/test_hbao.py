"""Horizon-based ambient occlusion and its ray-marched form."""

import math

import numpy as np
import pytest
from screen_buffers import depth_at, measured, pixel, point, rough

import screen_scenes
from adret import Camera, DepthBuffer, InputError
from adret.screen import ambient_occlusion
from adret.screen.hbao import Options

PROJECTIONS = ("orthographic", "perspective")
FINE = {"directions": 64, "spacing": 1.0, "jitter": False}


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_a_plane_is_zero_at_any_tilt(projection):
    for lean, pitch in ((0.0, 0.0), (0.7, 0.4), (1.1, 0.0)):
        view = screen_scenes.look(screen_scenes.plane(), projection, 48, lean=lean, pitch=pitch)
        for options in ({}, {"radius": math.inf, "falloff": "none"}):
            found, *_ = measured(view, method="hbao", **{"radius": 1.0, **options})
            assert np.abs(found).max() < 2e-5


def test_a_plane_that_faces_the_eye_but_not_the_image_plane_is_zero():
    camera = Camera.perspective(64, 48, fov_y_deg=80.0)
    ax, bx, ay, by = camera.rays
    u, v = np.meshgrid(ax * np.arange(64) + bx, ay * np.arange(48) + by)
    normal = np.array([0.95, 0.1, -0.3])
    normal /= np.linalg.norm(normal)
    slope = -(normal[0] * u + normal[1] * v - normal[2])  # cosine to the eye, times a length
    depth = np.where(slope > 0.08, 1.0 / np.where(slope > 0.08, slope, 1.0), np.inf)
    normals = np.ones((3, 48, 64)) * normal[:, None, None]
    buffer = DepthBuffer(depth, camera, normals=normals)
    for options in ({"radius": 2.0}, {"radius": math.inf, "falloff": "none"}):
        found = ambient_occlusion(buffer, method="hbao", **FINE, **options).occlusion
        assert np.isfinite(found).sum() > 500
        assert np.nanmax(found) < 2e-5


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("name", ["step", "dihedral", "trench", "groove"])
def test_without_falloff_it_is_the_uniform_integral_and_the_error_falls(name, projection):
    errors = []
    for pixels in (120, 360):
        view = screen_scenes.look(screen_scenes.SCENES[name](), projection, pixels)
        found, rows, columns, _ = measured(view, method="hbao", falloff="none", **FINE)
        errors.append(np.abs(found - view.truth("uniform", rows, columns)).mean())
    # A vertical wall is one pixel wide, so its foot is known to half a pixel.
    assert errors[1] < 0.006
    assert errors[1] < 0.5 * errors[0]


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize(("falloff", "size"), [("hard", 2.0), ("quadratic", 2.0)])
def test_a_wall_that_is_seen_has_the_uniform_closed_forms(projection, falloff, size):
    errors = []
    for pixels in (90, 270):
        view = screen_scenes.look(screen_scenes.wall(), projection, pixels)
        found, rows, columns, _ = measured(
            view, method="hbao", radius=size, falloff=falloff, **FINE
        )
        truth = view.truth("uniform", rows, columns, falloff, size)
        errors.append(np.abs(found - truth).mean())
    assert errors[1] < 0.006
    assert errors[1] < 0.6 * errors[0]


def test_a_wall_seen_from_above_counts_by_its_top_as_published():
    distance, height, radius = 0.5, 0.6, 2.0
    azimuth = np.linspace(-0.5 * math.pi, 0.5 * math.pi, 100_001)
    top2 = (distance / np.cos(azimuth)) ** 2 + height**2
    share = np.maximum(0.0, 1.0 - top2 / radius**2) * height / np.sqrt(top2)
    published = float(np.trapezoid(share, azimuth)) / (2.0 * math.pi)
    assert published == pytest.approx(0.2039, abs=1e-4)
    found = []
    for pixels in (160, 480):
        side = distance / (pixels // 10 + 0.5) * (pixels + 1)  # a step midway between pixels
        camera = Camera.orthographic(pixels + 1, pixels + 1, extent=(side, side))
        ax, bx, _, _ = camera.rays
        x = ax * np.arange(pixels + 1) + bx
        depth = np.where(x > distance, 5.0 - height, 5.0) * np.ones((pixels + 1, 1))
        normals = np.zeros((3, *depth.shape))
        normals[2] = 1.0
        buffer = DepthBuffer(depth, camera, normals=normals, guard_band=pixels // 2)
        result = ambient_occlusion(buffer, method="hbao", radius=radius, **FINE)
        found.append(float(result.occlusion[0, 0]))
    assert found[0] == pytest.approx(published, abs=0.005)
    assert found[1] == pytest.approx(published, abs=0.0017)
    # Rays see the wall where they meet it; the gap is the method's, not ours.
    assert published < 0.222 - 0.015


def tangents_of(axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The x and y axes, carried along the great circle from the z axis to another."""
    x, y, z = axis
    first = np.array([1.0 - x * x / (1.0 + z), -x * y / (1.0 + z), -x])
    return first, np.cross(axis, first)


def horizons_by_the_paper(buffer: DepthBuffer, row: int, column: int, options: Options) -> float:
    """Equation 9, sample after sample, for one pixel, its axes turned to the view ray."""
    here = point(buffer, row, column)
    normal = buffer.field.normal[:, row, column].astype(float)
    ax, bx, ay, by = buffer.camera.rays
    u = v = 0.0
    footprint, toward = 1.0, np.array([0.0, 0.0, 1.0])
    if buffer.camera.perspective_divide:
        footprint, u, v = -here[2], ax * column + bx, ay * row + by
        toward = -here / np.linalg.norm(here)
    across, upward = tangents_of(toward)
    longest = options.radius / (footprint * min(ax, -ay) * toward[2])
    directions, steps = options.counts
    if options.spacing is not None:
        steps = int(longest / options.spacing)
    steps = min(steps, int(longest))
    bias = math.radians(options.angle_bias_deg)
    total = 0.0
    for k in range(directions):
        angle = 2.0 * math.pi * k / directions
        heading = math.cos(angle) * across - math.sin(angle) * upward
        highest, last, first = None, 0.0, None
        for i in range(1, steps + 1):
            far = i / (steps + 1) * options.radius / footprint
            at_column = math.floor(column + far * (heading[0] + heading[2] * u) / ax + 0.5)
            at_row = math.floor(row + far * (heading[1] + heading[2] * v) / ay + 0.5)
            if not (0 <= at_row < buffer.shape[0] and 0 <= at_column < buffer.shape[1]):
                break
            if (at_row, at_column) == (row, column) or np.isnan(buffer.depth[at_row, at_column]):
                continue
            way = point(buffer, at_row, at_column) - here
            distance = float(np.linalg.norm(way))
            if distance > options.radius:
                continue
            elevation = math.asin(way @ toward / distance)
            level = way - way @ toward * toward
            tangent = math.atan2(-(normal @ level) / (normal @ toward), np.linalg.norm(level))
            if options.tangents == "direction":
                first = tangent if first is None else first
                tangent = first
            tangent = min(tangent + bias, 0.5 * math.pi)
            if highest is None and elevation <= tangent:
                continue
            if highest is not None and elevation <= highest:
                continue
            above = math.sin(elevation) - math.sin(tangent)
            total += float(options.weights().weight(distance)) * (above - last)
            highest, last = elevation, above
    return total / directions


@pytest.mark.parametrize("perspective", [True, False])
@pytest.mark.parametrize(
    "given",
    [
        {"radius": 0.9},
        {"radius": 1.3, "spacing": 1.5, "directions": 7, "falloff": "none"},
        {"radius": 0.9, "angle_bias_deg": 20.0, "falloff": "timonen", "falloff_scale": 0.3},
        {"radius": 0.9, "quality": "high", "tangents": "direction"},
    ],
)
def test_horizons_equal_a_loop_written_from_the_paper(perspective, given):
    buffer = rough(perspective)
    options = Options(jitter=False, **given)
    result = ambient_occlusion(buffer, method="hbao", jitter=False, **given)
    for row in range(buffer.shape[0]):
        for column in range(buffer.shape[1]):
            if not np.isnan(buffer.depth[row, column]):
                expected = horizons_by_the_paper(buffer, row, column, options)
                found = float(result.occlusion[row, column])
                assert found == pytest.approx(min(max(expected, 0.0), 1.0), abs=2e-5)


def test_jitter_moves_samples_but_hardly_the_mean_and_few_steps_miss_some():
    view = screen_scenes.look(screen_scenes.wall(reach=(0.5, 1.5)), "orthographic", 120)
    still, *_ = measured(view, method="hbao", radius=2.0, **FINE)
    means = {}
    for steps in (8, 60):
        noisy = [
            measured(view, method="hbao", radius=2.0, directions=8, steps=steps, seed=seed)[0]
            for seed in range(8)
        ]
        assert np.std(noisy[0] - noisy[1]) > 0.002
        means[steps] = np.mean(noisy)
    assert means[60] == pytest.approx(still.mean(), abs=0.004)
    assert still.mean() - 0.03 < means[8] < means[60]


def test_the_per_sample_tangent_takes_away_false_occlusion_of_snapped_samples():
    view = screen_scenes.look(screen_scenes.plane(), "orthographic", 60, lean=0.9, pitch=0.4)
    worst = {
        tangents: np.abs(
            measured(view, method="hbao", radius=1.0, quality="high", tangents=tangents)[0]
        ).max()
        for tangents in ("sample", "direction")
    }
    assert worst["sample"] < 2e-5
    assert worst["direction"] > 0.01


def test_the_angle_bias_flattens_creases_below_it():
    view = screen_scenes.look(screen_scenes.dihedral(math.radians(165.0)), "orthographic", 90)
    plain, *_ = measured(view, method="hbao", radius=3.0, falloff="none", **FINE)
    biased, *_ = measured(
        view, method="hbao", radius=3.0, falloff="none", angle_bias_deg=16.0, **FINE
    )
    assert plain.mean() > 0.03
    assert np.all(biased == 0.0)


@pytest.mark.parametrize("perspective", [True, False])
def test_marched_rays_equal_a_loop_written_from_the_paper(perspective):
    buffer = rough(perspective)
    radius, steps, directions, rays = 0.9, 5, 4, 3
    result = ambient_occlusion(
        buffer,
        method="hbao",
        form="rays",
        radius=radius,
        steps=steps,
        directions=directions,
        rays=rays,
        jitter=False,
    )
    for row in range(1, buffer.shape[0], 2):
        for column in range(buffer.shape[1]):
            if np.isnan(buffer.depth[row, column]):
                continue
            here = point(buffer, row, column)
            normal = buffer.field.normal[:, row, column].astype(float)
            total = 0.0
            for way in hemisphere(normal, directions, rays):
                for i in range(1, steps + 1):
                    place = here + radius * i / steps * way
                    at = pixel(buffer, place)
                    if at is None:
                        break
                    surface = depth_at(buffer, *at)
                    if surface < -place[2]:
                        hit = point(buffer, *at, z=surface)
                        distance = float(np.linalg.norm(hit - here))
                        if distance <= radius:
                            total += 1.0 - (distance / radius) ** 2
                            break
            expected = total / (directions * rays)
            assert result.occlusion[row, column] == pytest.approx(expected, abs=1e-5)


def hemisphere(normal: np.ndarray, directions: int, rays: int) -> list[np.ndarray]:
    """Middles of equal azimuths and of equal sines, the sines shifted by the golden ratio."""
    sign = 1.0 if normal[2] >= 0.0 else -1.0
    a, b = -1.0 / (sign + normal[2]), 0.0
    b = normal[0] * normal[1] * a
    first = np.array([1.0 + sign * normal[0] ** 2 * a, sign * b, -sign * normal[0]])
    second = np.array([b, sign + normal[1] ** 2 * a, -normal[1]])
    found = []
    for k in range(directions):
        azimuth = 2.0 * math.pi * (k + 0.5) / directions
        for j in range(rays):
            sine = (j + (0.5 + j * 0.5 * (math.sqrt(5.0) - 1.0)) % 1.0) / rays
            cosine = math.sqrt(1.0 - sine * sine)
            across = math.cos(azimuth) * first + math.sin(azimuth) * second
            found.append(cosine * across + sine * normal)
    return found


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_marched_rays_have_the_uniform_closed_form_of_a_wall(projection):
    view = screen_scenes.look(screen_scenes.wall(reach=(0.5, 1.2)), projection, 120)
    options = {"form": "rays", "directions": 16, "rays": 8, "steps": 64}
    found, rows, columns, _ = measured(view, method="hbao", radius=2.0, **options)
    truth = view.truth("uniform", rows, columns, "quadratic", 2.0)
    assert (found - truth).mean() == pytest.approx(0.0, abs=0.01)


def test_pixels_whose_radius_is_below_a_pixel_are_counted_and_open():
    buffer = rough(True)
    result = ambient_occlusion(buffer, method="hbao", radius=0.15)
    footprint = buffer.depth * buffer.camera.rays[0]
    small = footprint > 0.15
    assert 0 < result.report.skipped["small_radius"] == small.sum() < small.size
    assert np.all(result.occlusion[small] == 0.0)
    # No other pixel's centre lies within the radius of theirs, so nothing was left out.
    for row, column in np.argwhere(small):
        here = point(buffer, row, column)
        for i in range(max(0, row - 1), min(buffer.shape[0], row + 2)):
            for j in range(max(0, column - 1), min(buffer.shape[1], column + 2)):
                if (i, j) != (row, column) and not np.isnan(buffer.depth[i, j]):
                    way = point(buffer, i, j) - here
                    assert np.linalg.norm(way) > 0.15 or way[2] <= 0.0


def test_options_that_exclude_each_other_are_refused():
    buffer = rough(True)
    with pytest.raises(InputError, match="spacing: must be None where steps are given"):
        ambient_occlusion(buffer, method="hbao", steps=4, spacing=2.0)
    with pytest.raises(InputError, match="radius: must be finite for the form rays"):
        ambient_occlusion(buffer, method="hbao", form="rays")
    with pytest.raises(InputError, match="quality: must be one of low, medium, high, ultra"):
        ambient_occlusion(buffer, method="hbao", quality="best")
