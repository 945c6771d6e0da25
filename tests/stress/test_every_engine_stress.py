"""What holds for every engine alike: smallest shapes, denormals, holes, mirrors, any field."""

import math
import warnings
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
from adret.screen import METHODS

Layers = list[NDArray[np.generic]]
SUN = adret.Sun(200.0, 30.0)
K = 8
AXES = [0.0, 90.0, 180.0, 270.0, 45.0, 135.0]


def middle(terrain: adret.Terrain) -> tuple[int, int]:
    """A cell with data, near the middle."""
    there = np.argwhere(~terrain.mask)
    row, column = there[len(there) // 2]
    return int(row), int(column)


def viewsheds(terrain: adret.Terrain) -> Layers:
    seen = adret.viewshed(terrain, middle(terrain))
    return [seen.visible.astype(np.float32), seen.minimum_height]


ENGINES: dict[str, Callable[[adret.Terrain], Layers]] = {
    "horizon": lambda t: [adret.horizon_map(t, K).elevation],
    "sky view": lambda t: [adret.sky_view_factor(t, directions=K)],
    "openness": lambda t: [adret.openness(t, s, directions=K) for s in (1, -1)],
    "light": lambda t: [
        adret.direct_light(t, adret.UniformSky(), directions=K).irradiance,
        adret.direct_light(t, SUN).irradiance,
    ],
    "shadow": lambda t: [adret.shadow(t, SUN).lit],
    "bounce": lambda t: [adret.indirect_light(t, SUN, 0.5, bounces=2, directions=K).irradiance],
    "intervisibility": lambda t: [adret.intervisibility(t, K, reduce="visible_count")],
    "viewshed": viewsheds,
    "total viewshed": lambda t: [adret.total_viewshed(t, K)],
}
NAMES = list(ENGINES)
RANGES = {
    "horizon": (-math.pi / 2, math.pi / 2),
    "sky view": (0.0, 1.0),
    "openness": (0.0, 180.0),  # degrees
    "light": (0.0, 1e9),
    "shadow": (0.0, 1.0),
    "bounce": (0.0, 1e9),
    "intervisibility": (0.0, 1e9),
    "viewshed": (0.0, 1e12),
    "total viewshed": (0.0, 1e12),
}


def sound(name: str, terrain: adret.Terrain) -> Layers:
    """An engine's layers: within their range where there is ground."""
    found = ENGINES[name](terrain)
    low, high = RANGES[name]
    for layer in found:
        values = np.asarray(layer, np.float64)[..., ~terrain.mask]
        assert not np.isnan(values).any(), name
        assert values.min() >= low - 1e-6 * high, name
        assert values.max() <= high * (1.0 + 1e-6), name
    return found


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("shape", [(1, 1), (1, 2), (2, 1), (2, 2), (1, 9), (9, 1)])
def test_smallest_rasters_have_sound_layers(name: str, shape: tuple[int, int]) -> None:
    terrain = adret.Terrain(np.random.default_rng(1).random(shape), (1.0, 1.0))
    assert all(layer.shape[-2:] == shape for layer in sound(name, terrain))


@pytest.mark.parametrize("name", NAMES)
def test_denormal_relief_is_level(name: str) -> None:
    z = references.fields(9, 11)["noise"]
    flat = ENGINES[name](adret.Terrain(np.zeros_like(z), (1.0, 1.0)))
    tiny = ENGINES[name](adret.Terrain(z * 1e-42, (1.0, 1.0), datum=0.0))
    for one, other in zip(flat, tiny, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-30, equal_nan=True)


@pytest.mark.parametrize("name", NAMES)
def test_nodata_in_every_position_leaves_the_rest_sound(name: str) -> None:
    z = references.fields()["noise"][:4, :5]
    for place in np.ndindex(z.shape):
        holed = z.copy()
        holed[place] = np.nan
        sound(name, adret.Terrain(holed, (1.0, 1.0)))


@pytest.mark.parametrize("name", [n for n in NAMES if n not in ("light", "shadow", "bounce")])
@pytest.mark.parametrize("field", ["rough", "noise", "towers"])
def test_mirrored_ground_has_mirrored_layers(name: str, field: str) -> None:
    """East and west; light from one side has a test of its own."""
    z = references.fields(9, 11)[field]
    first = ENGINES[name](adret.Terrain(z, (1.0, 2.0)))
    mirrored = ENGINES[name](adret.Terrain(z[:, ::-1], (1.0, 2.0)))
    turned = -np.arange(K) % K
    for one, other in zip(first, mirrored, strict=True):
        other = other[..., ::-1]
        if other.ndim == 3:
            other = other[turned]
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("field", ["rough", "noise", "towers", "stairs"])
@pytest.mark.parametrize("azimuth", [90.0, 45.0, 200.0])
def test_a_mirrored_sun_casts_mirrored_shadows(field: str, azimuth: float) -> None:
    z = references.fields(9, 11)[field]
    found = []
    for heights, towards in ((z, azimuth), (z[:, ::-1], 360.0 - azimuth)):
        terrain, sun = adret.Terrain(heights, (1.0, 1.0)), adret.Sun(towards, 15.0)
        shade = adret.shadow(terrain, sun)
        bounced = adret.indirect_light(terrain, sun, 0.5, directions=K).irradiance
        found.append((shade.code, shade.lit, bounced))
    np.testing.assert_array_equal(found[0][0], found[1][0][:, ::-1])
    for one, other in zip(found[0][1:], found[1][1:], strict=True):
        np.testing.assert_allclose(one, other[:, ::-1], rtol=0, atol=2e-6 * max(one.max(), 1.0))


@pytest.mark.parametrize("azimuth", AXES)
def test_a_sun_beside_an_axis_casts_the_shadows_of_one_on_it(azimuth: float) -> None:
    z = references.fields()["towers"] * 4.0
    terrain = adret.Terrain(z, (1.0, 1.0))
    codes = [
        adret.shadow(terrain, adret.Sun((azimuth + off) % 360.0, 20.0)).code
        for off in (0.0, math.degrees(1e-12), -math.degrees(1e-12))
    ]
    assert (codes[0] == 2).any()
    np.testing.assert_array_equal(codes[0], codes[1])
    np.testing.assert_array_equal(codes[0], codes[2])


def test_layout_of_what_the_ground_sends_changes_no_byte(tmp_path: Path) -> None:
    terrain = adret.Terrain(references.fields(9, 11)["rough"] * 4.0, (1.0, 1.0))
    sent = np.round(np.random.default_rng(3).random((9, 11)) * 8.0).astype(np.float32)
    mapped = np.memmap(tmp_path / "sent", np.float32, "w+", shape=sent.shape)
    mapped[:] = sent
    frozen = sent.copy()
    frozen.setflags(write=False)
    others = [np.asfortranarray(sent), sent[::-1].copy()[::-1], sent.astype(">f8"), mapped, frozen]
    others += [sent.astype(kind) for kind in ("f2", "f8", "i2", "u2")]

    def light(radiance: NDArray[np.generic], albedo: NDArray[np.generic]) -> bytes:
        options = {"radiance": radiance, "directions": K, "bounces": 2}
        return adret.indirect_light(terrain, None, albedo, **options).irradiance.tobytes()

    first = light(sent, sent / np.float32(16.0))
    for other in others:
        assert light(other, other / other.dtype.type(16.0)) == first, other.dtype


FIELDS = arrays.arrays(
    np.float32,
    st.tuples(st.integers(1, 7), st.integers(1, 7)),
    elements=st.one_of(
        st.floats(-1e6, 1e6, width=32), st.just(np.nan), st.sampled_from([0.0, 1.0, 1e-40])
    ),
).filter(lambda z: not np.isnan(z).all())
CELLS = st.sampled_from([(1.0, 1.0), (1e-3, 0.1), (1e4, 1e5), (1.0, 100.0)])


def any_field(z: NDArray[np.float32], cell: tuple[float, float]) -> None:
    terrain = adret.Terrain(z, cell)
    for name in NAMES:
        sound(name, terrain)


@settings(max_examples=12, deadline=None, derandomize=True)
@given(FIELDS, CELLS)
def test_any_heights_have_sound_layers(z: NDArray[np.float32], cell: tuple[float, float]) -> None:
    any_field(z, cell)


@pytest.mark.slow
@settings(max_examples=600, deadline=None, derandomize=True)
@given(FIELDS, CELLS)
def test_many_heights_have_sound_layers(z: NDArray[np.float32], cell: tuple[float, float]) -> None:
    any_field(z, cell)


def occlusion(depth: NDArray[np.generic], method: str) -> NDArray[np.float32]:
    rows, columns = depth.shape
    camera = adret.Camera.orthographic(columns, rows, extent=(float(columns), float(rows)))
    chosen: dict[str, object] = {"radius": 6.0}
    if method == "raytraced":
        chosen["rays"] = 16
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        buffer = adret.DepthBuffer(depth, camera)
        return adret.ambient_occlusion(buffer, method=method, **chosen).occlusion


def shares(found: NDArray[np.float32], depth: NDArray[np.generic]) -> None:
    there = found[np.isfinite(depth) & (depth > 0)]
    assert ((there >= 0.0) & (there <= 1.0)).all()


@pytest.mark.parametrize("method", list(METHODS))
def test_depths_of_any_number_type_give_the_same_occlusion(method: str, tmp_path: Path) -> None:
    depth = np.round(references.fields(12, 14)["noise"] * 8.0 + 20.0).astype(np.float32)
    mapped = np.memmap(tmp_path / "depth", np.float32, "w+", shape=depth.shape)
    mapped[:] = depth
    first = occlusion(depth, method)
    shares(first, depth)
    for other in (*(depth.astype(kind) for kind in ("f2", "i2", "u2", ">f8", "i4")), mapped):
        assert occlusion(other, method).tobytes() == first.tobytes(), other.dtype


@pytest.mark.parametrize("shape", [(1, 1), (1, 2), (2, 1), (2, 2), (1, 9), (9, 1)])
def test_the_light_field_method_has_smallest_images(shape: tuple[int, int]) -> None:
    depth = references.fields()["noise"][: shape[0], : shape[1]] + 20.0
    shares(occlusion(depth, "lightfield"), depth)


DEPTHS = arrays.arrays(
    np.float32,
    st.tuples(st.integers(1, 6), st.integers(1, 6)),
    elements=st.one_of(
        st.floats(0.0009765625, 1e6, width=32),
        st.sampled_from([1e-40, 1.0, np.nan, np.inf, 0.0, -1.0]),
    ),
)


@pytest.mark.parametrize("method", list(METHODS))
def test_any_depths_give_shares(method: str) -> None:
    @settings(max_examples=8, deadline=None, derandomize=True, database=None)
    @given(DEPTHS)
    def hold(depth: NDArray[np.float32]) -> None:
        shares(occlusion(depth, method), depth)

    hold()


@pytest.mark.slow
@pytest.mark.parametrize("method", list(METHODS))
def test_many_depths_give_shares(method: str) -> None:
    @settings(max_examples=300, deadline=None, derandomize=True, database=None)
    @given(DEPTHS)
    def hold(depth: NDArray[np.float32]) -> None:
        shares(occlusion(depth, method), depth)

    hold()
