"""Normals rebuilt from depth."""

import numpy as np
import pytest
from screen_buffers import camera_of

import screen_scenes
from adret import Camera, DepthBuffer
from adret.screen import view_normals

PROJECTIONS = ("orthographic", "perspective")


def slow_normal(buffer, row, column):
    """Loops over one pixel's axes: the straighter side, from points in view space."""
    z = buffer.depth.astype(np.float64)
    w = 1.0 / z if buffer.camera.perspective_divide else z
    rows, columns = z.shape

    def at(r, c):
        return w[r, c] if 0 <= r < rows and 0 <= c < columns else np.nan

    ends = []
    for dr, dc in ((0, 1), (1, 0)):
        sides = []
        for sign in (-1, 1):
            one = at(row + sign * dr, column + sign * dc)
            two = at(row + 2 * sign * dr, column + 2 * sign * dc)
            if np.isfinite(one):
                bend = abs(two - 2 * one + w[row, column])
                sides.append(
                    (bend if np.isfinite(bend) else np.inf, abs(one - w[row, column]), sign)
                )
        if not sides:
            ends.append(None)
            continue
        known = [s for s in sides if np.isfinite(s[0])]
        sign = min(known)[2] if known else min(s[1:] for s in sides)[1]
        ends.append((row + sign * dr, column + sign * dc, sign))
    here = buffer.camera.position(row, column, z[row, column])
    tangents = [
        np.eye(3)[k] * (-1) ** k
        if end is None
        else (buffer.camera.position(end[0], end[1], z[end[:2]]) - here) * end[2]
        for k, end in enumerate(ends)
    ]
    normal = np.cross(tangents[1], tangents[0])
    normal /= np.linalg.norm(normal)
    return normal if normal @ -here > 0 or not buffer.camera.perspective_divide else -normal


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_a_plane_has_its_normal_at_any_tilt_up_to_the_border(projection):
    for lean, pitch in ((0.0, 0.0), (0.9, -0.4), (-0.3, 1.1)):
        view = screen_scenes.look(
            screen_scenes.plane(), projection, 40, lean=lean, pitch=pitch, distance=4.0
        )
        found = view_normals(DepthBuffer(view.depth, camera_of(view)))
        assert np.abs(found - view.normals).max() < 2e-3  # what float32 depths leave
        assert np.abs(found - view.normals).mean() < 2e-4


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_at_a_step_each_side_keeps_its_own_normal(projection):
    view = screen_scenes.look(screen_scenes.trench(), projection, 60)
    found = view_normals(DepthBuffer(view.depth, camera_of(view)))
    wrong = np.abs(found - view.normals).max(axis=0) > 0.02
    # Only pixels with a step on both sides (a wall seen on one pixel) cannot know.
    assert wrong.mean() < 0.04
    floor = np.abs(view.points[2]) < 1e-9
    assert not wrong[floor].any()


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_normals_of_a_sphere_come_nearer_as_pixels_shrink(projection):
    errors = []
    for pixels in (60, 120):
        view = screen_scenes.look(screen_scenes.bowl(), projection, pixels)
        found = view_normals(DepthBuffer(view.depth, camera_of(view)))
        errors.append(np.abs(found - view.normals).max(axis=0)[view.usable].mean())
    assert errors[1] < 0.6 * errors[0]
    assert errors[1] < 0.03


@pytest.mark.parametrize("perspective", [True, False])
def test_they_equal_a_slow_search_for_the_straighter_side(perspective):
    rng = np.random.default_rng(5)
    if perspective:
        camera = Camera.perspective(9, 8, fx=7.0, fy=11.0)
    else:
        camera = Camera.orthographic(9, 8, extent=(9.0, 4.0))
    depth = rng.uniform(3.0, 6.0, (8, 9))
    depth[rng.random((8, 9)) < 0.25] = np.nan
    buffer = DepthBuffer(depth, camera)
    normal = buffer.field.normal
    for row, column in np.argwhere(~np.isnan(depth)):
        if perspective and (
            np.isnan(depth[row, [max(column - 1, 0), min(column + 1, 8)]]).all()
            or np.isnan(depth[[max(row - 1, 0), min(row + 1, 7)], column]).all()
        ):
            continue  # no neighbour on an axis: tested below
        expected = slow_normal(buffer, row, column)
        assert normal[:, row, column] == pytest.approx(expected, abs=1e-5), (row, column)
    assert np.isnan(normal[:, np.isnan(depth)]).all()


def test_a_pixel_without_neighbours_faces_the_eye_and_is_counted():
    camera = Camera.perspective(5, 5, fov_y_deg=50.0)
    depth = np.full((5, 5), np.nan)
    depth[1, 3] = 2.0
    depth[4, 0] = 2.0
    depth[4, 1] = 2.5
    buffer = DepthBuffer(depth, camera)
    assert buffer.normal_counts["degenerate"] == 3
    towards = -camera.position(1, 3, 1.0)
    # 1/z flat on both axes: the plane across the viewing axis.
    assert buffer.field.normal[:, 1, 3] == pytest.approx([0.0, 0.0, 1.0])
    assert buffer.field.normal[:, 1, 3] @ towards > 0


def test_all_face_the_eye():
    rng = np.random.default_rng(6)
    camera = Camera.perspective(40, 30, fov_y_deg=100.0)
    buffer = DepthBuffer(rng.uniform(0.5, 5.0, (30, 40)), camera)
    to_eye = -camera.position(*np.mgrid[0:30, 0:40], buffer.depth)
    assert ((buffer.field.normal * to_eye).sum(axis=0) > 0.0).all()
    assert np.allclose((buffer.field.normal**2).sum(axis=0), 1.0, atol=1e-6)
