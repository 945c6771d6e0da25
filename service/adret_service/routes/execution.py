"""Orders: a process is executed in a worker, and its client comes back for it or waits."""

import hashlib
import json
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial
from typing import Annotated, Any

import anyio
from anyio.to_thread import run_sync
from fastapi import APIRouter, Header, Request, Response
from fastapi.exceptions import RequestValidationError
from pydantic import ValidationError
from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.responses import JSONResponse
from starlette.routing import Match
from starlette.types import Scope

from adret_service.context import Service, Tenant, admitted, base_of, parts, secret_of
from adret_service.datasets import Dataset
from adret_service.documents import StatusInfo
from adret_service.engine.port import JobRecord, KeyReused, OverQuota, Quota, RequestKey
from adret_service.estimate import cost
from adret_service.examples import EXECUTIONS
from adret_service.ids import new_id
from adret_service.offers import offered
from adret_service.orders import Execute, checked_request
from adret_service.outbound import Outbound
from adret_service.prefer import preferences
from adret_service.problems import NO_SUCH_PROCESS, UNPARSED, FieldError, Problem, invalid, missing
from adret_service.processes import Process
from adret_service.references import resolved
from adret_service.results import results_response
from adret_service.routes.datasets import require_room
from adret_service.routes.frequent import Plain
from adret_service.settings import Settings
from adret_service.status import artefacts_of, status_info
from adret_service.tracing import traceparent

router = APIRouter(tags=["processes"])

LOOKS = (0.02, 0.25)  # seconds between looks at a job that somebody waits for: first, and later
ORDERED: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "The results, where the client waited for them: a document, one raw "
        "output, or several as multipart/related.",
        "content": {
            "application/json": {},
            "image/tiff": {},
            "image/png": {},
            "multipart/related": {},
        },
    },
    201: {"model": StatusInfo, "description": "The job, in a queue; `Location` is its address."},
    204: {"description": "The results are all references, in `Link` headers."},
    206: {"description": "The bytes of one range, of a raw output."},
    304: {"description": "The client has this raw output already."},
}


def _callback(member: str, schema: str) -> dict[str, Any]:
    """Describe the request that a subscriber gets."""
    reference = {"schema": {"$ref": f"#/components/schemas/{schema}"}}
    told = {
        "requestBody": {"content": {"application/json": reference}},
        "responses": {"2XX": {"description": "Heard; anything else is sent again."}},
    }
    return {f"{{$request.body#/subscriber/{member}}}": {"post": told}}


@router.post(
    "/processes/{process_id}/execution",
    status_code=201,
    operation_id="execute",
    response_class=JSONResponse,
    response_model=None,
    responses=ORDERED,
    openapi_extra={
        "requestBody": {"content": {"application/json": {"examples": EXECUTIONS}}},
        "callbacks": {
            name: _callback(member, schema)
            for name, member, schema in (
                ("jobCompleted", "successUri", "Results"),
                ("jobInProgress", "inProgressUri", "StatusInfo"),
                ("jobFailed", "failedUri", "StatusInfo"),
            )
        },
    },
)
async def execute_process(
    process_id: str,
    order: Execute,
    request: Request,
    response: Response,
    tenant: Tenant,
    key: Annotated[
        str | None,
        Header(
            alias="Idempotency-Key",
            min_length=1,
            max_length=255,
            description="A name for this order: sent again, it is answered with the same job.",
        ),
    ] = None,
    prefer: Annotated[
        list[str] | None,
        Header(
            description="respond-async: do not wait. wait=10: wait so many seconds for the "
            "results of a small order, and answer with its job only then.",
        ),
    ] = None,
) -> Response:
    """Order a computation.

    It runs in a worker, and `Location` is its job. A process that offers sync-execute is waited for
    unless `Prefer` says otherwise; any other small order is waited for if `Prefer` asks for it.
    Whoever waits in vain gets the job.
    """
    headers = {k: v for k, v in response.headers.items() if k.startswith("ratelimit")}
    return await executed(process_id, order, request, tenant, key, prefer or [], headers)


