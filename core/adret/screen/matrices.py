"""Projection matrices: what a camera's 4 x 4 matrix says, and the matrix of a camera."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adret.errors import InputError

if TYPE_CHECKING:
    from adret.screen.camera import Camera

__all__ = ["camera_matrix", "camera_numbers"]

FAR_LIMIT = 1e-9
"""Depth values that differ from the far plane's by less make the far plane infinite."""


def camera_numbers(
    matrix: ArrayLike, width: int, height: int, *, zero_to_one: bool
) -> dict[str, Any]:
    """Rays, clip planes, direction and handedness of a projection matrix."""
    try:
        p = np.asarray(matrix, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("matrix", "4 x 4 numbers", matrix) from None
    if p.shape != (4, 4) or not np.isfinite(p).all():
        raise InputError("matrix", "4 x 4 finite numbers", p.shape if p.shape != (4, 4) else p)
    last = np.abs(p[3])
    if not (np.allclose(last, (0, 0, 1, 0), atol=1e-6) or np.allclose(last, (0, 0, 0, 1))):
        limit = "with the last row 0 0 ±1 0 or 0 0 0 1 (transpose a matrix for row vectors)"
        raise InputError("matrix", limit, p[3].tolist())
    divide = p[3, 3] == 0.0
    others = p[[0, 1, 2, 2], [1, 0, 0, 1]]
    corner = p[[0, 1], [3, 3]] if divide else p[[0, 1], [2, 2]]
    if others.any() or corner.any():
        raise InputError("matrix", "a projection without shear or oblique planes", p.tolist())
    if p[0, 0] <= 0.0 or p[1, 1] <= 0.0 or (p[2, 3] == 0.0 if divide else p[2, 2] == 0.0):
        raise InputError("matrix", "invertible, x right and y up", p.tolist())
    low = 0.0 if zero_to_one else -1.0
    # x' = (right + 1) width / 2, y' = (1 - up) height / 2 of the clip coordinates.
    if divide:
        back = -p[3, 2]  # +1: looks along -z
        a, b = (p[2, 2] * -back - low) / (1.0 - low), p[2, 3] / (1.0 - low)
        # Depth value in 0..1 at distance z: a + b / z.
        fx, fy = 0.5 * width * p[0, 0], 0.5 * height * p[1, 1]
        cx = 0.5 * width * (1.0 - back * p[0, 2])
        cy = 0.5 * height * (1.0 + back * p[1, 2])
        planes = {value: _where(-b, a - value) for value in (0.0, 1.0)}
        rays = (1.0 / fx, (0.5 - cx) / fx, -1.0 / fy, (cy - 0.5) / fy)
    else:
        # Where the view space's z is 0 and 1 in depth values; both planes lie before the eye.
        slope, base = p[2, 2] / (1.0 - low), (p[2, 3] - low) / (1.0 - low)
        planes = {v: (v - base) / slope for v in (0.0, 1.0)}
        back = -1.0 if sum(planes.values()) > 0.0 else 1.0
        planes = {v: -back * at for v, at in planes.items()}
        ax, ay = 2.0 / (width * p[0, 0]), -2.0 / (height * p[1, 1])
        rays = (
            ax,
            0.5 * ax - (1.0 + p[0, 3]) / p[0, 0],
            ay,
            0.5 * ay + (1.0 - p[1, 3]) / p[1, 1],
        )
    near, far = sorted(planes.values())
    if -1e-12 * far < near < 0.0:  # rounding
        near = 0.0
    return {
        "rays": tuple(float(v) for v in rays),
        "perspective_divide": bool(divide),
        "near": float(near),
        "far": float(far),
        "reversed": bool(planes[1.0] < planes[0.0]),
        "handedness": "right" if back > 0.0 else "left",
    }


def _where(numerator: float, denominator: float) -> float:
    """Distance of a plane; what is beyond 1e9 near planes is infinite."""
    return math.inf if abs(denominator) < FAR_LIMIT else numerator / denominator


def camera_matrix(camera: "Camera") -> NDArray[np.float64]:
    """The matrix of a camera, whose z/w is the depth value as stored."""
    near, far = camera.planes()
    ax, bx, ay, by = camera.rays
    back = 1.0 if camera.handedness == "right" else -1.0
    p = np.zeros((4, 4))
    # Image borders at depth 1 (perspective) or anywhere (orthographic).
    left, right = bx - 0.5 * ax, bx + (camera.width - 0.5) * ax
    top, bottom = by - 0.5 * ay, by + (camera.height - 0.5) * ay
    p[0, 0], p[1, 1] = 2.0 / (right - left), 2.0 / (top - bottom)
    shift = (right + left) / (right - left), (top + bottom) / (top - bottom)
    if camera.perspective_divide:
        nearness = 0.0 if math.isinf(far) else near / far
        b = near / (1.0 - nearness)
        a = -nearness / (1.0 - nearness)  # reversed, 0..1: a + b / z
        p[3, 2] = -back
        p[0, 2], p[1, 2] = back * shift[0], back * shift[1]
    else:
        b, a = -1.0 / (far - near), far / (far - near)  # reversed, 0..1: a + b z
        p[3, 3] = 1.0
        p[0, 3], p[1, 3] = -shift[0], -shift[1]
    if not camera.reversed:
        a, b = 1.0 - a, -b
    if camera.clip == "-1..1":
        a, b = 2.0 * a - 1.0, 2.0 * b
    if camera.perspective_divide:
        p[2, 2], p[2, 3] = -back * a, b
    else:
        p[2, 2], p[2, 3] = -back * b, a
    return p
