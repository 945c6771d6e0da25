"""Uploads in pieces, by tus 1.0: a large one goes on where it stopped, in a later command too."""

import base64
import hashlib
import json
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import httpx

from adret_service.client.errors import ClientError, refusal
from adret_service.client.records import Dataset
from adret_service.client.session import LATER, PAUSES, Client

__all__ = ["upload"]

WHOLE = 32 << 20  # bytes up to which a file is sent at once
PIECE = 8 << 20
GONE = (404, 405, 410, 412)  # no such upload any more, or no such protocol
TUS = {"Tus-Resumable": "1.0.0"}


def upload(
    client: Client,
    file: Path,
    reading: Mapping[str, Any],
    sent: Callable[[int], None],
    notes: Path,
) -> Dataset:
    """Send a raster, a large one in pieces that are kept while it is on its way.

    Parameters
    ----------
    client : Client
        The service.
    file : Path
        What to send.
    reading : mapping
        How to read it; see `Client.upload`.
    sent : callable
        Called with the bytes that are there.
    notes : Path
        Folder where the names of unfinished uploads are kept.
    """
    size = file.stat().st_size
    if size <= WHOLE:
        return client.upload(file, reading, sent)
    note = notes / name_of(client, file, reading)
    begun = note.read_text("ascii").strip() if note.exists() else None
    for known in (begun, None):
        try:
            upload_id = known or begin(client, file, reading)
            notes.mkdir(parents=True, exist_ok=True, mode=0o700)
            note.write_text(upload_id, "ascii")
            dataset = send(client, f"/uploads/tus/{upload_id}", file, sent)
            break
        except ClientError as error:
            status = (error.problem or {}).get("status")
            if status not in GONE:
                if error.problem is not None:
                    note.unlink(missing_ok=True)  # refused: it would be refused again
                raise
            if known is None:
                return client.upload(file, reading, sent)
    note.unlink(missing_ok=True)
    return Dataset.read(client.ask("GET", f"/datasets/{dataset}").json())


def name_of(client: Client, file: Path, reading: Mapping[str, Any]) -> str:
    """Return the name of the note for an upload: another for each file, service and way to read."""
    seen = file.stat()
    told = [client.url, str(file.absolute()), seen.st_size, seen.st_mtime_ns, dict(reading)]
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:32]


def begin(client: Client, file: Path, reading: Mapping[str, Any]) -> str:
    """Announce an upload and return its id."""
    name = base64.b64encode(file.name.encode()).decode()
    headers = {
        **TUS,
        "Upload-Length": str(file.stat().st_size),
        "Upload-Metadata": f"filename {name}",
    }
    query = {key: value for key, value in reading.items() if value is not None}
    answer = client.ask("POST", "/uploads/tus", params=query, headers=headers)
    return str(answer.headers["location"]).rstrip("/").rsplit("/", 1)[-1]


def send(client: Client, path: str, file: Path, sent: Callable[[int], None]) -> str:
    """Send what is missing and return the id of the dataset; safe to break off at any byte."""
    news, pause, last = time.monotonic(), PAUSES[0], -1
    with file.open("rb") as source:
        while True:
            state = client.ask("GET", path, headers=TUS).json()
            if "dataset" in state:
                return str(state["dataset"])
            at = int(state["offset"])
            if at > last:
                news, pause, last = time.monotonic(), PAUSES[0], at
            sent(at)
            source.seek(at)
            headers = {
                **TUS,
                "Upload-Offset": str(at),
                "Content-Type": "application/offset+octet-stream",
            }
            try:
                piece = source.read(PIECE)
                answer = client.once("PATCH", path, content=piece, headers=headers)
                if not answer.is_error:
                    sent(at + len(piece))
                    continue
                error: ClientError = refusal(answer)
                if answer.status_code not in (*LATER, 409):
                    raise error
            except httpx.TransportError as broken:
                error = client.away(broken)
            if time.monotonic() - news > client.patience:
                raise error
            time.sleep(pause)
            pause = min(2 * pause, PAUSES[1])
