"""From DELETE to an idle processor, in the middle of a large kernel.

    python benchmarks/service/cancels.py --repeat 50

A raster so large that one kernel runs for seconds; its job is dismissed at a random moment, and
the CPU time of the computing processes is looked at until it stands still.
"""

import argparse
import json
import random
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from common import TICK, cpu_seconds, quantile, record, serving
from servers import Server, command_line, descendants, wait_for, write_dem

QUIET = 0.4  # seconds of almost no CPU time after which the work has ended
BEGUN = 600.0  # seconds until a job must have begun, on however busy a machine
IDLE = 0.1  # share of a core that waiting processes may use


def computing(server: Server) -> list[int]:
    return server.children("adret_service.compute")


def name_of(pid: int) -> str:
    """What a process of the server runs: the module, or the command."""
    words = command_line(pid).decode().split("\0")
    return next((word for word in words if word.startswith("adret_service.")), "the API")


def stop_time(server: Server, job: str) -> float:
    """Dismiss a job and return when the computing processes used the CPU for the last time [s]."""
    pids = computing(server)
    began = time.perf_counter()
    assert server.http.delete(f"/jobs/{job}").json()["status"] == "dismissed"
    used, last = cpu_seconds(pids), time.perf_counter()
    while time.perf_counter() - last < QUIET:
        time.sleep(0.002)
        now = cpu_seconds([*pids, *computing(server)])
        if now != used and computing(server):
            used, last = now, time.perf_counter()
        elif not computing(server):
            break
    return last - began


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeat", type=int, default=50)
    parser.add_argument("--side", type=int, default=2500)
    parser.add_argument("--seconds", type=float, default=3600.0, help="Begin none after that.")
    parser.add_argument("--keep", action="store_true", help="Write the results' file.")
    options = parser.parse_args()
    figures = measure(options.repeat, options.side, options.seconds)
    if options.keep:
        record("cancels", figures)
    else:
        print(json.dumps(figures, indent=1))


def measure(repeat: int, side: int, seconds: float = 3600.0) -> dict[str, Any]:
    """Dismiss so many jobs on a raster of side² cells."""
    random_, end = random.Random(1), time.monotonic() + seconds
    times, left, busy = [], 0, []
    with tempfile.TemporaryDirectory() as folder, serving() as server:
        heights = np.random.default_rng(1).normal(500.0, 50.0, (side, side)).astype(np.float32)
        dem = write_dem(Path(folder) / "large.tif", heights)
        dataset = server.upload(dem).json()["id"]
        assert server.process is not None
        threads = None
        for _ in range(repeat):
            if time.monotonic() > end:
                break
            job = server.submit("sky-view", dataset=dataset, directions=48, method="march")
            wait_for(lambda job=job: server.status(job)["progress"] > 0, BEGUN, server.log)
            time.sleep(random_.uniform(0.0, 0.5))
            times.append(stop_time(server, job))
            print(f"{len(times)}: {times[-1]:.3f} s", file=sys.stderr, flush=True)
            server.wait(job, "dismissed")
            time.sleep(0.3)
            left += len(computing(server)) > 1
            everyone = [server.process.pid, *descendants(server.process.pid)]
            idle = {pid: cpu_seconds([pid]) for pid in everyone}
            time.sleep(0.5)
            used = {pid: cpu_seconds([pid]) - before for pid, before in idle.items()}
            if sum(used.values()) > 0.5 * IDLE + 1.0 / TICK:
                busy.append({name_of(pid): round(x, 2) for pid, x in used.items() if x > 0.0})
            now = sum(len(list(Path("/proc").glob(f"{pid}/task/*"))) for pid in everyone)
            threads = threads or now
        return {
            "repeated": len(times),
            "side": side,
            "seconds": {
                "p50": round(quantile(times, 0.5), 3),
                "p99": round(quantile(times, 0.99), 3),
                "max": round(max(times), 3),
            },
            "processes_left": left,
            "busy_afterwards": busy,
            "threads_after_first_and_last": [threads, now],
        }


if __name__ == "__main__":
    main()
