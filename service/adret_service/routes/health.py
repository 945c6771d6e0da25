"""Liveness, readiness, and what the service counts."""

import logging
from typing import Any

from fastapi import APIRouter, Request, Response
from prometheus_client import CONTENT_TYPE_LATEST

from adret_service.context import ServiceDep
from adret_service.metrics import exposition
from adret_service.problems import Problem
from adret_service.watchers import Watcher

router = APIRouter(tags=["health"])

log = logging.getLogger("adret.service")

SOON = {"Retry-After": "2"}


@router.get("/healthz", operation_id="getLiveness")
def liveness() -> dict[str, str]:
    """Say that the process answers; looks at nothing."""
    return {"status": "ok"}


@router.get("/readyz", operation_id="getReadiness")
def readiness(service: ServiceDep) -> dict[str, Any]:
    """Say whether a job sent now would be run.

    The database takes a write, the store gives back what it is given, there is room, and a worker
    lives.
    """
    health = service.engine.health()
    try:
        service.storage.probe()
    except Exception as error:
        log.error("the store does not answer: %s", error)
        raise Problem(503, "the store does not answer", headers=SOON) from None
    free = service.storage.free_bytes()
    if free < service.settings.min_free_bytes:
        raise Problem(503, f"free space: must be {service.settings.min_free_bytes}, got {free}")
    if health.workers < 1:
        raise Problem(503, "workers: must be at least 1 alive, got 0", headers=SOON)
    return {
        "status": "ready",
        "database": "ok",
        "storage": "ok",
        "workers": health.workers,
        "waiting": health.waiting,
        "running": health.running,
        "free_bytes": free,
    }


@router.get(
    "/metrics",
    operation_id="getMetrics",
    response_class=Response,
    responses={200: {"description": "Metrics.", "content": {"text/plain": {}}}},
)
def metrics(request: Request, service: ServiceDep, watcher: Watcher) -> Response:
    """Return what is counted, as Prometheus reads it.

    Where the service asks for keys, this asks for one of the scope metrics.
    """
    registry = request.app.state.requests.registry
    database = service.catalogue.database
    text = exposition(registry, service.engine, database, service.storage)
    return Response(text, media_type=CONTENT_TYPE_LATEST)
