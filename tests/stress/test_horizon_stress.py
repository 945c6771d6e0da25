"""Horizons where arithmetic is hard: worst errors against long double, exact invariances."""

import itertools
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import stress_references as references
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray

import adret
from adret._kernels.near_field import near_field
from adret.blocks import Blocks

UNIT = 2.0**-24
"""Half a unit in the last place of 1 in float32."""
ROUNDINGS = 2.0
"""Roundings of the largest height above the datum that an error may amount to."""
ANGLE = 2.5e-7
"""What rounding of slopes and the arc tangent add [radians]."""

METHODS = ["exact", "sweep", "march"]
ALONG = references.ANGLES[:6]  # march is exact along axes and diagonals of square cells alone
RELIEFS = [1e-6, 1e-3, 1.0, 1e3, 1e6]  # cells
OFFSETS = [0.0, 1e4, 1e7]  # metres
CELLS = [(1.0, 1.0), (1e-3, 1e-3), (1e5, 1e5), (1.0, 100.0), (50.0, 0.5)]


def swept(
    z: NDArray[np.generic], cell: tuple[float, float], method: str, azimuths: NDArray[np.float64]
) -> tuple[NDArray[np.float32], adret.Terrain]:
    """Elevations by a method whose near field covers the raster."""
    terrain = adret.Terrain(z, cell)
    return adret.horizon_map(terrain, azimuths=azimuths, method=method, near=64).elevation, terrain


def excess(z: NDArray[np.float64], cell: tuple[float, float], method: str) -> float:
    """Largest error as a multiple of what is promised; also checks where nothing lies."""
    azimuths = ALONG if method == "march" else references.ANGLES
    truth = references.slopes(z, cell, azimuths)
    elevation, terrain = swept(z, cell, method, azimuths)
    there = np.isfinite(truth)
    np.testing.assert_array_equal(np.isnan(truth), np.isnan(elevation))
    assert (elevation[np.isneginf(truth)] == np.float32(-np.pi / 2)).all()
    off = np.abs(elevation - np.arctan(truth))[there]
    height = float(np.nanmax(np.abs(terrain.heights)))
    bound = ROUNDINGS * UNIT * height / min(cell) / (1.0 + truth[there] ** 2) + ANGLE
    return float(np.max(off / bound, initial=0.0))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", list(references.fields()))
def test_error_is_a_rounding_of_the_heights(method: str, name: str) -> None:
    """One relief, offset and cell of each kind; `make stress` takes every combination."""
    field = references.fields()[name]
    cases = [
        (1e-3, 1e7, CELLS[0]),
        (1.0, 1e4, CELLS[1]),
        (1e6, 0.0, CELLS[3]),
        (1.0, 0.0, CELLS[4]),
    ]
    for relief, offset, cell in cases:
        assert excess(field * relief * min(cell) + offset, cell, method) <= 1.0


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", list(references.fields()))
def test_error_is_a_rounding_of_the_heights_everywhere(method: str, name: str) -> None:
    field = references.fields()[name]
    for relief, offset, cell in itertools.product(RELIEFS, OFFSETS, CELLS):
        z = field * relief * min(cell) + offset
        if np.abs(z).max() < 9e8:
            assert excess(z, cell, method) <= 1.0


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("height", [0.0, 1e-30, 8848.86, 9.87654321e8])
def test_level_ground_is_exactly_level(method: str, height: float) -> None:
    """A step far away makes the datum another than the ground's own height."""
    z = np.full((20, 24), height)
    z[0, 0] = -height
    elevation, _ = swept(z, (0.5, 0.5), method, np.array([math.pi / 2, 2.0]))
    assert (elevation[:, 4:-1, 4:-1] == 0.0).all()


@pytest.mark.parametrize("near", [0, 2, 64])
@pytest.mark.parametrize("cell", [(1.0, 1.0), (1e-3, 0.1), (1e4, 1e3)])
def test_a_plane_meets_its_own_horizon(near: int, cell: tuple[float, float]) -> None:
    row, column = np.mgrid[0:60, 0:70]
    z = (column * cell[0] * 3.0 + row * cell[1] * 0.5) + 1234.0
    terrain = adret.Terrain(z, cell)
    azimuths = references.ANGLES
    elevation = adret.horizon_map(terrain, azimuths=azimuths, near=near).elevation
    own = np.arctan(3.0 * np.sin(azimuths) - 0.5 * np.cos(azimuths))  # the same for every cell size
    there = elevation > -1.57  # not on the edge that the ray leaves by
    assert there.mean() > 0.8
    # In float32 the plane itself is rough by roundings of its heights.
    rounding = ROUNDINGS * UNIT * float(np.abs(terrain.heights).max()) / min(cell)
    assert np.abs(elevation - own[:, None, None])[there].max() < 1e-5 + rounding


