"""Time of the methods that look arbitrarily far, against the radius, in one run.

    python benchmarks/far_effects.py [--pixels 1920x1080] [--repeats 3] [--full]

Prints seconds (wall, processor) of line-sweep and far-field obscurance for radii from 8 pixels to
unlimited, and the ratio of the slowest to the fastest radius; then what a frame takes with the
usual settings. `--full` adds far-field runs of all directions. Runs of all radii take turns, and
the least time of each counts, so that what else the machine does falls on all alike.
"""

import argparse
import math
import time
from typing import Any

import numpy as np

from adret import Camera, DepthBuffer
from adret._kernels.jit import threads
from adret.screen import ffao, lsao

RADII = (8, 32, 128, 512, math.inf)
GUARD = 0.1


def scene(columns: int, rows: int) -> DepthBuffer:
    """A hilly floor with pillars of many sizes, and a guard band of a tenth."""
    band = round(GUARD * rows), round(GUARD * columns)
    height, width = rows + 2 * band[0], columns + 2 * band[1]
    draw = np.random.default_rng(7)
    y, x = np.mgrid[0:height, 0:width] / height
    depth = 20.0 + sum(
        np.sin(6.0 * (a * x + b * y) + c) for a, b, c in draw.uniform(-3.0, 3.0, (8, 3))
    )
    for _ in range(60):
        row, column, side = draw.uniform(0.0, 1.0, 3) * (height, width, 0.12 * height)
        block = np.s_[int(row) : int(row + side) + 2, int(column) : int(column + 0.5 * side) + 2]
        depth[block] = depth[block].min(initial=20.0) - draw.uniform(0.5, 5.0)
    camera = Camera.perspective(width, height, fov_y_deg=60.0)
    return DepthBuffer(depth, camera, guard_band=(band[0], band[1], band[0], band[1]))


def pixel_of(buffer: DepthBuffer) -> float:
    """Width of a pixel at the middle depth."""
    return float(abs(buffer.field.rays[0]) * np.nanmedian(buffer.depth))


def weighted(buffer: DepthBuffer, pixels: float) -> dict[str, Any]:
    """Options of a falloff worth 1/2 at half of the radius."""
    scale = 0.5 * (pixels if math.isfinite(pixels) else 512.0) * pixel_of(buffer)
    radius = pixels * pixel_of(buffer)
    return {"falloff": "timonen", "falloff_scale": scale * scale, "radius": radius}


def times(buffer: DepthBuffer, runs: dict[str, Any], repeats: int) -> dict[str, tuple[float, ...]]:
    """Least wall and processor time of each run (module, options) [s]; runs take turns."""
    field = buffer.field
    best: dict[str, tuple[float, ...]] = dict.fromkeys(runs, (math.inf, math.inf))
    for _ in range(repeats):
        for name, (module, options) in runs.items():
            chosen = module.Options(**options)
            start = time.perf_counter(), time.process_time()
            module.estimate(field, chosen, None)
            took = time.perf_counter() - start[0], time.process_time() - start[1]
            best[name] = min(best[name][0], took[0]), min(best[name][1], took[1])
    return best


def by_radius(buffer: DepthBuffer, module: Any, repeats: int, **options: Any) -> tuple[float, ...]:
    """Ratios slowest to fastest radius, of wall and of processor time."""
    runs = {f"{pixels} px": (module, options | weighted(buffer, pixels)) for pixels in RADII}
    found = times(buffer, runs, repeats)
    for name, (wall, processor) in found.items():
        print(f"{module.__name__:20s} radius {name:8s} {wall:7.3f} s wall {processor:7.3f} s cpu")
    both = list(zip(*found.values(), strict=True))
    ratios = tuple(max(each) / min(each) for each in both)
    print(f"{module.__name__:20s} slowest / fastest: wall {ratios[0]:.2f}, cpu {ratios[1]:.2f}")
    return ratios


def main() -> None:
    """Print all times."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pixels", default="1920x1080")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--full", action="store_true")
    chosen = parser.parse_args()
    columns, rows = (int(each) for each in chosen.pixels.split("x"))
    small = scene(160, 90)
    for module, options in ((lsao, {}), (ffao, {"separation": True, "directions": 9})):
        times(small, {"compile": (module, options)}, 1)
    buffer = scene(columns, rows)
    print(f"{columns} x {rows}, {threads()} threads")
    far = {"near_field": False, "separation": True, "directions": 9}
    by_radius(buffer, lsao, chosen.repeats, directions=8)
    by_radius(buffer, ffao, chosen.repeats, **far)
    falloff = weighted(buffer, 256)
    runs = {
        "lsao 8, dense": (lsao, {"directions": 8, **falloff}),
        "lsao 8, sparse": (lsao, {"directions": 8, "step": 2.83, "line_spacing": 2.12, **falloff}),
        "ffao 9 x 2 far, separated": (ffao, far | falloff),
        "ffao 18 x 2 far, separated": (ffao, far | {"directions": 18} | falloff),
    }
    if chosen.full:
        runs["ffao 8 x 2 far"] = (ffao, {"directions": 8, "near_field": False, **falloff})
        runs["ffao 8 x 2 far, W = 1"] = (ffao, {"directions": 8, "near_field": False})
    for name, (wall, processor) in times(buffer, runs, chosen.repeats).items():
        rate = 1e-6 * columns * rows / processor
        print(f"{name:28s} {wall:7.3f} s wall {processor:7.3f} s cpu {rate:6.2f} Mpix/s a core")


if __name__ == "__main__":
    main()
