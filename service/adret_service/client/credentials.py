"""The keys that a person has for services, in one file that nobody else can read."""

import json
import os
import secrets
from dataclasses import dataclass, field
from pathlib import Path

import typer

from adret_service.client.errors import ClientError

__all__ = ["Credentials", "credentials_file"]

DEFAULT_URL = "http://127.0.0.1:8000"


def credentials_file() -> Path:
    """Return the file's place: the platform's folder for a person's settings."""
    return Path(typer.get_app_dir("adret")) / "credentials.json"


@dataclass
class Credentials:
    """The service that is used when none is named, and a key for each service by its address."""

    url: str = DEFAULT_URL
    keys: dict[str, str] = field(default_factory=dict)

    @classmethod
    def load(cls, path: Path) -> "Credentials":
        """Read the file; without one there are no keys.

        Raises
        ------
        ClientError
            If others can read it, or it is not what was written.
        """
        try:
            mode = path.stat().st_mode
            text = path.read_text(encoding="utf-8")
        except FileNotFoundError:
            return cls()
        except OSError as error:
            reason = f"credentials: must be readable, got {path} ({error.strerror})"
            raise ClientError(reason) from None
        if os.name == "posix" and mode & 0o077:
            raise ClientError(
                f"credentials: must be readable by you alone (chmod 600), got {path} "
                f"with mode {mode & 0o777:03o}"
            )
        try:
            found = json.loads(text)
            return cls(str(found["url"]), {str(k): str(v) for k, v in found["keys"].items()})
        except (ValueError, KeyError, TypeError, AttributeError):
            reason = f"credentials: must be what `adret login` wrote, got {path}"
            raise ClientError(reason) from None

    def save(self, path: Path) -> None:
        """Write the file at once and whole."""
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        draft = path.with_name(f".{path.name}-{secrets.token_hex(8)}")
        try:
            descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
            with os.fdopen(descriptor, "w", encoding="utf-8") as stream:
                json.dump({"url": self.url, "keys": self.keys}, stream, indent=1)
            os.replace(draft, path)
        finally:
            draft.unlink(missing_ok=True)
