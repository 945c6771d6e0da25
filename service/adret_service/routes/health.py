"""Liveness and readiness."""

from typing import Any

from fastapi import APIRouter

from adret_service.context import ServiceDep
from adret_service.problems import Problem

router = APIRouter(tags=["health"])


@router.get("/healthz", operation_id="getLiveness")
def liveness() -> dict[str, str]:
    """Say that the process answers; looks at nothing."""
    return {"status": "ok"}


@router.get("/readyz", operation_id="getReadiness")
def readiness(service: ServiceDep) -> dict[str, Any]:
    """Say whether a job sent now would be run: database, disk space and a live worker."""
    health = service.engine.health()
    free = service.storage.free_bytes()
    if free < service.settings.min_free_bytes:
        raise Problem(503, f"free space: must be {service.settings.min_free_bytes}, got {free}")
    if health.workers < 1:
        raise Problem(503, "workers: must be at least 1 alive, got 0", headers={"Retry-After": "2"})
    return {
        "status": "ready",
        "workers": health.workers,
        "waiting": health.waiting,
        "running": health.running,
        "free_bytes": free,
    }
