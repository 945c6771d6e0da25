"""The jobs table: every change of a job's state is one guarded UPDATE."""

import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import sqlalchemy as sa
from sqlalchemy.dialects import postgresql, sqlite

from adret_service.database import callbacks, datasets, events, jobs, keys, tally, usage, work
from adret_service.engine.port import (
    EVERY_JOB,
    FINISHED,
    JobEvent,
    JobFilter,
    JobRecord,
    JobStatus,
    KeyReused,
    OverQuota,
    Quota,
    RequestKey,
)

__all__ = ["OPEN", "SqlLedger"]

PAGE = 1000  # events that are returned at once
DAY = 86_400.0

PROGRESS_PAUSE = 5.0  # seconds between two callbacks about progress
CALLBACKS = {
    "successful": "success",
    "failed": "failed",
    "dismissed": "failed",
}  # by status; every other change is "inProgress"

OPEN = jobs.c.status.notin_([str(status) for status in FINISHED])

# What an order is accepted with, built once: building takes longer than running it.
ADDING = jobs.insert()
TELLING = events.insert()
LOOKING = sa.select(jobs).where(jobs.c.id.in_(sa.bindparam("ids", expanding=True)))
READ_BY = (
    sa.select(datasets.c.id)
    .where(datasets.c.id == sa.bindparam("named"), datasets.c.tenant == sa.bindparam("whose"))
    .with_for_update(read=True)
)
COUNTING = {
    name: insert(usage).on_conflict_do_update(
        index_elements=["tenant", "day"],
        set_={
            "jobs": usage.c.jobs + insert(usage).excluded.jobs,
            "cells": usage.c.cells + insert(usage).excluded.cells,
        },
    )
    for name, insert in (("postgresql", postgresql.insert), ("sqlite", sqlite.insert))
}


def to_record(row: Any) -> JobRecord:
    """Turn a row into a record."""
    fields = dict(row._mapping)
    fields["status"] = JobStatus(fields["status"])
    fields["request"] = fields["request"] or {}
    return JobRecord(**fields)


def _conditions(shown: JobFilter) -> Iterator[sa.ColumnElement[bool]]:
    """What `JobFilter.shows` says, for the database."""
    if shown.statuses:
        yield jobs.c.status.in_([str(status) for status in shown.statuses])
    if shown.processes:
        yield jobs.c.process.in_(list(shown.processes))
    ran = sa.func.coalesce(jobs.c.finished, time.time()) - jobs.c.started
    for value, (least, largest) in ((jobs.c.created, shown.created), (ran, shown.seconds)):
        if least is not None:
            yield value >= least
        if largest is not None:
            yield value <= largest


