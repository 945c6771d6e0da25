"""The HTTP surface in-process, with the in-memory engine: statuses, bodies, links, paging."""

import json
from collections.abc import AsyncIterator, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from servers import AppClient

from adret.products import PRODUCTS
from adret_service import processes
from adret_service.app import create_app
from adret_service.engine.memory import MemoryEngine
from adret_service.engine.port import JobRecord, JobStatus
from adret_service.ids import new_id
from adret_service.problems import Problem
from adret_service.settings import Settings

PROBLEM_KEYS = {"type", "title", "status", "detail", "instance", "errors", "request_id"}
INFO = {
    "rows": 40,
    "columns": 50,
    "cell_size": [30.0, 30.0],
    "crs": None,
    "crs_name": None,
    "epsg": None,
    "transform": None,
    "datum": 0.0,
    "lowest": 0.0,
    "highest": 500.0,
    "nodata_cells": 1,
}
OGC = "http://www.opengis.net/def/exceptions/ogcapi-processes-1/1.0/"


@pytest.fixture
def engine() -> MemoryEngine:
    return MemoryEngine()


@pytest.fixture
def client(tmp_path: Path, engine: MemoryEngine) -> Iterator[AppClient]:
    settings = Settings(data_dir=tmp_path / "data", min_free_bytes=0, queue_max=3)
    with AppClient(create_app(settings, engine)) as client:
        yield client


@pytest.fixture
def known(client: AppClient, small_dem: Path) -> str:
    """A dataset's id, catalogued without decoding."""
    catalogue = client.app.state.service.catalogue
    raster = small_dem.rename(small_dem.with_name("heights.tif"))
    return str(
        catalogue.add("local", raster, sha256="0" * 64, name="x", upload_bytes=1, info=INFO).id
    )


def order(client: AppClient, process: str, **inputs: Any) -> Any:
    return client.post(
        f"/processes/{process}/execution",
        content=json.dumps({"inputs": inputs}),
        headers={"Content-Type": "application/json"},
    )


def problem(answer: Any, status: int) -> dict[str, Any]:
    """Check the form of a refusal and return it."""
    assert answer.status_code == status, answer.text
    body = dict(answer.json())
    assert set(body) == PROBLEM_KEYS
    assert body["status"] == status
    assert body["request_id"] == answer.headers["x-request-id"]
    assert answer.headers["content-type"] == "application/json"
    return body


def test_the_landing_page_links_to_what_exists(client: AppClient) -> None:
    links = client.get("/").json()["links"]
    rels = {link["rel"].rsplit("/", 1)[-1] for link in links}
    assert rels == {
        "self",
        "service-desc",
        "service-doc",
        "conformance",
        "processes",
        "job-list",
    }
    for link in links:
        assert client.get(link["href"]).status_code == 200, link
    assert all(
        c.startswith("http://www.opengis.net/")
        for c in client.get("/conformance").json()["conformsTo"]
    )


def test_processes_are_described_by_their_own_schemas(client: AppClient) -> None:
    listed = client.get("/processes").json()["processes"]
    assert [p["id"] for p in listed] == list(PRODUCTS)
    for summary in listed:
        described = client.get(f"/processes/{summary['id']}").json()
        assert described["jobControlOptions"] == ["async-execute", "dismiss"]
        assert described["inputs"]["dataset"]["minOccurs"] == 1
        assert "environment" not in described["inputs"]
        for entry in described["inputs"].values():
            assert entry["description"], entry
        assert set(described["outputs"]) == {"result", "preview"}
    directions = client.get("/processes/horizon").json()["inputs"]["directions"]["schema"]
    assert directions == {"type": "integer", "minimum": 1, "maximum": 7200, "default": 64}
    observer = client.get("/processes/viewshed").json()["inputs"]["observer"]["schema"]
    pair = {"type": "array", "items": {"type": "integer", "minimum": 0}}
    assert observer["items"] == pair | {"minItems": 2, "maxItems": 2}
    assert (observer["minItems"], observer["maxItems"]) == (1, 7200)


