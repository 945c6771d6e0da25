"""How many orders a second are accepted, durably, before the queue is full and says so.

python benchmarks/service/orders.py --database sqlite
"""

import argparse
import asyncio
import time
from collections import Counter
from typing import Any

from common import DEM, milliseconds, record, serving
from connection import Connection


async def order(port: int, dataset: str, clients: int, seconds: float) -> dict[str, Any]:
    """Order as fast as the service answers, over so many connections."""
    times: list[float] = []
    codes: Counter[str] = Counter()
    end = time.monotonic() + seconds
    last = 0.0

    async def one(number: int) -> None:
        nonlocal last
        body = {"inputs": {"dataset": dataset}}
        async with Connection("127.0.0.1", port) as connection:
            while time.monotonic() < end:
                answer = await connection.ask("POST", "/processes/shadow/execution", body)
                later = "retry-after" in answer.headers
                codes[f"{answer.status}{' with Retry-After' if later else ''}"] += 1
                if answer.status == 201:
                    times.append(answer.seconds)
                    last = time.monotonic()

    began = time.monotonic()
    await asyncio.gather(*(one(number) for number in range(clients)))
    return {
        "clients": clients,
        "accepted": codes["201"],
        "accepted_a_second": round(codes["201"] / max(last - began, 1e-9), 1),
        "answers": dict(sorted(codes.items())),
        "accepted_ms": milliseconds(times),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--database", choices=["sqlite", "postgresql"], default="sqlite")
    parser.add_argument("--seconds", type=float, default=15.0)
    parser.add_argument("--clients", type=int, default=16)
    parser.add_argument("--keep", action="store_true", help="Write the results' file.")
    options = parser.parse_args()
    with serving(options.database, ADRET_THREADS_PER_JOB="1") as server:
        dataset = server.upload(DEM).json()["id"]
        run = order(server.port, dataset, options.clients, options.seconds)
        figures = asyncio.run(run)
    if options.keep:
        record(f"orders-{options.database}", figures)
    else:
        print(figures)


if __name__ == "__main__":
    main()
