"""Resumable uploads by tus 1.0: core, creation, termination, checksum, expiration."""

import base64
import binascii
import hashlib
from email.utils import formatdate
from typing import Annotated, Any

from anyio.to_thread import run_sync
from fastapi import APIRouter, Depends, Header, Query, Request, Response
from starlette.requests import ClientDisconnect

from adret_service.context import BaseUrl, ServiceDep, Tenant
from adret_service.documents import UploadState
from adret_service.ingest import ReadOptions
from adret_service.problems import FieldError, Problem, invalid, too_large
from adret_service.receiving import Received, pieces_of, safe_name
from adret_service.resuming import CHECKSUMS, Partial, append
from adret_service.routes.datasets import require_room
from adret_service.storage import UPLOAD, digest

VERSION = "1.0.0"
EXTENSIONS = "creation,termination,checksum,expiration"
PIECE = "application/offset+octet-stream"
MAX_LENGTH = 2**53


def spoken(
    request: Request,
    response: Response,
    version: Annotated[str | None, Header(alias="Tus-Resumable", description=f"{VERSION}.")] = None,
) -> None:
    """Say which version of the protocol this is, and refuse any other."""
    response.headers["Tus-Resumable"] = VERSION
    if version != VERSION:
        error = FieldError("Tus-Resumable", VERSION, version)
        headers = {"Tus-Version": VERSION, "Tus-Resumable": VERSION}
        raise Problem(412, str(error), errors=[error], headers=headers)


router = APIRouter(tags=["datasets"])
Spoken = [Depends(spoken)]


@router.options("/uploads/tus", status_code=204, operation_id="getTusOptions")
def options(service: ServiceDep, tenant: Tenant, response: Response) -> None:
    """Say what of the tus protocol is understood."""
    response.headers.update(
        {
            "Tus-Resumable": VERSION,
            "Tus-Version": VERSION,
            "Tus-Extension": EXTENSIONS,
            "Tus-Max-Size": str(service.settings.max_upload_bytes),
            "Tus-Checksum-Algorithm": ",".join(CHECKSUMS),
        }
    )


@router.post("/uploads/tus", status_code=201, operation_id="createTusUpload", dependencies=Spoken)
def create(
    response: Response,
    service: ServiceDep,
    tenant: Tenant,
    base: BaseUrl,
    read_as: Annotated[ReadOptions, Query()],
    length: Annotated[int, Header(alias="Upload-Length", ge=1, le=MAX_LENGTH)],
    metadata: Annotated[
        str,
        Header(
            alias="Upload-Metadata",
            max_length=4096,
            description="filename and its base64 text; further pairs are not looked at.",
        ),
    ] = "",
) -> None:
    """Begin an upload in pieces; `Location` is where they go. The query says how to read it."""
    settings = service.settings
    if length > settings.max_upload_bytes:
        raise too_large("Upload-Length", f"at most {settings.max_upload_bytes} bytes", length)
    require_room(service)
    if settings.auth != "none":
        total = service.catalogue.stored_bytes(tenant) + length
        total += service.partials.waiting_bytes(tenant)
        if total > settings.tenant_max_bytes:
            raise too_large("bytes", f"at most {settings.tenant_max_bytes} in all", total)
    given = read_as.model_dump(exclude_none=True)
    partial = service.partials.create(tenant, length, file_name(metadata), given)
    response.headers["Location"] = f"{base}/uploads/tus/{partial.id}"
    tell(response, service, partial, 0)


@router.get(
    "/uploads/tus/{upload_id}",
    operation_id="getTusUpload",
    response_model=UploadState,
    response_model_exclude_unset=True,
)
def state(
    upload_id: str, response: Response, service: ServiceDep, tenant: Tenant, base: BaseUrl
) -> dict[str, Any]:
    """Say how much of an upload has come, and which dataset became of it."""
    partial = service.partials.find(upload_id, tenant)
    offset = service.partials.offset(partial)
    tell(response, service, partial, offset)
    body: dict[str, Any] = {"id": partial.id, "offset": offset, "length": partial.length}
    if partial.dataset is not None:
        body["dataset"] = partial.dataset
        href = f"{base}/datasets/{partial.dataset}"
        body["links"] = [{"rel": "item", "type": "application/json", "href": href}]
    return body


@router.head(
    "/uploads/tus/{upload_id}",
    status_code=200,
    operation_id="headTusUpload",
    dependencies=Spoken,
    response_class=Response,
)
def head(upload_id: str, response: Response, service: ServiceDep, tenant: Tenant) -> None:
    """Say how much of an upload has come."""
    partial = service.partials.find(upload_id, tenant)
    tell(response, service, partial, service.partials.offset(partial))
    response.headers["Cache-Control"] = "no-store"


