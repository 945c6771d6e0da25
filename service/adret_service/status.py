"""The status of a job as clients and subscribers see it."""

from typing import Any

from adret_service.datasets import timestamp
from adret_service.engine.port import JobRecord, JobStatus

__all__ = ["RESULTS", "prefix_of", "status_info"]

RESULTS = "http://www.opengis.net/def/rel/ogc/1.0/results"


def status_info(job: JobRecord, base: str) -> dict[str, Any]:
    """Return statusInfo as version 1.0 and the draft of 2.0 of OGC API - Processes have it."""
    href = f"{base}/jobs/{job.id}"
    links = [
        {"rel": "self", "type": "application/json", "href": href, "title": "this job"},
        {"rel": "events", "type": "text/event-stream", "href": f"{href}/events"},
        {"rel": "logs", "type": "application/json", "href": f"{href}/logs"},
    ]
    if job.status is JobStatus.SUCCESSFUL:
        links.append({"rel": RESULTS, "type": "application/json", "href": f"{href}/results"})
    body: dict[str, Any] = {
        "jobID": job.id,
        "id": job.id,
        "processID": job.process,
        "type": "process",
        "processingEntityType": "process",
        "status": str(job.status),
        "message": job.message,
        "progress": job.progress,
        "created": timestamp(job.created),
        "updated": timestamp(job.updated),
        "inputs": ({"dataset": job.dataset} if job.dataset else {}) | dict(job.inputs),
        "links": links,
    }
    for name in ("started", "finished"):
        if getattr(job, name) is not None:
            body[name] = timestamp(getattr(job, name))
    if job.error is not None:
        body["exception"] = dict(job.error)
    return body


def prefix_of(job: JobRecord) -> str:
    """Return the folder of a job's results in the store."""
    return f"{job.tenant}/jobs/{job.id}"
