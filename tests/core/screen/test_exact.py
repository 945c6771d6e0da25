"""Exact slices: planes, closed forms, a slow twin by 2D ray casting, the ray tracer, symmetries."""

import itertools
import math

import numpy as np
import pytest
from screen_buffers import camera_of, framed, measured, rough

import screen_scenes
from adret import Camera, Cancelled, DepthBuffer, InputError
from adret._kernels.jit import threads
from adret.screen import ambient_occlusion
from adret.screen.raytraced import Options as RayOptions
from adret.screen.raytraced import trace_at

PROJECTIONS = ("orthographic", "perspective")
CASES = [
    (name, weight, falloff)
    for name, make in screen_scenes.SCENES.items()
    for weight, falloff in make().forms
    if name != "plane" and weight in ("cosine", "uniform")
]
EVERY_SAMPLE = {"near": 4096, "growth": 0.0}


def occlusion(buffer, **options):
    return ambient_occlusion(buffer, method="exact", **options).occlusion


# --- known answers ---------------------------------------------------------------------------


TILTS = ((0.0, 0.0), (0.4, 0.1), (-0.9, 0.5), (1.2, -0.3), (1.35, 0.2), (0.0, 1.4))
REACHES = (
    {},
    {"radius": 1.0},
    {"radius": 0.05},
    {"radius": 1.0, "falloff": "quadratic"},
    {"falloff": "timonen", "falloff_scale": 0.3},
)


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("weight", ["cosine", "uniform"])
def test_a_plane_is_open_at_any_tilt_with_any_number_of_directions(projection, weight):
    for lean, pitch in TILTS:
        view = screen_scenes.look(screen_scenes.plane(), projection, 32, lean=lean, pitch=pitch)
        buffer = DepthBuffer(view.depth, camera_of(view), normals=view.normals)
        for directions, reach in itertools.product((1, 2, 3, 7, 32), REACHES):
            # A thickness that no two neighbouring pixels of the steepest plane are apart by.
            for thickness in (math.inf, 500.0):
                options = {"directions": directions, "thickness": thickness, **reach}
                found = occlusion(buffer, weight=weight, **options)
                assert found.max() <= 1e-6, (lean, pitch, options)


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_a_plane_is_open_by_its_own_rebuilt_normals(projection):
    for lean, pitch in TILTS:
        view = screen_scenes.look(screen_scenes.plane(), projection, 32, lean=lean, pitch=pitch)
        buffer = DepthBuffer(view.depth, camera_of(view))
        for directions in (1, 3, 32):
            found = occlusion(buffer, directions=directions, weight="cosine")
            # Normals from differences of float32 depths are off by some 1e-5 radians, which one
            # direction alone, up a steep plane, may take for a share of its narrow sector.
            assert found.max() <= (1e-6 if directions == 32 else 5e-5), (lean, pitch, directions)


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_a_plane_of_any_tilt_bends_no_normal(projection):
    view = screen_scenes.look(screen_scenes.plane(), projection, 24, lean=0.9, pitch=0.5)
    buffer = DepthBuffer(view.depth, camera_of(view), normals=view.normals)
    for directions in (1, 3, 8):
        bent = ambient_occlusion(buffer, method="exact", directions=directions).bent_normal
        assert np.abs(bent - view.normals).max() < 1e-5


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize(("name", "weight", "falloff"), CASES)
def test_closed_forms_come_nearer_as_pixels_shrink(name, weight, falloff, projection):
    scene = screen_scenes.SCENES[name]()
    options = {"weight": weight, "thickness": scene.thickness, "directions": 64}
    size = math.inf
    if falloff == "timonen":
        options |= {"falloff": falloff, "falloff_scale": (size := 4.0)}
    elif falloff != "none":
        options |= {"falloff": falloff, "radius": (size := 2.0)}
    errors = []
    for pixels in (100, 200):
        view = screen_scenes.look(scene, projection, pixels)
        found, rows, columns, _ = measured(view, method="exact", **options)
        errors.append(float(np.mean(found - view.truth(weight, rows, columns, falloff, size))))
    assert abs(errors[1]) < 0.009
    assert abs(errors[1]) < max(0.8 * abs(errors[0]), 0.002)


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_the_bent_normal_of_a_dihedral_halves_the_opening(projection):
    scene = screen_scenes.dihedral(math.radians(120.0), 40.0)
    view = screen_scenes.look(scene, projection, 160)
    buffer, rows, columns = framed(view)
    result = ambient_occlusion(buffer, method="exact", directions=64)
    # Open are 120 degrees from the floor on; their cosine-weighted mean lies in the plane across
    # the edge, by symmetry, at the angle e from the floor.
    angle = np.linspace(0.0, math.radians(120.0), 200_001)
    weight = np.sin(angle)
    e = math.atan2((weight * np.sin(angle)).sum(), (weight * np.cos(angle)).sum())
    bent = result.bent_normal[:, rows - rows.min(), columns - columns.min()]
    normal = view.normals[:, rows, columns]
    leaning = np.degrees(np.arccos(np.clip((bent * normal).sum(axis=0), -1.0, 1.0)))
    # A degree and a half is lost where the image ends.
    assert np.median(leaning) == pytest.approx(abs(90.0 - math.degrees(e)), abs=1.6)


