"""Requirements class core of OGC API - Processes 1.0; each test is named after its requirement.

The public suite has process-execute-… by the older name job-creation-….
"""

import base64
import email
import email.policy
import json
import uuid
from collections.abc import Callable
from typing import Any

import pytest
from servers import Server, wait_for

from ogc.ogc_schemas import (
    CONFORMANCE,
    LANDING,
    PROCESSES,
    RESULTS,
    STATUS,
    check,
    check_exception,
)

Execute = Callable[..., Any]
Finished = Callable[..., dict[str, Any]]

REL = "http://www.opengis.net/def/rel/ogc/1.0/"
CONF = "http://www.opengis.net/spec/ogcapi-processes-1/1.0/conf/"
TEXT = "teststring"
BOX = {"bbox": [51.9, 7, 52, 7.1], "crs": "http://www.opengis.net/def/crs/OGC/1.3/CRS84"}
INPUTS = {
    "string": TEXT,
    "number": 1.5,
    "array": ["test1", "test2"],
    "bbox": BOX,
    "object": {"a": {"b": [1]}},
    "mixed": {"c": 2},
    "binary": base64.b64encode(b"\x00\xffbytes").decode(),
}


def parts(answer: Any) -> dict[str, Any]:
    """Return the parts of a multipart answer by their Content-ID."""
    head = f"Content-Type: {answer.headers['content-type']}\r\n\r\n".encode()
    message = email.message_from_bytes(head + answer.content, policy=email.policy.HTTP)
    assert message.get_content_type() == "multipart/related"
    assert not message.defects
    assert message.get_param("type")
    return {part["Content-ID"]: part for part in message.iter_parts()}  # type: ignore[attr-defined]


def content(part: Any) -> bytes:
    """Return the bytes of a part as they were sent."""
    return bytes(part.get_payload(decode=True))


def modes(mode: str, *names: str) -> dict[str, Any]:
    return {name: {"transmissionMode": mode} for name in names}


def test_landingpage_op_and_success(ogc: Server) -> None:
    answer = ogc.http.get("/", headers={"Accept": "application/json"})
    assert answer.status_code == 200
    check(answer.json(), LANDING)
    rels = {link["rel"]: link["href"] for link in answer.json()["links"]}
    assert {"service-desc", "service-doc", REL + "conformance", REL + "processes"} <= set(rels)
    assert REL + "job-list" in rels
    for href in rels.values():
        assert ogc.http.get(href).status_code == 200


def test_api_definition_op_and_success(ogc: Server) -> None:
    links = ogc.http.get("/").json()["links"]
    href = next(link["href"] for link in links if link["rel"] == "service-desc")
    api = ogc.http.get(href).json()
    assert api["openapi"].startswith("3.")
    for path in ("/processes", "/processes/{process_id}/execution", "/jobs/{job_id}/results"):
        assert path in api["paths"]


def test_conformance_op_and_success(ogc: Server) -> None:
    answer = ogc.http.get("/conformance")
    assert answer.status_code == 200
    check(answer.json(), CONFORMANCE)
    classes = ("core", "json", "ogc-process-description", "job-list", "dismiss", "callback")
    assert {CONF + name for name in classes} <= set(answer.json()["conformsTo"])


def test_http(ogc: Server) -> None:
    answer = ogc.http.get("/")
    assert answer.http_version == "HTTP/1.1"
    check_exception(ogc.http.put("/processes"), 405)
    check_exception(ogc.http.get("/nowhere"), 404)


def test_process_list_and_success(ogc: Server) -> None:
    answer = ogc.http.get("/processes")
    assert answer.status_code == 200
    check(answer.json(), PROCESSES)
    found = [process["id"] for process in answer.json()["processes"]]
    assert {"echo", "horizon", "shadow", "ssao"} <= set(found)
    assert len(found) == len(set(found))
    for process in answer.json()["processes"]:
        own = next(link["href"] for link in process["links"] if link["rel"] == "self")
        assert ogc.http.get(own).json()["id"] == process["id"]


