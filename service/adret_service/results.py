"""Results in the forms of OGC API - Processes: one document, or raw outputs, by value or reference.

Where an order does not say how it wants an output: in a document a file is a reference and JSON a
value; raw, everything is a value. A file too large for a document is a reference there, always.
"""

import base64
import json
import secrets
from collections.abc import Iterator, Mapping
from typing import Any

from fastapi import Request, Response
from starlette.responses import JSONResponse, StreamingResponse

from adret_service.artefacts import serve_artefact
from adret_service.engine.port import JobRecord
from adret_service.status import RESULTS
from adret_service.storage import Artefact, Storage

__all__ = ["document", "file_name", "results_response"]

Modes = dict[str, str | None]


def results_response(
    job: JobRecord,
    artefacts: Mapping[str, Artefact],
    storage: Storage,
    base: str,
    limit: int,
    request: Request,
) -> Response:
    """Return a job's results as they were ordered."""
    if job.request.get("response") != "raw":
        return JSONResponse(document(job, artefacts, storage, base, limit))
    modes = {name: mode or "value" for name, mode in _wanted(job, artefacts).items()}
    by_value = [name for name, mode in modes.items() if mode == "value"]
    if not by_value:
        links = [_link_header(job, name, artefacts[name], base) for name in modes]
        return Response(status_code=204, headers={"Link": ", ".join(links)} if links else None)
    if len(modes) == 1:
        (name,) = by_value
        return serve_artefact(request, storage, artefacts[name], file_name(job, artefacts[name]))
    boundary = f"adret-{secrets.token_hex(16)}"
    first = artefacts[next(iter(modes))].media_type.split(";")[0]
    return StreamingResponse(
        _parts(job, artefacts, storage, base, modes, boundary),
        media_type=f'multipart/related; boundary={boundary}; type="{first}"',
    )


def document(
    job: JobRecord, artefacts: Mapping[str, Artefact], storage: Storage, base: str, limit: int
) -> dict[str, Any]:
    """Return the results document: each output a value, or a link.

    Parameters
    ----------
    job : JobRecord
        A successful job.
    artefacts : mapping of str to Artefact
        Its outputs by name.
    storage : Storage
        Where they are.
    base : str
        Absolute URL of the service.
    limit : int
        Largest file that may become a value [bytes].
    """
    found: dict[str, Any] = {}
    for name, mode in _wanted(job, artefacts).items():
        artefact = artefacts[name]
        value = mode == "value" or (mode is None and is_json(artefact))
        if value and artefact.size <= limit:
            found[name] = _inline(artefact, b"".join(storage.read(artefact.key)))
        else:
            found[name] = reference(job, name, artefact, base)
    return found


def reference(job: JobRecord, name: str, artefact: Artefact, base: str) -> dict[str, Any]:
    """Return one output as a link."""
    return {
        "href": f"{base}/jobs/{job.id}/results/{name}",
        "type": artefact.media_type,
        "length": artefact.size,
        "sha256": artefact.sha256,
    }


def file_name(job: JobRecord, artefact: Artefact) -> str:
    """Return the name under which a browser keeps an output."""
    return f"{job.id}-{artefact.key.rsplit('-', 1)[-1]}"


def is_json(artefact: Artefact) -> bool:
    """Whether an output is a JSON value."""
    return artefact.media_type.startswith("application/json")


def _wanted(job: JobRecord, artefacts: Mapping[str, Artefact]) -> Modes:
    ordered: Modes | None = job.request.get("outputs")
    if ordered is None:
        return dict.fromkeys(artefacts)
    return {name: mode for name, mode in ordered.items() if name in artefacts}


def _inline(artefact: Artefact, content: bytes) -> Any:
    if is_json(artefact):
        value = json.loads(content)
        if isinstance(value, dict) and "bbox" not in value:
            return {"value": value, "mediaType": "application/json"}
        return value
    return {
        "value": base64.b64encode(content).decode("ascii"),
        "mediaType": artefact.media_type,
        "encoding": "base64",
    }


def _link_header(job: JobRecord, name: str, artefact: Artefact, base: str) -> str:
    href = f"{base}/jobs/{job.id}/results/{name}"
    media = artefact.media_type.replace('"', "")
    return f'<{href}>; rel="{RESULTS}"; title="{name}"; type="{media}"'


def _parts(
    job: JobRecord,
    artefacts: Mapping[str, Artefact],
    storage: Storage,
    base: str,
    modes: Mapping[str, str],
    boundary: str,
) -> Iterator[bytes]:
    for name, mode in modes.items():
        artefact = artefacts[name]
        size = artefact.size if mode == "value" else 0
        headers = {
            "Content-Type": artefact.media_type,
            "Content-ID": name,
            "Content-Location": f"{base}/jobs/{job.id}/results/{name}",
            "Content-Length": str(size),
        }
        if mode == "value":
            del headers["Content-Location"]
        lines = "".join(f"{key}: {value}\r\n" for key, value in headers.items())
        yield f"--{boundary}\r\n{lines}\r\n".encode()
        if mode == "value":
            yield from storage.read(artefact.key)
        yield b"\r\n"
    yield f"--{boundary}--\r\n".encode()