def test_the_list_of_processes_has_pages(client: AppClient) -> None:
    page = client.get("/processes?limit=2&offset=1").json()
    assert [p["id"] for p in page["processes"]] == ["sky-view", "openness"]
    following = next(link["href"] for link in page["links"] if link["rel"] == "next")
    assert [p["id"] for p in client.get(following).json()["processes"]] == ["shadow", "light"]


def test_an_order_is_accepted_with_its_location(client: AppClient, known: str) -> None:
    answer = client.post(
        "/processes/horizon/execution",
        json={"inputs": {"dataset": known, "directions": 16}},
        headers={"Prefer": "respond-async "},
    )
    assert answer.status_code == 201
    assert answer.headers["preference-applied"] == "respond-async"
    info = client.get(answer.headers["location"]).json()
    assert info == answer.json()
    assert info["status"] == "accepted"
    assert info["inputs"]["directions"] == 16
    assert {"jobID", "id", "type", "processID", "created"} <= set(info)
    waiting = problem(client.get(answer.headers["location"] + "/results"), 404)
    assert waiting["type"] == OGC + "result-not-ready"


def test_every_wrong_input_is_named_at_once(client: AppClient) -> None:
    body = problem(
        order(
            client,
            "light",
            dataset="../../etc/passwd",
            directions=0,
            method="magic",
            environment="/etc/passwd",
            refraction="thick",
            sun_deg=[1.0],
        ),
        400,
    )
    fields = [error["field"] for error in body["errors"]]
    assert sorted(fields) == sorted(
        [
            "inputs.dataset",
            "inputs.directions",
            "inputs.method",
            "inputs.refraction",
            "inputs.sun_deg",
            "inputs.environment",
        ]
    )
    assert all(error["limit"] for error in body["errors"])
    assert {"field": "inputs.directions", "limit": "greater than or equal to 1", "value": 0} in (
        body["errors"]
    )
    assert body["type"].startswith(OGC)


@pytest.mark.parametrize(
    ("inputs", "field"),
    [
        ({"sky": "none"}, "inputs.sky"),
        ({"sun_deg": [0.0, 95.0]}, "inputs.sun_deg"),
        ({"sky": "uniform", "directions": True}, "inputs.directions"),
        ({"sky": "uniform", "directions": 10**400}, "inputs.directions"),
        ({"sky": "uniform", "directions": "automatic"}, "inputs.directions"),
        ({"sky": "uniform", "directions": None}, "inputs.directions"),
        ({"sky": "uniform", "tolerance": 0.1}, "inputs.tolerance"),
        ({"sky": "uniform", "max_distance": 0}, "inputs.max_distance"),
        ({"sky": "uniform", "max_distance": 10**400}, "inputs.max_distance"),
        ({"sky": "uniform", "azimuths_deg": []}, "inputs.azimuths_deg"),
        ({"sky": "uniform", "azimuths_deg": [0.0] * 7201}, "inputs.azimuths_deg"),
        ({"sky": "uniform", "dataset": "0" * 26}, "inputs.dataset"),
        ({"sky": "uniform", "a\ud800": 1}, "inputs.body"),
    ],
)
def test_a_wrong_input_is_named(
    client: AppClient, known: str, inputs: dict[str, Any], field: str
) -> None:
    body = problem(order(client, "light", **({"dataset": known} | inputs)), 400)
    assert [error["field"] for error in body["errors"]] == [field]


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"{",
        b"[]",
        b"null",
        b'{"inputs": 3}',
        b'{"inputs": {}, "x": 1}',
        b"[" * 100_000,
        b'{"inputs": {"directions": NaN}}',
        b'{"inputs":{"directions":' + b"9" * 5000 + b"}}",
        b"\xff\xfe{}",
        b'{"inputs": {}, "outputs": {"other": {}}}',
    ],
)
def test_a_broken_body_is_a_400(client: AppClient, body: bytes) -> None:
    headers = {"Content-Type": "application/json"}
    problem(client.post("/processes/horizon/execution", content=body, headers=headers), 400)