@router.patch(
    "/uploads/tus/{upload_id}",
    status_code=204,
    operation_id="appendTusUpload",
    dependencies=Spoken,
    openapi_extra={"requestBody": {"required": True, "content": {PIECE: {"schema": {}}}}},
)
async def add_piece(
    upload_id: str,
    request: Request,
    response: Response,
    service: ServiceDep,
    tenant: Tenant,
    base: BaseUrl,
    offset: Annotated[int, Header(alias="Upload-Offset", ge=0, le=MAX_LENGTH)],
    checksum: Annotated[str | None, Header(alias="Upload-Checksum", max_length=200)] = None,
) -> None:
    """Add a piece; after the last one the file is read, and `Content-Location` is its dataset."""
    kind = request.headers.get("content-type", "")
    if kind.split(";")[0].strip().lower() != PIECE:
        error = FieldError("content-type", PIECE, kind)
        raise Problem(415, str(error), errors=[error])
    promised = checksum_of(checksum)
    partials = service.partials
    partial = await run_sync(partials.find, upload_id, tenant)
    if partial.dataset is not None:
        raise wrong_offset(partial.length, offset)
    require_room(service)
    with partials.writing(partial) as file:
        here = partials.offset(partial)
        if offset != here:
            raise wrong_offset(here, offset)
        pieces = pieces_of(request, service.settings.upload_idle)
        try:
            now = await append(file, pieces, offset, partial.length, promised)
        except ClientDisconnect:
            raise Problem(400, "the client went away; what came before is kept") from None
        if now == partial.length:
            dataset = await run_sync(finished, service, partial)
            response.headers["Content-Location"] = f"{base}/datasets/{dataset}"
            partial = await run_sync(partials.find, upload_id, tenant)
    tell(response, service, partial, now)


@router.delete(
    "/uploads/tus/{upload_id}",
    status_code=204,
    operation_id="deleteTusUpload",
    dependencies=Spoken,
)
def terminate(upload_id: str, service: ServiceDep, tenant: Tenant) -> None:
    """Give an upload up; a dataset that became of it stays."""
    partial = service.partials.find(upload_id, tenant)
    if partial.dataset is None:
        with service.partials.writing(partial):
            service.partials.remove(partial)
    else:
        service.partials.remove(partial)


def finished(service: ServiceDep, partial: Partial) -> str:
    """Read a complete upload into a dataset; one that cannot be read leaves nothing behind."""
    try:
        with service.ingest.folder() as folder:
            path = folder / UPLOAD
            path.hardlink_to(service.partials.folder(partial) / UPLOAD)
            sha256, size = digest(path)
            received = Received(path, partial.name, size, sha256)
            options = ReadOptions(**partial.options)
            dataset = service.ingest.register(partial.tenant, received, options)
    except Problem as problem:
        if problem.status not in (503, 507):
            service.partials.remove(partial)
        raise
    service.partials.finish(partial, dataset.id)
    return dataset.id


def tell(response: Response, service: ServiceDep, partial: Partial, offset: int) -> None:
    """Add the headers that every answer about an upload has."""
    response.headers["Tus-Resumable"] = VERSION
    response.headers["Upload-Offset"] = str(offset)
    response.headers["Upload-Length"] = str(partial.length)
    until = service.partials.expires(partial)
    response.headers["Upload-Expires"] = formatdate(until, usegmt=True)


def wrong_offset(here: int, given: int) -> Problem:
    """Build the 409 for a piece that does not begin where the last one ended."""
    error = FieldError("Upload-Offset", str(here), given)
    return Problem(409, str(error), errors=[error], headers={"Tus-Resumable": VERSION})


def file_name(metadata: str) -> str:
    """Return the name that a client gives its file, for people to read.

    Raises
    ------
    Problem
        400 if it is not base64.
    """
    for pair in metadata.split(","):
        key, _, value = pair.strip().partition(" ")
        if key == "filename":
            try:
                return safe_name(base64.b64decode(value, validate=True).decode("utf-8", "replace"))
            except (binascii.Error, ValueError):
                raise invalid(FieldError("Upload-Metadata", "base64 values", value)) from None
    return "upload"


def checksum_of(text: str | None) -> tuple[str, bytes] | None:
    """Return the algorithm and the digest that a piece must have.

    Raises
    ------
    Problem
        400 for an algorithm or a digest that is none.
    """
    if text is None:
        return None
    name, _, value = text.partition(" ")
    try:
        wanted = base64.b64decode(value, validate=True)
    except (binascii.Error, ValueError):
        wanted = b""
    if name not in CHECKSUMS or len(wanted) != hashlib.new(name).digest_size:
        limit = f"one of {', '.join(CHECKSUMS)} and a digest in base64"
        raise invalid(FieldError("Upload-Checksum", limit, text))
    return name, wanted
