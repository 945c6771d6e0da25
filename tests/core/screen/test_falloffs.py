"""Weights of occluders by distance."""

import math

import numpy as np
import pytest

from adret import InputError
from adret._kernels.jit import kernel
from adret._kernels.screen.falloffs import weight
from adret.screen import make_falloff

DISTANCES = np.concatenate([[0.0], np.geomspace(1e-6, 1e6, 400)])


@kernel
def weights_of(code, radius, scale, table, d, out):
    for k in range(len(d)):
        out[k] = weight(code, radius, scale, table, d[k])


def by_kernel(falloff, d):
    out = np.empty(len(d))
    weights_of(*falloff.numbers, d, out)
    return out


def test_names_have_their_formulas_and_end_at_the_radius():
    d = np.array([0.0, 0.5, 1.0, 1.9999, 2.0, 5.0])
    assert make_falloff("none", 2.0).weight(d).tolist() == [1, 1, 1, 1, 0, 0]
    assert make_falloff("hard", 2.0).weight(d).tolist() == [1, 1, 1, 1, 0, 0]
    assert make_falloff("quadratic", 2.0).weight(d[:3]) == pytest.approx([1, 0.9375, 0.75])
    assert make_falloff("timonen", math.inf, 4.0).weight(d) == pytest.approx(4 / (4 + d * d))
    assert make_falloff("quadratic").weight([3.0, 1e9]).tolist() == [1, 1]


@pytest.mark.parametrize("name", ["none", "hard", "quadratic", "timonen"])
@pytest.mark.parametrize("radius", [3.0, math.inf])
def test_kernels_have_the_same_weights(name, radius):
    falloff = make_falloff(name, radius, 2.5)
    assert by_kernel(falloff, DISTANCES) == pytest.approx(falloff.weight(DISTANCES), abs=1e-15)


@pytest.mark.parametrize("radius", [3.0, math.inf])
def test_a_callable_is_tabulated_finely(radius):
    falloff = make_falloff(lambda d: np.exp(-d) / (1.0 + d), radius)
    assert falloff.weight(1.0) == (math.exp(-1.0) / 2.0)
    assert by_kernel(falloff, DISTANCES) == pytest.approx(falloff.weight(DISTANCES), abs=2e-8)


def test_a_table_holds_what_the_falloff_says():
    falloff = make_falloff("timonen", math.inf, 4.0)
    u = np.linspace(0.0, 1.0, 101)[:-1]
    assert falloff.tabulated(101)[:-1] == pytest.approx(falloff.weight(4.0 * u / (1.0 - u)))
    assert falloff.tabulated(101)[-1] < 1e-50


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (("cubic",), "falloff: must be one of none, hard, quadratic, timonen or a callable"),
        ((None,), "falloff: must be"),
        (("none", 0.0), "radius: must be"),
        (("none", math.nan), "radius: must be"),
        (("timonen", 1.0, 0.0), "falloff_scale: must be"),
        ((lambda d: 2.0 * np.ones_like(d),), r"falloff: must be between 0 and 1 .at d = 0.*got 2"),
        ((lambda d: 1.0 - d,), r"falloff: must be between 0 and 1 .at d = 1.0002"),
        ((lambda d: np.full_like(d, np.nan),), "falloff: must be between 0 and 1"),
        ((lambda d: "near",), "falloff: must be a callable of an array"),
        ((lambda d: 1.0 / 0.0,), "ZeroDivisionError"),
    ],
)
def test_what_is_no_falloff_is_refused(given, words):
    with pytest.raises(InputError, match=words):
        make_falloff(*given)