@pytest.mark.parametrize("method", METHODS)
def test_denormal_relief_is_level(method: str) -> None:
    z = references.fields()["rough"] * 1e-42
    elevation, _ = swept(z, (1.0, 1.0), method, ALONG)
    assert np.abs(elevation[elevation > -1.57]).max() <= 1e-38


@pytest.mark.parametrize("method", METHODS)
def test_nodata_in_every_position(method: str) -> None:
    z = references.fields()["noise"][:5, :6]
    for row, column in np.ndindex(z.shape):
        holed = z.copy()
        holed[row, column] = np.nan
        assert excess(holed, (1.0, 1.0), method) <= 1.0


@pytest.mark.parametrize("value", [np.inf, -np.inf])
def test_infinity_is_refused_in_every_position(value: float) -> None:
    z = references.fields()["noise"][:3, :4]
    for row, column in np.ndindex(z.shape):
        endless = z.copy()
        endless[row, column] = value
        with pytest.raises(adret.InputError, match="finite or NaN"):
            adret.Terrain(endless, (1.0, 1.0))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    "shape", [(1, 1), (1, 2), (2, 1), (2, 2), (1, 17), (17, 1), (2, 9), (3, 3)]
)
def test_smallest_rasters(method: str, shape: tuple[int, int]) -> None:
    z = np.random.default_rng(3).random(shape)
    assert excess(z, (1.0, 1.0), method) <= 1.0
    for near in (0, 1):
        thin = adret.horizon_map(adret.Terrain(z, (1.0, 1.0)), 16, method=method, near=near)
        assert np.isfinite(thin.elevation).all()


def layouts(z: NDArray[np.generic], folder: Path) -> list[NDArray[np.generic]]:
    """The same numbers, laid out otherwise."""
    wide = np.zeros((2 * z.shape[0], 3 * z.shape[1]), z.dtype)
    wide[::2, ::3] = z
    frozen = z.copy()
    frozen.setflags(write=False)
    np.save(folder / "z.npy", z)
    odd = np.frombuffer(b"\0" * 3 + z.tobytes(), np.uint8)[3:].view(z.dtype).reshape(z.shape)
    return [
        np.asfortranarray(z),
        np.ascontiguousarray(z[::-1, ::-1])[::-1, ::-1],
        wide[::2, ::3],
        frozen,
        np.load(folder / "z.npy", mmap_mode="r"),
        z.astype(z.dtype.newbyteorder()),
        odd,
    ]


@pytest.mark.parametrize("kind", ["f2", "f4", "f8", "i2", "u2", "i4", "i8", "u1"])
def test_layout_and_byte_order_change_no_byte(kind: str, tmp_path: Path) -> None:
    z = (np.random.default_rng(4).random((9, 13)) * 100.0).astype(kind)
    first, _ = swept(z.astype(np.float64), (1.0, 1.0), "sweep", references.ANGLES)
    for other in [z, *layouts(z, tmp_path)]:
        before = other.copy()
        again, _ = swept(other, (1.0, 1.0), "sweep", references.ANGLES)
        assert again.tobytes() == first.tobytes()
        np.testing.assert_array_equal(other, before)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("power", [-19, -3, 11])
def test_powers_of_two_change_no_byte(method: str, power: int) -> None:
    z = references.fields()["rough"].astype(np.float32).astype(np.float64)
    scale = 2.0**power
    elevations = []
    for factor in (1.0, scale):
        terrain = adret.Terrain(z * factor, (factor, 1.5 * factor), datum=0.0)
        elevations.append(
            adret.horizon_map(terrain, azimuths=references.ANGLES, method=method, near=4).elevation
        )
    assert elevations[0].tobytes() == elevations[1].tobytes()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ["rough", "noise", "towers"])
