"""How far the fast methods stay from the exact horizon, on real, rough and smooth ground.

Figures in degrees over all cells and 16 azimuths; the bounds leave a factor of about 1.5 to what
was measured.  `benchmarks/` measures the same on larger rasters.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import adret
import scenes

Degrees = NDArray[np.float64]


@dataclass(frozen=True)
class Ground:
    """A terrain, its exact horizons, and where they lie on the raster's last row or column."""

    terrain: adret.Terrain
    exact: Degrees
    at_edge: NDArray[np.bool_]


def alps(example_dem: Path) -> adret.Terrain:
    return adret.Terrain.open(example_dem).window((60, 260), (80, 300))


def rough(_: Path) -> adret.Terrain:
    z = scenes.fractal(np.random.default_rng(1), (180, 220), relief=1200.0)
    return adret.Terrain(z, (30.0, 24.0))


def smooth(_: Path) -> adret.Terrain:
    x, y = scenes.metres((180, 220), (30.0, 30.0))
    waves = 300.0 * np.sin(x / 700.0) * np.cos(y / 900.0) + 200.0 * np.cos((x + y) / 1500.0)
    return adret.Terrain(waves, (30.0, 30.0))


@pytest.fixture(scope="module", params=[alps, rough, smooth], ids=["alps", "rough", "smooth"])
def ground(request: pytest.FixtureRequest, example_dem: Path) -> Ground:
    """One of the terrains with its truth."""
    make: Callable[[Path], adret.Terrain] = request.param
    terrain = make(example_dem)
    exact = adret.horizon_map(terrain, 16, method="exact", distance=True)
    assert exact.distance is not None
    rows, columns = terrain.shape
    (dx, dy), (i, j) = terrain.cell_size, np.mgrid[0:rows, 0:columns]
    at_edge = np.zeros(exact.elevation.shape, dtype=bool)
    for k, azimuth in enumerate(exact.azimuth):
        to_row = i * dy if np.cos(azimuth) > 0 else (rows - 1 - i) * dy
        to_column = (columns - 1 - j) * dx if np.sin(azimuth) > 0 else j * dx
        with np.errstate(divide="ignore", invalid="ignore"):
            leaves = np.fmin(to_row / abs(np.cos(azimuth)), to_column / abs(np.sin(azimuth)))
        at_edge[k] = leaves - exact.distance[k] < 1.6 * max(dx, dy)
    return Ground(terrain, np.degrees(exact.elevation.astype(np.float64)), at_edge)


def off(ground: Ground, where: str = "everywhere", **options: object) -> Degrees:
    """Error [degrees] wherever terrain lies in the direction."""
    found = np.degrees(
        adret.horizon_map(ground.terrain, 16, **options).elevation  # type: ignore[arg-type]
    )
    there = ground.exact > -89.99
    if where == "inside":
        there &= ~ground.at_edge
    elif where == "edge":
        there &= ground.at_edge
    return np.asarray((found - ground.exact)[there])


@pytest.mark.parametrize(
    ("near", "mean", "p99", "above"),
    [(8, 0.22, 3.8, 1.2), (16, 0.075, 1.4, 0.7), (32, 0.02, 0.4, 0.35), (64, 0.0045, 0.12, 0.15)],
)
def test_sweep_error(ground: Ground, near: int, mean: float, p99: float, above: float) -> None:
    error = off(ground, "inside", method="sweep", near=near)
    assert np.abs(error).mean() < mean
    assert np.quantile(np.abs(error), 0.99) < p99
    assert np.quantile(error, 0.999) < above


def test_horizon_on_the_rasters_edge(ground: Ground) -> None:
    """The last crossing of a cell's own ray is found although no line need hold it."""
    error = np.abs(off(ground, "edge"))
    assert error.mean() < 0.01
    assert np.quantile(error, 0.99) < 0.2


def test_default_sweep_keeps_its_promise(ground: Ground) -> None:
    error = np.abs(off(ground))
    assert error.mean() <= 0.03
    assert np.quantile(error, 0.99) <= 0.4


def test_wider_near_field_is_more_accurate(ground: Ground) -> None:
    means = [np.abs(off(ground, near=near)).mean() for near in (0, 4, 8, 16, 32, 64, 256)]
    assert means == sorted(means, reverse=True)
    assert means[-1] < 1e-4  # the whole raster is near


def test_march_never_rises_above_the_exact_horizon(ground: Ground) -> None:
    """Its samples are some of the exact crossings."""
    error = off(ground, method="march")
    assert error.max() < 2e-4
    assert np.abs(error).mean() < 0.1


def test_published_form_has_the_error_of_its_lines(ground: Ground) -> None:
    error = np.abs(off(ground, method="hull"))
    assert 0.02 < error.mean() < 1.8
