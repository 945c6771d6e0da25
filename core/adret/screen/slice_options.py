"""What the methods by slices through view rays have in common: their options."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from adret.screen.field import Field
from adret.screen.options import FalloffOptions, option
from adret.screen.slice_lines import SliceLines

__all__ = ["SliceOptions", "band_edges"]

BANDS = 16
TOLERANCE = 0.03
"""Largest bend of the weights over an interval, times its sine, for Simpson's rule."""


@dataclass(frozen=True, kw_only=True)
class SliceOptions(FalloffOptions):
    """Options of slices through the view ray."""

    directions: int = option(
        32, "Directions of the image round each pixel", minimum=1, maximum=4096
    )
    weight: Literal["cosine", "uniform"] = option("cosine", "Of directions in the hemisphere")
    near: int = option(
        16,
        "Distance up to which every crossing with the pixel grid is looked at",
        unit="pixels",
        minimum=1,
        maximum=65536,
    )
    growth: float = option(
        1.0 / 64.0,
        "Distance of samples further out, as a share of the way to them; 0 for every pixel",
        minimum=0.0,
        maximum=1.0,
    )
    tile: int = option(
        1,
        "Side of the square of pixels whose directions are turned against each other, for a "
        "filter over that square",
        unit="pixels",
        minimum=1,
        maximum=8,
    )
    seed: int = option(0, "Deals the turned directions to the square", minimum=0, maximum=2**31)

    def lines(self, field: Field) -> SliceLines:
        """Lines of samples round the pixels of a field."""
        return SliceLines.of(
            field,
            self.radius,
            self.directions,
            self.near,
            self.growth,
            tile=self.tile,
            seed=self.seed,
        )

    @property
    def shares(self) -> tuple[np.float32, np.float32]:
        """1 and 0 for the weight "cosine", 0 and 1 for "uniform"."""
        cosine = np.float32(self.weight == "cosine")
        return cosine, np.float32(1.0) - cosine


def band_edges(field: Field) -> list[int]:
    """First rows of the bands that a frame is done in, and its number of rows."""
    rows = field.shape[0]
    edges: list[int] = np.linspace(0, rows, min(BANDS, rows) + 1).astype(int).tolist()
    return edges
