"""Uploads in pieces by tus 1.0: what came is kept, and nothing else."""

import base64
import hashlib
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from servers import AppClient, hill, write_dem

from adret_service.app import create_app
from adret_service.auth import add_key
from adret_service.engine.memory import MemoryEngine
from adret_service.settings import Settings

TUS = {"Tus-Resumable": "1.0.0"}
PIECE = TUS | {"Content-Type": "application/offset+octet-stream"}


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return Settings(data_dir=tmp_path / "data", min_free_bytes=0, max_upload_bytes=10**6)


@pytest.fixture
def client(settings: Settings) -> Iterator[AppClient]:
    with AppClient(create_app(settings, MemoryEngine())) as client:
        yield client


@pytest.fixture
def body(tmp_path: Path) -> bytes:
    return write_dem(tmp_path / "dem.tif", hill(40, 50)).read_bytes()


def name(text: str) -> str:
    return f"filename {base64.b64encode(text.encode()).decode()},filetype aW1hZ2U="


def begun(client: AppClient, length: int, query: str = "", **headers: str) -> str:
    answer = client.post(
        f"/uploads/tus{query}", headers=TUS | {"Upload-Length": str(length)} | headers
    )
    assert answer.status_code == 201, answer.text
    assert answer.headers["tus-resumable"] == "1.0.0"
    return str(answer.headers["location"])


def patch(client: AppClient, url: str, data: bytes, at: int, **headers: str) -> Any:
    more = {name.replace("_", "-"): value for name, value in headers.items()}
    return client.request(
        "PATCH", url, content=data, headers=PIECE | {"Upload-Offset": str(at)} | more
    )


def partial_files(settings: Settings) -> list[Path]:
    return [p for p in (settings.data_dir / "partial").rglob("*") if p.is_file()]


def test_the_server_says_what_it_understands(client: AppClient) -> None:
    answer = client.request("OPTIONS", "/uploads/tus")
    assert answer.status_code == 204
    assert answer.headers["tus-version"] == "1.0.0"
    assert answer.headers["tus-extension"] == "creation,termination,checksum,expiration"
    assert answer.headers["tus-max-size"] == "1000000"
    assert "sha256" in answer.headers["tus-checksum-algorithm"]


def test_pieces_become_the_same_dataset_as_the_whole(
    client: AppClient, settings: Settings, body: bytes
) -> None:
    url = begun(client, len(body), **{"Upload-Metadata": name("../my dem.tif")})
    at = 0
    for size in (1, 1000, 5000, len(body)):
        answer = patch(client, url, body[at : at + size], at)
        assert answer.status_code == 204, answer.text
        at = min(at + size, len(body))
        assert answer.headers["upload-offset"] == str(at)
        state = client.request("HEAD", url, headers=TUS)
        assert (state.status_code, state.headers["upload-offset"]) == (200, str(at))
        assert state.headers["upload-length"] == str(len(body))
        assert state.headers["cache-control"] == "no-store"
    told = client.get(url).json()
    dataset = client.get(answer.headers["content-location"]).json()
    assert (told["dataset"], told["offset"]) == (dataset["id"], len(body))
    assert (dataset["name"], dataset["sha256"]) == ("my dem.tif", hashlib.sha256(body).hexdigest())
    assert client.post("/uploads", content=body).json()["id"] == dataset["id"]
    assert [path.name for path in partial_files(settings)] == ["note.json"]
    assert client.request("DELETE", url, headers=TUS).status_code == 204
    assert partial_files(settings) == []
    assert client.get(f"/datasets/{dataset['id']}").status_code == 200


def test_an_upload_goes_on_after_the_server_was_started_again(
    settings: Settings, body: bytes
) -> None:
    with AppClient(create_app(settings, MemoryEngine())) as client:
        url = begun(client, len(body), "?vertical_unit=ft")
        assert patch(client, url, body[:7000], 0).status_code == 204
    with AppClient(create_app(settings, MemoryEngine())) as client:
        assert client.request("HEAD", url, headers=TUS).headers["upload-offset"] == "7000"
        answer = patch(client, url, body[7000:], 7000)
        dataset = client.get(answer.headers["content-location"]).json()
        assert dataset["source"]["vertical_unit"] == "ft"
        assert dataset["highest"] == pytest.approx(500 * 0.3048, rel=0.01)


def test_a_piece_must_begin_where_the_last_ended(client: AppClient, body: bytes) -> None:
    url = begun(client, len(body))
    patch(client, url, body[:100], 0)
    for at in (0, 99, 101):
        answer = patch(client, url, body[at : at + 10], at)
        assert answer.status_code == 409
        assert answer.json()["errors"][0] == {"field": "Upload-Offset", "limit": "100", "value": at}
    assert client.request("HEAD", url, headers=TUS).headers["upload-offset"] == "100"


