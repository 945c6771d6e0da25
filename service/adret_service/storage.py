"""Artefacts: written once under a name that holds their digest, read by range.

A file enters the store by one rename after it is complete and synced, and a manifest is the last
thing written, so what a manifest names exists whole. Keys are made by the service and hold no part
of any name that a user gave.
"""

import errno
import hashlib
import json
import os
import re
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from adret_service.ids import new_id

__all__ = ["HEIGHTS", "UPLOAD", "Artefact", "Storage", "digest"]

UPLOAD = "upload"  # a received file in its private folder, under no name of the client's
HEIGHTS = "heights.tif"  # what the decoder makes of it

_PART = re.compile(r"[a-z0-9][a-z0-9._-]{0,127}")
CHUNK = 1 << 20


@dataclass(frozen=True, slots=True, kw_only=True)
class Artefact:
    """One stored file: `size` in bytes, `sha256` in hexadecimal."""

    key: str
    size: int
    sha256: str
    media_type: str

    @property
    def etag(self) -> str:
        """Strong entity tag, with its quotes."""
        return f'"{self.sha256}"'


class Storage:
    """Files below one folder, by key.

    Parameters
    ----------
    root : Path
        Folder of the store, on a local disk.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        root.mkdir(parents=True, exist_ok=True)

    def publish(self, source: Path, prefix: str, name: str, media_type: str) -> Artefact:
        """Move a finished file into the store.

        Parameters
        ----------
        source : Path
            Complete file; gone afterwards.
        prefix, name : str
            The key becomes ``prefix/<16 digits of the digest>-name``.
        media_type : str
            Media type to serve it with.
        """
        sha256, size = digest(source)
        artefact = Artefact(
            key=f"{prefix}/{sha256[:16]}-{name}", size=size, sha256=sha256, media_type=media_type
        )
        target = self.path(artefact.key)
        target.parent.mkdir(parents=True, exist_ok=True)
        _sync(source)
        try:
            os.replace(source, target)
        except OSError as error:
            if error.errno != errno.EXDEV:
                raise
            self._copy_in(source, target)
        _sync(target.parent)
        return artefact

    def write_manifest(
        self, prefix: str, artefacts: Mapping[str, Artefact], notes: Mapping[str, Any]
    ) -> None:
        """Write the manifest of `prefix`, which makes its artefacts count."""
        body = {"artefacts": {k: asdict(v) for k, v in artefacts.items()}, "notes": dict(notes)}
        target = self.path(f"{prefix}/manifest.json")
        target.parent.mkdir(parents=True, exist_ok=True)
        draft = target.with_name(f".manifest-{new_id()}")
        try:
            draft.write_text(json.dumps(body, indent=1), encoding="utf-8")
            _sync(draft)
            os.replace(draft, target)
        finally:
            draft.unlink(missing_ok=True)
        _sync(target.parent)

    def manifest(self, prefix: str) -> dict[str, Artefact] | None:
        """Return the artefacts of `prefix` by name, or None before its manifest is written."""
        try:
            text = self.path(f"{prefix}/manifest.json").read_text(encoding="utf-8")
        except FileNotFoundError:
            return None
        return {k: Artefact(**v) for k, v in json.loads(text)["artefacts"].items()}

    def path(self, key: str) -> Path:
        """Return the file of a key; ValueError for anything that is not a key."""
        parts = key.split("/")
        if not all(_PART.fullmatch(part) and ".." not in part for part in parts):
            raise ValueError(f"key: must be made of plain names, got {key!r}")
        return self.root.joinpath(*parts)

    def exists(self, key: str) -> bool:
        """Whether the artefact is there."""
        return self.path(key).is_file()

    def read(self, key: str, start: int = 0, stop: int | None = None) -> Iterator[bytes]:
        """Yield the bytes of ``[start, stop)`` in pieces of a mebibyte at most."""
        with self.path(key).open("rb") as file:
            file.seek(start)
            left = (os.fstat(file.fileno()).st_size if stop is None else stop) - start
            while left > 0:
                piece = file.read(min(CHUNK, left))
                if not piece:
                    return
                left -= len(piece)
                yield piece

    def delete(self, prefix: str) -> None:
        """Delete everything below `prefix`, the manifest first."""
        folder = self.path(prefix)
        (folder / "manifest.json").unlink(missing_ok=True)
        shutil.rmtree(folder, ignore_errors=True)

    def free_bytes(self) -> int:
        """Return the free space of the store's disk [bytes]."""
        return shutil.disk_usage(self.root).free

    def _copy_in(self, source: Path, target: Path) -> None:
        draft = target.with_name(f".draft-{new_id()}")
        try:
            shutil.copyfile(source, draft)
            _sync(draft)
            os.replace(draft, target)
        finally:
            draft.unlink(missing_ok=True)
        source.unlink()


def digest(path: Path) -> tuple[str, int]:
    """Return the SHA-256 of a file in hexadecimal, and its size [bytes]."""
    with path.open("rb") as file:
        sha256 = hashlib.file_digest(file, "sha256").hexdigest()
        return sha256, file.tell()


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
