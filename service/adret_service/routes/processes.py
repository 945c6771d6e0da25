"""What can be computed, and the order to compute it."""

import hashlib
import json
import time
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Header, Query, Request, Response
from pydantic import BaseModel, ConfigDict, Field

from adret_service import processes
from adret_service.context import BaseUrl, ServiceDep, Tenant
from adret_service.documents import Process, ProcessList, StatusInfo
from adret_service.engine.port import JobRecord, KeyReused, OverQuota, Quota, RequestKey
from adret_service.ids import new_id
from adret_service.problems import NO_SUCH_PROCESS, FieldError, Problem, invalid
from adret_service.routes.datasets import require_room
from adret_service.routes.jobs import status_info
from adret_service.settings import Settings

router = APIRouter(tags=["processes"])


class Execute(BaseModel):
    """An order: the inputs of a process, and how its outputs are wanted."""

    model_config = ConfigDict(extra="forbid")

    inputs: dict[str, Any] = Field(default_factory=dict)
    outputs: dict[str, Any] | None = Field(
        default=None, description="Outputs that are wanted; all are made whatever it says."
    )
    response: Literal["document", "raw"] = Field(
        default="document", description="Results are always served by reference."
    )


@router.get(
    "/processes",
    operation_id="getProcesses",
    response_model=ProcessList,
    response_model_exclude_unset=True,
)
def list_processes(
    base: BaseUrl,
    limit: Annotated[int, Query(ge=1, le=1000)] = 100,
    offset: Annotated[int, Query(ge=0, le=1_000_000)] = 0,
) -> dict[str, Any]:
    """List the processes."""
    names = processes.names()
    links = [_link("self", f"{base}/processes?limit={limit}&offset={offset}")]
    if offset + limit < len(names):
        links.append(_link("next", f"{base}/processes?limit={limit}&offset={offset + limit}"))
    return {
        "processes": [
            processes.summary(name) | {"links": [_link("self", f"{base}/processes/{name}")]}
            for name in names[offset : offset + limit]
        ],
        "links": links,
    }


@router.get(
    "/processes/{process_id}",
    operation_id="getProcessDescription",
    response_model=Process,
    response_model_exclude_unset=True,
)
def describe_process(process_id: str, base: BaseUrl) -> dict[str, Any]:
    """Describe a process: its inputs as JSON Schema, its outputs, its limits."""
    _known(process_id)
    execute = f"{base}/processes/{process_id}/execution"
    return processes.description(process_id) | {
        "links": [_link("http://www.opengis.net/def/rel/ogc/1.0/execute", execute)]
    }


@router.post(
    "/processes/{process_id}/execution",
    status_code=201,
    operation_id="execute",
    response_model=StatusInfo,
    response_model_exclude_unset=True,
)
def execute_process(
    process_id: str,
    order: Execute,
    request: Request,
    response: Response,
    service: ServiceDep,
    tenant: Tenant,
    base: BaseUrl,
    key: Annotated[
        str | None,
        Header(
            alias="Idempotency-Key",
            min_length=1,
            max_length=255,
            description="A name for this order: sent again, it is answered with the same job.",
        ),
    ] = None,
) -> dict[str, Any]:
    """Order a computation; it runs in a worker, and `Location` is its job."""
    _known(process_id)
    dataset, inputs = processes.validated(process_id, order.inputs)
    unknown = FieldError("inputs.dataset", "the id of an existing dataset", dataset)
    found = service.catalogue.get(dataset, tenant)
    if found is None:
        raise invalid(unknown)
    kind = found.info.get("kind", "terrain")
    if kind != processes.reads(process_id):
        limit = f"a dataset of kind {processes.reads(process_id)}"
        raise invalid(FieldError("inputs.dataset", limit, f"one of kind {kind}"))
    _wanted_outputs(process_id, order.outputs)
    require_room(service)
    waiting = service.engine.waiting()
    if waiting >= service.settings.queue_max:
        detail = f"queue: must be below {service.settings.queue_max} waiting jobs, got {waiting}"
        raise Problem(503, detail, headers={"Retry-After": "30"})
    job = JobRecord(id=new_id(), tenant=tenant, process=process_id, dataset=dataset, inputs=inputs)
    named = None if key is None else RequestKey(key=key, digest=digest_of(job))
    cells = int(found.info["rows"]) * int(found.info["columns"])
    try:
        job = service.engine.submit(job, named, cells=cells, quota=quota_of(service.settings))
    except LookupError:
        raise invalid(unknown) from None
    except OverQuota as over:
        error = FieldError(over.field, over.limit, over.value)
        wait = 86_400 - int(time.time()) % 86_400 if over.until_midnight else 10
        raise Problem(429, str(error), errors=[error], headers={"Retry-After": str(wait)}) from None
    except KeyReused:
        error = FieldError("Idempotency-Key", "new, or sent with the order it was made for", key)
        raise Problem(422, str(error), errors=[error]) from None
    response.headers["Location"] = f"{base}/jobs/{job.id}"
    if "respond-async" in request.headers.get("prefer", ""):
        response.headers["Preference-Applied"] = "respond-async"
    return status_info(job, base)


def quota_of(settings: Settings) -> Quota | None:
    """Return what a tenant may order; None where everybody is the same one."""
    if settings.auth == "none":
        return None
    return Quota(jobs=settings.tenant_max_jobs, cells_per_day=settings.tenant_cells_per_day)


def digest_of(job: JobRecord) -> str:
    """Return the digest of what was ordered."""
    ordered = [job.process, job.dataset, dict(job.inputs)]
    return hashlib.sha256(json.dumps(ordered, sort_keys=True).encode()).hexdigest()


def _known(process_id: str) -> None:
    if process_id not in processes.names():
        raise Problem(404, "no such process", type_=NO_SUCH_PROCESS)


def _wanted_outputs(process_id: str, outputs: dict[str, Any] | None) -> None:
    made = processes.description(process_id)["outputs"]
    unknown = [name for name in outputs or {} if name not in made]
    if unknown:
        limit = f"left out: the outputs are {', '.join(made)}"
        raise invalid(*(FieldError(f"outputs.{name}", limit, name) for name in unknown))


def _link(rel: str, href: str) -> dict[str, str]:
    return {"rel": rel, "type": "application/json", "href": href}
