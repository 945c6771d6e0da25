"""The scenes with closed forms: against the published numbers, and against plain rays."""

import math

import numpy as np
import pytest

import screen_scenes

FIXTURES = [  # a = 0.7, R = 2, r = 4, H = 1.1
    ("wall", "hard", 2.0, 0.2818, 0.3250),
    ("wall", "quadratic", 2.0, 0.1677, 0.2113),
    ("high wall", "timonen", 4.0, 0.2517, 0.2840),
    ("step", "none", None, 0.2316, 0.3196),
]


@pytest.mark.parametrize(("name", "falloff", "size", "cosine", "uniform"), FIXTURES)
def test_closed_forms_give_the_published_numbers(name, falloff, size, cosine, uniform):
    scene = screen_scenes.SCENES[name]()
    point = np.array([[-0.7], [0.0], [0.0]])
    arguments = (point,) if size is None else (point, size)
    assert scene.forms["cosine", falloff](*arguments)[0] == pytest.approx(cosine, abs=5e-5)
    assert scene.forms["uniform", falloff](*arguments)[0] == pytest.approx(uniform, abs=5e-5)


def test_limits_are_those_of_the_endless_scenes():
    point = np.array([[-1e-6], [-1e-6], [0.0]])
    corner = screen_scenes.corner(1.0).forms
    assert corner["cosine", "none"](point)[0] == pytest.approx(0.75, abs=1e-4)
    assert corner["uniform", "none"](point)[0] == pytest.approx(0.75, abs=1e-4)
    angle = math.radians(120.0)
    dihedral = screen_scenes.dihedral(angle).forms
    assert dihedral["cosine", "none"](point)[0] == pytest.approx(
        (1 + math.cos(angle)) / 2, abs=1e-5
    )
    assert dihedral["uniform", "none"](point)[0] == pytest.approx(1 - angle / math.pi, abs=1e-5)
    slope = math.radians(40.0)
    bottom = np.array([[1e-6], [0.0], [1e-6 * math.tan(slope)]])
    groove = screen_scenes.groove(slope).forms
    assert groove["cosine", "none"](bottom)[0] == pytest.approx(math.sin(slope) ** 2, abs=1e-5)
    assert groove["uniform", "none"](bottom)[0] == pytest.approx(2 * slope / math.pi, abs=1e-5)


@pytest.mark.parametrize("name", [n for n in screen_scenes.SCENES if n != "plane"])
def test_plain_rays_against_the_surfaces_themselves_find_the_closed_forms(name):
    """No depth image: random rays from the receivers, cut with the scene's own primitives."""
    scene = screen_scenes.SCENES[name]()
    view = screen_scenes.look(scene, "orthographic", 60)
    rows, columns = view.receivers(6)
    assert len(rows)
    rng = np.random.default_rng(11)
    n = 40_000
    for weight, falloff in scene.forms:
        if weight == "volumetric":
            continue
        size = {"timonen": 4.0, "none": None}.get(falloff, 2.0)
        truth = view.truth(weight, rows, columns, falloff, size)
        for k, (row, column) in enumerate(zip(rows, columns, strict=True)):
            point = view.points[:, row, column]
            normal = scene.hit(
                point[:, None] + [[0], [0], [1e-7]], np.array([[0.0], [0.0], [-1.0]])
            )
            up = normal[1][:, 0]
            side = np.cross(up, [0.0, 1.0, 0.0])
            side /= np.linalg.norm(side)
            u, v = (np.arange(n) + rng.random(n)) / n, rng.random(n) * 2 * np.pi
            z = np.sqrt(1 - u) if weight == "cosine" else 1 - u
            r = np.sqrt(1 - z * z)
            ray = np.outer(side, r * np.cos(v)) + np.outer(np.cross(up, side), r * np.sin(v))
            ray += np.outer(up, z)
            start = np.repeat((point + 1e-9 * up)[:, None], n, axis=1)
            distance, _ = scene.hit(start, ray)
            hit = np.isfinite(distance)
            weights = hit * 1.0
            if falloff in ("hard", "quadratic"):
                weights = hit * (distance < 2.0)
            if falloff == "quadratic":
                weights = np.where(weights > 0, 1 - (np.where(hit, distance, 0) / 2.0) ** 2, 0.0)
            if falloff == "timonen":
                weights = np.where(hit, 4.0 / (4.0 + np.where(hit, distance, 0.0) ** 2), 0.0)
            assert weights.mean() == pytest.approx(truth[k], abs=0.012), (weight, falloff, k)


def test_a_view_from_aside_sees_the_same_points():
    scene = screen_scenes.step()
    for projection in ("perspective", "orthographic"):
        view = screen_scenes.look(scene, projection, 40, lean=0.4, pitch=0.3)
        x, _, h = view.points
        # Every point lies on the floor, on the wall or on top of it.
        on = (np.abs(h) < 1e-9) & (x <= 1e-9)
        on |= (np.abs(x) < 1e-9) & (h >= -1e-9) & (h <= 1.1 + 1e-9)
        on |= (np.abs(h - 1.1) < 1e-9) & (x >= -1e-9)
        assert on.all()
        assert np.allclose((view.normals**2).sum(axis=0), 1.0)
