"""A real room whose solids are thin: slices and far-field scans against rays."""

from pathlib import Path

import numpy as np
import pytest

from adret import DepthBuffer
from adret.screen import ambient_occlusion
from adret.screen.raytraced import Options, trace_at

DATA = Path(__file__).resolve().parents[3] / "examples" / "data"
pytestmark = pytest.mark.slow


@pytest.mark.parametrize(("thickness", "far"), [(0.05, 0.04), (0.3, 0.02)])
def test_thin_solids_come_to_what_rays_find(thickness, far):
    buffer = DepthBuffer.open(DATA / "living_room.npz", DATA / "living_room.json")
    row0, row1, column0, column1 = buffer.frame
    draw = np.random.default_rng(3)
    rows = draw.integers(0, row1 - row0, 500)
    columns = draw.integers(0, column1 - column0, 500)
    known = np.isfinite(buffer.field.depth[rows + row0, columns + column0])
    rows, columns = rows[known], columns[known]
    options = {"radius": 0.5, "falloff": "quadratic", "thickness": thickness}
    rays = Options(rays=2048, **options)
    truth = trace_at(buffer.field, rows + row0, columns + column0, rays).occlusion

    def error(**more):
        found = ambient_occlusion(buffer, **options, **more).occlusion[rows, columns]
        return np.abs(found - truth).mean()

    errors = [error(method="exact", directions=count) for count in (8, 32)]
    assert errors[0] < 0.012
    assert errors[1] < 0.0025
    assert errors[1] < 0.4 * errors[0]
    assert error(method="ffao", points="lines") < far
