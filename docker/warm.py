"""Compiles the kernels that most jobs need, by running each process once on a small hill."""

import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import adret
from adret import products
from adret_service.compute import warm_up

SUN = {"sun_deg": [315.0, 35.0]}
ORDERS: dict[str, dict[str, Any]] = {
    "horizon": {"directions": 4},
    "sky-view": {"directions": 4},
    "openness": {"directions": 4},
    "shadow": SUN,
    "light": {"directions": 4, "sky": "uniform", **SUN},
    "bounce": {"directions": 4, "sky": "uniform"},
    "viewshed": {"observer": [[32, 32]]},
    "visibility": {"directions": 4},
}


def main() -> None:
    """Run everything; print what each took."""
    print(f"threading layer: {warm_up()}", flush=True)
    y, x = np.mgrid[:64, :64] - 32.0
    hill = adret.Terrain(100.0 * np.exp(-(x * x + y * y) / 200.0), (10.0, 10.0))
    with tempfile.TemporaryDirectory() as folder:
        for process, inputs in ORDERS.items():
            began = time.monotonic()
            product = products.PRODUCTS[process]
            parameters = product.parameters(**inputs)
            out = Path(folder) / f"{process}.tif"
            products.run(product, hill, parameters, out, preview_path=out.with_suffix(".png"))
            print(f"{process}: {time.monotonic() - began:.1f} s", flush=True)


if __name__ == "__main__":
    main()
