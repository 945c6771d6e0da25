"""Callbacks: what a job's subscriber is told, signed, and again until it is heard.

A change of a job and the order to tell its subscriber are one commit (see `SqlLedger`), so no
crash loses a callback. A herald claims an order by moving its due time, sends it, and deletes it;
an order whose herald died is due again after a while. So a callback comes at least once, and
``Adret-Delivery`` tells a receiver whether it has seen it.
"""

import hashlib
import hmac
import json
import logging
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa

import adret
from adret_service.database import callbacks, events, jobs
from adret_service.engine.ledger import to_record
from adret_service.engine.port import JobRecord
from adret_service.outbound import Outbound
from adret_service.results import document
from adret_service.settings import Settings
from adret_service.status import prefix_of, status_info
from adret_service.storage import Storage

__all__ = ["Herald", "signature"]

log = logging.getLogger("adret.service")

LOOK = 0.5  # seconds between two looks for what is due
CLAIM = 60.0  # seconds after which what a herald has claimed is another's
AT_ONCE = 8  # callbacks on their way at the same time


@dataclass(frozen=True, slots=True)
class Due:
    """An order to tell a job's subscriber something."""

    job: str
    kind: str
    attempts: int
    claim: float


class Herald:
    """Sends the callbacks of all jobs; any number of heralds share the work.

    Parameters
    ----------
    settings : Settings
        Hosts, secret, attempts.
    database : sqlalchemy.Engine
        Where the orders are.
    storage : Storage
        Where results are, for their document.
    """

    def __init__(self, settings: Settings, database: sa.Engine, storage: Storage) -> None:
        self.settings = settings
        self.database = database
        self.storage = storage
        self.outbound = Outbound(
            settings.webhook_hosts, allow_private=settings.webhook_allow_private
        )
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._loop, name="herald", daemon=True)

    def start(self) -> None:
        """Send in the background."""
        self._thread.start()

    def stop(self) -> None:
        """Stop; what was not sent stays due."""
        self._stop.set()
        self._thread.join(2.0)

    def look(self) -> int:
        """Send what is due now; returns how many were sent."""
        with ThreadPoolExecutor(AT_ONCE, "callback") as senders:
            return sum(senders.map(self._tell, self._claimed()))

    def _claimed(self) -> list[Due]:
        now = time.time()
        query = sa.select(callbacks).where(callbacks.c.due <= now).order_by(callbacks.c.due)
        with self.database.connect() as connection:
            rows = connection.execute(query.limit(4 * AT_ONCE)).all()
        mine = []
        for row in rows:
            claim = now + CLAIM
            statement = (
                callbacks.update()
                .where(
                    callbacks.c.job == row.job,
                    callbacks.c.kind == row.kind,
                    callbacks.c.due == row.due,
                )
                .values(due=claim, attempts=row.attempts + 1)
            )
            with self.database.begin() as connection:
                if connection.execute(statement).rowcount == 1:
                    mine.append(Due(row.job, row.kind, row.attempts + 1, claim))
        return mine

    def _tell(self, due: Due) -> bool:
        job = self._job(due.job)
        if job is None or (due.kind == "inProgress" and job.is_finished):
            self._forget(due)
            return False
        address = str(job.request.get("subscriber", {}).get(f"{due.kind}Uri", ""))
        try:
            body = json.dumps(self._message(job, due.kind)).encode()
            status = self.outbound.post(address, body, self._headers(due, body).items())
            failure = None if 200 <= status < 300 else f"status {status}"
        except OSError as error:
            failure = str(error)
        if failure is None:
            self._forget(due)
            return True
        if due.attempts >= self.settings.webhook_attempts:
            self._forget(due)
            self._note(job.id, f"callback {due.kind} given up after {due.attempts}: {failure}")
        else:
            self._again(due)
        return False

    def _message(self, job: JobRecord, kind: str) -> dict[str, Any]:
        base = str(job.request.get("base", ""))
        if kind != "success":
            return status_info(job, base)
        artefacts = self.storage.manifest(prefix_of(job)) or {}
        return document(job, artefacts, self.storage, base, self.settings.inline_max_bytes)

    def _headers(self, due: Due, body: bytes) -> dict[str, str]:
        return {
            "Content-Type": "application/json",
            "User-Agent": f"adret/{adret.__version__}",
            "Adret-Event": due.kind,
            "Adret-Delivery": f"{due.job}-{due.kind}",
            "Adret-Signature": signature(self.settings.webhook_secret, int(time.time()), body),
        }

    def _job(self, job_id: str) -> JobRecord | None:
        with self.database.connect() as connection:
            row = connection.execute(sa.select(jobs).where(jobs.c.id == job_id)).first()
        return None if row is None else to_record(row)

    def _forget(self, due: Due) -> None:
        with self.database.begin() as connection:
            connection.execute(callbacks.delete().where(*_of(due)))

    def _again(self, due: Due) -> None:
        pause = self.settings.webhook_pause * 4.0 ** (due.attempts - 1)
        with self.database.begin() as connection:
            statement = callbacks.update().where(*_of(due)).values(due=time.time() + pause)
            connection.execute(statement)

    def _note(self, job_id: str, message: str) -> None:
        log.warning("job %s: %s", job_id, message)
        body = {"level": "warning", "message": message}
        row = {"job": job_id, "at": time.time(), "kind": "log", "body": body}
        with self.database.begin() as connection:
            connection.execute(events.insert().values(**row))

    def _loop(self) -> None:
        while not self._stop.wait(LOOK):
            try:
                self.look()
            except Exception:
                log.exception("the herald failed and will try again")


def _of(due: Due) -> tuple[sa.ColumnElement[bool], ...]:
    """The order, if it is still this herald's."""
    return (
        callbacks.c.job == due.job,
        callbacks.c.kind == due.kind,
        callbacks.c.due == due.claim,
    )


def signature(secret: str, at: int, body: bytes) -> str:
    """Return ``t=<Unix seconds>,v1=<HMAC-SHA-256 of "t.body" in hexadecimal>``.

    Examples
    --------
    >>> signature("secret", 0, b"{}")[:20]
    't=0,v1=2b19a87cf8a19'
    """
    digest = hmac.new(secret.encode(), f"{at}.".encode() + body, hashlib.sha256).hexdigest()
    return f"t={at},v1={digest}"
