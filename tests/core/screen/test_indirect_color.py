"""One bounce of colour: form factors, the nearest one counts, linearity, errors."""

import math

import numpy as np
import pytest
from screen_buffers import framed, rough

import screen_scenes
from adret import Cancelled, InputError
from adret._kernels.jit import threads
from adret.screen import ambient_occlusion, indirect_color

PROJECTIONS = ("orthographic", "perspective")


def white(buffer):
    return np.ones((3, *buffer.shape))


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("angle", [100.0, 120.0, 150.0])
def test_a_white_plane_sends_its_form_factor(projection, angle):
    scene = screen_scenes.dihedral(math.radians(angle))
    errors = []
    for pixels in (100, 200):
        view = screen_scenes.look(scene, projection, pixels, lean=0.5)
        buffer, rows, columns = framed(view)
        found = indirect_color(buffer, white(buffer), directions=64)
        light = found[:, rows - rows.min(), columns - columns.min()]
        truth = view.truth("cosine", rows, columns)
        assert np.array_equal(light[0], light[2])
        errors.append(float(np.mean(light[0] - truth)))
    assert abs(errors[1]) < 0.01
    assert abs(errors[1]) < max(0.8 * abs(errors[0]), 0.002)


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_the_stripes_of_a_wall_send_their_own_form_factors(projection):
    view = screen_scenes.look(screen_scenes.step(2.0), projection, 200, lean=0.5)
    buffer, rows, columns = framed(view)
    # Red up to a height of 1, green above; the floor is blue and sees none of itself.
    x, _, height = view.points
    on_wall = height > 1e-9
    colour = np.stack([on_wall & (height < 1.0), on_wall & (height >= 1.0), ~on_wall])
    light = indirect_color(buffer, colour, directions=64)
    red, green, blue = light[:, rows - rows.min(), columns - columns.min()]
    one, two = (np.cos(np.arctan(h / np.abs(x[rows, columns]))) for h in (1.0, 2.0))
    assert np.abs(red - (1.0 - one) / 2.0).mean() < 0.02
    assert np.abs(green - (one - two) / 2.0).mean() < 0.02
    assert blue.max() < 0.01


def test_white_surfaces_with_two_sides_send_the_occlusion():
    for options in (
        {},
        {"radius": 0.8},
        {"radius": 1.2, "falloff": "quadratic", "weight": "uniform"},
        {"falloff": "timonen", "falloff_scale": 0.3},
        {"radius": 1.0, "falloff": lambda d: np.exp(-d), "tile": 2},
    ):
        buffer = rough(True)
        light = indirect_color(buffer, white(buffer), facing=False, **options)
        occlusion = ambient_occlusion(buffer, method="exact", tolerance=0.0, **options).occlusion
        known = ~np.isnan(occlusion)
        assert np.isnan(light[0]).sum() == (~known).sum() == 1
        assert np.abs(light[1] - occlusion)[known].max() < 0.03
        assert np.abs(light[1] - occlusion)[known].mean() < 0.003


def test_backs_are_black():
    buffer = rough(True)
    front = indirect_color(buffer, white(buffer))
    both = indirect_color(buffer, white(buffer), facing=False)
    assert np.nanmin(both - front) >= 0.0
    # Whoever stands behind the block in front sees its unknown side.
    assert both[0, 5, 3] > 0.1
    assert front[0, 5, 3] < 0.5 * both[0, 5, 3]


def test_light_is_linear_in_colour():
    buffer = rough(False)
    draw = np.random.default_rng(3)
    one, two = draw.random((2, 3, *buffer.shape))
    options = {"radius": 1.0, "directions": 7}
    total = indirect_color(buffer, 2.0 * one + two, **options)
    parts = 2.0 * indirect_color(buffer, one, **options) + indirect_color(buffer, two, **options)
    assert np.allclose(total, parts, atol=1e-5, equal_nan=True)
    assert np.nanmax(indirect_color(buffer, 0.0 * one, **options)) == 0.0


def test_sky_and_holes_and_their_colours_do_not_matter():
    buffer = rough(True)
    colour = white(buffer)
    plain = indirect_color(buffer, colour)
    colour[:, ~np.isfinite(buffer.depth)] = np.nan
    assert np.array_equal(indirect_color(buffer, colour), plain, equal_nan=True)
    assert np.isnan(plain[:, 1, 2]).all()
    assert np.all(plain[:, 10:, 3:5] == 0.0)
    assert plain.dtype == np.float32


def test_one_thread_and_two_give_the_same_bytes_and_a_frame_is_a_window():
    buffer = rough(True)
    colour = np.random.default_rng(1).random((3, *buffer.shape))
    before = threads()
    try:
        results = []
        for count in (1, min(2, before)):
            threads(count)
            results.append(indirect_color(buffer, colour, radius=0.8))
    finally:
        threads(before)
    assert results[0].tobytes() == results[1].tobytes()
    inner = indirect_color(rough(True, guard_band=(3, 5, 1, 2)), colour, radius=0.8)
    assert inner.tobytes() == results[0][:, 3:12, 2:12].tobytes()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"color": np.ones((13, 17))}, r"color: must be of shape \(3, 13, 17\)"),
        ({"color": np.full((3, 13, 17), np.inf)}, "color: must be finite where there is a surface"),
        ({"color": "red"}, "color: must be numbers"),
        ({"thickness": 1.0}, "thickness: must be an option of 'indirect_color'"),
        ({"directions": 0}, "directions: must be"),
        ({"facing": 2}, "facing: must be"),
        ({"buffer": np.ones((13, 17))}, "buffer: must be a DepthBuffer"),
    ],
)
def test_bad_input_is_named(change, message):
    buffer = rough(True)
    given = {"buffer": buffer, "color": white(buffer), **change}
    with pytest.raises(InputError, match=message):
        indirect_color(given.pop("buffer"), given.pop("color"), **given)


def test_a_run_can_be_watched_and_stopped():
    buffer = rough(True)
    steps = []
    indirect_color(buffer, white(buffer), progress=lambda *each: steps.append(each))
    assert steps[0] == (0, 13)
    assert steps[-1] == (13, 13)

    def stop(done, total):
        raise Cancelled("enough")

    with pytest.raises(Cancelled):
        indirect_color(buffer, white(buffer), progress=stop)
