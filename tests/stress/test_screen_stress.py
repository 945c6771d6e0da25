"""Ambient occlusion on depth buffers that are hard on arithmetic."""

import warnings

import numpy as np
import pytest
from numpy.typing import NDArray

import adret
from adret.screen import METHODS

NAMES = [name for name in METHODS if name != "lightfield"]


def options(method: str, radius: float) -> dict[str, object]:
    """A radius in view units, and few rays."""
    chosen: dict[str, object] = {"radius": radius}
    if method == "raytraced":
        chosen["rays"] = 16
    if method == "lsao":
        chosen["falloff"] = "quadratic"  # its own is in view units, whatever the radius
    return chosen


def occlusion(depth: NDArray[np.generic], method: str, size: float = 1.0) -> NDArray[np.float32]:
    rows, columns = depth.shape
    camera = adret.Camera.orthographic(columns, rows, extent=(columns * size, rows * size))
    buffer = adret.DepthBuffer(depth, camera)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return adret.ambient_occlusion(
            buffer, method=method, **options(method, 6.0 * size)
        ).occlusion


def ground(rows: int = 20, columns: int = 24) -> NDArray[np.float64]:
    z = np.random.default_rng(2).standard_normal((rows, columns)).cumsum(0).cumsum(1)
    return 40.0 + np.round(z / np.ptp(z) * 256.0) / 32.0


@pytest.mark.parametrize("method", NAMES)
@pytest.mark.parametrize("shape", [(1, 1), (1, 2), (2, 1), (2, 2), (1, 9), (9, 1)])
def test_smallest_images(method: str, shape: tuple[int, int]) -> None:
    found = occlusion(ground()[: shape[0], : shape[1]], method)
    assert ((found >= 0.0) & (found <= 1.0)).all()


@pytest.mark.parametrize("method", NAMES)
@pytest.mark.parametrize("power", [-12, 9])
def test_powers_of_two_change_no_byte(method: str, power: int) -> None:
    scale = 2.0**power
    first = occlusion(ground(), method)
    assert occlusion(ground() * scale, method, scale).tobytes() == first.tobytes()


@pytest.mark.parametrize("method", NAMES)
def test_layout_and_byte_order_change_no_byte(method: str) -> None:
    depth = ground().astype(np.float32)
    first = occlusion(depth, method)
    frozen = depth.copy()
    frozen.setflags(write=False)
    for other in (
        depth.astype(np.float64),
        np.asfortranarray(depth),
        depth[::-1, ::-1].copy()[::-1, ::-1],
        depth.astype(">f4"),
        frozen,
    ):
        assert occlusion(other, method).tobytes() == first.tobytes()


@pytest.mark.parametrize("method", NAMES)
@pytest.mark.parametrize("hole", [np.nan, np.inf, -np.inf, 0.0, -3.0])
def test_what_is_no_depth_stays_where_it_is(method: str, hole: float) -> None:
    for place in [(0, 0), (0, 5), (9, 0), (5, 6), (9, 11)]:
        depth = ground(10, 12)
        depth[place] = hole
        found = occlusion(depth, method)
        here = np.ones(depth.shape, bool)
        here[place] = False
        assert ((found[here] >= 0.0) & (found[here] <= 1.0)).all()
        assert np.isnan(found[place]) or found[place] == 0.0


@pytest.mark.parametrize("method", [name for name in NAMES if name not in ("crytek", "vao")])
@pytest.mark.parametrize("offset", [1.0, 1e3, 1e6])
def test_an_even_wall_is_open_at_any_distance(method: str, offset: float) -> None:
    found = occlusion(np.full((16, 16), offset), method)
    assert np.abs(found).max() <= 1e-5


@pytest.mark.parametrize("method", NAMES)
@pytest.mark.parametrize("relief", [1e-6, 1e6])
def test_extreme_relief_gives_shares(method: str, relief: float) -> None:
    depth = (ground() - 30.0) * relief + 1e-3
    found = occlusion(depth, method)
    assert ((found >= 0.0) & (found <= 1.0)).all()
