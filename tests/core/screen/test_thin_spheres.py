"""Thin balls over a floor: slices and far-field scans against rays."""

import numpy as np
import pytest

from adret import Camera, DepthBuffer
from adret.screen import ambient_occlusion
from adret.screen.raytraced import Options, trace_at

BALLS = ((0.9, 0.2, 1.2, 0.5), (-0.8, -0.5, 0.9, 0.4), (0.1, 0.9, 0.6, 0.35))  # x, y, z, radius


def balls_over_a_floor(perspective, rows=72, columns=90):
    """Seen from straight above; given normals."""
    if perspective:
        camera = Camera.perspective(columns, rows, fov_y_deg=50.0)
    else:
        camera = Camera.orthographic(columns, rows, extent=(4.5, 3.6))
    ax, bx, ay, by = camera.rays
    x, y = np.broadcast_arrays(ax * np.arange(columns) + bx, (ay * np.arange(rows) + by)[:, None])
    eye = np.array([0.0, 0.0, 4.0])
    ones = np.ones_like(x)
    if perspective:
        begin = eye[:, None, None] * ones
        way = np.stack([x, y, -ones])
    else:
        begin = np.stack([x, y, eye[2] * ones])
        way = np.stack([0.0 * x, 0.0 * y, -ones])
    depth = eye[2] * ones
    normal = np.stack([0.0 * x, 0.0 * y, ones])
    for *middle, radius in BALLS:
        out = begin - np.array(middle)[:, None, None]
        a, b = (way**2).sum(axis=0), (way * out).sum(axis=0)
        root = b**2 - a * ((out**2).sum(axis=0) - radius**2)
        t = np.where(root > 0.0, (-b - np.sqrt(np.maximum(root, 0.0))) / a, np.inf)
        nearer = t < depth
        depth = np.where(nearer, t, depth)
        with np.errstate(invalid="ignore"):
            normal = np.where(nearer, (out + np.where(nearer, t, 0.0) * way) / radius, normal)
    return DepthBuffer(depth, camera, normals=normal)


@pytest.mark.parametrize("perspective", [True, False])
@pytest.mark.parametrize("thickness", [0.1, 0.3])
def test_under_thin_balls_the_floor_is_as_open_as_rays_find_it(perspective, thickness):
    buffer = balls_over_a_floor(perspective)
    rows, columns = (each.ravel()[::13] for each in np.indices(buffer.shape))
    truth = trace_at(buffer.field, rows, columns, Options(rays=1024, thickness=thickness)).occlusion
    solid = trace_at(buffer.field, rows, columns, Options(rays=1024)).occlusion
    assert truth.mean() < 0.75 * solid.mean()  # light falls in below the balls

    def error(**more):
        result = ambient_occlusion(buffer, thickness=thickness, **more)
        return np.abs(result.occlusion[rows, columns] - truth)

    exact = error(method="exact", directions=32)
    coarse = error(method="exact", directions=8)
    far = error(method="ffao", points="lines", directions=16)
    assert exact.mean() < 0.006
    assert exact.mean() < 0.6 * coarse.mean()
    assert (
        far.mean() < 0.08
    )  # its thickness is that of points: `docs/explanation/far-field-obscurance.md`