def test_a_large_body_is_refused_while_it_arrives(client: AppClient) -> None:
    body = problem(client.post("/processes/horizon/execution", content=b"x" * (2 << 20)), 413)
    assert body["errors"][0]["field"] == "body"

    async def pieces() -> AsyncIterator[bytes]:
        for _ in range(40):
            yield b"x" * (1 << 16)

    problem(client.post("/processes/horizon/execution", content=pieces()), 413)


def test_unknown_things_are_404_with_their_type(client: AppClient) -> None:
    assert problem(order(client, "tea", dataset="x"), 404)["type"] == OGC + "no-such-process"
    for job in (new_id(), "..%2f..", "x" * 500, "1;drop table"):
        assert problem(client.get(f"/jobs/{job}"), 404)["type"] in (
            OGC + "no-such-job",
            "about:blank",
        )
    problem(client.get(f"/datasets/{new_id()}"), 404)
    problem(client.delete(f"/jobs/{new_id()}"), 404)
    problem(client.get("/nothing"), 404)
    problem(client.put("/jobs"), 405)


def test_problem_json_is_sent_to_who_asks_for_it(client: AppClient) -> None:
    answer = client.get("/nothing", headers={"Accept": "application/problem+json"})
    assert answer.headers["content-type"] == "application/problem+json"


def test_jobs_are_listed_newest_first_with_filters_and_pages(
    client: AppClient, engine: MemoryEngine, known: str
) -> None:
    ids = [order(client, "shadow", dataset=known).json()["jobID"] for _ in range(3)]
    assert engine.begin(ids[1]) is not None
    first = client.get("/jobs?limit=2&processID=shadow").json()
    assert [job["jobID"] for job in first["jobs"]] == sorted(ids, reverse=True)[:2]
    following = next(link["href"] for link in first["links"] if link["rel"] == "next")
    assert [j["jobID"] for j in client.get(following).json()["jobs"]] == [min(ids)]
    running = client.get("/jobs?status=running").json()["jobs"]
    assert [job["jobID"] for job in running] == [ids[1]]
    problem(client.get("/jobs?status=asleep"), 400)
    assert problem(client.get("/jobs?limit=0"), 400)["errors"][0]["field"] == "limit"


def test_a_full_queue_answers_503_and_when_to_come_back(client: AppClient, known: str) -> None:
    for _ in range(3):
        assert order(client, "shadow", dataset=known).status_code == 201
    answer = order(client, "shadow", dataset=known)
    assert "queue: must be below 3" in problem(answer, 503)["detail"]
    assert int(answer.headers["retry-after"]) > 0


def test_a_failed_job_answers_with_its_own_error(
    client: AppClient, engine: MemoryEngine, known: str
) -> None:
    job = order(client, "shadow", dataset=known).json()["jobID"]
    error = {"field": "radius", "limit": "known", "value": "None"}
    engine.fail(job, {"status": 400, "detail": "radius: must be known", "errors": [error]})
    body = problem(client.get(f"/jobs/{job}/results"), 400)
    assert body["errors"] == [error]
    assert client.get(f"/jobs/{job}").json()["exception"]["errors"] == [error]


def test_another_tenants_things_do_not_exist(
    client: AppClient, engine: MemoryEngine, known: str
) -> None:
    job = order(client, "shadow", dataset=known).json()["jobID"]
    engine._jobs[job] = replace(engine._jobs[job], tenant="other")
    problem(client.get(f"/jobs/{job}"), 404)
    problem(client.delete(f"/jobs/{job}"), 404)
    assert client.get("/jobs").json()["jobs"] == []


def test_dismissing_twice_dismisses_then_removes(
    client: AppClient, engine: MemoryEngine, known: str
) -> None:
    job = order(client, "shadow", dataset=known).json()["jobID"]
    assert client.delete(f"/jobs/{job}").json()["status"] == "dismissed"
    assert client.get(f"/jobs/{job}").json()["status"] == "dismissed"
    assert client.delete(f"/jobs/{job}").json()["message"] == "removed"
    problem(client.get(f"/jobs/{job}"), 404)


