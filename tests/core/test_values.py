"""What callers pass by mistake: every door of the library names the field, the limit, the value."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import adret
from adret import InputError, Terrain
from adret._values import file_path, one_of, real, whole

FLAT = np.zeros((4, 5))
TERRAIN = Terrain(FLAT, (1.0, 1.0), datum=0.0)
NO_NUMBERS = ["a", "10", b"1", True, np.True_, 1j, [1.0], np.array([1.0, 2.0]), object, 10**400]
NOTHING = [None, math.nan]
DEM = Path(__file__).resolve().parents[2] / "examples/data/alpine_aletsch_dhm200_lv95_200m.tif"


def test_numbers_come_out_as_they_are() -> None:
    for value in (2, 2.5, np.float32(2.5), np.int8(3), np.float64(-1.0)):
        assert real("x", value, "a number") == value
        assert type(real("x", value, "a number")) is float
    assert real("x", math.inf, "any", high=math.inf) == math.inf
    assert whole("x", 2.0, "whole", 0) == 2
    assert whole("x", np.int64(7), "whole", 0, 7) == 7
    assert file_path("x", Path("a/b")) == str(Path("a/b"))
    one_of("x", "b", ("a", "b"))


@pytest.mark.parametrize(
    ("check", "value"),
    [
        *((lambda v: real("x", v, "a limit", 0.0, 5.0), v) for v in [*NO_NUMBERS, *NOTHING, -1, 6]),
        (lambda v: real("x", v, "a limit"), math.inf),
        *((lambda v: whole("x", v, "a limit", 0), v) for v in [*NO_NUMBERS, *NOTHING, 1.5, -1]),
        (lambda v: whole("x", v, "a limit", 0), math.inf),
        *((lambda v: one_of("x", v, ("a limit",)), v) for v in (None, 1, np.array(["a", "b"]))),
        *((lambda v: file_path("x", v), v) for v in (None, 5, b"a", ["a"])),
    ],
)
def test_what_is_no_value_is_refused(check: Callable[[Any], Any], value: Any) -> None:
    with pytest.raises(InputError, match=r"^x: must be (one of a|a|the path of a)") as caught:
        check(value)
    assert caught.value.value is value


NUMBERS: dict[str, Callable[[Any], Any]] = {
    "halo": lambda v: TERRAIN.window((0, 2), (0, 2), halo=v),
    "max_azimuth_error": TERRAIN.latitude_bands,
    "datum": lambda v: Terrain(FLAT, (1.0, 1.0), datum=v),
    "cell_size": lambda v: Terrain(FLAT, (1.0, v)),
    "azimuth_deg": lambda v: adret.Sun(v, 10.0),
    "elevation_deg": lambda v: adret.Sun(10.0, v),
    "irradiance": lambda v: adret.Sun(10.0, 10.0, v),
    "angular_diameter_deg": lambda v: adret.Sun(10.0, 10.0, 1.0, v),
    "radiance": adret.UniformSky,
    "zenith_radiance": adret.OvercastSky,
    "rotation_deg": lambda v: adret.Environment(np.ones((2, 4)), rotation_deg=v),
    "normal_angles": lambda v: adret.Environment(np.ones((2, 4)), normal_angles=v),
    "near": lambda v: adret.horizon_map(TERRAIN, 2, near=v),
    "max_distance": lambda v: adret.horizon_map(TERRAIN, 2, max_distance=v),
    "radius": lambda v: adret.horizon_map(TERRAIN, 2, radius=v),
    "refraction": lambda v: adret.horizon_map(TERRAIN, 2, radius=6e6, refraction=v),
    "observer_height": lambda v: adret.horizon_map(TERRAIN, 2, observer_height=v),
    "target_height": lambda v: adret.viewshed(TERRAIN, (0, 0), target_height=v),
    "directions": lambda v: adret.horizon_map(TERRAIN, v),
    "sign": lambda v: adret.openness(TERRAIN, v, directions=2),
}


@pytest.mark.parametrize("field", NUMBERS)
def test_no_number_passes_a_door_for_numbers(field: str) -> None:
    optional = field in ("datum", "normal_angles", "max_distance", "radius")
    for value in [*NO_NUMBERS, math.nan, *([] if optional else [None])]:
        with pytest.raises(InputError, match=f"^{field}: must be "):
            NUMBERS[field](value)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Terrain(FLAT, "10"), "cell_size: must be metres: a number or a pair"),
        (lambda: Terrain(FLAT, -10.0), "cell_size: must be between 1e-06 and .* m, got -10"),
        (lambda: Terrain(FLAT, True), "cell_size: must be between 1e-06 and .* m, got True"),
        (lambda: Terrain(FLAT, (1.0, 1.0), vertical_unit=5), "vertical_unit: must be one of m, km"),
        (lambda: Terrain(FLAT, (1.0, 1.0), crs=np.array([1, 2])), "crs: must be a coordinate"),
        (lambda: TERRAIN.window((0, 1.5), (0, 2)), "rows: must be a slice or a pair"),
        (lambda: TERRAIN.window((0, 2), slice(0, math.inf)), "columns: must be a slice or a pair"),
        (lambda: Terrain.open(DEM, None), "band: must be a whole number, got None"),
        (lambda: Terrain.open(DEM, "1"), "band: must be a whole number, got '1'"),
        (lambda: Terrain.open(DEM, 2), "band: must be between 1 and 1, got 2"),
        (lambda: Terrain.open(DEM, vertical_unit=0), "vertical_unit: must be one of m, km"),
        (lambda: Terrain.open(DEM, datum="x"), "datum: must be a height within"),
        (lambda: Terrain.open(5), "path: must be the path of a file, got 5"),
        (lambda: adret.Environment.open("a\0b"), "environment: must be the path of a file"),
        (lambda: adret.Environment.open(None), "environment: must be the path of a file, got None"),
        (lambda: adret.sky_view_factor(TERRAIN, kind=FLAT), "kind: must be one of visible"),
        (lambda: adret.horizon_map(TERRAIN, method=FLAT), "method: must be one of sweep"),
        (lambda: adret.horizon_map(TERRAIN, azimuths=10**400), "azimuths: must be a list of real"),
        (lambda: adret.horizon_at(FLAT, [0], [0]), "terrain: must be a Terrain, got 'ndarray'"),
        (lambda: adret.line_of_sight(None, (0, 0), (1, 0)), "terrain: must be a Terrain"),
        (lambda: adret.total_viewshed(FLAT), "terrain: must be a Terrain, got 'ndarray'"),
        (lambda: adret.cells_at(FLAT, 0.0, 0.0), "terrain: must be a Terrain, got 'ndarray'"),
        (lambda: adret.horizon_map(TERRAIN, refraction=0.13), "refraction: must be 0 without a"),
        (lambda: adret.horizon_at(TERRAIN, [0], [0], refraction=0.13), "refraction: must be 0 wit"),
        (lambda: adret.total_viewshed(TERRAIN, refraction=0.1), "refraction: must be 0 without a"),
    ],
)
def test_odd_arguments_are_named(call: Callable[[], Any], message: str) -> None:
    with pytest.raises(InputError, match=f"^{message}"):
        call()


def test_a_file_that_cannot_be_read_is_named_without_numbers_of_the_system(tmp_path: Path) -> None:
    gone = tmp_path / "gone.hdr"
    with pytest.raises(adret.RasterError) as caught:
        adret.Environment.open(gone)
    assert caught.value.field == "environment"
    assert caught.value.limit == "a file that can be read (No such file or directory)"
    assert caught.value.value == str(gone)
    assert "Errno" not in str(caught.value)
