"""Orders to call back: one commit with the change, shared among heralds, on both databases."""

import json
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from postgres import Postgres

from adret_service.callbacks import CLAIM, Herald
from adret_service.database import callbacks, open_database, tally
from adret_service.engine.durable import DurableEngine
from adret_service.engine.port import JobRecord
from adret_service.ids import new_id
from adret_service.settings import Settings
from adret_service.storage import FileStorage

URIS = {f"{kind}Uri": f"https://h.example/{kind}" for kind in ("success", "failed", "inProgress")}


@dataclass
class Wire:
    """Stands for the network; `answers` are the next statuses, then 200."""

    sent: list[tuple[str, dict[str, Any]]] = field(default_factory=list)
    answers: list[int | OSError] = field(default_factory=list)

    def post(self, url: str, body: bytes, headers: Any) -> int:
        self.sent.append((url.rsplit("/", 1)[-1], json.loads(body)))
        answer = self.answers.pop(0) if self.answers else 200
        if isinstance(answer, OSError):
            raise answer
        return answer


@dataclass
class Post:
    """An engine, a herald, and the wire between it and the world."""

    engine: DurableEngine
    herald: Herald
    wire: Wire

    def order(self, **subscriber: str) -> JobRecord:
        request = {"subscriber": subscriber or URIS, "base": "https://adret.example"}
        job = JobRecord(
            id=new_id(), tenant="t", process="echo", dataset="", inputs={}, request=request
        )
        return self.engine.submit(job)

    def due(self) -> list[Any]:
        with self.engine.database.connect() as connection:
            return list(connection.execute(sa.select(callbacks).order_by(callbacks.c.kind)))

    def told(self) -> list[str]:
        return [kind for kind, _ in self.wire.sent]


@pytest.fixture(params=["sqlite", "postgresql"])
def post(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Post]:
    address = ""
    if request.param == "postgresql":
        server: Postgres = request.getfixturevalue("postgres")
        address = server.url(f"callbacks-{new_id()}")
    settings = Settings(
        data_dir=tmp_path,
        database_url=address,
        webhook_hosts="h.example",
        webhook_secret="x" * 16,
        webhook_attempts=2,
        webhook_pause=0.01,
    )
    database = open_database(settings)
    engine = DurableEngine(settings, database)
    herald = Herald(settings, database, FileStorage(settings.store_dir))
    wire = Wire()
    herald.outbound = wire  # type: ignore[assignment]
    yield Post(engine, herald, wire)
    engine.close()
    database.dispose()


def test_each_change_is_told_once_to_its_address(post: Post) -> None:
    job = post.order()
    assert post.due() == []
    post.engine.begin(job.id)
    assert post.herald.look() == 1
    assert post.wire.sent[0][1]["status"] == "running"
    assert post.wire.sent[0][1]["links"][0]["href"] == f"https://adret.example/jobs/{job.id}"
    post.engine.progress(job.id, 50, "running")
    assert [row.kind for row in post.due()] == ["inProgress"]
    assert post.due()[0].due > time.time() + 3.0
    post.engine.succeed(job.id)
    assert post.herald.look() == 1
    assert post.told() == ["inProgress", "success"]
    with post.engine.database.begin() as connection:
        connection.execute(callbacks.update().values(due=0.0))
    assert post.herald.look() == 0  # progress of a job that has ended is no news
    assert post.due() == []


def test_what_fails_or_is_dismissed_is_told_as_failed(post: Post) -> None:
    failed, dismissed = post.order(), post.order()
    post.engine.fail(failed.id, {"status": 500, "detail": "broken"})
    post.engine.cancel(dismissed.id, "t")
    assert post.herald.look() == 2
    assert {body["status"] for _, body in post.wire.sent} == {"failed", "dismissed"}


def test_only_what_was_asked_for_is_told(post: Post) -> None:
    job = post.order(failedUri=URIS["failedUri"])
    post.engine.begin(job.id)
    post.engine.succeed(job.id)
    assert post.due() == []


def test_a_callback_comes_again_and_is_given_up(post: Post) -> None:
    job = post.order(failedUri=URIS["failedUri"])
    post.engine.cancel(job.id, "t")
    post.wire.answers += [OSError("nobody there"), 500]
    assert post.herald.look() == 0
    assert [row.attempts for row in post.due()] == [1]
    time.sleep(0.05)
    assert post.herald.look() == 0
    assert post.due() == []
    assert post.told() == ["failed", "failed"]
    last = post.engine.events(job.id)[-1].body
    assert last["message"] == "callback failed given up after 2: status 500"


def test_a_claimed_callback_is_anothers_only_after_a_while(post: Post) -> None:
    job = post.order(failedUri=URIS["failedUri"])
    post.engine.cancel(job.id, "t")
    assert len(post.herald._claimed()) == 1  # and its herald dies
    assert post.herald.look() == 0
    (row,) = post.due()
    assert time.time() < row.due <= time.time() + CLAIM
    with post.engine.database.begin() as connection:
        connection.execute(callbacks.update().values(due=time.time()))
    assert post.herald.look() == 1
    assert post.due() == []


def test_a_removed_job_is_not_told_of_and_ended_jobs_are_counted(post: Post) -> None:
    job = post.order(failedUri=URIS["failedUri"])
    post.engine.begin(job.id)
    post.engine.cancel(job.id, "t")
    assert post.engine.remove(job.id, "t")
    assert post.herald.look() == 0
    assert post.wire.sent == []
    with post.engine.database.connect() as connection:
        (row,) = connection.execute(sa.select(tally)).all()
    assert (row.process, row.status, row.jobs) == ("echo", "dismissed", 1)
    assert 0.0 <= row.ran < 30.0
    assert 0.0 <= row.waited < 30.0
