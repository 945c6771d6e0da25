"""One tenant cannot see, guess, change or delete what is another's, on any route there is."""

import hashlib
import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from servers import AppClient, hill, write_dem

from adret import cogs
from adret.terrain import Terrain
from adret_service.app import create_app
from adret_service.auth import add_key
from adret_service.engine.memory import MemoryEngine
from adret_service.engine.port import JobRecord
from adret_service.ids import new_id
from adret_service.settings import Settings
from adret_service.tokens import TokenMaker

ALPHABET = "0123456789abcdefghjkmnpqrstvwxyz"
TUS = {"Tus-Resumable": "1.0.0"}
SETTINGS: dict[str, Any] = {"rate_api": "9000/s", "rate_submit": "9000/s", "viewers": 1}

# What each operation needs besides the ids to be answered at all.
VALUES: dict[str, Any] = {
    "z": 0,
    "x": 0,
    "y": 0,
    "format": "png",
    "output": "result",
    "process_id": "horizon",
    "lat": 45,
    "lon": 9,
    "Tus-Resumable": "1.0.0",
    "Upload-Offset": 0,
    "Upload-Length": 9,
}


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AppClient]:
    folder = tmp_path_factory.mktemp("isolation")
    settings = Settings(data_dir=folder / "data", min_free_bytes=0, auth="apikey", **SETTINGS)
    with AppClient(create_app(settings, MemoryEngine())) as client:
        yield client


@pytest.fixture(scope="module")
def keys(client: AppClient) -> dict[str, dict[str, str]]:
    path = client.app.state.service.settings.keys_file
    return {
        who: {"X-API-Key": add_key(path, who, ["read", "submit"])[1]} for who in ("alice", "bob")
    }


@pytest.fixture(scope="module")
def owned(
    client: AppClient, keys: dict[str, Any], tmp_path_factory: pytest.TempPathFactory
) -> dict[str, str]:
    """Ids of a dataset, a finished job and an upload in pieces, all of them Alice's."""
    folder = tmp_path_factory.mktemp("owned")
    body = write_dem(folder / "dem.tif", hill(40, 50)).read_bytes()
    dataset = client.post("/uploads", content=body, headers=keys["alice"]).json()["id"]
    service = client.app.state.service
    job = JobRecord(id=new_id(), tenant="alice", process="horizon", dataset=dataset, inputs={})
    service.engine.submit(job)
    service.engine.begin(job.id)
    terrain = Terrain(np.zeros((9, 9)), (1.0, 1.0))
    layer = np.ones((9, 9), np.float32)
    cogs.write(folder / "r.tif", layer, terrain, names=["a"], unit="1", tags={})
    prefix = f"alice/jobs/{job.id}"
    artefact = service.storage.publish(folder / "r.tif", prefix, "result.tif", "image/tiff")
    service.storage.write_manifest(prefix, {"result": artefact}, {})
    service.engine.succeed(job.id)
    headers = keys["alice"] | TUS | {"Upload-Length": "9"}
    upload = client.post("/uploads/tus", headers=headers).headers["location"].rsplit("/", 1)[1]
    return {"dataset_id": dataset, "job_id": job.id, "upload_id": upload}


def operations(client: AppClient) -> list[tuple[str, str, dict[str, Any]]]:
    """Every operation whose path holds an id of somebody's."""
    return [
        (method.upper(), path, operation)
        for path, methods in client.get("/api").json()["paths"].items()
        for method, operation in methods.items()
        if any(name in path for name in ("{dataset_id}", "{job_id}", "{upload_id}"))
    ]


def call(
    client: AppClient,
    method: str,
    path: str,
    operation: dict[str, Any],
    ids: dict[str, str],
    key: Any,
) -> Any:
    """Send an operation with these ids and whatever else it asks for."""
    query, headers = {}, dict(key)
    for parameter in operation.get("parameters", ()):
        name, place = parameter["name"], parameter["in"]
        if (place != "path" and parameter.get("required")) or name == "Tus-Resumable":
            (headers if place == "header" else query)[name] = str(VALUES[name])
    if method == "PATCH":
        headers["Content-Type"] = "application/offset+octet-stream"
    url = path.format(**VALUES | ids)
    return client.request(method, url, params=query, headers=headers)


def digest(client: AppClient, keys: dict[str, Any], owned: dict[str, str]) -> str:
    """All that Alice sees of her things."""
    paths = (
        f"/datasets/{owned['dataset_id']}",
        f"/jobs/{owned['job_id']}",
        f"/jobs/{owned['job_id']}/results/result",
        f"/uploads/tus/{owned['upload_id']}",
        "/datasets",
        "/jobs",
    )
    answers = [client.get(path, headers=keys["alice"]) for path in paths]
    assert [answer.status_code for answer in answers] == [200] * len(paths)
    return hashlib.sha256(b"".join(answer.content for answer in answers)).hexdigest()


def test_there_are_the_routes_that_this_file_is_about(client: AppClient) -> None:
    paths = {path for _, path, _ in operations(client)}
    assert len(paths) >= 20
    assert "/datasets/{dataset_id}/tiles/{z}/{x}/{y}.{format}" in paths
    assert "/jobs/{job_id}/tiles/{z}/{x}/{y}.{format}" in paths
    assert "/datasets/{dataset_id}/horizon" in paths
    assert "/uploads/tus/{upload_id}" in paths


