"""Tiles, pictures, statistics and values of datasets and results, against known numbers."""

import io
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from PIL import Image
from servers import AppClient, write_dem

from adret import cogs
from adret.terrain import Terrain
from adret_service.app import create_app
from adret_service.engine.memory import MemoryEngine
from adret_service.engine.port import JobRecord
from adret_service.ids import new_id
from adret_service.problems import Problem
from adret_service.settings import Settings
from adret_service.viewers import Copies

ZOOM, LEFT, TOP = 12, 2132, 1450
CELL = 2.0 * 20037508.342789244 / 256 / 2**ZOOM
RIM = 8  # cells round the tiles


def heights() -> Any:
    """Two by two tiles of the web's grid, cell by cell, and a rim; the last tile is nodata."""
    values = np.arange(512 + 2 * RIM)[:, None] % 200 + np.arange(512 + 2 * RIM)[None, :] % 55
    values = values.astype(np.float32)
    values[256 + RIM :, 256 + RIM :] = np.nan
    return values


def block(dx: int, dy: int) -> Any:
    """The cells of one tile."""
    return heights()[RIM:, RIM:][256 * dy : 256 * dy + 256, 256 * dx : 256 * dx + 256]


def corner(x: int, y: int) -> tuple[float, float]:
    """North-western corner of a tile, and the rim beyond it [m]."""
    west = (x * 256 - RIM) * CELL - 20037508.342789244
    return west, 20037508.342789244 - (y * 256 - RIM) * CELL


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AppClient]:
    settings = Settings(
        data_dir=tmp_path_factory.mktemp("views") / "data", min_free_bytes=0, viewers=1
    )
    with AppClient(create_app(settings, MemoryEngine())) as client:
        yield client


def sent(client: AppClient, path: Path, **options: Any) -> str:
    answer = client.post("/uploads", content=path.read_bytes(), params=options)
    assert answer.status_code == 201, answer.text
    return f"/datasets/{answer.json()['id']}"


@pytest.fixture(scope="module")
def dataset(client: AppClient, tmp_path_factory: pytest.TempPathFactory) -> str:
    west, north = corner(LEFT, TOP)
    place = {"crs": "EPSG:3857", "transform": rasterio.Affine(CELL, 0, west, 0, -CELL, north)}
    return sent(client, write_dem(tmp_path_factory.mktemp("dem") / "d.tif", heights(), **place))


def numbers(answer: Any) -> Any:
    assert answer.status_code == 200, answer.text
    return np.load(io.BytesIO(answer.content), allow_pickle=False)


def picture(answer: Any) -> Any:
    assert answer.status_code == 200, answer.text
    return np.asarray(Image.open(io.BytesIO(answer.content)))


def test_a_tile_at_the_rasters_own_zoom_holds_its_cells(client: AppClient, dataset: str) -> None:
    for dx, dy in ((0, 0), (1, 0), (0, 1)):
        answer = client.get(f"{dataset}/tiles/{ZOOM}/{LEFT + dx}/{TOP + dy}.npy")
        tile = numbers(answer)[0]
        assert tile.shape == (256, 256)
        inner = np.s_[:255, :255]  # what touches nodata may be nodata
        assert np.abs(tile[inner] - block(dx, dy)[inner]).max() < 1e-3
        assert answer.headers["content-type"] == "application/x-npy"


def test_a_tile_above_it_holds_means_of_cells(client: AppClient, dataset: str) -> None:
    above = numbers(client.get(f"{dataset}/tiles/{ZOOM - 1}/{LEFT // 2}/{TOP // 2}.npy"))[0]
    means = heights()[RIM:-RIM, RIM:-RIM].reshape(256, 2, 256, 2).mean(axis=(1, 3))
    for rows, columns in ((np.s_[:127], np.s_[:]), (np.s_[:], np.s_[:127])):
        assert np.abs(above[rows, columns] - means[rows, columns]).max() < 1e-3
    assert np.isnan(above[129:, 129:]).all()


