"""Surface normals: planes, edges, nodata, geographic rasters."""

import numpy as np
import pytest
from affine import Affine

import adret
import oracles
from adret._kernels import horizon_integrals
from adret.normals import surface_slopes


@pytest.mark.parametrize("slope_deg", [0.0, 5.0, 45.0, 85.0])
@pytest.mark.parametrize("aspect_deg", [0.0, 30.0, 250.0])
def test_plane_has_one_normal_up_to_its_edges(slope_deg: float, aspect_deg: float) -> None:
    slope, aspect = np.radians(slope_deg), np.radians(aspect_deg)
    row, column = np.mgrid[0:7, 0:9]
    heights = -np.tan(slope) * (column * 3.0 * np.sin(aspect) - row * 5.0 * np.cos(aspect))
    normals = adret.surface_normals(adret.Terrain(heights, (3.0, 5.0)))
    want = [np.sin(slope) * np.sin(aspect), np.sin(slope) * np.cos(aspect), np.cos(slope)]
    np.testing.assert_allclose(
        normals, np.broadcast_to(want, (7, 9, 3)).T.swapaxes(1, 2), atol=2e-6
    )


def test_normal_is_the_sum_of_the_unnormalised_normals_of_four_quads(
    rng: np.random.Generator,
) -> None:
    z = rng.normal(0.0, 2.0, (3, 3))
    dx, dy = 2.0, 3.0
    east = np.array([[dx, 0.0, z[1, 2] - z[1, 1]], [-dx, 0.0, z[1, 0] - z[1, 1]]])
    north = np.array([[0.0, dy, z[0, 1] - z[1, 1]], [0.0, -dy, z[2, 1] - z[1, 1]]])
    total = sum(
        s * t * np.cross(east[i], north[j])
        for i, s in ((0, 1), (1, -1))
        for j, t in ((0, 1), (1, -1))
    )
    got = adret.surface_normals(adret.Terrain(z, (dx, dy), datum=0.0))[:, 1, 1]
    np.testing.assert_allclose(got, total / np.linalg.norm(total), atol=1e-6)


@pytest.mark.parametrize("shape", [(1, 1), (1, 2), (2, 1), (1, 7), (7, 1), (2, 2), (13, 9)])
def test_edges_and_holes_as_the_oracle_has_them(
    shape: tuple[int, int], rng: np.random.Generator
) -> None:
    z = rng.normal(0.0, 5.0, shape)
    if z.size > 20:
        z[rng.random(shape) < 0.3] = np.nan
    got = adret.surface_normals(adret.Terrain(z, (2.0, 3.0), datum=0.0))
    for row, column in np.ndindex(shape):
        want = oracles.normal(z, (2.0, 3.0), row, column)
        np.testing.assert_allclose(got[:, row, column], want, atol=2e-6)
    assert got.dtype == np.float32


def test_geographic_rasters_take_the_cell_size_of_the_row() -> None:
    rows, columns, step = 400, 4, 0.01
    transform = Affine(step, 0.0, 10.0, 0.0, -step, 66.0)
    heights = np.arange(columns) * np.ones((rows, 1)) * 100.0
    terrain = adret.Terrain(heights, crs="EPSG:4326", transform=transform)
    to_east, to_north = surface_slopes(terrain)
    latitude = np.radians(66.0 - step * (np.arange(rows) + 0.5))
    a, f = 6_378_137.0, 1.0 / 298.257223563
    es = f * (2.0 - f)
    width = a * np.cos(latitude) / np.sqrt(1.0 - es * np.sin(latitude) ** 2) * np.radians(step)
    np.testing.assert_allclose(to_east[:, 1], 100.0 / width, rtol=5e-4)
    assert (to_north == 0.0).all()


def test_tangent_and_arctangent_are_inverse_to_a_ten_millionth() -> None:
    angle = np.linspace(-1.5707, 1.5707, 200_001, dtype=np.float32)[None, :]
    slope = np.empty_like(angle)
    horizon_integrals.slopes_of_angles(angle, np.float32(2e15), slope)
    np.testing.assert_allclose(np.arctan(slope.astype(np.float64)), angle, atol=1.3e-7)
    back = np.zeros_like(angle)
    horizon_integrals.add_angle(slope, back)
    np.testing.assert_allclose(back, np.arctan(slope.astype(np.float64)), atol=2e-7)
    ends = np.array([[np.pi / 2, -np.pi / 2, np.nan, 0.0]], dtype=np.float32)
    slope = np.empty_like(ends)
    horizon_integrals.slopes_of_angles(ends, np.float32(2e15), slope)
    np.testing.assert_array_equal(slope, np.array([[2e15, -2e15, np.nan, 0.0]], dtype=np.float32))
    steep = np.array([[np.inf, -np.inf, np.nan]], dtype=np.float32)
    back = np.zeros_like(steep)
    horizon_integrals.add_angle(steep, back)
    np.testing.assert_allclose(back, [[np.pi / 2, -np.pi / 2, np.nan]], rtol=1e-7)
