"""One real depth buffer by every method of ambient occlusion, and the error of each.

Writes ssao-methods.png (results), ssao-errors.png (method minus the integral that it claims, by
rays), ssao-bounce.png (occlusion, bent normals, one bounce of colour) to a folder (default
docs/images), and prints the table of docs/explanation/screen-space.md. Needs matplotlib; takes a
few minutes for the rays.
"""

import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib import pyplot
from numpy.typing import NDArray

from adret import DepthBuffer, ambient_occlusion
from adret.screen import indirect_color
from adret.screen.crytek import published_kernel

DATA = Path(__file__).resolve().parent / "data"
RADIUS = 0.5  # metres
RAYS = 768
COSINE = {"weight": "cosine", "falloff": "quadratic"}
UNIFORM = {"weight": "uniform", "falloff": "quadratic"}
TIMONEN = {"falloff": "timonen", "falloff_scale": (0.5 * RADIUS) ** 2}
KERNEL = tuple(np.unique(np.linalg.norm(published_kernel(16), axis=1).round(9)).tolist())
SHELL = tuple(np.cbrt(0.8**3 + np.array([0.1, 0.3, 0.5, 0.7, 0.9]) * (1.0 - 0.8**3)).tolist())
COLUMNS = 3


class Shown(NamedTuple):
    """A method's setting and what rays compute of its integral.

    Of spheres, the mean over some shares of the radius.
    """

    title: str
    method: str
    options: dict[str, Any]
    truth: dict[str, Any]
    spheres: tuple[float, ...] = (1.0,)


SHOWN = (
    Shown("raytraced, 64 rays", "raytraced", {**COSINE, "rays": 64, "seed": 7}, COSINE),
    Shown("exact, K = 16", "exact", {**COSINE, "directions": 16}, COSINE),
    Shown("ffao, K = 16 x 2", "ffao", {"falloff": "quadratic", "directions": 16}, COSINE),
    Shown("lsao, K = 16", "lsao", {**TIMONEN, "directions": 16}, {"weight": "cosine", **TIMONEN}),
    Shown("hbao, 8 x 8", "hbao", {"falloff": "quadratic", "quality": "high"}, UNIFORM),
    Shown("vao, 8 pipes, box filter", "vao", {"denoise": "box"}, {"weight": "volumetric"}),
    Shown(
        "vao, 16 points, box filter",
        "vao",
        {"estimator": "containment", "samples": 16, "denoise": "box"},
        {"weight": "hemisphere"},
    ),
    Shown(
        "crytek, 16, box filter",
        "crytek",
        {"range_check": "none", "denoise": "box"},
        {"weight": "shell"},
        KERNEL,
    ),
    Shown(
        "lightfield, 8, box filter",
        "lightfield",
        {"denoise": "box"},
        {"weight": "shell"},
        SHELL,
    ),
)


