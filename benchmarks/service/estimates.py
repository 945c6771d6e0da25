"""How well orders' times are foreseen: seconds by the built-in line and as measured.

Runs small orders of every process in this process, on one core, and prints measured processor
seconds over foreseen ones, so that a busy machine matters less; the largest factor either way is
what `adret_service.estimate.FACTOR` must cover.
"""

import os
import tempfile
import time
from pathlib import Path
from typing import Any

os.environ.setdefault("NUMBA_NUM_THREADS", "1")

import numpy as np

import adret
from adret.products import PRODUCTS, run
from adret_service.estimate import cost

ORDERS: list[tuple[str, dict[str, Any]]] = [
    ("horizon", {"directions": 16}),
    ("horizon", {"directions": 8, "method": "hull"}),
    ("horizon", {"directions": 4, "method": "march"}),
    ("horizon", {"directions": 4, "method": "exact"}),
    ("sky-view", {"directions": 16}),
    ("sky-view", {"directions": 16, "kind": "normal"}),
    ("openness", {"directions": 16}),
    ("shadow", {"sun_deg": (300.0, 20.0)}),
    ("light", {"directions": 16, "sky": "uniform", "sun_deg": (300.0, 20.0)}),
    ("bounce", {"directions": 8, "sky": "uniform"}),
    ("viewshed", {"observer": ((100, 100), (50, 180))}),
    ("visibility", {"directions": 8}),
    ("visibility", {"directions": 8, "method": "march"}),
    ("visibility", {"directions": 8, "method": "tree"}),
    ("ssao", {}),
]


def terrain(side: int) -> adret.Terrain:
    """Rough ground: octaves of noise."""
    rng = np.random.default_rng(1)
    heights = np.zeros((side, side))
    for octave in range(3, 8):
        coarse = rng.standard_normal((side // (1 << octave) + 2,) * 2)
        at = np.linspace(0, coarse.shape[0] - 1.001, side)
        rows = np.array([np.interp(at, np.arange(coarse.shape[0]), c) for c in coarse.T]).T
        full = np.array([np.interp(at, np.arange(coarse.shape[1]), r) for r in rows])
        heights += full * (1 << octave) * 0.6
    return adret.Terrain(heights.astype(np.float32), (10.0, 10.0))


def source(name: str, side: int) -> Any:
    """What a process reads: rough ground, or a frame that looks onto it."""
    ground = terrain(side)
    if PRODUCTS[name].reads == "terrain":
        return ground
    from adret.screen import Camera, DepthBuffer

    depth = 200.0 - (ground.heights - ground.heights.mean())
    camera = Camera.from_mapping({"width": side, "height": side, "fov_y_deg": 50.0})
    return DepthBuffer(depth.astype(np.float32), camera)


def main() -> None:
    """Print one line an order and size."""
    worst = 1.0
    with tempfile.TemporaryDirectory() as folder:
        out, picture = Path(folder) / "out.tif", Path(folder) / "out.png"
        for name, given in ORDERS:
            product = PRODUCTS[name]
            parameters = product.parameters(**given)
            run(product, source(name, 256), parameters, out, picture)  # compiles
            for side in (256, 700):
                ground = source(name, side)
                info = {"rows": side, "columns": side, "cell_size": [10.0, 10.0]}
                inputs = {f: getattr(parameters, f) for f in parameters.__dataclass_fields__}
                foreseen = cost(name, inputs, info)
                began = time.process_time()
                run(product, ground, parameters, out, picture)
                took = time.process_time() - began
                ratio = took / foreseen.core_seconds
                worst = max(worst, ratio, 1 / ratio)
                each = took / (foreseen.cells * foreseen.passes) * 1e9
                print(
                    f"{name:12} {given.get('method', ''):6} {side:5} {took:8.3f} s "
                    f"foreseen {foreseen.core_seconds:8.3f} s  ratio {ratio:5.2f}  "
                    f"{each:8.1f} ns a cell and pass, reach {foreseen.reach:.0f}",
                    flush=True,
                )
    print(f"largest factor: {worst:.2f}")


if __name__ == "__main__":
    main()
