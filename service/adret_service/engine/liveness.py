"""Who is alive: every process holds a file lock that the operating system drops on its death.

The lock is taken on a file named after the process, so a lock that can be taken belongs to a dead
one. A process that is only stopped (SIGSTOP) keeps its lock and counts as alive.
"""

import fcntl
import os
import shutil
import socket
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Protocol, Self

from adret_service.ids import new_id

__all__ = ["FilePresence", "Lease", "Presence", "is_dead", "live", "only_one", "sweep_scratch"]


class Presence(Protocol):
    """Tells the living from the dead among the processes that share a database."""

    def is_dead(self, name: str) -> bool:
        """Whether the process of that name has died."""

    def living(self, role: str) -> int:
        """Return how many processes of this role are alive."""

    def only_one(self, duty: str) -> AbstractContextManager[bool]:
        """Yield whether this process got the duty; at most one process has it at a time."""


class FilePresence:
    """The living and the dead on this machine, as the locks in a folder tell.

    Parameters
    ----------
    locks : Path
        Folder of the locks.
    """

    def __init__(self, locks: Path) -> None:
        self._locks = locks

    def is_dead(self, name: str) -> bool:
        """Whether the process of that name has died."""
        return is_dead(self._locks, name)

    def living(self, role: str) -> int:
        """Return how many processes of this role are alive."""
        return len(live(self._locks, role))

    def only_one(self, duty: str) -> AbstractContextManager[bool]:
        """Yield whether this process got the duty; at most one process has it at a time."""
        return only_one(self._locks, duty)


class Lease:
    """A lock and a scratch folder that belong to this process until it dies.

    Parameters
    ----------
    locks, scratch : Path
        Folders of the locks and of the scratch space, on a local disk.
    role : str
        "worker" or "api"; the first part of the name.
    """

    def __init__(self, locks: Path, scratch: Path, role: str) -> None:
        locks.mkdir(parents=True, exist_ok=True)
        self.name = f"{role}-{socket.gethostname()}-{new_id()}"
        self._file = locks / f"{self.name}.lock"
        self._descriptor = _take(self._file)
        self.scratch = scratch / self.name
        self.scratch.mkdir(parents=True, mode=0o700)

    def release(self) -> None:
        """Give the lock back and drop the scratch folder."""
        shutil.rmtree(self.scratch, ignore_errors=True)
        self._file.unlink(missing_ok=True)
        os.close(self._descriptor)

    def __enter__(self) -> Self:
        """Return the lease."""
        return self

    def __exit__(self, *_: object) -> None:
        """Release the lease."""
        self.release()


def _take(path: Path) -> int:
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        try:
            if os.stat(path).st_ino == os.fstat(descriptor).st_ino:
                return descriptor
        except FileNotFoundError:
            pass
        os.close(descriptor)  # swept between its creation and its lock: make it again


def live(locks: Path, role: str) -> list[str]:
    """Return the names of the live processes of this role."""
    return [path.stem for path in sorted(locks.glob(f"{role}-*.lock")) if not _free(path)]


def is_dead(locks: Path, name: str) -> bool:
    """Whether the process of that name has died (or never took its lock on this machine)."""
    return _free(locks / f"{name}.lock")


def _free(path: Path) -> bool:
    try:
        descriptor = os.open(path, os.O_RDONLY)
    except FileNotFoundError:
        return True
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    else:
        return True
    finally:
        os.close(descriptor)


@contextmanager
def only_one(locks: Path, duty: str) -> Iterator[bool]:
    """Yield whether this process got the duty; at most one process has it at a time."""
    locks.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(locks / f"{duty}.duty", os.O_RDWR | os.O_CREAT, 0o600)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            yield False
        else:
            yield True
    finally:
        os.close(descriptor)


def sweep_scratch(locks: Path, scratch: Path) -> None:
    """Remove what dead processes left: their scratch folders, then their locks."""
    for folder in scratch.glob("*-*"):
        if folder.is_dir() and is_dead(locks, folder.name):
            shutil.rmtree(folder, ignore_errors=True)
    for path in locks.glob("*-*.lock"):
        if not (scratch / path.stem).exists() and _free(path):
            path.unlink(missing_ok=True)
