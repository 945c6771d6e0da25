"""What the routes of one application share, built once at start; and who asks."""

import math
from dataclasses import dataclass
from typing import Annotated, cast

from fastapi import Depends, Request, Response
from fastapi.security import APIKeyHeader, APIKeyQuery, HTTPAuthorizationCredentials, HTTPBearer
from starlette.datastructures import Headers
from starlette.requests import Request as PlainRequest

from adret_service.auth import LOCAL, Credential, KeyFile
from adret_service.datasets import Dataset, DatasetCatalogue
from adret_service.engine.port import JobEngine, JobRecord
from adret_service.ingest import Ingest
from adret_service.lookup import Lookup
from adret_service.problems import Problem, unknown_key
from adret_service.queue_length import QueueLength
from adret_service.rates import Buckets
from adret_service.resuming import Partials
from adret_service.settings import Settings
from adret_service.storage import Storage
from adret_service.tokens import TokenMaker
from adret_service.viewers import Viewers

__all__ = ["Service", "ServiceDep", "Tenant", "base_url"]

BEARER = HTTPBearer(auto_error=False, description="An API key, where the service asks for one.")
HEADER = APIKeyHeader(name="X-API-Key", auto_error=False, description="The same.")
TOKEN = APIKeyQuery(name="token", auto_error=False, description="For maps: of a TileJSON document.")
READING = ("GET", "HEAD")


@dataclass(frozen=True, slots=True)
class Service:
    """The parts of a running service; `keys` and `rates` are None where everybody may ask."""

    settings: Settings
    engine: JobEngine
    catalogue: DatasetCatalogue
    storage: Storage
    ingest: Ingest
    viewers: Viewers
    partials: Partials
    jobs: Lookup[JobRecord]
    datasets: Lookup[Dataset]
    queue: QueueLength
    keys: KeyFile | None = None
    rates: dict[str, Buckets] | None = None
    tokens: TokenMaker | None = None


# What every request needs is `async`: FastAPI sends each plain function to a thread, which takes
# longer than what these do.


async def service_of(request: Request) -> Service:
    """Return the application's parts."""
    return parts(request)


def parts(request: PlainRequest) -> Service:
    """Return the application's parts."""
    return cast(Service, request.app.state.service)


async def credential_of(
    request: Request,
    response: Response,
    bearer: Annotated[HTTPAuthorizationCredentials | None, Depends(BEARER)],
    header: Annotated[str | None, Depends(HEADER)],
    token: Annotated[str | None, Depends(TOKEN)],
) -> Credential:
    """Return who asks, if that one may, and not too often; see `admitted`."""
    secret = header if bearer is None else bearer.credentials
    found, headers = admitted(request, secret, token)
    response.headers.update(headers)
    return found


def secret_of(headers: Headers) -> str | None:
    """Return the key that a request names in its headers."""
    scheme, _, bearer = headers.get("authorization", "").partition(" ")
    return bearer if bearer and scheme.lower() == "bearer" else headers.get("x-api-key")


def admitted(
    request: PlainRequest, secret: str | None, token: str | None
) -> tuple[Credential, dict[str, str]]:
    """Return who asks, if that one may, and not too often; and headers for the answer.

    Raises
    ------
    Problem
        401 without a key that is known, 403 for a key that may not, 429 for one that asks too
        often.
    """
    service = parts(request)
    if service.keys is None:
        return LOCAL, {}
    found = None if secret is None else service.keys.find(secret)
    if secret is None and token is not None and service.tokens is not None:
        found = service.tokens.find(token, request.url.path)
    if found is None:
        raise unknown_key(secret)
    scope = "read" if request.method in READING else "submit"
    if scope not in found.scopes:
        raise Problem(403, f"this key's scopes: must have {scope}, got {sorted(found.scopes)}")
    if service.rates is None:
        return found, {}
    bucket = "api" if scope == "read" else "submit"
    if "/tiles/" in request.url.path:
        bucket = "tiles"
    return found, _count(service.rates[bucket], found.id)


def _count(buckets: Buckets, name: str) -> dict[str, str]:
    left, wait = buckets.take(name)
    rate = buckets.rate
    headers = {
        "RateLimit-Policy": f'"default";q={rate.count};w={math.ceil(rate.seconds)}',
        "RateLimit": f'"default";r={left};t={math.ceil(wait or rate.seconds / rate.count)}',
    }
    if wait > 0.0:
        detail = f"requests: must be at most {rate.count} in {rate.seconds:g} s"
        raise Problem(429, detail, headers=headers | {"Retry-After": str(math.ceil(wait))})
    return headers


async def tenant_of(credential: Annotated[Credential, Depends(credential_of)]) -> str:
    """Return whose things this request may see."""
    return credential.tenant


async def base_url(request: Request) -> str:
    """Return the absolute URL of the landing page, without a slash at its end."""
    return base_of(request)


def base_of(request: PlainRequest) -> str:
    """Return the absolute URL of the landing page, without a slash at its end."""
    configured = parts(request).settings.base_url
    return (configured or str(request.base_url)).rstrip("/")


ServiceDep = Annotated[Service, Depends(service_of)]
Tenant = Annotated[str, Depends(tenant_of)]
BaseUrl = Annotated[str, Depends(base_url)]
