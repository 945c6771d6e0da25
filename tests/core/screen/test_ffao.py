"""Far-field obscurance: stages against slow twins, slabs against quadrature, scenes, symmetries."""

import math

import numpy as np
import pytest

import screen_scenes as scenes
from adret import Camera, DepthBuffer, InputError
from adret._kernels.jit import threads
from adret._kernels.screen import far_field_block as block
from adret._kernels.screen import far_field_lines as scanning
from adret._kernels.screen import far_field_slabs as slabs
from adret.screen import ambient_occlusion, ffao, make_falloff, raytraced
from adret.screen.slabs import slab_weights


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


@pytest.mark.parametrize("phases", [1, 3])
def test_prefix_sums_give_means_over_any_lines(phases):
    draw = np.random.default_rng(1)
    height = draw.random((3, 50)).astype(np.float32)
    height[1, 7] = -np.inf
    height[1, :2] = -np.inf
    place = 20 + draw.integers(0, 10, (3, 50)).astype(np.float32)
    *sums, spans = scanning.empty_sums(3, phases, 50)
    scanning.sum_lines(height, place, np.full(3, 20), 1, *sums, spans)
    heights, places, counts, tops = (
        each.transpose(0, 2, 1).reshape(3, -1)[:, :51] for each in sums
    )
    part = np.isfinite(height[1, 4:30])
    kept = height[1, 4:30][part].astype(float)
    assert counts[1, 30] - counts[1, 4] == part.sum()
    assert heights[1, 30] - heights[1, 4] == pytest.approx(kept.sum(), abs=1e-12)
    assert places[1, 30] - places[1, 4] == (place[1, 4:30][part] - 20).sum()
    assert np.array_equal(tops[1, :50], np.where(np.isfinite(height[1]), height[1], 0.0))
    assert spans.tolist() == [[0, 50, 1], [2, 50, 0], [0, 50, 1]]


def slab_by_quadrature(start, end, way, foot, rise, drop, near, side, normal, weight):
    """Obscurance of the line from a ray's point at row `foot` to another's at row `way`."""
    angles = np.linspace(math.atan2(1.0, end), math.atan2(1.0, start), 20001)
    middle, width = 0.5 * (angles[1:] + angles[:-1]), np.diff(angles)
    ends = []
    for c, row in ((end, way), (start, foot)):
        across = side * row / (near + (c - drop) / rise * row)
        ends.append(np.array([across, c * across]))
    along = ends[1] - ends[0] if ends[1][0] > 0.0 else ends[0] - ends[1]
    cross = ends[0][0] * along[1] - ends[0][1] * along[0]
    distance = cross / (np.sin(middle) * along[1] - np.cos(middle) * along[0])
    seen = np.where(distance > 0.0, weight(np.where(distance > 0.0, distance, 1e30)), 0.0)
    cosine = normal[1] * np.cos(middle) + normal[0] * np.sin(middle)
    return (seen * cosine * np.sin(middle) * width).sum()


@pytest.mark.parametrize(
    ("falloff", "radius", "bound"),
    [
        ("timonen", math.inf, 1e-3),
        ("quadratic", 6.0, 2e-4),
        ("hard", 5.0, 1e-6),
        (lambda d: np.exp(-d / 3.0), math.inf, 1e-3),
    ],
    ids=["timonen", "quadratic", "hard", "callable"],
)
def test_a_slab_is_the_integral_along_its_line(falloff, radius, bound):
    count, near, rise, side = 120, 0.2, 1000.0, 1e-3
    draw = np.random.default_rng(0)
    drop = draw.uniform(-0.3, 0.3, count)
    way = draw.uniform(12.0, 300.0, count)
    tilt = draw.uniform(-0.6, 0.6, count)
    normal = np.sin(tilt), np.cos(tilt)
    start = np.maximum(draw.uniform(-4.0, 1.0, count), -np.tan(tilt) + 1e-3)
    end = start + draw.uniform(0.01, 3.0, count)
    height = near + (end - drop) / rise * way
    w = np.zeros(block.SIZE, dtype=np.float32)
    for at, values in (
        (block.TOP, start),
        (block.SEEN, end),
        (block.PLACE, way),
        (block.HEIGHT, height),
        (block.SHARE, 1.0),
        (block.A, rise),
        (block.B, drop),
        (block.NEAR, near),
        (block.SIDE, side),
        (block.NORMAL_U, normal[0]),
        (block.NORMAL_V, normal[1]),
    ):
        w[at : at + count] = values
    found = make_falloff(falloff, radius, 4.0)
    weights = slab_weights(found, 1e-3, 100.0)
    slabs.add_weighted(w, count, np.float32(10.0), np.float32(0.5), True, weights, True)
    foot = way + 0.5 * (10.0 - way)
    for i in np.flatnonzero(height > 0.01):
        expected = slab_by_quadrature(
            start[i], end[i], way[i], foot[i], rise, drop[i], near, side,
            (normal[0][i], normal[1][i]), found.weight,
        )  # fmt: skip
        assert w[block.CLOSED + i] == pytest.approx(expected, abs=bound)
        assert w[block.TOP + i] == np.float32(end[i])


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


