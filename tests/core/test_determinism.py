"""The same bytes every time: again, and with any number of threads."""

from collections.abc import Iterator

import numpy as np
import pytest

import adret
import scenes
from adret._kernels import jit

METHODS = ["exact", "sweep", "march", "hull"]


@pytest.fixture
def terrain(rng: np.random.Generator) -> adret.Terrain:
    z = scenes.fractal(rng, (120, 150), relief=400.0)
    z[rng.random(z.shape) < 0.003] = np.nan
    return adret.Terrain(z, (10.0, 12.5), datum=200.0)


@pytest.fixture
def any_thread_count() -> Iterator[int]:
    """More threads than one, put back afterwards."""
    before = jit.threads()
    if before < 2:
        pytest.skip("this process may use one thread only")
    yield before
    jit.threads(before)


def products(terrain: adret.Terrain, method: str) -> dict[str, bytes]:
    """Every result of one method, as bytes."""
    options = {"method": method, "radius": 6_371_000.0}
    located = method in ("exact", "sweep")
    cube = adret.horizon_map(terrain, 16, distance=located, **options)
    sun = adret.Sun(250.0, 12.0)
    found = {
        "elevation": cube.elevation,
        "distance": cube.elevation if cube.distance is None else cube.distance,
        "openness": adret.openness(terrain, directions=16, **options),
        "lit": adret.shadow(terrain, sun, **options).lit,
        "code": adret.shadow(terrain, sun, **options).code,
        "uniform": adret.direct_light(terrain, adret.UniformSky(), 16, **options).irradiance,
        "overcast": adret.direct_light(terrain, adret.OvercastSky(), 16, **options).irradiance,
        "sun": adret.direct_light(terrain, sun, **options).irradiance,
    }
    for kind in ("visible", "horizontal", "normal"):
        found[kind] = adret.sky_view_factor(terrain, kind=kind, directions=16, **options)
    return {name: layer.tobytes() for name, layer in found.items()}


@pytest.mark.parametrize("method", METHODS)
def test_same_bytes_again_and_on_one_thread(
    method: str, terrain: adret.Terrain, any_thread_count: int
) -> None:
    first = products(terrain, method)
    again = products(terrain, method)
    jit.threads(1)
    alone = products(terrain, method)
    for name, data in first.items():
        assert again[name] == data, f"{name} differs from run to run"
        assert alone[name] == data, f"{name} differs with one thread"


def test_memory_order_of_the_input_does_not_matter(rng: np.random.Generator) -> None:
    z = scenes.fractal(rng, (30, 40))
    first = adret.horizon_map(adret.Terrain(z, (1.0, 1.0)), 16).elevation
    other = adret.horizon_map(adret.Terrain(np.asfortranarray(z), (1.0, 1.0)), 16).elevation
    strided = np.repeat(np.repeat(z, 2, axis=0), 3, axis=1)[::2, ::3]
    third = adret.horizon_map(adret.Terrain(strided, (1.0, 1.0)), 16).elevation
    assert first.tobytes() == other.tobytes() == third.tobytes()
