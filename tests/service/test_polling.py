"""What many clients ask at once: the state of a job, told fresh, cheaply, and once if known."""

import asyncio
import gc
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
import uvicorn
from servers import AppClient

from adret_service.app import create_app
from adret_service.engine.memory import MemoryEngine
from adret_service.engine.port import JobRecord
from adret_service.ids import new_id
from adret_service.lookup import Lookup
from adret_service.precedence import GROUP
from adret_service.server import serve
from adret_service.settings import Settings


@pytest.fixture
def engine() -> MemoryEngine:
    return MemoryEngine()


@pytest.fixture
def http(engine: MemoryEngine, tmp_path: Path) -> Iterator[AppClient]:
    with AppClient(create_app(Settings(data_dir=tmp_path), engine)) as client:
        yield client


@pytest.fixture
def job(engine: MemoryEngine) -> str:
    record = JobRecord(id=new_id(), tenant="local", process="echo", dataset="", inputs={"a": 1})
    return engine.submit(record).id


def test_all_who_ask_while_a_read_goes_on_share_the_next_one_and_are_told_what_it_found() -> None:
    known = {"a": 1, "b": 2}
    reads: list[list[str]] = []
    begun, go_on = threading.Event(), threading.Event()

    def read(keys: list[str]) -> dict[str, int]:
        reads.append(sorted(keys))
        found = {key: known[key] for key in keys if key in known}
        begun.set()
        assert go_on.wait(10.0)
        return found

    async def ask() -> list[int | None]:
        lookup = Lookup(read)
        first = asyncio.create_task(lookup.get("a"))
        await asyncio.to_thread(begun.wait, 10.0)
        known["a"] = 10  # after the first read looked: the others must be told of it
        others = [asyncio.create_task(lookup.get(key)) for key in ["a"] * 50 + ["b", "none"]]
        await asyncio.sleep(0.01)
        go_on.set()
        return [await first, *[await each for each in others]]

    assert asyncio.run(ask()) == [1, *[10] * 50, 2, None]
    assert reads == [["a"], ["a", "b", "none"]]


def test_a_read_that_fails_is_told_to_each_who_waits_and_the_next_one_works() -> None:
    answers: list[dict[str, int]] = [{"a": 5}]

    def read(keys: list[str]) -> dict[str, int]:
        if len(keys) > 1:
            raise ConnectionError("away")
        return answers.pop()

    async def ask() -> list[int | BaseException | None]:
        lookup = Lookup(read)
        told = await asyncio.gather(*map(lookup.get, "abc"), return_exceptions=True)
        return [*told, await lookup.get("a")]

    *told, last = asyncio.run(ask())
    assert [type(each) for each in told] == [ConnectionError] * 3
    assert last == 5


def test_a_status_that_the_client_knows_is_304_until_it_changes(
    http: AppClient, engine: MemoryEngine, job: str
) -> None:
    first = http.get(f"/jobs/{job}")
    tag = first.headers["etag"]
    assert first.headers["retry-after"] == "1"
    for known in (tag, f"W/{tag}", f'"other", {tag}'):
        again = http.get(f"/jobs/{job}", headers={"If-None-Match": known})
        assert (again.status_code, again.content) == (304, b"")
        assert again.headers["etag"] == tag
    engine.begin(job)
    engine.progress(job, 40, "working")
    changed = http.get(f"/jobs/{job}", headers={"If-None-Match": tag})
    assert (changed.status_code, changed.json()["progress"]) == (200, 40)
    assert changed.headers["etag"] != tag


def test_a_status_is_the_same_document_in_the_list_of_jobs(http: AppClient, job: str) -> None:
    assert http.get(f"/jobs/{job}").json() == http.get("/jobs").json()["jobs"][0]
    head = http.request("HEAD", f"/jobs/{job}")
    assert (head.status_code, head.content) == (200, b"")
    unknown = new_id()
    missing = http.get(f"/jobs/{unknown}")
    told = (missing.status_code, missing.json()["detail"])
    assert told == (404, f"no such job: '{unknown}'")
    wrong = http.request("PUT", f"/jobs/{job}")
    assert wrong.status_code == 405


def test_requests_of_the_short_way_are_counted_under_their_route(http: AppClient, job: str) -> None:
    http.get(f"/jobs/{job}")
    http.get(f"/jobs/{job}/results/result")
    text = http.get("/metrics").text
    name = "adret_http_request_seconds_count"
    assert f'{name}{{method="GET",route="/jobs/{{job_id}}",status="200"}} 1.0' in text
    route = 'route="/jobs/{job_id}/results/{output}"'
    assert f'{name}{{method="GET",{route},status="404"}} 1.0' in text


@pytest.mark.skipif(not GROUP.exists(), reason="this kernel does not group processes by session")
def test_a_session_of_its_own_steps_back_as_a_whole() -> None:
    told = subprocess.run(
        [
            sys.executable,
            "-c",
            "import os; from adret_service.precedence import GROUP, step_back;"
            "step_back(7, session=True); print(GROUP.read_text(), os.nice(0))",
        ],
        start_new_session=True,
        capture_output=True,
        text=True,
        check=True,
    )
    assert told.stdout.split()[1:] == ["nice", "7", str(os.nice(0))]


def test_what_start_up_made_is_not_looked_through_for_garbage_while_clients_wait(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    frozen: list[int] = []
    monkeypatch.setattr(uvicorn.Server, "run", lambda _: frozen.append(gc.get_freeze_count()))
    try:
        serve(Settings(data_dir=tmp_path, role="api"))
    finally:
        gc.unfreeze()
    assert frozen[0] > 100_000
