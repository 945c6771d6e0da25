"""The horizon of a place and a map tile, from request to answer, with everything warm.

    python benchmarks/service/horizons.py --repeat 50

One server over loopback, one DEM of 1000 x 1000 cells of 30 m, a new place or tile each time.
"""

import argparse
import json
import random
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from common import quantile, record
from servers import Server, write_dem

SIDE = 1000


def relief(side: int) -> Any:
    """Heights of sums of random waves, from hills to mountains."""
    rng = np.random.default_rng(7)
    y, x = np.mgrid[:side, :side].astype(np.float32)
    heights = np.zeros((side, side), np.float32)
    for length in (400, 150, 60, 25, 10):
        for _ in range(4):
            angle, phase = rng.uniform(0, 2 * np.pi, 2)
            way = np.cos(angle) * x + np.sin(angle) * y
            heights += length * 1.2 * np.sin(2 * np.pi * way / length + phase)
    return heights


def times(server: Server, paths: list[str]) -> dict[str, float]:
    """Ask for each path; returns first, median, 99th percentile and longest time [ms]."""
    taken = []
    for path in paths:
        began = time.perf_counter()
        answer = server.http.get(path)
        taken.append((time.perf_counter() - began) * 1e3)
        assert answer.status_code in (200, 204), answer.text
    warm = taken[1:]
    return {
        "calls": len(warm),
        "first_ms": round(taken[0], 1),
        "p50_ms": round(quantile(warm, 0.5), 1),
        "p99_ms": round(quantile(warm, 0.99), 1),
        "max_ms": round(max(warm), 1),
    }


def measure(repeat: int) -> dict[str, Any]:
    """Ask so often for each kind of view."""
    random_ = random.Random(3)
    with tempfile.TemporaryDirectory() as folder:
        server = Server(Path(folder) / "data", ADRET_ROLE="api", ADRET_VIEWERS="1")
        try:
            server.start(ready=False)
            dem = write_dem(Path(folder) / "dem.tif", relief(SIDE))
            url = f"/datasets/{server.upload(dem).json()['id']}"
            figures = {}
            for azimuths in (48, 360):
                places = [
                    f"{url}/horizon?lat={44.90 + 0.22 * random_.random():.5f}"
                    f"&lon={7.75 + 0.33 * random_.random():.5f}&azimuths={azimuths}"
                    for _ in range(repeat + 1)
                ]
                figures[f"horizon, {azimuths} azimuths"] = times(server, places)
            grid = server.http.get(f"{url}/tilejson.json").json()
            tiles = tiles_of(grid["bounds"], grid["maxzoom"] + 1)
            random_.shuffle(tiles)
            paths = [f"{url}/tiles/{z}/{x}/{y}.png" for z, x, y in tiles[: repeat + 1]]
            figures["tile, png"] = times(server, paths)
            figures["tile again, from memory"] = times(server, [paths[0]] * (repeat + 1))
        finally:
            server.stop()
    return figures


def tiles_of(bounds: list[float], zoom: int) -> list[tuple[int, int, int]]:
    """Return the tiles of a zoom that touch a box of degrees."""
    west, south, east, north = bounds
    size = 2**zoom

    def row(latitude: float) -> int:
        return int(size * (1.0 - np.arcsinh(np.tan(np.radians(latitude))) / np.pi) / 2.0)

    columns = range(int(size * (west + 180) / 360), int(size * (east + 180) / 360) + 1)
    return [(zoom, x, y) for x in columns for y in range(row(north), row(south) + 1)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeat", type=int, default=50)
    parser.add_argument("--keep", action="store_true", help="Write the results' file.")
    options = parser.parse_args()
    figures = measure(options.repeat)
    if options.keep:
        record("horizons", figures)
    else:
        print(json.dumps(figures, indent=1))


if __name__ == "__main__":
    main()
