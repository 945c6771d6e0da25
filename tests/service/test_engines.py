"""The durable engine and its in-memory twin keep the same promises; the reaper keeps one more."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from adret_service.database import datasets, open_database
from adret_service.engine.durable import DurableEngine, Reaper
from adret_service.engine.liveness import Lease, is_dead, live, only_one, sweep_scratch
from adret_service.engine.memory import MemoryEngine
from adret_service.engine.port import JobRecord, JobStatus
from adret_service.ids import is_id, new_id
from adret_service.settings import Settings

Engine = DurableEngine | MemoryEngine
DATASET = "0" * 26


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return Settings(data_dir=tmp_path / "data", job_max_revivals=2)


@pytest.fixture
def durable(settings: Settings) -> Iterator[DurableEngine]:
    database = open_database(settings)
    row = {
        "id": DATASET,
        "tenant": "t",
        "sha256": "",
        "name": "",
        "upload_bytes": 0,
        "created": 0.0,
        "key": "",
        "info": {},
    }
    with database.begin() as connection:
        connection.execute(datasets.insert().values(**row))
    engine = DurableEngine(settings, database)
    yield engine
    engine.close()
    database.dispose()


@pytest.fixture(params=["memory", "durable"])
def engine(request: pytest.FixtureRequest) -> Engine:
    if request.param == "memory":
        return MemoryEngine()
    found: DurableEngine = request.getfixturevalue("durable")
    return found


def job(**changes: object) -> JobRecord:
    record = JobRecord(
        id=new_id(), tenant="t", process="p", dataset=DATASET, inputs={"a": [1, None]}
    )
    return replace(record, **changes)  # type: ignore[arg-type]


def test_an_accepted_job_is_found_by_its_tenant_alone(engine: Engine) -> None:
    accepted = engine.submit(job())
    assert engine.get(accepted.id, "t") == accepted
    assert accepted.status is JobStatus.ACCEPTED
    assert abs(accepted.created - time.time()) < 10.0
    assert engine.get(accepted.id, "other") is None
    assert engine.get(new_id(), "t") is None
    assert engine.cancel(accepted.id, "other") is None
    assert not engine.remove(accepted.id, "other")


def test_a_job_goes_through_its_states(engine: Engine) -> None:
    accepted = engine.submit(job())
    started = engine.begin(accepted.id)
    assert started is not None
    assert (started.status, started.started is None) == (JobStatus.RUNNING, False)
    assert engine.wanted(accepted.id)
    engine.progress(accepted.id, 40, "running")
    again = engine.begin(accepted.id)
    assert again is not None
    assert (again.progress, again.inputs) == (40, {"a": [1, None]})
    assert engine.health().running == 1
    assert engine.succeed(accepted.id)
    done = engine.get(accepted.id, "t")
    assert done is not None
    assert (done.status, done.progress, done.is_finished) == (JobStatus.SUCCESSFUL, 100, True)


@pytest.mark.parametrize("end", ["succeed", "fail", "cancel"])
def test_a_finished_job_never_changes_again(engine: Engine, end: str) -> None:
    accepted = engine.submit(job())
    error = {"detail": "why"}
    if end == "succeed":
        engine.succeed(accepted.id)
    elif end == "fail":
        engine.fail(accepted.id, error)
    else:
        engine.cancel(accepted.id, "t")
    before = engine.get(accepted.id, "t")
    assert not engine.succeed(accepted.id)
    assert not engine.fail(accepted.id, error)
    assert engine.begin(accepted.id) is None
    assert not engine.wanted(accepted.id)
    engine.progress(accepted.id, 3, "x")
    assert engine.cancel(accepted.id, "t") == before
    assert engine.get(accepted.id, "t") == before


def test_only_a_finished_job_can_be_removed(engine: Engine) -> None:
    accepted = engine.submit(job())
    assert not engine.remove(accepted.id, "t")
    engine.cancel(accepted.id, "t")
    assert engine.remove(accepted.id, "t")
    assert engine.get(accepted.id, "t") is None
    assert engine.list("t") == []


def test_lists_are_newest_first_and_filtered(engine: Engine) -> None:
    made = [engine.submit(job(process="pq"[i % 2])) for i in range(4)]
    ids = sorted((record.id for record in made), reverse=True)
    assert [record.id for record in engine.list("t")] == ids
    assert [record.id for record in engine.list("t", limit=2)] == ids[:2]
    assert [record.id for record in engine.list("t", before=ids[1])] == ids[2:]
    assert {record.process for record in engine.list("t", process="q")} == {"q"}
    engine.cancel(ids[0], "t")
    assert [r.id for r in engine.list("t", status=JobStatus.DISMISSED)] == ids[:1]
    assert engine.list("other") == []
    assert engine.health().waiting == 3


def test_an_accepted_job_survives_the_engine(settings: Settings, durable: DurableEngine) -> None:
    accepted = durable.submit(job())
    other = DurableEngine(settings)
    assert other.get(accepted.id, "t") == accepted
    other.close()


def test_a_job_for_a_missing_dataset_is_not_accepted(durable: DurableEngine) -> None:
    orphan = job(dataset="1" * 26)
    with pytest.raises(LookupError):
        durable.submit(orphan)
    assert durable.get(orphan.id, "t") is None
    assert durable.pending() == {}


def test_identifiers_sort_by_time_and_are_recognised() -> None:
    first = new_id()
    time.sleep(0.002)
    assert first < new_id()
    assert is_id(first)
    assert not is_id(first.upper())


HOLDER = """
import sys, time
from pathlib import Path
from adret_service.engine.liveness import Lease
lease = Lease(Path(sys.argv[1]), Path(sys.argv[2]), "worker")
print(lease.name, flush=True)
time.sleep(60)
"""


@pytest.fixture
def holder(settings: Settings) -> Iterator["subprocess.Popen[str]"]:
    command = [sys.executable, "-c", HOLDER, str(settings.locks_dir), str(settings.scratch_dir)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        yield process
        process.kill()


def test_a_killed_process_is_dead_and_a_stopped_one_is_not(
    settings: Settings, holder: "subprocess.Popen[str]"
) -> None:
    assert holder.stdout is not None
    name = holder.stdout.readline().strip()
    assert live(settings.locks_dir, "worker") == [name]
    os.kill(holder.pid, signal.SIGSTOP)
    assert not is_dead(settings.locks_dir, name)
    (settings.scratch_dir / name / "half").write_text("x")
    sweep_scratch(settings.locks_dir, settings.scratch_dir)
    assert (settings.scratch_dir / name / "half").exists()
    holder.kill()
    holder.wait()
    assert is_dead(settings.locks_dir, name)
    sweep_scratch(settings.locks_dir, settings.scratch_dir)
    assert list(settings.scratch_dir.iterdir()) == []
    assert list(settings.locks_dir.iterdir()) == []


def test_a_lease_is_released_in_peace_and_a_duty_has_one_holder(settings: Settings) -> None:
    with Lease(settings.locks_dir, settings.scratch_dir, "api") as lease:
        assert live(settings.locks_dir, "api") == [lease.name]
        assert lease.scratch.is_dir()
    assert is_dead(settings.locks_dir, lease.name)
    assert not lease.scratch.exists()
    locks = settings.locks_dir
    with only_one(locks, "reaper") as first, only_one(locks, "reaper") as second:
        assert (first, second) == (True, False)
    with only_one(settings.locks_dir, "reaper") as third:
        assert third


class Claimed(DurableEngine):
    """An engine whose queue says that a process has claimed these jobs."""

    claimed: dict[str, list[str]] = {}  # noqa: RUF012

    def pending(self) -> dict[str, list[str]]:
        return self.claimed


def test_the_reaper_gives_back_the_jobs_of_the_dead_and_of_nobody_else(
    settings: Settings, durable: DurableEngine
) -> None:
    engine = Claimed(settings, durable.database)
    lost, kept, gone, worn = (engine.submit(job()).id for _ in range(4))
    for each in (lost, kept, gone, worn):
        engine.begin(each)
    engine.cancel(gone, "t")
    for _ in range(settings.job_max_revivals):
        engine.revived(worn)
    with Lease(settings.locks_dir, settings.scratch_dir, "worker") as lease:
        engine.claimed = {"worker-dead": [lost, gone, worn], lease.name: [kept]}
        assert Reaper(engine, settings).look() == 1
    revived = engine.get(lost, "t")
    assert revived is not None
    assert (revived.status, revived.revivals) == (JobStatus.RUNNING, 1)
    untouched = engine.get(kept, "t")
    assert untouched is not None
    assert untouched.revivals == 0
    given_up = engine.get(worn, "t")
    assert given_up is not None
    assert given_up.status is JobStatus.FAILED
    assert "too often (limit: 2 times)" in given_up.message
    dismissed = engine.get(gone, "t")
    assert dismissed is not None
    assert dismissed.status is JobStatus.DISMISSED
    engine.close()


def test_nothing_in_the_database_is_pickled(durable: DurableEngine) -> None:
    durable.submit(job())
    with durable.database.connect() as connection:
        kinds = connection.exec_driver_sql("SELECT serialization FROM workflow_status").scalars()
        assert set(kinds) == {"portable_json"}
        inputs = connection.exec_driver_sql("SELECT inputs FROM workflow_input").scalars().all()
    assert [set(json.loads(text)) for text in inputs] == [{"positionalArgs", "namedArgs"}]
