"""What can go wrong between a client and a service, each with its exit code."""

from collections.abc import Mapping
from typing import Any

import httpx

__all__ = ["AWAY", "ENDED", "WRONG", "ClientError", "refusal"]

AWAY = 1  # the service cannot be reached, or failed
WRONG = 2  # something that was given is wrong, or the service refused it
ENDED = 3  # the job failed or was dismissed


class ClientError(Exception):
    """One line for the person at the terminal.

    Parameters
    ----------
    message : str
        The line.
    code : int
        Exit code of the command.
    problem : mapping, optional
        The service's own words, as RFC 9457 has them.
    """

    def __init__(
        self, message: str, code: int = WRONG, problem: Mapping[str, Any] | None = None
    ) -> None:
        super().__init__(message)
        self.code = code
        self.problem = problem


def refusal(answer: httpx.Response) -> ClientError:
    """Return the reason that an answer gives for being an error; its body must have been read."""
    code = WRONG if answer.status_code < 500 else AWAY
    try:
        problem = dict(answer.json())
        line = " ".join(str(problem["detail"]).split())
    except (ValueError, KeyError, TypeError):
        return ClientError(f"url: the service answered {answer.status_code}", code)
    if answer.status_code == 401:
        line += " (`adret login` keeps one; ADRET_API_KEY gives one)"
    if answer.status_code in (429, 503) and "retry-after" in answer.headers:
        line += f" (again in {answer.headers['retry-after']} s)"
    if answer.status_code >= 500 and problem.get("request_id"):
        line += f" (request {problem['request_id']})"
    return ClientError(line, code, problem)
