"""What the service asks of a job engine, and the records they exchange."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Protocol

__all__ = [
    "EVERY_JOB",
    "FINISHED",
    "EngineHealth",
    "JobEngine",
    "JobEvent",
    "JobFilter",
    "JobLedger",
    "JobRecord",
    "JobStatus",
    "KeyReused",
    "OverQuota",
    "Quota",
    "RequestKey",
]


class JobStatus(StrEnum):
    """States of a job, by the names of OGC API - Processes."""

    ACCEPTED = "accepted"  # waits in the queue
    RUNNING = "running"  # a worker has it, or had it and died: it will run again
    SUCCESSFUL = "successful"  # its manifest is written
    FAILED = "failed"  # its error is kept
    DISMISSED = "dismissed"  # cancelled by its owner


FINISHED = frozenset({JobStatus.SUCCESSFUL, JobStatus.FAILED, JobStatus.DISMISSED})


@dataclass(frozen=True, slots=True, kw_only=True)
class JobRecord:
    """One job as the database knows it; times are Unix seconds, progress is percent."""

    id: str
    tenant: str
    process: str
    dataset: str
    inputs: Mapping[str, Any]
    status: JobStatus = JobStatus.ACCEPTED
    progress: int = 0
    message: str = "waiting for a worker"
    error: Mapping[str, Any] | None = None
    created: float = 0.0
    started: float | None = None
    updated: float = 0.0
    finished: float | None = None
    revivals: int = 0
    request: Mapping[str, Any] = field(default_factory=dict)  # how it was ordered; see orders.py

    @property
    def is_finished(self) -> bool:
        """Whether the job has reached its last state."""
        return self.status in FINISHED


@dataclass(frozen=True, slots=True, kw_only=True)
class JobFilter:
    """Which jobs a list is to show; what is empty or None shows all.

    `created` are Unix seconds from and to; `seconds` are the least and the largest time that a job
    has run, and only jobs that have begun have one.
    """

    statuses: frozenset[JobStatus] = frozenset()
    processes: frozenset[str] = frozenset()
    created: tuple[float | None, float | None] = (None, None)
    seconds: tuple[float | None, float | None] = (None, None)

    def shows(self, job: JobRecord, now: float) -> bool:
        """Whether the list shows this job."""
        if self.statuses and job.status not in self.statuses:
            return False
        if self.processes and job.process not in self.processes:
            return False
        if not _within(job.created, self.created):
            return False
        if self.seconds == (None, None):
            return True
        if job.started is None:
            return False
        return _within((job.finished or now) - job.started, self.seconds)


def _within(value: float, limits: tuple[float | None, float | None]) -> bool:
    least, largest = limits
    return (least is None or value >= least) and (largest is None or value <= largest)


EVERY_JOB = JobFilter()


@dataclass(frozen=True, slots=True, kw_only=True)
class JobEvent:
    """Something that happened to a job; `seq` grows, `kind` is status, progress or log."""

    seq: int
    at: float
    kind: str
    body: Mapping[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class RequestKey:
    """A client's name for one order, and the digest of what it ordered."""

    key: str
    digest: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Quota:
    """What a tenant may have in work, and may order in a day (UTC)."""

    jobs: int
    cells_per_day: int


class OverQuota(Exception):
    """An order that its tenant's quota has no room for."""

    def __init__(self, field: str, limit: str, value: int, *, until_midnight: bool) -> None:
        super().__init__(f"{field}: must be {limit}, got {value}")
        self.field = field
        self.limit = limit
        self.value = value
        self.until_midnight = until_midnight


class KeyReused(Exception):
    """A request key was used before, for another order."""


@dataclass(frozen=True, slots=True, kw_only=True)
class EngineHealth:
    """What readiness needs to know."""

    waiting: int
    running: int
    workers: int
    details: Mapping[str, str] = field(default_factory=dict)


class JobEngine(Protocol):
    """The API's side: accept, look up, cancel, remove. Every call is scoped to a tenant."""

    def submit(
        self,
        job: JobRecord,
        key: RequestKey | None = None,
        *,
        cells: int = 0,
        quota: Quota | None = None,
    ) -> JobRecord:
        """Accept a job of so many cells durably: when this returns, the job will be run.

        An order with a key that was used for an equal order returns that order's job. Raises
        LookupError if its dataset is gone, KeyReused if the key was used for another order,
        OverQuota if the tenant has no room left.
        """

    def get(self, job_id: str, tenant: str) -> JobRecord | None:
        """Return the job, or None if this tenant has no such job."""

    def look(self, job_ids: Sequence[str]) -> Mapping[str, JobRecord]:
        """Return those of these jobs that there are, whoever's they are, in one read."""

    def list(
        self,
        tenant: str,
        shown: JobFilter = EVERY_JOB,
        *,
        limit: int = 100,
        before: str | None = None,
    ) -> list[JobRecord]:
        """Return the tenant's jobs, newest first, those with an id below `before`."""

    def cancel(self, job_id: str, tenant: str) -> JobRecord | None:
        """Dismiss an unfinished job at once; a finished one is returned as it is."""

    def retry(self, job_id: str, tenant: str) -> JobRecord | None:
        """Accept a failed or dismissed job again; None if it is neither."""

    def events(self, job_id: str, after: int = 0) -> tuple[JobEvent, ...]:
        """Return what happened to a job since the event with that number, oldest first."""

    def remove(self, job_id: str, tenant: str) -> bool:
        """Forget a finished job; False if it is unknown or not finished."""

    def waiting(self) -> int:
        """Return how many jobs wait in the queue."""

    def health(self) -> EngineHealth:
        """Return queue depth and live workers; raises if the database cannot be written."""

    def close(self) -> None:
        """Let go of connections."""


class JobLedger(Protocol):
    """The worker's side: the only changes that a running job can make to its record."""

    def begin(self, job_id: str) -> JobRecord | None:
        """Mark the job running; None if it is gone or finished already."""

    def wanted(self, job_id: str) -> bool:
        """Whether the job is still to be run (False once dismissed or removed)."""

    def status(self, job_id: str) -> JobStatus | None:
        """Return the state that the job is in; None once it is removed."""

    def look(self, job_ids: Sequence[str]) -> Mapping[str, JobRecord]:
        """Return those of these jobs that there are, in one read."""

    def progress(self, job_id: str, percent: int, message: str) -> None:
        """Note progress of a running job."""

    def note(self, job_id: str, level: str, message: str) -> None:
        """Write a line into the log of an unfinished job."""

    def succeed(self, job_id: str) -> bool:
        """Mark success; False if the job was dismissed meanwhile."""

    def fail(self, job_id: str, error: Mapping[str, Any]) -> bool:
        """Mark failure; False if the job was dismissed meanwhile."""
