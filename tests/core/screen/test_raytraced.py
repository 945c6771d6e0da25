"""The ray-traced reference: closed forms, a slow march along the same rays, Embree, noise."""

import math

import numpy as np
import pytest
from screen_buffers import camera_of, rough

import screen_scenes
from adret import Camera, DepthBuffer, InputError, ambient_occlusion
from adret._kernels.jit import threads
from adret.screen import make_falloff
from adret.screen.raytraced import Options, trace_at, trace_several

PROJECTIONS = ("orthographic", "perspective")
CASES = [
    (name, weight, falloff)
    for name, make in screen_scenes.SCENES.items()
    for weight, falloff in make().forms
    if name != "plane"
]
# What a pixel's width makes of the scene: mean error allowed at 200 columns.
BOUNDS = {"wall": 0.003, "high wall": 0.004, "dihedral": 0.002, "groove": 0.003, "bar": 0.003}


def options_for(scene, weight, falloff, rays):
    options = {"weight": weight, "rays": rays, "thickness": scene.thickness}
    if weight == "volumetric":
        return Options(**options, radius=2.0), 2.0
    if falloff == "timonen":
        return Options(**options, falloff=falloff, falloff_scale=4.0), 4.0
    if falloff == "none":
        return Options(**options), math.inf
    return Options(**options, falloff=falloff, radius=2.0), 2.0


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize(("name", "weight", "falloff"), CASES)
def test_closed_forms_come_nearer_as_pixels_shrink(name, weight, falloff, projection):
    scene = screen_scenes.SCENES[name]()
    options, size = options_for(scene, weight, falloff, 4096)
    errors, noise = [], 0.0
    for pixels in (100, 200):
        view = screen_scenes.look(scene, projection, pixels)
        buffer = DepthBuffer(view.depth, camera_of(view))
        rows, columns = view.receivers(24)
        found = trace_at(buffer.field, rows, columns, options)
        truth = view.truth(weight, rows, columns, falloff, size)
        errors.append(abs((found.occlusion - truth).mean()))
        noise = max(noise, found.noise / math.sqrt(len(rows)))
    assert errors[1] < BOUNDS.get(name, 0.01)
    assert errors[1] < max(0.7 * errors[0], 0.0015 + 3.0 * noise)


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("weight", ["cosine", "uniform", "volumetric"])
def test_a_plane_is_open_at_any_tilt(projection, weight):
    view = screen_scenes.look(screen_scenes.plane(), projection, 60, lean=1.0, pitch=0.3)
    buffer = DepthBuffer(view.depth, camera_of(view))
    rows, columns = view.receivers(12)
    radius = {"radius": 2.0} if weight == "volumetric" else {}
    found = trace_at(buffer.field, rows, columns, Options(weight=weight, rays=4096, **radius))
    # Depths are float32: a ray a ten-thousandth of a radian above the plane may graze it.
    assert found.occlusion.max() < (1e-6 if weight == "cosine" else 3e-4)


# --- a slow march along the same rays --------------------------------------------------------


def hashed(row, column, seed, count):
    """The library's noise, by whole Python numbers (checked in test_ambient_occlusion)."""
    mask, golden = (1 << 64) - 1, 0x9E3779B97F4A7C15
    first, second = 0xBF58476D1CE4E5B9, 0x94D049BB133111EB

    def mix(h):
        h = ((h ^ (h >> 30)) * first) & mask
        h = ((h ^ (h >> 27)) * second) & mask
        return h ^ (h >> 31)

    h = mix((((row << 32) | column) + golden) & mask)
    h = mix(h ^ ((seed * golden + first) & mask))
    return (mix(h ^ ((count * golden + second) & mask)) >> 11) / 2.0**53


