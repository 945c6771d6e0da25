"""What an order would cost, and whether it would be taken: a dry run."""

from typing import Any

from anyio.to_thread import run_sync
from fastapi import APIRouter

from adret_service.context import BaseUrl, Service, ServiceDep, Tenant
from adret_service.datasets import Dataset
from adret_service.documents import Estimate
from adret_service.engine.port import JobFilter, JobStatus
from adret_service.estimate import cost, seconds
from adret_service.examples import EXECUTIONS
from adret_service.orders import Execute
from adret_service.problems import Problem
from adret_service.routes.datasets import require_room
from adret_service.routes.execution import checked, known_process, quota_of

router = APIRouter(tags=["processes"])

LEARNT = 50  # earlier jobs that are looked at


@router.post(
    "/processes/{process_id}/estimate",
    operation_id="estimate",
    response_model=Estimate,
    response_model_exclude_unset=True,
    openapi_extra={
        "requestBody": {"content": {"application/json": {"examples": EXECUTIONS}}},
    },
)
async def estimate(
    process_id: str, order: Execute, service: ServiceDep, tenant: Tenant, base: BaseUrl
) -> dict[str, Any]:
    """Say what an order would cost, without placing it: cells, passes, bytes, seconds.

    The time has a range, and what it rests on: your own earlier jobs of this process, or the
    built-in line. An order that could not be run is refused as it would be.
    """
    process = known_process(service, process_id)
    _, inputs, dataset = await checked(service, process, order, tenant, base)
    if dataset is None:
        expected = float(inputs.get("pause", 0.0))
        time = {"expected": expected, "low": expected, "high": expected, "basis": "the inputs"}
        return {"process": process_id, "cells": 0, "passes": 0, "seconds": time, "accepted": True}
    return await run_sync(estimated, service, process_id, inputs, dataset, tenant)


def estimated(
    service: Service, process_id: str, inputs: dict[str, Any], dataset: Dataset, tenant: str
) -> dict[str, Any]:
    """Return what a checked order would cost."""
    found = cost(process_id, inputs, dataset.info)
    done = JobFilter(statuses=frozenset({JobStatus.SUCCESSFUL}), processes=frozenset({process_id}))
    earlier = service.engine.list(tenant, done, limit=LEARNT)
    body: dict[str, Any] = {
        "process": process_id,
        "cells": found.cells,
        "passes": found.passes,
        "bands": found.bands,
        "result_bytes": found.result_bytes,
        "memory_bytes": found.memory_bytes,
        "threads": service.settings.threads,
        "seconds": seconds(found.core_seconds, service.settings.threads, earlier),
        "waiting": service.engine.waiting(),
        "waited_for": found.cells <= service.settings.sync_max_cells,
        "accepted": True,
    }
    try:
        require_room(service)
        if body["waiting"] >= service.settings.queue_max:
            raise Problem(503, f"queue: must be below {service.settings.queue_max} waiting jobs")
        quota = quota_of(service.settings)
        if quota is not None and found.cells > quota.cells_per_day:
            raise Problem(429, f"cells: must be at most {quota.cells_per_day} in a day")
    except Problem as problem:
        body |= {"accepted": False, "reason": problem.detail, "status": problem.status}
    return body
