"""Distance between neighbouring depths that a depth buffer can hold."""

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from adret.errors import InputError

if TYPE_CHECKING:
    from adret.screen.camera import Camera

__all__ = ["depth_step"]


def depth_step(
    camera: "Camera",
    depth: ArrayLike,
    *,
    dtype: DTypeLike | None,
    bits: int | None,
    device: bool,
) -> NDArray[np.float64]:
    """As `Camera.depth_step`."""
    z = np.asarray(depth, dtype=np.float64)
    if (dtype is None) == (bits is None):
        raise InputError("dtype", "given, or else bits", dtype)
    if not device:
        return _spacing(z, dtype)
    near, far = camera.planes()
    span = 2.0 if camera.clip == "-1..1" else 1.0
    if bits is not None:
        if isinstance(bits, bool) or not isinstance(bits, int) or not 1 <= bits <= 64:
            raise InputError("bits", "a whole number between 1 and 64", bits)
        step = np.full_like(z, span / (2.0**bits - 1.0))
    else:
        step = _spacing(camera.to_device(z), dtype)
    if not camera.perspective_divide:
        return step / span * (far - near)
    return step / span * z**2 * (1.0 / near - (0.0 if math.isinf(far) else 1.0 / far))


def _spacing(values: NDArray[np.float64], dtype: DTypeLike | None) -> NDArray[np.float64]:
    kind = np.dtype(dtype)
    if kind.kind != "f":
        raise InputError("dtype", "a floating-point type", str(kind))
    with np.errstate(over="ignore", invalid="ignore"):
        spacing: NDArray[np.float64] = np.abs(np.spacing(values.astype(kind))).astype(np.float64)
    return spacing
