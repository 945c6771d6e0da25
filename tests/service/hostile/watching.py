"""What a server's processes do while hostile files come: memory, open files, sockets, traces."""

import re
import sqlite3
import threading
import time
from pathlib import Path
from typing import Self

from servers import descendants

CALLS = "openat,open,creat,socket,connect,execve,clone,clone3,fork,vfork"
LINE = re.compile(r"^(\d+) +(\w+)\((.*)\) += (-?\d+)")
RESUMED = re.compile(r"^(\d+) +<\.\.\. (\w+) resumed>(.*)\) += (-?\d+)")
PATH = re.compile(r'"((?:[^"\\]|\\.)*)"')


class Memory:
    """The most memory that a process and its descendants had at once [bytes], every 20 ms."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self.most = 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _look(self) -> None:
        while not self._stop.wait(0.02):
            self.most = max(self.most, sum(map(resident, descendants(self.pid))))


def resident(pid: int) -> int:
    """Resident set of a process [bytes]; pages that processes share count for each of them."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * 4096
    except (FileNotFoundError, ProcessLookupError, IndexError):
        return 0


def left_behind(data: Path) -> tuple[list[str], dict[str, int]]:
    """Everything in scratch, every file of store and unfinished uploads, and the rows of tables."""
    found = list((data / "tmp").rglob("*"))
    for name in ("store", "partial"):
        found += [path for path in (data / name).rglob("*") if path.is_file()]
    files = sorted(str(path.relative_to(data)) for path in found)
    with sqlite3.connect(f"file:{data / 'adret.db'}?mode=ro", uri=True, timeout=10) as base:
        query = "select name from sqlite_master where type = 'table' and name like 'adret_%'"
        names = [row[0] for row in base.execute(query)]
        rows = {name: base.execute(f"select count(*) from {name}").fetchone()[0] for name in names}
    base.close()
    return files, rows


def settled(data: Path, before: tuple[list[str], dict[str, int]]) -> bool:
    """Whether all is as before, within a second."""
    deadline = time.monotonic() + 1.0
    while (now := left_behind(data)) != before:
        if time.monotonic() > deadline:
            print(now, before)
            return False
        time.sleep(0.02)
    return True


class Trace:
    """What strace wrote about the decoder and the children that it forked.

    Parameters
    ----------
    path : Path
        Output of ``strace -f -e trace=...``.
    """

    def __init__(self, path: Path) -> None:
        self.opened: list[str] = []
        self.started: list[str] = []
        self.sockets: list[str] = []
        self.connected: list[str] = []
        self.children: set[str] = set()
        pending: dict[tuple[str, str], str] = {}
        decoders: set[str] = set()
        for line in path.read_text(errors="replace").splitlines():
            if line.endswith("<unfinished ...>"):
                pid, rest = line.split(None, 1)
                call, _, arguments = rest.partition("(")
                pending[pid, call] = arguments.removesuffix("<unfinished ...>").rstrip()
                continue
            found = LINE.match(line) or RESUMED.match(line)
            if found is None:
                continue
            pid, call, arguments, result = found.groups()
            arguments = pending.pop((pid, call), "") + arguments
            if call == "execve" and "adret_service.decoder" in arguments:
                decoders.add(pid)
                continue
            if call == "connect" and "AF_INET" in arguments:
                self.connected.append(arguments)
            if pid in decoders | self.children and call in ("clone", "clone3", "fork", "vfork"):
                if "CLONE_THREAD" not in arguments:
                    self.children.add(result)
                continue
            if pid not in self.children:
                continue
            if call == "socket":
                self.sockets.append(arguments)
            elif call == "execve":
                self.started.append(arguments)
            elif call in ("openat", "open", "creat") and int(result) >= 0:
                self.opened += PATH.findall(arguments)[:1]
