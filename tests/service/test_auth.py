"""Keys, scopes, tenants, quotas and rates."""

import json
import os
import stat
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from servers import ADRET, AppClient
from test_api import INFO, problem

from adret_service.app import create_app
from adret_service.auth import KeyFile, add_key, remove_key
from adret_service.engine.memory import MemoryEngine
from adret_service.ids import new_id
from adret_service.settings import Settings

LIMITS: dict[str, Any] = {
    "tenant_max_jobs": 2,
    "tenant_cells_per_day": 7_000,
    "tenant_max_bytes": 5_000_000,
    "rate_api": "40/h",
    "rate_submit": "12/h",
}


class Caller:
    """The application as one key's owner sees it."""

    def __init__(self, client: AppClient, key: str | None) -> None:
        self.client = client
        self.headers = {} if key is None else {"Authorization": f"Bearer {key}"}

    def call(self, method: str, path: str, **options: Any) -> Any:
        headers = {**self.headers, **options.pop("headers", {})}
        return self.client.request(method, path, headers=headers, **options)

    def order(self, dataset: str) -> Any:
        body = json.dumps({"inputs": {"dataset": dataset, "directions": 8}})
        headers = {"Content-Type": "application/json"}
        return self.call("POST", "/processes/horizon/execution", content=body, headers=headers)


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return Settings(data_dir=tmp_path / "data", min_free_bytes=0, auth="apikey", **LIMITS)


@pytest.fixture
def client(settings: Settings) -> Iterator[AppClient]:
    with AppClient(create_app(settings, MemoryEngine())) as client:
        yield client


@pytest.fixture
def alice(client: AppClient, settings: Settings) -> Caller:
    return Caller(client, add_key(settings.keys_file, "alice", ["read", "submit"])[1])


@pytest.fixture
def bob(client: AppClient, settings: Settings) -> Caller:
    return Caller(client, add_key(settings.keys_file, "bob", ["read", "submit"])[1])


def catalogued(client: AppClient, tenant: str, dem: Path) -> str:
    catalogue = client.app.state.service.catalogue
    raster = dem.with_name(f"{tenant}.tif")
    raster.write_bytes(dem.read_bytes())
    return str(
        catalogue.add(tenant, raster, sha256="0" * 64, name="x", upload_bytes=1, info=INFO).id
    )


NOBODYS = "01jd5z8k5v4k2m9qf7xw3hbn6t"

DOORS = [
    ("GET", "/jobs"),
    ("GET", "/datasets"),
    ("POST", "/uploads"),
    ("GET", f"/jobs/{NOBODYS}"),
    ("GET", f"/jobs/{NOBODYS}/events"),
    ("GET", f"/jobs/{NOBODYS}/logs"),
    ("POST", f"/jobs/{NOBODYS}/retry"),
    ("DELETE", f"/jobs/{NOBODYS}"),
    ("GET", f"/jobs/{NOBODYS}/results"),
    ("GET", f"/jobs/{NOBODYS}/results/result"),
    ("GET", f"/datasets/{NOBODYS}"),
    ("DELETE", f"/datasets/{NOBODYS}"),
]


@pytest.mark.parametrize(("method", "path"), DOORS)
@pytest.mark.parametrize("key", [None, "adret_wrong", ""])
def test_without_a_known_key_every_door_is_shut(
    client: AppClient, method: str, path: str, key: str | None
) -> None:
    answer = Caller(client, key).call(method, path)
    problem(answer, 401)
    assert answer.headers["www-authenticate"].startswith("Bearer")


def test_every_route_asks_for_a_key_unless_it_is_meant_for_all(client: AppClient) -> None:
    open_to_all = {"/", "/conformance", "/processes", "/healthz", "/readyz"}
    paths = client.get("/api").json()["paths"]
    for path, operations in paths.items():
        for method, operation in operations.items():
            public = path in open_to_all or path == "/processes/{process_id}"
            assert ("security" in operation) != public, f"{method} {path}"


def test_a_key_opens_its_doors_in_either_header(client: AppClient, alice: Caller) -> None:
    assert alice.call("GET", "/jobs").status_code == 200
    key = alice.headers["Authorization"].removeprefix("Bearer ")
    assert client.get("/jobs", headers={"X-API-Key": key}).status_code == 200
    assert client.get("/healthz").status_code == 200
    assert client.get("/processes").status_code == 200


def test_a_reader_may_not_order(client: AppClient, settings: Settings, small_dem: Path) -> None:
    reader = Caller(client, add_key(settings.keys_file, "alice", ["read"])[1])
    dataset = catalogued(client, "alice", small_dem)
    assert reader.call("GET", f"/datasets/{dataset}").status_code == 200
    assert "must have submit" in problem(reader.order(dataset), 403)["detail"]
    problem(reader.call("DELETE", f"/datasets/{dataset}"), 403)


def test_a_removed_key_is_known_no_more(
    client: AppClient, settings: Settings, alice: Caller
) -> None:
    assert alice.call("GET", "/jobs").status_code == 200
    (entry,) = json.loads(settings.keys_file.read_text())["keys"]
    assert remove_key(settings.keys_file, entry["id"])
    problem(alice.call("GET", "/jobs"), 401)


