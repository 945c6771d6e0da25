"""Rasters that lie on a terrain's own grid: its reflectance, its own light."""

import math
import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from adret import rasters
from adret._gdal import GDAL_OPTIONS, PathLike, sniff_driver
from adret.errors import RasterError

if TYPE_CHECKING:
    from adret.terrain import Terrain

__all__ = ["read_overlay"]

SAME_PLACE = 1e-3  # of a cell


def read_overlay(
    field: str, path: PathLike, terrain: "Terrain", most: float = math.inf
) -> NDArray[np.float32]:
    """Read one or three bands of a raster on a terrain's grid, of values that are never negative.

    Parameters
    ----------
    field : str
        What the caller calls the file, for messages.
    path : path-like
        A GeoTIFF, an Arc/Info ASCII grid or a PNG with as many rows and columns as the terrain, or
        as the raster that it was cut from; in its CRS and place where both say theirs.
    terrain : Terrain
    most : float
        Largest value that is allowed; infinite values never are.

    Returns
    -------
    ndarray, shape (rows, columns) or (rows, columns, 3), float32
        In the file's own unit, scale and offset applied; NaN where the file is masked.

    Raises
    ------
    RasterError
        If the file cannot be read, has other than one or three bands, lies elsewhere, or holds a
        value out of range.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np, adret
    >>> terrain = adret.Terrain(np.zeros((2, 3)), (1.0, 1.0))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = f"{folder}/lava.tif"
    ...     rasters.write(path, np.eye(2, 3), terrain, names=("lava",), unit="1", tags={})
    ...     read_overlay("emission", path, terrain)
    array([[1., 0., 0.],
           [0., 1., 0.]], dtype=float32)
    """
    import rasterio
    from rasterio.errors import NotGeoreferencedWarning, RasterioError

    absolute, driver = sniff_driver(path, field)
    try:
        with warnings.catch_warnings(), rasterio.Env(**GDAL_OPTIONS):
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            with rasterio.open(absolute, driver=driver) as source:
                count, size = int(source.count), (int(source.height), int(source.width))
    except RasterioError:
        raise RasterError(field, f"a readable {driver} file", str(path)) from None
    if count not in (1, 3):
        raise RasterError(field, "of one band or three", f"{count} bands")
    window = None
    if size != terrain.shape and size == terrain.grid.shape:
        window = tuple(
            (start, start + length)
            for start, length in zip(terrain.origin, terrain.shape, strict=True)
        )
    grids = [_read(field, path, band + 1, terrain, window) for band in range(count)]
    _check_place(field, grids[0], terrain)
    layers = [grid.heights.astype(np.float32) for grid in grids]
    for layer in layers:
        wrong = (layer < 0.0) | (layer > most) | np.isinf(layer)
        if wrong.any():
            limit = "finite, 0 or more," if math.isinf(most) else f"between 0 and {most:g}"
            raise RasterError(field, f"{limit} in every cell", float(layer[wrong][0]))
    return layers[0] if count == 1 else np.stack(layers, axis=2)


def _read(
    field: str, path: PathLike, band: int, terrain: "Terrain", window: Any
) -> rasters.HeightGrid:
    size = terrain.cell_size
    try:
        # A unit of length of 1 m leaves the numbers as they are.
        return rasters.open_heights(path, band, window, vertical_unit="m", cell_size=size)
    except RasterError as error:
        name = field if error.field == "path" else f"{field}'s {error.field}"
        raise RasterError(name, error.limit, error.value) from None


def _check_place(field: str, grid: rasters.HeightGrid, terrain: "Terrain") -> None:
    """Refuse another grid than the terrain's."""
    if grid.heights.shape != terrain.shape:
        rows, columns = terrain.shape
        found = "{} x {}".format(*grid.heights.shape)
        raise RasterError(field, f"of the terrain's {rows} x {columns} cells", found)
    if terrain.crs is not None and grid.crs is not None and terrain.crs != grid.crs:
        raise RasterError(field, f"in the terrain's CRS ({terrain.crs.name})", grid.crs.name)
    own, other = terrain.transform, grid.transform
    if own is None or other is None:
        return
    cells = np.array([[0.0, terrain.shape[1]], [0.0, terrain.shape[0]]])
    corners, others = ([[t.c], [t.f]] + np.array([[t.a], [t.e]]) * cells for t in (own, other))
    if (abs(corners - others) > SAME_PLACE * np.abs([[own.a], [own.e]])).any():
        place = f"from {own.c:.10g}, {own.f:.10g} in cells of {own.a:.10g} x {-own.e:.10g}"
        found = f"{other.c:.10g}, {other.f:.10g}; {other.a:.10g} x {-other.e:.10g}"
        raise RasterError(field, f"on the terrain's grid ({place})", found)
