"""Artefacts over HTTP: strong entity tags, 304, one byte range, flat memory."""

import re
from collections.abc import Iterator

from fastapi import Request, Response
from starlette.responses import StreamingResponse

from adret_service.problems import FieldError, Problem
from adret_service.storage import Artefact, Storage

__all__ = ["serve_artefact"]

AT_ONCE = 1 << 20  # bytes that are read before the answer begins: a stream costs more
_RANGE = re.compile(r"bytes=(\d{0,18})-(\d{0,18})")


def serve_artefact(
    request: Request, storage: Storage, artefact: Artefact, filename: str
) -> Response:
    """Answer GET or HEAD for a stored file, as RFC 9110 asks.

    Several ranges at once are answered with the whole file.

    Raises
    ------
    Problem
        412 if `If-Match` names another version, 416 for a range outside the file, 410 if the file
        is gone.
    """
    headers = {
        "ETag": artefact.etag,
        "Accept-Ranges": "bytes",
        "Cache-Control": "private, max-age=0, must-revalidate",
        "Content-Disposition": f'attachment; filename="{filename}"',
        "X-Content-Type-Options": "nosniff",
    }
    if not storage.exists(artefact.key):
        raise Problem(410, "the file is gone")
    if_match = request.headers.get("if-match")
    if if_match is not None and not _names(if_match, artefact.etag):
        raise Problem(412, "the file is not the version that If-Match names")
    if_none = request.headers.get("if-none-match")
    if if_none is not None and _names(if_none.replace("W/", ""), artefact.etag):
        return Response(status_code=304, headers=headers)
    status, (start, stop) = 200, (0, artefact.size)
    asked = _asked_range(request, artefact)
    if asked is not None:
        status, (start, stop) = 206, asked
        headers["Content-Range"] = f"bytes {start}-{stop - 1}/{artefact.size}"
    headers["Content-Length"] = str(stop - start)
    if request.method == "HEAD":
        return Response(status_code=status, headers=headers, media_type=artefact.media_type)
    body: Iterator[bytes] = storage.read(artefact.key, start, stop)
    if stop - start <= AT_ONCE:
        return Response(b"".join(body), status, headers, artefact.media_type)
    return StreamingResponse(body, status, headers, artefact.media_type)


def _names(condition: str, etag: str) -> bool:
    return condition.strip() == "*" or etag in (tag.strip() for tag in condition.split(","))


def _asked_range(request: Request, artefact: Artefact) -> tuple[int, int] | None:
    """Return [start, stop) of the range asked for; None if there is none to honour."""
    size = artefact.size
    text = request.headers.get("range", "").replace(" ", "")
    found = _RANGE.fullmatch(text)
    condition = request.headers.get("if-range")
    if found is None or (condition is not None and condition.strip() != artefact.etag):
        return None
    first, last = found.groups()
    if not first and not last:
        return None
    if first and last and int(last) < int(first):
        return None
    start = int(first) if first else max(size - int(last), 0)
    stop = min(int(last) + 1, size) if first and last else size
    if start >= stop:
        error = FieldError("range", f"within {size} bytes", text)
        headers = {"Content-Range": f"bytes */{size}"}
        raise Problem(416, str(error), errors=[error], headers=headers)
    return start, stop
