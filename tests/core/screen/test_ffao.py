"""Far-field obscurance: stages against slow twins, slabs against quadrature, scenes, symmetries."""

import math

import numpy as np
import pytest

import screen_scenes as scenes
from adret import Camera, DepthBuffer, InputError
from adret._kernels.screen import far_field_lines as scanning
from adret.screen import ambient_occlusion, ffao, make_falloff, raytraced
from adret.screen.slabs import slab_table


def buffer_of(view):
    make = Camera.perspective if view.perspective else Camera.orthographic
    return DepthBuffer(view.depth, make(view.width, view.height, **view.lens), normals=view.normals)


def hills(rows=48, columns=64, seed=3):
    draw = np.random.default_rng(seed)
    y, x = np.mgrid[0:rows, 0:columns]
    waves = sum(np.sin(a * x + b * y + c) for a, b, c in draw.uniform(-0.4, 0.4, (6, 3)))
    return 20.0 + waves


def test_peaks_and_pyramid_are_those_of_a_walk_along_each_line():
    near = (1.0 / hills()).astype(np.float32)
    near[5:9, 20:30] = np.nan
    slope, first, size = 0.37, -20, 6
    height, place = np.empty((2, 12, 90), dtype=np.float32)
    scanning.scan(near, slope, first, size, 0.0, 0.0, False, height[:8], place[:8])
    scanning.merge(height, place, 0, 8, 8, 0.0, False)
    for n in range(12):
        low, high = (n * size, n * size + size) if n < 8 else ((n - 8) * 12, (n - 8) * 12 + 12)
        for line in range(90):
            best, row = -np.inf, -np.inf
            for r in range(low, min(high, 48)):
                column = line + first + math.floor(r * slope + 0.5)
                if 0 <= column < 64 and near[r, column] > best:
                    best, row = near[r, column], r
            assert height[n, line] == np.float32(best)
            assert place[n, line] == row


def test_prefix_sums_give_means_over_any_lines():
    draw = np.random.default_rng(1)
    height = draw.random((3, 50)).astype(np.float32)
    height[:, 7] = -np.inf
    sums = [np.empty((3, 51)) for _ in range(3)]
    scanning.sum_lines(height, 2.0 * height, *sums)
    part = height[1, 4:30].astype(float)
    part = part[np.isfinite(part)]
    heights, places, counts = (each[1, 30] - each[1, 4] for each in sums)
    assert counts == len(part)
    assert heights / counts == pytest.approx(part.mean(), abs=1e-12)
    assert places / counts == pytest.approx(2.0 * part.mean(), abs=1e-12)


@pytest.mark.parametrize(
    "falloff", ["quadratic", "timonen", lambda d: np.exp(-d)], ids=["quadratic", "timonen", "exp"]
)
def test_table_of_slabs_is_the_integral_along_a_line(falloff):
    found = make_falloff(falloff, 3.0)
    table = slab_table(found, 1e-3, 3.0)
    values = table.values.reshape(-1, table.nodes, 4)
    rows = table.base + np.arange(len(values)) / table.scale
    distance = np.sqrt(rows.astype(np.int32).view(np.float32).astype(float))
    for row, node in ((5, 20), (40, 33), (len(values) - 12, 50)):
        v = 1.0 - 2.0 * node / (table.nodes - 1)
        end = math.atan2(1.0 - abs(v), v)
        psi = (np.arange(20000) + 0.5) / 20000 * end
        weight = found.weight(distance[row] / np.sin(psi)) * end / 20000
        expected = [(weight * f).sum() for f in (1.0, np.cos(2.0 * psi), np.sin(2.0 * psi))]
        assert values[row, node, :3] == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
def test_a_plane_is_open_at_any_tilt(projection):
    for lean, pitch in ((0.0, 0.0), (0.5, 0.0), (0.3, 0.6)):
        buffer = buffer_of(scenes.look(scenes.plane(), projection, 96, lean=lean, pitch=pitch))
        for options in ({}, {"falloff": "quadratic", "radius": 5.0}, {"points": "lines"}):
            found = ambient_occlusion(buffer, method="ffao", **options).occlusion
            assert found.mean() < 1e-4
            assert found.max() < 1e-3


