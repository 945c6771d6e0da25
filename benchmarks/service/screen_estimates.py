"""How well the times of ambient occlusion are foreseen: every method on real depth buffers.

Prints measured processor seconds over foreseen ones, so that a busy machine matters less, and the
largest factor either way. `--data` is the folder of the buffers, each with its camera beside it.
"""

import argparse
import os
import tempfile
import time
from pathlib import Path
from typing import Any

os.environ.setdefault("NUMBA_NUM_THREADS", "1")

from adret.products import PRODUCTS, run
from adret.screen import DepthBuffer
from adret_service.estimate import cost

ORDERS: list[dict[str, Any]] = [
    {"method": "exact", "directions": 8},
    {"method": "exact", "directions": 4, "radius": 1.0},
    {"method": "exact", "directions": 4, "falloff": "quadratic", "radius": 1.0},
    {"method": "exact", "directions": 2, "thickness": 0.5},
    {"method": "ffao"},
    {"method": "ffao", "directions": 32, "falloff": "timonen", "falloff_scale": 1.0},
    {"method": "lsao"},
    {"method": "lsao", "directions": 32},
    {"method": "hbao"},
    {"method": "hbao", "directions": 16, "steps": 16},
    {"method": "vao"},
    {"method": "vao", "samples": 32},
    {"method": "crytek"},
    {"method": "crytek", "samples": 64, "denoise": "box"},
    {"method": "lightfield"},
    {"method": "lightfield", "samples": 32, "denoise": "bilateral"},
    {"method": "raytraced", "rays": 8},
    {"method": "hbao", "half_res": True, "radius": 1.0},
    {"method": "exact", "directions": 8, "half_res": True, "radius": 1.0},
]
NAMES = ("sponza_atrium.exr", "bust_ground.npz", "living_room_scan.npz", "tokyo_street.tif")
NAMES += ("trees_and_chains.npz",)


def about(buffer: DepthBuffer) -> dict[str, Any]:
    """What the service knows of a depth buffer."""
    return {
        "kind": "depth",
        "rows": buffer.shape[0],
        "columns": buffer.shape[1],
        "guard_band": list(buffer.guard_band),
        "sky_pixels": int(buffer.sky.sum()),
        "hole_pixels": int(buffer.holes.sum()),
    }


def main() -> None:
    """Print one line an order and buffer."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--names", nargs="*", default=NAMES)
    parser.add_argument("--methods", nargs="*")
    arguments = parser.parse_args()
    product, worst = PRODUCTS["ssao"], 1.0
    # Radii are lengths: of the scene in centimetres another than of those in metres.
    units = {"tokyo_street.tif": 100.0}
    with tempfile.TemporaryDirectory() as folder:
        out, picture = Path(folder) / "out.tif", Path(folder) / "out.png"
        for order in ORDERS:
            if arguments.methods and order["method"] not in arguments.methods:
                continue
            for number, name in enumerate(arguments.names):
                path = arguments.data / name
                buffer = DepthBuffer.open(path, path.with_suffix(".json"))
                unit = units.get(name, 1.0)
                given = dict(order)
                for length in {"radius", "thickness"} & order.keys():
                    given[length] = order[length] * unit
                if order["method"] in ("vao", "crytek", "lightfield"):
                    given["radius"] = unit
                parameters = product.parameters(**given)
                if number == 0:
                    run(product, buffer, parameters, out, picture)  # compiles
                info = about(buffer)
                inputs = {f: getattr(parameters, f) for f in parameters.__dataclass_fields__}
                foreseen = cost("ssao", inputs, info)
                began = time.process_time()
                run(product, buffer, parameters, out, picture)
                took = time.process_time() - began
                ratio = took / foreseen.core_seconds
                worst = max(worst, ratio, 1 / ratio)
                print(
                    f"{name[:15]:15} {took:7.2f} s foreseen {foreseen.core_seconds:7.2f} s "
                    f"ratio {ratio:5.2f}  {order}",
                    flush=True,
                )
    print(f"largest factor: {worst:.2f}")


if __name__ == "__main__":
    main()
