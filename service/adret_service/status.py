"""The status of a job as clients and subscribers see it."""

from typing import Any

from adret_service.datasets import timestamp
from adret_service.engine.port import JobRecord, JobStatus
from adret_service.problems import RESULT_NOT_READY, FieldError, Problem
from adret_service.storage import Artefact, Storage

__all__ = ["RESULTS", "artefacts_of", "prefix_of", "status_info"]

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


def artefacts_of(storage: Storage, job: JobRecord) -> dict[str, Artefact]:
    """Return the artefacts of a successful job, or answer why there are none."""
    if job.status is JobStatus.FAILED:
        error = job.error or {}
        raise Problem(
            int(error.get("status", 500)),
            str(error.get("detail", "the job failed")),
            type_=str(error.get("type", "about:blank")),
            errors=[FieldError(**entry) for entry in error.get("errors", ())],
        )
    if job.status is JobStatus.DISMISSED:
        raise Problem(404, "the job was dismissed", type_=RESULT_NOT_READY)
    if job.status is not JobStatus.SUCCESSFUL:
        raise Problem(404, "the job is not finished", type_=RESULT_NOT_READY)
    artefacts = storage.manifest(prefix_of(job))
    if artefacts is None:
        raise Problem(410, "the results of this job are gone")
    return artefacts


def prefix_of(job: JobRecord) -> str:
    """Return the folder of a job's results in the store."""
    return f"{job.tenant}/jobs/{job.id}"
