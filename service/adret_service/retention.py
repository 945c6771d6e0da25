"""Retention: what is old enough goes, and what something kept refers to stays."""

import logging
import threading
import time

import sqlalchemy as sa

from adret_service.database import datasets, jobs, usage
from adret_service.datasets import DatasetCatalogue, wait_for_orders
from adret_service.engine.durable import DurableEngine
from adret_service.engine.port import FINISHED, JobStatus
from adret_service.settings import Settings
from adret_service.status import prefix_of

__all__ = ["Janitor"]

log = logging.getLogger("adret.service")

DAY = 86_400.0
BATCH = 200
ORPHANS = 3600.0  # seconds between two looks through the whole store


class Janitor:
    """Removes old jobs with their results, old datasets, and what a crash left in the store.

    A dataset stays as long as any job that is kept refers to it. Of all janitors that share a
    database one is at work at a time.

    Parameters
    ----------
    settings : Settings
        Ages; zero keeps for ever.
    engine : DurableEngine
    catalogue : DatasetCatalogue
    """

    def __init__(
        self, settings: Settings, engine: DurableEngine, catalogue: DatasetCatalogue
    ) -> None:
        self.settings = settings
        self.engine = engine
        self.catalogue = catalogue
        self._swept = time.monotonic()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._loop, name="janitor", daemon=True)

    def start(self) -> None:
        """Look in the background, now and every `sweep_interval`."""
        self._thread.start()

    def stop(self) -> None:
        """Stop looking."""
        self._stop.set()
        self._thread.join(2.0)

    def look(self) -> tuple[int, int]:
        """Remove what is old; returns how many jobs and datasets went."""
        with self.engine.presence.only_one("janitor") as mine:
            if not mine:
                return 0, 0
            gone = self._old_jobs(), self._old_datasets()
            self._old_usage()
            if time.monotonic() - self._swept > ORPHANS:
                self._swept = time.monotonic()
                self.catalogue.sweep()
        if any(gone):
            log.info("retention removed %d jobs and %d datasets", *gone)
        return gone

    def _old_jobs(self) -> int:
        removed = 0
        for status in FINISHED:
            kept = status is JobStatus.SUCCESSFUL
            days = self.settings.retention_days if kept else self.settings.keep_failed_days
            if not days:
                continue
            query = (
                sa.select(jobs.c.id, jobs.c.tenant)
                .where(jobs.c.status == str(status), jobs.c.finished < time.time() - days * DAY)
                .order_by(jobs.c.finished)
                .limit(BATCH)
            )
            with self.engine.database.connect() as connection:
                rows = connection.execute(query).all()
            for row in rows:
                if self._stop.is_set():
                    break
                job = self.engine.get(row.id, row.tenant)
                # One that is run again meanwhile is not finished any more, and stays.
                if job is not None and self.engine.remove(row.id, row.tenant):
                    self.catalogue.storage.delete(prefix_of(job))
                    removed += 1
        return removed

    def _old_datasets(self) -> int:
        if not self.settings.dataset_days:
            return 0
        old = datasets.c.created < time.time() - self.settings.dataset_days * DAY
        unused = ~sa.exists().where(jobs.c.dataset == datasets.c.id)
        query = sa.select(datasets.c.id, datasets.c.tenant).where(old, unused).limit(BATCH)
        removed = 0
        with self.engine.database.connect() as connection:
            rows = connection.execute(query).all()
        for row in rows:
            statement = datasets.delete().where(datasets.c.id == row.id, unused)
            with self.engine.database.begin() as connection:
                wait_for_orders(connection, row.id)
                deleted = connection.execute(statement).rowcount == 1
            if deleted:
                self.catalogue.storage.delete(f"{row.tenant}/datasets/{row.id}")
                removed += 1
        return removed

    def _old_usage(self) -> None:
        today = int(time.time() // DAY)
        with self.engine.database.begin() as connection:
            connection.execute(usage.delete().where(usage.c.day < today - 1))

    def _loop(self) -> None:
        while not self._stop.is_set():
            try:
                self.look()
            except Exception:
                log.exception("the janitor failed and will try again")
            self._stop.wait(self.settings.sweep_interval)
