"""The two questions that clients ask all the time, answered without the framework's ceremony.

FastAPI spends ten times as long on a request as these answers take. They are plain routes that
stand before the described ones, whose functions call them: one answer, whichever way it is reached.
"""

import hashlib
import json

from anyio.to_thread import run_sync
from starlette.convertors import Convertor, register_url_convertor
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Match, Route
from starlette.types import Scope

from adret_service.artefacts import serve_artefact
from adret_service.context import Service, admitted, base_of, parts, secret_of
from adret_service.engine.port import JobRecord
from adret_service.ids import is_id
from adret_service.problems import NO_SUCH_JOB, FieldError, Problem, missing
from adret_service.results import file_name
from adret_service.status import artefacts_of, status_info

__all__ = ["ROUTES", "answer_output", "answer_status", "known_job"]

ALIASES = {"preview.png": "preview", "result.tif": "result"}


class OutputName(Convertor[str]):
    """A name of an output; ``stac`` is a document beside them."""

    regex = r"(?!stac(?:/|$))[^/]+"

    def convert(self, value: str) -> str:
        """Return the name."""
        return value

    def to_string(self, value: str) -> str:
        """Return the name."""
        return value


register_url_convertor("output", OutputName())


class Plain(Route):
    """A route that tells which it was, as FastAPI's do: requests are counted by it."""

    def matches(self, scope: Scope) -> tuple[Match, Scope]:
        """Return whether this is the route, and what to add to the scope."""
        match, child = super().matches(scope)
        return match, {**child, "route": self} if match is Match.FULL else child


async def answer_status(request: Request) -> Response:
    """Say how far a job is; 304 to a client that knows it."""
    _, job, headers = await found(request)
    body = json.dumps(status_info(job, base_of(request)), separators=(",", ":")).encode()
    headers["ETag"] = etag = f'"{hashlib.sha256(body).hexdigest()[:32]}"'
    headers["Cache-Control"] = "private, no-cache"
    if not job.is_finished:
        headers["Retry-After"] = "1"
    known = request.headers.get("if-none-match", "").replace("W/", "")
    if known and etag in (tag.strip() for tag in known.split(",")):
        return Response(status_code=304, headers=headers)
    return Response(body, headers=headers, media_type="application/json")


async def answer_output(request: Request) -> Response:
    """Return the bytes of one output: whole, one range of them, or 304."""
    service, job, headers = await found(request)
    response = await run_sync(bytes_of, service, job, request)
    response.headers.update(headers)
    return response


def bytes_of(service: Service, job: JobRecord, request: Request) -> Response:
    """Return the answer with one output."""
    output = str(request.path_params["output"])
    artefacts = artefacts_of(service.storage, job)
    artefact = artefacts.get(ALIASES.get(output, output))
    if artefact is None:
        error = FieldError("output", f"one of {', '.join(artefacts)}", output)
        raise Problem(404, str(error), errors=[error])
    return serve_artefact(request, service.storage, artefact, file_name(job, artefact))


async def found(request: Request) -> tuple[Service, JobRecord, dict[str, str]]:
    """Return the service, the job that a request is about, and headers for its answer."""
    credential, headers = admitted(
        request, secret_of(request.headers), request.query_params.get("token")
    )
    service = parts(request)
    job = await known_job(service, str(request.path_params["job_id"]), credential.tenant)
    return service, job, headers


async def known_job(service: Service, job_id: str, tenant: str) -> JobRecord:
    """Return the job or answer 404."""
    job = await service.jobs.get(job_id) if is_id(job_id) else None
    if job is None or job.tenant != tenant:
        raise missing("job", job_id, NO_SUCH_JOB)
    return job


ROUTES = [
    Plain("/jobs/{job_id}", answer_status),
    Plain("/jobs/{job_id}/results/{output:output}", answer_output),
]
