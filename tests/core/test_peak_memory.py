"""Products of many azimuths hold a few layers, never one an azimuth."""

import subprocess
import sys
from pathlib import Path

import pytest

PEAK = """
import sys
import numpy as np
import adret
from adret._kernels import jit
SIDE, AZIMUTHS = 1000, 24
PRODUCTS = {
    "sky view": lambda t: adret.sky_view_factor(t, "normal", AZIMUTHS, near=8),
    "openness": lambda t: adret.openness(t, directions=AZIMUTHS, near=8),
    "light": lambda t: adret.direct_light(t, adret.UniformSky(), AZIMUTHS, near=8),
}
def status(name):
    lines = open("/proc/self/status").read().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(name))
make = PRODUCTS[sys.argv[1]]
jit.threads(1)
make(adret.Terrain(np.zeros((20, 20)), (1.0, 1.0)))
terrain = adret.Terrain(np.random.default_rng(0).random((SIDE, SIDE)), (1.0, 1.0))
open("/proc/self/clear_refs", "w").write("5")  # the peak so far is forgotten
before = status("VmRSS")
made = make(terrain)
layer = SIDE * SIDE * 4 / 2**20
rise = status("VmHWM") - before
assert rise <= layer + 64.0, rise
assert AZIMUTHS * layer > layer + 64.0
"""


@pytest.mark.skipif(
    not Path("/proc/self/clear_refs").exists(), reason="peaks are read from Linux's /proc"
)
@pytest.mark.parametrize("product", ["sky view", "openness", "light"])
def test_the_peak_rises_by_the_output_and_64_mib_at_most(product: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", PEAK, product], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
