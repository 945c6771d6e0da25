"""Ambient occlusion over images of positions, with maps that no matrix can do."""

import numpy as np
import pytest
from screen_buffers import camera_of, depth_at, measured, pixel, point, rough

import screen_scenes
from adret import DepthBuffer, InputError
from adret.screen import LookupMap, PositionsBuffer, ambient_occlusion
from adret.screen.lightfield import Options
from adret.screen.samples import rotations, shell_samples

PROJECTIONS = ("orthographic", "perspective")


def camera_map(buffer: DepthBuffer):
    """The buffer's own camera as a map; depth as it is linear over images of planes."""
    ax, bx, ay, by = buffer.camera.rays

    def map_of(points):
        z = -points[2]
        scale = z if buffer.camera.perspective_divide else 1.0
        depth = -1.0 / z if buffer.camera.perspective_divide else z
        return np.stack(
            [(points[0] / scale - bx) / ax + 0.5, (points[1] / scale - by) / ay + 0.5, depth]
        )

    return map_of


def positions_of(buffer: DepthBuffer) -> np.ndarray:
    rows, columns = buffer.shape
    found = np.full((3, rows, columns), np.nan)
    for row in range(rows):
        for column in range(columns):
            if not np.isnan(buffer.depth[row, column]):
                found[:, row, column] = point(buffer, row, column)
    return found


def light_field_screen(points):
    """A display with horizontal parallax alone: x is seen from one point, y from another.

    As on a screen whose modules stand behind it and whose watcher stands on a line before it.
    """
    x, y, z = points
    column = 60.0 + 20.0 * x * 5.0 / (5.0 - z)
    row = 40.0 - 20.0 * y * 9.0 / (9.0 - z)
    return np.stack([column, row, -z])


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_a_plane_is_one_half_and_a_wall_adds_a_quarter_of_what_it_cuts_off(projection):
    view = screen_scenes.look(screen_scenes.wall(reach=(0.1, 2.5)), projection, 160)
    found, rows, columns, _ = measured(view, method="lightfield", radius=2.0, samples=128, tile=8)
    distance = -view.points[0, rows, columns]
    truth = np.full(distance.shape, 0.5)
    # Mean of (1 - a/l)/4 over the lengths l of the shell, uniform in its volume.
    lengths = np.linspace(1.6, 2.0, 2001)
    for k, away in enumerate(distance):
        cut = np.maximum(0.0, 1.0 - away / lengths) * lengths**2
        truth[k] += 0.25 * cut.mean() / (lengths**2).mean()
    assert np.abs((found - truth).mean()) < 0.004
    assert np.abs(found - truth).max() < 0.08
    assert truth.max() > 0.7


@pytest.mark.parametrize("perspective", [True, False])
@pytest.mark.parametrize("sampler", ["cylindrical", "jittered", "latin", "poisson"])
def test_it_equals_a_loop_written_from_the_paper(perspective, sampler):
    buffer = rough(perspective)
    options = {"radius": 0.6, "sampler": sampler, "radii": 5, "ratio": 0.7, "seed": 2}
    result = ambient_occlusion(buffer, method="lightfield", **options)
    samples, turns = shell_samples(sampler, 8, 2), rotations(16, 2)
    for row in range(0, buffer.shape[0], 2):
        for column in range(buffer.shape[1]):
            if np.isnan(buffer.depth[row, column]):
                continue
            here, largest = point(buffer, row, column), 0.0
            for k in range(5):
                closed = 0.0
                for sample in samples:
                    turned = turns[row % 4 * 4 + column % 4] @ sample
                    place = here + 0.6 * 0.7**k * turned
                    at = pixel(buffer, place)
                    if at is None:
                        closed += 0.5
                    else:
                        surface = depth_at(buffer, *at)
                        closed += not np.isnan(surface) and surface < -place[2]
                largest = max(largest, closed / 8)
            assert result.occlusion[row, column] == pytest.approx(largest, abs=1e-6)


