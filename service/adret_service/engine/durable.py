"""The durable engine: job rows and the DBOS queue in one database, one transaction.

DBOS is the queue: a job is a workflow whose only argument is the job's id, written as JSON. The
jobs table is what the world sees. Nothing in DBOS's open package revives the workflows of a
process that died for good, so :class:`Reaper` does: a process is dead when its lock can be taken,
a file's lock beside a SQLite database and an advisory lock in a PostgreSQL one.
"""

import contextlib
import logging
import threading
import time
from collections.abc import Callable
from typing import Any

import sqlalchemy as sa
from dbos import (
    DBOS,
    DBOSClient,
    DBOSConfig,
    DBOSPortableJSONSerializer,
    EnqueueOptions,
    WorkflowSerializationFormat,
    run_dbos_database_migrations,
)

from adret_service.database import jobs, open_database
from adret_service.engine.advisory import AdvisoryLock, AdvisoryPresence
from adret_service.engine.ledger import SqlLedger
from adret_service.engine.liveness import FilePresence, Lease, Presence, sweep_scratch
from adret_service.engine.port import EngineHealth, JobRecord, JobStatus, Quota, RequestKey
from adret_service.settings import WORKFLOW_VERSION, Settings
from adret_service.tile_folders import TileFolders

__all__ = ["DurableEngine", "Reaper", "serve_queue"]

log = logging.getLogger("adret.service")

APPLICATION = "adret"
QUEUE = "adret-jobs"
WORKFLOW = "adret_job"


class DurableEngine(SqlLedger):
    """Jobs on DBOS; see :class:`adret_service.engine.port.JobEngine` for the calls.

    Parameters
    ----------
    settings : Settings
        Where the database and the locks are.
    database : sqlalchemy.Engine, optional
        An open database to share; a new one is opened (and owned) without it.
    """

    def __init__(self, settings: Settings, database: sa.Engine | None = None) -> None:
        self.settings = settings
        self._owns_database = database is None
        super().__init__(open_database(settings) if database is None else database)
        # One file has one writer at a time, and a second one asks for its turn by sleeping: orders
        # of one process that wait for each other here are accepted three times as fast.
        embedded = self.database.dialect.name == "sqlite"
        self._turns: contextlib.AbstractContextManager[Any] = (
            threading.Lock() if embedded else contextlib.nullcontext()
        )
        self.presence: Presence = (
            FilePresence(settings.locks_dir)
            if embedded
            else AdvisoryPresence(self.database, settings.liveness_grace)
        )
        logging.getLogger("dbos").setLevel(logging.WARNING)
        run_dbos_database_migrations(settings.database)
        self._client = DBOSClient(
            system_database_engine=self.database,
            serializer=DBOSPortableJSONSerializer(),
            application_name=APPLICATION,
        )
        self._client.register_queue(
            QUEUE,
            worker_concurrency=settings.job_slots,
            polling_interval_sec=settings.queue_poll,
        )

    def submit(
        self,
        job: JobRecord,
        key: RequestKey | None = None,
        *,
        cells: int = 0,
        quota: Quota | None = None,
    ) -> JobRecord:
        """Accept a job: its row, its key and its place in the queue are one commit."""
        now = time.time()
        job = JobRecord(
            id=job.id,
            tenant=job.tenant,
            process=job.process,
            dataset=job.dataset,
            inputs=job.inputs,
            created=now,
            updated=now,
            request=job.request,
        )
        try:
            with self._turns, self.database.begin() as connection:
                earlier = None if key is None else self.ordered(connection, job.tenant, key)
                if earlier is not None:
                    return earlier
                self.insert(connection, job)
                if key is not None:
                    self.keep(connection, job, key)
                self._client.enqueue_in_transaction(connection, queue_options(job.id), job.id)
                self.count_in(connection, job.tenant, cells, quota)
        except sa.exc.IntegrityError:
            if key is None:
                raise
            with self.database.begin() as connection:  # an equal order overtook this one
                earlier = self.ordered(connection, job.tenant, key)
            if earlier is None:
                raise
            return earlier
        return job

    def retry(self, job_id: str, tenant: str) -> JobRecord | None:
        """Accept a failed or dismissed job again, with what it was ordered with."""
        job = self.get(job_id, tenant)
        if job is None or job.status not in (JobStatus.FAILED, JobStatus.DISMISSED):
            return None
        self._client.delete_workflow(job_id)
        with self.database.begin() as connection:
            if not self.reopen(connection, job_id, tenant):
                return None
            self._client.enqueue_in_transaction(connection, queue_options(job_id), job_id)
        return self.get(job_id, tenant)

    def cancel(self, job_id: str, tenant: str) -> JobRecord | None:
        """Dismiss a job: its worker sees the row and stops; a waiting one leaves the queue."""
        before = self.get(job_id, tenant)
        if before is None:
            return None
        if self.dismiss(job_id, tenant) and before.status is JobStatus.ACCEPTED:
            self._client.cancel_workflow(job_id)
        return self.get(job_id, tenant)

    def remove(self, job_id: str, tenant: str) -> bool:
        """Forget a finished job."""
        if not self.delete(job_id, tenant):
            return False
        self._client.delete_workflow(job_id)
        return True

    def waiting(self) -> int:
        """Return how many jobs wait in the queue."""
        return self.count(JobStatus.ACCEPTED)

    def health(self) -> EngineHealth:
        """Count jobs and live workers, and prove that the database takes a write."""
        with self.database.begin() as connection:
            connection.execute(sa.text("UPDATE adret_meta SET schema_version = schema_version"))
        return EngineHealth(
            waiting=self.waiting(),
            running=self.count(JobStatus.RUNNING),
            workers=self.presence.living("worker"),
        )

    def close(self) -> None:
        """Close the connections."""
        self._client.destroy()
        if self._owns_database:
            self.database.dispose()

    def announce(self, lease: Lease) -> AdvisoryLock | None:
        """Tell processes on other machines that the holder of `lease` lives; None if none can."""
        if isinstance(self.presence, FilePresence):
            return None
        return AdvisoryLock(self.settings.database, lease.name, self.settings.liveness_interval)

    def pending(self) -> dict[str, list[str]]:
        """Return the ids of workflows that a process has claimed, by that process's name."""
        claimed: dict[str, list[str]] = {}
        for flow in self._client.list_workflows(
            status="PENDING", name=WORKFLOW, load_input=False, load_output=False
        ):
            claimed.setdefault(flow.executor_id or "", []).append(flow.workflow_id)
        return claimed

    def requeue(self, job_id: str) -> None:
        """Put a claimed job back into the queue, ahead of newer ones."""
        self._client.resume_workflow(job_id, queue_name=QUEUE)

    def drop(self, job_id: str) -> None:
        """Take a job that is not to be run out of the queue."""
        self._client.cancel_workflow(job_id)

    def stranded(self) -> list[str]:
        """Return jobs marked running whose workflow has ended without finishing them."""
        query = sa.select(jobs.c.id).where(jobs.c.status == str(JobStatus.RUNNING))
        with self.database.connect() as connection:
            running = list(connection.execute(query).scalars())
        if not running:
            return []
        ended = self._client.list_workflows(
            workflow_ids=running,
            status=["SUCCESS", "ERROR", "CANCELLED", "MAX_RECOVERY_ATTEMPTS_EXCEEDED"],
            load_input=False,
            load_output=False,
        )
        return [flow.workflow_id for flow in ended if self.wanted(flow.workflow_id)]


