"""Errors of the service and their one way onto the wire.

Bodies follow RFC 9457 and are valid OGC API exceptions: ``type``, ``title``, ``status``,
``detail``, ``instance``, ``errors`` (each ``field``, ``limit``, ``value``) and ``request_id``.
Invalid input is 400, as OGC API - Processes asks, never 422.
"""

import errno
import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from sqlalchemy.exc import OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeout
from starlette.exceptions import HTTPException

from adret.errors import InputError

__all__ = [
    "FieldError",
    "Problem",
    "install",
    "invalid",
    "missing",
    "printable",
    "too_large",
    "unknown_key",
]

log = logging.getLogger("adret.service")

OGC = "http://www.opengis.net/def/exceptions/ogcapi-processes-1/1.0/"
NO_SUCH_PROCESS = OGC + "no-such-process"
NO_SUCH_JOB = OGC + "no-such-job"
RESULT_NOT_READY = OGC + "result-not-ready"
INVALID_INPUT = OGC + "invalid-parameter-value"

AGAIN = 5  # seconds until a request may be repeated
MAX_VALUE_TEXT = 200
UNPARSED = "There was an error parsing the body"  # FastAPI: bytes that are no text, deep nesting
TITLES = {460: "Checksum Mismatch"}  # a status of the tus protocol alone


@dataclass(frozen=True, slots=True)
class FieldError:
    """One refused value: the field's name, what it must be, and what was given."""

    field: str
    limit: str
    value: Any

    def body(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {"field": self.field, "limit": self.limit, "value": printable(self.value)}

    def __str__(self) -> str:
        """One line: field, limit and value."""
        return f"{self.field}: must be {self.limit}, got {printable(self.value)!r}"


class Problem(HTTPException):
    """An answer other than success, raised anywhere and rendered in one place.

    It is an `HTTPException` because FastAPI lets only those through while it reads a body.

    Parameters
    ----------
    status : int
        HTTP status.
    detail : str
        One sentence for a person.
    type_ : str
        URI of the kind of problem; "about:blank" means that the status says it all.
    errors : sequence of FieldError
        The refused values, all at once.
    headers : dict of str, optional
        Extra response headers, such as Retry-After.
    """

    def __init__(
        self,
        status: int,
        detail: str,
        *,
        type_: str = "about:blank",
        errors: Sequence[FieldError] = (),
        headers: dict[str, str] | None = None,
    ) -> None:
        super().__init__(status, detail, headers)
        self.status = status
        self.type = type_
        self.errors = tuple(errors)

    def __str__(self) -> str:
        """The sentence for a person."""
        return self.detail


def invalid(*errors: FieldError) -> Problem:
    """Build the 400 for refused values."""
    return Problem(400, "; ".join(map(str, errors)), type_=INVALID_INPUT, errors=errors)


def missing(what: str, value: str, type_: str = "about:blank") -> Problem:
    """Build the 404 for a job, process, dataset or upload that this caller does not have."""
    error = FieldError(what, f"the id of {'an' if what[0] in 'aeiou' else 'a'} {what}", value)
    return Problem(404, f"no such {what}: {printable(value)!r}", type_=type_, errors=[error])


def unknown_key(secret: str | None) -> Problem:
    """Build the 401 for a request without a key, or with one that is not known."""
    detail = "this service does not know that API key"
    if not secret:
        detail = "an API key is needed, as Authorization: Bearer ... or X-API-Key: ..."
    return Problem(401, detail, headers={"WWW-Authenticate": 'Bearer realm="adret"'})


def too_large(field: str, limit: str, value: Any) -> Problem:
    """Build the 413 for something above a limit of the service."""
    error = FieldError(field, limit, value)
    return Problem(413, str(error), errors=[error])


def printable(value: Any) -> Any:
    """Return `value` if JSON can carry it in a few bytes, else a shortened text of it."""
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, int) and abs(value) < 2**53:
        return value
    if isinstance(value, float) and math.isfinite(value):
        return value
    text = value if isinstance(value, str) else repr(value)
    text = text.encode("utf-8", "replace").decode("utf-8")
    return text if len(text) <= MAX_VALUE_TEXT else text[: MAX_VALUE_TEXT - 1] + "…"


