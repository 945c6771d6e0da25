"""Exact slices on a depth buffer of a real room, against thousands of rays from each pixel."""

import itertools
from pathlib import Path

import numpy as np
import pytest

from adret import DepthBuffer
from adret.screen import ambient_occlusion
from adret.screen.raytraced import Options, trace_at

DATA = Path(__file__).resolve().parents[3] / "examples" / "data"


@pytest.fixture(scope="module")
def room():
    """The buffer, and pixels spread over its frame."""
    buffer = DepthBuffer.open(DATA / "living_room.npz", DATA / "living_room.json")
    row0, row1, column0, column1 = buffer.frame
    draw = np.random.default_rng(1)
    rows = draw.integers(0, row1 - row0, 500)
    columns = draw.integers(0, column1 - column0, 500)
    return buffer, rows, columns


def traced(room, **options):
    buffer, rows, columns = room
    row0, _, column0, _ = buffer.frame
    truth = trace_at(buffer.field, rows + row0, columns + column0, Options(**options))
    assert truth.noise < 0.0016
    return truth.occlusion


def errors(room, truth, **options):
    buffer, rows, columns = room
    found = ambient_occlusion(buffer, method="exact", **options)
    return np.abs(found.occlusion[rows, columns] - truth)


def test_the_error_falls_with_the_number_of_directions_to_a_thousandth(room):
    truth = traced(room, rays=4608)
    found = {k: errors(room, truth, directions=k) for k in (4, 8, 32, 128)}
    means = [float(error.mean()) for error in found.values()]
    assert all(later < earlier for earlier, later in itertools.pairwise(means))
    assert means[2] <= 0.01
    assert (found[32] < 0.05).mean() >= 0.97
    assert means[3] <= 0.005
    assert (found[128] < 0.05).mean() >= 0.99


@pytest.mark.parametrize(
    ("options", "mean"),
    [
        ({"radius": 0.5, "falloff": "quadratic"}, 0.004),
        ({"weight": "uniform"}, 0.01),
    ],
)
def test_other_integrals_are_as_near(room, options, mean):
    truth = traced(room, rays=4608, **options)
    error = errors(room, truth, directions=32, **options)
    assert error.mean() <= mean
    assert (error < 0.05).mean() >= 0.97
