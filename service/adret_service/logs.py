"""Logs on standard error: a line an event, for people or as JSON, with request and job ids."""

import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from datetime import UTC, datetime

from adret_service.settings import Settings

__all__ = ["about", "set_up_logging"]

REQUEST: ContextVar[str] = ContextVar("request_id", default="")
JOB: ContextVar[str] = ContextVar("job_id", default="")


class JsonLines(logging.Formatter):
    """One JSON object a line: at, level, logger, message, and ids where there are any."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line."""
        line = {
            "at": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
            "process": record.process,
            "request_id": REQUEST.get(),
            "job_id": JOB.get(),
            **getattr(record, "fields", {}),
        }
        if record.exc_info:
            line["exception"] = self.formatException(record.exc_info)
        kept = {key: value for key, value in line.items() if value != ""}
        return json.dumps(kept, ensure_ascii=False, default=str)


@contextmanager
def about(*, request_id: str = "", job_id: str = "") -> Iterator[None]:
    """Have every line of this block name its request, its job, or both."""
    tokens = REQUEST.set(request_id or REQUEST.get()), JOB.set(job_id or JOB.get())
    try:
        yield
    finally:
        REQUEST.reset(tokens[0])
        JOB.reset(tokens[1])


def set_up_logging(settings: Settings) -> None:
    """Log to standard error."""
    logging.basicConfig(
        level=settings.log_level.upper(),
        format="%(asctime)s %(levelname)s %(name)s: %(message)s",
    )
    if settings.log_json:
        for handler in logging.getLogger().handlers:
            handler.setFormatter(JsonLines())
