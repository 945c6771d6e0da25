"""What the routes of one application share, built once at start."""

from dataclasses import dataclass
from typing import Annotated, cast

from fastapi import Depends, Request

from adret_service.datasets import DatasetCatalogue
from adret_service.engine.port import JobEngine
from adret_service.ingest import Ingest
from adret_service.settings import Settings
from adret_service.storage import Storage

__all__ = ["Service", "ServiceDep", "Tenant", "base_url"]


@dataclass(frozen=True, slots=True)
class Service:
    """The parts of a running service."""

    settings: Settings
    engine: JobEngine
    catalogue: DatasetCatalogue
    storage: Storage
    ingest: Ingest


def service_of(request: Request) -> Service:
    """Return the application's parts."""
    return cast(Service, request.app.state.service)


def tenant_of(request: Request) -> str:
    """Return whose things this request may see: one tenant as long as nobody signs in."""
    return "local"


def base_url(request: Request) -> str:
    """Return the absolute URL of the landing page, without a slash at its end."""
    configured = service_of(request).settings.base_url
    return (configured or str(request.base_url)).rstrip("/")


ServiceDep = Annotated[Service, Depends(service_of)]
Tenant = Annotated[str, Depends(tenant_of)]
BaseUrl = Annotated[str, Depends(base_url)]