def test_pl_limit_definition_and_response(ogc: Server) -> None:
    page = ogc.http.get("/processes", params={"limit": 1}).json()
    assert len(page["processes"]) == 1
    check_exception(ogc.http.get("/processes", params={"limit": 0}), 400)


def test_pl_links(ogc: Server) -> None:
    href, seen = f"{ogc.url}/processes?limit=4", []
    while href:
        page = ogc.http.get(href).json()
        links = {link["rel"]: link["href"] for link in page["links"]}
        assert "self" in links
        seen += [process["id"] for process in page["processes"]]
        href = links.get("next", "")
    assert seen == [p["id"] for p in ogc.http.get("/processes").json()["processes"]]


def test_process_and_success(ogc: Server) -> None:
    answer = ogc.http.get("/processes/echo")
    assert answer.status_code == 200
    assert answer.json()["id"] == "echo"


def test_process_exception_no_such_process(ogc: Server) -> None:
    name = f"invalid-process-{uuid.uuid4()}"
    check_exception(ogc.http.get(f"/processes/{name}"), 404, "no-such-process")
    answer = ogc.http.post(f"/processes/{name}/execution", json={"inputs": {}})
    check_exception(answer, 404, "no-such-process")


def test_process_execute_op_and_request(execute: Execute, ogc: Server) -> None:
    prefer = "respond-async , handling=lenient"
    answer = execute(prefer, inputs=INPUTS, outputs=modes("value", *INPUTS))
    assert answer.status_code == 201
    check(answer.json(), STATUS)
    check(ogc.http.get(answer.headers["location"]).json(), STATUS)


def test_process_execute_auto_execution_mode(execute: Execute) -> None:
    assert execute("respond-async", inputs={"string": TEXT}).status_code == 201
    assert execute("wait=20", inputs={"string": TEXT}).status_code == 200


def test_process_execute_default_execution_mode(execute: Execute, terrain: str) -> None:
    assert execute(inputs={"string": TEXT}).status_code == 200
    heavy = execute(process="shadow", inputs={"dataset": terrain})
    assert heavy.status_code == 201


def test_process_execute_default_outputs(execute: Execute) -> None:
    answer = execute(inputs=INPUTS)
    assert answer.status_code == 200
    assert set(answer.json()) == set(INPUTS)


@pytest.mark.parametrize("name", INPUTS)
def test_process_execute_input_inline(name: str, execute: Execute) -> None:
    """Object, array, bbox, binary and mixed inputs, each with the value that comes back."""
    answer = execute(inputs={name: INPUTS[name]}, outputs=modes("value", name))
    assert answer.status_code == 200
    check(answer.json(), RESULTS)
    found = answer.json()[name]
    if name in ("object", "mixed"):
        assert found == {"value": INPUTS[name], "mediaType": "application/json"}
    elif name == "binary":
        assert (found["value"], found["encoding"]) == (INPUTS[name], "base64")
    else:
        assert found == INPUTS[name]


def test_process_execute_input_cardinality_and_qualified_value(execute: Execute) -> None:
    answer = execute(inputs={"string": {"value": TEXT}, "object": {"value": TEXT}})
    assert answer.json()["string"] == TEXT
    assert answer.json()["object"]["value"] == {"value": TEXT}


def test_process_execute_input_by_reference(execute: Execute, ogc: Server, terrain: str) -> None:
    data = base64.b64encode(json.dumps(["a", "b"]).encode()).decode()
    answer = execute(inputs={"array": {"href": f"data:application/json;base64,{data}"}})
    assert answer.json() == {"array": ["a", "b"]}
    own = {"href": f"{ogc.url}/datasets/{terrain}"}
    assert execute(process="shadow", inputs={"dataset": own}).status_code == 201
    for foreign in ("http://169.254.169.254/", "file:///etc/passwd", "https://example.org/x"):
        body = check_exception(execute(inputs={"string": {"href": foreign}}), 400)
        assert body["errors"][0]["field"] == "inputs.string.href"