def test_pixels_are_the_values_between_the_two_of_rescale(client: AppClient, dataset: str) -> None:
    url = f"{dataset}/tiles/{ZOOM}/{LEFT}/{TOP}.png"
    shown = picture(client.get(url, params={"rescale": "0,255"}))
    assert shown.shape == (256, 256, 2), "grey and its mask"
    assert np.abs(shown[..., 0].astype(int) - block(0, 0)).max() <= 1
    assert (shown[..., 1] == 255).all()
    lossless = picture(client.get(url.replace("png", "webp"), params={"rescale": "0,255"}))
    assert np.array_equal(lossless[..., 0], shown[..., 0])
    scaled = numbers(client.get(url.replace("png", "npy"), params={"rescale": "50,150"}))[0]
    assert np.abs(scaled - (block(0, 0) - 50.0) / 100.0).max() < 1e-4
    coloured = picture(client.get(url, params={"rescale": "30,31", "colormap_name": "viridis"}))
    assert block(0, 0)[0, 0] < 30.0
    assert coloured[0, 0].tolist() == [68, 1, 84, 255]
    assert coloured[100, 40].tolist() == [253, 231, 36, 255]
    large = picture(client.get(url, params={"tilesize": "512"}))
    assert large.shape[:2] == (512, 512)


def test_without_rescale_the_percentiles_are_black_and_white(
    client: AppClient, dataset: str
) -> None:
    low, high = np.nanpercentile(heights(), (2, 98))
    shown = picture(client.get(f"{dataset}/tiles/{ZOOM}/{LEFT}/{TOP}.png"))[..., 0]
    expected = np.clip((block(0, 0) - low) / (high - low), 0, 1) * 255
    assert np.abs(shown - expected).max() <= 1.0


def test_empty_tiles_have_no_body_and_those_elsewhere_are_not_found(
    client: AppClient, dataset: str
) -> None:
    empty = client.get(f"{dataset}/tiles/{ZOOM}/{LEFT + 1}/{TOP + 1}.png")
    assert (empty.status_code, empty.content) == (204, b"")
    away = client.get(f"{dataset}/tiles/{ZOOM}/{LEFT + 3}/{TOP}.png")
    assert away.status_code == 404
    assert away.json()["errors"][0]["field"] == "z, x, y"
    assert away.json()["errors"][0]["limit"].startswith("within west, south, east, north of [")


@pytest.mark.parametrize(
    ("path", "field"),
    [
        ("25/0/0.png", "z"),
        ("-1/0/0.png", "z"),
        ("3/8/0.png", "x, y"),
        ("3/0/1e3.png", "y"),
        ("3/0/0.gif", "format"),
        ("12/2132/1450.png?rescale=1", "rescale.0"),
        ("12/2132/1450.png?rescale=2,1", "rescale"),
        ("12/2132/1450.png?rescale=nan,1", "rescale.0"),
        ("12/2132/1450.png?rescale=1,2&rescale=1,2", "rescale"),
        ("12/2132/1450.png?bidx=2", "bidx"),
        ("12/2132/1450.png?bidx=0", "bidx.0"),
        ("12/2132/1450.png?bidx=1&bidx=1", "bidx"),
        ("12/2132/1450.png?bidx=1&bidx=1&bidx=1&colormap_name=viridis", "colormap_name"),
        ("12/2132/1450.png?colormap_name=nothing", "colormap_name"),
        ("12/2132/1450.png?colormap_name=../x", "colormap_name"),
        ("12/2132/1450.png?tilesize=100000", "tilesize"),
    ],
)
def test_what_cannot_be_shown_is_refused_by_name(
    client: AppClient, dataset: str, path: str, field: str
) -> None:
    answer = client.get(f"{dataset}/tiles/{path}")
    assert answer.status_code == 400, answer.text
    assert answer.json()["errors"][0]["field"] == field, answer.text
    assert answer.json()["type"].endswith("invalid-parameter-value")


def test_a_view_that_the_client_has_is_not_sent_again(client: AppClient, dataset: str) -> None:
    url = f"{dataset}/tiles/{ZOOM}/{LEFT}/{TOP}.png"
    first = client.get(url)
    assert first.headers["cache-control"] == "private, max-age=3600"
    again = client.get(url, headers={"If-None-Match": f'W/"x", {first.headers["etag"]}'})
    assert (again.status_code, again.content) == (304, b"")
    other = client.get(url, params={"rescale": "0,9"})
    assert other.headers["etag"] != first.headers["etag"]


def test_tilejson_says_where_the_tiles_are(client: AppClient, dataset: str) -> None:
    grid = client.get(f"{dataset}/tilejson.json?colormap_name=magma").json()
    assert grid["tiles"] == [
        f"http://127.0.0.1{dataset}/tiles/{{z}}/{{x}}/{{y}}.png?colormap_name=magma"
    ]
    assert (grid["maxzoom"], grid["grid"]) == (ZOOM, "WebMercatorQuad")
    side = 360.0 / 2**ZOOM
    assert grid["bounds"][0] == pytest.approx((LEFT - RIM / 256) * side - 180.0, abs=1e-6)
    assert grid["bounds"][2] == pytest.approx((LEFT + 2 + RIM / 256) * side - 180.0, abs=1e-6)
    z, x, y = ZOOM, LEFT, TOP
    url = grid["tiles"][0].format(z=z, x=x, y=y).removeprefix("http://127.0.0.1")
    assert client.get(url).status_code == 200


