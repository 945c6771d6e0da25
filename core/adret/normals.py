"""Surface slopes and normals."""

import numpy as np
from numpy.typing import NDArray

from adret._kernels import normals as kernels
from adret.terrain import Terrain

__all__ = ["surface_normals"]

# Cell sizes of a geographic raster are taken anew wherever they change the azimuth by this much.
MAX_AZIMUTH_ERROR = 1e-4


def surface_slopes(terrain: Terrain) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Rise per metre towards east and north, each (rows, columns); NaN at nodata."""
    rows, columns = terrain.shape
    # Of a tile, the neighbours of its edge cells as well.
    heights, top, left, _ = terrain.view
    above, before = min(top, 1), min(left, 1)
    heights = heights[top - above : top + rows + 1, left - before : left + columns + 1]
    per_width = np.empty(len(heights), dtype=np.float32)
    per_height = np.empty(len(heights), dtype=np.float32)
    for start, stop, (dx, dy) in terrain.latitude_bands(MAX_AZIMUTH_ERROR):
        per_width[above + start : above + stop] = 1.0 / dx
        per_height[above + start : above + stop] = 1.0 / dy
    # Of a row beyond the tile only the heights matter.
    per_width[:above] = per_width[above + rows :] = 0.0
    per_height[:above] = per_height[above + rows :] = 0.0
    to_east = np.empty(heights.shape, dtype=np.float32)
    to_north = np.empty(heights.shape, dtype=np.float32)
    kernels.gradients(np.ascontiguousarray(heights), per_width, per_height, to_east, to_north)
    own = (slice(above, above + rows), slice(before, before + columns))
    return np.ascontiguousarray(to_east[own]), np.ascontiguousarray(to_north[own])


def surface_normals(terrain: Terrain) -> NDArray[np.float32]:
    """Unit normals (east, north, up) of the surface at every cell.

    Parameters
    ----------
    terrain : Terrain

    Returns
    -------
    ndarray, shape (3, rows, columns), float32
        East, north and up component [-]; NaN at nodata. Up is always positive.

    Notes
    -----
    Paper P1 (section 7) sums the unnormalised normals of the four quads that meet at a sample; the
    sum is that of the central differences (z_E - z_W)/(2 dx) and (z_N - z_S)/(2 dy). Beside
    nodata and at the edge of the raster the missing quads leave the one-sided difference; where
    neither neighbour on an axis exists that component is zero.

    References
    ----------
    V. Timonen and J. Westerholm, "Scalable Height Field Self-Shadowing", 2010, section 7.

    Examples
    --------
    >>> import numpy as np, adret
    >>> rising_east = np.tile([0.0, 3.0, 6.0], (3, 1))
    >>> adret.surface_normals(adret.Terrain(rising_east, (4.0, 4.0)))[:, 1, 1]
    array([-0.6, -0. ,  0.8], dtype=float32)
    """
    to_east, to_north = surface_slopes(terrain)
    normals = np.empty((3, *terrain.shape), dtype=np.float32)
    kernels.normals_from_gradients(to_east, to_north, normals)
    return normals
