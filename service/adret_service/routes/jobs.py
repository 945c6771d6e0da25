"""Jobs: accepted, running, then successful, failed or dismissed; their results; their end."""

import math
import time
from typing import Any

from fastapi import APIRouter, Request, Response

from adret_service.artefacts import serve_artefact
from adret_service.context import BaseUrl, Service, ServiceDep, Tenant
from adret_service.datasets import timestamp
from adret_service.documents import ResultReference, StatusInfo, StatusList
from adret_service.engine.port import JobRecord, JobStatus
from adret_service.ids import is_id
from adret_service.listing import Shown
from adret_service.paging import Before, Limit, page_links
from adret_service.problems import NO_SUCH_JOB, RESULT_NOT_READY, FieldError, Problem
from adret_service.storage import Artefact

router = APIRouter(tags=["jobs"])

STOPPING = 2.0  # seconds within which a dismissed job leaves its worker
ALIASES = {"preview.png": "preview", "result.tif": "result"}
BINARY: dict[int | str, dict[str, Any]] = {
    200: {"description": "The whole file.", "content": {"image/tiff": {}, "image/png": {}}},
    206: {"description": "The bytes of one range."},
    304: {"description": "The client has it already."},
}


@router.get(
    "/jobs", operation_id="getJobs", response_model=StatusList, response_model_exclude_unset=True
)
def list_jobs(
    service: ServiceDep,
    tenant: Tenant,
    base: BaseUrl,
    query: Shown,
    limit: Limit = 100,
    before: Before = None,
) -> dict[str, Any]:
    """List jobs, newest first."""
    found = service.engine.list(tenant, query.shown, limit=limit + 1, before=before)
    ids = [job.id for job in found]
    return {
        "jobs": [status_info(job, base) for job in found[:limit]],
        "links": page_links(f"{base}/jobs", limit, ids, **query.again),
    }


@router.get(
    "/jobs/{job_id}",
    operation_id="getStatus",
    response_model=StatusInfo,
    response_model_exclude_unset=True,
)
def get_job(
    job_id: str, response: Response, service: ServiceDep, tenant: Tenant, base: BaseUrl
) -> dict[str, Any]:
    """Say how far a job is."""
    job = found_job(service, job_id, tenant)
    if not job.is_finished:
        response.headers["Retry-After"] = "1"
    return status_info(job, base)


@router.delete(
    "/jobs/{job_id}",
    operation_id="dismiss",
    response_model=StatusInfo,
    response_model_exclude_unset=True,
)
def delete_job(job_id: str, service: ServiceDep, tenant: Tenant, base: BaseUrl) -> dict[str, Any]:
    """Dismiss an unfinished job, which stops its work; remove a finished one with its results."""
    job = found_job(service, job_id, tenant)
    if not job.is_finished:
        dismissed = service.engine.cancel(job_id, tenant)
        return status_info(dismissed or job, base)
    service.engine.remove(job_id, tenant)
    service.storage.delete(results_prefix(job))
    return status_info(job, base) | {"message": "removed"}


@router.post(
    "/jobs/{job_id}/retry",
    status_code=201,
    operation_id="retry",
    response_model=StatusInfo,
    response_model_exclude_unset=True,
)
def retry_job(
    job_id: str, response: Response, service: ServiceDep, tenant: Tenant, base: BaseUrl
) -> dict[str, Any]:
    """Run a failed or dismissed job again, as it was ordered."""
    job = found_job(service, job_id, tenant)
    gone_by = time.time() - job.updated  # negative after the clock was set back
    stopping = job.status is JobStatus.DISMISSED and 0.0 <= gone_by < STOPPING
    if stopping:
        headers = {"Retry-After": str(math.ceil(STOPPING))}
        raise Problem(409, "the job is still stopping", headers=headers)
    again = service.engine.retry(job_id, tenant)
    if again is None:
        error = FieldError("status", "failed or dismissed", str(job.status))
        raise Problem(409, str(error), errors=[error])
    response.headers["Location"] = f"{base}/jobs/{job_id}"
    return status_info(again, base)


