"""What the service counts, for Prometheus: jobs, queue, workers, callbacks, space."""

import time
from collections.abc import Iterator

import sqlalchemy as sa
from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily
from prometheus_client.metrics_core import Metric
from prometheus_client.registry import Collector

import adret
from adret_service.database import callbacks, datasets, jobs, tally, work
from adret_service.engine.port import JobEngine, JobStatus
from adret_service.processes import names
from adret_service.storage import Storage

__all__ = ["exposition"]

LABELS = ["process", "status"]


class Counted(Collector):
    """Looks into the database when it is asked, so every API process tells the same."""

    def __init__(self, engine: JobEngine, database: sa.Engine, storage: Storage) -> None:
        self.engine = engine
        self.database = database
        self.storage = storage

    def collect(self) -> Iterator[Metric]:
        """Yield every metric."""
        info = GaugeMetricFamily("adret_build_info", "This release.", labels=["version"])
        info.add_metric([adret.__version__], 1.0)
        yield info
        health = self.engine.health()
        for name, what, value in (
            ("adret_queue_waiting", "Jobs that wait for a worker.", health.waiting),
            ("adret_jobs_running", "Jobs that a worker has.", health.running),
            ("adret_workers_alive", "Worker processes that hold their lock.", health.workers),
            ("adret_free_bytes", "Free space of the store.", self.storage.free_bytes()),
        ):
            yield GaugeMetricFamily(name, what, value=float(value))
        with self.database.connect() as connection:
            yield from self._jobs(connection)
            yield from self._others(connection)

    def _jobs(self, connection: sa.Connection) -> Iterator[Metric]:
        yield from self._queue(connection)
        kept = GaugeMetricFamily("adret_jobs", "Jobs that are kept.", labels=LABELS)
        query = sa.select(jobs.c.process, jobs.c.status, sa.func.count())
        for process, status, count in connection.execute(
            query.group_by(jobs.c.process, jobs.c.status)
        ):
            kept.add_metric([process, status], float(count))
        yield kept
        ended = CounterMetricFamily("adret_jobs_ended", "Jobs that ended, ever.", labels=LABELS)
        waited = CounterMetricFamily(
            "adret_job_wait_seconds", "Time that ended jobs waited.", labels=LABELS
        )
        ran = CounterMetricFamily(
            "adret_job_run_seconds", "Time that ended jobs ran.", labels=LABELS
        )
        for row in connection.execute(sa.select(tally)):
            labels = [row.process, row.status]
            ended.add_metric(labels, float(row.jobs))
            waited.add_metric(labels, row.waited)
            ran.add_metric(labels, row.ran)
        cells = CounterMetricFamily(
            "adret_job_cells", "Cells of the rasters of successful jobs.", labels=["process"]
        )
        lost = CounterMetricFamily(
            "adret_worker_deaths", "Deaths of workers that had a job, ever.", labels=["process"]
        )
        for row in connection.execute(sa.select(work)):
            cells.add_metric([row.process], float(row.cells))
            lost.add_metric([row.process], float(row.revivals))
        yield from (ended, waited, ran, cells, lost)

    def _queue(self, connection: sa.Connection) -> Iterator[Metric]:
        """Waiting and running jobs of every process that can be ordered, none counted as 0."""
        oldest = sa.func.min(jobs.c.created)
        query = sa.select(jobs.c.process, jobs.c.status, sa.func.count(), oldest)
        unfinished = (JobStatus.ACCEPTED, JobStatus.RUNNING)
        found = {
            (process, status): (count, since)
            for process, status, count, since in connection.execute(
                query.where(jobs.c.status.in_([str(each) for each in unfinished])).group_by(
                    jobs.c.process, jobs.c.status
                )
            )
        }
        processes = sorted({*names(), *(process for process, _ in found)})
        now = time.time()
        for name, what, status, place in (
            ("adret_queue_depth", "Jobs that wait, by process.", "accepted", 0),
            ("adret_queue_oldest_seconds", "Age of the oldest that waits.", "accepted", 1),
            ("adret_running", "Jobs that a worker has, by process.", "running", 0),
        ):
            metric = GaugeMetricFamily(name, what, labels=["process"])
            for process in processes:
                value = found.get((process, status), (0, now))[place]
                metric.add_metric([process], float(value) if place == 0 else max(now - value, 0.0))
            yield metric

    def _others(self, connection: sa.Connection) -> Iterator[Metric]:
        for name, what, query in (
            (
                "adret_job_revivals",
                "Workers that the kept jobs have lost.",
                sa.select(sa.func.coalesce(sa.func.sum(jobs.c.revivals), 0)),
            ),
            (
                "adret_callbacks_waiting",
                "Callbacks to be sent.",
                sa.select(sa.func.count()).select_from(callbacks),
            ),
            ("adret_datasets", "Datasets.", sa.select(sa.func.count()).select_from(datasets)),
            (
                "adret_upload_bytes",
                "Bytes of all uploads that are kept.",
                sa.select(sa.func.coalesce(sa.func.sum(datasets.c.upload_bytes), 0)),
            ),
        ):
            value = float(connection.execute(query).scalar_one())
            yield GaugeMetricFamily(name, what, value=value)


def exposition(
    requests: CollectorRegistry, engine: JobEngine, database: sa.Engine, storage: Storage
) -> bytes:
    """Return all metrics as Prometheus reads them."""
    registry = CollectorRegistry()
    registry.register(Counted(engine, database, storage))
    return generate_latest(registry) + generate_latest(requests)
