"""Line-Sweep Ambient Obscurance (P3)."""

import math

import numpy as np
import pytest
from screen_buffers import measured, rough

import screen_scenes
from adret import Camera, DepthBuffer, InputError
from adret._kernels.jit import threads
from adret.screen import ambient_occlusion
from adret.screen.line_sweeps import box_directions, lattice
from adret.screen.lsao import Options

PROJECTIONS = ("orthographic", "perspective")
FIXED = -0.85


def occlusion(buffer, **options):
    return ambient_occlusion(buffer, method="lsao", **options).occlusion


# --- Known answers ---------------------------------------------------------------------------


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("tangent", ["fixed", "receiver", "mixed"])
def test_a_plane_is_zero_at_any_tilt(projection, tangent):
    for lean, pitch in ((0.0, 0.0), (0.5, 0.4), (0.8, 0.0)):
        view = screen_scenes.look(screen_scenes.plane(), projection, 40, lean=lean, pitch=pitch)
        for options in (
            {"falloff": "none"},
            {"falloff_scale": 1e9, "directions": 6},
            {"falloff": "none", "directions": 24, "pattern": "box", "step": 3.0},
            {"falloff": "none", "step": 2.83, "line_spacing": 2.12},
        ):
            found, *_ = measured(view, method="lsao", tangent=tangent, **options)
            assert np.abs(found).max() < 2e-5


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("name", ["step", "dihedral", "trench", "well"])
def test_without_falloff_it_is_the_uniform_integral_and_the_error_falls(name, projection):
    errors = []
    for pixels in (120, 360):
        view = screen_scenes.look(screen_scenes.SCENES[name](), projection, pixels)
        found, rows, columns, _ = measured(view, method="lsao", falloff="none", directions=96)
        errors.append(np.abs(found - view.truth("uniform", rows, columns)).mean())
    # A vertical wall is one pixel wide, so its foot is known to half a pixel. The dihedral's
    # faces are seen as they are: what is left is the count of directions.
    assert errors[1] < 0.006
    assert errors[1] < (0.5 * errors[0] if name != "dihedral" else 0.001)


def test_directions_of_a_box_stand_for_unequal_shares_of_the_circle():
    directions = box_directions(16, (1.0, -1.0))
    steps = {(d.row, d.column): d for d in directions}
    assert len(steps) == 16
    assert max(max(abs(r), abs(c)) for r, c in steps) == 2
    oblique = math.degrees(math.atan2(1, 2))
    assert steps[2, 0].share == pytest.approx(oblique / 360.0)
    assert steps[2, 1].share == pytest.approx(45.0 / 2.0 / 360.0)
    assert steps[2, 2].share == pytest.approx((45.0 - oblique) / 360.0)
    assert steps[2, 1].view == pytest.approx((1 / math.sqrt(5), -2 / math.sqrt(5)))
    assert [steps[s].period for s in ((2, 0), (2, 1), (2, 2))] == [1, 2, 1]
    for count, pixel in ((24, (1.0, -1.0)), (24, (1.0, -3.0)), (32, (0.2, -0.1))):
        assert sum(d.share for d in box_directions(count, pixel)) == pytest.approx(1.0)


def test_sparse_lines_are_where_the_paper_has_them():
    """D_S of figure 11, and 2.83 with D_L = 2.12 of figure 1: pixels a sample stands for."""
    for count, step in ((8, 1.41), (16, 2.43), (24, 3.56)):
        directions = box_directions(count, (1.0, -1.0))
        oblique = [d for d in directions if d.row and d.column]
        apart = [
            abs(
                lattice(d, (400, 400), step, 1.0).rows[1]
                - lattice(d, (400, 400), step, 1.0).rows[0]
            )
            * d.stretch
            for d in oblique
        ]
        assert np.mean(apart) == pytest.approx(step, abs=0.01)
    diagonal = next(d for d in box_directions(8, (1.0, -1.0)) if d.row == d.column == 1)
    found = lattice(diagonal, (400, 300), 2.83, 2.12)
    assert np.all(np.diff(found.rows) == 2)
    assert np.all(np.diff(found.starts) == 3)
    assert not found.dense
    assert lattice(diagonal, (400, 300), 1.0, 1.0).dense


