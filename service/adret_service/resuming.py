"""Uploads in pieces: what has come so far is on disk, and outlives clients and servers.

Each unfinished upload is a folder below ``data_dir/partial/<tenant>`` with the bytes that came and
a note of what they will be. One writer at a time holds its lock. The folder is on one machine: in
front of several, a proxy must send an upload's pieces to the one that began it.
"""

import fcntl
import hashlib
import json
import os
import shutil
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO, Any

import anyio

from adret_service.ids import is_id, new_id
from adret_service.problems import FieldError, Problem, missing, too_large
from adret_service.storage import UPLOAD

__all__ = ["CHECKSUMS", "Partial", "Partials"]

NOTE = "note.json"
FLUSH = 1 << 20
CHECKSUMS = ("sha1", "sha256", "md5")
MISMATCH = 460  # of tus: the piece is not what its checksum says
MAX_OPEN = 100  # unfinished uploads of one tenant


@dataclass(frozen=True, slots=True, kw_only=True)
class Partial:
    """An upload on its way: `length` in bytes; `dataset` is what became of it."""

    id: str
    tenant: str
    length: int
    name: str
    options: dict[str, Any]
    created: float
    dataset: str | None = None


class Partials:
    """The unfinished uploads of one machine.

    Parameters
    ----------
    root : Path
        Folder of all of them.
    keep : float
        Seconds without a piece after which one is forgotten.
    """

    def __init__(self, root: Path, keep: float) -> None:
        self.root = root
        self.keep = keep

    def create(self, tenant: str, length: int, name: str, options: dict[str, Any]) -> Partial:
        """Begin an upload.

        Raises
        ------
        Problem
            429 if the tenant has begun too many.
        """
        self.sweep()
        opened = len(list(self.root.glob(f"{tenant}/*")))
        if opened >= MAX_OPEN:
            error = FieldError("uploads", f"below {MAX_OPEN} that are not finished", opened)
            raise Problem(429, str(error), errors=[error], headers={"Retry-After": "60"})
        partial = Partial(
            id=new_id(),
            tenant=tenant,
            length=length,
            name=name,
            options=options,
            created=time.time(),
        )
        self.folder(partial).mkdir(parents=True, mode=0o700)
        (self.folder(partial) / UPLOAD).touch()
        self._note(partial)
        return partial

    def find(self, partial_id: str, tenant: str) -> Partial:
        """Return the tenant's upload or answer 404."""
        if is_id(partial_id):
            try:
                note = (self.root / tenant / partial_id / NOTE).read_text(encoding="utf-8")
                return Partial(**json.loads(note))
            except FileNotFoundError:
                pass
        raise missing("upload", partial_id)

    def folder(self, partial: Partial) -> Path:
        """Return the folder of an upload."""
        return self.root / partial.tenant / partial.id

    def offset(self, partial: Partial) -> int:
        """Return how many bytes have come."""
        if partial.dataset is not None:
            return partial.length
        try:
            return (self.folder(partial) / UPLOAD).stat().st_size
        except FileNotFoundError:
            return 0

    def expires(self, partial: Partial) -> float:
        """Return when the upload will be forgotten if nothing comes [Unix seconds]."""
        return max(partial.created, self._touched(self.folder(partial))) + self.keep

    @contextmanager
    def writing(self, partial: Partial) -> Iterator[IO[bytes]]:
        """Hold the upload's only pen.

        Raises
        ------
        Problem
            423 while another request writes, 404 if the upload was ended meanwhile.
        """
        try:
            file = (self.folder(partial) / UPLOAD).open("r+b")
        except FileNotFoundError:
            raise missing("upload", partial.id) from None
        with file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                headers = {"Retry-After": "1"}
                raise Problem(
                    423, "another request writes to this upload", headers=headers
                ) from None
            yield file

    def finish(self, partial: Partial, dataset: str) -> None:
        """Keep only the note of what the upload became."""
        self._note(Partial(**asdict(partial) | {"dataset": dataset}))
        (self.folder(partial) / UPLOAD).unlink(missing_ok=True)

    def remove(self, partial: Partial) -> None:
        """Forget an upload."""
        shutil.rmtree(self.folder(partial), ignore_errors=True)

    def sweep(self) -> int:
        """Forget uploads that nobody continues; returns how many."""
        swept = 0
        for folder in self.root.glob("*/*"):
            if time.time() - self._touched(folder) > self.keep:
                shutil.rmtree(folder, ignore_errors=True)
                swept += 1
        return swept

    def waiting_bytes(self, tenant: str) -> int:
        """Return the bytes that a tenant's unfinished uploads will have."""
        total = 0
        for note in self.root.glob(f"{tenant}/*/{NOTE}"):
            partial = Partial(**json.loads(note.read_text(encoding="utf-8")))
            total += partial.length if partial.dataset is None else 0
        return total

    def _touched(self, folder: Path) -> float:
        times = [path.stat().st_mtime for path in (folder, folder / UPLOAD) if path.exists()]
        return max(times, default=0.0)

    def _note(self, partial: Partial) -> None:
        draft = self.folder(partial) / f".{NOTE}"
        draft.write_text(json.dumps(asdict(partial)), encoding="utf-8")
        draft.replace(self.folder(partial) / NOTE)


async def append(
    file: IO[bytes],
    pieces: AsyncIterator[bytes],
    offset: int,
    length: int,
    checksum: tuple[str, bytes] | None,
) -> int:
    """Write a piece behind what is there; returns the new offset.

    What came before a client went away is kept, unless it has a checksum that it cannot meet.

    Raises
    ------
    Problem
        413 if more comes than was announced, 460 if the piece is not what its checksum says.
    """
    digest = None if checksum is None else hashlib.new(checksum[0], usedforsecurity=False)
    buffer = bytearray()
    at, whole = offset, False
    file.seek(offset)

    def write(data: bytes) -> None:
        file.write(data)
        if digest is not None:
            digest.update(data)

    try:
        async for piece in pieces:
            if at + len(buffer) + len(piece) > length:
                size = at + len(buffer) + len(piece)
                raise too_large("upload-length", f"at most the announced {length} bytes", size)
            buffer += piece
            if len(buffer) >= FLUSH:
                data, buffer = bytes(buffer), bytearray()
                await anyio.to_thread.run_sync(write, data)
                at += len(data)
        whole = True
    finally:
        with anyio.CancelScope(shield=True):
            await anyio.to_thread.run_sync(write, bytes(buffer))
            at += len(buffer)
            wrong = checksum is not None and digest is not None and digest.digest() != checksum[1]
            if wrong or at > length:
                at = offset
                file.truncate(offset)
            await anyio.to_thread.run_sync(_settle, file)
    if wrong and whole:
        assert checksum is not None
        error = FieldError("upload-checksum", "the digest of the piece", checksum[1].hex())
        raise Problem(MISMATCH, str(error), errors=[error])
    return at


def _settle(file: IO[bytes]) -> None:
    file.flush()
    os.fsync(file.fileno())
