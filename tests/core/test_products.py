"""Products: files that hold what the library computes, and say how."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from PIL import Image

import adret
from adret import InputError, Terrain, parameters, products
from adret.products import PRODUCTS
from raster_files import NORTH_UP


@pytest.fixture
def terrain(rng: np.random.Generator) -> Terrain:
    """A bumpy pyramid with a hole of nodata, in UTM."""
    rows, columns = np.mgrid[0:40, 0:48]
    heights = (
        300.0 - 8.0 * np.maximum(abs(rows - 20), abs(columns - 20)) + rng.normal(0, 4, (40, 48))
    )
    heights[5:7, 30:33] = np.nan
    return Terrain(heights, crs="EPSG:32633", transform=NORTH_UP)


def written(name: str, terrain: Terrain, path: Path, **options: Any) -> tuple[np.ndarray, dict]:
    """Values (scale and offset applied, NaN for nodata) and metadata of a written product."""
    product = PRODUCTS[name]
    products.run(product, terrain, product.parameters(**options), path)
    with rasterio.open(path) as source:
        stored = source.read(masked=True)
        values = np.ma.filled(stored * source.scales[0] + source.offsets[0], np.nan)
        facts = source.tags() | {"names": source.descriptions, "unit": source.units[0]}
        return values, facts


# ---------------------------------------------------------------- files


@pytest.mark.parametrize(("dtype", "step"), [("uint16", 180.0 / 65534), ("float32", 0.0)])
def test_horizon_file_is_the_horizon_map_in_degrees(
    dtype: str, step: float, terrain: Terrain, tmp_path: Path
) -> None:
    values, facts = written("horizon", terrain, tmp_path / "a.tif", directions=8, dtype=dtype)
    want = np.degrees(adret.horizon_map(terrain, 8).elevation)
    np.testing.assert_allclose(values, want, atol=0.5 * step + 3e-5, rtol=0)
    assert facts["names"] == tuple(f"azimuth {a} deg" for a in np.arange(8) * 45.0)
    assert (facts["unit"], facts["ADRET_DIRECTIONS"], facts["ADRET_METHOD"]) == (
        "degree",
        "8",
        "sweep",
    )


def test_given_azimuths_become_bands_in_their_order(terrain: Terrain, tmp_path: Path) -> None:
    chosen = (270.0, 12.5, 90.0)
    values, facts = written(
        "horizon", terrain, tmp_path / "a.tif", azimuths_deg=chosen, dtype="float32"
    )
    want = np.degrees(adret.horizon_map(terrain, azimuths=np.radians(chosen)).elevation)
    np.testing.assert_allclose(values, want, atol=3e-5, rtol=0)
    assert facts["names"] == ("azimuth 270.0 deg", "azimuth 12.5 deg", "azimuth 90.0 deg")
    assert facts["ADRET_DIRECTIONS"] == "3"


@pytest.mark.parametrize("kind", ["visible", "horizontal", "normal"])
def test_sky_view_file_is_the_sky_view(kind: Any, terrain: Terrain, tmp_path: Path) -> None:
    values, facts = written("sky-view", terrain, tmp_path / "a.tif", kind=kind, directions=16)
    np.testing.assert_array_equal(values[0], adret.sky_view_factor(terrain, kind, 16))
    formula = {"visible": "<1 - sin max(h, 0)>", "horizontal": "<cos^2", "normal": "n_u cos^2 e>"}
    assert formula[kind] in facts["ADRET_DEFINITION"]


@pytest.mark.parametrize("sign", [1, -1])
def test_openness_file_is_openness(sign: Any, terrain: Terrain, tmp_path: Path) -> None:
    values, facts = written("openness", terrain, tmp_path / "a.tif", sign=sign, directions=16)
    np.testing.assert_array_equal(values[0], adret.openness(terrain, sign, 16))
    assert facts["unit"] == "degree"
    assert facts["ADRET_DEFINITION"].startswith("positive" if sign > 0 else "negative")


def test_shadow_file_is_the_shadow(terrain: Terrain, tmp_path: Path) -> None:
    want = adret.shadow(terrain, adret.Sun(135.0, 12.0))
    values, facts = written("shadow", terrain, tmp_path / "a.tif", sun_deg=(135.0, 12.0))
    with rasterio.open(tmp_path / "a.tif") as source:
        np.testing.assert_array_equal(source.read(1), want.code)
        assert source.nodata == 3
    assert set(np.unique(want.code)) == {0, 1, 2, 3}
    assert facts["ADRET_SUN"] == "azimuth 135.0 deg, elevation 12.0 deg"
    values, _ = written("shadow", terrain, tmp_path / "b.tif", sun_deg=(135.0, 12.0), layer="lit")
    np.testing.assert_array_equal(values[0], want.lit)


def test_light_file_is_the_sum_of_its_sources(terrain: Terrain, tmp_path: Path) -> None:
    values, facts = written(
        "light",
        terrain,
        tmp_path / "a.tif",
        sun_deg=(315.0, 35.0),
        sun_irradiance=800.0,
        sky="uniform",
        sky_radiance=30.0,
        directions=16,
    )
    sun = adret.direct_light(terrain, adret.Sun(315.0, 35.0, irradiance=800.0), 16)
    sky = adret.direct_light(terrain, adret.UniformSky(30.0), 16)
    np.testing.assert_allclose(values[0], sun.irradiance + sky.irradiance, rtol=2e-7)
    assert "sun at azimuth 315.0, elevation 35.0 deg, uniform sky" in facts["ADRET_DEFINITION"]
    matt, facts = written(
        "light", terrain, tmp_path / "b.tif", sun_deg=(315.0, 35.0), directions=16, albedo=0.5
    )
    single = adret.direct_light(terrain, adret.Sun(315.0, 35.0), 16)
    np.testing.assert_allclose(matt[0], single.irradiance * 0.5 / np.pi, rtol=2e-7)
    assert facts["ADRET_DEFINITION"].startswith("radiance, albedo 0.5")


def test_a_coloured_environment_gives_three_bands(terrain: Terrain, tmp_path: Path) -> None:
    rows = np.linspace(1.0, 0.0, 8)[:, np.newaxis, np.newaxis]
    np.save(tmp_path / "sky.npy", np.broadcast_to(rows * [1.0, 2.0, 4.0], (8, 16, 3)))
    values, facts = written(
        "light",
        terrain,
        tmp_path / "a.tif",
        environment=str(tmp_path / "sky.npy"),
        sun_deg=(90.0, 30.0),
        directions=16,
    )
    sky = adret.direct_light(terrain, adret.Environment.open(tmp_path / "sky.npy"), 16)
    sun = adret.direct_light(terrain, adret.Sun(90.0, 30.0), 16)
    want = np.moveaxis(sky.irradiance + sun.irradiance[..., np.newaxis], 2, 0)
    np.testing.assert_allclose(values, want, rtol=1e-5, atol=1e-7)
    assert facts["names"] == ("red", "green", "blue")


def test_viewshed_files_are_the_viewshed(terrain: Terrain, tmp_path: Path) -> None:
    observers = ((20, 20), (3, 40), (39, 0))
    want = adret.viewshed(terrain, observers, target_height=0.5, max_distance=250.0)
    assert want.seen_by is not None
    bits = [(want.seen_by >> np.uint64(i)) & np.uint64(1) for i in range(3)]
    for layer, expected in [
        ("visible", [want.visible]),
        ("count", [want.count]),
        ("seen-by", bits),
        ("minimum-height", [want.minimum_height]),
    ]:
        values, facts = written(
            "viewshed",
            terrain,
            tmp_path / f"{layer}.tif",
            observer=observers,
            target_height=0.5,
            max_distance=250.0,
            layer=layer,
        )
        wanted = np.where(terrain.mask, np.nan, np.asarray(expected, dtype=np.float32))
        np.testing.assert_array_equal(values, wanted, err_msg=layer)
        assert facts["ADRET_TARGET_HEIGHT"] == "0.5 m"
        assert facts["ADRET_MAX_DISTANCE"] == "250 m"
        assert facts["unit"] == ("m" if layer == "minimum-height" else "1")
        assert "line of sight" in facts["ADRET_DEFINITION"]
        if layer == "seen-by":
            assert facts["names"] == tuple(f"row {r} column {c}" for r, c in observers)


@pytest.mark.parametrize("layer", ["indirect", "total", "radiance"])
def test_bounce_files_are_the_indirect_light(layer: str, terrain: Terrain, tmp_path: Path) -> None:
    options: dict[str, Any] = {"directions": 8, "near": 12, "radius": 6.4e6}
    values, facts = written(
        "bounce",
        terrain,
        tmp_path / "a.tif",
        sun_deg=(135.0, 25.0),
        sky="uniform",
        sky_radiance=0.1,
        albedo=0.5,
        bounces=2,
        layer=layer,
        **options,
    )
    skies = (adret.Sun(135.0, 25.0), adret.UniformSky(0.1))
    direct = sum(adret.direct_light(terrain, sky, **options).irradiance for sky in skies)
    found = adret.indirect_light(
        terrain, None, 0.5, radiance=direct * np.float32(0.5 / np.pi), bounces=2, **options
    )
    want = found.irradiance + (0.0 if layer == "indirect" else direct)
    want = want * (0.5 / np.pi) if layer == "radiance" else want
    np.testing.assert_allclose(values[0], want, rtol=3e-7)
    assert (facts["ADRET_BOUNCES"], facts["ADRET_ALBEDO"]) == ("2", "0.5")
    assert (facts["ADRET_NEAR"], facts["ADRET_DIRECTIONS"]) == ("12", "8")
    assert facts["ADRET_DEFINITION"].endswith(
        "lit by sun at azimuth 135.0, elevation 25.0 deg, uniform sky"
    )
    assert facts["ADRET_RESIDUAL"].startswith("at most 0.")


def test_a_converged_file_says_how_many_bounces_it_took(terrain: Terrain, tmp_path: Path) -> None:
    _, facts = written(
        "bounce",
        terrain,
        tmp_path / "a.tif",
        sky="overcast",
        albedo=0.8,
        bounces="converge",
        tolerance=0.01,
        directions=4,
    )
    assert int(facts["ADRET_BOUNCES"]) > 2
    assert float(facts["ADRET_RESIDUAL"].split()[2]) <= 0.01


@pytest.mark.parametrize(
    ("measure", "unit"),
    [("visible-count", "1"), ("visible-area", "m2"), ("max-sight-distance", "m")],
)
def test_visibility_files_are_the_reductions(
    measure: Any, unit: str, terrain: Terrain, tmp_path: Path
) -> None:
    values, facts = written(
        "visibility", terrain, tmp_path / "a.tif", measure=measure, directions=8, max_distance=150.0
    )
    want = adret.intervisibility(
        terrain,
        8,
        reduce=measure.replace("-", "_"),
        observer_height=1.6,
        max_distance=150.0,
    )
    np.testing.assert_array_equal(values[0], want)
    assert (facts["unit"], facts["ADRET_METHOD"], facts["ADRET_DIRECTIONS"]) == (unit, "rays", "8")
    assert facts["ADRET_OBSERVER_HEIGHT"] == "1.6 m"


def test_every_measure_has_a_definition() -> None:
    from adret.products.sights import MEASURES

    (measure, *_) = products.specifications(parameters.VisibilityParameters)
    assert tuple(MEASURES) == measure.choices


def test_a_map_coordinate_is_the_cell_it_lies_in(terrain: Terrain, tmp_path: Path) -> None:
    x, y = NORTH_UP.c + 10.2 * NORTH_UP.a, NORTH_UP.f + 20.9 * NORTH_UP.e
    placed, facts = written("viewshed", terrain, tmp_path / "a.tif", at=((x, y),))
    counted, _ = written("viewshed", terrain, tmp_path / "b.tif", observer=((20, 10),))
    np.testing.assert_array_equal(placed, counted)
    assert facts["ADRET_OBSERVERS"] == "row 20 column 10"


def test_curvature_takes_the_radius_of_the_body(terrain: Terrain, tmp_path: Path) -> None:
    values, facts = written(
        "horizon",
        terrain,
        tmp_path / "a.tif",
        directions=4,
        curvature=True,
        refraction=0.13,
        dtype="float32",
    )
    want = adret.horizon_map(terrain, 4, radius=terrain.body_radius, refraction=0.13).elevation
    np.testing.assert_allclose(values, np.degrees(want), atol=3e-5, rtol=0)
    assert facts["ADRET_RADIUS"] == f"{terrain.body_radius:.1f} m"
    assert facts["ADRET_REFRACTION"] == "0.13"


def test_the_same_run_gives_the_same_bytes(terrain: Terrain, tmp_path: Path) -> None:
    for name in ("a.tif", "b.tif"):
        written("horizon", terrain, tmp_path / name, directions=8)
    assert (tmp_path / "a.tif").read_bytes() == (tmp_path / "b.tif").read_bytes()


# ---------------------------------------------------------------- pictures


def shown(name: str, terrain: Terrain, folder: Path, **options: Any) -> np.ndarray:
    product = PRODUCTS[name]
    products.run(
        product, terrain, product.parameters(**options), folder / "a.tif", folder / "a.png"
    )
    with Image.open(folder / "a.png") as picture:
        return np.asarray(picture)


def test_a_lit_picture_is_bright_towards_the_sun(terrain: Terrain, tmp_path: Path) -> None:
    for azimuth, bright, dark in [
        (0.0, np.s_[8:14, 16:24], np.s_[28:34, 16:24]),
        (90.0, np.s_[16:24, 28:34], np.s_[16:24, 8:14]),
    ]:
        picture = shown("light", terrain, tmp_path, sun_deg=(azimuth, 30.0))
        assert picture[bright][..., 0].mean() > picture[dark][..., 0].mean() + 100.0


def test_nodata_is_transparent_in_every_picture(terrain: Terrain, tmp_path: Path) -> None:
    for name, options in [
        ("horizon", {"directions": 4}),
        ("sky-view", {"directions": 4}),
        ("shadow", {}),
        ("light", {"sky": "overcast", "directions": 4}),
        ("bounce", {"sky": "overcast", "directions": 4}),
        ("visibility", {"directions": 4}),
        ("viewshed", {"observer": [(20, 20)]}),
        ("viewshed", {"observer": [(20, 20)], "layer": "minimum-height"}),
        ("viewshed", {"observer": [(20, 20)], "layer": "count"}),
    ]:
        picture = shown(name, terrain, tmp_path, **options)
        np.testing.assert_array_equal(picture[..., 3] == 0, terrain.mask, err_msg=name)


# ---------------------------------------------------------------- parameters


def test_every_parameter_is_described_and_has_a_lawful_default() -> None:
    for name, product in PRODUCTS.items():
        options: dict[str, Any] = {
            "light": {"sky": "uniform"},
            "bounce": {"sky": "uniform"},
            "viewshed": {"observer": [(0, 0)]},
        }.get(name, {})
        made = product.parameters(**options)
        for spec in products.specifications(product.parameters):
            assert spec.description.endswith("."), spec.name
            kinds = ("integer", "number", "boolean", "string", "numbers", "cells", "points")
            assert spec.type in kinds
            assert spec.optional or getattr(made, spec.name) is not None
            if spec.unit == "deg":
                assert spec.name.endswith("_deg")


@pytest.mark.parametrize(
    ("kind", "options", "message"),
    [
        (
            "horizon",
            {"directions": 0},
            "directions: must be a whole number between 1 and 7200, got 0",
        ),
        ("horizon", {"directions": 2.5}, "directions: must be a whole number .* got 2.5"),
        ("horizon", {"directions": True}, "directions: must be a whole number .* got True"),
        ("horizon", {"method": "magic"}, "method: must be one of sweep, hull, march, exact, got"),
        ("horizon", {"max_distance": 0.0}, "max_distance: must be a number above 0 m, got 0.0"),
        ("horizon", {"near": -1}, "near: must be a whole number between 0 and 4096, got -1"),
        ("horizon", {"azimuths_deg": []}, "azimuths_deg: must be at least one number"),
        ("horizon", {"azimuths_deg": [float("nan")]}, "azimuths_deg: must be a number between"),
        ("horizon", {"curvature": 1}, "curvature: must be true or false, got 1"),
        ("openness", {"sign": 0}, "sign: must be 1 or -1, got 0"),
        ("shadow", {"sun_deg": (10.0, 91.0)}, "sun_deg: must be an elevation between -90 and 90"),
        ("shadow", {"sun_deg": (10.0,)}, "sun_deg: must be 2 numbers"),
        ("light", {}, "sky: must be lit by at least one of sun, sky and environment"),
        ("light", {"sky": "uniform", "albedo": 1.5}, "albedo: must be a number between 0 and 1"),
        ("bounce", {}, "sky: must be lit by at least one of sun, sky and environment"),
        (
            "bounce",
            {"sky": "uniform", "bounces": 1001},
            "bounces: must be a whole number between 1 and 1000 or converge, got 1001",
        ),
        ("bounce", {"sky": "uniform", "bounces": "2"}, "bounces: must be a whole number"),
        ("bounce", {"sky": "uniform", "tolerance": 0.0}, "tolerance: must be a number between 0"),
        ("visibility", {"measure": "all"}, "measure: must be one of visible-count, visible-area"),
        ("viewshed", {}, "observer: must be given at least once"),
        ("viewshed", {"observer": [(1, -1)]}, "observer: must be a whole number of at least 0"),
        ("viewshed", {"observer": [(1, 2.5)]}, "observer: must be a whole number"),
        ("viewshed", {"observer": [(1, 2, 3)]}, "observer: must be a list of up to 7200 pairs"),
        ("viewshed", {"observer": []}, "observer: must be a list of up to 7200 pairs"),
        ("viewshed", {"observer": "1,2"}, "observer: must be a list of up to 7200 pairs"),
        ("viewshed", {"at": [(1.0, float("inf"))]}, "at: must be a number, got inf"),
        (
            "viewshed",
            {"at": [(0, 0)], "azimuth_range_deg": (5, 5)},
            "azimuth_range_deg: must be two different azimuths",
        ),
        (
            "viewshed",
            {"at": [(0, 0)], "pitch_range_deg": (5, 2)},
            "pitch_range_deg: must be two elevations",
        ),
    ],
)
def test_unlawful_parameters_are_named(kind: str, options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        PRODUCTS[kind].parameters(**options)


def test_refraction_and_curvature_need_a_radius(tmp_path: Path) -> None:
    bare = Terrain(np.zeros((4, 4)), (1.0, 1.0))
    horizon = PRODUCTS["horizon"]
    for options, field in [({"refraction": 0.13}, "refraction"), ({"curvature": True}, "radius")]:
        with pytest.raises(InputError) as caught:
            products.run(horizon, bare, horizon.parameters(**options), tmp_path / "a.tif")
        assert caught.value.field == field
    assert os.listdir(tmp_path) == []


def test_parameters_of_another_product_are_refused(terrain: Terrain, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="parameters: must be of class HorizonParameters"):
        products.run(
            PRODUCTS["horizon"], terrain, parameters.ShadowParameters(), tmp_path / "a.tif"
        )


def test_a_cancelled_run_leaves_no_file(terrain: Terrain, tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []

    def progress(done: int, total: int) -> None:
        seen.append((done, total))
        if done >= 3:
            raise adret.errors.Cancelled("stopped")

    for name in ("horizon", "sky-view"):
        product = PRODUCTS[name]
        seen.clear()
        with pytest.raises(adret.errors.Cancelled):
            products.run(
                product,
                terrain,
                product.parameters(directions=16),
                tmp_path / "a.tif",
                tmp_path / "a.png",
                progress,
            )
        assert seen[-1] == (3, 16)
        assert os.listdir(tmp_path) == []


def test_progress_of_several_sources_runs_once_from_start_to_end(
    terrain: Terrain, tmp_path: Path
) -> None:
    seen: list[float] = []
    light = PRODUCTS["light"]
    products.run(
        light,
        terrain,
        light.parameters(sky="uniform", sun_deg=(90.0, 20.0), directions=8),
        tmp_path / "a.tif",
        progress=lambda done, total: seen.append(done / total),
    )
    assert seen == sorted(seen)
    assert seen[-1] == 1.0


def test_a_preview_over_the_raster_is_refused(terrain: Terrain, tmp_path: Path) -> None:
    sky = PRODUCTS["sky-view"]
    path = tmp_path / "a.tif"
    with pytest.raises(InputError, match="preview: must be another file than out"):
        products.run(sky, terrain, sky.parameters(), path, path)
