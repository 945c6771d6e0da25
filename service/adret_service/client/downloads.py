"""Downloads that go on where they stopped, and files that appear only whole."""

import hashlib
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx

from adret_service.client.errors import AWAY, ClientError
from adret_service.client.records import Output
from adret_service.client.session import CHUNK, PAUSES, Client

__all__ = ["fetch", "part_of"]

Got = Callable[[int, int], None]


def part_of(target: Path, output: Output) -> Path:
    """Return the file that holds what has come of an output so far."""
    return target.with_name(f".{target.name}.{output.sha256[:16]}.part")


def fetch(
    client: Client, job_id: str, output: Output, target: Path, got: Got = lambda _have, _all: None
) -> None:
    """Download one output: `target` appears when it is whole and its digest is right.

    What has come stays beside the target when the download is interrupted, and the next one of
    the same output goes on from there.

    Parameters
    ----------
    client : Client
        The service.
    job_id : str
        A successful job.
    output : Output
        One of its results.
    target : Path
        The file to write.
    got : callable
        Called with the bytes that are there, and all bytes.

    Raises
    ------
    ClientError
        If the service refuses or stays away, or if what came is not what was made.
    """
    part = part_of(target, output)
    continued = part.exists()
    _receive(client, job_id, output, part, got)
    if continued and _digest(part).hexdigest() != output.sha256:
        part.unlink()  # what was there before was something else
        _receive(client, job_id, output, part, got)
    if _digest(part).hexdigest() != output.sha256:
        part.unlink()
        raise ClientError(f"{output.name}: the download does not match its digest", AWAY)
    os.replace(part, target)


def _receive(client: Client, job_id: str, output: Output, part: Path, got: Got) -> None:
    news, pause = time.monotonic(), PAUSES[0]
    with part.open("ab") as file:
        have = file.tell()
        if have > output.length:
            file.truncate(have := 0)
        got(have, output.length)
        while have < output.length:
            try:
                for place, piece in client.download(job_id, output, have):
                    if place < have:
                        file.truncate(have := place)
                    file.write(piece)
                    have += len(piece)
                    got(have, output.length)
                    news, pause = time.monotonic(), PAUSES[0]
                if have >= output.length:
                    break
                error: Exception = ClientError("the download ended early", AWAY)
            except httpx.TransportError as broken:
                error = client.away(broken)
            except ClientError as refused:
                if refused.code != AWAY:
                    raise
                error = refused
            if time.monotonic() - news > client.patience:
                raise error
            time.sleep(pause)
            pause = min(2 * pause, PAUSES[1])
        file.flush()
        os.fsync(file.fileno())


def _digest(path: Path) -> Any:
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while piece := file.read(CHUNK):
            digest.update(piece)
    return digest
