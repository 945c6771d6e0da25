"""Following a job to its end, over broken connections and restarts of the service."""

import time
from collections.abc import Iterator

import httpx

from adret_service.client.errors import ENDED, ClientError
from adret_service.client.records import Event, Job
from adret_service.client.session import Client, NoStream

__all__ = ["follow", "successful"]

POLL = (0.2, 2.0)  # seconds between two looks, at first and at most
EMPTY = 2  # connections without an event after which a stream is not believed in
AGAIN = 0.2  # seconds before a stream is opened again


def follow(client: Client, job_id: str) -> Iterator[Event]:
    """Yield what happens to a job until it has ended, each event once.

    The events come as a stream, which is opened again after the last event seen when it breaks.
    Where there is no stream to be had, the job is looked at again and again.

    Raises
    ------
    ClientError
        If there is no such job, or the service stays away.
    """
    last, empty = 0, 0
    client.job(job_id)
    while empty < EMPTY:
        before = last
        try:
            for event in client.events(job_id, last):
                last = event.seq or last
                yield event
                if event.kind == "end":
                    return
        except NoStream:
            break
        except httpx.TransportError:
            pass
        empty = 0 if last > before else empty + 1
        time.sleep(AGAIN)
        client.job(job_id)  # waits for a service that is away
    yield from poll(client, job_id)


def poll(client: Client, job_id: str) -> Iterator[Event]:
    """Yield the changes that looking at a job now and then shows, then its end."""
    pause, known = POLL[0], None
    while True:
        job = client.job(job_id)
        seen = {"status": job.status, "progress": job.progress, "message": job.message}
        if seen != known:
            yield Event(seq=None, kind="status", body=seen)
            known, pause = seen, POLL[0]
        if job.is_finished:
            yield Event(seq=None, kind="end", body={"status": job.status})
            return
        time.sleep(pause)
        pause = min(1.3 * pause, POLL[1])


def successful(job: Job) -> Job:
    """Return a job that did what it was ordered to; ClientError says why another did not."""
    if job.status != "successful":
        exception = job.document.get("exception")
        line = f"job {job.id}: {job.status}: {job.message}"
        raise ClientError(line, ENDED, exception if isinstance(exception, dict) else None)
    return job
