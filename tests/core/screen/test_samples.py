"""Sets of samples: where they lie and how evenly."""

import numpy as np
import pytest

from adret import InputError
from adret.screen.samples import (
    SAMPLERS,
    disk_samples,
    rotations,
    shell_samples,
    square_samples,
)


def nearest(points: np.ndarray, period: float | None = None) -> float:
    way = np.abs(points[:, None] - points[None])
    if period is not None:
        way = np.minimum(way, period - way)
    distance = np.sqrt((way**2).sum(axis=2))
    np.fill_diagonal(distance, np.inf)
    return float(distance.min())


def test_poisson_points_keep_apart_on_the_torus_and_random_ones_do_not():
    for count in (9, 16, 64):
        packed = 2.0 * np.sqrt(np.sqrt(4.0 / 3.0) / count)
        kept = [nearest(square_samples("poisson", count, seed), 2.0) for seed in range(5)]
        loose = [nearest(square_samples("cylindrical", count, seed), 2.0) for seed in range(5)]
        assert min(kept) > 0.55 * packed
        assert np.mean(loose) < 0.5 * np.mean(kept)


def test_disk_points_are_kept_apart_and_uniform_on_average():
    points = np.stack([disk_samples(12, seed) for seed in range(120)])
    radius2 = (points**2).sum(axis=2)
    assert radius2.max() <= 1.0
    assert radius2.mean() == pytest.approx(0.5, abs=0.01)
    assert np.abs(points.mean(axis=(0, 1))).max() < 0.02
    assert min(nearest(each) for each in points) > 0.25
    # In the longest run, lengths of pipes average what they do over the disk.
    assert np.sqrt(1.0 - radius2).mean() == pytest.approx(2.0 / 3.0, abs=0.01)


def test_stratified_disk_points_have_one_ring_of_equal_area_each():
    points = disk_samples(16, 3, stratified=True)
    radius2 = np.sort((points**2).sum(axis=1))
    assert np.allclose(radius2, (np.arange(16) + 0.5) / 16)
    loose = disk_samples(16, 3)
    turned = np.arctan2(*loose.T) - np.arctan2(*points.T)
    assert np.allclose(np.angle(np.exp(1j * turned)), 0.0, atol=1e-9)


@pytest.mark.parametrize("count", [1, 4, 7, 8, 12])
def test_jittered_points_fill_a_grid(count):
    points = 0.5 * square_samples("jittered", count, 1) + 0.5
    grids = {1: (1, 1), 4: (2, 2), 7: (2, 3), 8: (2, 4), 12: (3, 4)}
    rows, columns = grids[count]
    cells = {(int(y * rows), int(x * columns)) for x, y in points[: rows * columns]}
    assert len(cells) == rows * columns
    assert len(points) == count


def test_latin_points_have_a_row_and_a_column_each():
    points = 0.5 * square_samples("latin", 9, 4) + 0.5
    for axis in (0, 1):
        assert sorted((points[:, axis] * 9).astype(int)) == list(range(9))


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_shell_points_are_uniform_in_their_shell(sampler):
    points = np.concatenate([shell_samples(sampler, 16, seed) for seed in range(100)])
    radius = np.linalg.norm(points, axis=1)
    assert radius.min() >= 0.8
    assert radius.max() <= 1.0
    # Cubes of radii, heights and longitudes are uniform.
    assert (radius**3).mean() == pytest.approx(0.5 * (1.0 + 0.8**3), abs=0.006)
    assert np.abs((points / radius[:, None]).mean(axis=0)).max() < 0.04
    assert ((points[:, 2] / radius) ** 2).mean() == pytest.approx(1.0 / 3.0, abs=0.02)


def test_rotations_turn_and_nothing_else_and_reach_every_way():
    turns = rotations(2000, 1)
    assert np.allclose(turns @ turns.transpose(0, 2, 1), np.eye(3), atol=1e-12)
    assert np.allclose(np.linalg.det(turns), 1.0)
    assert np.abs(turns.mean(axis=0)).max() < 0.04
    assert (turns[:, 2, 0] ** 2).mean() == pytest.approx(1.0 / 3.0, abs=0.03)


def test_the_same_seed_gives_the_same_points_and_another_does_not():
    for draw in (disk_samples, rotations, lambda n, s: shell_samples("poisson", n, s)):
        assert np.array_equal(draw(8, 5), draw(8, 5))
        assert not np.array_equal(draw(8, 5), draw(8, 6))


def test_what_cannot_be_used_is_refused_by_name():
    with pytest.raises(InputError, match="samples: must be a whole number from 1 to 4096, got 0"):
        disk_samples(0)
    with pytest.raises(InputError, match="seed: must be a whole number of 0 or more, got -1"):
        square_samples("poisson", 4, -1)
    with pytest.raises(InputError, match=r"inner: must be between 0 and 1, got 1\.5"):
        shell_samples("latin", 4, 0, 1.5)
    with pytest.raises(InputError, match="sampler: must be one of cylindrical, jittered"):
        square_samples("halton", 4)
