"""The worker's job runner with children that misbehave on purpose, and the store beneath it."""

import errno
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from adret_service.children import ComputeChild, Unfit
from adret_service.database import open_database
from adret_service.datasets import DatasetCatalogue
from adret_service.engine.memory import MemoryEngine
from adret_service.engine.port import JobRecord, JobStatus
from adret_service.ids import new_id
from adret_service.running import JobRunner
from adret_service.settings import Settings
from adret_service.storage import Artefact, FileStorage

# Speaks the protocol of adret_service.compute and does what the job's input "act" says.
CHILD = """
import json, os, sys, time
from pathlib import Path
def say(**message): print(json.dumps(message), flush=True)
say(event="ready", layer="none")
for line in sys.stdin:
    order = json.loads(line)
    folder = Path(order["folder"])
    act = order["inputs"]["act"]
    marker = Path(order["raster"]).with_suffix(".tries")
    tries = len(marker.read_text()) if marker.exists() else 0
    marker.write_text("x" * (tries + 1))
    say(event="progress", done=1, total=2)
    if act == "die" or (act == "die once" and tries == 0):
        os.kill(os.getpid(), 9)
    if act == "full" and tries == 0:
        say(event="failed", reason="OSError", full=True)
        continue
    if act == "break":
        say(event="failed", reason="ZeroDivisionError", full=False)
        continue
    if act == "refuse":
        say(event="refused", field="radius", limit="known", value="None")
        continue
    if act == "hang":
        time.sleep(60)
    (folder / "result.tif").write_bytes(b"result of try %d" % tries)
    (folder / "preview.png").write_bytes(b"picture")
    say(event="done", notes={})
"""


class Bench:
    """A runner with one scripted child, and what it works on."""

    def __init__(self, data: Path, **settings: float) -> None:
        self.settings = Settings(data_dir=data, **settings)  # type: ignore[arg-type]
        self.storage = FileStorage(self.settings.store_dir)
        self.database = open_database(self.settings)
        self.catalogue = DatasetCatalogue(self.database, self.storage)
        self.engine = MemoryEngine()
        self.scratch = data / "scratch"
        self.scratch.mkdir()
        self.child = ComputeChild(1, [sys.executable, "-c", CHILD])
        self.runner = JobRunner(
            self.settings, self.engine, self.catalogue, self.storage, self.scratch, [self.child]
        )
        (data / "raster").write_bytes(b"raster")
        self.dataset = self.catalogue.add(
            "t", data / "raster", sha256="0", name="n", upload_bytes=6, info={}
        ).id

    def submit(self, act: str) -> str:
        job = JobRecord(
            id=new_id(), tenant="t", process="p", dataset=self.dataset, inputs={"act": act}
        )
        return self.engine.submit(job).id

    def run(self, act: str) -> JobRecord:
        job = self.submit(act)
        self.runner.execute(job)
        return self.found(job)

    def found(self, job: str) -> JobRecord:
        record = self.engine.get(job, "t")
        assert record is not None
        return record

    def results(self, job: str) -> dict[str, Artefact] | None:
        return self.storage.manifest(f"t/jobs/{job}")


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    bench = Bench(tmp_path, cancel_grace=0.1, job_timeout=3.0, job_max_attempts=2)
    yield bench
    bench.runner.stop()
    bench.database.dispose()


def test_a_job_is_computed_published_and_marked(bench: Bench) -> None:
    job = bench.run("work")
    assert (job.status, job.progress) == (JobStatus.SUCCESSFUL, 100)
    results = bench.results(job.id)
    assert results is not None
    assert b"".join(bench.storage.read(results["result"].key)) == b"result of try 0"
    assert list(bench.scratch.iterdir()) == []


def test_a_child_that_dies_is_replaced_and_the_job_runs_again(bench: Bench) -> None:
    job = bench.run("die once")
    assert job.status is JobStatus.SUCCESSFUL
    assert list(bench.scratch.iterdir()) == []


