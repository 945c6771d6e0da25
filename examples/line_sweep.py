"""Picture of line-sweep obscurance: dense and sparse sweeps, and the three tangent planes.

Writes line-sweep.png to a folder (default docs/images). Needs matplotlib.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib import pyplot

import adret

EXAMPLES = Path(__file__).resolve().parent
ROOM = EXAMPLES / "data" / "living_room.npz"
DIRECTIONS = 8


def main(folder: Path) -> None:
    """Draw both rows of pictures."""
    buffer = adret.DepthBuffer.open(ROOM, ROOM.with_suffix(".json"))
    reach = 0.4 * float(np.nanmedian(buffer.depth))
    common = {"method": "lsao", "directions": DIRECTIONS, "falloff_scale": reach * reach}

    def estimate(**options: object) -> np.ndarray:
        return adret.ambient_occlusion(buffer, **common, **options).occlusion

    dense = estimate()
    sparse = estimate(step=2.83, line_spacing=2.12)
    pictures = [
        ("dense", dense, "gray_r", 0.0, 0.6),
        ("a sample for 6 pixels", sparse, "gray_r", 0.0, 0.6),
        ("sparse less dense", sparse - dense, "RdBu_r", -0.1, 0.1),
        ("8 directions to the pixels of a box", estimate_box(buffer, common), "gray_r", 0.0, 0.6),
        ("tangent plane of the receiver", estimate(tangent="receiver"), "gray_r", 0.0, 0.6),
        ("found by the fixed, weighed by its own", estimate(tangent="mixed"), "gray_r", 0.0, 0.6),
    ]
    figure, axes = pyplot.subplots(2, 3, figsize=(12.0, 5.0), layout="constrained")
    for axis, (title, image, colors, low, high) in zip(axes.ravel(), pictures, strict=True):
        axis.imshow(image, cmap=colors, vmin=low, vmax=high)
        axis.set_title(title, fontsize=10)
        axis.axis("off")
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "line-sweep.png", dpi=80)
    print(f"mean |sparse - dense| = {np.nanmean(np.abs(sparse - dense)):.4f}")


def estimate_box(buffer: adret.DepthBuffer, common: dict[str, object]) -> np.ndarray:
    """Eight directions to the border of a box of three by three pixels."""
    options = {**common, "directions": 8, "pattern": "box"}
    return adret.ambient_occlusion(buffer, **options).occlusion


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else EXAMPLES.parent / "docs" / "images")
