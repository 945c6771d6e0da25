"""The durable engine and its in-memory twin keep the same promises; the reaper keeps one more."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from postgres import Postgres
from servers import wait_for

from adret_service.database import datasets, open_database
from adret_service.engine.advisory import AdvisoryPresence
from adret_service.engine.durable import DurableEngine, Reaper
from adret_service.engine.liveness import Lease, is_dead, live, only_one, sweep_scratch
from adret_service.engine.memory import MemoryEngine
from adret_service.engine.port import (
    JobFilter,
    JobRecord,
    JobStatus,
    KeyReused,
    OverQuota,
    Quota,
    RequestKey,
)
from adret_service.ids import is_id, new_id
from adret_service.settings import Settings

Engine = DurableEngine | MemoryEngine
DATASET = "0" * 26


DATABASES = ["sqlite", "postgresql"]


@pytest.fixture(scope="module")
def migrated(postgres: Postgres) -> str:
    """Name of a database with all tables, to be copied."""
    settings = Settings(database_url=postgres.url("migrated"))
    DurableEngine(settings).close()
    return "migrated"


def settings_on(database: str, request: pytest.FixtureRequest, folder: Path) -> Settings:
    address = ""
    if database == "postgresql":
        postgres: Postgres = request.getfixturevalue("postgres")
        template = request.getfixturevalue("migrated")
        address = postgres.url(f"engine-{new_id()}", template)
    return Settings(
        data_dir=folder / "data",
        database_url=address,
        job_max_revivals=2,
        liveness_interval=0.1,
        liveness_grace=0.0,
    )


@contextmanager
def engine_on(settings: Settings) -> Iterator[DurableEngine]:
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


@pytest.fixture(params=DATABASES)
def settings(request: pytest.FixtureRequest, tmp_path: Path) -> Settings:
    return settings_on(request.param, request, tmp_path)


@pytest.fixture
def durable(settings: Settings) -> Iterator[DurableEngine]:
    with engine_on(settings) as engine:
        yield engine


@pytest.fixture(params=["memory", *DATABASES])
def engine(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Engine]:
    if request.param == "memory":
        yield MemoryEngine()
        return
    with engine_on(settings_on(request.param, request, tmp_path)) as engine:
        yield engine


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


def test_a_key_stands_for_one_order(engine: Engine) -> None:
    key = RequestKey(key="mine", digest="a")
    first = engine.submit(job(), key)
    assert engine.submit(job(), key).id == first.id
    assert engine.submit(job(tenant="t"), RequestKey(key="other", digest="a")).id != first.id
    with pytest.raises(KeyReused):
        engine.submit(job(), RequestKey(key="mine", digest="b"))
    assert len(engine.list("t")) == 2
    engine.cancel(first.id, "t")
    assert engine.submit(job(), key).id == first.id
    engine.remove(first.id, "t")
    assert engine.submit(job(), key).id != first.id


def test_a_key_that_comes_many_times_at_once_makes_one_job(engine: Engine) -> None:
    key = RequestKey(key="mine", digest="a")
    with ThreadPoolExecutor(8) as pool:
        ids = {made.id for made in pool.map(lambda _: engine.submit(job(), key), range(16))}
    assert len(ids) == 1
    assert [record.id for record in engine.list("t")] == list(ids)


def test_a_quota_holds_however_many_orders_come_at_once(engine: Engine) -> None:
    quota = Quota(jobs=3, cells_per_day=1000)

    def order(_: int) -> str | OverQuota:
        try:
            return engine.submit(job(), cells=1, quota=quota).id
        except OverQuota as over:
            return over

    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(order, range(12)))
    made = [answer for answer in answers if isinstance(answer, str)]
    refused = [(each.field, each.value) for each in answers if isinstance(each, OverQuota)]
    assert refused == [("jobs", 3)] * 9
    assert len(made) == len(engine.list("t")) == 3
    engine.cancel(made[0], "t")
    with pytest.raises(OverQuota, match="cells"):
        engine.submit(job(), cells=998, quota=quota)
    engine.submit(job(), cells=997, quota=quota)


@pytest.mark.parametrize("end", ["fail", "cancel", "succeed", None])
def test_a_failed_or_dismissed_job_can_be_tried_again(engine: Engine, end: str | None) -> None:
    accepted = engine.submit(job())
    engine.begin(accepted.id)
    engine.progress(accepted.id, 40, "running")
    if end == "fail":
        engine.fail(accepted.id, {"detail": "why"})
    elif end == "cancel":
        engine.cancel(accepted.id, "t")
    elif end == "succeed":
        engine.succeed(accepted.id)
    assert engine.retry(accepted.id, "other") is None
    again = engine.retry(accepted.id, "t")
    if end in ("succeed", None):
        assert again is None
        return
    assert again is not None
    assert (again.status, again.progress, again.error) == (JobStatus.ACCEPTED, 0, None)
    assert again.finished is None
    assert engine.retry(accepted.id, "t") is None
    assert engine.begin(accepted.id) is not None
    assert engine.succeed(accepted.id)


def test_what_happens_to_a_job_is_told_in_order(engine: Engine) -> None:
    accepted, other = engine.submit(job()), engine.submit(job())
    engine.begin(accepted.id)
    engine.progress(accepted.id, 40, "running")
    engine.note(accepted.id, "warning", "its computing process died")
    engine.succeed(accepted.id)
    engine.note(accepted.id, "info", "too late")
    told = engine.events(accepted.id)
    assert [event.kind for event in told] == ["status", "status", "progress", "log", "status"]
    assert [event.body.get("status") for event in told] == [
        "accepted",
        "running",
        None,
        None,
        "successful",
    ]
    assert told[2].body["progress"] == 40
    assert told[3].body == {"level": "warning", "message": "its computing process died"}
    numbers = [event.seq for event in told]
    assert numbers == sorted(set(numbers))
    assert engine.events(accepted.id, numbers[2]) == told[3:]
    assert len(engine.events(other.id)) == 1
    engine.remove(accepted.id, "t")
    assert engine.events(accepted.id) == ()


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
    of_q = JobFilter(processes=frozenset({"q"}))
    assert {record.process for record in engine.list("t", of_q)} == {"q"}
    engine.cancel(ids[0], "t")
    ended = JobFilter(statuses=frozenset({JobStatus.DISMISSED, JobStatus.FAILED}))
    assert [record.id for record in engine.list("t", ended)] == ids[:1]
    later = JobFilter(created=(made[1].created, None))
    assert {record.id for record in engine.list("t", later)} == {r.id for r in made[1:]}
    assert engine.list("t", JobFilter(created=(None, made[0].created - 1.0))) == []
    assert engine.list("t", JobFilter(seconds=(0.0, None))) == []
    engine.begin(ids[1])
    assert [record.id for record in engine.list("t", JobFilter(seconds=(0.0, 60.0)))] == [ids[1]]
    assert engine.list("t", JobFilter(seconds=(60.0, None))) == []
    assert engine.list("other") == []
    assert engine.health().waiting == 2


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


@pytest.fixture
def local(tmp_path: Path) -> Settings:
    return Settings(data_dir=tmp_path / "data")


HOLDER = """
import sys, time
from pathlib import Path
from adret_service.engine.liveness import Lease
lease = Lease(Path(sys.argv[1]), Path(sys.argv[2]), "worker")
print(lease.name, flush=True)
time.sleep(60)
"""


@pytest.fixture
def holder(local: Settings) -> Iterator["subprocess.Popen[str]"]:
    command = [sys.executable, "-c", HOLDER, str(local.locks_dir), str(local.scratch_dir)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        yield process
        process.kill()


def test_a_killed_process_is_dead_and_a_stopped_one_is_not(
    local: Settings, holder: "subprocess.Popen[str]"
) -> None:
    assert holder.stdout is not None
    name = holder.stdout.readline().strip()
    assert live(local.locks_dir, "worker") == [name]
    os.kill(holder.pid, signal.SIGSTOP)
    assert not is_dead(local.locks_dir, name)
    (local.scratch_dir / name / "half").write_text("x")
    sweep_scratch(local.locks_dir, local.scratch_dir)
    assert (local.scratch_dir / name / "half").exists()
    holder.kill()
    holder.wait()
    assert is_dead(local.locks_dir, name)
    sweep_scratch(local.locks_dir, local.scratch_dir)
    assert list(local.scratch_dir.iterdir()) == []
    assert list(local.locks_dir.iterdir()) == []


def test_a_lease_is_released_in_peace_and_a_duty_has_one_holder(local: Settings) -> None:
    with Lease(local.locks_dir, local.scratch_dir, "api") as lease:
        assert live(local.locks_dir, "api") == [lease.name]
        assert lease.scratch.is_dir()
    assert is_dead(local.locks_dir, lease.name)
    assert not lease.scratch.exists()
    locks = local.locks_dir
    with only_one(locks, "reaper") as first, only_one(locks, "reaper") as second:
        assert (first, second) == (True, False)
    with only_one(local.locks_dir, "reaper") as third:
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
        announced = engine.announce(lease)
        engine.claimed = {"worker-dead": [lost, gone, worn], lease.name: [kept]}
        assert Reaper(engine, settings).look() == 1
        if announced is not None:
            announced.release()
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


@pytest.fixture
def remote(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[DurableEngine]:
    with engine_on(settings_on("postgresql", request, tmp_path)) as engine:
        yield engine


def test_a_process_on_a_server_lives_as_long_as_its_session(remote: DurableEngine) -> None:
    settings = remote.settings
    with Lease(settings.locks_dir, settings.scratch_dir, "worker") as lease:
        assert remote.presence.is_dead(lease.name)
        announced = remote.announce(lease)
        assert announced is not None
        assert not remote.presence.is_dead(lease.name)
        assert (remote.presence.living("worker"), remote.presence.living("api")) == (1, 0)
        assert remote.health().workers == 1
        announced.release()
        assert remote.presence.is_dead(lease.name)
        assert remote.presence.living("worker") == 0


def test_a_killed_process_frees_its_lock_on_the_server(remote: DurableEngine) -> None:
    code = (
        "import sys, time\n"
        "from adret_service.engine.advisory import AdvisoryLock\n"
        "AdvisoryLock(sys.argv[1], 'worker-x', 1.0)\n"
        "print('held', flush=True)\n"
        "time.sleep(60)\n"
    )
    command = [sys.executable, "-c", code, remote.settings.database]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        os.kill(process.pid, signal.SIGSTOP)
        assert not remote.presence.is_dead("worker-x")
        process.kill()
    wait_for(lambda: remote.presence.is_dead("worker-x"), 5.0)


def test_a_lost_session_is_not_a_death_within_the_grace(
    remote: DurableEngine, postgres: Postgres
) -> None:
    settings = remote.settings
    patient = AdvisoryPresence(remote.database, grace=5.0)
    with Lease(settings.locks_dir, settings.scratch_dir, "worker") as lease:
        announced = remote.announce(lease)
        assert announced is not None
        remote.database.dispose()
        postgres.drop_sessions(str(remote.database.url.database))
        assert not patient.is_dead(lease.name)
        wait_for(lambda: not remote.presence.is_dead(lease.name), 5.0)
        announced.release()
        assert not patient.is_dead(lease.name)
        # The server frees the lock once it has noticed that the session is closed.
        hasty = AdvisoryPresence(remote.database, grace=0.0)
        wait_for(lambda: hasty.is_dead(lease.name), 5.0)


def test_a_duty_on_a_server_has_one_holder(remote: DurableEngine) -> None:
    presence = remote.presence
    with presence.only_one("reaper") as first, presence.only_one("reaper") as second:
        assert (first, second) == (True, False)
    with presence.only_one("reaper") as third:
        assert third


def test_nothing_in_the_database_is_pickled(durable: DurableEngine) -> None:
    durable.submit(job())
    schema = "" if durable.database.dialect.name == "sqlite" else "dbos."
    with durable.database.connect() as connection:
        kinds = connection.exec_driver_sql(f"SELECT serialization FROM {schema}workflow_status")
        assert set(kinds.scalars()) == {"portable_json"}
        query = f"SELECT inputs FROM {schema}workflow_input"
        inputs = connection.exec_driver_sql(query).scalars().all()
    assert [set(json.loads(text)) for text in inputs] == [{"positionalArgs", "namedArgs"}]


@pytest.mark.parametrize("database", DATABASES)
def test_jobs_of_the_first_release_are_kept_and_finished(
    database: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    settings = settings_on(database, request, tmp_path)
    with engine_on(settings) as engine:
        old = engine.submit(job())
        with engine.database.begin() as connection:
            connection.exec_driver_sql("ALTER TABLE adret_jobs DROP COLUMN request")
            connection.exec_driver_sql("DROP TABLE adret_callbacks")
            connection.exec_driver_sql("DROP TABLE adret_tally")
            connection.exec_driver_sql("UPDATE adret_meta SET schema_version = 1")
    newer = DurableEngine(settings)
    found = newer.begin(old.id)
    assert found is not None
    assert (found.inputs, found.request) == (old.inputs, {})
    assert newer.succeed(old.id)
    newer.close()