@pytest.mark.parametrize("perspective", [True, False])
def test_positions_give_what_the_depth_buffer_gives(perspective):
    buffer = rough(perspective)
    options = {"method": "lightfield", "radius": 0.5, "radii": 2}
    by_depth = ambient_occlusion(buffer, **options)
    positions = PositionsBuffer(positions_of(buffer), camera_map(buffer))
    by_positions = ambient_occlusion(positions, **options)
    known = ~np.isnan(buffer.depth)
    difference = np.abs(by_depth.occlusion - by_positions.occlusion)[known]
    assert (difference > 1e-6).mean() < 0.01  # a sample may lie on the surface to a rounding
    # Beside sky the one falls back on the nearest pixel, and so does the other.
    assert np.all(by_positions.occlusion[~known] == 0.0)
    assert np.all(by_positions.confidence[~known] == 0.0)
    assert np.allclose(by_depth.confidence[known], by_positions.confidence[known], atol=1e-6)


def bumps(x, y):
    return 0.4 * np.sin(3.0 * x) * np.cos(2.0 * y) - 0.3 * (np.abs(x) > 1.0)


def seen_by_screen(shape=(80, 120)) -> np.ndarray:
    """Positions on the surface z = bumps(x, y) that each pixel of the light-field screen shows."""
    row, column = np.mgrid[0 : shape[0], 0 : shape[1]] + 0.5
    z = np.zeros(shape)
    for _ in range(200):
        x = (column - 60.0) / 20.0 * (5.0 - z) / 5.0
        y = (40.0 - row) / 20.0 * (9.0 - z) / 9.0
        z = 0.5 * z + 0.5 * bumps(x, y)
    return np.stack([x, y, z])


def test_a_map_without_an_inverse_matrix_gives_the_solid_share_of_its_surface():
    positions = seen_by_screen()
    buffer = PositionsBuffer(positions, light_field_screen)
    options = {"radius": 0.5, "samples": 64, "tile": 1, "seed": 1}
    found = ambient_occlusion(buffer, method="lightfield", **options)
    inside = (slice(20, 60), slice(20, 100))
    x, y, z = positions[(slice(None), *inside)]
    closed = np.zeros(x.shape)
    for a, b, c in 0.5 * shell_samples("poisson", 64, 1):
        closed += z + c < bumps(x + a, y + b)
    # Away from its steps nothing hides the surface, and the surface itself says what is solid.
    difference = (found.occlusion[inside] - closed / 64)[np.abs(np.abs(x) - 1.0) > 0.6]
    assert difference.size > 500
    assert np.abs(difference).mean() < 0.002
    assert abs(difference.mean()) < 0.001
    assert found.camera is None


def test_a_lookup_map_gives_what_its_callable_gives():
    positions = seen_by_screen()
    table = LookupMap.of(light_field_screen, (-4.5, -3.5, -2.0), (4.5, 3.5, 2.0), (91, 71, 81))
    options = {"method": "lightfield", "radius": 0.4, "samples": 16}
    exact = ambient_occlusion(PositionsBuffer(positions, light_field_screen), **options)
    looked_up = ambient_occlusion(PositionsBuffer(positions, table), **options)
    assert np.abs(exact.occlusion - looked_up.occlusion).mean() < 1e-3


def test_a_lookup_map_interpolates_linear_maps_exactly_and_knows_its_border():
    table = LookupMap.of(lambda p: 2.0 * p + p[::-1], (0, -1, 2), (3, 1, 5), (4, 3, 2))
    points = np.random.default_rng(0).uniform((0, -1, 2), (3, 1, 5), (50, 3)).T
    assert np.allclose(table(points), 2.0 * points + points[::-1])
    assert np.isfinite(table(np.array([[3.0], [1.0], [5.0]]))).all()
    assert np.isnan(table(np.array([[3.0 + 1e-9], [1.0], [5.0]]))).all()


