"""What is old goes; what a kept job refers to stays."""

import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from postgres import Postgres

from adret_service.database import datasets, events, jobs, open_database, usage
from adret_service.datasets import DatasetCatalogue
from adret_service.engine.durable import DurableEngine
from adret_service.engine.port import JobRecord
from adret_service.ids import new_id
from adret_service.retention import DAY, Janitor
from adret_service.settings import Settings
from adret_service.status import prefix_of
from adret_service.storage import FileStorage


@dataclass
class Home:
    """A service's data, and ways to make it older."""

    engine: DurableEngine
    catalogue: DatasetCatalogue
    janitor: Janitor
    folder: Path

    def dataset(self, name: str, *, days: float = 0.0) -> str:
        raster = self.folder / name
        raster.write_bytes(name.encode())
        made = self.catalogue.add("t", raster, sha256=name, name=name, upload_bytes=1, info={})
        with self.engine.database.begin() as connection:
            connection.execute(
                datasets.update()
                .where(datasets.c.id == made.id)
                .values(created=time.time() - days * DAY)
            )
        return made.id

    def job(self, dataset: str, end: str | None, *, days: float = 0.0) -> JobRecord:
        job = self.engine.submit(
            JobRecord(id=new_id(), tenant="t", process="p", dataset=dataset, inputs={})
        )
        result = self.folder / "result"
        result.write_bytes(b"result")
        artefact = self.catalogue.storage.publish(
            result, prefix_of(job), "result.tif", "image/tiff"
        )
        self.catalogue.storage.write_manifest(prefix_of(job), {"result": artefact}, {})
        if end == "successful":
            self.engine.begin(job.id)
            self.engine.succeed(job.id)
        elif end == "failed":
            self.engine.fail(job.id, {"status": 500, "detail": "broken"})
        elif end == "dismissed":
            self.engine.cancel(job.id, "t")
        if end is not None:
            with self.engine.database.begin() as connection:
                connection.execute(
                    jobs.update()
                    .where(jobs.c.id == job.id)
                    .values(finished=time.time() - days * DAY)
                )
        return job

    def kept(self, job: JobRecord) -> tuple[bool, bool]:
        """Whether its record and whether its results are there."""
        known = self.engine.get(job.id, "t") is not None
        return known, self.catalogue.storage.manifest(prefix_of(job)) is not None


@pytest.fixture(params=["sqlite", "postgresql"])
def home(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Home]:
    address = ""
    if request.param == "postgresql":
        server: Postgres = request.getfixturevalue("postgres")
        address = server.url(f"retention-{new_id()}")
    settings = Settings(
        data_dir=tmp_path / "data",
        database_url=address,
        retention_days=7,
        keep_failed_days=2,
        dataset_days=30,
    )
    database = open_database(settings)
    engine = DurableEngine(settings, database)
    catalogue = DatasetCatalogue(database, FileStorage(settings.store_dir))
    yield Home(engine, catalogue, Janitor(settings, engine, catalogue), tmp_path)
    engine.close()
    database.dispose()


def test_jobs_go_at_the_age_of_their_kind_with_their_results(home: Home) -> None:
    dataset = home.dataset("a")
    old = home.job(dataset, "successful", days=7.1)
    young = home.job(dataset, "successful", days=6.9)
    failed = home.job(dataset, "failed", days=2.1)
    fresh = home.job(dataset, "failed", days=1.9)
    dismissed = home.job(dataset, "dismissed", days=3.0)
    waiting = home.job(dataset, None)
    assert home.janitor.look() == (3, 0)
    for job in (old, failed, dismissed):
        assert home.kept(job) == (False, False)
        assert home.engine.events(job.id) == ()
    for job in (young, fresh, waiting):
        assert home.kept(job) == (True, True)
    assert home.janitor.look() == (0, 0)


def test_a_dataset_stays_as_long_as_a_kept_job_refers_to_it(home: Home) -> None:
    read, unread, new = home.dataset("a", days=31), home.dataset("b", days=31), home.dataset("c")
    job = home.job(read, "successful", days=1)
    assert home.janitor.look() == (0, 1)
    assert home.catalogue.get(read, "t") is not None
    assert home.catalogue.get(unread, "t") is None
    assert home.catalogue.get(new, "t") is not None
    store = home.folder / "data" / "store" / "t" / "datasets"
    assert {path.name for path in store.iterdir()} == {read, new}
    assert home.engine.remove(job.id, "t")
    assert home.janitor.look() == (0, 1)
    assert home.catalogue.get(read, "t") is None


def test_a_dataset_that_is_being_ordered_stays(home: Home) -> None:
    """An order that is not yet committed holds its dataset against user and janitor."""
    dataset = home.dataset("a", days=31)
    job = JobRecord(id=new_id(), tenant="t", process="p", dataset=dataset, inputs={})
    outcomes: list[object] = []
    with home.engine.database.begin() as connection:
        home.engine.insert(connection, job)
        threads = [
            threading.Thread(target=lambda: outcomes.append(home.janitor.look())),
            threading.Thread(target=lambda: outcomes.append(home.catalogue.delete(dataset, "t"))),
        ]
        for thread in threads:
            thread.start()
        time.sleep(0.5)
    for thread in threads:
        thread.join(30.0)
    assert home.catalogue.get(dataset, "t") is not None
    assert sorted(map(str, outcomes)) == ["(0, 0)", "False"]


def test_zero_days_keep_for_ever(home: Home) -> None:
    never = home.janitor.settings.model_copy(
        update={"retention_days": 0.0, "keep_failed_days": 0.0, "dataset_days": 0.0}
    )
    home.janitor.settings = never
    job = home.job(home.dataset("a", days=4000), "successful", days=4000)
    assert home.janitor.look() == (0, 0)
    assert home.kept(job) == (True, True)


def test_one_janitor_is_at_work_at_a_time_and_usage_is_forgotten(home: Home) -> None:
    home.job(home.dataset("a"), "successful", days=8)
    with home.engine.database.begin() as connection:
        row = {"tenant": "t", "day": 1, "jobs": 1, "cells": 1}
        connection.execute(usage.insert().values(**row))
    with home.engine.presence.only_one("janitor") as mine:
        assert mine
        assert home.janitor.look() == (0, 0)
    assert home.janitor.look() == (1, 0)
    with home.engine.database.connect() as connection:
        days = [row.day for row in connection.execute(usage.select())]
        assert connection.execute(events.select()).first() is None
    assert 1 not in days
