"""What happens to a job: as a stream while it happens, and as a log to read afterwards."""

import json
import time
from collections.abc import AsyncIterator
from typing import Annotated, Any

import anyio
from anyio.to_thread import run_sync
from fastapi import APIRouter, Header, Query, Request
from starlette.responses import StreamingResponse

from adret_service.context import BaseUrl, Service, ServiceDep, Tenant
from adret_service.datasets import timestamp
from adret_service.documents import LogPage
from adret_service.engine.port import FINISHED, JobEvent
from adret_service.problems import FieldError, invalid
from adret_service.routes.jobs import found_job

router = APIRouter(tags=["jobs"])

LOOK = 0.25  # seconds between two looks for news
PING = 15.0  # seconds of silence after which a comment keeps the connection open
MAX_SEQ = 2**53
ENDS = {str(status) for status in FINISHED}

After = Annotated[int, Query(ge=0, le=MAX_SEQ, description="Only events after this number.")]


@router.get(
    "/jobs/{job_id}/events",
    operation_id="getEvents",
    response_class=StreamingResponse,
    responses={200: {"description": "Events.", "content": {"text/event-stream": {}}}},
)
async def stream_events(
    job_id: str,
    request: Request,
    service: ServiceDep,
    tenant: Tenant,
    after: After = 0,
    last: Annotated[str | None, Header(alias="Last-Event-ID", max_length=32)] = None,
) -> StreamingResponse:
    """Stream a job's events: `status`, `progress` and `log`, then `end`.

    Each has a number as its id; a client that lost the connection sends the last one it saw and
    gets what came after. The stream ends with the job.
    """
    await run_sync(found_job, service, job_id, tenant)
    if last:
        after = sequence(last)
    return StreamingResponse(
        news(request, service, job_id, tenant, after),
        media_type="text/event-stream",
        headers={"Cache-Control": "no-store", "X-Accel-Buffering": "no"},
    )


@router.get(
    "/jobs/{job_id}/logs",
    operation_id="getLogs",
    response_model=LogPage,
    response_model_exclude_unset=True,
)
def get_logs(
    job_id: str, service: ServiceDep, tenant: Tenant, base: BaseUrl, after: After = 0
) -> dict[str, Any]:
    """Return what happened to a job, oldest first."""
    found_job(service, job_id, tenant)
    found = service.engine.events(job_id, after)
    lines = [log_line(event) for event in found]
    last = found[-1].seq if found else after
    href = f"{base}/jobs/{job_id}/logs"
    links = [{"rel": "self", "type": "application/json", "href": href}]
    if found:
        following = {"rel": "next", "type": "application/json", "href": f"{href}?after={last}"}
        links.append(following)
    return {"logs": lines, "links": links}


async def news(
    request: Request, service: Service, job_id: str, tenant: str, after: int
) -> AsyncIterator[str]:
    """Yield a job's events as they come, in the form of server-sent events."""
    spoken = time.monotonic()
    while not await request.is_disconnected():
        # The record first: what ended it is among the events that are read after it.
        job = await run_sync(service.engine.get, job_id, tenant)
        for event in await run_sync(service.engine.events, job_id, after):
            after, spoken = event.seq, time.monotonic()
            yield server_sent(event.kind, event.seq, {"at": timestamp(event.at), **event.body})
        if job is None or job.is_finished:
            status = "removed" if job is None else str(job.status)
            yield server_sent("end", None, {"status": status})
            return
        if time.monotonic() - spoken > PING:
            spoken = time.monotonic()
            yield ": ping\n\n"
        await anyio.sleep(LOOK)


def server_sent(kind: str, seq: int | None, body: dict[str, Any]) -> str:
    """Return one event as the HTML standard writes it."""
    number = "" if seq is None else f"id: {seq}\n"
    return f"{number}event: {kind}\ndata: {json.dumps(body)}\n\n"


def log_line(event: JobEvent) -> dict[str, Any]:
    """Return an event as a line of a log."""
    body = event.body
    line: dict[str, Any] = {
        "id": event.seq,
        "at": timestamp(event.at),
        "level": body.get("level", "error" if body.get("status") == "failed" else "info"),
        "message": body.get("message", ""),
    }
    return line | {k: body[k] for k in ("status", "progress") if k in body}


def sequence(text: str) -> int:
    """Return the number that a client says it has seen."""
    if not text.isascii() or not text.isdigit() or int(text) > MAX_SEQ:
        raise invalid(FieldError("Last-Event-ID", "the id of an event", text))
    return int(text)
