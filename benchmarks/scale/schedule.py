"""Where more workers stop helping: recorded tile times, a real scheduler's cost, and latency.

    python benchmarks/scale/schedule.py

The cost of an order is measured on a Dask scheduler in this process with workers that do nothing.
Then a simulation hands the tiles of a 30 000² raster to 1 to 1000 workers: the scheduler deals with
one message at a time, an order and its answer each take the latency, a worker begins its next tile
only when it has it, or at once where one more order was sent ahead. Tile times are those that
tiles.py recorded, drawn again and again with a fixed seed.

The simulation is held against Dask's own scheduler in this process, with up to 10 workers that
sleep for a tenth of the recorded times and for the latency of an order and its answer. (With 100 of
them in one process their heartbeats alone keep a core busy, which says nothing of the scheduler.)
Writes results/schedule.json and .md.
"""

import asyncio
import heapq
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

RESULTS = Path(__file__).parent / "results"
ORDERS = 2000
CHECKED = 12
LATENCIES = (0.001, 0.05, 0.5)  # s: a rack, a continent, a bad day
WORKERS = (1, 2, 4, 10, 100, 1000)
SPREAD = 0.15  # of a tile's time, where only its mean is recorded

# Places worth doing: cells, and words.
EARTH = (5.0e11, "Earth at 1 arc-second")
MOON = (1.52e12, "Moon at 5 m")


def nothing(number: int) -> int:
    """A tile that takes no time."""
    return number


def cost_of_an_order() -> float:
    """CPU seconds an order, of scheduler, client and two workers together: at the most."""
    from distributed import Client, LocalCluster, as_completed

    with (
        LocalCluster(
            n_workers=2, threads_per_worker=1, processes=False, dashboard_address="127.0.0.1:0"
        ) as cluster,
        Client(cluster) as client,
    ):
        client.submit(nothing, -1).result()
        start = time.process_time()
        futures = [client.submit(nothing, number, pure=False) for number in range(ORDERS)]
        for _ in as_completed(futures):
            pass
        return (time.process_time() - start) / ORDERS


async def asleep(seconds: float, latency: float) -> None:
    """A tile that takes a worker's time, and whose order and answer are under way."""
    await asyncio.sleep(seconds + 2.0 * latency)


def scheduled(seconds: Any, workers: int, latency: float) -> float:
    """Wall time [s] of such tiles under Dask's scheduler."""
    from distributed import Client, LocalCluster, as_completed

    with (
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=False,
            dashboard_address="127.0.0.1:0",
        ) as cluster,
        Client(cluster) as client,
    ):
        client.submit(nothing, -1).result()
        start = time.perf_counter()
        futures = [client.submit(asleep, each, latency, pure=False) for each in seconds.tolist()]
        for _ in as_completed(futures):
            pass
        return time.perf_counter() - start


def simulate(seconds: Any, workers: int, cost: float, latency: float, ahead: int) -> float:
    """Wall time [s] of tiles that take `seconds` each."""
    waiting = list(seconds[::-1])
    # Events: (time, worker) at which the scheduler hears that a worker wants an order.
    events = [(0.0, worker) for worker in range(workers) for _ in range(1 + ahead)]
    heapq.heapify(events)
    scheduler = 0.0  # free again at
    busy = [0.0] * workers  # each worker is free again at
    end = 0.0
    while waiting:
        heard, worker = heapq.heappop(events)
        scheduler = max(scheduler, heard) + cost
        begin = max(busy[worker], scheduler + latency)
        busy[worker] = begin + waiting.pop()
        end = max(end, busy[worker] + latency)
        heapq.heappush(events, (busy[worker] + latency, worker))
    return end


def recorded() -> tuple[Any, float, float]:
    """Tile times [s], CPU nanoseconds a sample and bytes a cell of the 30 000² raster."""
    known = json.loads((RESULTS / "tiles.json").read_text())["size"]["30000-2048"]
    products = known["products"].values()
    mean = sum(each["cpu_seconds"] for each in products) / known["tiles_measured"]
    rng = np.random.default_rng(7)
    seconds = mean * rng.normal(1.0, SPREAD, size=known["tiles"] * len(products)).clip(0.3, 3.0)
    samples = sum(each["cells"] for each in products) * 32
    nanoseconds = sum(each["cpu_seconds"] for each in products) / samples * 1e9
    return seconds / len(products), nanoseconds, sum(each["bytes_a_cell"] for each in products)


def main() -> None:
    """Measure, simulate, write."""
    cost = cost_of_an_order()
    seconds, nanoseconds, size = recorded()
    lines = [
        "# Scheduling",
        "",
        f"One order costs Dask's scheduler at most {cost * 1e3:.2f} ms (CPU time of {ORDERS} empty "
        "tasks, of client and workers as well). "
        f"{len(seconds)} tiles of {seconds.mean():.1f} CPU s each, one core a worker.",
        "",
        "| workers | latency | efficiency, one order a worker | one more sent ahead |",
        "|---|---|---|---|",
    ]
    table = []
    total = float(seconds.sum())
    for latency in LATENCIES:
        for workers in WORKERS:
            # Enough tiles that the last ones are not what is measured: at least 20 a worker.
            many = np.resize(seconds, max(len(seconds), 20 * workers))
            work = float(many.sum())
            shares = [
                work / workers / simulate(many, workers, cost, latency, ahead) for ahead in (0, 1)
            ]
            table.append({"workers": workers, "latency_s": latency, "efficiency": shares})
            lines.append(
                f"| {workers} | {latency * 1e3:g} ms | {shares[0]:.3f} | {shares[1]:.3f} |"
            )
    lines += [
        "",
        f"Held against Dask's scheduler in this process: {CHECKED} tiles a worker that sleep a "
        "tenth of their time.",
        "",
        "| workers | latency | efficiency, simulated | Dask's scheduler |",
        "|---|---|---|---|",
    ]
    held = []
    for workers in (2, 4, 10):
        for latency in (0.001, 0.05):
            few = 0.1 * np.resize(seconds, CHECKED * workers)
            ideal = float(few.sum()) / workers
            pair = [
                ideal / simulate(few, workers, cost, latency, 0),
                ideal / scheduled(few, workers, latency),
            ]
            held.append({"workers": workers, "latency_s": latency, "efficiency": pair})
            lines.append(f"| {workers} | {latency * 1e3:g} ms | {pair[0]:.3f} | {pair[1]:.3f} |")
    limit = float(seconds.mean()) / cost
    lines += [
        "",
        f"The scheduler is busy all the time from {limit:.0f} workers on (tile time over order "
        "cost): that is where it saturates.",
        "",
        "| raster | cells | CPU hours | tiles on disk |",
        "|---|---|---|---|",
    ]
    for cells, words in (EARTH, MOON):
        hours = cells * 32 * 2 * nanoseconds * 1e-9 / 3600.0
        lines.append(
            f"| {words}, sky view and 32 horizons | {cells:.2g} | {hours:,.0f} "
            f"| {cells * size / 1e12:.1f} TB |"
        )
    RESULTS.mkdir(exist_ok=True)
    document = {
        "order_s": cost,
        "tile_cpu_s": float(seconds.mean()),
        "work_cpu_s": total,
        "ns_a_sample": nanoseconds,
        "bytes_a_cell": size,
        "saturates_at_workers": limit,
        "efficiency": table,
        "held_against_dask": held,
    }
    (RESULTS / "schedule.json").write_text(json.dumps(document, indent=1) + "\n")
    (RESULTS / "schedule.md").write_text("\n".join(lines) + "\n")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
