"""A process that holds the decoder ready and forks one confined child for each upload.

Forking takes 10 ms where starting an interpreter and GDAL takes a second, and is safe here: this
process has one thread and never opens a raster itself. It reads orders as JSON lines from its
standard input, writes one JSON line for each child that has ended, and ends with its input.
"""

import json
import os
import resource
import selectors
import signal
from collections.abc import Callable
from typing import Any

from adret_service import decoding

__all__ = ["main"]

MAX_ANSWER = 1 << 20


class Children:
    """The children that are at work, by the pipe that brings their answer."""

    def __init__(self) -> None:
        self.selector = selectors.DefaultSelector()
        self._children: dict[int, tuple[str, int, bytearray]] = {}

    def fork(self, order: str, work: Callable[[int], None]) -> None:
        """Run `work` in a child; it gets the descriptor to write its answer to."""
        reading, writing = os.pipe()
        pid = os.fork()
        if pid == 0:
            status = 1
            try:
                _close_all_but(writing)
                work(writing)
                status = 0
            finally:
                os._exit(status)
        os.close(writing)
        self._children[reading] = order, pid, bytearray()
        self.selector.register(reading, selectors.EVENT_READ)

    def take(self, reading: int) -> dict[str, Any] | None:
        """Read what a child has written; returns its last word once it has ended."""
        order, pid, answer = self._children[reading]
        piece = os.read(reading, 1 << 16)
        if len(answer) + len(piece) > MAX_ANSWER:
            os.kill(pid, signal.SIGKILL)
        elif piece:
            answer += piece
            return None
        self.selector.unregister(reading)
        os.close(reading)
        del self._children[reading]
        status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
        return {"order": order, "exit": status, "answer": answer.decode("utf-8", "replace")}

    def kill(self, order: str) -> None:
        """Kill the child of one order; its end is told like any other."""
        for name, pid, _ in self._children.values():
            if name == order:
                os.kill(pid, signal.SIGKILL)

    def kill_all(self) -> None:
        """Kill every child."""
        for name, _, _ in list(self._children.values()):
            self.kill(name)


def _close_all_but(kept: int) -> None:
    """Close the orders, the answers and what other children hold; standard error stays."""
    os.close(0)
    os.dup2(2, 1)
    os.closerange(3, kept)
    os.closerange(kept + 1, resource.getrlimit(resource.RLIMIT_NOFILE)[0])


def main() -> None:
    """Serve orders until the input closes."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8", buffering=1)
    os.dup2(2, 1)
    children = Children()
    children.selector.register(0, selectors.EVENT_READ)
    children.fork("drivers", decoding.send_drivers)
    drivers: list[str] = []
    waiting = bytearray()
    while True:
        for key, _ in children.selector.select():
            if key.fd != 0:
                ended = children.take(key.fd)
                if ended is None:
                    continue
                if ended["order"] == "drivers":
                    drivers = json.loads(ended["answer"])
                answers.write(json.dumps(ended) + "\n")
                continue
            piece = os.read(0, 1 << 16)
            if not piece:
                children.kill_all()
                return
            waiting += piece
            *lines, rest = waiting.split(b"\n")
            waiting = bytearray(rest)
            for line in lines:
                obey(json.loads(line), children, drivers)


def obey(message: dict[str, Any], children: Children, drivers: list[str]) -> None:
    """Start or kill a child."""
    if "kill" in message:
        children.kill(message["kill"])
        return
    limits = message["limits"] | {"drivers": drivers}
    children.fork(
        message["order"],
        lambda writing: decoding.child(writing, message["folder"], limits, message["options"]),
    )


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    main()