async def execute_plainly(request: Request) -> Response:
    """Order a computation: what `execute_process` answers, without the framework's ceremony.

    Raises
    ------
    RequestValidationError
        For a body that is no order, as FastAPI does.
    """
    credential, headers = admitted(
        request, secret_of(request.headers), request.query_params.get("token")
    )
    body = await request.body()
    try:
        order = Execute.model_validate(json.loads(body))
    except json.JSONDecodeError as error:
        where = {"type": "json_invalid", "loc": ("body", error.pos), "msg": error.msg}
        raise RequestValidationError([where | {"ctx": {"error": error.msg}}]) from None
    except ValidationError as error:
        entries = error.errors(include_url=False)
        raise RequestValidationError(
            [{**entry, "loc": ("body", *entry["loc"])} for entry in entries]
        ) from None
    except (ValueError, RecursionError):  # bytes that are no text, deep nesting
        raise HTTPException(400, UNPARSED) from None
    return await executed(
        str(request.path_params["process_id"]),
        order,
        request,
        credential.tenant,
        request.headers.get("idempotency-key"),
        request.headers.getlist("prefer"),
        headers,
    )


class Ordinary(Plain):
    """The route of orders as clients send them; FastAPI's own says what is wrong with others."""

    def matches(self, scope: Scope) -> tuple[Match, Scope]:
        """Return whether this is the route, and what to add to the scope."""
        match, child = super().matches(scope)
        if match is Match.NONE:
            return match, child
        headers = Headers(scope=scope)
        length = headers.get("content-length", "")
        key = headers.get("idempotency-key", "-")
        ordinary = (
            headers.get("content-type") == "application/json"
            and length.isdigit()
            and int(length) > 0
            and 0 < len(key) < 256
        )
        return (match, child) if ordinary else (Match.NONE, {})


ORDINARY = Ordinary("/processes/{process_id}/execution", execute_plainly, methods=["POST"])


async def executed(
    process_id: str,
    order: Execute,
    request: Request,
    tenant: str,
    key: str | None,
    prefer: list[str],
    headers: dict[str, str],
) -> Response:
    """Have an order accepted, wait for its end if that is wanted, and answer."""
    service, base = parts(request), base_of(request)
    process = known_process(service, process_id)
    preferred = preferences(prefer)
    what = await checked(service, process, order, tenant, base)
    place = partial(placed, service, process, order, tenant, base, request, key, what)
    job, cells = await run_sync(place)
    seconds = patience(process, cells, preferred, service.settings)
    if seconds is not None:
        async with turn(request, service.settings) as granted:
            ended = await until_finished(service, job, seconds) if granted else None
        if ended is not None:
            if "wait" in preferred:
                headers["Preference-Applied"] = f"wait={preferred['wait']}"
            headers["Link"] = f"<{base}/jobs/{job.id}>; rel=monitor"
            return await run_sync(partial(answer, service, ended, base, request, headers))
        found = await run_sync(service.engine.get, job.id, tenant)
        job = job if found is None else found
    elif "respond-async" in preferred:
        headers["Preference-Applied"] = "respond-async"
    headers["Location"] = f"{base}/jobs/{job.id}"
    return JSONResponse(status_info(job, base), 201, headers)


def placed(
    service: Service,
    process: Process,
    order: Execute,
    tenant: str,
    base: str,
    request: Request,
    key: str | None,
    what: tuple[str, dict[str, Any], Dataset | None],
) -> tuple[JobRecord, int]:
    """Have a checked order accepted; returns its job and the cells it is about."""
    dataset, inputs, found = what
    outbound = Outbound(
        service.settings.webhook_hosts, allow_private=service.settings.webhook_allow_private
    )
    wanted = checked_request(order, process, outbound)
    require_room(service)
    waiting = service.queue.now()
    if waiting >= service.settings.queue_max:
        detail = f"queue: must be below {service.settings.queue_max} waiting jobs, got {waiting}"
        raise Problem(503, detail, headers={"Retry-After": "30"})
    cells = cells_of(found)
    ordered = [process.id, dataset, inputs, wanted]
    digest = hashlib.sha256(json.dumps(ordered, sort_keys=True).encode()).hexdigest()
    kept = wanted | {
        "base": base,
        "request_id": request.scope.get("request_id", ""),
        "traceparent": traceparent(),
    }
    if found is not None:
        line = cost(process.id, inputs, found.info).core_seconds / service.settings.threads
        kept["cells"] = cells
        kept["line"] = round(line, 6)  # seconds by the built-in line: later estimates learn from it
    job = JobRecord(
        id=new_id(),
        tenant=tenant,
        process=process.id,
        dataset=dataset,
        inputs=inputs,
        request=kept,
    )
    named = None if key is None else RequestKey(key=key, digest=digest)
    try:
        quota = quota_of(service.settings)
        job = service.engine.submit(job, named, cells=cells, quota=quota)
        service.queue.one_more()
    except LookupError:
        raise invalid(unknown_dataset(dataset)) from None
    except OverQuota as over:
        error = FieldError(over.field, over.limit, over.value)
        wait = 86_400 - int(time.time()) % 86_400 if over.until_midnight else 10
        raise Problem(429, str(error), errors=[error], headers={"Retry-After": str(wait)}) from None
    except KeyReused:
        error = FieldError("Idempotency-Key", "new, or sent with the order it was made for", key)
        raise Problem(422, str(error), errors=[error]) from None
    return job, cells