def reference(buffer: DepthBuffer, shown: Shown, kept: dict[str, Any]) -> Any:
    """The integral by rays, once for each set of options."""
    key = repr((sorted(shown.truth.items()), shown.spheres))
    if key not in kept:
        options = {"method": "raytraced", "rays": RAYS // len(shown.spheres), **shown.truth}
        kept[key] = np.mean(
            [
                ambient_occlusion(buffer, radius=share * RADIUS, **options).occlusion
                for share in shown.spheres
            ],
            axis=0,
        )
    return kept[key]


def grid(images: list[NDArray[np.float32]], titles: list[str], path: Path, **how: Any) -> None:
    """Images side by side, with one colour bar."""
    rows = -(-len(images) // COLUMNS)
    figure, axes = pyplot.subplots(
        rows, COLUMNS, figsize=(4.1 * COLUMNS, 2.6 * rows), layout="constrained"
    )
    for axis, image, title in zip(axes.flat, images, titles, strict=True):
        drawn = axis.imshow(image, interpolation="nearest", **how)
        axis.set_title(title, fontsize=9)
        axis.set_axis_off()
    figure.colorbar(drawn, ax=axes, shrink=0.6, aspect=40)
    figure.savefig(path, dpi=110)
    pyplot.close(figure)


def every_method(buffer: DepthBuffer, folder: Path) -> None:
    """Results and errors of all methods."""
    kept: dict[str, Any] = {}
    images, errors, titles, notes = [], [], [], []
    for each in SHOWN:
        options = {"radius": RADIUS, **each.options}
        ambient_occlusion(buffer, method=each.method, **options)  # compiles
        start = time.process_time()
        found = ambient_occlusion(buffer, method=each.method, **options)
        spent = (time.process_time() - start) / found.report.receivers
        error = found.occlusion - reference(buffer, each, kept)
        images.append(1.0 - found.occlusion)
        errors.append(error)
        titles.append(each.title)
        size = np.abs(error)
        notes.append(f"{each.title}: e_A {size.mean():.4f}, bias {error.mean():+.4f}")
        print(
            f"| {each.title} | {size.mean():.4f} | {(size < 0.05).mean():.1%} | "
            f"{error.mean():+.4f} | {spent * 1e6:.2f} |",
            flush=True,
        )
    grid(images, titles, folder / "ssao-methods.png", cmap="gray", vmin=0.0, vmax=1.0)
    grid(errors, notes, folder / "ssao-errors.png", cmap="RdBu_r", vmin=-0.1, vmax=0.1)


def more_of_exact(buffer: DepthBuffer, folder: Path) -> None:
    """Occlusion with an infinite and a finite thickness, bent normals, a bounce of colour."""
    row0, row1, column0, column1 = buffer.frame
    frame = (slice(row0, row1), slice(column0, column1))
    solid = ambient_occlusion(buffer, method="exact", radius=1.5, directions=96)
    shell = ambient_occlusion(buffer, method="exact", radius=1.5, directions=96, thickness=0.3)
    # A red wall on the left, a blue one on the right, white between them.
    x, _, _ = buffer.camera.position(*np.mgrid[0 : buffer.shape[0], 0 : buffer.shape[1]], 1.0)
    side = np.clip(x, -1.0, 1.0)
    colour = np.stack([1.0 - 0.9 * np.maximum(side, 0.0), 1.0 - 0.9 * np.abs(side), 1.0 + 0 * side])
    colour[2] -= 0.9 * np.maximum(-side, 0.0)
    light = indirect_color(buffer, colour, radius=1.5, directions=96)
    assert solid.bent_normal is not None
    shown = [
        (1.0 - solid.occlusion, "all behind the surface is solid"),
        (1.0 - shell.occlusion, "thickness 0.3 m"),
        (0.5 + 0.5 * np.moveaxis(solid.bent_normal, 0, 2), "bent normals (right, up, back)"),
        (np.moveaxis(colour[:, *frame], 0, 2), "colours"),
        (np.moveaxis(light, 0, 2), "one bounce of them"),
        (
            np.moveaxis(colour[:, *frame] * (0.8 * (1.0 - solid.occlusion) + light), 0, 2) ** 0.45,
            "colours, ambient light and bounce",
        ),
    ]
    figure, axes = pyplot.subplots(2, 3, figsize=(12.3, 5.0), layout="constrained")
    for axis, (image, title) in zip(axes.flat, shown, strict=True):
        axis.imshow(np.clip(image, 0.0, 1.0), cmap="gray", vmin=0.0, vmax=1.0)
        axis.set_title(title, fontsize=9)
        axis.set_axis_off()
    figure.savefig(folder / "ssao-bounce.png", dpi=110)
    pyplot.close(figure)


def main() -> None:
    """Make all pictures."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else DATA.parents[1] / "docs" / "images")
    folder.mkdir(parents=True, exist_ok=True)
    buffer = DepthBuffer.open(DATA / "living_room.npz", DATA / "living_room.json")
    more_of_exact(buffer, folder)
    every_method(buffer, folder)


if __name__ == "__main__":
    main()
