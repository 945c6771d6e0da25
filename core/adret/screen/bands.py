"""A run over the frame in bands of rows, so that it can be watched and stopped."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from adret.screen.field import Field

__all__ = ["NO_COLOR", "Frame", "Layer", "no_light", "run_in_bands"]

Layer = NDArray[np.float32]
Frame = tuple[int, int, int, int]
BANDS = 16
NO_COLOR = np.zeros((0, 1, 1), dtype=np.float32)
"""What containment tests take where no light is asked for."""


def run_in_bands(
    field: Field,
    fill: Callable[[Frame, Layer, Layer], None],
    progress: Callable[[int, int], None] | None,
) -> tuple[Layer, Layer]:
    """Occlusion and confidence of the frame, by `fill` of (part of the frame, its two layers).

    Examples
    --------
    >>> from adret import Camera, DepthBuffer
    >>> buffer = DepthBuffer(np.ones((4, 4)), Camera.orthographic(4, 4, extent=(1.0, 1.0)))
    >>> def fill(frame, occlusion, confidence):
    ...     occlusion[:], confidence[:] = frame[0], 1.0
    >>> run_in_bands(buffer.field, fill, None)[0][:, 0]
    array([0., 1., 2., 3.], dtype=float32)
    """
    row0, row1, column0, column1 = field.frame
    occlusion = np.empty(field.shape, dtype=np.float32)
    confidence = np.empty(field.shape, dtype=np.float32)
    edges = np.linspace(0, row1 - row0, min(BANDS, row1 - row0) + 1).astype(int).tolist()
    for done, (start, stop) in enumerate(pairwise(edges)):
        if progress is not None:
            progress(done, len(edges) - 1)
        part = (row0 + start, row0 + stop, column0, column1)
        fill(part, occlusion[start:stop], confidence[start:stop])
    if progress is not None:
        progress(len(edges) - 1, len(edges) - 1)
    return occlusion, confidence


def no_light(occlusion: Layer) -> Layer:
    """Where containment tests add the light of no color."""
    return np.zeros((0, *occlusion.shape), dtype=np.float32)