class Reaper:
    """Gives the jobs of dead workers to live ones; one reaper is at work at a time.

    Parameters
    ----------
    engine : DurableEngine
        The engine to tend.
    settings : Settings
        Intervals, limits and folders.
    """

    def __init__(self, engine: DurableEngine, settings: Settings) -> None:
        self.engine = engine
        self.settings = settings
        self._tile_folders = TileFolders(settings)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._loop, name="reaper", daemon=True)

    def start(self) -> None:
        """Look once now, then every `liveness_interval` in the background."""
        self.look()
        self._thread.start()

    def stop(self) -> None:
        """Stop looking."""
        self._stop.set()

    def look(self) -> int:
        """Revive what is dead; returns how many jobs went back to the queue."""
        revived = 0
        sweep_scratch(self.settings.locks_dir, self.settings.scratch_dir)
        self._tile_folders.sweep(self.engine.look)
        with self.engine.presence.only_one("reaper") as mine:
            if not mine:
                return 0
            for owner, job_ids in self.engine.pending().items():
                if self.engine.presence.is_dead(owner):
                    revived += sum(self._revive(job_id) for job_id in job_ids)
            for job_id in self.engine.stranded():
                self._give_up(job_id, "the worker failed while it ran the job")
        return revived

    def _revive(self, job_id: str) -> bool:
        count = self.engine.revived(job_id)
        if count is None:
            self.engine.drop(job_id)
            return False
        if count > self.settings.job_max_revivals:
            limit = self.settings.job_max_revivals
            self._give_up(job_id, f"the job lost its worker too often (limit: {limit} times)")
            self.engine.drop(job_id)
            return False
        log.warning("job %s lost its worker (%d times); back into the queue", job_id, count)
        self.engine.requeue(job_id)
        return True

    def _give_up(self, job_id: str, detail: str) -> None:
        self.engine.fail(job_id, {"type": "about:blank", "status": 500, "detail": detail})

    def _loop(self) -> None:
        while not self._stop.wait(self.settings.liveness_interval):
            try:
                self.look()
            except Exception:
                log.exception("the reaper failed and will try again")


def queue_options(job_id: str) -> EnqueueOptions:
    """Where and how a job waits."""
    return {
        "workflow_name": WORKFLOW,
        "queue_name": QUEUE,
        "workflow_id": job_id,
        "app_version": WORKFLOW_VERSION,
        "serialization_type": WorkflowSerializationFormat.PORTABLE,
    }


def serve_queue(settings: Settings, lease: Lease, execute: Callable[[str], None]) -> None:
    """Start taking jobs from the queue in background threads, as the holder of `lease`.

    Parameters
    ----------
    settings : Settings
        Database, queue and slots.
    lease : Lease
        Whose name owns the claimed jobs.
    execute : callable
        Runs one job by its id and returns when its record says how it ended; it may be called
        again for a job it has run before.
    """
    config: DBOSConfig = {
        "name": APPLICATION,
        "system_database_url": settings.database,
        "application_version": WORKFLOW_VERSION,
        "executor_id": lease.name,
        "serializer": DBOSPortableJSONSerializer(),
        "log_level": "WARNING",
        "run_migrations": False,
        "scheduler_polling_interval_sec": 3600.0,
    }
    DBOS(config=config)

    @DBOS.workflow(name=WORKFLOW)
    def adret_job(job_id: str) -> str:
        execute(job_id)
        return job_id

    DBOS.listen_queues([QUEUE])
    DBOS.launch()