def test_a_step_with_falloff_casts_what_its_edge_casts():
    """Seen from straight above: a floor, and the edge of a step, the largest occluder."""
    distance, height, r = 0.5, 0.6, 2.0
    azimuth = np.linspace(-0.5 * math.pi, 0.5 * math.pi, 100_001)
    d2 = (distance / np.cos(azimuth)) ** 2 + height**2
    cast = np.maximum(0.0, FIXED + (height / np.sqrt(d2) - FIXED) * r / (r + d2))
    published = float(np.trapezoid(cast, azimuth)) / (2.0 * math.pi)
    own = float(np.trapezoid(height / np.sqrt(d2) * r / (r + d2), azimuth)) / (2.0 * math.pi)
    found = {"fixed": [], "receiver": []}
    for pixels in (160, 480):
        side = distance / (pixels // 10) * (pixels + 1)  # the edge is at a pixel's centre
        camera = Camera.orthographic(pixels + 1, pixels + 1, extent=(side, side))
        ax, bx, _, _ = camera.rays
        depth = np.where(ax * np.arange(pixels + 1) + bx > 0.999 * distance, 5.0 - height, 5.0)
        normals = np.zeros((3, pixels + 1, pixels + 1))
        normals[2] = 1.0
        buffer = DepthBuffer(
            depth * np.ones((pixels + 1, 1)), camera, normals=normals, guard_band=pixels // 2
        )
        for tangent, values in found.items():
            result = occlusion(buffer, falloff_scale=r, directions=128, tangent=tangent)
            values.append(float(result[0, 0]))
    for tangent, truth in (("fixed", published), ("receiver", own)):
        assert found[tangent][0] == pytest.approx(truth, abs=0.003)
        assert found[tangent][1] == pytest.approx(truth, abs=0.001)
    # The fixed tangent plane weighs what is below the receiver's own by the distance, too.
    assert published < own - 0.05


# --- Slow twin -------------------------------------------------------------------------------


def line_points(depth, camera, row, column, down, slant):
    """Points of the line nearest to a pixel, from the pixel on, backwards (rows lead)."""
    ax, bx, ay, by = camera.rays
    perspective = camera.perspective_divide
    start = column - math.floor(slant * row + 0.5 + 1e-9)
    found = []
    for y in range(row, -1, -1) if down else range(row, len(depth)):
        at = start + slant * y
        pixel = math.floor(at + 0.5 + 1e-9)
        if not 0 <= pixel < depth.shape[1] or np.isnan(depth[y, pixel]):
            continue
        z = depth[y, pixel]
        if abs(at - pixel) > 1e-9:
            side = 1 if at > pixel else -1
            for other in (pixel + side, pixel - side):
                if 0 <= other < depth.shape[1]:
                    far = abs(depth[y, other] - z)
                    if far <= 10.0 * abs(ax) * (z if perspective else 1.0):
                        places = [pixel, other] if other > pixel else [other, pixel]
                        lo, hi = (1 / depth[y, places]) if perspective else depth[y, places]
                        mixed = lo + (hi - lo) * (at - places[0])
                        z = 1 / mixed if perspective else mixed
                        break
        scale = z if perspective else 1.0
        found.append([scale * (ax * at + bx), scale * (ay * y + by), -z])
    return np.array(found)


class Mirrored:
    """A camera whose image is transposed: x and -y change places."""

    def __init__(self, camera):
        ax, bx, ay, by = camera.rays
        self.rays = (-ay, -by, -ax, -bx)
        self.perspective_divide = camera.perspective_divide


def largest_occluders(buffer, receivers, count, weight):
    """Mean over directions of the most that any point of a line casts, by brute force."""
    found = []
    depth, camera = buffer.depth.astype(np.float64), buffer.camera
    perspective = camera.perspective_divide
    ax, bx, ay, by = camera.rays
    for row, column in receivers:
        total = shares = 0.0
        for k in range(count):
            angle = 2.0 * math.pi * k / count
            right, up = math.cos(angle), math.sin(angle)
            dr, dc = up / ay, right / ax
            dr, dc = (0.0 if abs(v) < 1e-9 * (abs(dr) + abs(dc)) else v for v in (dr, dc))
            if abs(dc) > abs(dr) * (1 + 1e-9):
                points = line_points(depth.T, Mirrored(camera), column, row, dc > 0, dr / dc)
                points = points[:, [1, 0, 2]] * [-1.0, -1.0, 1.0]
            else:
                points = line_points(depth, camera, row, column, dr > 0, dc / dr)
            direction = np.array([right, up, 0.0])
            p = points[0]
            share = 1.0
            if perspective:  # how fast the azimuth about the pixel's ray turns with the direction
                eye = -np.array([ax * column + bx, ay * row + by, -1.0])
                eye /= np.linalg.norm(eye)
                across = direction - direction @ eye * eye
                across /= np.linalg.norm(across)
                beside = np.cross(eye, across)
                turned = np.array([-up, right, 0.0]) * 1e-5
                azimuth = [
                    math.atan2((direction + s * turned) @ beside, (direction + s * turned) @ across)
                    for s in (1.0, -1.0)
                ]
                share = (azimuth[0] - azimuth[1]) / 2e-5
            eye = -p / np.linalg.norm(p) if perspective else np.array([0.0, 0.0, 1.0])
            if len(points) > 1:
                o = points[1:] - p
                d = np.sqrt((o**2).sum(axis=1))
                cast = FIXED + np.maximum(0.0, o @ eye / d - FIXED) * weight(d)
                total += share * cast.max()
            else:  # nothing before: the tangent plane, whose direction is across the normal
                normal = buffer.field.normal[:, row, column].astype(np.float64)
                plane = direction * (eye @ normal) - eye * (direction @ normal)
                total -= share * (plane @ eye) / np.linalg.norm(plane)
            shares += share
        found.append(min(1.0, max(0.0, total / shares)))
    return np.array(found)


@pytest.mark.parametrize("perspective", [True, False])
@pytest.mark.parametrize("count", [8, 12])
def test_without_falloff_no_largest_occluder_is_missed(perspective, count):
    buffer = rough(perspective, 31, 37)
    receivers = np.argwhere(np.isfinite(buffer.depth))[::7]
    truth = largest_occluders(buffer, receivers, count, np.ones_like)
    found = occlusion(buffer, falloff="none", directions=count)[*receivers.T]
    assert truth.max() > 0.4
    assert np.abs(found - truth).max() < 1e-6


@pytest.mark.parametrize(
    ("options", "weight"),
    [
        ({"falloff_scale": 0.1}, lambda d: 0.1 / (0.1 + d * d)),
        ({"falloff": "quadratic", "radius": 1.5}, lambda d: np.maximum(0.0, 1 - (d / 1.5) ** 2)),
        ({"falloff": lambda d: np.exp(-d), "radius": 3.0}, lambda d: np.exp(-d) * (d < 3.0)),
    ],
    ids=["timonen", "quadratic", "callable"],
)
def test_with_a_falloff_the_hull_misses_little(options, weight):
    buffer = rough(True, 61, 67)
    receivers = np.argwhere(np.isfinite(buffer.depth))[::17]
    truth = largest_occluders(buffer, receivers, 12, weight)
    found = occlusion(buffer, directions=12, **options)[*receivers.T]
    short = truth - found
    assert truth.mean() > 0.03
    assert short.min() > -2e-6  # never more than the largest
    assert np.median(short) < 1e-6
    assert short.mean() < 0.003


def test_a_falloff_that_ends_abruptly_is_what_the_hull_misses_most():
    """A point popped for a higher one behind it is missing once that one is beyond the radius."""
    buffer = rough(True, 61, 67)
    receivers = np.argwhere(np.isfinite(buffer.depth))[::17]
    truth = largest_occluders(buffer, receivers, 12, lambda d: 1.0 * (d < 1.5))
    short = truth - occlusion(buffer, directions=12, falloff="hard", radius=1.5)[*receivers.T]
    assert truth.mean() > 0.03
    assert short.min() > -2e-6
    assert short.mean() < 0.03


@pytest.mark.parametrize(
    ("options", "weight", "share"),
    [
        ({"falloff_scale": 0.5}, lambda d: 0.5 / (0.5 + d * d), 0.5),
        ({"falloff": "hard", "radius": 1.5}, lambda d: 1.0 * (d < 1.5), 0.5),
        ({"falloff": lambda d: np.exp(-d), "radius": 3.0}, lambda d: np.exp(-d) * (d < 3.0), 0.5),
    ],
    ids=["timonen", "hard", "callable"],
)
def test_high_points_beside_the_hull_miss_less(options, weight, share):
    buffer = rough(True, 61, 67)
    receivers = np.argwhere(np.isfinite(buffer.depth))[::17]
    truth = largest_occluders(buffer, receivers, 12, weight)
    short = truth - occlusion(buffer, directions=12, **options)[*receivers.T]
    beside = truth - occlusion(buffer, directions=12, peaks=True, **options)[*receivers.T]
    assert beside.min() > -2e-6
    assert beside.mean() < share * short.mean()
    assert (beside < short + 1e-6).all()


@pytest.mark.parametrize("perspective", [True, False])
@pytest.mark.parametrize("options", [{}, {"tangent": "receiver"}])
def test_with_high_points_a_hard_radius_misses_nothing_among_the_latest_samples(
    perspective, options
):
    """Lines of 130 samples and fewer: the steepest point within the radius is always looked at."""
    buffer = rough(perspective, 61, 67)
    receivers = np.argwhere(np.isfinite(buffer.depth))[::17]
    for radius in (0.4, 1.5, 6.0):
        found = occlusion(
            buffer, directions=12, falloff="hard", radius=radius, peaks=True, **options
        )[*receivers.T]
        if options:
            # No twin for the receiver's own plane: not less than the hull finds, which is within.
            hull = occlusion(buffer, directions=12, falloff="hard", radius=radius, **options)
            assert (found - hull[*receivers.T]).min() > -1e-6
        else:
            truth = largest_occluders(buffer, receivers, 12, lambda d, r=radius: 1.0 * (d < r))
            assert truth.mean() > 0.0004
            assert np.abs(found - truth).max() < 2e-6


def test_a_post_that_a_wall_covered_casts_where_the_wall_is_beyond_the_radius():
    """On a floor 4 below the eye a wall 1.0 high, then a post of 0.5: both covered, one missed."""
    depth = np.full((9, 400), 4.0)
    depth[:, 30] = 3.0
    depth[:, 40] = 3.5
    buffer = DepthBuffer(depth, Camera.orthographic(400, 9, extent=(4.0, 0.09)))
    options = {"directions": 2, "falloff": "hard", "radius": 1.1}
    # Column 60 sees the wall above the post, column 85 has it beyond the radius; ahead is floor.
    wall, post = 1.0 / math.hypot(1.0, 0.3), 0.5 / math.hypot(0.5, 0.45)
    searched = occlusion(buffer, peaks=True, **options)[4]
    assert searched[[60, 85]] == pytest.approx([0.5 * wall, 0.5 * post], abs=1e-6)
    hull = occlusion(buffer, **options)[4]
    assert hull[[60, 85]] == pytest.approx([0.5 * wall, 0.0], abs=1e-6)


@pytest.mark.parametrize(
    ("name", "corner", "ours", "published"),
    [
        ("sponza_atrium", (300, 300), 0.0005, 0.003),
        ("bust_ground", (300, 500), 0.0003, 0.004),
        ("trees_and_chains", (300, 700), 0.01, 0.04),  # all twigs; 0.005 over the whole frame
    ],
)
def test_on_real_buffers_the_hull_misses_less_than_the_published_one(
    data_dir, name, corner, ours, published
):
    depth = data_dir / "depth"
    [path] = [p for p in depth.glob(f"{name}.*") if p.suffix != ".json"]
    whole = DepthBuffer.open(path, depth / f"{name}.json")
    window = (slice(corner[0], corner[0] + 150), slice(corner[1], corner[1] + 200))
    z = np.where(whole.sky, np.inf, whole.depth)[window]
    ax, bx, ay, by = whole.camera.rays
    camera = Camera.perspective(
        200,
        150,
        fx=1.0 / ax,
        fy=-1.0 / ay,
        cx=0.5 - (bx + ax * corner[1]) / ax,
        cy=0.5 - (by + ay * corner[0]) / ay,
    )
    buffer = DepthBuffer(z, camera)
    r = (20.0 * ax * float(np.nanmedian(buffer.depth))) ** 2  # 1/2 at 20 pixels
    draw = np.random.default_rng(3)
    receivers = draw.permutation(np.argwhere(np.isfinite(buffer.depth)))[:250]
    truth = largest_occluders(buffer, receivers, 8, lambda d: r / (r + d * d))
    found = occlusion(buffer, directions=8, falloff_scale=r)[*receivers.T]
    as_published = occlusion(buffer, directions=8, falloff_scale=r, published=True)[*receivers.T]
    assert np.abs(found - truth).mean() < ours
    # In a small window the planes along the viewing axis hardly differ from those of the eye.
    assert np.abs(found - truth).mean() < 0.5 * np.abs(as_published - truth).mean()
    assert np.abs(as_published - truth).mean() < published


# --- Sparse sweeps ---------------------------------------------------------------------------


def smooth(rows=60, columns=66):
    y, x = np.mgrid[:rows, :columns]
    return 6.0 - 0.9 * np.sin(0.13 * x) * np.cos(0.11 * y)


def test_sparse_sweeps_are_dense_sweeps_of_fewer_pixels():
    side = 0.05
    depth = smooth()
    rows, columns = depth.shape
    camera = Camera.orthographic(columns, rows, extent=(columns * side, rows * side))
    normals = np.zeros((3, rows, columns))
    normals[2] = 1.0
    buffer = DepthBuffer(depth, camera, normals=normals)
    found = occlusion(buffer, directions=2, step=3.0, line_spacing=2.0)
    fewer = Camera.orthographic(columns // 3, rows // 2, extent=(columns * side, rows * side))
    coarse = DepthBuffer(depth[::2, ::3], fewer, normals=normals[:, ::2, ::3])
    # With two directions only the way along rows counts; pixels may be oblong.
    expected = occlusion(coarse, directions=2)
    assert found[::2, ::3] == pytest.approx(expected, abs=1e-6)
    # Elsewhere the nearest sample counts.
    assert np.array_equal(found[:, 1::3], found[:, ::3])
    assert np.array_equal(found[:, 2:-1:3], found[:, 3::3])


def test_sparse_sweeps_do_not_blur_over_depth_edges():
    depth = np.full((60, 70), 4.0)
    depth[20:40, 21:50] = 3.0
    buffer = DepthBuffer(depth, Camera.perspective(70, 60, fov_y_deg=50.0))
    for options in (
        {"directions": 8, "step": 2.83, "line_spacing": 2.12},
        {"directions": 16, "step": 4.87, "line_spacing": 2.46},
        {"directions": 16, "step": 4.87, "line_spacing": 2.46, "pattern": "box"},
    ):
        found = occlusion(buffer, falloff="none", **options)
        assert np.abs(found[20:40, 21:50]).max() < 1e-6
        assert found[20:40, 51:54].min() > 0.05
        assert found[20:40, 17:20].min() > 0.05


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_sparse_sweeps_stay_near_the_dense_ones(projection):
    view = screen_scenes.look(screen_scenes.bowl(), projection, 160)
    dense, *_ = measured(view, method="lsao", falloff="none", directions=16)
    for options in (
        {"step": 2.83, "line_spacing": 2.12},
        {"step": 4.87, "line_spacing": 2.46},
        {"step": 4.87, "line_spacing": 2.46, "pattern": "box"},
    ):
        sparse, *_ = measured(view, method="lsao", falloff="none", directions=16, **options)
        assert np.abs(sparse - dense).mean() < 0.015


# --- Invariants ------------------------------------------------------------------------------


@pytest.mark.parametrize("perspective", [True, False])
@pytest.mark.parametrize("options", [{}, {"step": 2.83, "line_spacing": 2.12, "tangent": "mixed"}])
def test_one_thread_and_two_give_the_same_bytes(perspective, options):
    buffer = rough(perspective, 150, 170)
    before = threads()
    try:
        results = []
        for count in (1, min(2, before)):
            threads(count)
            results.append(ambient_occlusion(buffer, method="lsao", **options))
    finally:
        threads(before)
    assert results[0].occlusion.tobytes() == results[1].occlusion.tobytes()
    assert results[0].confidence.tobytes() == results[1].confidence.tobytes()


def test_a_guard_band_occludes_and_does_not_receive():
    whole = ambient_occlusion(rough(True), method="lsao", step=2.0)
    inner = ambient_occlusion(rough(True, guard_band=(3, 5, 1, 2)), method="lsao", step=2.0)
    assert inner.occlusion.shape == (9, 10)
    assert np.allclose(inner.occlusion, whole.occlusion[3:12, 2:12], atol=1e-7, equal_nan=True)
    assert np.allclose(inner.confidence, whole.confidence[3:12, 2:12], atol=1e-7)


def test_turning_and_mirroring_the_image_turns_and_mirrors_the_result():
    depth = rough(False, 40, 40).depth
    camera = Camera.orthographic(40, 40, extent=(4.0, 4.0))

    def run(z):
        buffer = DepthBuffer(np.where(np.isnan(z), np.inf, z), camera)
        return occlusion(buffer, falloff_scale=0.3, directions=8)

    found = run(depth)
    assert np.abs(run(np.rot90(depth)) - np.rot90(found)).max() < 2e-6
    assert np.abs(run(depth[:, ::-1]) - found[:, ::-1]).max() < 2e-6


def test_scale_does_not_matter():
    buffer = rough(True)
    larger = DepthBuffer(
        np.where(buffer.sky, np.inf, 1000.0 * buffer.depth),
        Camera.perspective(17, 13, fov_y_deg=55),
    )
    one = occlusion(buffer, falloff_scale=0.3)
    other = occlusion(larger, falloff_scale=0.3e6)
    assert np.nanmax(np.abs(one - other)) < 1e-5


def test_confidence_is_what_no_surface_beyond_the_edge_could_change():
    camera = Camera.perspective(61, 61, fov_y_deg=60.0)
    flat = DepthBuffer(np.full((61, 61), 2.0), camera)
    ax = camera.rays[0]
    r = 0.2
    result = ambient_occlusion(
        flat, method="lsao", falloff_scale=r, directions=4, tangent="receiver"
    )
    half = 30.5 * ax * 2.0
    assert result.confidence[30, 30] == pytest.approx(1.0 - r / (r + half**2), abs=1e-5)
    assert result.confidence[30, 5] < result.confidence[30, 30]
    endless = ambient_occlusion(flat, method="lsao", falloff="none")
    assert np.abs(endless.confidence).max() < 1e-6
    near = ambient_occlusion(flat, method="lsao", falloff="hard", radius=0.5 * half)
    assert near.confidence[30, 30] == 1.0


def test_sky_and_holes_neither_receive_nor_occlude():
    result = ambient_occlusion(rough(True), method="lsao")
    assert np.isnan(result.occlusion).sum() == 1
    assert np.isnan(result.occlusion[1, 2])
    assert np.all(result.occlusion[10:, 3:5] == 0.0)
    assert np.all(result.confidence[10:, 3:5] == 0.0)
    near = np.full((20, 20), 5.0)
    near[:, 10:] = np.inf
    alone = occlusion(DepthBuffer(near, Camera.perspective(20, 20, fov_y_deg=60.0)))
    assert np.abs(alone).max() < 1e-6


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (2, 2), (3, 200)])
@pytest.mark.parametrize("options", [{}, {"step": 5.0, "line_spacing": 7.0}])
def test_images_of_any_size_are_open_where_they_are_flat(shape, options):
    for camera in (
        Camera.perspective(shape[1], shape[0], fov_y_deg=50.0),
        Camera.orthographic(shape[1], shape[0], extent=(1.0, 1.0)),
    ):
        flat = DepthBuffer(np.full(shape, 2.0), camera)
        assert np.abs(occlusion(flat, **options)).max() < 1e-6
        sky = DepthBuffer(np.full(shape, np.inf), camera)
        assert (occlusion(sky, **options) == 0.0).all()


