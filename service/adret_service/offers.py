"""The processes that one service offers."""

from collections.abc import Mapping
from functools import cache

from adret_service import processes
from adret_service.echo_process import ECHO_PROCESS
from adret_service.processes import Process

__all__ = ["offered"]


@cache
def offered(*, echo: bool) -> Mapping[str, Process]:
    """Return every process by its id; `echo` adds the one for tests.

    Examples
    --------
    >>> "shadow" in offered(echo=False), "echo" in offered(echo=False)
    (True, False)
    """
    found = {name: processes.process(name) for name in processes.names()}
    return found | {ECHO_PROCESS.id: ECHO_PROCESS} if echo else found