def directions(normal, row, column, strata, around):
    """Stratified cosine directions of both halves, (2, strata * around, 3)."""
    nx, ny, nz = normal
    sign = 1.0 if nz >= 0 else -1.0
    a, b = -1.0 / (sign + nz), -nx * ny / (sign + nz)
    side = np.array([1 + sign * nx * nx * a, sign * b, -sign * nx])
    other = np.array([b, sign + ny * ny * a, -ny])
    rays = np.empty((2, strata * around, 3))
    for half, k in np.ndindex(2, strata * around):
        draw = 2 * (half * strata * around + k)
        u = (k // around + hashed(row, column, 0, draw)) / strata
        v = 2 * math.pi * (k % around + hashed(row, column, 0, draw + 1)) / around
        out = math.sqrt(u) * (math.cos(v) * side + math.sin(v) * other)
        rays[half, k] = out + math.sqrt(1 - u) * normal
    return rays


def is_solid(buffer, thickness, own, row, column, depth):
    """Whether a point lies in what the docstring calls solid; rows and columns may be broken."""
    rows, columns = buffer.shape
    i, j = math.floor(row), math.floor(column)
    v, u = row - i, column - j
    corners = {}
    for di, dj in np.ndindex(2, 2):
        known = 0 <= i + di < rows and 0 <= j + dj < columns
        corners[di, dj] = float(buffer.depth[i + di, j + dj]) if known else math.nan
    values = np.array(list(corners.values()))
    if np.isnan(values).any() or values.max() - values.min() > thickness:
        place = (int(v > 0.5), int(u > 0.5))
        if (i + place[0], j + place[1]) == own:
            return False
        surface = corners[place]
    else:
        w = 1.0 / values if buffer.camera.perspective_divide else values
        w = (1 - v) * ((1 - u) * w[0] + u * w[1]) + v * ((1 - u) * w[2] + u * w[3])
        surface = 1.0 / w if buffer.camera.perspective_divide else w
    return surface < depth < surface + thickness


def march(buffer, thickness, row, column, direction, reach):
    """Distance to the solid by tiny steps; inf without a hit, NaN after leaving the image."""
    ax, bx, ay, by = buffer.camera.rays
    divide = buffer.camera.perspective_divide
    z0 = float(buffer.depth[row, column])
    start = buffer.camera.position(row, column, z0)
    rows, columns = buffer.shape
    for t in np.concatenate([np.geomspace(1e-6, 0.0025, 30), np.arange(0.005, reach, 0.005)]):
        x, y, back = start + t * direction
        depth = -back
        if divide and depth <= 0:
            return math.nan
        scale = depth if divide else 1.0
        c, r = (x / scale - bx) / ax, (y / scale - by) / ay
        if not (0 <= r <= rows - 1 and 0 <= c <= columns - 1):
            return math.nan
        if is_solid(buffer, thickness, (row, column), r, c, depth):
            return t
    return math.inf


@pytest.mark.parametrize("perspective", [True, False])
@pytest.mark.parametrize("thickness", [math.inf, 0.3])
def test_it_equals_tiny_steps_along_the_same_rays(perspective, thickness):
    buffer = rough(perspective)
    pixels = [(5, 3), (2, 2), (9, 10), (12, 16), (7, 12)]
    strata, around, reach = 4, 5, 2.0
    excess = []
    for row, column in pixels:
        normal = buffer.field.normal[:, row, column].astype(np.float64)
        rays = directions(normal, row, column, strata, around)
        falloff = {"falloff": "quadratic", "radius": reach}
        options = Options(rays=2 * strata * around, thickness=thickness, **falloff)
        found = trace_at(buffer.field, [row], [column], options)
        assert found.rays == 2 * strata * around
        distance = np.array(
            [[march(buffer, thickness, row, column, ray, reach) for ray in half] for half in rays]
        )
        weight = np.where(distance < reach, 1.0 - (distance / reach) ** 2, 0.0)
        # The march stops up to one step late, and may step over an edge that one ray touches.
        more = found.halves[:, 0] - weight.mean(axis=1)
        assert (more > -0.002).all(), (row, column)
        assert (more < 0.005 + 1.0 / (strata * around)).all(), (row, column)
        excess.append(more)
        known = 1.0 - np.isnan(distance).mean()
        assert found.confidence[0] == pytest.approx(known, abs=0.03)
    assert np.mean(excess) < 0.006


# --- Embree ----------------------------------------------------------------------------------


@pytest.mark.parametrize("perspective", [True, False])
def test_embree_hides_the_same_share_of_the_same_mesh(perspective):
    trimesh = pytest.importorskip("trimesh", reason="the ray tracer's mesh library is missing")
    pytest.importorskip("embreex", reason="the ray tracer is not installed")
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    rng = np.random.default_rng(4)
    rows, columns = 48, 56
    # Nearness f(column) + g(row): every cell is flat, and its two triangles are the surface.
    # Straight pieces, so that a pixel's normal is that of the cells about it but at few kinks.
    across = np.interp(np.arange(columns), [0, 9, 10, 21, 40, 41, 55], [0, 5, 20, 20, 0, 12, 10])
    down = np.interp(np.arange(rows), [0, 13, 26, 27, 47], [4, -4, 5, -1, 2])
    nearness = 0.4 + 0.01 * (across[None, :] + down[:, None])
    if perspective:
        camera = Camera.perspective(columns, rows, fov_y_deg=60.0)
        depth = 1.0 / nearness
    else:
        camera = Camera.orthographic(columns, rows, extent=(5.6, 4.8))
        depth = 5.0 - 6.0 * nearness
    buffer = DepthBuffer(depth, camera)
    places = camera.position(*np.mgrid[0:rows, 0:columns], buffer.depth).reshape(3, -1).T
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + columns, corner + 1], axis=1),
            np.stack([corner + 1, corner + columns, corner + columns + 1], axis=1),
        ]
    )
    intersector = RayMeshIntersector(trimesh.Trimesh(places, faces, process=False))
    at = np.stack([rng.integers(5, rows - 5, 40), rng.integers(5, columns - 5, 40)])
    found = trace_at(buffer.field, *at, Options(rays=8192))
    shares = []
    for row, column in at.T:
        normal = buffer.field.normal[:, row, column].astype(np.float64)
        side = np.cross(normal, [1.0, 0.0, 0.0])
        side /= np.linalg.norm(side)
        u, v = (np.arange(4096) + rng.random(4096)) / 4096, rng.random(4096) * 2 * np.pi
        ray = np.outer(np.sqrt(u) * np.cos(v), side)
        ray += np.outer(np.sqrt(u) * np.sin(v), np.cross(normal, side))
        ray += np.outer(np.sqrt(1 - u), normal)
        start = camera.position(row, column, buffer.depth[row, column]) + 2e-5 * normal
        hits = intersector.intersects_any(np.repeat(start[None], len(ray), axis=0), ray)
        shares.append(hits.mean())
    difference = found.occlusion - np.array(shares)
    assert found.occlusion.mean() > 0.1
    assert abs(difference.mean()) < 0.0025  # 40 x 4096 plain rays: 0.0009
    assert np.abs(difference).max() < 0.035


