"""Jobs: accepted, running, then successful, failed or dismissed; their results; their end."""

import math
import time
from typing import Any

from fastapi import APIRouter, Request, Response
from starlette.responses import JSONResponse

from adret_service.context import BaseUrl, Service, ServiceDep, Tenant
from adret_service.documents import StatusInfo, StatusList
from adret_service.engine.port import JobRecord, JobStatus
from adret_service.ids import is_id
from adret_service.listing import Shown
from adret_service.paging import Before, Limit, page_links
from adret_service.problems import NO_SUCH_JOB, FieldError, Problem, missing
from adret_service.routes.frequent import answer_status
from adret_service.status import prefix_of, status_info

router = APIRouter(tags=["jobs"])

STOPPING = 2.0  # seconds within which a dismissed job leaves its worker


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
    response_class=JSONResponse,
    response_model=None,
    responses={
        200: {"model": StatusInfo, "description": "How far it is."},
        304: {"description": "The client knows it already, by its entity tag."},
    },
)
async def get_job(job_id: str, request: Request, tenant: Tenant) -> Response:
    """Say how far a job is."""
    return await answer_status(request)


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
    service.storage.delete(prefix_of(job))
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


def found_job(service: Service, job_id: str, tenant: str) -> JobRecord:
    """Return the job or answer 404."""
    job = service.engine.get(job_id, tenant) if is_id(job_id) else None
    if job is None:
        raise missing("job", job_id, NO_SUCH_JOB)
    return job
