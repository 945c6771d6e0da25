"""Who is alive among processes that share a PostgreSQL server: its session advisory locks.

The server drops a session's locks when the session ends, however it ends. A session also ends when
the server itself restarts, while its owner lives on; so every owner takes its lock again as soon as
it can, and only a lock that stays free for `Settings.liveness_grace` counts as a death.
"""

import hashlib
import logging
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import psycopg
import sqlalchemy as sa

__all__ = ["AdvisoryLock", "AdvisoryPresence"]

log = logging.getLogger("adret.service")

# First halves of the keys; the second is a digest of the name.
CLASSES = {"worker": 727_153_801, "api": 727_153_802, "duty": 727_153_803}

# A host that vanishes without a word is noticed by both ends after about ten seconds.
IDLE, INTERVAL, COUNT = 5, 2, 3  # seconds, seconds, probes
SERVER_SIDE = (
    f"-c tcp_keepalives_idle={IDLE} -c tcp_keepalives_interval={INTERVAL} "
    f"-c tcp_keepalives_count={COUNT}"
)


def key_of(name: str) -> tuple[int, int]:
    """Return the two halves of the lock that belongs to a process's name."""
    digest = hashlib.sha256(name.encode()).digest()
    return CLASSES[name.split("-", 1)[0]], int.from_bytes(digest[:4], "big", signed=True)


class AdvisoryLock:
    """A lock that says that this process lives, on a connection of its own.

    Parameters
    ----------
    url : str
        ``postgresql://…``
    name : str
        Name of the process; begins with its role.
    interval : float
        Seconds between two looks at the connection.

    Raises
    ------
    psycopg.OperationalError
        If the server cannot be reached now; later losses are mended in the background.
    """

    def __init__(self, url: str, name: str, interval: float) -> None:
        self._url = sa.make_url(url).set(drivername="postgresql")
        self._key = key_of(name)
        self._interval = interval
        self._stop = threading.Event()
        self._connection = self._take()
        self._keeper = threading.Thread(target=self._keep, name="presence", daemon=True)
        self._keeper.start()

    def release(self) -> None:
        """Let the lock go."""
        self._stop.set()
        self._keeper.join(self._interval + 1.0)
        self._connection.close()

    def _take(self) -> "psycopg.Connection[tuple[object, ...]]":
        connection = psycopg.connect(
            self._url.render_as_string(hide_password=False),
            autocommit=True,
            connect_timeout=IDLE,
            keepalives_idle=IDLE,
            keepalives_interval=INTERVAL,
            keepalives_count=COUNT,
            options=SERVER_SIDE,
        )
        while not self._stop.is_set():
            found = connection.execute("SELECT pg_try_advisory_lock(%s, %s)", self._key).fetchone()
            if found == (True,):
                break
            self._stop.wait(0.2)  # the server has not noticed the end of the lost session yet
        return connection

    def _keep(self) -> None:
        while not self._stop.wait(self._interval):
            try:
                if self._connection.closed:
                    self._connection = self._take()
                self._connection.execute("SELECT 1")
            except psycopg.OperationalError as error:
                log.warning("the database is away: %s", str(error).splitlines()[0])
                self._connection.close()


class AdvisoryPresence:
    """The living and the dead, as the locks on a PostgreSQL server tell.

    Parameters
    ----------
    database : sqlalchemy.Engine
        An open database on that server.
    grace : float
        Seconds that a lock must have been seen free before its owner counts as dead.
    """

    def __init__(self, database: sa.Engine, grace: float) -> None:
        self._database = database
        self._grace = grace
        self._free_since: dict[str, float] = {}

    def is_dead(self, name: str) -> bool:
        """Whether the process of that name has died, on whichever machine it ran."""
        with self._database.begin() as connection:
            free = _try_lock(connection, *key_of(name))
        if not free:
            self._free_since.pop(name, None)
            return False
        now = time.monotonic()
        return now - self._free_since.setdefault(name, now) >= self._grace

    def living(self, role: str) -> int:
        """Return how many processes of this role are alive."""
        query = sa.text(
            "SELECT count(*) FROM pg_locks WHERE locktype = 'advisory' AND granted AND "
            "classid = :role AND database = (SELECT oid FROM pg_database "
            "WHERE datname = current_database())"
        )
        with self._database.connect() as connection:
            return int(connection.execute(query, {"role": CLASSES[role]}).scalar_one())

    @contextmanager
    def only_one(self, duty: str) -> Iterator[bool]:
        """Yield whether this process got the duty; at most one process has it at a time."""
        with self._database.begin() as connection:
            yield _try_lock(connection, *key_of(f"duty-{duty}"))


def _try_lock(connection: sa.Connection, first: int, second: int) -> bool:
    query = sa.text("SELECT pg_try_advisory_xact_lock(:first, :second)")
    return bool(connection.execute(query, {"first": first, "second": second}).scalar_one())
