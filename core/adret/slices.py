"""Azimuth slices of a sky: what the light asks of every sky, from a point sun to a picture.

A sky is a list of slices. Each slice has the azimuth towards which horizons are swept, can say
whether it is dark above an elevation, and adds its irradiance to all receivers. Sums are of
irradiance over n_u, the up component of the receiver's normal.
"""

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from adret._kernels import light as kernels

__all__ = ["LightSlice", "NormalTableSlice", "Receivers", "Sky", "SmoothSlice", "TableSlice"]

Layer = NDArray[np.float32]
Table = NDArray[np.float64]

# Elevations in the kernels are off by up to 2e-7 rad.
ELEVATION_MARGIN = 1e-6


@dataclass(frozen=True, eq=False)
class Receivers:
    """Slopes of the receiving cells [rise per metre towards east and north], NaN at nodata."""

    to_east: Layer
    to_north: Layer


class LightSlice(Protocol):
    """One azimuth slice of a sky."""

    @property
    def azimuth(self) -> float:
        """Azimuth [radians clockwise from north] of the horizon that cuts the slice."""

    def dark_above(self, elevation: float) -> bool:
        """Whether no light comes from above this elevation [radians]."""

    def add(self, slope: Layer, receivers: Receivers, total: Layer) -> None:
        """Add irradiance/n_u above horizons of these slopes to `total` (bands, rows, columns)."""


class Sky(Protocol):
    """Light from infinitely far away."""

    @property
    def bands(self) -> int:
        """1, or 3 for red, green, blue."""

    def slices(self, directions: int) -> list[LightSlice]:
        """Cut the sky into at most `directions` azimuth slices."""


def sine_cosine(azimuth: float) -> tuple[np.float32, np.float32]:
    """Sine and cosine as the kernels take them."""
    return np.float32(np.sin(azimuth)), np.float32(np.cos(azimuth))


@dataclass(frozen=True)
class SmoothSlice:
    """A slice whose radiance is constant + sine·sin e above the horizontal and 0 below.

    Both are already multiplied by the slice's width [radiance · rad].
    """

    azimuth: float
    constant: float
    sine: float

    def dark_above(self, elevation: float) -> bool:
        """Only a black sky is dark anywhere above the horizontal."""
        return self.constant == 0.0 and self.sine == 0.0

    def add(self, slope: Layer, receivers: Receivers, total: Layer) -> None:
        """Add the closed form of the slice."""
        kernels.add_smooth_sky(
            slope,
            receivers.to_east,
            receivers.to_north,
            *sine_cosine(self.azimuth),
            np.float32(self.constant),
            np.float32(self.sine),
            total[0],
        )


@dataclass(frozen=True, eq=False)
class TableSlice:
    """A slice given by its moments above each elevation of an even grid.

    Attributes
    ----------
    azimuth : float
        Of the horizon [radians].
    first, step : float
        Elevation of the first entry and distance of the entries [radians].
    horizontal, vertical : ndarray, shape (bands, n), float64
        A and B: integrals over the slice above the entry of radiance times cos² e de dφ and of
        radiance times sin e cos e de dφ.
    """

    azimuth: float
    first: float
    step: float
    horizontal: Table
    vertical: Table

    def dark_above(self, elevation: float) -> bool:
        """Whether all moments vanish from the entry below `elevation` up."""
        below = (elevation - ELEVATION_MARGIN - self.first) / self.step
        start = min(max(int(np.floor(below)), 0), self.vertical.shape[1] - 1)
        return not (self.horizontal[:, start:].any() or self.vertical[:, start:].any())

    def add(self, slope: Layer, receivers: Receivers, total: Layer) -> None:
        """Look the moments up, linearly interpolated."""
        kernels.add_tables(
            slope,
            receivers.to_east,
            receivers.to_north,
            *sine_cosine(self.azimuth),
            np.float32(self.first),
            np.float32(1.0 / self.step),
            self._packed(),
            total,
        )

    def _packed(self) -> Layer:
        """B of three bands, 0, A of three bands, 0 for every entry; the last entry twice."""
        bands, count = self.vertical.shape
        packed = np.zeros((count + 1, 8), np.float32)
        packed[:count, :bands] = self.vertical.T
        packed[:count, 4 : 4 + bands] = self.horizontal.T
        packed[count] = packed[count - 1]
        return packed.ravel()


@dataclass(frozen=True, eq=False)
class NormalTableSlice:
    """A slice tabulated over normal angle and horizon angle: L_p of paper P1, eq. 6 and 7.

    `moments` is the exact slice that the table is made of; `normal_angles` is N.
    """

    moments: TableSlice
    normal_angles: int
    azimuth: float = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "azimuth", self.moments.azimuth)

    def dark_above(self, elevation: float) -> bool:
        """As the moments say: horizons are never looked up below the cell's own plane."""
        return self.moments.dark_above(elevation)

    def _leans(self) -> Table:
        """Angles of the tabulated normals from the zenith towards the azimuth [radians]."""
        return np.linspace(-np.pi / 2.0, np.pi / 2.0, self.normal_angles)

    def table(self) -> Layer:
        """L_p, shape (N, n, bands): irradiance on a normal that lies in the slice's plane."""
        source = self.moments
        bands, count = source.vertical.shape
        leans = self._leans()
        entries = source.first + source.step * np.arange(count)
        table = np.empty((len(leans), count, bands), dtype=np.float32)
        for j, lean in enumerate(leans):
            above = np.maximum(entries, -lean)
            for band in range(bands):
                a = np.interp(above, entries, source.horizontal[band])
                b = np.interp(above, entries, source.vertical[band])
                table[j, :, band] = np.sin(lean) * a + np.cos(lean) * b
        return table

    def add(self, slope: Layer, receivers: Receivers, total: Layer) -> None:
        """Look L_p up, linear in the horizon angle and in the normal."""
        leans = self._leans()
        kernels.add_normal_table(
            slope,
            receivers.to_east,
            receivers.to_north,
            *sine_cosine(self.azimuth),
            np.float32(self.moments.first),
            np.float32(1.0 / self.moments.step),
            np.sin(leans).astype(np.float32),
            np.cos(leans).astype(np.float32),
            self.table().reshape(-1, len(total)),
            total,
        )
