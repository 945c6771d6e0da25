"""Commands that use a service: login, upload, run, jobs, watch, cancel and fetch.

Exit codes: 0 done; 1 the service cannot be reached, or failed; 2 wrong input, or the service
refused it; 3 the job failed or was dismissed; 130 interrupted.
"""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from adret_service.client.steps import (
    bars_shown,
    fetch_all,
    fetch_one,
    how_to_read,
    looks_like_id,
    named_output,
    open_client,
    reported,
    say,
    send,
    typed_key,
    wait_or_cancel,
)

__all__ = [
    "add_cancel",
    "add_fetch",
    "add_jobs",
    "add_login",
    "add_run",
    "add_upload",
    "add_watch",
]

Url = Annotated[
    str | None,
    typer.Option(envvar="ADRET_URL", help="Address of the service; else that of the last login."),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON for programs, and no bars.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Show no bars.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace files that exist.")]
Camera = Annotated[Path | None, typer.Option(help="Camera file: what is sent is a depth buffer.")]
Reading = Annotated[
    list[str] | None,
    typer.Option("--read", help="How to read the file: cell_size=10, vertical_unit=ft, band=2."),
]
JobId = Annotated[str, typer.Argument(metavar="JOB", help="Id of the job.")]


def add_login(app: typer.Typer) -> None:
    """Add ``adret login``."""
    app.command()(login)


def add_upload(app: typer.Typer) -> None:
    """Add ``adret upload``."""
    app.command()(upload)


def add_run(app: typer.Typer) -> None:
    """Add ``adret run``."""
    app.command()(run)


def add_jobs(app: typer.Typer) -> None:
    """Add ``adret jobs``."""
    app.command()(jobs)


def add_watch(app: typer.Typer) -> None:
    """Add ``adret watch``."""
    app.command()(watch)


def add_cancel(app: typer.Typer) -> None:
    """Add ``adret cancel``."""
    app.command()(cancel)


def add_fetch(app: typer.Typer) -> None:
    """Add ``adret fetch``."""
    app.command()(fetch)


def login(
    url: Annotated[
        str | None, typer.Argument(envvar="ADRET_URL", help="Address of the service.")
    ] = None,
    remove: Annotated[bool, typer.Option(help="Forget the key of this service.")] = False,
    as_json: Json = False,
) -> None:
    """Keep the address of a service and the API key for it, after trying it.

    The key is asked for, or read from standard input or ADRET_API_KEY.
    """
    from adret_service.client.credentials import Credentials, credentials_file
    from adret_service.client.errors import ClientError
    from adret_service.client.session import Client

    with reported(as_json):
        path = credentials_file()
        known = Credentials.load(path)
        url = (url or known.url).rstrip("/")
        if remove:
            known.keys.pop(url, None)
        else:
            key = None
            try:
                with Client(url) as client:
                    client.jobs(limit=1)
            except ClientError as error:
                if error.problem is None or error.problem.get("status") != 401:
                    raise
                key = typed_key()
                with Client(url, key) as client:
                    client.jobs(limit=1)
            if key is not None:
                known.keys[url] = key
            known.url = url
        known.save(path)
        say(as_json, {"url": url, "key": url in known.keys}, f"{url} ({path})")


def upload(
    file: Annotated[Path, typer.Argument(help="Elevation raster or depth buffer to send.")],
    camera: Camera = None,
    reading: Reading = None,
    url: Url = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Send a raster and print the id of its dataset, which orders name."""
    from adret_service.client.inputs import check_source

    with reported(as_json):
        asked = how_to_read(camera, reading)
        check_source(file)
        with open_client(url) as client:
            dataset = send(client, file, asked, shown=bars_shown(as_json, quiet))
        say(as_json, dataset.document, dataset.id)


def run(
    process: Annotated[str, typer.Argument(help="horizon, sky-view, light, viewshed, ssao, ...")],
    data: Annotated[
        str, typer.Argument(metavar="FILE|DATASET", help="A file to send, or a dataset's id.")
    ],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="GeoTIFF to write.")] = None,
    preview: Annotated[Path | None, typer.Option(help="PNG to write as well.")] = None,
    directions: Annotated[int | None, typer.Option(help="Number of azimuths.")] = None,
    option: Annotated[
        list[str] | None,
        typer.Option("--input", "-i", help="Another input of the process, as name=value in JSON."),
    ] = None,
    camera: Camera = None,
    reading: Reading = None,
    detach: Annotated[
        bool, typer.Option("--detach", "-d", help="Print the job's id and leave it running.")
    ] = False,
    url: Url = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Have a computation done by a service: send, order, wait, fetch. Ctrl-C dismisses the job."""
    from adret_service.client.errors import ClientError
    from adret_service.client.inputs import check_source, check_targets, parse_values

    shown = bars_shown(as_json, quiet)
    with reported(as_json):
        inputs: dict[str, Any] = {} if directions is None else {"directions": directions}
        inputs |= parse_values(option or [])
        asked = how_to_read(camera, reading)
        wanted = {"result": out, "preview": preview}
        targets = {name: path for name, path in wanted.items() if path is not None}
        if detach == bool(targets):
            raise ClientError("out: must be given, or --detach, and not both")
        check_targets(list(targets.values()), overwrite=overwrite)
        dataset = data if looks_like_id(data) and not Path(data).exists() else None
        file = None if dataset else check_source(Path(data))
        with open_client(url) as client:
            if file is not None:
                dataset = send(client, file, asked, shown=shown).id
            job = client.submit(process, {"dataset": dataset, **inputs})
            if detach:
                say(as_json, job.document, job.id)
                return
            job = wait_or_cancel(client, job, shown=shown)
            fetch_all(client, job, targets, shown=shown)
        files = {name: str(path) for name, path in targets.items()}
        say(as_json, {"job": job.document, "files": files}, "")


def jobs(
    job_id: Annotated[
        str | None, typer.Argument(metavar="[JOB]", help="Show all of this one.")
    ] = None,
    status: Annotated[
        str | None, typer.Option(help="accepted, running, successful, failed or dismissed.")
    ] = None,
    process: Annotated[str | None, typer.Option(help="Only jobs of this process.")] = None,
    limit: Annotated[int, typer.Option(help="How many, at most.", min=1, max=1000)] = 20,
    url: Url = None,
    as_json: Json = False,
) -> None:
    """List jobs, the newest first; or show one."""
    with reported(as_json), open_client(url) as client:
        if job_id is not None:
            document = client.job(job_id).document
            say(as_json, document, json.dumps(document, indent=1))
            return
        found = client.jobs(status=status, process=process, limit=limit)
        if as_json:
            say(True, {"jobs": [job.document for job in found]}, "")
        else:
            from adret_service.client.bars import show_jobs

            show_jobs(found)


def watch(job_id: JobId, url: Url = None, as_json: Json = False, quiet: Quiet = False) -> None:
    """Follow a job to its end; with --json one object an event, then the job. Ctrl-C leaves it."""
    from adret_service.client.bars import follow_with_bar
    from adret_service.client.following import successful
    from adret_service.client.records import Event

    def told(event: Event) -> None:
        if as_json:
            say(True, {"event": event.kind, "id": event.seq, **event.body}, "")

    with reported(as_json), open_client(url) as client:
        job = follow_with_bar(client, job_id, shown=bars_shown(as_json, quiet), told=told)
        say(as_json, job.document, job.status)
        successful(job)


def cancel(
    job_ids: Annotated[list[str], typer.Argument(metavar="JOB...", help="Ids of the jobs.")],
    url: Url = None,
    as_json: Json = False,
) -> None:
    """Dismiss jobs that have not ended, which stops their work; the others stay as they are."""
    with reported(as_json), open_client(url) as client:
        for job_id in job_ids:
            job = client.cancel(job_id)
            say(as_json, job.document, f"{job.id} {job.status}")


def fetch(
    job_id: JobId,
    output: Annotated[str, typer.Argument(help="Which output.")] = "result",
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="File to write; default: JOB-OUTPUT.")
    ] = None,
    url: Url = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Download an output of a finished job; one that was interrupted goes on where it stopped."""
    from adret_service.client.following import successful
    from adret_service.client.inputs import check_targets

    with reported(as_json), open_client(url) as client:
        if out is not None:
            check_targets([out], overwrite=overwrite)
        job = client.job(job_id)
        if job.is_finished:
            successful(job)
        found = named_output(client, job_id, output)
        suffix = {"image/tiff": ".tif", "image/png": ".png"}
        ending = suffix.get(found.media_type.split(";")[0].strip(), "")
        target = out or Path(f"{job_id}-{output}{ending}")
        check_targets([target], overwrite=overwrite)
        fetch_one(client, job_id, found, target, shown=bars_shown(as_json, quiet))
        fields = {"output": output, "path": str(target), "bytes": found.length}
        say(as_json, {**fields, "sha256": found.sha256}, str(target))