def test_process_execute_input_validation(execute: Execute) -> None:
    wrong = {"binary": {"type": f"wrong/type_{uuid.uuid4()}"}, "number": "many", "colour": 3}
    body = check_exception(execute(inputs=wrong), 400)
    assert body["type"].endswith("invalid-parameter-value")
    named = {error["field"].split(".")[1] for error in body["errors"]}
    assert named == {"binary", "number", "colour"}
    check_exception(execute(**{"invalid-execute-request": "true"}), 400)
    check_exception(execute(inputs={}, outputs={"other": {}}), 400)
    check_exception(execute(inputs={}, response="teapot"), 400)
    formats = {"string": {"format": {"mediaType": "image/png"}}}
    check_exception(execute(inputs={"string": TEXT}, outputs=formats), 400)


def test_process_execute_sync_document(execute: Execute) -> None:
    answer = execute(inputs=INPUTS, outputs=modes("value", "string", "array"), response="document")
    assert answer.status_code == 200
    assert answer.headers["content-type"] == "application/json"
    check(answer.json(), RESULTS)
    assert answer.json() == {"string": TEXT, "array": INPUTS["array"]}


def test_process_execute_sync_document_by_reference(execute: Execute, ogc: Server) -> None:
    answer = execute(inputs={"string": TEXT}, outputs=modes("reference", "string"))
    check(answer.json(), RESULTS)
    assert ogc.http.get(answer.json()["string"]["href"]).json() == TEXT


def test_process_execute_sync_raw_value_one(execute: Execute) -> None:
    answer = execute(
        inputs={"string": TEXT, "binary": INPUTS["binary"]},
        outputs=modes("value", "binary"),
        response="raw",
    )
    assert answer.status_code == 200
    assert answer.headers["content-type"] == "application/octet-stream"
    assert answer.content == b"\x00\xffbytes"
    text = execute(inputs={"string": TEXT}, outputs=modes("value", "string"), response="raw")
    assert TEXT in text.text


def test_process_execute_sync_raw_value_multi(execute: Execute) -> None:
    answer = execute(inputs=INPUTS, outputs=modes("value", *INPUTS), response="raw")
    assert answer.status_code == 200
    found = parts(answer)
    assert list(found) == list(INPUTS)
    assert content(found["binary"]) == b"\x00\xffbytes"
    assert found["binary"].get_content_type() == "application/octet-stream"
    for name in set(INPUTS) - {"binary"}:
        assert json.loads(content(found[name])) == INPUTS[name]


def test_process_execute_sync_raw_mixed_multi(execute: Execute, ogc: Server) -> None:
    outputs = modes("value", "string") | modes("reference", "array")
    answer = execute(inputs=INPUTS, outputs=outputs, response="raw")
    assert answer.status_code == 200
    found = parts(answer)
    assert json.loads(content(found["string"])) == TEXT
    assert content(found["array"]) == b""
    assert ogc.http.get(found["array"]["Content-Location"]).json() == INPUTS["array"]


def test_process_execute_sync_raw_ref(execute: Execute, ogc: Server) -> None:
    names = ("string", "array")
    answer = execute(inputs=INPUTS, outputs=modes("reference", *names), response="raw")
    assert (answer.status_code, answer.content) == (204, b"")
    links = [link for link in answer.headers["link"].split(", <") if "monitor" not in link]
    hrefs = [link.split(">")[0].lstrip("<") for link in links]
    assert [ogc.http.get(href).json() for href in hrefs] == [INPUTS[name] for name in names]


def test_process_execute_sync_job_and_job_results_sync(execute: Execute, ogc: Server) -> None:
    answer = execute(inputs={"string": TEXT})
    (link,) = (link for link in answer.headers["link"].split(", ") if "rel=monitor" in link)
    status = ogc.http.get(link.split(">")[0].lstrip("<")).json()
    check(status, STATUS)
    assert status["status"] == "successful"
    results = ogc.http.get(f"/jobs/{status['jobID']}/results")
    assert results.json() == answer.json()


