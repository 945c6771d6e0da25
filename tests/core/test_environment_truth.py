"""Light of a real sky picture on rough ground, against the sum over the pixels it sees."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import adret
import oracles
import scenes

CELL = (10.0, 12.0)


CELLS = [(16, 18), (5, 30), (27, 7), (30, 33)]
FINE = 6  # strips that a row of pixels is cut into


@pytest.fixture(scope="module")
def heights() -> NDArray[np.float64]:
    return scenes.fractal(np.random.default_rng(11), (33, 37), relief=90.0)


@pytest.fixture(scope="module")
def summed_light(data_dir: Path, heights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Irradiance (cells, bands): every pixel in `FINE` strips, each column with its own horizon.

    Column u of the picture looks towards azimuth 2πu - π/2, row v to elevation π/2 - πv.
    """
    picture = adret.Environment.open(data_dir / "hdr" / "sky_512.exr").radiance
    picture = np.repeat(picture, FINE, axis=0)
    rows, columns = picture.shape[:2]
    azimuths = (np.arange(columns) + 0.5) / columns * 2.0 * np.pi - np.pi / 2.0
    borders = np.linspace(np.pi / 2.0, -np.pi / 2.0, rows + 1)
    azimuth, elevation = np.meshgrid(azimuths, (borders[1:] + borders[:-1]) / 2.0)
    strip = (np.sin(borders[:-1]) - np.sin(borders[1:])) * 2.0 * np.pi / columns
    horizon = oracles.horizons(heights, CELL, CELLS, azimuths)
    return np.array(
        [
            oracles.environment_irradiance(
                picture,
                azimuth,
                elevation,
                np.broadcast_to(strip[:, None], azimuth.shape),
                lambda a, cell=k: np.broadcast_to(horizon[:, cell], a.shape),
                oracles.normal(heights, CELL, *cell),
            )
            for k, cell in enumerate(CELLS)
        ]
    )


@pytest.mark.parametrize(
    ("directions", "normal_angles", "bound"),
    [(64, None, 6e-4), (512, None, 2e-4), (64, 65, 1e-3)],
)
def test_environment_light_is_the_sum_over_its_pixels(
    directions: int,
    normal_angles: int | None,
    bound: float,
    data_dir: Path,
    heights: NDArray[np.float64],
    summed_light: NDArray[np.float64],
) -> None:
    sky = adret.Environment.open(data_dir / "hdr" / "sky_512.exr", normal_angles=normal_angles)
    terrain = adret.Terrain(heights, CELL, datum=45.0)
    light = adret.direct_light(terrain, sky, directions, method="exact").irradiance
    found = np.array([light[cell] for cell in CELLS])
    np.testing.assert_allclose(found, summed_light, rtol=bound)