# --- symmetries and invariants ---------------------------------------------------------------


def test_its_noise_is_what_other_seeds_show():
    buffer = rough(True, 33, 41)
    rows, columns = np.nonzero(~np.isnan(buffer.depth))
    rows, columns = rows[::5], columns[::5]
    runs = [trace_at(buffer.field, rows, columns, Options(rays=128, seed=s)) for s in range(12)]
    spread = np.std([run.occlusion for run in runs], axis=0, ddof=1)
    seen = float(np.sqrt((spread**2).mean()))
    said = float(np.mean([run.noise for run in runs]))
    assert said == pytest.approx(seen, rel=0.05)
    fine = trace_at(buffer.field, rows, columns, Options(rays=2048)).noise
    assert fine < 0.2 * said  # stratified: falls faster than the root, which is 0.25


def test_a_solid_thicker_than_every_step_is_as_good_as_endless():
    buffer = rough(True, 33, 41)
    rows, columns = np.nonzero(~np.isnan(buffer.depth))
    thick, endless = (
        trace_at(buffer.field, rows, columns, Options(rays=64, thickness=t)).halves
        for t in (100.0, math.inf)
    )
    assert np.array_equal(thick, endless)


def test_several_falloffs_by_the_same_rays_equal_each_alone():
    buffer = rough(False)
    rows, columns = [5, 9, 7], [3, 10, 12]
    falloffs = [
        make_falloff("none"),
        make_falloff("quadratic", 1.0),
        make_falloff("timonen", math.inf, 0.5),
        make_falloff(lambda d: np.exp(-d)),
    ]
    together = trace_several(buffer.field, rows, columns, Options(rays=512), falloffs)
    for found, falloff in zip(together, falloffs, strict=True):
        given = falloff.function or falloff.name
        options = Options(
            rays=512, falloff=given, radius=falloff.radius, falloff_scale=falloff.scale
        )
        alone = trace_at(buffer.field, rows, columns, options)
        assert found.halves == pytest.approx(alone.halves, abs=1e-7)
    assert (together[0].occlusion >= together[3].occlusion).all()


