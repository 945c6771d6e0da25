"""Uploads onto the disk: multipart or raw, hashed while they are written, never above the limit."""

import hashlib
import re
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import anyio
from python_multipart.exceptions import MultipartParseError
from python_multipart.multipart import MultipartParser, parse_options_header
from starlette.requests import ClientDisconnect, Request

from adret_service.problems import FieldError, Problem, invalid, too_large

__all__ = ["Received", "pieces_of", "plain_name", "receive", "safe_name"]

ENVELOPE = 64 * 1024  # what multipart may add around the file
MAX_HEADER = 8 * 1024
FLUSH = 1 << 20
SLOWEST = 1024  # bytes a second below which an upload only holds a connection


@dataclass(frozen=True, slots=True)
class Received:
    """An upload on disk: its file, name as the client gave it, size [bytes] and SHA-256."""

    path: Path
    name: str
    size: int
    sha256: str


@dataclass
class _Sink:
    """The file being written: counts, hashes, and refuses to grow above the limit."""

    file: BinaryIO
    limit: int
    size: int = 0
    sha256: Any = field(default_factory=hashlib.sha256)
    buffer: bytearray = field(default_factory=bytearray)

    def take(self, data: bytes) -> None:
        self.size += len(data)
        if self.size > self.limit:
            raise too_large("file", f"at most {self.limit} bytes", self.size)
        self.buffer += data

    async def flush(self, *, at_least: int = 1) -> None:
        if len(self.buffer) >= at_least:
            data, self.buffer = bytes(self.buffer), bytearray()
            await anyio.to_thread.run_sync(self._write, data)

    def _write(self, data: bytes) -> None:
        self.sha256.update(data)
        self.file.write(data)


async def receive(request: Request, target: Path, limit: int, idle: float) -> Received:
    """Write the request's file to `target`.

    Parameters
    ----------
    request : Request
        Multipart with one part named ``file``, or the file itself as the body.
    target : Path
        File to write.
    limit : int
        Largest file [bytes].
    idle : float
        Longest pause between two pieces [s].

    Raises
    ------
    Problem
        400 for a broken or empty upload, 408 for one that stalls, 413 above the limit.
    """
    kind, options = parse_options_header(request.headers.get("content-type", ""))
    multipart = kind == b"multipart/form-data"
    declared = request.headers.get("content-length", "")
    if declared.isdigit() and int(declared) > limit + (ENVELOPE if multipart else 0):
        raise too_large("file", f"at most {limit} bytes", int(declared))
    with target.open("wb") as file:
        sink = _Sink(file, limit)
        pieces = pieces_of(request, idle)
        try:
            if multipart:
                name = await _multipart(pieces, options.get(b"boundary", b""), sink)
            else:
                name = plain_name(request.headers.get("content-disposition", "").encode("latin-1"))
                async for piece in pieces:
                    sink.take(piece)
                    await sink.flush(at_least=FLUSH)
        except ClientDisconnect:
            raise Problem(400, "the client went away during the upload") from None
        await sink.flush()
    if sink.size == 0:
        raise invalid(FieldError("file", "at least 1 byte", 0))
    return Received(target, name or "upload", sink.size, sink.sha256.hexdigest())


async def pieces_of(request: Request, idle: float) -> AsyncIterator[bytes]:
    """Yield the body as it comes.

    Raises
    ------
    Problem
        408 when nothing comes for `idle` seconds, or less than `SLOWEST` bytes a second on and on.
    """
    stream = request.stream()
    began, seen = time.monotonic(), 0
    while True:
        late = time.monotonic() - began - idle
        if late > 0.0 and seen < SLOWEST * late:
            limit = f"at least {SLOWEST} bytes a second"
            error = FieldError("body", limit, round(seen / (late + idle), 1))
            raise Problem(408, str(error), errors=[error])
        try:
            with anyio.fail_after(idle):
                piece = await anext(stream)
        except StopAsyncIteration:
            return
        except TimeoutError:
            error = FieldError("body", f"without pauses of {idle:g} s", "a longer one")
            raise Problem(408, str(error), errors=[error]) from None
        seen += len(piece)
        yield piece


async def _multipart(pieces: AsyncIterator[bytes], boundary: bytes, sink: _Sink) -> str:
    if not boundary or len(boundary) > 70:
        raise invalid(FieldError("content-type", "multipart/form-data with a boundary", boundary))
    form = _Form(sink)
    parser = MultipartParser(boundary, form.callbacks())
    try:
        async for piece in pieces:
            parser.write(piece)
            await sink.flush(at_least=FLUSH)
        parser.finalize()
    except MultipartParseError as error:
        raise invalid(FieldError("body", "well-formed multipart/form-data", str(error))) from None
    if not form.ended:
        raise invalid(FieldError("body", "complete multipart/form-data", "a cut-off body"))
    if form.files != 1:
        raise invalid(FieldError("file", "given once, as a form field named 'file'", form.files))
    return form.filename


class _Form:
    """Callbacks of the multipart parser: one part named ``file`` goes into the sink."""

    def __init__(self, sink: _Sink) -> None:
        self.sink = sink
        self.files = 0
        self.ended = False
        self.filename = ""
        self._header: tuple[bytearray, bytearray] = (bytearray(), bytearray())
        self._disposition = b""
        self._header_bytes = 0

    def callbacks(self) -> Any:
        return {
            "on_part_begin": self.part_begin,
            "on_header_field": lambda data, start, end: self.header(0, data[start:end]),
            "on_header_value": lambda data, start, end: self.header(1, data[start:end]),
            "on_header_end": self.header_end,
            "on_headers_finished": self.headers_finished,
            "on_part_data": lambda data, start, end: self.sink.take(data[start:end]),
            "on_end": self.end,
        }

    def part_begin(self) -> None:
        self._disposition, self._header_bytes = b"", 0
        self._header = (bytearray(), bytearray())

    def header(self, which: int, data: bytes) -> None:
        self._header_bytes += len(data)
        if self._header_bytes > MAX_HEADER:
            limit = f"at most {MAX_HEADER} bytes of headers a part"
            raise invalid(FieldError("body", limit, self._header_bytes))
        self._header[which].extend(data)

    def header_end(self) -> None:
        name, value = (bytes(part) for part in self._header)
        if name.lower() == b"content-disposition":
            self._disposition = value
        self._header = (bytearray(), bytearray())

    def headers_finished(self) -> None:
        _, options = parse_options_header(self._disposition)
        name = options.get(b"name", b"").decode("utf-8", "replace")
        if name != "file":
            raise invalid(FieldError(name or "part", "left out: only 'file' is taken", name))
        self.files += 1
        self.filename = plain_name(self._disposition)

    def end(self) -> None:
        self.ended = True


def plain_name(disposition: bytes) -> str:
    """Return the name that a part's or a body's header gives its file."""
    _, options = parse_options_header(disposition)
    return safe_name(options.get(b"filename", b"").decode("utf-8", "replace"))


def safe_name(name: str) -> str:
    """Return the client's name of a file, for people to read: never used as a path."""
    name = name.replace("\\", "/").rsplit("/", 1)[-1]
    return re.sub(r"[^\w .()+-]", "_", name)[:120].strip()