def render(request: Request, problem: Problem) -> JSONResponse:
    """Turn a problem into its response."""
    wanted = request.headers.get("accept", "")
    media = "application/problem+json" if "application/problem+json" in wanted else None
    return JSONResponse(
        {
            "type": problem.type,
            "title": TITLES.get(problem.status) or HTTPStatus(problem.status).phrase,
            "status": problem.status,
            "detail": problem.detail,
            "instance": request.url.path,
            "errors": [error.body() for error in problem.errors],
            "request_id": request.scope.get("request_id", ""),
        },
        status_code=problem.status,
        headers=dict(problem.headers or {}),
        media_type=media,
    )


def from_validation(error: RequestValidationError) -> Problem:
    """Translate FastAPI's list of refused values."""
    return invalid(*(field_error(item) for item in error.errors()))


def field_error(item: Any) -> FieldError:
    """Translate one entry of pydantic's error list."""
    where = [str(part) for part in item["loc"]]
    if where and where[0] in ("body", "query", "path", "header") and len(where) > 1:
        where = where[1:]
    field = ".".join(where) or "body"
    kind, message = item["type"], str(item["msg"])
    if kind == "extra_forbidden":
        return FieldError(field, "left out: no such input", item["input"])
    if kind == "missing":
        return FieldError(field, "given", None)
    if kind == "json_invalid":
        return FieldError("body", "valid JSON", item.get("ctx", {}).get("error", message))
    lowered = message[:1].lower() + message[1:]
    for prefix in ("input should be ", "value error, "):
        lowered = lowered.removeprefix(prefix)
    return FieldError(field, lowered, item.get("input"))


def install(app: FastAPI) -> None:
    """Register the handlers: every error leaves through `render`."""

    def on_problem(request: Request, exc: Exception) -> JSONResponse:
        assert isinstance(exc, Problem)
        return render(request, exc)

    def on_input_error(request: Request, exc: Exception) -> JSONResponse:
        assert isinstance(exc, InputError)
        return render(request, invalid(FieldError(exc.field, exc.limit, exc.value)))

    def on_validation(request: Request, exc: Exception) -> JSONResponse:
        assert isinstance(exc, RequestValidationError)
        return render(request, from_validation(exc))

    def on_http(request: Request, exc: Exception) -> JSONResponse:
        assert isinstance(exc, HTTPException)
        if exc.detail == UNPARSED:
            error = FieldError("body", "JSON that can be parsed", "a body that cannot")
            return render(request, invalid(error))
        headers = dict(exc.headers) if exc.headers else None
        return render(request, Problem(exc.status_code, str(exc.detail), headers=headers))

    def on_full_disk(request: Request, exc: Exception) -> JSONResponse:
        if getattr(exc, "errno", None) in (errno.ENOSPC, errno.EDQUOT):
            return render(request, Problem(507, "the storage of the service is full"))
        return on_any(request, exc)

    def on_database(request: Request, exc: Exception) -> JSONResponse:
        if isinstance(exc, OperationalError) and "full" in str(exc.orig):
            return render(request, Problem(507, "the storage of the service is full"))
        log.error("the database does not answer: %s", str(exc).splitlines()[0])
        later = {"Retry-After": str(AGAIN)}
        return render(request, Problem(503, "the database does not answer", headers=later))

    def on_any(request: Request, exc: Exception) -> JSONResponse:
        log.error("unhandled error", exc_info=exc)
        return render(request, Problem(500, "the service failed; the request id finds the reason"))

    app.add_exception_handler(Problem, on_problem)
    app.add_exception_handler(InputError, on_input_error)
    app.add_exception_handler(RequestValidationError, on_validation)
    app.add_exception_handler(HTTPException, on_http)
    app.add_exception_handler(OSError, on_full_disk)
    app.add_exception_handler(OperationalError, on_database)
    app.add_exception_handler(PoolTimeout, on_database)
    app.add_exception_handler(Exception, on_any)