def test_spheres_and_shells_are_half_full_on_a_plane_and_three_quarters_in_a_corner():
    view = screen_scenes.look(screen_scenes.wall(reach=(0.0, 2.0)), "orthographic", 200)
    buffer = DepthBuffer(view.depth, camera_of(view))
    rows, columns = view.receivers(400)
    far = view.points[0, rows, columns] < -1.0
    near = view.points[0, rows, columns] > -0.05
    for weight in ("sphere", "shell"):
        options = Options(weight=weight, radius=0.9, rays=8192)
        found = trace_at(buffer.field, rows, columns, options).occlusion
        assert found[far] == pytest.approx(0.5, abs=0.006)
        assert near.any()
        assert found[near] == pytest.approx(0.75, abs=0.03)


def test_beside_an_endless_wall_the_hemispheres_share_is_the_occlusion_by_its_cube():
    view = screen_scenes.look(screen_scenes.wall(), "perspective", 100)
    buffer = DepthBuffer(view.depth, camera_of(view))
    rows, columns = view.receivers(24)
    share = trace_at(
        buffer.field, rows, columns, Options(weight="hemisphere", radius=2.0, rays=8192)
    )
    cube = {"radius": 2.0, "falloff": lambda d: np.maximum(0.0, 1.0 - (d / 2.0) ** 3)}
    rays = trace_at(buffer.field, rows, columns, Options(rays=4096, **cube))
    # A ray that has come into the wall stays in it.
    assert (share.occlusion - rays.occlusion).mean() == pytest.approx(0.0, abs=0.002)
    assert share.occlusion.mean() > 0.1


def test_bent_normals_lean_away_from_what_hides():
    view = screen_scenes.look(screen_scenes.step(), "perspective", 100)
    buffer = DepthBuffer(view.depth, camera_of(view))
    rows, columns = view.receivers(8)
    bent = trace_at(buffer.field, rows, columns, Options(rays=2048)).bent_normal
    assert (bent[0] < -0.05).all()
    assert np.abs(bent[1]).max() < 0.02
    assert np.allclose((bent**2).sum(axis=0), 1.0)
    flat = trace_at(buffer.field, rows, columns, Options(rays=2048, radius=0.01)).bent_normal
    assert np.allclose(flat, buffer.field.normal[:, rows, columns], atol=0.01)


