"""Metrics, logs, traces and readiness of a real server."""

import json
import os
import shutil
import signal
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from prometheus_client.parser import text_string_to_metric_families
from servers import AppClient, Server, wait_for

from adret_service.app import create_app
from adret_service.auth import add_key
from adret_service.engine.memory import MemoryEngine
from adret_service.settings import Settings


@pytest.fixture(scope="module")
def spans() -> Iterator[tuple[str, list[Any]]]:
    """A collector of traces: its address, and the spans that came."""
    from opentelemetry.proto.collector.trace.v1.trace_service_pb2 import ExportTraceServiceRequest

    got: list[Any] = []

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["Content-Length"]))
            request = ExportTraceServiceRequest.FromString(body)
            for resource in request.resource_spans:
                for scope in resource.scope_spans:
                    got.extend(scope.spans)
            self.send_response(200)
            self.send_header("Content-Length", "0")
            self.end_headers()

        def log_message(self, *_: Any) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_address[1]}", got
    server.shutdown()
    server.server_close()


@pytest.fixture(scope="module")
def observed(
    tmp_path_factory: pytest.TempPathFactory, spans: tuple[str, list[Any]]
) -> Iterator[Server]:
    """A server that writes JSON logs and sends traces."""
    server = Server(
        tmp_path_factory.mktemp("observed") / "data",
        ADRET_ENABLE_ECHO="1",
        ADRET_LOG_JSON="1",
        ADRET_OTEL_ENDPOINT=spans[0],
    )
    try:
        server.start()
        yield server
    finally:
        server.stop()


def metrics(text: str) -> dict[tuple[str, tuple[str, ...]], float]:
    """Return samples by name and label values."""
    return {
        (sample.name, tuple(value for _, value in sorted(sample.labels.items()))): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


def test_a_request_and_its_job_are_counted_logged_and_traced(
    observed: Server, spans: tuple[str, list[Any]]
) -> None:
    trace = "0af7651916cd43dd8448eb211c80319c"
    answer = observed.http.post(
        "/processes/echo/execution",
        json={"inputs": {"string": "x"}},
        headers={
            "X-Request-ID": "told-by-client",
            "Prefer": "respond-async",
            "traceparent": f"00-{trace}-b7ad6b7169203331-01",
        },
    )
    job = answer.json()["jobID"]
    observed.wait(job, "successful")

    found = metrics(observed.http.get("/metrics").text)
    assert found["adret_jobs_ended_total", ("echo", "successful")] == 1.0
    assert found["adret_jobs", ("echo", "successful")] == 1.0
    assert found["adret_workers_alive", ()] == 1.0
    for name in ("adret_queue_depth", "adret_queue_oldest_seconds", "adret_running"):
        assert found[name, ("sky-view",)] == 0.0
    assert 0.0 < found["adret_job_run_seconds_total", ("echo", "successful")] < 60.0
    route = ("POST", "/processes/{process_id}/execution", "201")
    assert found["adret_http_request_seconds_count", route] == 1.0
    assert not any(job in label for _, labels in found for label in labels)

    lines = [json.loads(line) for line in observed.log.read_text().splitlines()]
    ordered = [line for line in lines if line.get("request_id") == "told-by-client"]
    assert {"adret.access", "adret.worker"} <= {line["logger"] for line in ordered}
    assert any(line.get("job_id") == job for line in ordered)
    access = next(line for line in ordered if line["logger"] == "adret.access")
    assert (access["method"], access["status"]) == ("POST", 201)
    assert access["route"] == "/processes/{process_id}/execution"

    def names() -> set[str]:
        return {span.name for span in spans[1] if span.trace_id.hex() == trace}

    wanted = {"POST /processes/{process_id}/execution", "job echo"}
    wait_for(lambda: wanted <= names(), 20.0, observed.log)


def test_cells_queues_and_deaths_of_workers_are_counted_by_process(
    observed: Server, small_dem: Path
) -> None:
    dataset = observed.upload(small_dem).json()["id"]
    observed.wait(observed.submit("shadow", dataset=dataset), "successful")
    order = {"inputs": {"string": "x", "pause": 30.0}}
    now = {"Prefer": "respond-async"}
    slow = observed.http.post("/processes/echo/execution", json=order, headers=now).json()["jobID"]
    observed.wait(slow, "running")
    waits = observed.submit("shadow", dataset=dataset)
    found = metrics(observed.http.get("/metrics").text)
    assert found["adret_job_cells_total", ("shadow",)] == 40 * 50
    assert (found["adret_queue_depth", ("shadow",)], found["adret_running", ("echo",)]) == (1, 1)
    assert 0.0 < found["adret_queue_oldest_seconds", ("shadow",)] < 30.0

    os.kill(observed.children("adret_service.worker")[0], signal.SIGKILL)

    def deaths() -> float:
        text = observed.http.get("/metrics").text
        return metrics(text).get(("adret_worker_deaths_total", ("echo",)), 0.0)

    wait_for(lambda: deaths() == 1.0, 30.0, observed.log)
    observed.http.delete(f"/jobs/{slow}")
    observed.http.delete(f"/jobs/{slow}")
    assert deaths() == 1.0  # though the job is removed
    observed.wait(waits, "successful")


def test_readiness_names_what_it_has_checked(observed: Server) -> None:
    ready = observed.http.get("/readyz").json()
    assert (ready["database"], ready["storage"], ready["workers"]) == ("ok", "ok", 1)
    assert not list((observed.data / "store" / "probe").glob("ready/*"))


def test_a_store_that_cannot_be_written_is_not_ready(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path / "data", min_free_bytes=0)
    with AppClient(create_app(settings, MemoryEngine())) as client:
        assert client.get("/readyz").status_code == 200
        shutil.rmtree(settings.store_dir)
        settings.store_dir.write_text("not a folder")
        answer = client.get("/readyz")
        assert (answer.status_code, answer.json()["detail"]) == (503, "the store does not answer")


def test_metrics_are_for_keys_that_may_read_them(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path / "data", auth="apikey", min_free_bytes=0)
    _, reader = add_key(settings.keys_file, "alice", ["read", "submit"])
    _, watcher = add_key(settings.keys_file, "ops", ["metrics"])
    with AppClient(create_app(settings, MemoryEngine())) as client:
        assert client.get("/metrics").status_code == 401
        assert client.get("/metrics", headers={"X-API-Key": reader}).status_code == 403
        allowed = client.get("/metrics", headers={"X-API-Key": watcher})
        assert allowed.status_code == 200
        assert allowed.headers["content-type"].startswith("text/plain")
        assert "adret_queue_waiting 0.0" in allowed.text
        assert client.get("/jobs", headers={"X-API-Key": watcher}).status_code == 403


def test_a_failure_of_the_service_is_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = Settings(data_dir=tmp_path / "data", min_free_bytes=0)
    engine = MemoryEngine()
    with AppClient(create_app(settings, engine)) as client:
        with monkeypatch.context() as broken:
            broken.setattr(engine, "list", lambda *_, **__: 1 / 0)
            assert client.get("/jobs").status_code == 500
        assert client.get("/jobs").status_code == 200
        found = metrics(client.get("/metrics").text)
        assert found["adret_http_request_seconds_count", ("GET", "/jobs", "500")] == 1.0
        assert found["adret_http_request_seconds_count", ("GET", "/jobs", "200")] == 1.0