def test_readiness_needs_a_live_worker_and_room(
    client: AppClient, engine: MemoryEngine, tmp_path: Path
) -> None:
    assert client.get("/healthz").json() == {"status": "ok"}
    assert client.get("/readyz").json()["status"] == "ready"
    engine.workers = 0
    assert "workers: must be at least 1" in problem(client.get("/readyz"), 503)["detail"]
    crowded = Settings(data_dir=tmp_path / "crowded", min_free_bytes=1 << 62)
    with AppClient(create_app(crowded, MemoryEngine())) as full:
        assert "free space" in problem(full.get("/readyz"), 503)["detail"]
        problem(full.post("/uploads", content=b"x"), 507)


def test_a_request_id_is_kept_if_it_is_plain(client: AppClient) -> None:
    assert client.get("/", headers={"X-Request-ID": "abc-1"}).headers["x-request-id"] == "abc-1"
    assert client.get("/", headers={"X-Request-ID": "a\tb"}).headers["x-request-id"] != "a\tb"


def test_a_page_elsewhere_cannot_rebind_its_name_to_the_service(client: AppClient) -> None:
    assert client.get("/jobs", headers={"Host": "evil.example"}).status_code == 400


def test_a_page_elsewhere_cannot_send_uploads(client: AppClient) -> None:
    foreign = {"Origin": "https://evil.example"}
    body = problem(client.post("/uploads", content=b"x", headers=foreign), 403)
    assert body["errors"][0]["field"] == "origin"
    assert client.get("/jobs", headers=foreign).status_code == 200
    own = {"Origin": "http://127.0.0.1"}
    assert client.post("/uploads", content=b"x", headers=own).status_code == 415


def test_validated_inputs_rebuild_the_librarys_parameters() -> None:
    dataset, inputs = processes.validated(
        "light", {"dataset": "0" * 26, "sun_deg": [315, 35], "sky": "overcast"}
    )
    made = processes.parameters("light", inputs)
    assert (dataset, made.sun_deg, made.sky) == ("0" * 26, (315.0, 35.0), "overcast")


@pytest.mark.parametrize(
    ("inputs", "field"),
    [
        ({}, "inputs.observer"),
        ({"observer": [[1]]}, "inputs.observer.0"),
        ({"observer": [[1, 2.5]]}, "inputs.observer.0.1"),
        ({"observer": [[1, -2]]}, "inputs.observer.0.1"),
        ({"observer": []}, "inputs.observer"),
        ({"at": [[1.0, "x"]]}, "inputs.at.0.1"),
        ({"observer": [[1, 1]], "azimuth_range_deg": [360, 0]}, "inputs.azimuth_range_deg"),
        ({"observer": [[1, 1]], "pitch_range_deg": [10, -10]}, "inputs.pitch_range_deg"),
        ({"observer": [[1, 1]], "max_distance": 0}, "inputs.max_distance"),
        ({"observer": [[1, 1]], "observer_height": float("nan")}, "inputs.observer_height"),
        ({"observer": [[1, 1]], "refraction": 0.13}, "inputs.refraction"),
        ({"observer": [[1, 1]] * 65, "layer": "seen-by"}, "inputs.observer"),
    ],
)
def test_observers_are_checked_one_by_one(inputs: dict[str, Any], field: str) -> None:
    with pytest.raises(Problem) as caught:
        processes.validated("viewshed", {"dataset": "0" * 26, **inputs})
    assert [entry.field for entry in caught.value.errors] == [field]


def test_a_number_of_bounces_may_be_a_word() -> None:
    order = {"dataset": "0" * 26, "sky": "uniform"}
    for bounces in (3, "converge"):
        _, inputs = processes.validated("bounce", order | {"bounces": bounces})
        assert processes.parameters("bounce", inputs).bounces == bounces
    for wrong in (0, 2.5, "all", True, None, [1]):
        with pytest.raises(Problem) as caught:
            processes.validated("bounce", order | {"bounces": wrong})
        assert [entry.field for entry in caught.value.errors] == ["inputs.bounces"]
    schema = processes.process("bounce").inputs["bounces"]["schema"]
    assert schema["anyOf"] == [
        {"type": "integer", "minimum": 1, "maximum": 1000},
        {"type": "string", "enum": ["converge"]},
    ]