def test_process_execute_success_async(execute: Execute, ogc: Server, finished: Finished) -> None:
    answer = execute("respond-async", inputs={"string": TEXT, "pause": 0.3})
    assert answer.status_code == 201
    assert answer.headers["location"] == f"{ogc.url}/jobs/{answer.json()['jobID']}"
    assert answer.json()["status"] in ("accepted", "running")
    assert finished(answer)["status"] == "successful"


def test_process_execute_sync_gives_the_job_where_time_runs_out(
    execute: Execute, finished: Finished
) -> None:
    answer = execute("wait=1", inputs={"string": TEXT, "pause": 2.5})
    assert answer.status_code == 201
    assert answer.json()["status"] in ("accepted", "running")
    assert finished(answer)["status"] == "successful"


def test_a_small_raster_is_waited_for_if_the_client_prefers(
    execute: Execute, ogc: Server, terrain: str
) -> None:
    order = {"inputs": {"dataset": terrain}, "outputs": {"result": {}}, "response": "raw"}
    answer = execute("wait=30", process="shadow", **order)
    assert answer.status_code == 200
    assert answer.headers["preference-applied"] == "wait=30"
    assert answer.headers["content-type"].startswith("image/tiff")
    assert answer.content[:4] in (b"II*\x00", b"II+\x00")
    both = execute("wait=30", process="shadow", inputs={"dataset": terrain}, response="raw")
    found = parts(both)
    assert content(found["result"]) == answer.content
    assert content(found["preview"]).startswith(b"\x89PNG")
    document = execute("wait=30", process="shadow", inputs={"dataset": terrain}).json()
    assert ogc.http.get(document["result"]["href"]).content == answer.content
    order = {"inputs": {"dataset": terrain}, "outputs": modes("value", "preview")}
    inline = execute("wait=30", process="shadow", **order).json()["preview"]
    assert base64.b64decode(inline["value"]).startswith(b"\x89PNG")
    assert inline["mediaType"] == "image/png"


def test_a_large_raster_is_not_waited_for(execute: Execute, ogc: Server, example_dem: Any) -> None:
    dataset = ogc.upload(example_dem).json()["id"]
    answer = execute("wait=30", process="shadow", inputs={"dataset": dataset})
    assert answer.status_code == 201
    assert "preference-applied" not in answer.headers


def test_job_and_success(execute: Execute, ogc: Server, finished: Finished) -> None:
    answer = execute("respond-async", inputs={"string": TEXT})
    status = finished(answer)
    check(status, STATUS)
    assert status["processID"] == "echo"
    assert REL + "results" in [link["rel"] for link in status["links"]]


def test_job_exception_no_such_job(ogc: Server) -> None:
    check_exception(ogc.http.get(f"/jobs/invalid-job-{uuid.uuid4()}"), 404, "no-such-job")


def test_job_results_exception_no_such_job(ogc: Server) -> None:
    path = f"/jobs/invalid-job-{uuid.uuid4()}/results"
    check_exception(ogc.http.get(path), 404, "no-such-job")


def test_job_results_exception_results_not_ready(execute: Execute, ogc: Server) -> None:
    answer = execute("respond-async", inputs={"string": TEXT, "pause": 5}, response="raw")
    results = ogc.http.get(answer.headers["location"] + "/results")
    check_exception(results, 404, "result-not-ready")
    ogc.http.delete(answer.headers["location"])


def test_job_results_failed(execute: Execute, ogc: Server, finished: Finished) -> None:
    answer = execute("respond-async", inputs={"fail": True})
    assert finished(answer)["status"] == "failed"
    body = check_exception(ogc.http.get(answer.headers["location"] + "/results"), 400)
    assert body["errors"][0]["field"] == "inputs.fail"
    direct = execute(inputs={"fail": True})
    check_exception(direct, 400)
    assert "rel=monitor" in direct.headers["link"]


def results_of(execute: Execute, ogc: Server, finished: Finished, **order: Any) -> Any:
    """Results of an order that was not waited for."""
    answer = execute("respond-async", **order)
    assert answer.status_code == 201
    assert finished(answer)["status"] == "successful"
    return ogc.http.get(answer.headers["location"] + "/results")


