"""Indirect light against a path tracer that nobody here wrote, on the same triangles."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import adret
import path_tracer

pytestmark = pytest.mark.slow

EXAMPLES = Path(__file__).resolve().parents[2] / "examples" / "data"
SKY = EXAMPLES / "sky_512.exr"
ALBEDO = 0.6
CELLS = 300
SAMPLES = 12_000  # paths a cell of each of two seeds
DEPTHS = [2, 3, 5]  # one, two and four bounces


def error_and_noise(terrain: adret.Terrain, depth: int, times: int = 1) -> tuple[float, float]:
    """Mean error over the mean, and the same of the reference: the mean of two seeds."""
    row, column = np.random.default_rng(depth).integers(1, min(terrain.shape) - 1, (2, CELLS))
    sky = adret.Environment.open(SKY)
    tracer = path_tracer.PathTracer(
        terrain.heights,
        terrain.cell_size,
        adret.surface_normals(terrain),
        sky.radiance,
        ALBEDO,
        row,
        column,
    )
    one, other = (tracer.indirect(depth, SAMPLES, seed) for seed in (1, 2))
    want = (one + other) / 2.0
    size = terrain.cell_size[0] / times, terrain.cell_size[1] / times
    fine = adret.Terrain(path_tracer.finer(terrain.elevations(), times), size)
    light = adret.indirect_light(fine, sky, ALBEDO, bounces=depth - 1, directions=64)
    return share(light.irradiance[row * times, column * times], want), share(one, other) / 2.0


def share(got: NDArray[np.floating], want: NDArray[np.floating]) -> float:
    """Mean difference over the mean."""
    return float(abs(got - want).mean() / want.mean())


def beyond(error: float, noise: float) -> float:
    """The part of an error that is not noise."""
    return float(np.sqrt(max(error**2 - noise**2, 0.0)))


@pytest.fixture(scope="module", autouse=True)
def _mitsuba() -> None:
    reason = path_tracer.missing()
    if reason is not None:
        pytest.skip(reason)


@pytest.mark.parametrize("depth", DEPTHS)
def test_hills_agree_cell_by_cell(depth: int) -> None:
    path = EXAMPLES / "jacksboro_fault_epsg4326.tif"
    terrain = adret.Terrain.open(path, window=((100, 220), (100, 220)))
    error, noise = error_and_noise(terrain, depth)
    print(f"jacksboro, depth {depth}: error {error:.4f}, noise {noise:.4f}")
    assert noise < 0.03
    assert beyond(error, noise) < 0.02


@pytest.mark.parametrize("depth", DEPTHS)
def test_mountains_agree_cell_by_cell(depth: int, data_dir: Path) -> None:
    path = data_dir / "dem" / "alpine_bigtujunga_srtm1_utm11_30m.tif"
    terrain = adret.Terrain.open(path, window=((100, 220), (100, 220)))
    error, noise = error_and_noise(terrain, depth)
    print(f"big tujunga, depth {depth}: error {error:.4f}, noise {noise:.4f}")
    assert noise < 0.03
    assert beyond(error, noise) < 0.02


@pytest.mark.parametrize("depth", [2, 5])
def test_rough_mountains_agree_once_their_facets_are_resolved(depth: int) -> None:
    """At 200 m the Alps are so rough from cell to cell that no mesh of them is the right one.

    Cells' mean normals are none of the facets'. On the same triangles, cut finer, they are.
    """
    path = EXAMPLES / "alpine_aletsch_dhm200_lv95_200m.tif"
    terrain = adret.Terrain.open(path, window=((100, 160), (100, 160)))
    error, noise = error_and_noise(terrain, depth, times=8)
    print(f"aletsch, depth {depth}: error {error:.4f}, noise {noise:.4f}")
    assert noise < 0.03
    assert beyond(error, noise) < 0.02
