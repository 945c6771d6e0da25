"""What the scripts share: a server of their own, figures of processes, the file of results."""

import json
import os
import shutil
import signal
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "benchmarks"), str(ROOT / "tests" / "service")]

from present import about  # noqa: E402
from servers import Server  # noqa: E402

RESULTS = ROOT / "benchmarks" / "results" / "service.json"
DEM = ROOT / "examples" / "data" / "alpine_aletsch_dhm200_lv95_200m.tif"
TICK = os.sysconf("SC_CLK_TCK")

signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that the server goes, too


@contextmanager
def serving(database: str = "sqlite", **environment: str) -> Iterator[Server]:
    """Yield a server in a folder that goes with it; on PostgreSQL if asked."""
    folder = Path(tempfile.mkdtemp(prefix="adret-bench-"))
    postgres = None
    if database == "postgresql":
        from postgres import Postgres

        postgres = Postgres()
        environment["ADRET_DATABASE_URL"] = postgres.url("bench")
    server = Server(folder / "data", **environment)
    try:
        server.start()
        yield server
    finally:
        server.stop()
        if postgres is not None:
            postgres.remove()
        shutil.rmtree(folder, ignore_errors=True)


def resident(pid: int) -> int:
    """Return the resident memory of a process [bytes]."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def cpu_seconds(pids: Sequence[int]) -> float:
    """Return the CPU time that live processes have used [s]."""
    used = 0
    for pid in pids:
        try:
            fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
        except (FileNotFoundError, ProcessLookupError):
            continue
        used += int(fields[11]) + int(fields[12])
    return used / TICK


def quantile(values: Sequence[float], share: float) -> float:
    """Return the smallest value that so large a share of the values does not exceed."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


def milliseconds(values: Sequence[float]) -> dict[str, float]:
    """Return the median, the 99th percentile and the largest of times [ms]."""
    named = {"p50": 0.5, "p95": 0.95, "p99": 0.99, "max": 1.0}
    return {name: round(1000 * quantile(values, share), 2) for name, share in named.items()}


def record(name: str, figures: Any) -> None:
    """Print figures and keep them under their name in the file of results."""
    known = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    known[name] = {"about": about(), "figures": figures}
    RESULTS.write_text(json.dumps(dict(sorted(known.items())), indent=1) + "\n")
    print(json.dumps(figures, indent=1))
