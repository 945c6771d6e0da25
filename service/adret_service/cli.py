"""Commands that run a service: serve, worker and keys."""

import ipaddress
from pathlib import Path
from typing import Annotated, Any

import typer

__all__ = ["add_keys", "add_serve", "add_worker"]


def add_serve(app: typer.Typer) -> None:
    """Add ``adret serve``; what it needs is imported when it runs, here and below."""
    app.command()(serve)


def add_worker(app: typer.Typer) -> None:
    """Add ``adret worker``."""
    app.command()(worker)


def add_keys(app: typer.Typer) -> None:
    """Add ``adret keys``."""
    app.command()(keys)


def serve(
    host: Annotated[str | None, typer.Option(help="Address to listen on.")] = None,
    port: Annotated[int | None, typer.Option(help="Port to listen on; 0 takes a free one.")] = None,
    data_dir: Annotated[
        Path | None, typer.Option(help="Folder of database, datasets and results.")
    ] = None,
    workers: Annotated[int | None, typer.Option(help="Worker processes to keep running.")] = None,
    role: Annotated[
        str | None, typer.Option(help="all: API and workers; api: the API alone.")
    ] = None,
) -> None:
    """Serve the HTTP API, with workers that run its jobs."""
    given = {"host": host, "port": port, "data_dir": data_dir, "workers": workers, "role": role}
    settings = settings_or_exit(given)
    refuse_open_door(settings.host, settings.allow_insecure_bind or settings.auth != "none")

    from adret_service.server import serve as run

    run(settings)


def worker(
    data_dir: Annotated[
        Path | None, typer.Option(help="Folder of database, datasets and results.")
    ] = None,
) -> None:
    """Run jobs of a service that was started with --role api."""
    settings = settings_or_exit({"data_dir": data_dir})

    from adret_service.worker import run_worker, set_up_logging

    set_up_logging(settings)
    run_worker(settings)


def keys(
    tenant: Annotated[str | None, typer.Option(help="Make a key for this tenant.")] = None,
    scope: Annotated[
        list[str] | None,
        typer.Option(help="read, submit or metrics; may be repeated; default: read, submit."),
    ] = None,
    remove: Annotated[str | None, typer.Option(help="Forget the key of this id.")] = None,
    data_dir: Annotated[
        Path | None, typer.Option(help="Folder of database, datasets and results.")
    ] = None,
) -> None:
    """List, make and remove the API keys of a service; a new one is shown once."""
    from adret_service.auth import SCOPES, add_key, read_keys, remove_key

    path = settings_or_exit({"data_dir": data_dir}).keys_file
    if remove is not None and not remove_key(path, remove):
        typer.echo(f"remove: must be the id of a key, got {remove!r}", err=True)
        raise typer.Exit(2)
    if tenant is not None:
        try:
            key_id, secret = add_key(path, tenant, scope or SCOPES)
        except ValueError as error:
            typer.echo(str(error), err=True)
            raise typer.Exit(2) from None
        typer.echo(f"{key_id} {secret}")
    elif remove is None:
        for entry in read_keys(path):
            typer.echo(f"{entry['id']} {entry['tenant']} {','.join(entry['scopes'])}")


def settings_or_exit(given: dict[str, Any]) -> Any:
    """Build the settings from options and environment, or say what is wrong and exit with 2."""
    from pydantic import ValidationError

    from adret_service.settings import Settings

    try:
        return Settings(**{key: value for key, value in given.items() if value is not None})
    except ValidationError as error:
        for entry in error.errors():
            field = ".".join(str(part) for part in entry["loc"]) or "settings"
            typer.echo(f"{field}: {entry['msg']}, got {entry['input']!r}", err=True)
        raise typer.Exit(2) from None


def refuse_open_door(host: str, allowed: bool) -> None:
    """Exit with 2 if `host` can be reached from other machines and nobody said that it may."""
    try:
        local = ipaddress.ip_address(host).is_loopback
    except ValueError:
        local = host == "localhost"
    if not local and not allowed:
        typer.echo(
            f"host: must be a loopback address, because this service asks nobody who they are; "
            f"got {host!r} (ADRET_AUTH=apikey asks for keys, which `adret keys` makes; "
            "ADRET_ALLOW_INSECURE_BIND=1 serves everyone who can reach it)",
            err=True,
        )
        raise typer.Exit(2)