def test_tiny_and_huge_radii():
    buffer = rough(True)
    assert np.nanmax(occlusion(buffer, falloff="hard", radius=1e-6)) == 0.0
    assert np.nanmax(occlusion(buffer, falloff_scale=1e-12)) == 0.0
    huge = occlusion(buffer, falloff="quadratic", radius=1e12)
    assert np.nanmax(np.abs(huge - occlusion(buffer, falloff="none"))) < 1e-6
    scaled = occlusion(buffer, falloff_scale=1e30)
    assert np.nanmax(np.abs(scaled - occlusion(buffer, falloff="none"))) < 1e-6


# --- Errors ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"directions": 7}, "directions"),
        ({"directions": 12, "pattern": "box"}, "directions"),
        ({"step": 0.5}, "step"),
        ({"line_spacing": math.inf}, "line_spacing"),
        ({"tangent": "none"}, "tangent"),
        ({"tangent_sine": 0.2}, "tangent_sine"),
        ({"edge": 0.0}, "edge"),
        ({"falloff_scale": 0.0}, "falloff_scale"),
        ({"peaks": True, "tangent": "mixed"}, "peaks"),
    ],
)
def test_wrong_options_are_named(options, field):
    with pytest.raises(InputError) as caught:
        Options(**options)
    assert caught.value.field == field


