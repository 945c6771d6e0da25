"""Exact slices turned against each other over a square of pixels, and gathered from it."""

import numpy as np
import pytest
from screen_buffers import measured, rough

import screen_scenes
from adret import InputError
from adret.screen import ambient_occlusion


def slices(buffer, **options):
    return ambient_occlusion(buffer, method="exact", **options)


def mean_of_like(buffer, tile, layers):
    """Means over windows, pixel by pixel, of what lies on the same plane, from its definition."""
    ax, bx, ay, by = buffer.camera.rays
    z, normal = buffer.depth.astype(float), buffer.field.normal.astype(float)
    rows, columns = z.shape
    scale = z if buffer.camera.perspective_divide else np.ones_like(z)
    row, column = np.mgrid[:rows, :columns]
    places = np.stack([scale * (ax * column + bx), scale * (ay * row + by), -z])
    half = tile // 2
    found = np.full((len(layers), rows, columns), np.nan)
    for i, j in np.argwhere(np.isfinite(z)):
        total, weights = np.zeros(len(layers)), 0.0
        for r in range(max(0, i - half), min(rows, i + half + 1)):
            for c in range(max(0, j - half), min(columns, j + half + 1)):
                apart = places[:, r, c] - places[:, i, j]
                near = 0.5 * ax * scale[i, j]
                if (
                    normal[:, i, j] @ normal[:, r, c] > 0.98
                    and abs(apart @ normal[:, i, j]) < near
                    and abs(apart @ normal[:, r, c]) < near
                ):
                    share = 0.5 ** sum(2 * abs(step) == tile for step in (r - i, c - j))
                    total += share * layers[:, r, c]
                    weights += share
        found[:, i, j] = total / weights
    return found


@pytest.mark.parametrize("perspective", [True, False])
@pytest.mark.parametrize("tile", [2, 3])
def test_what_is_gathered_is_the_mean_of_like_surface_in_the_square(perspective, tile):
    buffer = rough(perspective, 31, 37)
    alone = slices(buffer, directions=4, tile=tile)
    found = slices(buffer, directions=4, tile=tile, gather=True)
    layers = np.stack([alone.occlusion, alone.confidence, *alone.bent_normal]).astype(float)
    truth = mean_of_like(buffer, tile, layers)
    bent = truth[2:] / np.linalg.norm(truth[2:], axis=0)
    shown = np.isfinite(buffer.depth)
    assert np.abs(found.occlusion - truth[0])[shown].max() < 1e-6
    assert np.abs(found.confidence - truth[1])[shown].max() < 1e-6
    assert np.abs(found.bent_normal - bent)[:, shown].max() < 1e-5
    changed = np.abs(found.occlusion - alone.occlusion)[shown] > 1e-3
    assert 0.1 < changed.mean() < 0.9  # some have neighbours of like surface, some none


@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
def test_a_plane_stays_open(projection):
    for lean, pitch in ((0.0, 0.0), (0.6, 0.7), (1.2, 0.0)):
        view = screen_scenes.look(screen_scenes.plane(), projection, 40, lean=lean, pitch=pitch)
        found, *_ = measured(view, method="exact", directions=4, tile=3, gather=True)
        assert np.abs(found).max() < 2e-6


@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
def test_a_square_of_directions_errs_less_than_its_pixels_alone(projection):
    view = screen_scenes.look(screen_scenes.SCENES["step"](), projection, 120)
    errors = []
    for options in ({}, {"tile": 2, "gather": True}):
        found, rows, columns, _ = measured(view, method="exact", directions=5, **options)
        errors.append(np.abs(found - view.truth("cosine", rows, columns)).mean())
    assert errors[1] < 0.5 * errors[0]


def test_pixels_that_look_alike_are_not_gathered():
    with pytest.raises(InputError, match=r"tile.*2 or more.*1"):
        slices(rough(True), directions=2, gather=True)
