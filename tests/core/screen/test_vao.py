"""Volumetric ambient occlusion and its containment test."""

import math

import numpy as np
import pytest
from screen_buffers import camera_of, depth_at, measured, pixel, point, rough

import screen_scenes
from adret import Camera, DepthBuffer, InputError
from adret.screen import Relief, ambient_occlusion
from adret.screen.samples import disk_samples
from adret.screen.vao import containment_kernel

PROJECTIONS = ("orthographic", "perspective")


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("lean", [0.0, 0.9])
def test_a_plane_is_zero_at_any_tilt(projection, lean):
    view = screen_scenes.look(screen_scenes.plane(), projection, 48, lean=lean, pitch=0.4)
    for estimator in ("pipes", "containment"):
        found, *_ = measured(view, method="vao", radius=1.5, estimator=estimator)
        assert found.max() < 1e-5


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_beside_a_wall_it_is_the_cap_of_the_tangent_sphere_and_the_error_falls(projection):
    errors = []
    for pixels in (60, 240):
        scene = screen_scenes.wall(reach=(0.2, 1.2))
        # From straight above the wall is one pixel wide, so its foot is known to half a pixel.
        view = screen_scenes.look(scene, projection, pixels, lean=0.0)
        found, rows, columns, _ = measured(
            view, method="vao", radius=2.0, samples=128, tile=8, disk="stratified"
        )
        truth = view.truth("volumetric", rows, columns, "hard", 2.0)
        errors.append(abs((found - truth).mean()))
        assert truth.max() > 0.2
    assert errors[1] < 0.003
    assert errors[1] < 0.6 * errors[0]


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("membership", ["hard", "quadratic"])
def test_containment_is_the_cosine_weighted_occlusion_of_a_wall(projection, membership):
    view = screen_scenes.look(screen_scenes.wall(reach=(0.2, 1.2)), projection, 120)
    found, rows, columns, _ = measured(
        view,
        method="vao",
        estimator="containment",
        membership=membership,
        radius=2.0,
        samples=256,
        tile=8,
    )
    truth = view.truth("cosine", rows, columns, membership, 2.0)
    assert found.mean() == pytest.approx(truth.mean(), abs=0.006)
    assert np.corrcoef(found, truth)[0, 1] > 0.99


def test_containment_has_the_falloff_of_its_membership():
    # The openness (d/R)^p of a wall, by quadrature over directions.
    distance, radius = 0.6, 2.0
    azimuth, zenith = np.meshgrid(
        np.linspace(-0.5 * math.pi, 0.5 * math.pi, 1201)[1:-1],
        np.linspace(0.0, 0.5 * math.pi, 1201)[1:],
        indexing="ij",
    )
    hit = distance / (np.sin(zenith) * np.cos(azimuth))
    element = np.cos(zenith) * np.sin(zenith) * (math.pi / 1200) * (0.5 * math.pi / 1200) / math.pi
    camera = Camera.orthographic(401, 201, extent=(8.02, 4.02))
    depth = np.where(np.arange(401) > 230, 5.0, 9.0) * np.ones((201, 1))
    buffer = DepthBuffer(depth, camera, guard_band=(100, 200, 84, 200))  # the foot is 30.5 away
    for membership, power in (("volumetric", 3.0), ("linear", 1.0), ("root", 0.5)):
        weight = np.maximum(0.0, 1.0 - (hit / radius) ** power)
        found = ambient_occlusion(
            buffer,
            method="vao",
            estimator="containment",
            membership=membership,
            radius=radius,
            samples=512,
            tile=16,
        ).occlusion
        assert found.mean() == pytest.approx(float((weight * element).sum()), abs=0.012)


@pytest.mark.parametrize("perspective", [True, False])
@pytest.mark.parametrize("normalisation", ["weighted", "analytic"])
def test_pipes_equal_a_loop_written_from_the_paper(perspective, normalisation):
    buffer = rough(perspective)
    radius, samples = 0.8, 8
    result = ambient_occlusion(
        buffer, method="vao", radius=radius, samples=samples, tile=1, normalisation=normalisation
    )
    for row in range(buffer.shape[0]):
        for column in range(row % 3, buffer.shape[1], 3):
            if np.isnan(buffer.depth[row, column]):
                continue
            normal = buffer.field.normal[:, row, column].astype(float)
            centre = point(buffer, row, column) + 0.5 * radius * normal
            free, whole, cover = tangent_sphere(buffer, centre, 0.5 * radius, samples)
            if normalisation == "analytic":
                whole = 4.0 / 3.0 * math.pi * (0.5 * radius) ** 3 / (cover / samples)
            expected = min(max(1.0 - free / whole, 0.0), 1.0)
            assert result.occlusion[row, column] == pytest.approx(expected, abs=1e-3)


