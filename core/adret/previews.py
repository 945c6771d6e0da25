"""Pictures of results: PNG with a colour table, nodata transparent, ground proportions kept."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from adret._gdal import PathLike, atomic, check_output
from adret.errors import InputError

__all__ = ["CODE_COLOURS", "COLOURS", "preview"]

# Anchors (sRGB, evenly spaced, lightness rises steadily) between which colours are interpolated.
COLOURS: dict[str, tuple[tuple[int, int, int], ...]] = {
    "grey": ((0, 0, 0), (255, 255, 255)),
    "dusk": (
        (14, 12, 44),
        (54, 28, 98),
        (108, 42, 116),
        (164, 62, 108),
        (212, 96, 84),
        (240, 148, 72),
        (250, 204, 108),
        (253, 246, 200),
    ),
}
# Lit, self-shadowed, cast shadow: the ground colour that a hillshade is multiplied with.
CODE_COLOURS = ((250, 240, 214), (104, 112, 148), (48, 56, 96))

MAX_SIDE = 2048


def preview(
    path: PathLike,
    layer: NDArray[Any],
    *,
    colours: str = "grey",
    low: float | None = None,
    high: float | None = None,
    gamma: float = 1.0,
    shading: NDArray[np.floating[Any]] | None = None,
    cell_size: tuple[float, float] = (1.0, 1.0),
    overwrite: bool = True,
) -> None:
    """Write a picture of a layer as PNG: complete, or not at all.

    Parameters
    ----------
    path : path-like
        Where the PNG goes.
    layer : ndarray
        Shape (rows, columns): a quantity, or uint8 shadow codes (0 lit, 1 self-shadowed, 2 cast
        shadow, 3 masked). Shape (rows, columns, 3): linear red, green and blue. NaN is transparent.
    colours : str
        Colour table of a quantity: "grey" or "dusk".
    low, high : float, optional
        Values of the first and last colour; default the 1st and 99th percentile (for red, green
        and blue: 0 and the 99th percentile over the three).
    gamma : float
        The stretched value is raised to 1/gamma; 2.2 for light.
    shading : ndarray, shape (rows, columns), optional
        Brightness 0..1 to multiply with.
    cell_size : (float, float)
        Ground size (dx, dy) of a cell; the picture is resized so that its pixels are square.
    overwrite : bool
        Whether a file that exists may be replaced.

    Raises
    ------
    InputError
        If the shape or the colour table is not known.
    RasterError
        If the place cannot be written.
    """
    from PIL import Image

    target = check_output(path, field="preview", overwrite=overwrite)
    layer, shading = _thinned(layer, shading)
    if layer.ndim == 2 and layer.dtype == np.uint8:
        rgb = np.array([*CODE_COLOURS, (0, 0, 0)], dtype=np.float32)[np.minimum(layer, 3)] / 255.0
        opaque = layer < 3
    elif layer.ndim == 2:
        opaque = np.isfinite(layer)
        rgb = _coloured(_stretched(layer, low, high, gamma), colours)
    elif layer.ndim == 3 and layer.shape[2] == 3:
        opaque = np.isfinite(layer).all(axis=2)
        rgb = _stretched(layer, 0.0 if low is None else low, high, gamma)
    else:
        raise InputError("layer", "of shape (rows, columns) or (rows, columns, 3)", layer.shape)
    if shading is not None:
        rgb = rgb * np.nan_to_num(shading)[..., np.newaxis]
    rgba = np.zeros((*layer.shape[:2], 4), dtype=np.uint8)
    rgba[..., :3] = np.rint(np.clip(rgb, 0.0, 1.0) * 255.0)
    rgba[..., 3] = opaque * 255
    rgba[~opaque] = 0
    picture = Image.fromarray(rgba)
    size = _square_pixels(picture.size, cell_size)
    if size != picture.size:
        picture = picture.resize(size, Image.Resampling.BICUBIC)
    with atomic(target) as unfinished:
        picture.save(unfinished, format="PNG", compress_level=6)


def _thinned(
    layer: NDArray[Any], shading: NDArray[Any] | None
) -> tuple[NDArray[Any], NDArray[Any] | None]:
    """Mean over blocks (codes: first cell) until no side exceeds `MAX_SIDE`."""
    step = math.ceil(max(layer.shape[:2]) / MAX_SIDE)
    if step <= 1:
        return layer, shading
    if layer.dtype == np.uint8:
        return layer[::step, ::step], None if shading is None else shading[::step, ::step]
    return _block_mean(layer, step), None if shading is None else _block_mean(shading, step)


def _block_mean(layer: NDArray[Any], step: int) -> NDArray[Any]:
    rows, columns = (size // step * step for size in layer.shape[:2])
    blocks = layer[:rows, :columns].reshape(
        rows // step, step, columns // step, step, *layer.shape[2:]
    )
    return np.asarray(blocks.mean(axis=(1, 3), dtype=np.float32))


def _stretched(
    layer: NDArray[Any], low: float | None, high: float | None, gamma: float
) -> NDArray[np.float32]:
    """Values to 0..1 between `low` and `high`, NaN kept."""
    values = layer[np.isfinite(layer)]
    if values.size == 0:
        return np.zeros(layer.shape, dtype=np.float32)
    first, last = np.percentile(values, (1.0, 99.0))
    low = float(first) if low is None else low
    high = float(last) if high is None else high
    if not high > low:
        low, high = low - 0.5, low + 0.5
    unit = np.clip((np.nan_to_num(layer, nan=low) - low) / (high - low), 0.0, 1.0)
    return np.asarray(unit ** (1.0 / gamma), dtype=np.float32)


def _coloured(unit: NDArray[np.float32], colours: str) -> NDArray[np.float32]:
    if colours not in COLOURS:
        raise InputError("colours", f"one of {', '.join(COLOURS)}", colours)
    anchors: Sequence[tuple[int, int, int]] = COLOURS[colours]
    places = np.linspace(0.0, 1.0, len(anchors))
    channels = [np.interp(unit, places, [a[c] / 255.0 for a in anchors]) for c in range(3)]
    return np.stack(channels, axis=-1).astype(np.float32)


def _square_pixels(size: tuple[int, int], cell_size: tuple[float, float]) -> tuple[int, int]:
    """Width and height with square pixels: the longer side of a cell shrinks to the shorter."""
    width, height = size
    dx, dy = cell_size
    if abs(dx / dy - 1.0) < 0.01:
        return size
    if dx > dy:
        return width, max(1, round(height * dy / dx))
    return max(1, round(width * dx / dy)), height