def test_several_views_in_one_call_are_the_views_one_by_one():
    first = seen_by_screen()

    def shifted(points):
        return light_field_screen(points + np.array([[0.1], [0.0], [0.0]]))

    second = first - np.array([0.1, 0.0, 0.0])[:, None, None]
    options = {"method": "lightfield", "radius": 0.3}
    both = ambient_occlusion(
        PositionsBuffer(np.stack([first, second]), [light_field_screen, shifted]), **options
    )
    assert both.occlusion.shape == (2, 80, 120)
    for k, (positions, map_of) in enumerate(((first, light_field_screen), (second, shifted))):
        single = ambient_occlusion(PositionsBuffer(positions, map_of), **options)
        assert np.array_equal(both.occlusion[k], single.occlusion)
        assert np.array_equal(both.confidence[k], single.confidence)


def test_more_shells_never_lower_the_occlusion_and_find_what_is_small():
    buffer = PositionsBuffer(seen_by_screen(), light_field_screen)
    options = {"method": "lightfield", "radius": 0.8}
    one = ambient_occlusion(buffer, **options).occlusion
    five = ambient_occlusion(buffer, radii=5, **options).occlusion
    assert np.all(five >= one)
    assert (five - one).mean() > 0.03


def test_progress_counts_to_the_end_and_can_stop_the_run():
    buffer = PositionsBuffer(seen_by_screen(), light_field_screen)
    steps = []
    ambient_occlusion(
        buffer, method="lightfield", radius=0.1, progress=lambda *each: steps.append(each)
    )
    assert steps[0] == (0, 1)
    assert steps[-1] == (1, 1)

    def stop(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ambient_occlusion(buffer, method="lightfield", progress=stop)


def test_power_and_intensity_act_as_on_depth_buffers():
    buffer = PositionsBuffer(seen_by_screen(), light_field_screen)
    plain = ambient_occlusion(buffer, method="lightfield", radius=0.4).occlusion
    strong = ambient_occlusion(
        buffer, method="lightfield", radius=0.4, intensity=1.5, power=2.0
    ).occlusion
    expected = 1.0 - (1.0 - np.minimum(1.5 * plain, 1.0)) ** 2
    assert np.allclose(strong, expected, atol=1e-6)


def test_what_cannot_be_used_is_refused_by_name():
    good = seen_by_screen()
    with pytest.raises(InputError, match="positions: must be real, of shape"):
        PositionsBuffer(np.zeros((2, 4, 4)), light_field_screen)
    with pytest.raises(InputError, match="world_to_image: must be 1 callables"):
        PositionsBuffer(good, [light_field_screen, light_field_screen])
    with pytest.raises(InputError, match="world_to_image: must be a map of view 0 that takes"):
        PositionsBuffer(good, lambda p: light_field_screen(p) + 5.0)
    with pytest.raises(InputError, match="world_to_image: must be a callable that returns"):
        PositionsBuffer(good, lambda p: p[:2])
    with pytest.raises(InputError, match="world_to_image: must be a callable of world positions"):
        PositionsBuffer(good, lambda p: p["x"])
    with pytest.raises(InputError, match="method: must be 'lightfield' for images of positions"):
        ambient_occlusion(PositionsBuffer(good, light_field_screen), method="vao")
    with pytest.raises(InputError, match="table: must be of shape"):
        LookupMap(np.zeros(3), np.ones(3), np.zeros((3, 1, 4, 4)))
    with pytest.raises(InputError, match="high: must be above low"):
        LookupMap(np.zeros(3), np.zeros(3), np.zeros((3, 4, 4, 4)))
    with pytest.raises(InputError, match="sampler: must be one of"):
        Options(sampler="sobol")


def test_a_view_that_shows_nothing_is_open():
    empty = PositionsBuffer(np.full((3, 4, 5), np.nan), light_field_screen)
    result = ambient_occlusion(empty, method="lightfield")
    assert np.all(result.occlusion == 0.0)
    assert np.all(result.confidence == 0.0)
    assert result.report.skipped["sky"] == 20


def test_the_field_and_its_camera_stay_what_they_are():
    view = screen_scenes.look(screen_scenes.plane(), "perspective", 20)
    buffer = DepthBuffer(view.depth, camera_of(view))
    before = buffer.depth.copy()
    ambient_occlusion(buffer, method="lightfield", radii=3)
    assert np.array_equal(before, buffer.depth)