def test_a_job_that_kills_every_child_fails_after_its_attempts(bench: Bench) -> None:
    job = bench.run("die")
    assert job.status is JobStatus.FAILED
    assert job.message == "the computing process died 2 times"
    assert bench.run("work").status is JobStatus.SUCCESSFUL


def test_a_full_disk_delays_a_job_and_loses_nothing(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bench.runner.stopping, "wait", lambda _: None)
    assert bench.run("full").status is JobStatus.SUCCESSFUL


def test_a_store_that_fills_up_while_publishing_delays_the_job(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    publish, refusals = bench.storage.publish, [errno.ENOSPC, errno.ENOSPC]

    def crowded(source: Path, prefix: str, name: str, media_type: str) -> Artefact:
        if refusals:
            raise OSError(refusals.pop(), "no space left")
        return publish(source, prefix, name, media_type)

    monkeypatch.setattr(bench.storage, "publish", crowded)
    monkeypatch.setattr(bench.runner.stopping, "wait", lambda _: None)
    job = bench.run("work")
    assert job.status is JobStatus.SUCCESSFUL
    assert bench.results(job.id) is not None
    assert list(bench.scratch.iterdir()) == []


def test_a_broken_computation_fails_without_saying_where(bench: Bench) -> None:
    job = bench.run("break")
    assert (job.status, job.message) == (
        JobStatus.FAILED,
        "the computation failed (ZeroDivisionError)",
    )


def test_a_refused_input_is_kept_with_field_limit_and_value(bench: Bench) -> None:
    job = bench.run("refuse")
    assert job.error is not None
    assert job.error["status"] == 400
    assert job.error["errors"] == [{"field": "radius", "limit": "known", "value": "None"}]


def test_a_dismissed_job_that_ignores_it_is_killed(bench: Bench) -> None:
    job = bench.submit("hang")
    thread = threading.Thread(target=bench.runner.execute, args=(job,))
    thread.start()
    while bench.found(job).progress == 0:
        time.sleep(0.01)
    bench.engine.cancel(job, "t")
    began = time.monotonic()
    thread.join(5.0)
    assert time.monotonic() - began < 1.0
    assert bench.found(job).status is JobStatus.DISMISSED
    assert bench.results(job) is None
    assert bench.run("work").status is JobStatus.SUCCESSFUL


def test_a_job_that_runs_too_long_is_killed_and_fails(bench: Bench) -> None:
    bench.runner.settings = bench.settings.model_copy(update={"job_timeout": 0.5})
    job = bench.run("hang")
    assert (job.status, job.message) == (JobStatus.FAILED, "the job ran longer than 0.5 s")


def test_a_job_whose_manifest_is_written_is_not_computed_again(bench: Bench) -> None:
    job = bench.submit("die")
    file = bench.scratch / "earlier"
    file.write_bytes(b"earlier")
    artefact = bench.storage.publish(file, f"t/jobs/{job}", "result.tif", "image/tiff")
    bench.storage.write_manifest(f"t/jobs/{job}", {"result": artefact}, {})
    bench.runner.execute(job)
    assert bench.found(job).status is JobStatus.SUCCESSFUL
    assert bench.results(job) == {"result": artefact}


def test_a_job_whose_dataset_is_gone_fails(bench: Bench) -> None:
    job = bench.submit("work")
    assert bench.catalogue.delete(bench.dataset, "t")
    bench.runner.execute(job)
    assert bench.found(job).message.startswith("dataset: must be an existing dataset")


def test_a_job_dismissed_while_it_is_published_leaves_no_files(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = bench.submit("work")
    write = bench.storage.write_manifest

    def late(*arguments: object) -> None:
        write(*arguments)  # type: ignore[arg-type]
        bench.engine.cancel(job, "t")

    monkeypatch.setattr(bench.storage, "write_manifest", late)
    bench.runner.execute(job)
    assert bench.found(job).status is JobStatus.DISMISSED
    assert bench.results(job) is None
    assert not bench.storage.path(f"t/jobs/{job}").exists()


def test_a_worker_that_stumbles_tries_again_and_then_says_so(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    publish, stumbles = bench.storage.publish, [1]

    def clumsy(source: Path, prefix: str, name: str, media_type: str) -> Artefact:
        if stumbles:
            stumbles.pop()
            raise OSError(errno.EIO, "input/output error")
        return publish(source, prefix, name, media_type)

    monkeypatch.setattr(bench.storage, "publish", clumsy)
    monkeypatch.setattr(bench.runner.stopping, "wait", lambda _: None)
    assert bench.run("work").status is JobStatus.SUCCESSFUL
    stumbles += [1, 1]
    job = bench.run("work")
    assert (job.status, job.message) == (
        JobStatus.FAILED,
        "the worker failed while it ran the job",
    )
    assert list(bench.scratch.iterdir()) == []


def test_a_child_that_cannot_compute_says_why() -> None:
    unfit = 'import json; print(json.dumps({"event": "unfit", "reason": "no tbb"}), flush=True)'
    with pytest.raises(Unfit, match="no tbb"):
        ComputeChild(1, [sys.executable, "-c", unfit]).start()
    with pytest.raises(RuntimeError, match="died or hung"):
        ComputeChild(1, [sys.executable, "-c", "raise SystemExit(1)"]).start()


def test_what_a_crash_left_in_the_store_is_swept(bench: Bench) -> None:
    orphan = bench.storage.path(f"t/datasets/{new_id()}")
    orphan.mkdir(parents=True)
    assert bench.catalogue.sweep() == 0
    assert bench.catalogue.sweep(older_than=-1.0) == 1
    assert not orphan.exists()
    assert bench.catalogue.get(bench.dataset, "t") is not None


def test_a_worker_that_wakes_up_late_leaves_the_results_of_another_alone(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Taken for dead while it computed, while it failed, and while it published."""
    write = bench.storage.write_manifest

    def other_worker(job: str) -> None:
        file = bench.scratch / "other"
        file.write_bytes(b"the other's")
        artefact = bench.storage.publish(file, f"t/jobs/{job}", "result.tif", "image/tiff")
        write(f"t/jobs/{job}", {"result": artefact}, {})
        assert bench.engine.succeed(job)

    def finished_by_another(act: str) -> JobRecord:
        job = bench.submit(act)
        thread = threading.Thread(target=bench.runner.execute, args=(job,))
        thread.start()
        while bench.found(job).progress == 0:
            time.sleep(0.01)
        other_worker(job)
        thread.join(10.0)
        assert not thread.is_alive()
        return bench.found(job)

    def late(prefix: str, *arguments: object) -> None:
        other_worker(prefix.rsplit("/", 1)[-1])
        write(prefix, *arguments)  # type: ignore[arg-type]

    job = finished_by_another("hang")
    monkeypatch.setattr(bench.storage, "write_manifest", late)
    for each in (job, bench.run("work")):
        assert each.status is JobStatus.SUCCESSFUL
        results = bench.results(each.id)
        assert results is not None
        assert b"".join(bench.storage.read(results["result"].key)) != b""
    breaks = bench.submit("break")
    monkeypatch.setattr(bench.runner.ledger, "fail", lambda *_: other_worker(breaks))
    bench.runner.execute(breaks)
    results = bench.results(breaks)
    assert results is not None
    assert b"".join(bench.storage.read(results["result"].key)) == b"the other's"


def test_a_job_that_is_dismissed_while_its_child_starts_does_not_wait_for_it() -> None:
    slow = ComputeChild(1, [sys.executable, "-c", "import time; time.sleep(60)"])
    began = time.monotonic()
    asked: list[object] = []
    end = slow.run({}, lambda message: asked.append(message) is None and len(asked) < 3, 0.1)
    assert end == {"event": "cancelled"}
    assert asked == [None] * 3
    assert time.monotonic() - began < 5.0
    assert slow._process is None
