"""The database: a few tables of ours beside the queue's own, in one file or one server."""

import logging
import time
from collections.abc import Callable
from typing import Any, TypeVar

import sqlalchemy as sa
from sqlalchemy import event
from sqlalchemy.exc import OperationalError

from adret_service.settings import Settings

__all__ = [
    "callbacks",
    "datasets",
    "events",
    "jobs",
    "keys",
    "open_database",
    "persist",
    "tally",
    "usage",
    "work",
]

log = logging.getLogger("adret.service")

T = TypeVar("T")

SCHEMA_VERSION = 2
CHANGES = {1: ("ALTER TABLE adret_jobs ADD COLUMN request JSON",)}  # from a version to the next

tables = sa.MetaData()

meta = sa.Table("adret_meta", tables, sa.Column("schema_version", sa.Integer, nullable=False))

jobs = sa.Table(
    "adret_jobs",
    tables,
    sa.Column("id", sa.String(26), primary_key=True),
    sa.Column("tenant", sa.String(64), nullable=False),
    sa.Column("process", sa.String(64), nullable=False),
    sa.Column("dataset", sa.String(26), nullable=False, index=True),
    sa.Column("inputs", sa.JSON, nullable=False),
    sa.Column("status", sa.String(16), nullable=False, index=True),
    sa.Column("progress", sa.Integer, nullable=False),
    sa.Column("message", sa.Text, nullable=False),
    sa.Column("error", sa.JSON(none_as_null=True), nullable=True),
    sa.Column("created", sa.Float, nullable=False),
    sa.Column("started", sa.Float, nullable=True),
    sa.Column("updated", sa.Float, nullable=False),
    sa.Column("finished", sa.Float, nullable=True),
    sa.Column("revivals", sa.Integer, nullable=False),
    sa.Column("request", sa.JSON(none_as_null=True), nullable=True),
)

callbacks = sa.Table(
    "adret_callbacks",
    tables,
    sa.Column("job", sa.String(26), primary_key=True),
    sa.Column("kind", sa.String(16), primary_key=True),
    sa.Column("due", sa.Float, nullable=False, index=True),
    sa.Column("attempts", sa.Integer, nullable=False),
)

tally = sa.Table(
    "adret_tally",
    tables,
    sa.Column("process", sa.String(64), primary_key=True),
    sa.Column("status", sa.String(16), primary_key=True),
    sa.Column("jobs", sa.BigInteger, nullable=False),
    sa.Column("waited", sa.Float, nullable=False),
    sa.Column("ran", sa.Float, nullable=False),
)

work = sa.Table(
    "adret_work",
    tables,
    sa.Column("process", sa.String(64), primary_key=True),
    sa.Column("cells", sa.BigInteger, nullable=False),
    sa.Column("revivals", sa.BigInteger, nullable=False),
)

datasets = sa.Table(
    "adret_datasets",
    tables,
    sa.Column("id", sa.String(26), primary_key=True),
    sa.Column("tenant", sa.String(64), nullable=False),
    sa.Column("sha256", sa.String(64), nullable=False),
    sa.Column("name", sa.Text, nullable=False),
    sa.Column("upload_bytes", sa.BigInteger, nullable=False),
    sa.Column("created", sa.Float, nullable=False),
    sa.Column("key", sa.Text, nullable=False),
    sa.Column("info", sa.JSON, nullable=False),
    sa.UniqueConstraint("tenant", "sha256"),
)

events = sa.Table(
    "adret_events",
    tables,
    sa.Column("seq", sa.Integer, primary_key=True, autoincrement=True),
    sa.Column("job", sa.String(26), nullable=False, index=True),
    sa.Column("at", sa.Float, nullable=False),
    sa.Column("kind", sa.String(16), nullable=False),
    sa.Column("body", sa.JSON, nullable=False),
    sqlite_autoincrement=True,
)

keys = sa.Table(
    "adret_keys",
    tables,
    sa.Column("tenant", sa.String(64), primary_key=True),
    sa.Column("key", sa.String(255), primary_key=True),
    sa.Column("digest", sa.String(64), nullable=False),
    sa.Column("job", sa.String(26), nullable=False),
    sa.Column("created", sa.Float, nullable=False),
)

usage = sa.Table(
    "adret_usage",
    tables,
    sa.Column("tenant", sa.String(64), primary_key=True),
    sa.Column("day", sa.Integer, primary_key=True),
    sa.Column("jobs", sa.BigInteger, nullable=False),
    sa.Column("cells", sa.BigInteger, nullable=False),
)


def open_database(settings: Settings) -> sa.Engine:
    """Open the database, creating our tables when they are missing.

    A SQLite file runs in WAL mode with every commit synced: readers never wait for the writer,
    and an accepted job survives a power cut.

    Raises
    ------
    RuntimeError
        If the tables were written by a newer or older, incompatible release.
    """
    url = sa.make_url(settings.database)
    if url.get_backend_name() == "sqlite":
        settings.data_dir.mkdir(parents=True, exist_ok=True)
        engine = sa.create_engine(url, pool_size=10, max_overflow=30, pool_timeout=30)
        event.listen(engine, "connect", _prepare_sqlite)
        persist(lambda: _use_wal(engine), patience=30.0)
    else:
        engine = sa.create_engine(
            url.set(drivername="postgresql+psycopg"),
            pool_size=40,  # all are kept: to open one takes longer than an order
            max_overflow=0,
            pool_use_lifo=True,  # and few are used where few are asked for
            pool_pre_ping=True,
            connect_args={"client_encoding": "utf8"},
        )
    _create_tables(engine)
    return engine


def _prepare_sqlite(connection: Any, _record: Any) -> None:
    connection.isolation_level = "IMMEDIATE"  # writers queue for the lock instead of failing late
    connection.execute("PRAGMA busy_timeout=30000")
    connection.execute("PRAGMA synchronous=FULL")


def _use_wal(engine: sa.Engine) -> None:
    with engine.connect() as connection:
        connection.exec_driver_sql("PRAGMA journal_mode=WAL")


def _create_tables(engine: sa.Engine) -> None:
    with engine.begin() as connection:
        if engine.dialect.name == "sqlite":
            connection.exec_driver_sql("BEGIN IMMEDIATE")  # two first starts at once
        else:
            connection.exec_driver_sql("SELECT pg_advisory_xact_lock(7271538)")
        tables.create_all(connection)
        found = connection.execute(sa.select(meta.c.schema_version)).scalar()
        if found is None:
            connection.execute(meta.insert().values(schema_version=SCHEMA_VERSION))
        while found in CHANGES:
            for change in CHANGES[found]:
                connection.exec_driver_sql(change)
            found += 1
            connection.execute(meta.update().values(schema_version=found))
        if found not in (None, SCHEMA_VERSION):
            raise RuntimeError(
                f"database schema: must be version {SCHEMA_VERSION}, got {found}; "
                "finish the jobs with the release that wrote it, then start with a new data_dir"
            )


def persist(write: Callable[[], T], *, patience: float = 3600.0) -> T:
    """Call `write` until it succeeds: a full disk or a lost connection only delays a job.

    Parameters
    ----------
    write : callable
        A transaction that may be repeated.
    patience : float
        Seconds after which the last error is raised.
    """
    deadline = time.monotonic() + patience
    pause = 0.1
    while True:
        try:
            return write()
        except OperationalError as error:
            if time.monotonic() > deadline:
                raise
            log.warning("database refused a write, trying again: %s", error.orig)
            time.sleep(pause)
            pause = min(2 * pause, 5.0)