# --- a slow twin: rays against a polyline in each slice ----------------------------------------


def nearness_at(buffer, row, column):
    """Linear between two pixels of a grid line; that of the nearer one beside NaN."""
    i, j = math.floor(row + 1e-9), math.floor(column + 1e-9)
    share = max(row - i, column - j)
    if share < 1e-9:
        share, other = 0.0, (i, j)
    else:
        other = (i + 1, j) if row - i > column - j else (i, j + 1)
    depths = [float(buffer.depth[place]) for place in ((i, j), other)]
    depths = [z if math.isfinite(z) else math.nan for z in depths]
    values = [1.0 / z if buffer.camera.perspective_divide else -z for z in depths]
    if math.isnan(values[0] + values[1]):
        return values[share > 0.5]
    return (1.0 - share) * values[0] + share * values[1]


def place(buffer, row, column, nearness):
    depth = 1.0 / nearness if buffer.camera.perspective_divide else -nearness
    return np.asarray(buffer.camera.position(row, column, depth))


def axes(buffer, row, column, dc, dr, point):
    """Unit vectors of a slice: across the view ray, and towards the eye."""
    v = -point / np.linalg.norm(point) if buffer.camera.perspective_divide else np.array([0, 0, 1])
    ax, _, ay, _ = buffer.camera.rays
    e = np.array([ax * dc, ay * dr, 0.0])
    u = e - (e @ v) * v
    return u / np.linalg.norm(u), v


def crossings(row, column, dc, dr, rows, columns):
    """Where a line crosses the pixel grid, until it leaves the image; and where it leaves."""
    ways = set()
    if abs(dc) > 1e-9:
        ways |= {j / abs(dc) for j in range(1, columns)}
    if abs(dr) > 1e-9:
        ways |= {j / abs(dr) for j in range(1, rows)}
    edge = min(
        (columns - 1 - column if dc > 0 else column) / abs(dc) if abs(dc) > 1e-9 else math.inf,
        (rows - 1 - row if dr > 0 else row) / abs(dr) if abs(dr) > 1e-9 else math.inf,
    )
    inside = sorted(s for s in ways if s <= edge + 1e-9)
    kept = [s for k, s in enumerate(inside) if k == 0 or s - inside[k - 1] > 1e-9]
    return kept, edge