def test_datasets_are_listed_described_and_deleted(client: AppClient, small_dem: Path) -> None:
    known = client.post("/uploads", files={"file": small_dem.read_bytes()}).json()["id"]
    listed = client.get("/datasets").json()["datasets"]
    assert [dataset["id"] for dataset in listed] == [known]
    found = client.get(f"/datasets/{known}").json()
    assert (found["rows"], found["columns"], found["epsg"]) == (40, 50, 32632)
    assert found["nodata_cells"] == 1
    assert found["source"]["driver"] == "GTiff"
    again = client.post("/uploads", files={"file": small_dem.read_bytes()})
    assert (again.status_code, again.json()["id"]) == (201, known)
    assert client.delete(f"/datasets/{known}").status_code == 204
    problem(client.get(f"/datasets/{known}"), 404)


def test_a_record_knows_when_it_is_finished() -> None:
    job = JobRecord(id=new_id(), tenant="t", process="p", dataset="d", inputs={})
    assert not job.is_finished
    assert replace(job, status=JobStatus.DISMISSED).is_finished


def post(client: AppClient, known: str, key: str | None, **inputs: Any) -> Any:
    headers = {"Content-Type": "application/json"}
    if key is not None:
        headers["Idempotency-Key"] = key
    body = json.dumps({"inputs": {"dataset": known, **inputs}})
    return client.post("/processes/horizon/execution", content=body, headers=headers)


def test_an_order_sent_twice_with_one_key_is_one_job(client: AppClient, known: str) -> None:
    first, second = (post(client, known, "a-b-c", directions=8) for _ in range(2))
    assert first.status_code == second.status_code == 201
    assert first.headers["location"] == second.headers["location"]
    assert len(client.get("/jobs").json()["jobs"]) == 1
    body = problem(post(client, known, "a-b-c", directions=9), 422)
    assert body["errors"][0]["field"] == "Idempotency-Key"
    assert post(client, known, "other", directions=8).json()["jobID"] != first.json()["jobID"]
    assert problem(post(client, known, "x" * 300), 400)["errors"][0]["field"] == "Idempotency-Key"


def test_a_failed_job_is_run_again_and_a_successful_one_is_not(
    client: AppClient, known: str, engine: MemoryEngine
) -> None:
    job = post(client, known, None).json()["jobID"]
    assert problem(client.post(f"/jobs/{job}/retry"), 409)["errors"][0]["field"] == "status"
    engine.fail(job, {"detail": "why", "status": 500})
    again = client.post(f"/jobs/{job}/retry")
    assert (again.status_code, again.json()["status"]) == (201, "accepted")
    assert again.headers["location"].endswith(f"/jobs/{job}")
    assert "exception" not in client.get(f"/jobs/{job}").json()
    engine.succeed(job)
    problem(client.post(f"/jobs/{job}/retry"), 409)
    problem(client.post(f"/jobs/{new_id()}/retry"), 404)


def test_a_dismissed_job_is_run_again_once_it_has_stopped(client: AppClient, known: str) -> None:
    job = post(client, known, None).json()["jobID"]
    client.delete(f"/jobs/{job}")
    refused = client.post(f"/jobs/{job}/retry")
    assert "still stopping" in problem(refused, 409)["detail"]
    assert int(refused.headers["retry-after"]) >= 1


def test_a_log_is_read_page_by_page(client: AppClient, known: str, engine: MemoryEngine) -> None:
    job = post(client, known, None).json()["jobID"]
    engine.begin(job)
    page = client.get(f"/jobs/{job}/logs").json()
    assert [line.get("status") for line in page["logs"]] == ["accepted", "running"]
    following = next(link["href"] for link in page["links"] if link["rel"] == "next")
    assert client.get(following).json()["logs"] == []
    engine.note(job, "warning", "its computing process died")
    (line,) = client.get(following).json()["logs"]
    assert (line["level"], line["message"]) == ("warning", "its computing process died")
    engine.fail(job, {"detail": "why", "status": 500})
    assert client.get(following).json()["logs"][-1]["level"] == "error"
    problem(client.get(f"/jobs/{new_id()}/logs"), 404)


