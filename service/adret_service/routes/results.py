"""Results of jobs: as they were ordered, and one by one."""

import dataclasses
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from starlette.responses import JSONResponse

from adret_service.context import BaseUrl, ServiceDep, Tenant
from adret_service.documents import Results, StacItem
from adret_service.problems import FieldError, invalid
from adret_service.results import results_response
from adret_service.routes.execution import known_process
from adret_service.routes.frequent import answer_output
from adret_service.routes.jobs import found_job
from adret_service.stac import item
from adret_service.status import artefacts_of

router = APIRouter(tags=["jobs"])

BINARY: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "The whole file.",
        "content": {"image/tiff": {}, "image/png": {}, "application/json": {}},
    },
    206: {"description": "The bytes of one range."},
    304: {"description": "The client has it already."},
}
RESULTS: dict[int | str, dict[str, Any]] = {
    200: {
        "model": Results,
        "description": "A document, one raw output, or several as multipart/related.",
        "content": {"image/tiff": {}, "image/png": {}, "multipart/related": {}},
    },
    206: {"description": "The bytes of one range, of a raw output."},
    304: {"description": "The client has this raw output already."},
    204: {"description": "The results are all references, in `Link` headers."},
}


ITEM: dict[int | str, dict[str, Any]] = {
    200: {
        "model": StacItem,
        "description": "The item.",
        "content": {"application/geo+json": {"schema": {"$ref": "#/components/schemas/StacItem"}}},
    }
}


@router.get(
    "/jobs/{job_id}/results",
    operation_id="getResults",
    response_class=JSONResponse,
    response_model=None,
    responses=RESULTS,
)
def get_results(
    job_id: str,
    request: Request,
    service: ServiceDep,
    tenant: Tenant,
    base: BaseUrl,
    outputs: Annotated[
        str | None, Query(max_length=200, description="Only these outputs: names and commas.")
    ] = None,
) -> Response:
    """Return the results in the form in which they were ordered."""
    job = found_job(service, job_id, tenant)
    artefacts = artefacts_of(service.storage, job)
    if outputs is not None:
        names = [name for name in outputs.split(",") if name]
        unknown = [name for name in names if name not in artefacts]
        if unknown:
            made = f"of {', '.join(artefacts)}"
            raise invalid(*(FieldError("outputs", made, name) for name in unknown))
        ordered = job.request.get("outputs") or {}
        modes = {name: ordered.get(name) for name in names}
        job = dataclasses.replace(job, request={**job.request, "outputs": modes})
    limit = service.settings.inline_max_bytes
    return results_response(job, artefacts, service.storage, base, limit, request)


@router.get(
    "/jobs/{job_id}/stac",
    operation_id="getItem",
    response_class=JSONResponse,
    response_model=None,
    responses=ITEM,
)
@router.get("/jobs/{job_id}/results/stac", include_in_schema=False)
def get_item(job_id: str, service: ServiceDep, tenant: Tenant, base: BaseUrl) -> Response:
    """Return a result as a STAC item: where it lies, what made it, where its files are."""
    job = found_job(service, job_id, tenant)
    artefacts = artefacts_of(service.storage, job)
    process = known_process(service, job.process)
    dataset = service.catalogue.get(job.dataset, tenant) if job.dataset else None
    body = item(job, process, dataset, artefacts, base)
    return JSONResponse(body, media_type="application/geo+json")


@router.get(
    "/jobs/{job_id}/results/{output}",
    operation_id="getResult",
    responses=BINARY,
    response_class=Response,
)
@router.head("/jobs/{job_id}/results/{output}", include_in_schema=False)
async def get_result(job_id: str, output: str, request: Request, tenant: Tenant) -> Response:
    """Return the bytes of one output: whole, one range of them, or 304."""
    return await answer_output(request)