def first_distances(theta, points, walls, start):
    """Distance along each ray of angle theta to the first segment that it meets; inf for none."""
    ray = np.stack([np.sin(theta), np.cos(theta)])
    nearest = np.where(theta > start, 0.0, np.inf)
    segments = [(a, b) for a, b in itertools.pairwise(points)] + walls
    for a, b in segments:
        if not (np.isfinite(a).all() and np.isfinite(b).all()):
            continue
        d = b - a
        det = ray[0] * d[1] - ray[1] * d[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (a[0] * d[1] - a[1] * d[0]) / det
            k = (a[0] * ray[1] - a[1] * ray[0]) / det
        hit = (t > 1e-12) & (k >= -1e-9) & (k <= 1.0 + 1e-9)
        nearest = np.where(hit & (t < nearest), t, nearest)
    return nearest


def twin(buffer, row, column, directions, weight, falloff, radius, rays=6000):
    """Occlusion, confidence and bent normal of a pixel, by casting rays in 2D."""
    rows, columns = buffer.shape
    q0 = nearness_at(buffer, row, column)
    point = place(buffer, row, column, q0)
    normal = buffer.field.normal[:, row, column].astype(np.float64)
    closed = unknown = whole = 0.0
    bent = np.zeros(3)
    for k in range(directions):
        turns = []
        angle = 2.0 * math.pi * (k + 0.5) / directions
        for a in (angle, angle + 1e-5):
            u, v = axes(buffer, row, column, math.cos(a), math.sin(a), point)
            turns.append(u)
        turn = np.linalg.norm(turns[1] - turns[0]) / 1e-5
        dc, dr = math.cos(angle), math.sin(angle)
        u, v = axes(buffer, row, column, dc, dr, point)
        ways, edge = crossings(row, column, dc, dr, rows, columns)
        flat = [np.zeros(2)]
        walls = []
        start = math.inf
        for s in ways:
            r, c = row + s * dr, column + s * dc
            r = round(r) if abs(r - round(r)) < 1e-9 else r
            c = round(c) if abs(c - round(c)) < 1e-9 else c
            q = nearness_at(buffer, r, c)
            x = place(buffer, r, c, q) - point
            flat.append(np.array([x @ u, x @ v]))
            if np.isnan(flat[-2]).any() and not np.isnan(q):
                away = place(buffer, r, c, q / 50 if point[2] and q > 0 else q - 50.0) - point
                walls.append((flat[-1], np.array([away @ u, away @ v])))
        if ways:
            beside = nearness_at(buffer, row, column + np.sign(dc)) - q0
            below = nearness_at(buffer, row + np.sign(dr), column) - q0
            tiny = 1e-6
            x = place(
                buffer,
                row + tiny * dr,
                column + tiny * dc,
                q0 + tiny * (abs(dc) * beside + abs(dr) * below),
            )
            angles = [math.atan2(y @ u, y @ v) for y in [x - point] if np.isfinite(y).all()]
            angles += [math.atan2(*flat[1])] if np.isfinite(flat[1]).all() else []
            start = min(angles, default=math.inf)
        limit = math.atan2(1.0, -(normal @ u) / (normal @ v))
        theta = (np.arange(rays) + 0.5) / rays * limit
        share = np.sin(theta) * limit / rays
        if weight == "cosine":
            share *= np.sin(theta) * (normal @ u) + np.cos(theta) * (normal @ v)
        d = first_distances(theta, flat, walls, start)
        w = np.where(d < radius, falloff(np.minimum(d, 1e9)), 0.0)
        # The border's view ray, from where an open ray is lost unless the radius came first.
        r, c = row + edge * dr, column + edge * dc
        far = [place(buffer, r, c, q0 * f if q0 > 0 else q0 + f) - point for f in (0.5, 1.0)]
        a, b = (np.array([y @ u, y @ v]) for y in far)
        a, b = (a - 1e6 * (b - a), b + (1e6 if q0 < 0 else 0.0) * (b - a))
        if q0 > 0:  # from the eye to far behind
            b = np.array([0.0, np.linalg.norm(point)])
        border = first_distances(theta, [a, b], [], math.inf) if edge > 0 else 0.0 * theta
        closed += turn * (w * share).sum()
        whole += turn * share.sum()
        unknown += turn * (share * ((d == np.inf) & (border < radius))).sum()
        ray = np.outer(u, np.sin(theta)) + np.outer(v, np.cos(theta))
        bent += turn * (ray * w * share).sum(axis=1)
    mean = 2.0 / 3.0 if weight == "cosine" else 0.5
    open_mean = mean * whole * normal - bent
    return closed / whole, 1.0 - unknown / whole, open_mean / np.linalg.norm(open_mean)


FALLOFFS = [
    ({}, lambda d: np.ones_like(d), math.inf),
    ({"radius": 0.9}, lambda d: np.ones_like(d), 0.9),
    ({"radius": 1.2, "falloff": "quadratic"}, lambda d: 1.0 - (d / 1.2) ** 2, 1.2),
    (
        {"falloff": "timonen", "falloff_scale": 0.3},
        lambda d: 0.3 / (0.3 + d**2),
        math.inf,
    ),
    ({"radius": 2.0, "falloff": lambda d: np.exp(-d)}, lambda d: np.exp(-d), 2.0),
]


@pytest.mark.parametrize("perspective", [True, False])
@pytest.mark.parametrize("weight", ["cosine", "uniform"])
def test_it_equals_rays_in_the_same_slices(perspective, weight):
    buffer = rough(perspective)
    pixels = [(5, 3), (2, 2), (9, 10), (12, 16), (7, 12), (0, 0), (6, 8)]
    for options, falloff, radius in FALLOFFS:
        options = {"weight": weight, "directions": 6, **EVERY_SAMPLE, **options}
        quick = ambient_occlusion(buffer, method="exact", **options)
        exact = ambient_occlusion(buffer, method="exact", tolerance=0.0, **options)
        errors = []
        for row, column in pixels:
            a, known, bent = twin(buffer, row, column, 6, weight, falloff, radius)
            where = (row, column, options)
            assert exact.occlusion[row, column] == pytest.approx(a, abs=1.2e-3), where
            assert np.abs(exact.bent_normal[:, row, column] - bent).max() < 3e-3, where
            for found in (quick, exact):
                assert found.confidence[row, column] == pytest.approx(known, abs=1e-3), where
            errors.append(abs(quick.occlusion[row, column] - a))
        # A radius of five pixels: intervals are as coarse as they come.
        assert max(errors) < 5e-3
        assert np.mean(errors) < 2e-3


# --- the ray tracer --------------------------------------------------------------------------


@pytest.mark.parametrize("perspective", [True, False])
@pytest.mark.parametrize("thickness", [math.inf, 0.5, 0.1])
def test_it_equals_the_ray_tracer(perspective, thickness):
    buffer = rough(perspective, 24, 30)
    rows, columns = np.nonzero(np.isfinite(buffer.field.normal[0]))
    rows, columns = rows[::7], columns[::7]
    options = {"radius": 1.5, "falloff": "quadratic", "thickness": thickness}
    truth = trace_at(buffer.field, rows, columns, RayOptions(rays=2 * 64**2, **options))
    found = ambient_occlusion(buffer, method="exact", directions=128, **EVERY_SAMPLE, **options)
    error = found.occlusion[rows, columns] - truth.occlusion
    if thickness == math.inf:
        # Beside sky and holes a slice takes the surface as going on to the next crossing, and
        # cells as straight that are bilinear.
        assert np.abs(error).mean() < 0.006
        assert np.abs(error).max() < 0.09
    else:
        assert np.abs(error).mean() < 0.0015
        assert np.abs(error).max() < 0.008
    known = found.confidence[rows, columns] - truth.confidence
    assert np.abs(known).mean() < 0.004
    bent = (found.bent_normal[:, rows, columns] * truth.bent_normal).sum(axis=0)
    assert np.degrees(np.arccos(np.clip(bent, -1.0, 1.0))).mean() < 0.6


def test_more_directions_come_nearer_to_the_ray_tracer():
    buffer = rough(True, 24, 30)
    rows, columns = np.nonzero(np.isfinite(buffer.field.normal[0]))
    rows, columns = rows[::5], columns[::5]
    options = {"radius": 1.5, "falloff": "quadratic"}
    truth = trace_at(buffer.field, rows, columns, RayOptions(rays=2 * 64**2, **options)).occlusion
    errors = []
    for directions in (4, 8, 16, 32, 128):
        found = occlusion(buffer, directions=directions, **options)[rows, columns]
        errors.append(np.abs(found - truth).mean())
    assert all(later < earlier for earlier, later in itertools.pairwise(errors))
    assert errors[3] < 0.01
    assert errors[4] < 0.005


# --- symmetries and limits -------------------------------------------------------------------


@pytest.mark.parametrize("thickness", [math.inf, 0.3])
def test_one_thread_and_two_give_the_same_bytes(thickness):
    buffer = rough(True)
    before = threads()
    try:
        results = []
        for count in (1, min(2, before)):
            threads(count)
            options = {"thickness": thickness, "tile": 2, "directions": 5}
            results.append(ambient_occlusion(buffer, method="exact", radius=0.8, **options))
    finally:
        threads(before)
    for name in ("occlusion", "confidence", "bent_normal"):
        assert getattr(results[0], name).tobytes() == getattr(results[1], name).tobytes()


@pytest.mark.parametrize("perspective", [True, False])
@pytest.mark.parametrize("thickness", [math.inf, 0.3])
def test_mirrored_and_turned_images_have_mirrored_and_turned_results(perspective, thickness):
    def run(depth):
        rows, columns = depth.shape
        if perspective:
            camera = Camera.perspective(columns, rows, fx=20.0)
        else:
            camera = Camera.orthographic(columns, rows, extent=(0.1 * columns, 0.1 * rows))
        options = {"radius": 1.0, "falloff": "quadratic", "thickness": thickness}
        return occlusion(DepthBuffer(depth, camera), directions=8, **options)

    depth = np.where(np.isfinite(rough(True).depth), rough(True).depth, np.inf)
    plain = run(depth)
    assert 0.05 < plain.mean() < 0.9
    for turn in (np.fliplr, np.flipud, np.transpose, lambda a: np.rot90(a, 2)):
        # Shells whose edges just touch may or may not merge.
        assert np.abs(run(turn(depth)) - turn(plain)).max() < (2e-5 if thickness > 1.0 else 1e-3)


def test_a_huge_thickness_is_an_infinite_one():
    buffer = DepthBuffer(
        np.where(np.isfinite(rough(True).depth), rough(True).depth, 2.7), rough(True).camera
    )
    options = {"radius": 1.0, "falloff": "quadratic", **EVERY_SAMPLE}
    shell = occlusion(buffer, thickness=1e6, **options)
    whole = occlusion(buffer, tolerance=0.0, **options)
    assert np.abs(shell - whole).max() < 0.02
    assert np.abs(shell - whole).mean() < 0.004


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_a_thinner_solid_occludes_less(projection):
    depth = np.full((40, 40), 5.0)
    depth[10:30, 20:30] = 4.2
    camera = Camera.orthographic(40, 40, extent=(2.0, 2.0))
    if projection == "perspective":
        camera = Camera.perspective(40, 40, fx=100.0)
    buffer = DepthBuffer(depth, camera)
    beside = [
        occlusion(buffer, thickness=t, directions=64)[15:25, 12:18].mean()
        for t in (math.inf, 0.6, 0.3, 0.1, 0.01)
    ]
    assert all(thinner < 0.9 * thicker for thicker, thinner in itertools.pairwise(beside[1:]))
    assert beside[1] < beside[0]


@pytest.mark.parametrize("perspective", [True, False])
def test_what_lies_beyond_the_radius_changes_nothing(perspective):
    buffer = rough(perspective)
    for radius in (1e-6, 0.01, 0.3, 0.7):
        options = {"radius": radius, "falloff": "quadratic", "tolerance": 0.0, **EVERY_SAMPLE}
        near = occlusion(buffer, **options)
        # The lines' length follows from the radius; as a callable of an infinite one it does not,
        # and intervals are not cut where it ends.

        def weight(d, r=radius):
            return np.where(d < r, 1.0 - np.minimum(d / r, 1.0) ** 2, 0.0)

        options |= {"radius": math.inf, "falloff": weight, "falloff_scale": radius}
        assert np.nanmax(np.abs(near - occlusion(buffer, **options))) < 0.01


def test_a_frame_is_the_same_window_of_the_whole():
    for tile, thickness in ((1, math.inf), (3, math.inf), (2, 0.3)):
        options = {"directions": 6, "radius": 0.9, "tile": tile, "seed": 4, "thickness": thickness}
        whole = ambient_occlusion(rough(True), method="exact", **options)
        band = ambient_occlusion(rough(True, guard_band=(3, 5, 1, 2)), method="exact", **options)
        window = (slice(3, 12), slice(2, 12))
        assert band.occlusion.tobytes() == whole.occlusion[window].tobytes()
        assert band.confidence.tobytes() == whole.confidence[window].tobytes()


@pytest.mark.parametrize("thickness", [math.inf, 0.3])
def test_the_place_of_a_frame_in_a_wide_image_changes_no_byte(thickness):
    options = {"directions": 5, "radius": 1.0, "falloff": "quadratic", "thickness": thickness}
    whole = ambient_occlusion(rough(True, 12, 300), method="exact", **options)
    inner = rough(True, 12, 300, guard_band=(4, 9, 5, 77))
    frame = ambient_occlusion(inner, method="exact", **options)
    for name in ("occlusion", "confidence", "bent_normal"):
        window = getattr(whole, name)[..., 4:7, 77:291]
        assert getattr(frame, name).tobytes() == window.tobytes()


def test_a_tile_of_turned_directions_has_the_mean_of_as_many_more():
    view = screen_scenes.look(screen_scenes.wall(), "orthographic", 96)
    buffer, _, _ = framed(view)
    options = {"radius": 2.0, "falloff": "quadratic"}
    many = occlusion(buffer, directions=64, **options)
    turned = occlusion(buffer, directions=4, tile=4, **options)
    few = occlusion(buffer, directions=4, **options)
    rows, columns = (n // 4 * 4 for n in many.shape)

    def means(a):
        return a[:rows, :columns].reshape(rows // 4, 4, columns // 4, 4).mean(axis=(1, 3))

    assert (
        np.abs(means(turned) - means(many)).mean() < 0.2 * np.abs(means(few) - means(many)).mean()
    )
    other = occlusion(buffer, directions=4, tile=4, seed=1, **options)
    assert np.abs(other - turned).max() > 1e-3


def test_sky_is_open_holes_stay_holes_and_neither_occludes():
    for thickness in (math.inf, 0.2):
        result = ambient_occlusion(rough(True), method="exact", thickness=thickness)
        assert np.isnan(result.occlusion[1, 2])
        assert np.isnan(result.occlusion).sum() == 1
        assert np.all(result.occlusion[10:, 3:5] == 0.0)
        assert np.all(result.confidence[10:, 3:5] == 0.0)
        assert np.isnan(result.bent_normal[:, 11, 3]).all()
    # A lone wall stands as high beside sky as beside ground.
    depth = np.full((33, 33), 10.0)
    depth[:, 20:] = 4.0
    camera = Camera.orthographic(33, 33, extent=(33.0, 33.0))
    ground = occlusion(DepthBuffer(depth, camera), radius=12.0)
    depth[:, 12:20] = np.inf
    sky = occlusion(DepthBuffer(depth, camera), radius=12.0)
    assert 0.02 < ground[16, 11] < 0.3
    assert sky[16, 11] == pytest.approx(ground[16, 11], abs=0.005)


@pytest.mark.parametrize("thickness", [math.inf, 0.2])
@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (2, 2)])
def test_images_of_any_size(shape, thickness):
    for camera in (
        Camera.perspective(shape[1], shape[0], fov_y_deg=50.0),
        Camera.orthographic(shape[1], shape[0], extent=(1.0, 1.0)),
    ):
        for depth in (np.full(shape, 2.0), np.full(shape, np.inf)):
            for tile in (1, 3):
                result = ambient_occlusion(
                    DepthBuffer(depth, camera),
                    method="exact",
                    directions=3,
                    tile=tile,
                    thickness=thickness,
                )
                assert result.occlusion.shape == shape
                assert np.all(result.occlusion == 0.0)


@pytest.mark.parametrize("radius", [1e-6, 1e6, 1e30])
@pytest.mark.parametrize("perspective", [True, False])
@pytest.mark.parametrize("falloff", ["hard", "quadratic", "timonen"])
def test_tiny_and_huge_radii_give_numbers_between_0_and_1(falloff, perspective, radius):
    result = ambient_occlusion(
        rough(perspective), method="exact", falloff=falloff, radius=radius, directions=7
    )
    for layer in (result.occlusion, result.confidence):
        known = layer[~np.isnan(layer)]
        assert known.size >= 13 * 17 - 1
        assert 0.0 <= known.min() <= known.max() <= 1.0
    if falloff == "hard" and radius > 1.0:
        endless = occlusion(rough(perspective), directions=7)
        assert np.nanmax(np.abs(result.occlusion - endless)) < 1e-5


# --- what is skipped -------------------------------------------------------------------------


def stairs(perspective, rows=40, columns=150):
    """Terraces that fall away from the bottom of the image, boxes on them, sky above."""
    draw = np.random.default_rng(11)
    depth = 2.0 + 0.5 * np.repeat(np.arange(rows)[::-1] // 8, columns).reshape(rows, columns)
    for _ in range(12):
        row, column = draw.integers(0, rows - 6), draw.integers(0, columns - 9)
        depth[row : row + 6, column : column + 9] -= draw.uniform(0.1, 0.8)
    depth += 0.003 * draw.standard_normal(depth.shape)
    depth[:5] = np.inf
    if perspective:
        return DepthBuffer(depth, Camera.perspective(columns, rows, fx=120.0))
    return DepthBuffer(depth, Camera.orthographic(columns, rows, extent=(3.0, 0.8)))


@pytest.mark.parametrize("perspective", [True, False])
@pytest.mark.parametrize("thickness", [math.inf, 0.3])
def test_directions_with_nothing_high_ahead_are_given_up_and_no_bit_changes(
    perspective, thickness, monkeypatch
):
    options = {"method": "exact", "directions": 9, "thickness": thickness, "tile": 2}
    for buffer in (stairs(perspective), rough(perspective)):
        for reach in ({}, {"radius": 0.7, "falloff": "quadratic"}):
            quick = ambient_occlusion(buffer, **options, **reach)
            with monkeypatch.context() as patch:
                patch.setattr(
                    "adret.screen.exact.highest_from",
                    lambda field: np.full((4, max(field.depth.shape)), np.inf, dtype=np.float32),
                )
                whole = ambient_occlusion(buffer, **options, **reach)
            for name in ("occlusion", "confidence", "bent_normal"):
                assert getattr(quick, name).tobytes() == getattr(whole, name).tobytes()
            assert whole.report.skipped["directions"] == 0
            if buffer.shape == (40, 150):
                pairs = 9 * buffer.shape[0] * buffer.shape[1]
                assert 0.2 * pairs < quick.report.skipped["directions"] <= pairs


@pytest.mark.parametrize("perspective", [True, False])
def test_with_a_radius_below_a_pixel_only_the_pixels_own_patch_is_looked_at(perspective):
    buffer = stairs(perspective)
    _, _, ay, _ = buffer.camera.rays
    surface = np.isfinite(buffer.depth)
    pixel = np.where(surface, abs(ay) * (buffer.depth if perspective else 1.0), np.inf)
    radius = 0.9 * float(pixel.min())
    found = ambient_occlusion(buffer, method="exact", radius=radius)
    assert found.report.skipped["sky"] == np.count_nonzero(~surface)
    assert 0.8 * surface.sum() < found.report.skipped["small_radius"] <= surface.sum()
    # The patch starts at the receiver, so what it hides it hides at distance 0: the same for any
    # smaller radius, and with a weight of no radius that looks at all samples.
    least = occlusion(buffer, radius=1e-3 * radius)
    assert np.abs(found.occlusion - least).max() < 1e-5

    def weight(d):
        return np.where(d < radius, 1.0, 0.0)

    every = occlusion(buffer, falloff=weight, falloff_scale=radius, tolerance=0.0, **EVERY_SAMPLE)
    assert np.abs(found.occlusion - every).max() < 0.01
    assert ambient_occlusion(buffer, method="exact").report.skipped["small_radius"] == 0


# --- errors ----------------------------------------------------------------------------------


def test_a_run_can_be_watched_and_stopped():
    steps = []
    ambient_occlusion(rough(True), method="exact", progress=lambda *each: steps.append(each))
    assert steps[0] == (0, 13)
    assert steps[-1] == (13, 13)

    def stop(done, total):
        raise Cancelled("enough")

    with pytest.raises(Cancelled):
        ambient_occlusion(rough(True), method="exact", progress=stop)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"directions": 0}, "directions: must be"),
        ({"directions": 2.5}, "directions: must be"),
        ({"weight": "sine"}, "weight: must be one of cosine, uniform"),
        ({"thickness": 0.0}, "thickness: must be"),
        ({"thickness": math.nan}, "thickness: must be"),
        ({"near": 0}, "near: must be"),
        ({"growth": -0.1}, "growth: must be"),
        ({"tile": 9}, "tile: must be"),
        ({"tolerance": math.inf}, "tolerance: must be"),
        ({"radius": 0.0}, "radius: must be"),
        ({"steps": 4}, "steps: must be an option of 'exact': one of .*directions, .*radius"),
    ],
)
def test_bad_options_are_named(options, message):
    with pytest.raises(InputError, match=message):
        ambient_occlusion(rough(True), method="exact", **options)
