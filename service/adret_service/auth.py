"""Who asks: API keys, of which only digests are kept, and what each may do.

Without keys the service knows one tenant, "local", and listens on loopback only. With them every
request names its key, as ``Authorization: Bearer`` or ``X-API-Key``, and sees its tenant's things.
"""

import hashlib
import json
import os
import re
import secrets
import threading
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from adret_service.ids import new_id

__all__ = ["LOCAL", "METRICS", "SCOPES", "Credential", "KeyFile", "add_key", "remove_key"]

SCOPES = ("read", "submit")
METRICS = "metrics"  # may read /metrics, which tells of all tenants, and nothing else
TENANT = re.compile(r"[a-z0-9][a-z0-9_-]{0,39}")
PREFIX = "adret_"


@dataclass(frozen=True, slots=True, kw_only=True)
class Credential:
    """Who a request comes from."""

    id: str
    tenant: str
    scopes: frozenset[str]


LOCAL = Credential(id="local", tenant="local", scopes=frozenset((*SCOPES, METRICS)))


class KeyFile:
    """The keys of a file, read again whenever it changes.

    Parameters
    ----------
    path : Path
        JSON: ``{"keys": [{"id", "sha256", "tenant", "scopes", "created"}, …]}``.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = threading.Lock()
        self._seen: tuple[int, int] | None = None
        self._known: dict[str, Credential] = {}

    def find(self, secret: str) -> Credential | None:
        """Return the owner of a key, None if there is none."""
        self._refresh()
        return self._known.get(digest_of(secret))

    def _refresh(self) -> None:
        try:
            status = self.path.stat()
        except FileNotFoundError:
            self._known, self._seen = {}, None
            return
        seen = (status.st_mtime_ns, status.st_size)
        with self._lock:
            if seen != self._seen:
                self._known = {
                    entry["sha256"]: Credential(
                        id=entry["id"],
                        tenant=entry["tenant"],
                        scopes=frozenset(entry["scopes"]),
                    )
                    for entry in read_keys(self.path)
                }
                self._seen = seen


def digest_of(secret: str) -> str:
    """Return what is kept of a key: it is too long to be guessed, so no salt is needed."""
    return hashlib.sha256(secret.encode("utf-8", "replace")).hexdigest()


def read_keys(path: Path) -> list[dict[str, Any]]:
    """Return the entries of a key file, none if it does not exist."""
    try:
        return list(json.loads(path.read_text(encoding="utf-8"))["keys"])
    except FileNotFoundError:
        return []


def add_key(path: Path, tenant: str, scopes: Iterable[str]) -> tuple[str, str]:
    """Make a key; returns its id and the key itself, which is kept nowhere.

    Raises
    ------
    ValueError
        For a tenant's name or a scope that cannot be.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     key_id, secret = add_key(Path(folder) / "keys.json", "alice", ["read", "submit"])
    ...     KeyFile(Path(folder) / "keys.json").find(secret).tenant
    'alice'
    """
    if not TENANT.fullmatch(tenant):
        raise ValueError(f"tenant: must be 1 to 40 of a-z, 0-9, _ and -, got {tenant!r}")
    chosen = sorted(set(scopes))
    wrong = [scope for scope in chosen if scope not in (*SCOPES, METRICS)]
    if wrong or not chosen:
        named = ", ".join((*SCOPES, METRICS))
        raise ValueError(f"scope: must be of {named}, got {wrong or 'none'}")
    key_id, secret = new_id(), PREFIX + secrets.token_urlsafe(32)
    entry = {
        "id": key_id,
        "sha256": digest_of(secret),
        "tenant": tenant,
        "scopes": chosen,
        "created": int(time.time()),
    }
    _write_keys(path, [*read_keys(path), entry])
    return key_id, secret


def remove_key(path: Path, key_id: str) -> bool:
    """Forget a key; False if there is none of that id."""
    entries = read_keys(path)
    kept = [entry for entry in entries if entry["id"] != key_id]
    if len(kept) == len(entries):
        return False
    _write_keys(path, kept)
    return True


def _write_keys(path: Path, entries: list[dict[str, Any]]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.name}-{new_id()}")
    try:
        descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "w", encoding="utf-8") as stream:
            json.dump({"keys": entries}, stream, indent=1)
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)
