"""Pictures of what cells of the Aletsch mountains see: along one ray, and all of them.

Writes PNGs to a folder (default docs/images). Needs matplotlib.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot
from numpy.typing import NDArray
from PIL import Image

import adret

EXAMPLES = Path(__file__).resolve().parent
DEM = EXAMPLES / "data" / "alpine_aletsch_dhm200_lv95_200m.tif"
EYE = 2.0
CELL, AZIMUTH = (268, 12), np.pi / 2.0


def along_a_ray(path: Path) -> None:
    """The ground east of a cell, what of it is seen, and the local horizons."""
    terrain = adret.Terrain.open(DEM)
    row, column = CELL
    sight = adret.intervisibility(terrain, azimuths=[AZIMUTH], observer_height=EYE)
    _, seen = sight.visible(row, column, 0)
    ends = column + sight.of(row, column, 0)
    ground = terrain.elevations()[row, column:]
    km = np.arange(ground.size) * terrain.cell_size[0] / 1000.0

    figure, axis = pyplot.subplots(figsize=(10.0, 3.4), layout="constrained")
    axis.fill_between(km, ground, ground.min() - 100.0, color="0.85")
    axis.plot(km, ground, color="0.6", linewidth=1.0)
    for end in ends:
        way = [km[0], km[end - column]]
        axis.plot(way, [ground[0] + EYE, ground[end - column]], color="tab:blue", linewidth=0.6)
    visible = np.full(ground.size, np.nan)
    visible[seen - column] = ground[seen - column]
    axis.plot(km, visible, ".", color="tab:orange", markersize=4.0, label="seen")
    axis.plot(
        km[ends - column], ground[ends - column], "o", color="tab:blue", fillstyle="none",
        label="local horizons",
    )  # fmt: skip
    axis.set_xlim(0.0, km[-1])
    axis.set_ylim(ground.min() - 100.0, None)
    axis.set_xlabel("way east [km]")
    axis.set_ylabel("height [m]")
    axis.legend(loc="upper right")
    save(figure, path)


def maps(path: Path) -> None:
    """Ground seen, farthest sight, and sky seen, of every cell."""
    terrain = adret.Terrain.open(DEM)
    options: dict[str, Any] = {
        "observer_height": EYE,
        "radius": terrain.body_radius,
        "refraction": 0.13,
    }
    area = adret.intervisibility(terrain, 64, reduce="visible_area", **options) / 1e6
    way = adret.intervisibility(terrain, 64, reduce="max_sight_distance", **options) / 1e3
    sky = adret.intervisibility(terrain, 64, reduce="sky_view", **options)
    figure, axes = pyplot.subplots(1, 3, figsize=(13.0, 4.0), layout="constrained")
    panels: tuple[tuple[NDArray[np.float32], str], ...] = (
        (np.log10(np.maximum(area, 0.1)), "ground seen [log10 of km²]"),
        (way, "farthest ground seen [km]"),
        (sky, "sky-view factor"),
    )
    for axis, (layer, title) in zip(axes, panels, strict=True):
        low, high = np.nanquantile(layer, (0.01, 0.99))
        image = axis.imshow(layer, cmap="magma", vmin=low, vmax=high)
        figure.colorbar(image, ax=axis, shrink=0.8)
        axis.set_title(title, fontsize=10)
        axis.set_axis_off()
    save(figure, path)


def save(figure: Any, path: Path) -> None:
    """Write a figure and say how large it is."""
    figure.savefig(path, dpi=75)
    pyplot.close(figure)
    with Image.open(path) as picture:
        small = picture.convert("RGB").quantize(96)
    small.save(path, optimize=True)
    print(path, f"{path.stat().st_size / 1024:.0f} KB")


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else EXAMPLES.parent / "docs" / "images"
    folder.mkdir(parents=True, exist_ok=True)
    along_a_ray(folder / "intervisibility-ray.png")
    maps(folder / "intervisibility-maps.png")
