"""Typed calls of one service: each is safe to repeat, and repeated while the service is away."""

import json
import secrets
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Self

import httpx

from adret_service.client.errors import AWAY, ClientError, refusal
from adret_service.client.records import Dataset, Event, Job, Output

__all__ = ["Client", "NoStream"]

CHUNK = 1 << 20
PATIENCE = 60.0  # seconds
PAUSES = (0.2, 5.0)  # seconds between two tries, at first and at most
SILENCE = 45.0  # seconds without a word after which a stream of events is dead; pings come every 15
LATER = (429, 502, 503, 504)


class NoStream(Exception):
    """The service, or something before it, has no stream of events to give."""


class Client:
    """Talks to one service.

    A call that the service does not answer, or answers with "later", is repeated for `patience`
    seconds; but a service that never answered is given up at once.

    Parameters
    ----------
    url : str
        Address of the service.
    key : str, optional
        API key.
    patience : float
        How long a service may be away [s].
    transport : httpx.BaseTransport, optional
        Replaces the network, for tests.

    Examples
    --------
    >>> Client("http://127.0.0.1:8000").url
    'http://127.0.0.1:8000'
    """

    def __init__(
        self,
        url: str,
        key: str | None = None,
        *,
        patience: float = PATIENCE,
        transport: httpx.BaseTransport | None = None,
    ) -> None:
        self.url = url.rstrip("/")
        self.patience = patience
        self._reached = False
        headers = {"Accept": "application/json", "Accept-Encoding": "identity"}
        if key is not None:
            headers["Authorization"] = f"Bearer {key}"
        try:
            self._http = httpx.Client(
                base_url=self.url,
                headers=headers,
                timeout=httpx.Timeout(60.0, write=300.0),
                transport=transport,
            )
            scheme = self._http.base_url.scheme
        except (httpx.InvalidURL, UnicodeError):
            scheme = ""
        if scheme not in ("http", "https"):
            raise ClientError(f"url: must begin with http:// or https://, got {url!r}")

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    def __enter__(self) -> Self:
        """Return the client."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the connections."""
        self.close()

    def upload(
        self,
        file: Path,
        reading: Mapping[str, Any] | None = None,
        sent: Callable[[int], None] = lambda _: None,
    ) -> Dataset:
        """Send a raster; an equal one gives the same dataset, so a broken upload starts again.

        Parameters
        ----------
        file : Path
            What to send.
        reading : mapping, optional
            How to read it: band, cell_size, vertical_unit, camera.
        sent : callable
            Called with the bytes sent so far, which go back to 0 when the upload starts again.
        """

        def pieces() -> Iterator[bytes]:
            done = 0
            sent(done)
            with file.open("rb") as source:
                while piece := source.read(CHUNK):
                    done += len(piece)
                    yield piece
                    sent(done)

        name = file.name.encode("ascii", "replace").decode().replace('"', "_").replace("\\", "_")
        headers = {
            "Content-Type": "application/octet-stream",
            "Content-Length": str(file.stat().st_size),
            "Content-Disposition": f'attachment; filename="{name}"',
        }
        query = {name: value for name, value in (reading or {}).items() if value is not None}
        answer = self.ask("POST", "/uploads", params=query, content=pieces, headers=headers)
        return Dataset.read(answer.json())

    def submit(self, process: str, inputs: Mapping[str, Any], key: str | None = None) -> Job:
        """Order a computation; orders with one key are one job, and without one it gets its own."""
        headers = {"Idempotency-Key": key or secrets.token_hex(16)}
        path = f"/processes/{segment(process)}/execution"
        answer = self.ask("POST", path, json={"inputs": dict(inputs)}, headers=headers)
        return Job.read(answer.json())

    def job(self, job_id: str) -> Job:
        """Return a job."""
        return Job.read(self.ask("GET", f"/jobs/{segment(job_id)}").json())

    def jobs(
        self, *, status: str | None = None, process: str | None = None, limit: int = 20
    ) -> list[Job]:
        """Return the newest jobs."""
        asked = {"limit": limit, "status": status, "processID": process}
        query = {name: value for name, value in asked.items() if value is not None}
        return [Job.read(each) for each in self.ask("GET", "/jobs", params=query).json()["jobs"]]

    def cancel(self, job_id: str) -> Job:
        """Dismiss a job; one that has ended is returned as it is.

        Deleting it a second time would remove it, so after a lost answer its state is looked at.
        """
        while not (job := self.job(job_id)).is_finished:
            try:
                answer = self.once("DELETE", f"/jobs/{job.id}")
                if not answer.is_error:
                    return Job.read(answer.json())
                if answer.status_code not in LATER:
                    raise refusal(answer)
            except httpx.TransportError:
                pass
            time.sleep(PAUSES[0])
        return job

    def results(self, job_id: str) -> dict[str, Output]:
        """Return what a successful job made, by name."""
        found = self.ask("GET", f"/jobs/{segment(job_id)}/results").json()
        return {
            name: Output(
                name=name,
                length=int(each["length"]),
                sha256=str(each["sha256"]),
                media_type=str(each.get("type", "")),
            )
            for name, each in found.items()
        }

    def events(self, job_id: str, after: int = 0) -> Iterator[Event]:
        """Yield what happens to a job, as it happens, from the event after that number on.

        Raises
        ------
        NoStream
            If there is no stream to read.
        httpx.TransportError
            If the stream breaks off.
        """
        headers = {"Accept": "text/event-stream", "Last-Event-ID": str(after)}
        limits = httpx.Timeout(60.0, read=SILENCE)
        path = f"/jobs/{segment(job_id)}/events"
        with self._http.stream("GET", path, headers=headers, timeout=limits) as answer:
            kind = answer.headers.get("content-type", "").split(";")[0].strip()
            if answer.status_code != 200 or kind != "text/event-stream":
                raise NoStream
            yield from read_events(answer.iter_lines())

    def download(self, job_id: str, output: Output, start: int) -> Iterator[tuple[int, bytes]]:
        """Yield an output's bytes from `start` on, or from 0 if the service begins there.

        Each piece comes with its place in the file.
        """
        headers = {"Accept": "*/*"}
        if start:
            headers |= {"Range": f"bytes={start}-", "If-Range": f'"{output.sha256}"'}
        path = f"/jobs/{segment(job_id)}/results/{segment(output.name)}"
        with self._http.stream("GET", path, headers=headers) as answer:
            if answer.is_error:
                answer.read()
                raise refusal(answer)
            place = start if answer.status_code == 206 else 0
            for piece in answer.iter_bytes():  # as they come: what has come is kept
                yield place, piece
                place += len(piece)

    def ask(
        self,
        method: str,
        path: str,
        *,
        content: Callable[[], Iterator[bytes]] | None = None,
        **options: Any,
    ) -> httpx.Response:
        """Send a request that may be repeated, until the service answers it.

        Raises
        ------
        ClientError
            With the service's reason, or if it stays away.
        """
        began, pause = time.monotonic(), PAUSES[0]
        while True:
            left = self.patience - (time.monotonic() - began)
            body = None if content is None else content()
            try:
                answer = self.once(method, path, content=body, **options)
                self._reached = True
                if not answer.is_error:
                    return answer
                wait = _asked_wait(answer, pause)
                if answer.status_code not in LATER or wait > left:
                    raise refusal(answer)
            except httpx.TransportError as error:
                wait = pause
                if not self._reached or wait > left:
                    raise self.away(error) from None
            time.sleep(wait)
            pause = min(2 * pause, PAUSES[1])

    def once(self, method: str, path: str, **options: Any) -> httpx.Response:
        """Send a request that must not be repeated blindly; any answer is returned.

        Raises
        ------
        httpx.TransportError
            If no answer came; what was asked for may have happened.
        """
        return self._http.request(method, path, **options)

    def away(self, error: Exception) -> ClientError:
        """Return what to say of a service that does not answer."""
        reason = str(error) or type(error).__name__
        return ClientError(
            f"url: must be a service that answers, got {self.url!r} ({reason})", AWAY
        )


def read_events(lines: Iterator[str]) -> Iterator[Event]:
    """Yield the events of a stream, as the HTML standard writes them.

    Examples
    --------
    >>> text = ["id: 7", "event: progress", 'data: {"progress": 3}', "", ": ping", ""]
    >>> [(event.seq, event.kind, dict(event.body)) for event in read_events(iter(text))]
    [(7, 'progress', {'progress': 3})]
    """
    fields: dict[str, str] = {}
    for line in lines:
        if line:
            name, _, value = line.partition(":")
            fields[name] = value.removeprefix(" ")
            continue
        if "data" in fields:
            number = fields.get("id", "")
            yield Event(
                seq=int(number) if number.isdigit() else None,
                kind=fields.get("event", "message"),
                body=json.loads(fields["data"]),
            )
        fields = {}


def segment(text: str) -> str:
    """Return `text` if it can be one part of a path, else refuse it."""
    if not text or not all(c.isascii() and (c.isalnum() or c in "-_.") for c in text):
        raise ClientError(f"id: must be letters, digits, '-', '_' and '.', got {text!r}")
    return text


def _asked_wait(answer: httpx.Response, pause: float) -> float:
    text = answer.headers.get("retry-after", "")
    return max(float(text), pause) if text.isdigit() else pause