def made_scene():
    depth = hills(96, 128)
    depth[30:60, 40:70] -= 6.0
    depth[10:80, 95:99] -= 9.0
    return DepthBuffer(depth, Camera.perspective(128, 96, fov_y_deg=60.0))


def real_scene(name):
    def third(data_dir):
        """Every third pixel of a real buffer."""
        folder = data_dir / "depth"
        [path] = [each for each in folder.glob(f"{name}.*") if each.suffix != ".json"]
        whole = DepthBuffer.open(path, folder / f"{name}.json")
        depth = np.where(whole.sky, np.inf, whole.depth)[::3, ::3]
        ax, bx, ay, by = whole.camera.rays
        lens = {"fx": 1.0 / (3.0 * ax), "fy": -1.0 / (3.0 * ay)}
        centre = {"cx": 0.5 - bx * lens["fx"], "cy": 0.5 + by * lens["fy"]}
        camera = Camera.perspective(depth.shape[1], depth.shape[0], **lens, **centre)
        return DepthBuffer(depth, camera)

    return third


# Both meet 8 to 12 points a direction. Without falloff the means over squares lose what is thin or
# detached; a falloff that forgets what is far hides that where surfaces are whole.
@pytest.mark.parametrize(
    ("make", "falloff", "ratio"),
    [
        (made_scene, False, 0.5),
        (made_scene, True, 0.5),
        (real_scene("sponza_atrium"), False, 0.5),
        pytest.param(real_scene("sponza_atrium"), True, 0.6, marks=pytest.mark.slow),
        pytest.param(real_scene("living_room_scan"), False, 0.5, marks=pytest.mark.slow),
        pytest.param(real_scene("trees_and_chains"), False, 0.5, marks=pytest.mark.slow),
        pytest.param(real_scene("trees_and_chains"), True, 0.5, marks=pytest.mark.slow),
        pytest.param(real_scene("tokyo_street"), True, 0.5, marks=pytest.mark.slow),
    ],
    ids=[
        "made",
        "made, weighted",
        "atrium",
        "atrium, weighted",
        "room",
        "trees",
        "trees, weighted",
        "street, weighted",
    ],
)
def test_the_mean_error_is_half_of_that_of_mipmaps_and_below_two_percent(
    request, make, falloff, ratio
):
    buffer = make() if make is made_scene else make(request.getfixturevalue("data_dir"))
    shown = np.argwhere(np.isfinite(buffer.depth))
    rows, columns = np.random.default_rng(5).permutation(shown)[:250].T
    options = {}
    if falloff:
        scale = (0.2 * float(np.nanmedian(buffer.depth))) ** 2
        options = {"falloff": "timonen", "falloff_scale": scale}
    truth = raytraced.trace_at(
        buffer.field, rows, columns, raytraced.Options(rays=512, **options)
    ).occlusion
    error = {}
    for points in ("sectors", "mipmaps"):
        found = ambient_occlusion(buffer, method="ffao", points=points, **options).occlusion
        error[points] = np.abs(found[rows, columns] - truth).mean()
    assert error["sectors"] < 0.02
    assert error["sectors"] < ratio * error["mipmaps"]


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


def highest_of(near, line, rows, slope, fall):
    """Nearness and row of an interval's highest point, as seen along a line that falls."""
    best = (-math.inf, 0.0, 0)
    for row in rows:
        column = line + math.floor(row * slope + 0.5)
        if 0 <= column < near.shape[1] and not np.isnan(near[row, column]):
            best = max(best, (near[row, column] - fall * row, near[row, column], -row))
    return best[1], -best[2], best[0] > -math.inf


