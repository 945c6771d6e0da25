"""How wide a near field an error asks for: measured on the terrain itself, then by a fitted model.

A pilot sweeps a few azimuths with a near field of `PILOT` cells and compares some cells with the
exact horizon. How the error falls from there with the radius hardly differs from terrain to
terrain, though its size differs by a factor of twenty: `RATIOS` holds that fall, fitted on
mountains at 30 m and on the Moon at 118 m (`benchmarks/results/horizon.md`).
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from adret import methods
from adret._kernels.frames import to_elevation
from adret.horizon_options import HorizonOptions
from adret.horizon_run import HorizonRun
from adret.terrain import Terrain

__all__ = ["PILOT", "RATIOS", "near_for"]

PILOT = 16
AZIMUTHS = 8
CELLS = 1500
MARGIN = 1.1
"""The model's own spread: a promise is kept with this much in hand."""
RATIOS = {
    4: 4.95,
    6: 3.3,
    8: 2.42,
    12: 1.5,
    16: 1.0,
    18: 0.81,
    20: 0.74,
    22: 0.615,
    24: 0.55,
    26: 0.47,
    28: 0.435,
    32: 0.345,
    40: 0.24,
    48: 0.17,
    64: 0.097,
    96: 0.048,
    128: 0.028,
    192: 0.014,
    256: 0.009,
    512: 0.003,
}
"""Near radius [cells] -> mean error, as a multiple of that with `PILOT`."""


def near_for(
    terrain: Terrain,
    azimuths: NDArray[np.float64],
    options: HorizonOptions,
    max_error_deg: float,
) -> tuple[int, float]:
    """Near radius [cells] for a mean error, and the mean error to expect [degrees].

    Parameters
    ----------
    terrain : Terrain
    azimuths : ndarray, shape (K,), float64
    options : HorizonOptions
        Of the run to come; its `near` does not count.
    max_error_deg : float
        Mean of |error| over cells and azimuths [degrees].

    Returns
    -------
    near : int
        The largest radius of the model where even that promises more than was asked for.
    expected_deg : float
    """
    measured = _pilot_error(terrain, azimuths, replace(options, near=PILOT))
    expected = {near: MARGIN * ratio * measured for near, ratio in RATIOS.items()}
    near = next((n for n, error in expected.items() if error <= max_error_deg), max(RATIOS))
    return near, expected[near]


def _pilot_error(terrain: Terrain, azimuths: NDArray[np.float64], options: HorizonOptions) -> float:
    """Mean of |error| of a sweep [degrees] at some cells, towards some of the azimuths."""
    rng = np.random.default_rng(0)
    some = _some(azimuths)
    here = np.flatnonzero(~terrain.mask)
    here = rng.choice(here, min(CELLS, here.size), replace=False)
    row, column = np.divmod(here, terrain.shape[1])
    truth = methods.exact_points(terrain, options, some, row, column)
    exact = np.empty_like(truth)
    to_elevation(truth, exact)
    found = np.empty_like(truth)
    for k, slope in HorizonRun(terrain, some, options).layers():
        found[k] = np.arctan(slope[row, column])
    there = np.isfinite(truth)
    return float(np.degrees(np.abs(found - exact)[there].mean())) if there.any() else 0.0


def _some(azimuths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Azimuths round the circle, each elsewhere in its octant: errors hang on the place in it."""
    ordered, count = np.sort(azimuths), azimuths.size
    if count <= AZIMUTHS:
        return ordered
    each = np.arange(AZIMUTHS)
    return np.asarray(ordered[each * count // AZIMUTHS + each * (count // AZIMUTHS) // AZIMUTHS])
