"""Who may read what the service counts: it tells of all tenants."""

from typing import Annotated, cast

from fastapi import Depends, Request
from fastapi.security import HTTPAuthorizationCredentials

from adret_service.auth import METRICS
from adret_service.context import BEARER, HEADER, Service
from adret_service.problems import Problem, unknown_key

__all__ = ["Watcher"]


def watcher_of(
    request: Request,
    bearer: Annotated[HTTPAuthorizationCredentials | None, Depends(BEARER)],
    header: Annotated[str | None, Depends(HEADER)],
) -> str:
    """Return who asks, if that one may; answer 401 or 403 if not."""
    keys = cast(Service, request.app.state.service).keys
    if keys is None:
        return "local"
    secret = header if bearer is None else bearer.credentials
    found = None if secret is None else keys.find(secret)
    if found is None:
        raise unknown_key(secret)
    if METRICS not in found.scopes:
        raise Problem(403, f"this key's scopes: must have {METRICS}, got {sorted(found.scopes)}")
    return found.id


Watcher = Annotated[str, Depends(watcher_of)]
