"""The horizon of a place over HTTP, against closed forms and against the map of the library."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest
import rasterio
from servers import AppClient, write_dem

import adret
from adret_service import skylines
from adret_service.app import create_app
from adret_service.engine.memory import MemoryEngine
from adret_service.settings import Settings

CELL = 30.0


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AppClient]:
    settings = Settings(
        data_dir=tmp_path_factory.mktemp("horizon") / "data", min_free_bytes=0, viewers=1
    )
    with AppClient(create_app(settings, MemoryEngine())) as client:
        yield client


def sent(client: AppClient, path: Path) -> str:
    answer = client.post("/uploads", content=path.read_bytes())
    assert answer.status_code == 201, answer.text
    return f"/datasets/{answer.json()['id']}"


def place(crs: str, transform: Any, row: int, column: int) -> dict[str, float]:
    """Longitude and latitude of the middle of a cell."""
    x = transform.c + transform.a * (column + 0.5)
    y = transform.f + transform.e * (row + 0.5)
    lon, lat = pyproj.Transformer.from_crs(crs, 4326, always_xy=True).transform(x, y)
    return {"lat": lat, "lon": lon}


@pytest.fixture(scope="module")
def wall(client: AppClient, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Any]:
    """Flat ground on the middle meridian of UTM 32, a wall of 200 m in the east."""
    heights = np.full((41, 61), 400.0, np.float32)
    heights[:, 50:] = 600.0
    heights[0, 0] = np.nan
    transform = rasterio.Affine(CELL, 0, 5e5 - 30.5 * CELL, 0, -CELL, 5e6)
    path = write_dem(tmp_path_factory.mktemp("wall") / "w.tif", heights, transform=transform)
    return sent(client, path), transform


def test_a_wall_stands_as_high_as_the_tangent_says(
    client: AppClient, wall: tuple[str, Any]
) -> None:
    url, transform = wall
    here = place("EPSG:32632", transform, 20, 30)
    told = client.get(f"{url}/horizon", params={**here, "azimuths": 4}).json()
    out = told["outputs"]
    assert out["azimuth_deg"] == [0, 90, 180, 270]
    assert told["inputs"]["location"]["elevation"] == 400.0
    east = math.degrees(math.atan2(200.0, 20 * CELL))
    assert out["elevation_deg"] == [0, pytest.approx(east, abs=0.05), 0, 0]
    rows = {row["A"]: row["H_hor"] for row in out["horizon_profile"]}
    assert list(rows) == [-180, -90, 0, 90, 180]
    assert rows[-90] == out["elevation_deg"][1], "east is negative, as PVGIS counts"
    assert out["userhorizon"] == f"0,{rows[-90]:g},0,0"
    above = client.get(f"{url}/horizon", params={**here, "azimuths": 4, "height": 200}).json()
    assert above["outputs"]["elevation_deg"][1] == pytest.approx(0.0, abs=0.01)
    assert above["outputs"]["elevation_deg"][3] < -10.0
    assert {row["H_hor"] for row in above["outputs"]["horizon_profile"]} == {0}


def test_the_csv_form_is_the_table_of_pvgis(client: AppClient, wall: tuple[str, Any]) -> None:
    url, transform = wall
    here = place("EPSG:32632", transform, 20, 30)
    ways = (
        {"params": {**here, "outputformat": "csv"}},
        {"params": here, "headers": {"Accept": "text/csv"}},
    )
    for options in ways:
        answer = client.get(f"{url}/horizon", **options)
        assert answer.headers["content-type"].startswith("text/csv")
        lines = answer.text.splitlines()
        assert lines[0] == f"Latitude (decimal degrees):\t{here['lat']:.6f}"
        assert lines[1] == f"Longitude (decimal degrees):\t{here['lon']:.6f}"
        assert lines[3] == "A\tH_hor"
        table = np.array([list(map(float, line.split("\t"))) for line in lines[4:53]])
        assert np.array_equal(table[:, 0], np.linspace(-180, 180, 49))
        assert table[12, 1] == pytest.approx(math.degrees(math.atan2(200, 600)), abs=0.05)
        assert lines[54:] == [
            "A: Azimuth (0 = S, 90 = W, -90 = E) (degree)",
            "H_hor: Horizon height (degree)",
        ]


def test_azimuths_are_true_ones_and_the_bytes_those_of_the_exact_map(
    client: AppClient, tmp_path: Path
) -> None:
    rng = np.random.default_rng(5)
    heights = rng.normal(0.0, 40.0, (60, 60)).cumsum(0).cumsum(1).astype(np.float32) / 20
    transform = rasterio.Affine(CELL, 0, 7.5e5, 0, -CELL, 7.2e6)  # far east of the meridian
    url = sent(client, write_dem(tmp_path / "d.tif", heights, transform=transform))
    here = place("EPSG:32632", transform, 33, 21)
    got = client.get(f"{url}/horizon", params={**here, "azimuths": 16}).json()["outputs"]
    assert got["cell"] == [33, 21]
    turned = pyproj.Proj("EPSG:32632").get_factors(here["lon"], here["lat"]).meridian_convergence
    assert abs(turned) > 4.0
    terrain = adret.Terrain(heights, (CELL, CELL), "EPSG:32632", transform)
    grid = np.radians(np.arange(16) * 22.5 - turned)
    own = adret.horizon_map(terrain, azimuths=grid, method="exact").elevation[:, 33, 21]
    assert np.abs(np.degrees(own) - got["elevation_deg"]).max() < 0.02


def test_a_curved_body_lowers_what_is_far(client: AppClient, tmp_path: Path) -> None:
    heights = np.zeros((201, 3000), np.float32)
    heights[:, -1] = 1000.0
    transform = rasterio.Affine(CELL, 0, 4.55e5, 0, -CELL, 5e6)
    url = sent(client, write_dem(tmp_path / "d.tif", heights, transform=transform))
    here = place("EPSG:32632", transform, 100, 0) | {"azimuths": 360}
    flat, curved = (
        max(client.get(f"{url}/horizon", params=here | more).json()["outputs"]["elevation_deg"])
        for more in ({}, {"curvature": "true"})
    )
    way = 2999 * CELL
    assert math.tan(math.radians(flat)) == pytest.approx(1000.0 / way, rel=2e-3)
    drop = 0.87 * way / (2 * 6371e3)
    assert math.tan(math.radians(curved)) == pytest.approx(1000.0 / way - drop, rel=1e-2)


@pytest.mark.parametrize(
    ("query", "status", "field"),
    [
        ({"lat": 0, "lon": 0}, 404, "lat, lon"),
        ({"lat": 91, "lon": 9}, 400, "lat"),
        ({"lat": "nan", "lon": 9}, 400, "lat"),
        ({"lon": 9}, 400, "lat"),
        ({"lat": 45, "lon": 9, "azimuths": 0}, 400, "azimuths"),
        ({"lat": 45, "lon": 9, "azimuths": 10**9}, 400, "azimuths"),
        ({"lat": 45, "lon": 9, "height": -1}, 400, "height"),
        ({"lat": 45, "lon": 9, "outputformat": "xml"}, 400, "outputformat"),
    ],
)
def test_a_place_that_is_none_is_refused_by_name(
    client: AppClient, wall: tuple[str, Any], query: dict[str, Any], status: int, field: str
) -> None:
    answer = client.get(f"{wall[0]}/horizon", params=query)
    assert answer.status_code == status, answer.text
    assert answer.json()["errors"][0]["field"] == field


def test_nodata_and_rasters_without_a_place_have_no_horizon(
    client: AppClient, wall: tuple[str, Any], tmp_path: Path
) -> None:
    url, transform = wall
    answer = client.get(f"{url}/horizon", params=place("EPSG:32632", transform, 0, 0))
    assert answer.status_code == 404
    assert "has data" in answer.json()["detail"]
    bare = write_dem(tmp_path / "bare.tif", np.ones((9, 9), np.float32), crs=None)
    arena = 'LOCAL_CS["arena",UNIT["metre",1]]'
    tied_to_nothing = write_dem(tmp_path / "a.tif", np.ones((9, 9), np.float32), crs=arena)
    for path in (bare, tied_to_nothing):
        url = sent(client, path)
        answer = client.get(f"{url}/horizon", params={"lat": 45, "lon": 9})
        assert answer.status_code == 400, answer.text
        assert answer.json()["errors"][0]["field"] == "crs"
        assert client.get(f"{url}/tilejson.json").json()["grid"] == "cells"


def test_of_a_large_raster_a_window_round_the_cell_is_read(tmp_path: Path) -> None:
    assert skylines.span(17, 4096) == (0, 4096)
    assert skylines.span(17, 90_000) == (0, 4096)
    assert skylines.span(89_999, 90_000) == (90_000 - 4096, 90_000)
    start, stop = skylines.span(50_000, 90_000)
    assert stop - start == 4096
    assert min(50_000 - start, stop - 50_000) >= 1536
    heights = np.zeros((201, 6000), np.float32)
    heights[:, 4500] = 300.0
    heights[:, 5990] = 9000.0
    transform = rasterio.Affine(CELL, 0, 4.5e5, 0, -CELL, 5e6)
    path = write_dem(tmp_path / "long.tif", heights, transform=transform)
    info = {
        "rows": 201,
        "columns": 6000,
        "crs": rasterio.CRS.from_epsg(32632).to_wkt(),
        "transform": list(transform[:6]),
        "cell_size": [CELL, CELL],
        "datum": 0.0,
    }
    here = place("EPSG:32632", transform, 100, 3000)
    told = skylines.skyline(str(path), info, **here, azimuths=360, height=0.0, curvature=False)
    assert told["reach_m"] == CELL * (3000 - 1024), "the window begins there"
    wall = math.degrees(math.atan2(300.0, 1500 * CELL))
    assert max(told["elevation_deg"]) == pytest.approx(wall, abs=0.01)
    end = place("EPSG:32632", transform, 100, 5980)
    told = skylines.skyline(str(path), info, **end, azimuths=360, height=0.0, curvature=False)
    assert max(told["elevation_deg"]) > 80.0
