"""Computing processes as their worker sees them: orders in, messages out, killed when too slow."""

import contextlib
import json
import os
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from typing import IO, Any

__all__ = ["TICK", "ComputeChild", "Message", "Unfit"]

TICK = 0.1  # seconds between looks at whether a job is still wanted
START_PATIENCE = 300.0  # seconds to compile all kernels on a slow machine

Message = dict[str, Any]


class Unfit(Exception):
    """This machine cannot compute, today or tomorrow."""


class ComputeChild:
    """One process that computes; started when needed, killed when it does not stop in time.

    Parameters
    ----------
    threads : int
        Kernel threads.
    command : list of str, optional
        Replaces the command line, for tests.
    nice : int
        How far it steps back behind other processes that want the same cores, such as the API.
    """

    def __init__(self, threads: int, command: list[str] | None = None, nice: int = 0) -> None:
        self.threads = threads
        self.command = command or [sys.executable, "-m", "adret_service.compute", str(nice)]
        self._process: subprocess.Popen[str] | None = None
        self._answers: queue.Queue[Message | None] = queue.Queue()

    def start(self) -> str:
        """Start the process and wait until its kernels are loaded; returns the threading layer.

        Raises
        ------
        Unfit
            If it cannot compute safely on this machine.
        RuntimeError
            If it died or hung while it started.
        """
        self._launch()
        layer = self._ready(lambda _: True)
        assert layer is not None
        return layer

    def _launch(self) -> None:
        environment = {k: v for k, v in os.environ.items() if not k.startswith("ADRET_")}
        environment |= {
            "NUMBA_NUM_THREADS": str(self.threads),
            "OMP_NUM_THREADS": "1",
            "OMP_WAIT_POLICY": "PASSIVE",
        }
        self._answers = queue.Queue()
        self._process = subprocess.Popen(
            self.command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        )
        threading.Thread(
            target=_pump, args=(self._process.stdout, self._answers), daemon=True
        ).start()

    def _ready(self, note: Callable[[Message | None], bool]) -> str | None:
        """Wait until the kernels are loaded; None if `note` says that nobody wants them now."""
        deadline = time.monotonic() + START_PATIENCE
        while True:
            try:
                first = self._answers.get(timeout=TICK)
            except queue.Empty:
                if not note(None):
                    self.kill()
                    return None
                if time.monotonic() < deadline:
                    continue
                first = None
            if first is None:
                self.kill()
                raise RuntimeError("the computing process died or hung while it started")
            if first["event"] != "ready":
                self.kill()
                raise Unfit(first["reason"])
            return str(first["layer"])

    def run(self, order: Message, note: Callable[[Message | None], bool], grace: float) -> Message:
        """Run one order to its end.

        Parameters
        ----------
        order : dict
            See `adret_service.compute.run`.
        note : callable
            Called with each message and, at least every 0.1 s, with None; False stops the run.
        grace : float
            Seconds that the child has for stopping by itself before it is killed.

        Returns
        -------
        dict
            The last message: event done, cancelled, refused, failed or died.
        """
        try:
            if self._process is None or self._process.poll() is not None:
                self._launch()
                if self._ready(note) is None:
                    return {"event": "cancelled"}
            self._send(order)
            while True:
                try:
                    message = self._answers.get(timeout=TICK)
                except queue.Empty:
                    message = {}
                if message is None:
                    return self._died()
                if message.get("event", "progress") != "progress":
                    return message
                if not note(message or None):
                    return self._cancel(grace)
        except (BrokenPipeError, RuntimeError, Unfit):
            return self._died()

    def kill(self) -> None:
        """End the process now."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()
            for pipe in (process.stdin, process.stdout):
                if pipe is not None:
                    _close(pipe)

    def _cancel(self, grace: float) -> Message:
        deadline = time.monotonic() + grace
        self._send("cancel")
        while True:
            try:
                message = self._answers.get(timeout=max(deadline - time.monotonic(), 0.001))
            except queue.Empty:
                message = None
            if message is None:
                self.kill()
            if message is None or message["event"] != "progress":
                return {"event": "cancelled"}

    def _died(self) -> Message:
        code = None if self._process is None else self._process.poll()
        self.kill()
        return {"event": "died", "exit": code}

    def _send(self, message: Any) -> None:
        process = self._process
        if process is None or process.stdin is None or process.stdin.closed:
            raise BrokenPipeError  # killed by another thread
        try:
            process.stdin.write(json.dumps(message) + "\n")
            process.stdin.flush()
        except ValueError:  # closed in between
            raise BrokenPipeError from None


def _pump(source: IO[str], answers: "queue.Queue[Message | None]") -> None:
    try:
        for line in source:
            answers.put(json.loads(line))
    except ValueError:
        pass  # cut off in the middle of a line: it died
    answers.put(None)


def _close(pipe: IO[str]) -> None:
    with contextlib.suppress(BrokenPipeError):
        pipe.close()