async def checked(
    service: Service, process: Process, order: Execute, tenant: str, base: str
) -> tuple[str, dict[str, Any], Dataset | None]:
    """Return the dataset's id, the inputs and the dataset of an order that could be run."""
    inputs = resolved(order.inputs, base, process.objects)
    dataset, checked_inputs = process.validate(inputs)
    if process.reads is None:
        return dataset, checked_inputs, None
    found = await service.datasets.get(dataset)
    if found is None or found.tenant != tenant:
        raise invalid(unknown_dataset(dataset))
    kind = found.info.get("kind", "terrain")
    if kind != process.reads:
        limit = f"a dataset of kind {process.reads}"
        raise invalid(FieldError("inputs.dataset", limit, f"one of kind {kind}"))
    return dataset, checked_inputs, found


def unknown_dataset(dataset: str) -> FieldError:
    """Return the refusal of a dataset that is not there, or not this tenant's."""
    return FieldError("inputs.dataset", "the id of an existing dataset", dataset)


def cells_of(dataset: Dataset | None) -> int:
    """Return the cells of a dataset, none of none."""
    return 0 if dataset is None else int(dataset.info["rows"]) * int(dataset.info["columns"])


def known_process(service: Service, process_id: str) -> Process:
    """Return the process or answer 404."""
    process = offered(echo=service.settings.enable_echo).get(process_id)
    if process is None:
        raise missing("process", process_id, NO_SUCH_PROCESS)
    return process


def quota_of(settings: Settings) -> Quota | None:
    """Return what a tenant may order; None where everybody is the same one."""
    if settings.auth == "none":
        return None
    return Quota(jobs=settings.tenant_max_jobs, cells_per_day=settings.tenant_cells_per_day)


def patience(
    process: Process, cells: int, preferred: dict[str, str], settings: Settings
) -> float | None:
    """Return how long to wait for an order's end [s]; None to answer with its job at once."""
    wanted = preferred.get("wait", "")
    if wanted.isascii() and wanted.isdigit() and len(wanted) < 10:
        return None if cells > settings.sync_max_cells else min(float(wanted), settings.sync_wait)
    if "respond-async" in preferred or "sync-execute" not in process.control:
        return None
    return settings.sync_wait


@asynccontextmanager
async def turn(request: Request, settings: Settings) -> AsyncIterator[bool]:
    """Yield whether one more client may wait now; only so many may at a time."""
    state = request.app.state
    granted = getattr(state, "waiting", 0) < settings.sync_slots
    state.waiting = getattr(state, "waiting", 0) + granted
    try:
        yield granted
    finally:
        state.waiting -= granted


async def until_finished(service: Service, job: JobRecord, seconds: float) -> JobRecord | None:
    """Return the job once it has ended, or None if it has not within so many seconds."""
    deadline = time.monotonic() + seconds
    pause, longest = LOOKS
    while True:
        found = await run_sync(service.engine.get, job.id, job.tenant)
        if found is None or found.is_finished:
            return found
        left = deadline - time.monotonic()
        if left <= 0.0:
            return None
        await anyio.sleep(min(pause, left))
        pause = min(1.5 * pause, longest)


def answer(
    service: Service, job: JobRecord, base: str, request: Request, headers: dict[str, str]
) -> Response:
    """Return the results of a job that has ended, or raise what became of it."""
    try:
        artefacts = artefacts_of(service.storage, job)
    except Problem as problem:
        problem.headers = {**(problem.headers or {}), **headers}
        raise
    limit = service.settings.inline_max_bytes
    made = results_response(job, artefacts, service.storage, base, limit, request)
    for name, value in headers.items():
        made.headers.append(name, value)
    return made
