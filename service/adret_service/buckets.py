"""The store in a bucket: any S3-compatible service, so that workers on many machines share it."""

import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from obstore.exceptions import NotFoundError
from obstore.store import S3Store

from adret_service.ids import new_id
from adret_service.settings import Settings
from adret_service.storage import MANIFEST, Artefact, Storage, checked, digest

if TYPE_CHECKING:
    from obstore.store import S3Config

__all__ = ["BucketStorage"]

CHUNK = 8 << 20  # bytes of a part, the smallest that every service takes being 5 MiB


class BucketStorage(Storage):
    """Files in an S3 bucket, below a prefix.

    Who the service is comes from the environment (``AWS_ACCESS_KEY_ID`` and the like) or from the
    machine; no setting holds a secret.

    Parameters
    ----------
    settings : Settings
        `storage_url` (``s3://bucket/prefix``), `storage_endpoint`, `storage_allow_http`.
    """

    def __init__(self, settings: Settings) -> None:
        address = urlsplit(settings.storage_url)
        self._scratch = settings.scratch_dir
        self._scratch.mkdir(parents=True, exist_ok=True)
        config: S3Config = {}
        if settings.storage_endpoint:
            config["endpoint"] = settings.storage_endpoint
        self._store = S3Store(
            address.netloc,
            prefix=address.path.strip("/") or None,
            config=config,
            client_options={"allow_http": settings.storage_allow_http},
        )

    def publish(self, source: Path, prefix: str, name: str, media_type: str) -> Artefact:
        """Send a finished file; a repeated run sends the same bytes under the same key."""
        sha256, size = digest(source)
        artefact = Artefact(
            key=f"{prefix}/{sha256[:16]}-{name}", size=size, sha256=sha256, media_type=media_type
        )
        self._store.put(
            key_of(artefact.key),
            source,
            attributes={"Content-Type": media_type},
            chunk_size=CHUNK,
        )
        source.unlink()
        return artefact

    def exists(self, key: str) -> bool:
        """Whether the artefact is there."""
        try:
            self._store.head(key_of(key))
        except (NotFoundError, FileNotFoundError):
            return False
        return True

    def read(self, key: str, start: int = 0, stop: int | None = None) -> Iterator[bytes]:
        """Yield the bytes of ``[start, stop)`` in pieces of a few mebibytes."""
        size = self._store.head(key_of(key))["size"]
        stop = size if stop is None else min(stop, size)
        for first in range(start, stop, CHUNK):
            last = min(first + CHUNK, stop)
            yield bytes(self._store.get_range(key_of(key), start=first, end=last))

    def local(self, key: str, folder: Path) -> Path:
        """Fetch the artefact into `folder`."""
        target = folder / checked(key)[-1]
        draft = target.with_suffix(f".{new_id()}.part")  # another attempt may fetch it, too
        with draft.open("wb") as file:
            file.writelines(self.read(key))
        draft.replace(target)
        return target.absolute()

    def delete(self, prefix: str) -> None:
        """Delete everything below `prefix`, the manifest first."""
        keys = [f"{key_of(prefix)}/{MANIFEST}"]
        for batch in self._store.list(prefix=key_of(prefix)):
            keys += [entry["path"] for entry in batch if entry["path"] != keys[0]]
        for key in keys:
            try:
                self._store.delete(key)
            except (NotFoundError, FileNotFoundError):
                continue

    def prefixes(self, kind: str) -> Iterator[tuple[str, float]]:
        """Yield every ``tenant/kind/id`` with the age [s] of what was written last below it."""
        changed: dict[str, float] = {}
        for batch in self._store.list():
            for entry in batch:
                parts = entry["path"].split("/")
                if len(parts) > 3 and parts[1] == kind:
                    prefix = "/".join(parts[:3])
                    at = entry["last_modified"].timestamp()
                    changed[prefix] = max(at, changed.get(prefix, at))
        now = time.time()
        yield from ((prefix, now - at) for prefix, at in changed.items())

    def free_bytes(self) -> int:
        """Return the free space of the scratch disk, through which everything passes [bytes]."""
        return shutil.disk_usage(self._scratch).free

    def _put(self, key: str, content: bytes) -> None:
        self._store.put(key_of(key), content, attributes={"Content-Type": "application/json"})

    def _get(self, key: str) -> bytes | None:
        try:
            return bytes(self._store.get(key_of(key)).bytes())
        except (NotFoundError, FileNotFoundError):
            return None


def key_of(key: str) -> str:
    """Return the key if it is one."""
    return "/".join(checked(key))
