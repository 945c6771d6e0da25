"""Horizon maps: how high the terrain stands in each direction, seen from every cell."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adret import accuracy, horizon_files, methods
from adret._gdal import PathLike
from adret._kernels.frames import to_elevation
from adret._summaries import summary
from adret._values import real
from adret.azimuths import azimuth_set
from adret.errors import InputError
from adret.horizon_options import NEAR_DEFAULT, HorizonOptions, Method
from adret.horizon_run import HorizonRun, Progress
from adret.report import RunReport
from adret.terrain import Terrain

__all__ = [
    "NEAR_DEFAULT",
    "HorizonMap",
    "HorizonOptions",
    "Method",
    "horizon_at",
    "horizon_map",
]


@dataclass(frozen=True, slots=True)
class HorizonMap:
    """Horizon elevation of every cell towards K azimuths.

    Attributes
    ----------
    elevation : ndarray, shape (K, rows, columns), float32
        Elevation [radians], negative below the horizontal, -π/2 where no terrain lies that way,
        NaN at nodata cells.
    azimuth : ndarray, shape (K,), float64
        Azimuths [radians clockwise from north].
    distance : ndarray, shape (K, rows, columns), float32, or None
        Way to the horizon point [m], NaN where there is none.
    terrain : Terrain
    options : HorizonOptions
    report : RunReport
    """

    elevation: NDArray[np.float32]
    azimuth: NDArray[np.float64]
    distance: NDArray[np.float32] | None
    terrain: Terrain
    options: HorizonOptions
    report: RunReport

    __repr__ = summary

    def save(
        self,
        path: PathLike,
        *,
        dtype: horizon_files.Stored = "uint16",
        overwrite: bool = False,
    ) -> None:
        """Write the elevations [degrees]: complete, or not at all.

        Parameters
        ----------
        path : path-like
            A cloud-optimised GeoTIFF with one band an azimuth, or, where the name ends in
            ``.zarr``, a Zarr store with the dimensions azimuth, y, x (needs the package zarr).
        dtype : {"uint16", "uint8", "float32"}
            Steps of 0.0027 degrees, of 0.71 degrees, or none. Scale, offset and nodata are in
            the metadata, so that rasterio's ``scales`` and xarray give degrees back.
        overwrite : bool
            Whether a file that exists may be replaced.

        Raises
        ------
        InputError, RasterError, OSError
            If an option is out of range, or the place cannot be written.

        Notes
        -----
        `distance` is not kept.

        Examples
        --------
        >>> import numpy as np, adret, tempfile
        >>> terrain = adret.Terrain(np.eye(4), (1.0, 1.0))
        >>> found = adret.horizon_map(terrain, 8)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     found.save(f"{folder}/horizon.tif")
        ...     again = adret.HorizonMap.open(f"{folder}/horizon.tif", terrain)
        >>> bool(abs(np.degrees(again.elevation - found.elevation)).max() <= 0.0014)
        True
        """
        horizon_files.save(self, path, dtype, overwrite)

    @classmethod
    def open(cls, path: PathLike, terrain: Terrain) -> "HorizonMap":
        """Read what `save` wrote.

        Parameters
        ----------
        path : path-like
        terrain : Terrain
            The one that the map was made from.

        Returns
        -------
        HorizonMap
            Elevations [radians], off by half a step at most; no distances.

        Raises
        ------
        RasterError
            If there is no such file, or it is no horizon map.
        InputError
            If the terrain has another shape.
        """
        return horizon_files.load(path, terrain)


def horizon_map(
    terrain: Terrain,
    directions: int = 64,
    *,
    azimuths: ArrayLike | None = None,
    method: Method = "sweep",
    near: int = NEAR_DEFAULT,
    max_distance: float | None = None,
    radius: float | None = None,
    refraction: float = 0.0,
    observer_height: float = 0.0,
    distance: bool = False,
    max_error: float | None = None,
    progress: Progress | None = None,
) -> HorizonMap:
    """Horizon elevation of every cell towards K azimuths [radians].

    Parameters
    ----------
    terrain : Terrain
    directions : int
        Number K of equally spaced azimuths, the first one north.
    azimuths : array_like, shape (K,), optional
        Azimuths [radians clockwise from grid north] instead.
    method : {"sweep", "hull", "march", "exact"}
        "sweep": every crossing of the cell's own ray with the grid up to `near` cells, and beyond
        it the convex hulls of swept lines. "hull": paper P1 as published. "march": one sample a
        step along the cell's own ray, O(N) a cell. "exact": every crossing in float64, O(N) a
        cell: the truth that the others are measured by.
    near : int
        Radius of the exact near field [cells along the larger axis component], 0 to 4096; more is
        slower and more accurate. Used by "sweep" alone, which leaves ranges of up to three near
        radii to the near field altogether.
    max_distance : float, optional
        Terrain further away than this [m] is not seen. "sweep" resolves it to a few cells, and its
        result then depends on nothing further away; not for "hull".
    radius : float, optional
        Radius of the planet [m], such as ``terrain.body_radius``; None for a flat one.
    refraction : float
        Coefficient k of the ray's curvature, 0.13 or 1/7 on Earth, 0 without air; 0 without
        `radius`.
    observer_height : float
        Height of the eye above the surface [m].
    distance : bool
        Also return the way to the horizon point; "sweep" and "exact" only.
    max_error : float, optional
        Mean of |error| that is good enough [degrees], instead of `near`: a pilot on the terrain
        itself measures what near radius that takes (see `adret.accuracy`). The report says which
        one was chosen, and what error to expect; "sweep" only.
    progress : callable, optional
        Called with (azimuths done, azimuths in all); an exception from it ends the run.

    Returns
    -------
    HorizonMap
        Elevations in float32. A height sample that touches nodata does not occlude; outside the
        raster there is nothing.

    Raises
    ------
    InputError
        If an option is out of range.

    Notes
    -----
    tan h is the maximum over distances d of ``(z(d) - z0 - observer_height) / d
    - (1 - refraction) d / (2 radius)``. Near field and far field are joined by taking the larger.

    References
    ----------
    Timonen and Westerholm 2010, *Scalable height field self-shadowing*, sections 4 and 5.

    Examples
    --------
    >>> import numpy as np, adret
    >>> wall = np.zeros((1, 5)); wall[0, 4] = 10.0
    >>> terrain = adret.Terrain(wall, cell_size=(10.0, 10.0))
    >>> east = adret.horizon_map(terrain, azimuths=[np.pi / 2])
    >>> np.degrees(east.elevation[0, 0]).round(2)
    array([ 14.04,  18.43,  26.57,  45.  , -90.  ], dtype=float32)
    """
    if not isinstance(terrain, Terrain):
        raise InputError("terrain", "a Terrain", type(terrain).__name__)
    options = HorizonOptions(
        method=method,
        near=near,
        max_distance=max_distance,
        radius=radius,
        refraction=refraction,
        observer_height=observer_height,
    )
    if distance and method not in ("sweep", "exact"):
        raise InputError("distance", "False with methods 'hull' and 'march'", distance)
    azimuth = azimuth_set(directions, azimuths)
    expected = None
    if max_error is not None:
        if method != "sweep":
            raise InputError("max_error", "None with another method than 'sweep'", max_error)
        limit = "an angle above 0 and up to 90 degrees"
        if real("max_error", max_error, limit, 0.0, 90.0) == 0.0:
            raise InputError("max_error", limit, max_error)
        near, expected = accuracy.near_for(terrain, azimuth, options, max_error)
        options = replace(options, near=near)
    elevation = np.empty((azimuth.size, *terrain.shape), np.float32)
    ways = np.empty_like(elevation) if distance else None
    run = HorizonRun(terrain, azimuth, options, progress)
    run.expected_error_deg = expected
    for _ in run.layers(ways, elevation):
        pass
    return HorizonMap(elevation, azimuth, ways, terrain, options, run.report())


def horizon_at(
    terrain: Terrain,
    rows: ArrayLike,
    columns: ArrayLike,
    directions: int = 64,
    *,
    azimuths: ArrayLike | None = None,
    max_distance: float | None = None,
    radius: float | None = None,
    refraction: float = 0.0,
    observer_height: float = 0.0,
) -> NDArray[np.float32]:
    """Exact horizon of some cells [radians]: what ``horizon_map(method="exact")`` holds there.

    Parameters
    ----------
    terrain : Terrain
    rows, columns : array_like of int, shape (P,)
        Cells, from 0.
    directions, azimuths, max_distance, radius, refraction, observer_height
        As for `horizon_map`.

    Returns
    -------
    ndarray, shape (K, P), float32
        Elevations, the same bytes as those of the raster; NaN at nodata cells.

    Raises
    ------
    InputError
        If a cell lies outside the raster or an option is out of range.

    Examples
    --------
    >>> import numpy as np, adret
    >>> terrain = adret.Terrain(np.array([[0.0, 0.0, 30.0]]), cell_size=(10.0, 10.0))
    >>> np.degrees(adret.horizon_at(terrain, [0, 0], [0, 1], azimuths=[np.pi / 2])).round(2)
    array([[56.31, 71.57]], dtype=float32)
    """
    if not isinstance(terrain, Terrain):
        raise InputError("terrain", "a Terrain", type(terrain).__name__)
    options = HorizonOptions(
        method="exact",
        max_distance=max_distance,
        radius=radius,
        refraction=refraction,
        observer_height=observer_height,
    )
    azimuth = azimuth_set(directions, azimuths)
    row, column = (np.atleast_1d(np.asarray(a)) for a in (rows, columns))
    for field, index, length in (
        ("rows", row, terrain.shape[0]),
        ("columns", column, terrain.shape[1]),
    ):
        if index.ndim != 1 or index.dtype.kind not in "iu" or index.shape != row.shape:
            raise InputError(field, "a list of whole numbers, as many rows as columns", index)
        if index.size and (index.min() < 0 or index.max() >= length):
            raise InputError(
                field, f"between 0 and {length - 1}", index[(index < 0) | (index >= length)][0]
            )
    slope = methods.exact_points(terrain, options, azimuth, row, column)
    to_elevation(slope, slope)
    return slope