def test_anothers_ids_are_answered_like_ids_of_nothing(
    client: AppClient, keys: dict[str, Any], owned: dict[str, str]
) -> None:
    before = digest(client, keys, owned)
    nothing = {name: new_id() for name in owned}
    for method, path, operation in operations(client):
        theirs = call(client, method, path, operation, owned, keys["bob"])
        empty = call(client, method, path, operation, nothing, keys["bob"])
        assert theirs.status_code == empty.status_code == 404, f"{method} {path}: {theirs.text}"
        if theirs.content:
            text = theirs.text
            for name, id_ in owned.items():
                text = text.replace(id_, nothing[name])
            told, other = json.loads(text), empty.json()
            for unlike in ("instance", "request_id"):
                told.pop(unlike)
                other.pop(unlike)
            assert told == other, f"{method} {path}"
        assert "etag" not in theirs.headers
    assert digest(client, keys, owned) == before


def test_ids_near_a_known_one_are_ids_of_nothing(
    client: AppClient, keys: dict[str, Any], owned: dict[str, str]
) -> None:
    """Bob knows the id of a thing of his own, made just then, and counts on from there."""
    kinds = {
        "dataset_id": "/datasets/{}/tilejson.json",
        "job_id": "/jobs/{}/tilejson.json",
        "upload_id": "/uploads/tus/{}",
    }
    for name, path in kinds.items():
        known = owned[name]
        near = {known[:-1] + letter for letter in ALPHABET}
        near |= {known[:-2] + letter + known[-1] for letter in ALPHABET}
        near |= {known.upper(), known[:-1], known + "0", f"../{known}", f"alice/{known}"}
        for guess in near:
            answer = client.get(path.format(guess), headers=keys["bob"])
            assert answer.status_code == 404, guess


def test_lists_hold_only_ones_own(
    client: AppClient, keys: dict[str, Any], owned: dict[str, str]
) -> None:
    for path in ("/datasets", "/jobs"):
        seen = client.get(path, headers=keys["bob"]).text
        assert not any(value in seen for value in owned.values())
    order = {"inputs": {"dataset": owned["dataset_id"], "directions": 8}}
    headers = keys["bob"] | {"Content-Type": "application/json"}
    answer = client.post("/processes/horizon/execution", content=json.dumps(order), headers=headers)
    assert answer.status_code == 400
    assert answer.json()["errors"][0]["field"] == "inputs.dataset"


def test_a_view_that_the_owner_had_made_is_not_given_to_another(
    client: AppClient, keys: dict[str, Any], owned: dict[str, str]
) -> None:
    for path in (f"/datasets/{owned['dataset_id']}", f"/jobs/{owned['job_id']}"):
        mine = client.get(f"{path}/preview.png", headers=keys["alice"])
        assert mine.status_code == 200
        condition = {"If-None-Match": mine.headers["etag"]}
        theirs = client.get(f"{path}/preview.png", headers=keys["bob"] | condition)
        assert theirs.status_code == 404


def test_a_map_sees_one_raster_by_its_token_and_nothing_else(
    client: AppClient, keys: dict[str, Any], owned: dict[str, str]
) -> None:
    mine, other = f"/datasets/{owned['dataset_id']}", f"/jobs/{owned['job_id']}"
    grid = client.get(f"{mine}/tilejson.json?bidx=1", headers=keys["alice"]).json()
    url = grid["tiles"][0].format(z=0, x=0, y=0).removeprefix("http://127.0.0.1")
    assert "bidx=1&token=alice." in url
    token = {"token": url.rsplit("token=", 1)[1]}
    assert client.get(url).status_code in (200, 204), "so small a raster may miss every pixel"
    for name in ("map.html", "preview.png", "tilejson.json"):
        assert client.get(f"{mine}/{name}", params=token).status_code == 200
    page = grid["map"].removeprefix("http://127.0.0.1")
    assert client.get(page).status_code == 200
    for method, path in (
        ("GET", mine),
        ("DELETE", mine),
        ("GET", f"{mine}/statistics"),
        ("GET", "/datasets"),
        ("GET", other),
        ("GET", f"{other}/preview.png"),
        ("GET", f"{other}/results/result"),
        ("GET", f"/datasets/{new_id()}/preview.png"),
    ):
        assert client.request(method, path, params=token).status_code == 401, path


def test_a_token_that_was_changed_or_has_ended_opens_nothing(
    client: AppClient, owned: dict[str, str]
) -> None:
    path = f"/datasets/{owned['dataset_id']}"
    maker = client.app.state.service.tokens
    good = maker.make("alice", path)
    tenant, end, signed = good.split(".")
    old = TokenMaker(maker._secret, -10.0).make("alice", path)
    forged = TokenMaker(b"guess", 60.0).make("alice", path)
    for token in (
        f"bob.{end}.{signed}",
        f"{tenant}.{int(end) + 1}.{signed}",
        f"{tenant}.{end}.{signed[:-1]}0" if signed[-1] != "0" else f"{tenant}.{end}.{signed[:-1]}1",
        old,
        forged,
        "",
        "alice",
        "é" * 50,
    ):
        answer = client.get(f"{path}/preview.png", params={"token": token})
        assert answer.status_code == 401, token
    assert client.get(f"{path}/preview.png", params={"token": good}).status_code == 200
    secret = client.app.state.service.settings.data_dir / "token.secret"
    assert secret.stat().st_mode & 0o077 == 0
