"""What the service says about datasets, jobs and outputs, with types."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Self

__all__ = ["Dataset", "Event", "Job", "Output"]

FINISHED = ("successful", "failed", "dismissed")


@dataclass(frozen=True, slots=True, kw_only=True)
class Dataset:
    """A raster in the service; `document` is all that the service says of it."""

    id: str
    kind: str
    rows: int
    columns: int
    document: Mapping[str, Any] = field(repr=False)

    @classmethod
    def read(cls, document: Mapping[str, Any]) -> Self:
        """Read the service's JSON object."""
        return cls(
            id=str(document["id"]),
            kind=str(document.get("kind", "terrain")),
            rows=int(document["rows"]),
            columns=int(document["columns"]),
            document=document,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """A job; progress is percent, times are as ISO 8601 has them."""

    id: str
    process: str
    status: str
    progress: int
    message: str
    created: str
    document: Mapping[str, Any] = field(repr=False)

    @property
    def is_finished(self) -> bool:
        """Whether the job has reached its last state."""
        return self.status in FINISHED

    @classmethod
    def read(cls, document: Mapping[str, Any]) -> Self:
        """Read the service's JSON object."""
        return cls(
            id=str(document["jobID"]),
            process=str(document.get("processID", "")),
            status=str(document["status"]),
            progress=int(document.get("progress", 0)),
            message=str(document.get("message", "")),
            created=str(document.get("created", "")),
            document=document,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Output:
    """One file that a job made: its name, bytes, digest and media type."""

    name: str
    length: int
    sha256: str
    media_type: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """Something that happened to a job: status, progress, log, or the end of the stream."""

    seq: int | None
    kind: str
    body: Mapping[str, Any]
