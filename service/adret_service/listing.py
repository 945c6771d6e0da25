"""What a list of jobs may be asked for: the query of OGC API - Processes' job list."""

from datetime import datetime
from typing import Annotated, Any, Literal

from fastapi import Depends, Query
from pydantic import BeforeValidator

from adret_service.engine.port import JobFilter, JobStatus
from adret_service.problems import FieldError, invalid

__all__ = ["JobQuery", "Shown", "instants"]


def _split(values: Any) -> Any:
    """Take ``a,b`` for two values, as well as the parameter twice."""
    if not isinstance(values, list):
        return values
    return [part for value in values for part in str(value).split(",")]


Statuses = Annotated[list[JobStatus], BeforeValidator(_split), Query(max_length=10)]
Processes = Annotated[
    list[Annotated[str, Query(max_length=64)]],
    BeforeValidator(_split),
    Query(alias="processID", max_length=50),
]
Types = Annotated[
    list[Literal["process"]], BeforeValidator(_split), Query(alias="type", max_length=10)
]
Seconds = Annotated[float | None, Query(ge=0, allow_inf_nan=False, description="Seconds.")]
Datetime = Annotated[
    str | None,
    Query(
        max_length=100,
        description="When the job was created: an RFC 3339 date-time, or an interval of two "
        "with a slash between them; .. leaves an end open.",
    ),
]


class JobQuery:
    """A list's filter, and the query parameters that say it again on the next page."""

    def __init__(
        self,
        status: Statuses = [],  # noqa: B006 (FastAPI copies its defaults)
        process: Processes = [],  # noqa: B006
        kind: Types = [],  # noqa: B006
        datetime: Datetime = None,
        minDuration: Seconds = None,
        maxDuration: Seconds = None,
    ) -> None:
        self.shown = JobFilter(
            statuses=frozenset(status),
            processes=frozenset(process),
            created=(None, None) if datetime is None else instants(datetime),
            seconds=(minDuration, maxDuration),
        )
        if self.shown.seconds != (None, None) and not status:
            # A job that has not begun has no duration.
            begun = frozenset(JobStatus) - {JobStatus.ACCEPTED}
            self.shown = JobFilter(
                statuses=begun,
                processes=self.shown.processes,
                created=self.shown.created,
                seconds=self.shown.seconds,
            )
        self.again: dict[str, Any] = {
            "status": [str(each) for each in status],
            "processID": process,
            "type": kind,
            "datetime": datetime,
            "minDuration": minDuration,
            "maxDuration": maxDuration,
        }


def instants(text: str) -> tuple[float | None, float | None]:
    """Return the first and last Unix second of a date-time or an interval.

    Raises
    ------
    Problem
        400 for anything else.

    Examples
    --------
    >>> instants("2026-01-01T00:00:00Z/..")
    (1767225600.0, None)
    """
    first, slash, last = text.partition("/")
    limit = "an RFC 3339 date-time, or two with a slash between them"
    if not slash:
        first = last = text
    ends: list[float | None] = []
    for end in (first, last):
        if slash and end in ("", ".."):
            ends.append(None)
            continue
        try:
            found = datetime.fromisoformat(end.replace(" ", "+"))  # a + that nobody quoted
            if found.tzinfo is None or "T" not in end.upper():
                raise ValueError
            ends.append(found.timestamp())
        except (ValueError, OverflowError):
            raise invalid(FieldError("datetime", limit, text)) from None
    least, largest = ends
    known = (least is not None) + (largest is not None)
    if not known or (least is not None and largest is not None and least > largest):
        raise invalid(FieldError("datetime", limit + ", the earlier one first", text))
    return least, largest


Shown = Annotated[JobQuery, Depends(JobQuery)]
