"""What a person types, as the service takes it; refused here when it cannot be right."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from adret_service.client.errors import ClientError

__all__ = ["camera_text", "check_source", "check_targets", "parse_values"]


def parse_values(options: Sequence[str], field: str = "input") -> dict[str, Any]:
    """Turn ``name=value`` texts into values; a value that is no JSON is taken as text.

    Examples
    --------
    >>> parse_values(["sun_deg=[315, 35]", "method=hull"])
    {'sun_deg': [315, 35], 'method': 'hull'}
    """
    values: dict[str, Any] = {}
    for option in options:
        name, equals, text = option.partition("=")
        if not equals or not name:
            raise ClientError(f"{field}: must be name=value, got {option!r}")
        try:
            values[name] = json.loads(text)
        except ValueError:
            values[name] = text
    return values


def camera_text(path: Path) -> str:
    """Return a camera file as short JSON."""
    try:
        members = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ClientError(f"camera: must be a JSON file, got {path} ({error})") from None
    if not isinstance(members, dict):
        raise ClientError(f"camera: must be a JSON object, got {type(members).__name__}")
    return json.dumps(members, separators=(",", ":"))


def check_source(file: Path) -> Path:
    """Return a file that can be sent."""
    if not file.is_file():
        raise ClientError(f"file: must be an existing file, got {str(file)!r}")
    return file


def check_targets(targets: Sequence[Path], *, overwrite: bool) -> None:
    """Refuse targets that cannot be written, before anything is sent."""
    for target in targets:
        if not target.absolute().parent.is_dir():
            raise ClientError(f"out: must be in an existing folder, got {str(target)!r}")
        if target.is_dir():
            raise ClientError(f"out: must be a file name, not a folder, got {str(target)!r}")
        if target.exists() and not overwrite:
            raise ClientError(f"out: must be a new file (or use --overwrite), got {str(target)!r}")