def thin_obscurance(near, row, column, sign, slope, aim, thickness, interval):
    """Section 11 of P4 in one direction, of a receiver that faces the eye (orthographic).

    Lines run in the middle of the sector's angle, its middle in the image is `aim` columns a row.
    """
    rows = len(near)
    size = round(interval / math.hypot(1.0, slope))
    length = math.hypot(1.0, aim)
    count = -(-rows // size)
    levels = 1 + math.ceil(math.log2(count))
    n = row // size + 2 if sign > 0 else (row + 1) // size - 2
    level, top, closed = 0, 0.0, 0.0
    while 0 <= n < count:
        low = n if sign > 0 else n - 2**level + 1
        span = range(low * size, min(rows, (low + 2**level) * size))
        ahead = 0.5 * (span[0] + span[-1]) - row
        line = math.floor(column - row * slope + ahead * (aim - slope) + 0.5)
        height, at, shown = highest_of(near, line, span, slope, sign * 0.02)
        if shown:
            way = abs(at - row) * length
            peak, foot = ((h - near[row, column]) / way for h in (height, height - thickness))
            if peak > top:
                closed += peak**2 / (1.0 + peak**2)
                closed -= max(foot, top) ** 2 / (1.0 + max(foot, top) ** 2)
                top = peak
        n += sign * 2**level
        if (n if sign > 0 else n + 1) % (2 * 2**level) == 0 and level < levels - 1:
            level += 1
    return closed


def test_finite_thickness_is_that_of_the_peaks_of_intervals_above_the_horizon_so_far():
    depth = 40.0 * np.random.default_rng(4).random((40, 52)) ** 3
    normals = np.zeros((3, 40, 52))
    normals[2] = 1.0
    camera = Camera.orthographic(52, 40, extent=(52.0, 40.0))
    buffer = DepthBuffer(60.0 - depth, camera, normals=normals)
    options = {"points": "lines", "directions": 8, "segments": 1, "near_field": False}
    options |= {"interval": 4, "method": "ffao", "thickness": 3.0}
    found = ambient_occlusion(buffer, **options).occlusion
    near = -buffer.depth.astype(float)
    for row, column in ((3, 5), (20, 26), (21, 30), (38, 50), (11, 40)):
        total = 0.0
        for k in range(8):
            right, down = math.cos(math.pi * (k + 0.5) / 4), -math.sin(math.pi * (k + 0.5) / 4)
            turned = abs(right) > abs(down)
            major, minor = (right, down) if turned else (down, right)
            total += thin_obscurance(
                near.T if turned else near,
                column if turned else row,
                row if turned else column,
                1 if major > 0.0 else -1,
                minor / major,
                math.copysign(0.5, minor / major),
                3.0,
                4,
            )
        assert found[row, column] == pytest.approx(total / 8.0, abs=1e-4)


@pytest.mark.parametrize("options", [{}, {"separation": True, "directions": 9, "radius": 4.0}])
def test_one_thread_and_two_give_the_same_bytes(options):
    buffer = DepthBuffer(hills(), Camera.perspective(64, 48, fov_y_deg=60.0))
    before = threads()
    results = []
    try:
        for count in (1, min(2, before)):
            threads(count)
            results.append(ambient_occlusion(buffer, method="ffao", **options))
    finally:
        threads(before)
    assert results[0].occlusion.tobytes() == results[1].occlusion.tobytes()
    assert results[0].confidence.tobytes() == results[1].confidence.tobytes()


@pytest.mark.parametrize("options", [{}, {"separation": True, "directions": 9}])
def test_passing_over_empty_receivers_changes_no_byte(options, monkeypatch):
    depth = hills(40, 320)
    depth[:12, :260] = np.inf
    depth[:, 300:] = np.inf
    depth[30, 100] = np.nan
    buffer = DepthBuffer(depth, Camera.perspective(320, 40, fov_y_deg=20.0))
    quick = ambient_occlusion(buffer, method="ffao", **options)
    monkeypatch.setenv("ADRET_SKIP", "none")
    slow = ambient_occlusion(buffer, method="ffao", **options)
    name = "directions of empty receivers"
    # Blocks are 240 pixels of a row, or 40 of a column: the first 12 rows, the last 20 columns.
    assert quick.report.skipped[name] > 12 * 240
    assert slow.report.skipped[name] == 0
    assert quick.occlusion.tobytes() == slow.occlusion.tobytes()
    assert quick.confidence.tobytes() == slow.confidence.tobytes()


@pytest.mark.parametrize("options", [{}, {"separation": True, "directions": 9}])
def test_where_a_radius_is_less_than_a_pixel_the_far_field_changes_no_byte(options, monkeypatch):
    depth = hills(40, 320)
    depth[20:, :] *= 5.0
    depth[5::9, ::7] *= 0.9
    buffer = DepthBuffer(depth, Camera.perspective(320, 40, fov_y_deg=20.0), guard_band=3)
    radius = 1.2 * float(np.median(depth[:20])) * buffer.camera.rays[0]
    for falloff in ("quadratic", "hard"):
        monkeypatch.setenv("ADRET_SKIP", "all")
        quick = ambient_occlusion(buffer, method="ffao", radius=radius, falloff=falloff, **options)
        monkeypatch.setenv("ADRET_SKIP", "none")
        slow = ambient_occlusion(buffer, method="ffao", radius=radius, falloff=falloff, **options)
        name = "far fields of small radii"
        assert quick.report.skipped[name] > 1000
        assert slow.report.skipped[name] == 0
        assert quick.occlusion.max() > 0.01  # the near field is looked at
        assert quick.occlusion.tobytes() == slow.occlusion.tobytes()
        assert quick.confidence.tobytes() == slow.confidence.tobytes()


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