@router.get(
    "/jobs/{job_id}/results",
    operation_id="getResults",
    response_model=dict[str, ResultReference],
    response_model_exclude_unset=True,
)
def get_results(job_id: str, service: ServiceDep, tenant: Tenant, base: BaseUrl) -> dict[str, Any]:
    """Return the outputs by reference."""
    artefacts = finished_results(service, job_id, tenant)
    return {
        name: {
            "href": f"{base}/jobs/{job_id}/results/{name}",
            "type": artefact.media_type,
            "length": artefact.size,
            "sha256": artefact.sha256,
        }
        for name, artefact in artefacts.items()
    }


@router.get(
    "/jobs/{job_id}/results/{output}",
    operation_id="getResult",
    responses=BINARY,
    response_class=Response,
)
@router.head("/jobs/{job_id}/results/{output}", include_in_schema=False)
def get_result(
    job_id: str, output: str, request: Request, service: ServiceDep, tenant: Tenant
) -> Response:
    """Return the bytes of one output: whole, one range of them, or 304."""
    artefacts = finished_results(service, job_id, tenant)
    artefact = artefacts.get(ALIASES.get(output, output))
    if artefact is None:
        error = FieldError("output", f"one of {', '.join(artefacts)}", output)
        raise Problem(404, str(error), errors=[error])
    filename = f"{job_id}-{artefact.key.rsplit('-', 1)[-1]}"
    return serve_artefact(request, service.storage, artefact, filename)


def found_job(service: Service, job_id: str, tenant: str) -> JobRecord:
    """Return the job or answer 404."""
    job = service.engine.get(job_id, tenant) if is_id(job_id) else None
    if job is None:
        raise Problem(404, "no such job", type_=NO_SUCH_JOB)
    return job


def finished_results(service: Service, job_id: str, tenant: str) -> dict[str, Artefact]:
    """Return the artefacts of a successful job, or answer why there are none."""
    job = found_job(service, job_id, tenant)
    if job.status is JobStatus.FAILED:
        error = job.error or {}
        raise Problem(
            int(error.get("status", 500)),
            str(error.get("detail", "the job failed")),
            errors=[FieldError(**entry) for entry in error.get("errors", ())],
        )
    if job.status is JobStatus.DISMISSED:
        raise Problem(404, "the job was dismissed", type_=RESULT_NOT_READY)
    artefacts = None
    if job.status is JobStatus.SUCCESSFUL:
        artefacts = service.storage.manifest(results_prefix(job))
        if artefacts is None:
            raise Problem(410, "the results of this job are gone")
    if artefacts is None:
        raise Problem(404, "the job is not finished", type_=RESULT_NOT_READY)
    return artefacts


def results_prefix(job: JobRecord) -> str:
    """Return the folder of a job's results in the store."""
    return f"{job.tenant}/jobs/{job.id}"


def status_info(job: JobRecord, base: str) -> dict[str, Any]:
    """Return statusInfo as version 1.0 and the draft of 2.0 of OGC API - Processes have it."""
    href = f"{base}/jobs/{job.id}"
    links = [
        {"rel": "self", "type": "application/json", "href": href, "title": "this job"},
        {"rel": "events", "type": "text/event-stream", "href": f"{href}/events"},
        {"rel": "logs", "type": "application/json", "href": f"{href}/logs"},
    ]
    if job.status is JobStatus.SUCCESSFUL:
        rel = "http://www.opengis.net/def/rel/ogc/1.0/results"
        links.append({"rel": rel, "type": "application/json", "href": f"{href}/results"})
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
        "inputs": {"dataset": job.dataset, **job.inputs},
        "links": links,
    }
    for name in ("started", "finished"):
        if getattr(job, name) is not None:
            body[name] = timestamp(getattr(job, name))
    if job.error is not None:
        body["exception"] = dict(job.error)
    return body
