"""`adret tile-worker`: take tiles of batches from the durable queue."""

import os
from threading import Event
from typing import Annotated

import typer

from adret.errors import InputError

__all__ = ["add_tile_worker"]


def add_tile_worker(app: typer.Typer) -> None:
    """Add ``adret tile-worker``; what it needs is imported when it runs."""
    app.command("tile-worker")(tile_worker)


def tile_worker(
    database: Annotated[str, typer.Argument(help="URL of the queue's database.")],
    threads: Annotated[int, typer.Option(help="Threads of the kernels; default: all cores.")] = 0,
) -> None:
    """Take tiles of batches that run with --executor queue, until it is stopped."""
    if "://" not in database:
        raise InputError("DATABASE", "the URL of a PostgreSQL or SQLite database", database)
    from dbos import run_dbos_database_migrations

    from adret_service.tile_queue import serve_tiles

    run_dbos_database_migrations(database)
    serve_tiles(database, threads if threads > 0 else os.cpu_count() or 1)
    Event().wait()