def tangent_sphere(buffer, centre, radius, samples):
    """Free and whole volume of the pipes of unit area, and the area that they stand for."""
    eye = np.zeros(3)
    if buffer.camera.perspective_divide:
        away = np.linalg.norm(centre)
        toward = centre / away
        cover = radius / math.sqrt(1.0 - (radius / away) ** 2)
        across, upward = tangents_by_duff(toward)
    else:
        cover, across, upward = radius, np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    free = whole = 0.0
    for x, y in disk_samples(samples):
        through = centre + cover * (x * across + y * upward)
        if buffer.camera.perspective_divide:
            way = through / np.linalg.norm(through)
            solid_angle = away / np.linalg.norm(through) ** 3
        else:
            eye, way = through * (1.0, 1.0, 0.0), np.array([0.0, 0.0, -1.0])
        steps = np.linspace(*roots(eye, way, centre, radius), 1001)
        middle = 0.5 * (steps[1:] + steps[:-1])
        place = pixel(buffer, through)
        surface = math.nan if place is None else depth_at(buffer, *place)
        before = np.ones(len(middle), bool)
        if not math.isnan(surface):
            before = -(eye[2] + middle * way[2]) < surface
        volume = np.diff(steps)
        if buffer.camera.perspective_divide:
            volume = volume * middle**2 * solid_angle
        free += volume[before].sum()
        whole += volume.sum()
    return free, whole, math.pi * cover**2


def tangents_by_duff(n):
    sign = 1.0 if n[2] >= 0.0 else -1.0
    a = -1.0 / (sign + n[2])
    b = n[0] * n[1] * a
    first = np.array([1.0 + sign * n[0] ** 2 * a, sign * b, -sign * n[0]])
    return first, np.array([b, sign + n[1] ** 2 * a, -n[1]])


def roots(origin, way, centre, radius):
    """Where a line enters and leaves a sphere."""
    along = way @ (centre - origin)
    half = math.sqrt(max(0.0, radius**2 - np.sum((centre - origin) ** 2) + along**2))
    return along - half, along + half


@pytest.mark.parametrize("perspective", [True, False])
def test_containment_equals_a_loop_written_from_the_paper(perspective):
    buffer = rough(perspective)
    points = 0.7 * containment_kernel(16, "quadratic", 5)
    result = ambient_occlusion(
        buffer,
        method="vao",
        estimator="containment",
        membership="quadratic",
        radius=0.7,
        samples=16,
        tile=1,
        seed=5,
    )
    for row in range(buffer.shape[0]):
        for column in range(buffer.shape[1]):
            if np.isnan(buffer.depth[row, column]):
                continue
            normal = buffer.field.normal[:, row, column].astype(float)
            first, second = tangents_by_duff(normal)
            closed = 0
            for x, y, z in points:
                place = point(buffer, row, column) + x * first + y * second + z * normal
                at = pixel(buffer, place)
                closed += at is not None and depth_at(buffer, *at) < -place[2]
            assert result.occlusion[row, column] == pytest.approx(closed / 16, abs=1e-6)


def test_weighted_normalisation_is_nearer_to_its_reference_than_the_constant_at_4_samples():
    view = screen_scenes.look(screen_scenes.trench(), "perspective", 120)
    buffer = DepthBuffer(view.depth, camera_of(view), normals=view.normals, guard_band=10)
    options = {"method": "vao", "radius": 2.0}
    reference = ambient_occlusion(buffer, samples=512, disk="stratified", **options).occlusion
    for seed in range(4):
        errors = {
            normalisation: np.abs(
                ambient_occlusion(
                    buffer,
                    samples=4,
                    seed=seed,
                    normalisation=normalisation,
                    **options,
                ).occlusion
                - reference
            ).mean()
            for normalisation in ("weighted", "analytic")
        }
        assert errors["weighted"] < errors["analytic"]


