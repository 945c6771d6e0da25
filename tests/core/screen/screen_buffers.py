"""Depth buffers for the tests of methods: framed scenes, a rough one, and slow look-ups."""

import math

import numpy as np

from adret import Camera, DepthBuffer
from adret.screen import AOResult, ambient_occlusion
from screen_scenes import View


def camera_of(view: View) -> Camera:
    """The camera of a view."""
    kind = Camera.perspective if view.perspective else Camera.orthographic
    return kind(view.width, view.height, **view.lens)


def framed(view: View) -> tuple[DepthBuffer, np.ndarray, np.ndarray]:
    """A view as a buffer whose frame is just its receivers, and their rows and columns."""
    rows, columns = np.nonzero(view.usable)
    band = (
        int(rows.min()),
        int(view.width - 1 - columns.max()),
        int(view.height - 1 - rows.max()),
        int(columns.min()),
    )
    buffer = DepthBuffer(view.depth, camera_of(view), normals=view.normals, guard_band=band)
    return buffer, rows, columns


def measured(view: View, **options) -> tuple[np.ndarray, np.ndarray, np.ndarray, AOResult]:
    """Occlusion of a view's receivers, their rows and columns, and the whole result."""
    buffer, rows, columns = framed(view)
    result = ambient_occlusion(buffer, **options)
    return result.occlusion[rows - rows.min(), columns - columns.min()], rows, columns, result


def rough(perspective: bool, rows: int = 13, columns: int = 17, **options) -> DepthBuffer:
    """Blocks and slopes at depths of 2 to 4, with a hole and some sky."""
    draw = np.random.default_rng(7)
    depth = 3.0 + 0.03 * np.arange(columns) - 0.05 * np.arange(rows)[:, None]
    depth += 0.02 * draw.standard_normal((rows, columns))
    depth[3:7, 4:9] -= 0.7
    depth[8:, 12:] -= 0.4
    depth[1, 2] = np.nan
    depth[10:, 3:5] = np.inf
    if perspective:
        camera = Camera.perspective(columns, rows, fov_y_deg=55.0)
    else:
        camera = Camera.orthographic(columns, rows, extent=(3.1, 2.9))
    return DepthBuffer(depth, camera, **options)


def point(buffer: DepthBuffer, row: int, column: int, z: float | None = None) -> np.ndarray:
    """View-space point of a pixel, from the camera's definition."""
    z = float(buffer.depth[row, column]) if z is None else z
    ax, bx, ay, by = buffer.camera.rays
    scale = z if buffer.camera.perspective_divide else 1.0
    return np.array([scale * (ax * column + bx), scale * (ay * row + by), -z])


def pixel(buffer: DepthBuffer, place: np.ndarray) -> tuple[float, float] | None:
    """Row and column (pixel centres are whole) of a view-space point; None off the image."""
    ax, bx, ay, by = buffer.camera.rays
    z = -place[2]
    if buffer.camera.perspective_divide and z <= 0.0:
        return None
    scale = z if buffer.camera.perspective_divide else 1.0
    column, row = (place[0] / scale - bx) / ax, (place[1] / scale - by) / ay
    rows, columns = buffer.shape
    if -0.5 <= row < rows - 0.5 and -0.5 <= column < columns - 0.5:
        return row, column
    return None


def depth_at(buffer: DepthBuffer, row: float, column: float) -> float:
    """Depth of the surface between pixels; NaN over what is unknown."""
    rows, columns = buffer.shape
    i = min(max(math.floor(row), 0), rows - 2)
    j = min(max(math.floor(column), 0), columns - 2)
    v, u = row - i, column - j
    z = buffer.depth.astype(np.float64)
    w = 1.0 / z if buffer.camera.perspective_divide else z
    value = (1 - v) * ((1 - u) * w[i, j] + u * w[i, j + 1])
    value += v * ((1 - u) * w[i + 1, j] + u * w[i + 1, j + 1])
    if np.isnan(value):
        value = w[i + (v > 0.5), j + (u > 0.5)]
    return 1.0 / value if buffer.camera.perspective_divide else value