def test_job_results_async_document(execute: Execute, ogc: Server, finished: Finished) -> None:
    order = {"inputs": INPUTS, "outputs": modes("value", *INPUTS), "response": "document"}
    answer = results_of(execute, ogc, finished, **order)
    assert answer.status_code == 200
    check(answer.json(), RESULTS)
    assert set(answer.json()) == set(INPUTS)


def test_job_results_async_raw_value_one(execute: Execute, ogc: Server, finished: Finished) -> None:
    order = {"inputs": INPUTS, "outputs": modes("value", "string"), "response": "raw"}
    answer = results_of(execute, ogc, finished, **order)
    assert (answer.status_code, answer.json()) == (200, TEXT)


def test_job_results_async_raw_value_multi(
    execute: Execute, ogc: Server, finished: Finished
) -> None:
    order = {"inputs": INPUTS, "outputs": modes("value", "string", "bbox"), "response": "raw"}
    found = parts(results_of(execute, ogc, finished, **order))
    assert json.loads(content(found["bbox"])) == BOX


def test_job_results_async_raw_ref(execute: Execute, ogc: Server, finished: Finished) -> None:
    order = {"inputs": INPUTS, "outputs": modes("reference", "string"), "response": "raw"}
    answer = results_of(execute, ogc, finished, **order)
    assert (answer.status_code, answer.content) == (204, b"")
    assert ogc.http.get(answer.headers["link"].split(">")[0].lstrip("<")).json() == TEXT


def test_job_results_async_raw_mixed_multi(
    execute: Execute, ogc: Server, finished: Finished
) -> None:
    outputs = modes("reference", "string") | modes("value", "array")
    order = {"inputs": INPUTS, "outputs": outputs, "response": "raw"}
    found = parts(results_of(execute, ogc, finished, **order))
    assert content(found["string"]) == b""
    assert found["string"]["Content-Location"].startswith(ogc.url)
    assert json.loads(content(found["array"])) == INPUTS["array"]


def test_results_of_chosen_outputs(execute: Execute, ogc: Server, finished: Finished) -> None:
    answer = execute("respond-async", inputs={"string": TEXT, "number": 2})
    finished(answer)
    results = answer.headers["location"] + "/results"
    assert ogc.http.get(results, params={"outputs": "number"}).json() == {"number": 2.0}
    check_exception(ogc.http.get(results, params={"outputs": "colour"}), 400)


def test_the_echo_process_is_offered_only_where_it_is_asked_for(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    from adret_service.offers import offered

    assert "echo" not in offered(echo=False)


def test_a_dismissed_wait_ends_at_once(execute: Execute, ogc: Server) -> None:
    import threading

    answers: list[Any] = []
    inputs = {"string": "dismissed while waited for", "pause": 20}
    waiter = threading.Thread(target=lambda: answers.append(execute("wait=25", inputs=inputs)))
    waiter.start()

    def running() -> list[str]:
        listed = ogc.http.get("/jobs", params={"status": "running", "processID": "echo"}).json()
        return [j["jobID"] for j in listed["jobs"] if j["inputs"].get("pause") == 20]

    wait_for(lambda: bool(running()), 20.0, ogc.log)
    ogc.http.delete(f"/jobs/{running()[0]}")
    waiter.join(10.0)
    check_exception(answers[0], 404, "result-not-ready")


def test_a_job_without_a_raster_has_no_views(
    execute: Execute, ogc: Server, finished: Finished
) -> None:
    answer = execute("respond-async", inputs={"string": TEXT})
    finished(answer)
    check_exception(ogc.http.get(answer.headers["location"] + "/preview.png"), 404)
    item = ogc.http.get(answer.headers["location"] + "/stac").json()
    assert item["geometry"] is None
    assert item["assets"]["string"]["type"] == "application/json"


def test_an_estimate_of_an_echo_is_its_pause(ogc: Server) -> None:
    answer = ogc.http.post("/processes/echo/estimate", json={"inputs": {"pause": 2}})
    assert answer.json()["seconds"]["expected"] == 2.0
