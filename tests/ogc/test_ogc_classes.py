"""Requirements classes json, ogc-process-description, job-list and dismiss."""

import time
from collections.abc import Callable
from typing import Any

from jsonschema import Draft202012Validator
from servers import Server, wait_for

from ogc.ogc_schemas import INPUT, JOBS, OUTPUT, PROCESS, SCHEMA, STATUS, check, check_exception

Execute = Callable[..., Any]
Finished = Callable[..., dict[str, Any]]


def descriptions(ogc: Server) -> list[dict[str, Any]]:
    listed = ogc.http.get("/processes").json()["processes"]
    return [ogc.http.get(f"/processes/{process['id']}").json() for process in listed]


def test_json_content(execute: Execute, ogc: Server) -> None:
    execute(inputs={"string": "x"})
    for path in ("/", "/conformance", "/processes", "/processes/echo", "/jobs", "/nowhere"):
        answer = ogc.http.get(path, headers={"Accept": "application/json"})
        assert answer.headers["content-type"].split(";")[0] == "application/json"
        assert isinstance(answer.json(), dict)


def test_ogc_process_description_json_encoding(ogc: Server) -> None:
    for described in descriptions(ogc):
        check(described, PROCESS)
        assert described["jobControlOptions"]
        assert described["outputTransmission"]


def test_ogc_process_description_inputs_def_and_input_def(ogc: Server) -> None:
    for described in descriptions(ogc):
        assert described["inputs"]
        for entry in described["inputs"].values():
            check(entry, INPUT)
            check(entry["schema"], SCHEMA)
            Draft202012Validator.check_schema(entry["schema"])


def test_ogc_process_description_input_mixed_type(ogc: Server) -> None:
    schema = ogc.http.get("/processes/echo").json()["inputs"]["mixed"]["schema"]
    assert [branch["type"] for branch in schema["oneOf"]] == ["number", "object"]
    for branch in schema["oneOf"]:
        check(branch, SCHEMA)


def test_ogc_process_description_outputs_def_and_output_def(ogc: Server) -> None:
    for described in descriptions(ogc):
        assert described["outputs"]
        for entry in described["outputs"].values():
            check(entry, OUTPUT)


def test_defaults_are_what_their_own_schema_allows(ogc: Server) -> None:
    for described in descriptions(ogc):
        for name, entry in described["inputs"].items():
            schema = entry["schema"]
            if "default" in schema:
                assert Draft202012Validator(schema).is_valid(schema["default"]), name
                assert entry["minOccurs"] == 0


def test_job_list_op_success_and_links(execute: Execute, ogc: Server) -> None:
    for _ in range(3):
        execute("respond-async", inputs={"string": "x"})
    answer = ogc.http.get("/jobs", params={"limit": 2})
    assert answer.status_code == 200
    check(answer.json(), JOBS)
    assert len(answer.json()["jobs"]) == 2
    links = {link["rel"]: link["href"] for link in answer.json()["links"]}
    assert {"self", "next"} <= set(links)
    following = ogc.http.get(links["next"]).json()["jobs"]
    first = {job["jobID"] for job in answer.json()["jobs"]}
    assert not first & {job["jobID"] for job in following}


def test_job_list_type_definition_and_response(ogc: Server) -> None:
    jobs = ogc.http.get("/jobs", params={"type": "process"}).json()["jobs"]
    assert {job["type"] for job in jobs} == {"process"}
    check_exception(ogc.http.get("/jobs", params={"type": "coffee"}), 400)


def test_job_list_processid_definition_and_response(
    execute: Execute, ogc: Server, terrain: str
) -> None:
    execute(process="shadow", inputs={"dataset": terrain})
    execute("respond-async", inputs={"string": "x"})
    for asked in (["echo"], ["shadow"], ["echo", "shadow"]):
        jobs = ogc.http.get("/jobs", params={"processID": asked}).json()["jobs"]
        assert {job["processID"] for job in jobs} == set(asked)
    assert ogc.http.get("/jobs", params={"processID": "tea"}).json()["jobs"] == []


def test_job_list_status_definition_and_response(
    execute: Execute, ogc: Server, finished: Finished
) -> None:
    finished(execute("respond-async", inputs={"fail": True}))
    finished(execute("respond-async", inputs={"string": "x"}))
    for asked in (["failed"], ["successful"], ["failed", "successful"]):
        jobs = ogc.http.get("/jobs", params={"status": asked}).json()["jobs"]
        assert {job["status"] for job in jobs} == set(asked)


def test_job_list_datetime_definition_and_response(execute: Execute, ogc: Server) -> None:
    before = execute("respond-async", inputs={"string": "x"}).json()
    time.sleep(0.05)
    after = execute("respond-async", inputs={"string": "y"}).json()
    found = ogc.http.get("/jobs", params={"datetime": f"{after['created']}/.."}).json()["jobs"]
    ids = {job["jobID"] for job in found}
    assert after["jobID"] in ids
    assert before["jobID"] not in ids
    found = ogc.http.get("/jobs", params={"datetime": "../2000-01-01T00:00:00Z"}).json()["jobs"]
    assert found == []
    check_exception(ogc.http.get("/jobs", params={"datetime": "soon"}), 400)


def test_job_list_duration_definition_and_response(
    execute: Execute, ogc: Server, finished: Finished
) -> None:
    slow = finished(execute("respond-async", inputs={"string": "x", "pause": 1.2}))
    fast = finished(execute("respond-async", inputs={"string": "x"}))
    longer = ogc.http.get("/jobs", params={"minDuration": 1.0}).json()["jobs"]
    shorter = ogc.http.get("/jobs", params={"maxDuration": 1.0}).json()["jobs"]
    assert slow["jobID"] in {job["jobID"] for job in longer}
    assert fast["jobID"] in {job["jobID"] for job in shorter}
    assert not {j["jobID"] for j in longer} & {j["jobID"] for j in shorter}


def test_job_list_limit_definition_and_response(ogc: Server) -> None:
    assert len(ogc.http.get("/jobs", params={"limit": 1}).json()["jobs"]) == 1
    for wrong in ("0", "100000", "x"):
        check_exception(ogc.http.get("/jobs", params={"limit": wrong}), 400)


def test_job_dismiss_op_and_success(execute: Execute, ogc: Server) -> None:
    answer = execute("respond-async", inputs={"string": "x", "pause": 30})
    location = answer.headers["location"]
    wait_for(lambda: ogc.http.get(location).json()["status"] == "running", 20.0, ogc.log)
    dismissed = ogc.http.delete(location)
    assert dismissed.status_code == 200
    check(dismissed.json(), STATUS)
    assert dismissed.json()["status"] == "dismissed"
    assert ogc.http.get(location).json()["status"] == "dismissed"
    assert ogc.http.delete(location).status_code == 200
    check_exception(ogc.http.get(location), 404, "no-such-job")
    check_exception(ogc.http.delete(location), 404, "no-such-job")


def test_dismiss_of_a_finished_job_removes_it(
    execute: Execute, ogc: Server, finished: Finished
) -> None:
    answer = execute("respond-async", inputs={"string": "x"})
    finished(answer)
    assert ogc.http.delete(answer.headers["location"]).status_code == 200
    check_exception(ogc.http.get(answer.headers["location"] + "/results"), 404, "no-such-job")
