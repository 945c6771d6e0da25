"""Many clients that ask for the state of jobs and fetch results while jobs run.

    python benchmarks/service/load.py --seconds 180

Every client asks for its job's state once a second, as `Retry-After` tells it to, and between that
fetches a map tile, a preview or a part of a result.
"""

import argparse
import asyncio
import math
import random
import time
from collections import Counter
from typing import Any
from urllib.parse import urlsplit

from common import DEM, milliseconds, quantile, record, resident, serving
from connection import Answer, Connection
from servers import Server

ORDER = {"directions": 64}


class Load:
    """What the clients of one run have seen."""

    def __init__(self, server: Server, dataset: str, tiles: list[str]) -> None:
        self.server, self.dataset, self.tiles = server, dataset, tiles
        self.times: dict[str, list[float]] = {"status": [], "fetch": []}
        self.codes: Counter[str] = Counter()
        self.jobs: list[str] = []
        self.finished: list[str] = []
        self.memory: list[int] = []
        self.end = 0.0

    def count(self, kind: str, answer: Answer) -> None:
        self.codes[f"{kind} {answer.status}"] += 1
        self.times[kind].append(answer.seconds)

    async def client(self, number: int) -> None:
        """One client: asks, waits, fetches."""
        random_ = random.Random(number)
        await asyncio.sleep(random_.random())
        async with Connection("127.0.0.1", self.server.port) as connection:
            while time.monotonic() < self.end:
                job = random_.choice(self.jobs)
                answer = await connection.ask("GET", f"/jobs/{job}")
                self.count("status", answer)
                await asyncio.sleep(random_.uniform(0.3, 0.7))
                if random_.random() < 0.5:
                    path, headers = self.wanted(random_)
                    self.count("fetch", await connection.ask("GET", path, headers=headers))
                await asyncio.sleep(random_.uniform(0.3, 0.7))

    def wanted(self, random_: random.Random) -> tuple[str, dict[str, str]]:
        """What a client fetches: a map tile, a preview, or a part of a raster."""
        job = random_.choice(self.finished)
        kind = random_.choice(["tile", "preview", "range", "range"])
        if kind == "tile":
            return random_.choice(self.tiles), {}
        if kind == "preview":
            return f"/jobs/{job}/results/preview", {}
        start = random_.randrange(4) * 1024
        return f"/jobs/{job}/results/result", {"Range": f"bytes={start}-{start + 65535}"}

    async def orders(self) -> None:
        """Keep a job running and a few waiting."""
        async with Connection("127.0.0.1", self.server.port) as connection:
            while time.monotonic() < self.end:
                answer = await connection.ask("GET", "/jobs?status=accepted&limit=5")
                if len(answer.json()["jobs"]) < 3:
                    body = {"inputs": {"dataset": self.dataset, **ORDER}}
                    made = await connection.ask("POST", "/processes/sky-view/execution", body)
                    self.codes[f"order {made.status}"] += 1
                    if made.status == 201:
                        self.jobs.append(made.json()["jobID"])
                await asyncio.sleep(0.5)

    async def watch(self) -> None:
        """Look at the memory of the API every two seconds."""
        assert self.server.process is not None
        while time.monotonic() < self.end:
            self.memory.append(resident(self.server.process.pid))
            await asyncio.sleep(2.0)

    async def run(self, clients: int, seconds: float) -> None:
        self.end = time.monotonic() + seconds
        tasks = [self.client(number) for number in range(clients)]
        await asyncio.gather(self.orders(), self.watch(), *tasks)


def tiles_of(server: Server, dataset: str) -> list[str]:
    """Return the paths of the tiles that a map of a dataset shows at three zoom levels."""
    described = server.http.get(f"/datasets/{dataset}/tilejson.json").json()
    west, south, east, north = described["bounds"]
    template = urlsplit(described["tiles"][0]).path
    paths = []
    for zoom in (9, 10, 11):
        left, top = (int(each) for each in place(west, north, zoom))
        right, bottom = (int(each) for each in place(east, south, zoom))
        for x in range(left, right + 1):
            for y in range(top, bottom + 1):
                paths.append(template.format(z=zoom, x=x, y=y))
    return paths


def place(longitude: float, latitude: float, zoom: int) -> tuple[float, float]:
    """Return where a place lies among the tiles of a zoom level."""
    count = 2.0**zoom
    y = math.asinh(math.tan(math.radians(latitude))) / math.pi
    return (longitude + 180.0) / 360.0 * count, (1.0 - y) / 2.0 * count


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=180.0)
    parser.add_argument("--clients", type=int, default=200)
    parser.add_argument("--database", choices=["sqlite", "postgresql"], default="sqlite")
    parser.add_argument("--keep", action="store_true", help="Write the results' file.")
    options = parser.parse_args()
    with serving(options.database, ADRET_THREADS_PER_JOB="1", ADRET_COMPUTE_NICE="10") as server:
        dataset = server.upload(DEM).json()["id"]
        load = Load(server, dataset, tiles_of(server, dataset))
        for _ in range(3):
            job = server.submit("sky-view", dataset=dataset, **ORDER)
            server.wait(job, "successful")
            load.finished.append(job)
        load.jobs += load.finished
        asyncio.run(load.run(options.clients, options.seconds))
        figures = account(load, options)
    if options.keep:
        record(f"load-{options.database}", figures)
    else:
        print(figures)


def account(load: Load, options: argparse.Namespace) -> dict[str, Any]:
    """Sum a run up."""
    tenth = max(1, len(load.memory) // 10)
    early, late = load.memory[tenth : 2 * tenth], load.memory[-tenth:]
    growth = quantile(late, 0.5) / quantile(early, 0.5) - 1.0
    return {
        "clients": options.clients,
        "seconds": options.seconds,
        "requests_a_second": round(sum(load.codes.values()) / options.seconds, 1),
        "status_ms": milliseconds(load.times["status"]),
        "fetch_ms": milliseconds(load.times["fetch"]),
        "answers": dict(sorted(load.codes.items())),
        "server_errors": sum(n for name, n in load.codes.items() if name.split()[1] >= "500"),
        "memory_mib": [round(quantile(part, 0.5) / 2**20, 1) for part in (early, late)],
        "memory_growth_percent": round(100 * growth, 1),
    }


if __name__ == "__main__":
    main()