def test_one_tenant_cannot_see_guess_or_delete_what_is_anothers(
    client: AppClient, alice: Caller, bob: Caller, small_dem: Path
) -> None:
    dataset = catalogued(client, "alice", small_dem)
    job = alice.order(dataset).json()["jobID"]
    for method, path in (
        ("GET", f"/datasets/{dataset}"),
        ("DELETE", f"/datasets/{dataset}"),
        ("GET", f"/jobs/{job}"),
        ("GET", f"/jobs/{job}/events"),
        ("GET", f"/jobs/{job}/logs"),
        ("GET", f"/jobs/{job}/results"),
        ("GET", f"/jobs/{job}/results/result"),
        ("POST", f"/jobs/{job}/retry"),
        ("DELETE", f"/jobs/{job}"),
    ):
        theirs = bob.call(method, path)
        nobodys = new_id()
        unknown = bob.call(method, path.replace(dataset, nobodys).replace(job, nobodys))
        assert theirs.status_code == unknown.status_code == 404, f"{method} {path}"
        told = theirs.json()["detail"].replace(dataset, nobodys).replace(job, nobodys)
        assert told == unknown.json()["detail"]
    refused = problem(bob.order(dataset), 400)
    assert refused["errors"][0]["limit"] == "the id of an existing dataset"
    assert bob.call("GET", "/jobs").json()["jobs"] == []
    assert bob.call("GET", "/datasets").json()["datasets"] == []
    assert alice.call("GET", f"/jobs/{job}").json()["status"] == "accepted"


def test_a_key_of_one_tenants_order_is_not_anothers(
    client: AppClient, alice: Caller, bob: Caller, small_dem: Path
) -> None:
    orders = []
    for caller, tenant in ((alice, "alice"), (bob, "bob")):
        caller.headers["Idempotency-Key"] = "same"
        orders.append(caller.order(catalogued(client, tenant, small_dem)).json()["jobID"])
    assert orders[0] != orders[1]


def test_quotas_say_what_is_full_and_when_to_come_again(
    client: AppClient, alice: Caller, bob: Caller, small_dem: Path
) -> None:
    dataset = catalogued(client, "alice", small_dem)
    jobs = [alice.order(dataset).json()["jobID"] for _ in range(2)]
    refused = alice.order(dataset)
    body = problem(refused, 429)
    assert body["errors"] == [
        {"field": "jobs", "limit": "below 2 that are not finished", "value": 2}
    ]
    assert int(refused.headers["retry-after"]) > 0
    assert bob.order(catalogued(client, "bob", small_dem)).status_code == 201
    alice.call("DELETE", f"/jobs/{jobs[0]}")
    assert alice.order(dataset).status_code == 201
    alice.call("DELETE", f"/jobs/{jobs[1]}")
    refused = alice.order(dataset)
    assert problem(refused, 429)["errors"][0]["field"] == "cells"
    assert 0 < int(refused.headers["retry-after"]) <= 86_400


def test_uploads_have_a_quota(client: AppClient, alice: Caller, small_dem: Path) -> None:
    body = small_dem.read_bytes()
    client.app.state.service.catalogue.stored_bytes = lambda tenant: 4_999_999
    answer = alice.call("POST", "/uploads", content=body)
    assert problem(answer, 413)["errors"][0]["field"] == "bytes"


def test_who_asks_too_often_is_told_when_to_come_again(alice: Caller, bob: Caller) -> None:
    answers = [alice.call("GET", "/jobs") for _ in range(41)]
    assert [answer.status_code for answer in answers] == [200] * 40 + [429]
    assert answers[0].headers["ratelimit-policy"] == '"default";q=40;w=3600'
    assert answers[0].headers["ratelimit"].startswith('"default";r=39;')
    assert 0 < int(answers[-1].headers["retry-after"]) <= 90
    assert alice.call("POST", f"/jobs/{new_id()}/retry").status_code == 404, "another bucket"
    assert bob.call("GET", "/jobs").status_code == 200


def test_keys_are_kept_as_digests_that_nobody_else_can_read(tmp_path: Path) -> None:
    path = tmp_path / "keys.json"
    _, secret = add_key(path, "alice", ["read"])
    assert secret not in path.read_text()
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    found = KeyFile(path).find(secret)
    assert found is not None
    assert (found.tenant, found.scopes) == ("alice", {"read"})
    for tenant, scopes in (("Alice", ["read"]), ("../x", ["read"]), ("a", ["root"]), ("a", [])):
        with pytest.raises(ValueError, match=r"tenant|scope"):
            add_key(path, tenant, scopes)


def test_keys_are_made_listed_and_removed_at_the_command_line(tmp_path: Path) -> None:
    def keys(*options: str) -> "subprocess.CompletedProcess[str]":
        command = [str(ADRET), "keys", *options]
        environment = {**os.environ, "ADRET_DATA_DIR": str(tmp_path)}
        return subprocess.run(command, capture_output=True, text=True, env=environment)

    key_id, secret = keys("--tenant", "alice", "--scope", "read").stdout.split()
    assert KeyFile(tmp_path / "keys.json").find(secret) is not None
    assert keys().stdout.split() == [key_id, "alice", "read"]
    assert keys("--tenant", "A!").returncode == 2
    assert keys("--remove", key_id).returncode == 0
    assert keys("--remove", key_id).returncode == 2
    assert keys().stdout == ""