def test_statistics_are_those_of_the_cells(client: AppClient, dataset: str) -> None:
    told = client.get(f"{dataset}/statistics").json()["b1"]
    own = heights()
    for name, value in (
        ("min", np.nanmin(own)),
        ("max", np.nanmax(own)),
        ("mean", np.nanmean(own)),
    ):
        assert told[name] == pytest.approx(float(value), abs=1e-3), name
    assert told["count"] == np.isfinite(own).sum()
    assert told["valid_percent"] == pytest.approx(100.0 * np.isfinite(own).mean(), abs=0.01)
    assert sum(told["histogram"][0]) == told["count"]


def test_a_point_has_the_value_of_its_cell(client: AppClient, dataset: str) -> None:
    side = 360.0 / 2**ZOOM
    lon = (LEFT + 100.5 / 256) * side - 180.0
    lat = np.degrees(np.arctan(np.sinh(np.pi * (1 - 2 * (TOP + 30.5 / 256) / 2**ZOOM))))
    told = client.get(f"{dataset}/point", params={"lon": lon, "lat": lat}).json()
    assert told["values"] == [pytest.approx(float(block(0, 0)[30, 100]), abs=1e-3)]
    assert told["unit"] == "m"
    hole = client.get(f"{dataset}/point", params={"lon": lon + side, "lat": lat - 0.07}).json()
    assert hole["values"] == [None]
    away = client.get(f"{dataset}/point", params={"lon": 0, "lat": 0})
    assert away.status_code == 404
    assert client.get(f"{dataset}/point", params={"lon": "inf", "lat": 0}).status_code == 400


def test_a_preview_shows_the_whole(client: AppClient, dataset: str) -> None:
    shown = picture(
        client.get(f"{dataset}/preview.png", params={"max_size": 128, "rescale": "0,1"})
    )
    assert shown.shape == (128, 128, 2)
    assert shown[100, 100, 1] == 0, "nodata is transparent"
    assert shown[20, 20, 1] == 255


def test_the_map_page_asks_nobody_else(client: AppClient, dataset: str) -> None:
    page = client.get(f"{dataset}/map.html")
    assert page.headers["content-type"].startswith("text/html")
    assert "http:" not in page.text
    assert "https:" not in page.text
    policy = page.headers["content-security-policy"]
    assert "unsafe" not in policy
    assert policy.count("sha256-") == 2


def test_a_raster_without_a_place_is_cut_along_its_cells(client: AppClient, tmp_path: Path) -> None:
    values = (np.arange(300)[:, None] * 7 + np.arange(600)[None, :]).astype(np.uint16)
    Image.fromarray(values).save(tmp_path / "h.png")
    url = sent(client, tmp_path / "h.png", cell_size=10)
    grid = client.get(f"{url}/tilejson.json").json()
    assert (grid["grid"], grid["maxzoom"], grid["bounds"]) == ("cells", 2, [0, 0, 600, 300])
    tile = numbers(client.get(f"{url}/tiles/2/2/1.npy"))[0]
    own = np.full((256, 256), np.nan)
    own[:44, :88] = values[256:, 512:]
    assert np.array_equal(np.isnan(tile), np.isnan(own))
    assert np.nanmax(np.abs(tile - own)) < 1e-3
    whole = numbers(client.get(f"{url}/tiles/0/0/0.npy"))[0]
    assert np.isfinite(whole).sum() == 75 * 150
    assert client.get(f"{url}/tiles/2/3/0.png").status_code == 404
    assert client.get(f"{url}/point", params={"lon": 0, "lat": 0}).status_code == 400
    assert client.get(f"{url}/preview.png").status_code == 200


