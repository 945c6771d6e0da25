"""What filters and half resolution do to the error and to the edges of ambient occlusion.

    python benchmarks/ssao_filters.py

Prints a table in Markdown. Needs the data folder (`$ADRET_DATA`, else ../shared/data). Error: mean
of |filtered - reference|, the reference being volumetric occlusion of 512 pipes. Leak: mean change
that the filter makes of the reference itself, within 2 pixels of edges of depth.
"""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from adret import DepthBuffer
from adret.screen import ambient_occlusion
from adret.screen.denoise import (
    box_4x4,
    cross_bilateral,
    edge_leakage,
    gaussian,
    joint_bilateral_upsample,
)

DATA = Path(os.environ.get("ADRET_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
SCENES = (
    ("living room", "living_room_scan", ".npz", 0.4),
    ("Sponza", "sponza_atrium", ".exr", 0.8),
)
GUARD_BAND = (300, 450, 300, 450)


def rows(name: str, file: str, suffix: str, radius: float) -> list[str]:
    """Lines of the table for one depth buffer."""
    folder = DATA / "depth"
    opened = DepthBuffer.open(folder / (file + suffix), folder / f"{file}.json")
    buffer = DepthBuffer(opened.depth, opened.camera, guard_band=GUARD_BAND)
    row0, row1, column0, column1 = buffer.frame
    depth = buffer.depth[row0:row1, column0:column1]
    vao = {"method": "vao", "radius": radius}
    reference = ambient_occlusion(buffer, samples=512, tile=8, disk="stratified", **vao).occlusion
    noisy = [ambient_occlusion(buffer, samples=n, **vao).occlusion for n in (4, 8)]
    like = {"depth_tolerance": 0.5 * radius}
    filters: dict[str, Callable[[np.ndarray], np.ndarray]] = {
        "none": lambda v: v,
        "box 4 x 4": lambda v: box_4x4(v, depth, **like),
        "cross-bilateral 15 x 15, two passes": lambda v: cross_bilateral(v, depth, **like),
        "cross-bilateral 15 x 15, whole": lambda v: cross_bilateral(
            v, depth, separable=False, **like
        ),
        "Gaussian 5 x 5": gaussian,
        "every second pixel, joint bilateral": lambda v: joint_bilateral_upsample(
            v[::2, ::2], depth[::2, ::2], depth, **like
        ),
    }
    lines = []
    for filter_name, apply in filters.items():
        errors = [float(np.nanmean(np.abs(apply(v) - reference))) for v in noisy]
        leak = edge_leakage(reference, apply(reference), depth, depth_step=0.5 * radius)
        lines.append(f"| {name} | {filter_name} | {errors[0]:.4f} | {errors[1]:.4f} | {leak:.4f} |")
    return lines


if __name__ == "__main__":
    print("| depth buffer | filter | error, 4 pipes | error, 8 pipes | leak |")
    print("|---|---|---|---|---|")
    for scene in SCENES:
        print("\n".join(rows(*scene)))
