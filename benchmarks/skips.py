"""What each skip saves: the same run with all skips and with ADRET_SKIP=none, in one process.

    python benchmarks/skips.py

Writes results/skips.json and results/skips.md: processor seconds of both (the least of seven runs
that take turns), the saved share, the counter of the report, and that the bytes are the same.
"""

import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("NUMBA_NUM_THREADS", str(os.cpu_count()))

import numpy as np
from present import about

import adret
from adret import skips

RESULTS = Path(__file__).parent / "results"
REPEATS = 7
SIDE = 700


def rough(rim: float = 0.0) -> adret.Terrain:
    """Hills; the western column stands `rim` above them."""
    draw = np.random.default_rng(4)
    y, x = np.mgrid[0:SIDE, 0:SIDE] / SIDE
    z = sum(200.0 / f * np.sin(f * (a * x + b * y)) for f, a, b in draw.uniform(2, 40, (30, 3)))
    z += draw.normal(0.0, 3.0, z.shape)
    z[:, 0] += rim
    return adret.Terrain(z, (30.0, 30.0))


def sea(apart: int = 50) -> adret.Terrain:
    """Level water with islets."""
    z = np.zeros((SIDE, SIDE))
    z[::apart, ::apart] = -1.0
    return adret.Terrain(z, (30.0, 30.0), datum=0.0)


def coast() -> adret.Terrain:
    """Hills; no data beyond a slanting coast, which is half of the raster."""
    z = np.array(rough().heights)
    y, x = np.mgrid[0:SIDE, 0:SIDE]
    z[x + y > SIDE] = np.nan
    return adret.Terrain(z, (30.0, 30.0))


def lake() -> adret.Terrain:
    """Hills round a level lake, a quarter of the raster."""
    z = np.array(rough().heights)
    z[SIDE // 4 : -SIDE // 4, SIDE // 4 : -SIDE // 4] = np.median(z)
    return adret.Terrain(z, (30.0, 30.0))


def horizons(terrain: adret.Terrain) -> bytes:
    return adret.horizon_map(terrain, 16).elevation.tobytes()


def exact(terrain: adret.Terrain) -> bytes:
    part = terrain.window((0, 250), (0, 250))
    return adret.horizon_map(part, 4, method="exact").elevation.tobytes()


def repeated(terrain: adret.Terrain) -> bytes:
    azimuths = np.tile(np.linspace(0.0, 6.0, 6), 3)
    return adret.horizon_map(terrain, azimuths=azimuths).elevation.tobytes()


def one_window(terrain: adret.Terrain) -> bytes:
    picture = np.zeros((16, 32, 3), np.float32)
    picture[4:8, 5:8] = 1.0
    return adret.direct_light(terrain, adret.Environment(picture), 32).irradiance.tobytes()


def night(terrain: adret.Terrain) -> bytes:
    return adret.shadow(terrain, adret.Sun(200.0, -80.0)).lit.tobytes()


RUNS: dict[str, tuple[str, Callable[[], adret.Terrain], Callable[[adret.Terrain], bytes]]] = {
    "far edge, hills": ("far edge", rough, horizons),
    "far edge, hills with a high rim": ("far edge", lambda: rough(400.0), horizons),
    "far field, water": ("far field", sea, horizons),
    "far field, hills": ("far field", rough, horizons),
    "level ground, water": ("level ground", lambda: sea(250), horizons),
    "level ground, a lake in hills": ("level ground", lake, horizons),
    "nodata, half of hills": ("nodata", coast, horizons),
    "ends of rays, hills": ("ends of rays", rough, exact),
    "same azimuths, each three times": ("same azimuths", rough, repeated),
    "dark azimuths, light through a window": ("dark azimuths", rough, one_window),
    "dark azimuths, sun below every plane": ("dark azimuths", rough, night),
}


def measure(
    name: str, terrain: adret.Terrain, run: Callable[[adret.Terrain], bytes]
) -> dict[str, Any]:
    """Processor seconds with and without skips, the counter, and whether the bytes agree."""
    least = dict.fromkeys(("none", "all"), float("inf"))
    found: dict[str, bytes] = {}
    counted = 0
    for _ in range(REPEATS):
        for choice in least:
            os.environ["ADRET_SKIP"] = choice
            start = time.process_time()
            found[choice] = run(terrain)
            least[choice] = min(least[choice], time.process_time() - start)
            report = adret.last_run_report()
            counted = report.skipped.get(name, 0) if report is not None else 0
    return {
        "seconds_without": least["none"],
        "seconds_with": least["all"],
        "saved": 1.0 - least["all"] / least["none"],
        "counted": counted,
        "same_bytes": found["none"] == found["all"],
    }


def main() -> None:
    """Measure all and write the table."""
    results: dict[str, Any] = {"about": about(), "side": SIDE, "runs": {}}
    for title, (name, ground, run) in RUNS.items():
        terrain = ground()
        run(terrain)  # kernels are compiled
        results["runs"][title] = measure(name, terrain, run)
        print(title, results["runs"][title], flush=True)
    (RESULTS / "skips.json").write_text(json.dumps(results, indent=1) + "\n")
    lines = [
        "# What skips save",
        "",
        f"{SIDE} x {SIDE} cells; processor seconds with ADRET_SKIP=none and with all skips.",
        "",
        "| run | without skips | with | saved | counted | same bytes |",
        "|---|---:|---:|---:|---:|---|",
    ]
    for title, one in results["runs"].items():
        lines.append(
            f"| {title} | {one['seconds_without']:.3f} | {one['seconds_with']:.3f} "
            f"| {100.0 * one['saved']:.0f} % | {one['counted']} "
            f"| {'yes' if one['same_bytes'] else 'NO'} |"
        )
    lines += ["", "What is counted:", ""]
    lines += [f"- {name}: {text}" for name, text in skips.SKIPS.items()]
    (RESULTS / "skips.md").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