def finished(client: AppClient, folder: Path, tenant: str = "local") -> str:
    """A job that has a result of two bands: codes would be the first, degrees the second."""
    west, north = corner(LEFT, TOP)
    place = rasterio.Affine(CELL, 0, west, 0, -CELL, north)
    terrain = Terrain(np.zeros((272, 272)), None, "EPSG:3857", place)
    layers = np.stack([np.full((272, 272), 3.0), np.full((272, 272), 30.0)]).astype(np.float32)
    cogs.write(
        folder / "result.tif",
        layers,
        terrain,
        names=["north", "east"],
        unit="degree",
        tags={},
        dtype="uint8",
        nodata=255,
        scale=0.5,
        offset=0.0,
    )
    service = client.app.state.service
    job = JobRecord(id=new_id(), tenant=tenant, process="horizon", dataset=new_id(), inputs={})
    service.engine.submit(job)
    service.engine.begin(job.id)
    prefix = f"{tenant}/jobs/{job.id}"
    artefact = service.storage.publish(folder / "result.tif", prefix, "result.tif", "image/tiff")
    service.storage.write_manifest(prefix, {"result": artefact}, {})
    service.engine.succeed(job.id)
    return job.id


def test_a_result_has_the_same_views_with_its_scale_applied(
    client: AppClient, tmp_path: Path
) -> None:
    url = f"/jobs/{finished(client, tmp_path)}"
    tile = numbers(client.get(f"{url}/tiles/{ZOOM}/{LEFT}/{TOP}.npy?bidx=2&bidx=1"))
    assert np.array_equal(tile, np.stack([np.full((256, 256), 30.0), np.full((256, 256), 3.0)]))
    assert client.get(f"{url}/tilejson.json").json()["bands"] == ["north", "east"]
    assert client.get(f"{url}/statistics").json()["b2"]["mean"] == 30.0
    assert client.get(f"{url}/preview.png?bidx=2").status_code == 200
    assert client.get(f"{url}/map.html").status_code == 200
    for path in ("tilejson.json", "statistics", "preview.png", "map.html", "tiles/0/0/0.png"):
        assert client.get(f"/jobs/{new_id()}/{path}").status_code == 404


def test_a_job_that_has_no_result_has_no_views(client: AppClient) -> None:
    job = JobRecord(id=new_id(), tenant="local", process="light", dataset=new_id(), inputs={})
    client.app.state.service.engine.submit(job)
    answer = client.get(f"/jobs/{job.id}/tiles/0/0/0.png")
    assert answer.status_code == 404
    assert answer.json()["type"].endswith("result-not-ready")


def test_a_dataset_whose_file_is_gone_says_so(client: AppClient, tmp_path: Path) -> None:
    url = sent(client, write_dem(tmp_path / "gone.tif", np.ones((9, 9), np.float32)))
    storage = client.app.state.service.storage
    storage.delete(f"local{url}")
    assert client.get(f"{url}/preview.png").status_code == 410


def test_a_process_that_died_is_started_again(client: AppClient, dataset: str) -> None:
    viewer = client.app.state.service.viewers._pool[0]
    viewer._process.kill()
    assert client.get(f"{dataset}/preview.png", params={"max_size": 77}).status_code == 200
    viewer.seconds, kept = 1e-4, viewer.seconds
    late = client.get(f"{dataset}/preview.png", params={"max_size": 78})
    viewer.seconds = kept
    assert late.status_code == 503
    assert late.headers["retry-after"] == "5"
    began = time.monotonic()
    assert client.get(f"{dataset}/preview.png", params={"max_size": 78}).status_code == 200
    assert time.monotonic() - began < 20.0


class Bucket:
    """A store elsewhere: its files have to be fetched."""

    def __init__(self) -> None:
        self.fetched: list[str] = []

    def exists(self, key: str) -> bool:
        return not key.startswith("gone")

    def local(self, key: str, folder: Path) -> Path:
        self.fetched.append(key)
        path = folder / "heights.tif"
        path.write_bytes(key.encode() * 1000)
        return path


def test_copies_of_a_buckets_files_are_kept_up_to_a_limit(tmp_path: Path) -> None:
    bucket = Bucket()
    copies = Copies(bucket, tmp_path / "views", 2500)
    first = copies.path("a")
    assert first.read_bytes() == b"a" * 1000
    assert copies.path("b") != first, "equal names, different files"
    copies.path("a")
    copies.path("c")
    assert bucket.fetched == ["a", "b", "c"]
    assert len([p for p in (tmp_path / "views").rglob("*") if p.is_file()]) == 2
    assert first.exists(), "b was used least recently"
    copies.path("b")
    assert bucket.fetched[-1] == "b"
    with pytest.raises(Problem, match="gone"):
        copies.path("gone")


def test_too_many_waiting_views_are_sent_away(
    client: AppClient, dataset: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("adret_service.viewers.MAX_WAITING", -1)
    answer = client.get(f"{dataset}/preview.png", params={"max_size": 33})
    assert answer.status_code == 503
    assert answer.headers["retry-after"] == "1"