def test_mirrors_and_transposes_change_no_bit(method: str, name: str) -> None:
    """East and west, and the two axes: every number of the run is the same, in another place."""
    z = references.fields()[name]
    oblique = np.array([0.3, 1.1, 1.9, 2.8])
    first, _ = swept(z, (1.0, 1.0), method, oblique)
    mirrored, _ = swept(z[:, ::-1], (1.0, 1.0), method, -oblique)
    assert first[:, :, ::-1].tobytes() == mirrored.tobytes()
    axes = np.array([0.0, 0.5, 1.0, 1.5]) * np.pi
    first, _ = swept(z, (1.0, 1.0), method, axes)
    turned, _ = swept(z.T, (1.0, 1.0), method, 1.5 * np.pi - axes)
    assert first.transpose(0, 2, 1).tobytes() == turned.tobytes()


def test_place_in_memory_changes_no_byte() -> None:
    """A kernel's vectors start anywhere and end in remainders of any length."""
    rng = np.random.default_rng(6)
    rows, columns = 9, 61
    numbers = rng.random((rows + 4, columns + 9)).astype(np.float32)
    offsets = np.array([[-1, 0, -1, -1], [-1, -1, -2, -1], [-2, -1, -2, -2], [-3, -2, -3, -3]])
    weights = rng.random((3, 4)).astype(np.float32)
    ground = *Blocks.unknown((rows, columns)), np.zeros((2, rows), np.int64)
    results = set()
    for start in range(16):
        store = np.empty(numbers.size + 16, np.float32)
        z = store[start : start + numbers.size].reshape(numbers.shape)
        z[:] = numbers
        best = np.empty(rows * columns + 16, np.float32)
        out = best[15 - start : 15 - start + rows * columns].reshape(rows, columns)
        spans = np.array([0, rows]), np.array([0, columns])
        near_field(z, (4, 4), offsets, *weights, *ground, *spans, out)
        results.add(out.tobytes())
        for first in (0, 3):
            part = np.empty_like(out)
            some = spans[0], np.array([first, first + 40])
            near_field(z, (4, 4), offsets, *weights, *ground, *some, part)
            assert part[:, first : first + 40].tobytes() == out[:, first : first + 40].tobytes()
    assert len(results) == 1


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("offset_rad", [1e-6, 3e-7])
def test_grazing_suns_are_told_apart(side: float, offset_rad: float) -> None:
    """The sun stands less than a millionth above or below the crest of a wall."""
    wall = np.zeros((3, 40))
    wall[:, 0] = 7.0
    terrain = adret.Terrain(wall, (1.0, 1.0), datum=0.0)
    crest = np.arctan(7.0 / 20.0)
    sun = adret.Sun(270.0, np.degrees(crest + side * offset_rad), angular_diameter_deg=0.0)
    code = adret.shadow(terrain, sun).code
    assert (code[:, 20] == (0 if side > 0 else 2)).all()
    assert (code[:, 2:20] == 2).all()  # column 1 itself faces away
    assert (code[:, 21:] == 0).all()


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    arrays.arrays(
        np.float64,
        st.tuples(st.integers(1, 7), st.integers(1, 7)),
        elements=st.floats(-1e6, 1e6, width=32) | st.just(np.nan) | st.just(0.0),
    ),
    st.sampled_from(CELLS[:4]),
)
def test_any_heights(z: NDArray[np.float64], cell: tuple[float, float]) -> None:
    if not np.isnan(z).all():
        for method in ("exact", "sweep"):
            assert excess(z, cell, method) <= 1.0


@pytest.mark.parametrize("near", [1, 3])
@pytest.mark.parametrize("make", [np.rint, lambda z: z], ids=["steps", "rough"])
def test_far_field_stays_below_and_beside_the_truth(
    near: int, make: Callable[[NDArray[np.float64]], NDArray[np.float64]]
) -> None:
    """Whatever the far field misses, it invents nothing above the highest and lowest slopes."""
    z = make(references.fields(60, 70)["rough"] * 40.0)
    elevation = adret.horizon_map(adret.Terrain(z, (1.0, 1.0)), 16, near=near).elevation
    truth = np.arctan(references.slopes(z, (1.0, 1.0), np.arange(16) * np.pi / 8))
    there = np.isfinite(truth) & (truth > -1.57)
    assert elevation[there].max() <= truth[there].max() + 1e-6
    assert np.mean(np.abs(elevation - truth)[there]) < 0.05