def test_a_second_layer_hides_what_the_first_one_lets_pass():
    # A thin bar over a low one: from above only the upper one is seen.
    pixels, size = 160, 10.0
    x = (np.arange(pixels) + 0.5) * size / pixels - 5.0
    width = 13 * size / pixels
    first = np.where((x > 0) & (x < width), 10.0 - 2.0, 10.0)
    second = np.where((x > 0) & (x < width), 10.0 - 0.5, np.inf)
    camera = Camera.orthographic(pixels, pixels, extent=(size, 4 * size))
    one = DepthBuffer(np.tile(first, (pixels, 1)), camera)
    both = DepthBuffer(
        np.tile(first, (pixels, 1)), camera, second_layer=np.tile(second, (pixels, 1))
    )
    column = int((-1.0 + 5.0) / size * pixels)
    a = -x[column]
    options = Options(rays=8192, thickness=0.3)

    def slot(top, bottom):
        low, high = math.atan(bottom / (width + a)), math.atan(top / a)
        return 0.5 * (math.cos(low) - math.cos(high))

    row = pixels // 2
    alone = trace_at(one.field, [row], [column], options).occlusion[0]
    joined = trace_at(both.field, [row], [column], options).occlusion[0]
    assert alone == pytest.approx(slot(2.0, 1.7), abs=0.004)
    # Their elevations do not overlap, so they add up.
    assert joined == pytest.approx(slot(2.0, 1.7) + slot(0.5, 0.2), abs=0.004)


def test_what_was_decided_inside_the_image_is_the_confidence():
    camera = Camera.orthographic(41, 41, extent=(41.0, 41.0))
    buffer = DepthBuffer(np.full((41, 41), 10.0), camera)
    options = {"rays": 4096, "radius": 10.0}
    middle = trace_at(buffer.field, [20], [20], Options(**options)).confidence[0]
    edge = trace_at(buffer.field, [20], [40], Options(**options)).confidence[0]
    assert middle == 1.0
    assert edge == pytest.approx(0.5, abs=0.01)
    # Over a plane nothing ever ends an endless ray.
    assert trace_at(buffer.field, [20], [20], Options(rays=256)).confidence[0] == 0.0


def test_tiles_and_threads_change_no_byte():
    buffer = rough(True, 33, 41)
    found = []
    before = threads()
    try:
        for count in (1, 2):
            threads(count)
            found.append(ambient_occlusion(buffer, method="raytraced", rays=64))
    finally:
        threads(before)
    for one, two in zip(*((f.occlusion, f.confidence, f.bent_normal) for f in found), strict=True):
        assert one.tobytes() == two.tobytes()
    field = buffer.field
    rows, columns = np.nonzero(~np.isnan(field.depth))
    part = field._replace(origin=(100, 50))
    moved = trace_at(part, rows, columns, Options(rays=64)).occlusion
    whole = trace_at(field, rows, columns, Options(rays=64)).occlusion
    assert not np.array_equal(moved, whole)  # noise counts from the whole buffer's corner
    assert np.abs(moved - whole).max() < 0.2


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (2, 2)])
def test_the_smallest_images_are_open(shape):
    camera = Camera.perspective(shape[1], shape[0], fov_y_deg=50.0)
    result = ambient_occlusion(DepthBuffer(np.full(shape, 2.0), camera), method="raytraced", rays=8)
    assert (result.occlusion == 0.0).all()
    empty = DepthBuffer(np.full(shape, np.inf), camera)
    assert (ambient_occlusion(empty, method="raytraced", rays=8).occlusion == 0.0).all()


def test_pixels_without_a_surface_and_senseless_options_are_refused():
    field = rough(True).field
    with pytest.raises(InputError, match=r"rows: must be pixels that show a surface"):
        trace_at(field, [1], [2], Options())
    with pytest.raises(InputError, match=r"rows: must be inside the image"):
        trace_at(field, [1], [200], Options())
    with pytest.raises(InputError, match=r"columns: must be of the rows' shape"):
        trace_at(field, [1, 2], [2], Options())
    with pytest.raises(InputError, match="radius: must be finite for the weight volumetric"):
        Options(weight="volumetric")
    with pytest.raises(InputError, match="falloff: must be 'none' for the weight sphere"):
        Options(weight="sphere", radius=1.0, falloff="quadratic")
    with pytest.raises(InputError, match="thickness: must be a number between 0 and inf"):
        Options(thickness=0.0)
    with pytest.raises(InputError, match="rays: must be a whole number"):
        Options(rays=1)
