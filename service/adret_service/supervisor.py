"""Keeps the workers of one server running."""

import logging
import subprocess
import sys
import threading
import time
from typing import Self

from adret_service.settings import Settings
from adret_service.worker import UNFIT

__all__ = ["Supervisor"]

log = logging.getLogger("adret.service")

STEADY = 30.0  # seconds after which a worker's death is no longer a failed start


class Supervisor:
    """Starts `settings.workers` worker processes and starts each again when it dies.

    A worker holds a pipe to this process and ends when the pipe closes, so a killed server leaves
    no worker behind.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self._stopping = threading.Event()
        self._processes: dict[int, subprocess.Popen[str]] = {}
        self._threads = [
            threading.Thread(target=self._keep, args=(slot,), name=f"worker-{slot}", daemon=True)
            for slot in range(settings.workers)
        ]

    def __enter__(self) -> Self:
        """Start the workers."""
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop the workers; jobs in progress wait for the next start."""
        self._stopping.set()
        for process in list(self._processes.values()):
            if process.stdin is not None:
                process.stdin.close()
        deadline = time.monotonic() + 5.0
        for process in list(self._processes.values()):
            try:
                process.wait(max(0.1, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def _keep(self, slot: int) -> None:
        pause = 0.1
        while not self._stopping.is_set():
            began = time.monotonic()
            process = subprocess.Popen(
                [sys.executable, "-m", "adret_service.worker"],
                stdin=subprocess.PIPE,
                text=True,
                start_new_session=True,  # Ctrl-C reaches the server, which stops its workers
            )
            self._processes[slot] = process
            assert process.stdin is not None
            try:
                process.stdin.write(self.settings.model_dump_json() + "\n")
                process.stdin.flush()
            except BrokenPipeError:
                pass
            status = process.wait()
            if self._stopping.is_set():
                return
            if status == UNFIT:
                log.error("worker %d cannot run on this machine; not starting it again", slot)
                return
            pause = 0.1 if time.monotonic() - began > STEADY else min(2 * pause, 10.0)
            log.warning("worker %d died (exit %d); starting it again", slot, status)
            self._stopping.wait(pause)
