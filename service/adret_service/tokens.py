"""Tokens that let a map, which can send no header, look at one raster for a while.

A token names its tenant and when it ends, and is signed together with the path that it opens. It
reads views below that path, and nothing else.
"""

import hashlib
import hmac
import os
import re
import time
from pathlib import Path

from adret_service.auth import Credential
from adret_service.settings import Settings

__all__ = ["TokenMaker", "token_maker"]

VIEW = re.compile(
    r"(/(?:datasets|jobs)/[0-9a-z]{26})/(?:tiles/.+|tilejson\.json|map\.html|preview\.png|point)"
)
TOKEN = re.compile(r"([a-z0-9][a-z0-9_-]{0,39})\.([0-9]{1,12})\.([0-9a-f]{64})")
SECRET = "token.secret"


class TokenMaker:
    """Makes and checks tokens.

    Parameters
    ----------
    secret : bytes
        Shared by all API processes of a service.
    seconds : float
        How long a token opens its path.

    Examples
    --------
    >>> maker = TokenMaker(b"secret", 60.0)
    >>> path = "/datasets/" + "0" * 26
    >>> maker.find(maker.make("alice", path), path + "/map.html").tenant
    'alice'
    >>> maker.find(maker.make("alice", path), path) is None
    True
    """

    def __init__(self, secret: bytes, seconds: float) -> None:
        self._secret = secret
        self.seconds = seconds

    def make(self, tenant: str, path: str) -> str:
        """Return a token for the views of a raster, such as ``/datasets/{id}``."""
        end = str(int(time.time() + self.seconds))
        return f"{tenant}.{end}.{self._sign(tenant, end, path)}"

    def find(self, token: str, path: str) -> Credential | None:
        """Return whose views at `path` a token opens; None if it opens none there, or no more."""
        view, parts = VIEW.fullmatch(path), TOKEN.fullmatch(token)
        if view is None or parts is None:
            return None
        tenant, end, signed = parts.groups()
        if not hmac.compare_digest(signed, self._sign(tenant, end, view[1])):
            return None
        if time.time() > int(end):
            return None
        return Credential(id=f"token:{tenant}", tenant=tenant, scopes=frozenset({"read"}))

    def _sign(self, tenant: str, end: str, path: str) -> str:
        text = f"{tenant}\n{end}\n{path}".encode()
        return hmac.new(self._secret, text, hashlib.sha256).hexdigest()


def token_maker(settings: Settings) -> TokenMaker:
    """Return the maker of a service's tokens; without a set secret, one is kept in its folder."""
    if settings.token_secret:
        return TokenMaker(settings.token_secret.encode(), settings.token_seconds)
    path = settings.data_dir / SECRET
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError:
        return TokenMaker(_written(path), settings.token_seconds)
    with os.fdopen(descriptor, "wb") as file:
        file.write(os.urandom(32))
    return TokenMaker(_written(path), settings.token_seconds)


def _written(path: Path) -> bytes:
    """Return a secret that another process may just be writing."""
    for _ in range(100):
        secret = path.read_bytes()
        if len(secret) == 32:
            return secret
        time.sleep(0.02)
    raise RuntimeError(f"{path.name}: must hold 32 bytes; remove it to have another made")