# The far field knows one peak of each interval: its error depends on interval over distance, not on
# the resolution. With intervals as long as the image all is near field.
@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
@pytest.mark.parametrize(
    ("make", "options", "size", "far", "near"),
    [
        (scenes.step, {}, math.inf, 0.015, 0.015),
        (scenes.trench, {}, math.inf, 0.025, 0.024),
        (scenes.groove, {}, math.inf, 0.01, 0.012),
        (scenes.dihedral, {}, math.inf, 0.01, 0.012),
        (scenes.corner, {}, math.inf, 0.025, 0.025),
        (scenes.high_wall, {"falloff": "timonen", "falloff_scale": 4.0}, 4.0, 0.02, 0.02),
        (scenes.wall, {"falloff": "quadratic", "radius": 2.0}, 2.0, 0.035, 0.03),
    ],
    ids=["step", "trench", "groove", "dihedral", "corner", "high wall", "wall"],
)
def test_scenes_with_closed_forms(projection, make, options, size, far, near):
    view = scenes.look(make(), projection, 96)
    rows, columns = view.receivers(300)
    truth = view.truth("cosine", rows, columns, options.get("falloff", "none"), size)
    for interval, bound in ((10, far), (64, near)):
        estimate = ambient_occlusion(
            buffer_of(view), method="ffao", interval=interval, **options
        ).occlusion
        assert np.abs(estimate[rows, columns] - truth).mean() < bound


def test_the_mean_error_is_half_of_that_of_mipmaps_and_below_two_percent():
    depth = hills(96, 128)
    depth[30:60, 40:70] -= 6.0
    depth[10:80, 95:99] -= 9.0
    camera = Camera.perspective(128, 96, fov_y_deg=60.0)
    buffer = DepthBuffer(depth, camera)
    rows, columns = (each.ravel() for each in np.mgrid[2:96:7, 2:128:7])
    options = {"falloff": "timonen", "falloff_scale": 16.0}
    truth = raytraced.trace_at(
        buffer.field, rows, columns, raytraced.Options(rays=512, **options)
    ).occlusion
    error = {}
    for points in ("sectors", "mipmaps"):
        found = ambient_occlusion(buffer, method="ffao", points=points, **options).occlusion
        error[points] = np.abs(found[rows, columns] - truth).mean()
    assert error["sectors"] < 0.02
    assert error["sectors"] < error["mipmaps"]


def test_occlusion_and_confidence_are_shares_and_missing_pixels_keep_theirs():
    depth = hills()
    depth[:10] = np.inf
    depth[20, 20] = np.nan
    buffer = DepthBuffer(depth, Camera.perspective(64, 48, fov_y_deg=60.0), guard_band=2)
    result = ambient_occlusion(buffer, method="ffao", radius=3.0, falloff="hard")
    assert result.occlusion.shape == (44, 60)
    assert np.isnan(result.occlusion[18, 18])
    assert (result.occlusion[:8] == 0.0).all()
    assert np.isfinite(np.delete(result.occlusion.ravel(), 18 * 60 + 18)).all()
    assert result.confidence.min() >= 0.0
    assert result.confidence.max() <= 1.0


def test_separation_gathers_all_directions():
    buffer = DepthBuffer(hills(), Camera.orthographic(64, 48, extent=(64.0, 48.0)))
    whole = ambient_occlusion(buffer, method="ffao", directions=18).occlusion
    apart = ambient_occlusion(buffer, method="ffao", directions=18, separation=True).occlusion
    assert np.abs(whole - apart).mean() < 0.01


def test_thin_solids_occlude_less_and_endless_thickness_is_the_limit():
    buffer = DepthBuffer(hills(), Camera.orthographic(64, 48, extent=(64.0, 48.0)))

    def mean(**options):
        return ambient_occlusion(buffer, method="ffao", points="lines", **options).occlusion.mean()

    assert mean(thickness=0.2) < mean(thickness=1.0) < mean()
    assert mean(thickness=1e6) == pytest.approx(mean(), abs=6e-3)


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1)])
def test_tiny_images_are_open(shape):
    camera = Camera.orthographic(shape[1], shape[0], extent=(1.0, 1.0))
    buffer = DepthBuffer(np.ones(shape), camera)
    assert (ambient_occlusion(buffer, method="ffao").occlusion == 0.0).all()
    sky = DepthBuffer(np.full(shape, np.inf), camera)
    assert (ambient_occlusion(sky, method="ffao", radius=1.0).occlusion == 0.0).all()


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"thickness": 1.0}, "thickness"),
        ({"jitter": True}, "jitter"),
        ({"separation": True}, "directions"),
        ({"directions": 4}, "directions"),
    ],
)
def test_options_that_do_not_go_together_are_named(options, field):
    with pytest.raises(InputError) as caught:
        ffao.Options(**options)
    assert caught.value.field == field