def test_a_piece_that_is_not_what_its_checksum_says_is_forgotten(
    client: AppClient, body: bytes
) -> None:
    url = begun(client, len(body))
    right = base64.b64encode(hashlib.sha1(body[:500], usedforsecurity=False).digest()).decode()
    wrong = patch(client, url, body[1:501], 0, Upload_Checksum=f"sha1 {right}")
    assert wrong.status_code == 460
    assert wrong.json()["title"] == "Checksum Mismatch"
    assert client.request("HEAD", url, headers=TUS).headers["upload-offset"] == "0"
    assert patch(client, url, body[:500], 0, Upload_Checksum=f"sha1 {right}").status_code == 204
    for text in ("crc32 AAAA", "sha1 ???", "sha1 AAAA", "sha256"):
        answer = patch(client, url, b"x", 500, Upload_Checksum=text)
        assert answer.json()["errors"][0]["field"] == "Upload-Checksum"


def test_more_than_was_announced_is_refused(client: AppClient, body: bytes) -> None:
    url = begun(client, 100)
    answer = patch(client, url, body[:101], 0)
    assert answer.status_code == 413
    assert answer.json()["errors"][0]["limit"] == "at most the announced 100 bytes"


def test_a_file_that_cannot_be_read_is_refused_and_leaves_nothing(
    client: AppClient, settings: Settings
) -> None:
    url = begun(client, 26)
    patch(client, url, b"<VRTDataset rasterX", 0)
    answer = patch(client, url, b"Size=8>", 19)
    assert answer.status_code == 415, answer.text
    assert answer.json()["errors"][0]["field"] == "file"
    assert client.request("HEAD", url, headers=TUS).status_code == 404
    assert partial_files(settings) == []


@pytest.mark.parametrize(
    ("headers", "status", "field"),
    [
        ({}, 412, "Tus-Resumable"),
        ({"Tus-Resumable": "0.2.2"}, 412, "Tus-Resumable"),
        (TUS, 400, "Upload-Length"),
        (TUS | {"Upload-Length": "-1"}, 400, "Upload-Length"),
        (TUS | {"Upload-Length": "0"}, 400, "Upload-Length"),
        (TUS | {"Upload-Length": "1e3"}, 400, "Upload-Length"),
        (TUS | {"Upload-Length": str(10**7)}, 413, "Upload-Length"),
        (TUS | {"Upload-Length": "9", "Upload-Metadata": "filename ?"}, 400, "Upload-Metadata"),
    ],
)
def test_an_upload_that_cannot_begin_is_refused_by_name(
    client: AppClient, settings: Settings, headers: dict[str, str], status: int, field: str
) -> None:
    answer = client.post("/uploads/tus", headers=headers)
    assert answer.status_code == status, answer.text
    assert answer.json()["errors"][0]["field"] == field
    assert partial_files(settings) == []


def test_a_piece_of_another_kind_is_refused(client: AppClient) -> None:
    url = begun(client, 9)
    headers = TUS | {"Upload-Offset": "0", "Content-Type": "text/plain"}
    assert client.request("PATCH", url, content=b"x", headers=headers).status_code == 415
    assert client.request("PATCH", url, content=b"x", headers=PIECE).status_code == 400


def test_one_request_at_a_time_writes(client: AppClient) -> None:
    url = begun(client, 9)
    partials = client.app.state.service.partials
    partial = partials.find(url.rsplit("/", 1)[1], "local")
    with partials.writing(partial):
        assert patch(client, url, b"abc", 0).status_code == 423
        assert client.request("DELETE", url, headers=TUS).status_code == 423
    assert patch(client, url, b"abc", 0).status_code == 204


def test_uploads_that_nobody_continues_are_forgotten(client: AppClient, settings: Settings) -> None:
    url = begun(client, 9)
    folder = settings.data_dir / "partial" / "local" / url.rsplit("/", 1)[1]
    old = time.time() - settings.upload_ttl - 9
    for path in (folder / "upload", folder):
        os.utime(path, (old, old))
    begun(client, 9)
    assert client.request("HEAD", url, headers=TUS).status_code == 404
    assert not folder.exists()


