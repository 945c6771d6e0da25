"""The in-memory twin of the durable engine, for tests: same port, nothing survives."""

import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from adret_service.engine.port import (
    EVERY_JOB,
    EngineHealth,
    JobEvent,
    JobFilter,
    JobRecord,
    JobStatus,
    KeyReused,
    OverQuota,
    Quota,
    RequestKey,
)

__all__ = ["MemoryEngine"]


class MemoryEngine:
    """Keeps jobs in a dict; `workers` is what it claims about live workers."""

    def __init__(self, *, workers: int = 1) -> None:
        self._jobs: dict[str, JobRecord] = {}
        self._keys: dict[tuple[str, str], tuple[str, str]] = {}
        self._events: list[tuple[str, JobEvent]] = []
        self._cells: dict[str, int] = {}
        self._lock = threading.RLock()
        self.workers = workers

    def submit(
        self,
        job: JobRecord,
        key: RequestKey | None = None,
        *,
        cells: int = 0,
        quota: Quota | None = None,
    ) -> JobRecord:
        """Accept a job."""
        now = time.time()
        with self._lock:
            if key is not None:
                digest, known = self._keys.get((job.tenant, key.key), (key.digest, job.id))
                if digest != key.digest:
                    raise KeyReused(key.key)
                if known in self._jobs:
                    return self._jobs[known]
            if quota is not None:
                self._check(job.tenant, cells, quota)
            self._cells[job.tenant] = self._cells.get(job.tenant, 0) + cells
            if key is not None:
                self._keys[job.tenant, key.key] = key.digest, job.id
            self._jobs[job.id] = replace(job, created=now, updated=now)
            self._tell(job.id, "status", status=str(job.status), message=job.message)
            return self._jobs[job.id]

    def _check(self, tenant: str, cells: int, quota: Quota) -> None:
        used = self._cells.get(tenant, 0) + cells
        if used > quota.cells_per_day:
            limit = f"at most {quota.cells_per_day} in a day"
            raise OverQuota("cells", limit, used, until_midnight=True)
        waiting = sum(not j.is_finished and j.tenant == tenant for j in self._jobs.values())
        if waiting >= quota.jobs:
            limit = f"below {quota.jobs} that are not finished"
            raise OverQuota("jobs", limit, waiting, until_midnight=False)

    def retry(self, job_id: str, tenant: str) -> JobRecord | None:
        """Accept a failed or dismissed job again."""
        with self._lock:
            job = self.get(job_id, tenant)
            if job is None or job.status not in (JobStatus.FAILED, JobStatus.DISMISSED):
                return None
            told = {"message": "waiting for a worker, again", "progress": 0}
            self._jobs[job_id] = replace(
                job,
                status=JobStatus.ACCEPTED,
                error=None,
                started=None,
                finished=None,
                revivals=0,
                updated=time.time(),
                **told,  # type: ignore[arg-type]
            )
            self._tell(job_id, "status", status=str(JobStatus.ACCEPTED), **told)
            return self._jobs[job_id]

    def events(self, job_id: str, after: int = 0) -> tuple[JobEvent, ...]:
        """Return what happened to a job."""
        return tuple(event for job, event in self._events if job == job_id and event.seq > after)

    def note(self, job_id: str, level: str, message: str) -> None:
        """Write a line into the job's log."""
        if self.wanted(job_id):
            self._tell(job_id, "log", level=level, message=message)

    def get(self, job_id: str, tenant: str) -> JobRecord | None:
        """Return the tenant's job or None."""
        job = self._jobs.get(job_id)
        return job if job is not None and job.tenant == tenant else None

    def look(self, job_ids: Sequence[str]) -> Mapping[str, JobRecord]:
        """Return those of these jobs that there are."""
        return {each: self._jobs[each] for each in job_ids if each in self._jobs}

    def list(
        self,
        tenant: str,
        shown: JobFilter = EVERY_JOB,
        *,
        limit: int = 100,
        before: str | None = None,
    ) -> list[JobRecord]:
        """Return the tenant's jobs, newest first."""
        now = time.time()
        found = [
            job
            for job in sorted(self._jobs.values(), key=lambda job: job.id, reverse=True)
            if job.tenant == tenant
            and shown.shows(job, now)
            and (before is None or job.id < before)
        ]
        return found[:limit]

    def cancel(self, job_id: str, tenant: str) -> JobRecord | None:
        """Dismiss an unfinished job."""
        if self.get(job_id, tenant) is None:
            return None
        self._change(job_id, status=JobStatus.DISMISSED, message="dismissed", finished=time.time())
        return self.get(job_id, tenant)

    def remove(self, job_id: str, tenant: str) -> bool:
        """Forget a finished job."""
        job = self.get(job_id, tenant)
        if job is None or not job.is_finished:
            return False
        with self._lock:
            self._events = [entry for entry in self._events if entry[0] != job_id]
            self._keys = {k: v for k, v in self._keys.items() if v[1] != job_id}
            return self._jobs.pop(job_id, None) is not None

    def waiting(self) -> int:
        """Count the jobs that wait."""
        return self.health().waiting

    def health(self) -> EngineHealth:
        """Count the jobs."""
        states = [job.status for job in self._jobs.values()]
        return EngineHealth(
            waiting=states.count(JobStatus.ACCEPTED),
            running=states.count(JobStatus.RUNNING),
            workers=self.workers,
        )

    def close(self) -> None:
        """Nothing is held."""

    def begin(self, job_id: str) -> JobRecord | None:
        """Mark the job running."""
        started = self._change(
            job_id, status=JobStatus.RUNNING, message="running", started=time.time()
        )
        return self._jobs[job_id] if started else None

    def wanted(self, job_id: str) -> bool:
        """Whether the job is still to be run."""
        job = self._jobs.get(job_id)
        return job is not None and not job.is_finished

    def status(self, job_id: str) -> JobStatus | None:
        """Return the job's state; None once it is removed."""
        job = self._jobs.get(job_id)
        return None if job is None else job.status

    def progress(self, job_id: str, percent: int, message: str) -> None:
        """Note progress."""
        self._change(job_id, progress=percent, message=message)

    def succeed(self, job_id: str) -> bool:
        """Mark success."""
        return self._change(
            job_id,
            status=JobStatus.SUCCESSFUL,
            progress=100,
            message="done",
            finished=time.time(),
        )

    def fail(self, job_id: str, error: Mapping[str, Any]) -> bool:
        """Mark failure."""
        return self._change(
            job_id,
            status=JobStatus.FAILED,
            message=str(error["detail"]),
            error=dict(error),
            finished=time.time(),
        )

    def _change(self, job_id: str, **changes: Any) -> bool:
        with self._lock:
            job = self._jobs.get(job_id)
            if job is None or job.is_finished:
                return False
            self._jobs[job_id] = replace(job, updated=time.time(), **changes)
            told = {k: v for k, v in changes.items() if k in ("status", "progress", "message")}
            kind = "status" if "status" in told else "progress"
            self._tell(
                job_id, kind, **{k: v if k == "progress" else str(v) for k, v in told.items()}
            )
            return True

    def _tell(self, job_id: str, kind: str, **body: Any) -> None:
        with self._lock:
            seq = self._events[-1][1].seq + 1 if self._events else 1
            self._events.append((job_id, JobEvent(seq=seq, at=time.time(), kind=kind, body=body)))
