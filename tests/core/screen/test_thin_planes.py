"""Solids of finite thickness: a steep surface is whole, a step is not."""

import math

import numpy as np
import pytest
from screen_buffers import camera_of

import screen_scenes
from adret import Camera, DepthBuffer
from adret.screen import ambient_occlusion
from adret.screen.raytraced import Options, trace_at
from adret.screen.steepness import steepness

TILTS = ((0.0, 0.0), (0.5, 0.4), (1.1, 0.0), (1.2, -0.2), (1.35, 0.1))
THIN = 1e-4


@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
def test_a_thin_plane_is_open_at_any_tilt(projection):
    """Neighbouring pixels of the steepest one are apart by hundreds of its thickness."""
    for lean, pitch in TILTS:
        view = screen_scenes.look(screen_scenes.plane(), projection, 24, lean=lean, pitch=pitch)
        buffer = DepthBuffer(view.depth, camera_of(view), normals=view.normals)
        for directions in (3, 16):
            options = {"directions": directions, "thickness": THIN}
            found = ambient_occlusion(buffer, method="exact", **options).occlusion
            assert found.max() <= 1e-6, (lean, pitch, directions)
        rows, columns = (each[::3] for each in np.nonzero(np.isfinite(view.depth)))
        rays = trace_at(buffer.field, rows, columns, Options(rays=128, thickness=THIN))
        assert rays.occlusion.max() == 0.0, (lean, pitch)


def test_steepness_is_that_of_the_surface_and_not_of_its_steps():
    z = np.arange(6.0)[:, None] * 0.25 + np.arange(7.0) * 0.5 + 3.0
    z[:, 4:] += 10.0
    found = steepness(z.astype(np.float32), False)
    assert found == pytest.approx(0.75)
    z[2:] -= 8.0  # down, where the surface goes up
    expected = np.full((6, 7), 0.75)
    expected[:3] = 0.5
    assert steepness(z.astype(np.float32), False) == pytest.approx(expected)
    # 1/z is linear over the image of a plane, and changes of z grow away from the eye.
    plane = (1.0 / (1.0 - 0.1 * np.arange(9.0)))[None].astype(np.float32)
    steps = np.diff(plane[0])
    assert steepness(plane, True)[0] == pytest.approx([steps[0], *steps[:-1], steps[-1]], rel=1e-4)


@pytest.mark.parametrize("steep", [0.0, 1.0])
def test_light_passes_behind_what_stands_before_a_steep_floor(steep):
    """A post of one pixel's thickness stays apart from a floor that deepens by more a pixel."""
    side = 25
    depth = np.full((side, side), 20.0) + steep * np.arange(side)
    post = np.s_[:, 12:14]
    depth[post] = 5.0
    buffer = DepthBuffer(depth, Camera.orthographic(side, side, extent=(float(side),) * 2))
    rows, columns = np.full(2, 12), np.array([9, 16])
    thin = trace_at(buffer.field, rows, columns, Options(rays=2048, thickness=0.5)).occlusion
    whole = trace_at(buffer.field, rows, columns, Options(rays=2048)).occlusion
    assert np.all(thin < 0.15)
    assert np.all(thin < 0.5 * whole)
    found = ambient_occlusion(buffer, method="exact", directions=128, thickness=0.5).occlusion
    assert found[rows, columns] == pytest.approx(thin, abs=0.01)
    assert math.isfinite(float(found.sum()))