def events_of(text: str) -> list[tuple[str | None, str, dict[str, Any]]]:
    found = []
    for block in text.strip().split("\n\n"):
        lines = dict(line.split(": ", 1) for line in block.splitlines() if not line.startswith(":"))
        if lines:
            found.append((lines.get("id"), lines["event"], json.loads(lines["data"])))
    return found


def test_events_are_told_again_from_where_a_client_was(
    client: AppClient, known: str, engine: MemoryEngine
) -> None:
    job = post(client, known, None).json()["jobID"]
    engine.begin(job)
    engine.progress(job, 50, "running")
    engine.succeed(job)
    answer = client.get(f"/jobs/{job}/events")
    assert answer.headers["content-type"].startswith("text/event-stream")
    told = events_of(answer.text)
    assert [kind for _, kind, _ in told] == ["status", "status", "progress", "status", "end"]
    assert told[2][2]["progress"] == 50
    assert told[-1][2] == {"status": "successful"}
    seen = told[1][0]
    assert seen is not None
    rest = client.get(f"/jobs/{job}/events", headers={"Last-Event-ID": seen})
    assert events_of(rest.text) == told[2:]
    assert events_of(client.get(f"/jobs/{job}/events?after={seen}").text) == told[2:]
    body = problem(client.get(f"/jobs/{job}/events", headers={"Last-Event-ID": "x"}), 400)
    assert body["errors"][0]["field"] == "Last-Event-ID"
    problem(client.get(f"/jobs/{new_id()}/events"), 404)


def test_jobs_are_listed_by_several_states_and_times(
    client: AppClient, engine: MemoryEngine, known: str
) -> None:
    names = ("shadow", "horizon", "openness")
    ids = [order(client, name, dataset=known).json()["jobID"] for name in names]
    listed = client.get("/jobs?processID=shadow,horizon").json()["jobs"]
    assert {job["jobID"] for job in listed} == set(ids[:2])
    both = client.get("/jobs?status=accepted&status=running&type=process").json()
    assert ids[0] in [job["jobID"] for job in both["jobs"]]
    assert "status=accepted&status=running" in both["links"][0]["href"]
    created = client.get(f"/jobs/{ids[0]}").json()["created"]
    since = client.get(f"/jobs?datetime={created}/..").json()["jobs"]
    assert ids[0] in [job["jobID"] for job in since]
    assert client.get("/jobs?datetime=../1999-12-31T23:59:59Z").json()["jobs"] == []
    assert client.get("/jobs?minDuration=0").json()["jobs"] == []
    engine.begin(ids[0])
    ran = client.get("/jobs?minDuration=0&maxDuration=60").json()["jobs"]
    assert [job["jobID"] for job in ran] == ids[:1]
    for wrong in ("yesterday", "2026-01-01", "../..", "2026-01-02T00:00:00Z/2026-01-01T00:00:00Z"):
        assert problem(client.get(f"/jobs?datetime={wrong}"), 400)["errors"][0]["value"] == wrong
    problem(client.get("/jobs?minDuration=-1"), 400)
    problem(client.get("/jobs?type=coverage"), 400)


@pytest.mark.parametrize(
    "body",
    [b"{", b'{"inputs": 3}', b"\xff", b'{"inputs": {}, "response": "loud"}', b'{"more": 1}'],
)
def test_both_routes_of_an_order_refuse_alike(client: AppClient, body: bytes) -> None:
    plain, described = (
        client.post("/processes/light/execution", content=body, headers={"Content-Type": media})
        for media in ("application/json", "application/json; charset=utf-8")
    )
    assert plain.status_code == described.status_code == 400
    assert plain.json()["errors"] == described.json()["errors"]