def test_progress_counts_directions():
    seen = []
    ambient_occlusion(
        rough(True), method="lsao", directions=8, progress=lambda *at: seen.append(at)
    )
    assert seen[-1] == (8, 8)


@pytest.mark.parametrize("options", [{}, {"step": 2.83, "line_spacing": 2.12, "directions": 6}])
def test_passing_over_samples_without_a_surface_changes_no_byte(options, monkeypatch):
    view = rough(True, 24, 300)
    depth = np.array(view.depth)
    depth[:9] = np.inf
    depth[15:, 140:] = np.inf
    depth[20, 30] = np.nan
    buffer = DepthBuffer(depth, Camera.perspective(300, 24, fov_y_deg=20.0))
    quick = ambient_occlusion(buffer, method="lsao", **options)
    monkeypatch.setenv("ADRET_SKIP", "none")
    slow = ambient_occlusion(buffer, method="lsao", **options)
    name = "empty samples"
    # Along the rows' axis a strip is 128 columns: 9 rows of 300, and 9 of the last 44, at least.
    assert quick.report.skipped[name] > (9 * 300 if not options else 500)
    assert slow.report.skipped[name] == 0
    assert quick.occlusion.tobytes() == slow.occlusion.tobytes()
    assert quick.confidence.tobytes() == slow.confidence.tobytes()


def test_samples_without_a_surface_count_among_the_latest(monkeypatch):
    """A post that a wall covers, then a gap: passing over the gap brings the post no nearer."""
    depth = np.full((9, 400), 4.0)
    depth[:, 34], depth[:, 40] = 3.0, 3.5
    depth[:, 60:200] = np.nan
    buffer = DepthBuffer(depth, Camera.orthographic(400, 9, extent=(4.0, 0.09)))
    options = {"directions": 2, "falloff": "hard", "radius": 2.1, "peaks": True}
    quick = ambient_occlusion(buffer, method="lsao", **options)
    monkeypatch.setenv("ADRET_SKIP", "none")
    slow = ambient_occlusion(buffer, method="lsao", **options)
    assert quick.report.skipped["empty samples"] > 0
    assert quick.occlusion.tobytes() == slow.occlusion.tobytes()