class SqlLedger:
    """Job records in a SQL database.

    A finished job never changes again: each update names the states it may leave, so of a
    dismissal and a completion that race, the first one committed wins and the other is told.
    """

    def __init__(self, database: sa.Engine) -> None:
        self.database = database

    def get(self, job_id: str, tenant: str) -> JobRecord | None:
        """Return the tenant's job or None."""
        query = sa.select(jobs).where(jobs.c.id == job_id, jobs.c.tenant == tenant)
        with self.database.connect() as connection:
            row = connection.execute(query).first()
        return None if row is None else to_record(row)

    def look(self, job_ids: Sequence[str]) -> Mapping[str, JobRecord]:
        """Return those of these jobs that there are, whoever's they are, in one read."""
        with self.database.connect() as connection:
            rows = connection.execute(LOOKING, {"ids": list(job_ids)}).all()
        return {row.id: to_record(row) for row in rows}

    def list(
        self,
        tenant: str,
        shown: JobFilter = EVERY_JOB,
        *,
        limit: int = 100,
        before: str | None = None,
    ) -> list[JobRecord]:
        """Return the tenant's jobs, newest first."""
        query = sa.select(jobs).where(jobs.c.tenant == tenant, *_conditions(shown))
        if before is not None:
            query = query.where(jobs.c.id < before)
        with self.database.connect() as connection:
            rows = connection.execute(query.order_by(jobs.c.id.desc()).limit(limit)).all()
        return [to_record(row) for row in rows]

    def ordered(self, connection: sa.Connection, tenant: str, key: RequestKey) -> JobRecord | None:
        """Return the job of an earlier order with this key, if it still exists.

        Raises
        ------
        KeyReused
            If that order was another one.
        """
        query = sa.select(keys).where(keys.c.tenant == tenant, keys.c.key == key.key)
        known = connection.execute(query).first()
        if known is None:
            return None
        if known.digest != key.digest:
            raise KeyReused(key.key)
        row = connection.execute(sa.select(jobs).where(jobs.c.id == known.job)).first()
        if row is None:
            connection.execute(keys.delete().where(keys.c.job == known.job))
        return None if row is None else to_record(row)

    def keep(self, connection: sa.Connection, job: JobRecord, key: RequestKey) -> None:
        """Remember that this key stands for this job."""
        connection.execute(
            keys.insert().values(
                tenant=job.tenant, key=key.key, digest=key.digest, job=job.id, created=job.created
            )
        )

    def count_in(
        self, connection: sa.Connection, tenant: str, cells: int, quota: Quota | None
    ) -> None:
        """Add an order to its tenant's day, inside the caller's transaction.

        It comes last in the transaction, after the job's own row: of two orders of a tenant at once
        the second waits here for the first, and for nothing longer.

        Raises
        ------
        OverQuota
            If the quota has no room for it.
        """
        today = int(time.time() // DAY)
        row = {"tenant": tenant, "day": today, "jobs": 1, "cells": cells}
        connection.execute(COUNTING[connection.dialect.name], row)
        if quota is None:
            return
        query = sa.select(usage.c.cells).where(usage.c.tenant == tenant, usage.c.day == today)
        used = int(connection.execute(query).scalar_one())
        if used > quota.cells_per_day:
            limit = f"at most {quota.cells_per_day} in a day"
            raise OverQuota("cells", limit, used, until_midnight=True)
        unfinished = sa.select(sa.func.count()).where(jobs.c.tenant == tenant, OPEN)
        waiting = int(connection.execute(unfinished).scalar_one()) - 1  # but for this one
        if waiting >= quota.jobs:
            limit = f"below {quota.jobs} that are not finished"
            raise OverQuota("jobs", limit, waiting, until_midnight=False)

    def insert(self, connection: sa.Connection, job: JobRecord) -> None:
        """Add the row of a new job inside the caller's transaction.

        Raises
        ------
        LookupError
            If the tenant's dataset is gone.
        """
        fields = {column.name: getattr(job, column.name) for column in jobs.columns}
        fields |= {"status": str(job.status), "inputs": dict(job.inputs)}
        fields["request"] = dict(job.request) or None
        connection.execute(ADDING, fields)
        named = {"named": job.dataset, "whose": job.tenant}
        if job.dataset and connection.execute(READ_BY, named).first() is None:
            raise LookupError(job.dataset)
        self._tell(connection, job.id, "status", status=str(job.status), message=job.message)

    def reopen(self, connection: sa.Connection, job_id: str, tenant: str) -> bool:
        """Make a failed or dismissed job wait again; False if it is neither."""
        ended = (str(JobStatus.FAILED), str(JobStatus.DISMISSED))
        values = {
            "status": str(JobStatus.ACCEPTED),
            "message": "waiting for a worker, again",
            "progress": 0,
        }
        statement = (
            jobs.update()
            .where(jobs.c.id == job_id, jobs.c.tenant == tenant, jobs.c.status.in_(ended))
            .values(
                **values, error=None, started=None, finished=None, revivals=0, updated=time.time()
            )
        )
        if connection.execute(statement).rowcount != 1:
            return False
        self._tell(connection, job_id, "status", **values)
        return True

    def events(self, job_id: str, after: int = 0) -> tuple[JobEvent, ...]:
        """Return what happened to a job since the event with that number, oldest first."""
        query = (
            sa.select(events.c.seq, events.c.at, events.c.kind, events.c.body)
            .where(events.c.job == job_id, events.c.seq > after)
            .order_by(events.c.seq)
            .limit(PAGE)
        )
        with self.database.connect() as connection:
            return tuple(JobEvent(**row._mapping) for row in connection.execute(query))

    def note(self, job_id: str, level: str, message: str) -> None:
        """Write a line into the log of an unfinished job."""
        with self.database.begin() as connection:
            known = sa.select(jobs.c.id).where(jobs.c.id == job_id, OPEN)
            if connection.execute(known).first() is not None:
                self._tell(connection, job_id, "log", level=level, message=message)

    def dismiss(self, job_id: str, tenant: str) -> bool:
        """Mark an unfinished job dismissed; False if it was finished or unknown."""
        return self._change(
            job_id,
            jobs.c.tenant == tenant,
            status=str(JobStatus.DISMISSED),
            message="dismissed",
            finished=time.time(),
        )

    def delete(self, job_id: str, tenant: str) -> bool:
        """Delete the row of a finished job."""
        statement = jobs.delete().where(jobs.c.id == job_id, jobs.c.tenant == tenant, ~OPEN)
        with self.database.begin() as connection:
            if connection.execute(statement).rowcount != 1:
                return False
            connection.execute(events.delete().where(events.c.job == job_id))
            connection.execute(keys.delete().where(keys.c.job == job_id))
            connection.execute(callbacks.delete().where(callbacks.c.job == job_id))
        return True

    def count(self, status: JobStatus) -> int:
        """Return how many jobs of all tenants are in this state."""
        query = sa.select(sa.func.count()).where(jobs.c.status == str(status))
        with self.database.connect() as connection:
            return int(connection.execute(query).scalar_one())

    def begin(self, job_id: str) -> JobRecord | None:
        """Mark the job running; None if it is gone or finished."""
        now = time.time()
        if not self._change(
            job_id,
            status=str(JobStatus.RUNNING),
            message="running",
            started=sa.func.coalesce(jobs.c.started, now),
        ):
            return None
        with self.database.connect() as connection:
            row = connection.execute(sa.select(jobs).where(jobs.c.id == job_id)).first()
        return None if row is None else to_record(row)

    def wanted(self, job_id: str) -> bool:
        """Whether the job is still to be run."""
        query = sa.select(jobs.c.id).where(jobs.c.id == job_id, OPEN)
        with self.database.connect() as connection:
            return connection.execute(query).first() is not None

    def status(self, job_id: str) -> JobStatus | None:
        """Return the job's state; None once it is removed."""
        query = sa.select(jobs.c.status).where(jobs.c.id == job_id)
        with self.database.connect() as connection:
            found = connection.execute(query).scalar()
        return None if found is None else JobStatus(found)

    def progress(self, job_id: str, percent: int, message: str) -> None:
        """Note progress of a running job."""
        self._change(job_id, progress=percent, message=message)

    def revived(self, job_id: str) -> int | None:
        """Count one more death of the job's worker; None if the job is finished."""
        if not self._change(
            job_id, revivals=jobs.c.revivals + 1, message="its worker died; waiting for another"
        ):
            return None
        query = sa.select(jobs.c.revivals, jobs.c.process).where(jobs.c.id == job_id)
        with self.database.begin() as connection:
            row = connection.execute(query).first()
            if row is None:
                return None
            self._add_up(connection, work, {"process": row.process}, {"cells": 0, "revivals": 1})
        return int(row.revivals)

    def succeed(self, job_id: str) -> bool:
        """Mark success; False if the job was dismissed meanwhile."""
        return self._change(
            job_id,
            status=str(JobStatus.SUCCESSFUL),
            progress=100,
            message="done",
            finished=time.time(),
        )

    def fail(self, job_id: str, error: Mapping[str, Any]) -> bool:
        """Mark failure; False if the job was dismissed meanwhile."""
        return self._change(
            job_id,
            status=str(JobStatus.FAILED),
            message=str(error["detail"]),
            error=dict(error),
            finished=time.time(),
        )

    def _change(self, job_id: str, *conditions: Any, **values: Any) -> bool:
        statement = (
            jobs.update()
            .where(jobs.c.id == job_id, OPEN, *conditions)
            .values(updated=time.time(), **values)
        )
        with self.database.begin() as connection:
            if connection.execute(statement).rowcount != 1:
                return False
            told = {k: v for k, v in values.items() if k in ("status", "progress", "message")}
            kind = "status" if "status" in told else "progress" if "progress" in told else "log"
            self._tell(connection, job_id, kind, **told)
            if kind != "log":
                self._follow_up(connection, job_id, values.get("status"))
        return True

    def _follow_up(self, connection: sa.Connection, job_id: str, status: str | None) -> None:
        """Order the callback of a change, and count a job that has ended."""
        columns = (jobs.c.process, jobs.c.request, jobs.c.created, jobs.c.started, jobs.c.finished)
        job = connection.execute(sa.select(*columns).where(jobs.c.id == job_id)).one()
        upsert = postgresql.insert if connection.dialect.name == "postgresql" else sqlite.insert
        subscriber = (job.request or {}).get("subscriber") or {}
        kind = CALLBACKS.get(status or "", "inProgress")
        if f"{kind}Uri" in subscriber:
            due = time.time() + (PROGRESS_PAUSE if status is None else 0.0)
            row = {"job": job_id, "kind": kind, "due": due, "attempts": 0}
            connection.execute(upsert(callbacks).values(**row).on_conflict_do_nothing())
        if job.finished is None:
            return
        began = job.finished if job.started is None else job.started
        row = {
            "jobs": 1,
            "waited": max(began - job.created, 0.0),
            "ran": max(job.finished - began, 0.0),
        }
        self._add_up(connection, tally, {"process": job.process, "status": status}, row)
        cells = int((job.request or {}).get("cells", 0))
        if cells and status == str(JobStatus.SUCCESSFUL):
            self._add_up(
                connection, work, {"process": job.process}, {"cells": cells, "revivals": 0}
            )

    def _add_up(
        self, connection: sa.Connection, table: sa.Table, key: dict[str, Any], row: dict[str, Any]
    ) -> None:
        """Add to the counts of a key, which may be new."""
        upsert = postgresql.insert if connection.dialect.name == "postgresql" else sqlite.insert
        added = {name: table.c[name] + value for name, value in row.items()}
        connection.execute(
            upsert(table)
            .values(**key, **row)
            .on_conflict_do_update(index_elements=list(key), set_=added)
        )

    def _tell(self, connection: sa.Connection, job_id: str, kind: str, **body: Any) -> None:
        row = {"job": job_id, "at": time.time(), "kind": kind, "body": body}
        connection.execute(TELLING, row)