def test_other_tenants_cannot_see_continue_or_end_an_upload(tmp_path: Path, body: bytes) -> None:
    settings = Settings(
        data_dir=tmp_path / "data", min_free_bytes=0, auth="apikey", tenant_max_bytes=20_000
    )
    with AppClient(create_app(settings, MemoryEngine())) as client:
        keys = {who: add_key(settings.keys_file, who, ["read", "submit"])[1] for who in ("a", "b")}
        headers = {who: {"X-API-Key": key} for who, key in keys.items()}
        url = begun(client, len(body), **headers["a"])
        for method in ("HEAD", "GET", "DELETE"):
            assert client.request(method, url, headers=TUS | headers["b"]).status_code == 404
        assert patch(client, url, b"x", 0, **headers["b"]).status_code == 404
        assert patch(client, url, b"x", 0).status_code == 401
        more = headers["a"] | TUS | {"Upload-Length": str(20_000 - len(body) + 1)}
        full = client.post("/uploads/tus", headers=more)
        assert full.status_code == 413
        assert full.json()["errors"][0]["field"] == "bytes"
        assert patch(client, url, body, 0, **headers["a"]).status_code == 204


def arrays(folder: Path, **kinds: Any) -> Path:
    path = folder / "a.npz"
    np.savez_compressed(path, **kinds)
    return path


def test_arrays_become_terrain_with_a_georeference(client: AppClient, tmp_path: Path) -> None:
    heights = hill(20, 30)
    heights[5, 6] = -9999.0
    np.save(tmp_path / "a.npy", heights)
    place = '{"crs": "EPSG:32632", "transform": [30, 0, 4e5, 0, -30, 5e6], "nodata": -9999}'
    for path in (tmp_path / "a.npy", arrays(tmp_path, heights=heights, other=np.ones(3))):
        answer = client.post("/uploads", content=path.read_bytes(), params={"georeference": place})
        assert answer.status_code == 201, answer.text
        told = answer.json()
        assert (told["epsg"], told["transform"]) == (32632, [30, 0, 4e5, 0, -30, 5e6])
        assert (told["rows"], told["columns"], told["nodata_cells"]) == (20, 30, 2)
        assert told["highest"] == pytest.approx(float(np.nanmax(heights)), abs=1e-3)
        assert told["cell_size"][0] == pytest.approx(30.0, rel=1e-3)
        assert told["source"]["driver"] == path.suffix[1:].upper()
    plain = client.post("/uploads", content=path.read_bytes(), params={"cell_size": 5})
    assert plain.json()["cell_size"] == [5.0, 5.0]
    assert plain.json()["crs"] is None


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({}, "cell_size"),
        ({"georeference": "{"}, "georeference"),
        ({"georeference": "[]"}, "georeference"),
        ({"georeference": '{"colour": 1}'}, "georeference.colour"),
        ({"georeference": '{"crs": "EPSG:2056"}'}, "cell_size"),
        ({"georeference": '{"crs": "+proj=utm +nadgrids=/etc/passwd"}'}, "georeference.crs"),
        ({"georeference": '{"crs": "EPSG:99999999"}', "cell_size": 1}, "crs"),
        ({"georeference": '{"transform": [1, 0, 0, 0, -1]}'}, "georeference.transform"),
        ({"georeference": '{"transform": [1, 1, 0, 0, -1, 0]}'}, "georeference.transform"),
        ({"georeference": '{"transform": [1, 0, 0, 0, 1, 0]}'}, "georeference.transform"),
        ({"georeference": '{"transform": [1, 0, NaN, 0, -1, 0]}'}, "georeference.transform"),
        ({"georeference": '{"transform": [0.01, 0, 7, 0, -0.01, 46]}'}, "georeference.crs"),
        ({"georeference": '{"nodata": "x"}', "cell_size": 1}, "georeference.nodata"),
        ({"georeference": '{"nodata": 1e999}', "cell_size": 1}, "georeference.nodata"),
        ({"cell_size": 1, "band": 2}, "band"),
        ({"cell_size": 1, "vertical_unit": "parsec"}, "vertical_unit"),
    ],
)
def test_an_array_without_a_place_is_refused_by_name(
    client: AppClient, tmp_path: Path, options: dict[str, Any], field: str
) -> None:
    np.save(tmp_path / "a.npy", hill(4, 5))
    answer = client.post("/uploads", content=(tmp_path / "a.npy").read_bytes(), params=options)
    assert answer.status_code == 400, answer.text
    assert answer.json()["errors"][0]["field"] == field, answer.text


def test_a_geotiff_has_its_own_georeference(client: AppClient, body: bytes) -> None:
    answer = client.post("/uploads", content=body, params={"georeference": "{}"})
    assert answer.json()["errors"][0]["field"] == "georeference"
