"""Time of the methods that look arbitrarily far does not depend on the radius."""

import math
import time

import numpy as np
import pytest

from adret import Camera, DepthBuffer
from adret.screen import ffao, lsao


@pytest.mark.slow
@pytest.mark.parametrize(
    ("module", "options"),
    [(lsao, {"directions": 8}), (ffao, {"directions": 9, "separation": True})],
    ids=["lsao", "ffao"],
)
def test_time_is_the_same_from_eight_pixels_to_unlimited(module, options):
    """Processor time, the least of many short runs that take turns."""
    draw = np.random.default_rng(3)
    y, x = np.mgrid[0:300, 0:480]
    waves = sum(np.sin(a * x + b * y + c) for a, b, c in draw.uniform(-0.2, 0.2, (8, 3)))
    buffer = DepthBuffer(20.0 + waves, Camera.perspective(480, 300, fov_y_deg=60.0))
    field = buffer.field
    pixel = abs(field.rays[0]) * float(np.median(buffer.depth))
    runs = {}
    for radius in (8.0, 64.0, math.inf):
        scale = 0.5 * pixel * min(radius, 300.0)
        runs[radius] = module.Options(
            radius=radius * pixel, falloff="timonen", falloff_scale=scale * scale, **options
        )
    least = dict.fromkeys(runs, math.inf)
    module.estimate(field, runs[8.0], None)
    for _ in range(15):
        for radius, chosen in runs.items():
            start = time.process_time()
            module.estimate(field, chosen, None)
            least[radius] = min(least[radius], time.process_time() - start)
    assert max(least.values()) < 1.15 * min(least.values())
