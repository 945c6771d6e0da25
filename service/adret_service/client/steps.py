"""The steps that commands are made of; what each needs is imported when it runs."""

import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from adret_service.client.records import Dataset, Job, Output
    from adret_service.client.session import Client

__all__ = [
    "bars_shown",
    "fetch_all",
    "fetch_one",
    "how_to_read",
    "looks_like_id",
    "named_output",
    "open_client",
    "reported",
    "say",
    "send",
    "typed_key",
    "wait_or_cancel",
]


def open_client(url: str | None) -> "Client":
    """Return a client with the address and the key that the environment or a login gave."""
    from adret_service.client.credentials import Credentials, credentials_file
    from adret_service.client.session import Client

    key = os.environ.get("ADRET_API_KEY", "").strip() or None
    if url is None or key is None:
        known = Credentials.load(credentials_file())
        url = url or known.url
        key = key or known.keys.get(url.rstrip("/"))
    return Client(url, key)


def send(client: "Client", file: Path, asked: dict[str, Any], *, shown: bool) -> "Dataset":
    """Upload with a bar."""
    from adret_service.client.bars import bytes_bar
    from adret_service.client.credentials import credentials_file
    from adret_service.client.uploads import upload

    notes = credentials_file().with_name("uploads")
    with bytes_bar(f"send {file.name}", file.stat().st_size, shown=shown) as sent:
        return upload(client, file, asked, sent, notes)


def wait_or_cancel(client: "Client", job: "Job", *, shown: bool) -> "Job":
    """Wait for a job's success; one that nobody waits for any more is dismissed."""
    from adret_service.client.bars import follow_with_bar
    from adret_service.client.errors import ClientError
    from adret_service.client.following import successful

    try:
        return successful(follow_with_bar(client, job.id, shown=shown))
    except ClientError:
        raise
    except BaseException:
        client.patience = 0.0
        try:
            client.cancel(job.id)
        except ClientError as error:
            typer.echo(f"adret: the job {job.id} goes on: {error}", err=True)
        raise


def fetch_all(client: "Client", job: "Job", targets: dict[str, Path], *, shown: bool) -> None:
    """Download outputs, each with a bar."""
    for name, target in targets.items():
        try:
            fetch_one(client, job.id, named_output(client, job.id, name), target, shown=shown)
        except KeyboardInterrupt:
            hint = f"adret: `adret fetch {job.id} {name} --out {target}` goes on from here"
            typer.echo(hint, err=True)
            raise


def fetch_one(
    client: "Client", job_id: str, output: "Output", target: Path, *, shown: bool
) -> None:
    """Download one output with a bar."""
    from adret_service.client.bars import bytes_bar
    from adret_service.client.downloads import fetch as download

    with bytes_bar(f"fetch {target.name}", output.length, shown=shown) as got:
        download(client, job_id, output, target, lambda have, _: got(have))


def named_output(client: "Client", job_id: str, name: str) -> "Output":
    """Return one of a job's outputs, or say which there are."""
    from adret_service.client.errors import ClientError

    outputs = client.results(job_id)
    if name not in outputs:
        raise ClientError(f"output: must be one of {', '.join(outputs)}, got {name!r}")
    return outputs[name]


def how_to_read(camera: Path | None, reading: list[str] | None) -> dict[str, Any]:
    """Return what is to be said to the service about a file."""
    from adret_service.client.inputs import camera_text, parse_values

    asked = parse_values(reading or [], "read")
    return asked if camera is None else {**asked, "camera": camera_text(camera)}


def looks_like_id(text: str) -> bool:
    """Whether this may be a dataset's id."""
    return len(text) == 26 and text.isascii() and text.isalnum()


def bars_shown(as_json: bool, quiet: bool) -> bool:
    """Whether somebody looks at the bars."""
    return sys.stderr.isatty() and not (as_json or quiet)


def typed_key() -> str:
    """Return the key from the environment, a pipe or the keyboard."""
    from adret_service.client.errors import ClientError

    key = os.environ.get("ADRET_API_KEY", "").strip() or None
    if key is None and sys.stdin.isatty():
        key = str(typer.prompt("API key", hide_input=True, err=True))
    elif key is None:
        key = sys.stdin.readline()
    if not key.strip():
        raise ClientError("key: must be given, got nothing")
    return key.strip()


def say(as_json: bool, document: Any, line: str) -> None:
    """Print one JSON object on one line, or a line for a person if there is one."""
    if as_json:
        print(json.dumps(document), flush=True)
    elif line:
        print(line, flush=True)


@contextmanager
def reported(as_json: bool) -> Iterator[None]:
    """Turn a refusal into one line on standard error, or its JSON, and an exit code."""
    from adret_service.client.errors import ClientError

    try:
        yield
    except ClientError as error:
        if as_json:
            known = dict(error.problem or {})
            body = {
                "detail": str(error),
                "exit": error.code,
                **({"problem": known} if known else {}),
            }
            print(json.dumps({"error": body}), file=sys.stderr)
        else:
            print(f"adret: {error}", file=sys.stderr)
        raise typer.Exit(error.code) from None