def test_the_analytic_volume_is_off_by_the_chords_of_the_sample_set_and_rings_mend_it():
    camera = Camera.orthographic(16, 16, extent=(4.0, 4.0))
    plane = DepthBuffer(np.full((16, 16), 5.0), camera, guard_band=4)
    mean = {}
    for disk in ("poisson", "stratified"):
        points = disk_samples(8, 0, stratified=disk == "stratified")
        chord = 2.0 * np.sqrt(1.0 - (points**2).sum(axis=1)).mean()
        options = {"normalisation": "analytic", "disk": disk, "denoise": "box"}
        found = ambient_occlusion(plane, method="vao", radius=1.0, **options).occlusion
        mean[disk] = float(found.mean())
        assert np.ptp(found) < 1e-5  # the same in all pixels: a filter can't take it away
        assert mean[disk] == pytest.approx(max(1.0 - chord / (4.0 / 3.0), 0.0), abs=1e-5)
    assert mean["poisson"] > 0.06
    assert mean["stratified"] < 0.01


def test_a_relief_occludes_where_the_depth_buffer_is_flat():
    # Furrows of slope 1 on a frontal wall. From their bottom the sides rise to 45 degrees.
    camera = Camera.orthographic(128, 8, extent=(12.8, 0.8))
    flat = DepthBuffer(np.full((8, 128), 5.0), camera)
    period = 64
    heights = np.abs((np.arange(period) - 0.5 * period) * 0.05)
    column, row = np.meshgrid(np.arange(128) * 2.0, np.arange(8) * 2.0)
    along = np.zeros((3, 8, 128))
    along[0] = 1.0
    relief = Relief(
        heights=np.tile(heights, (4, 1)), texels=np.stack([column, row]), along=along, texel=0.05
    )
    options = {
        "method": "vao",
        "estimator": "containment",
        "membership": "hard",
        "radius": 0.4,
        "samples": 256,
    }
    plain = ambient_occlusion(flat, **options).occlusion
    rough_wall = ambient_occlusion(flat, relief=relief, **options).occlusion
    assert np.all(plain == 0.0)
    # What is open round the wall's own normal is 45 degrees on both sides: sin 45°.
    bottom = rough_wall[:, 16 + 32 * np.arange(4)]
    assert bottom.mean() == pytest.approx(1.0 - math.sqrt(0.5), abs=0.02)
    ridge = rough_wall[:, 32 * np.arange(1, 4)]
    assert ridge.max() == 0.0
    # Both indicators together are never more open than either.
    assert np.all(rough_wall >= plain)


def test_a_relief_without_texture_coordinates_changes_nothing():
    buffer = rough(True)
    relief = Relief(
        heights=np.ones((4, 4)),
        texels=np.full((2, *buffer.shape), np.nan),
        along=np.zeros((3, *buffer.shape)),
        texel=0.1,
    )
    options = {"method": "vao", "estimator": "containment", "radius": 0.7}
    plain = ambient_occlusion(buffer, **options)
    with_relief = ambient_occlusion(buffer, relief=relief, **options)
    assert np.array_equal(plain.occlusion, with_relief.occlusion, equal_nan=True)
    assert np.array_equal(plain.confidence, with_relief.confidence)


def test_a_relief_that_cannot_be_used_is_refused():
    buffer = rough(True)
    good = {
        "heights": np.ones((4, 4)),
        "texels": np.zeros((2, *buffer.shape)),
        "along": np.zeros((3, *buffer.shape)),
        "texel": 0.1,
    }
    for name, value, limit in (
        ("heights", np.ones(4), "heights: must be finite"),
        ("texels", np.zeros((3, 2, 2)), "texels: must be of shape"),
        ("along", np.zeros((3, 2, 2)), "along: must be of shape"),
        ("texel", 0.0, "texel: must be a number above 0"),
    ):
        with pytest.raises(InputError, match=limit):
            Relief(**{**good, name: value})
    with pytest.raises(InputError, match="relief: must be None for the estimator pipes"):
        ambient_occlusion(buffer, method="vao", relief=Relief(**good))
    with pytest.raises(InputError, match="relief: must be a Relief, got 'int'"):
        ambient_occlusion(buffer, method="vao", estimator="containment", relief=3)
    small = Relief(**{**good, "texels": np.zeros((2, 3, 3)), "along": np.zeros((3, 3, 3))})
    with pytest.raises(InputError, match="relief: must be for an image of 13 x 17 pixels"):
        ambient_occlusion(buffer, method="vao", estimator="containment", relief=small)
