"""Metres on the ground: what a coordinate reference system says about cells and directions.

A raster whose columns are meridians (geographic, or a cylindrical projection) has cells whose
ground size changes with the row. One cell size is then right at one latitude only; elsewhere the
ratio of width to height is off by a factor q and an azimuth by up to asin(abs(q - 1) / (q + 1)),
reached at tan(azimuth) = 1/sqrt(q). `RowWiseGrid` holds these relations.
"""

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adret.errors import InputError, RasterError

if TYPE_CHECKING:
    from affine import Affine
    from pyproj import CRS, Geod

__all__ = [
    "Band",
    "RowWiseGrid",
    "body_radius",
    "cell_size",
    "grid_convergence",
    "parse_crs",
    "row_wise_grid",
    "shifted",
    "vertical_factor",
]

MAX_LATITUDE = 89.9
# Projections that stretch the ground by more than this at the raster's centre are corrected.
GROUND_SCALE_TOLERANCE = 0.01

_VERTICAL_UNITS = {
    1.0: ("m", "metre", "meter", "metres", "meters"),
    1000.0: ("km", "kilometre", "kilometer", "kilometres", "kilometers"),
    0.1: ("dm", "decimetre", "decimeter", "decimetres", "decimeters"),
    0.01: ("cm", "centimetre", "centimeter", "centimetres", "centimeters"),
    0.001: ("mm", "millimetre", "millimeter", "millimetres", "millimeters"),
    0.3048: ("ft", "foot", "feet", "international foot"),
    1200.0 / 3937.0: ("us-ft", "ftus", "us survey foot", "us survey feet", "survey foot"),
}
_FACTOR_OF = {name: factor for factor, names in _VERTICAL_UNITS.items() for name in names}


class Band(NamedTuple):
    """Rows `start` to `stop` that share the cell size (dx, dy) [m]."""

    start: int
    stop: int
    cell_size: tuple[float, float]


def vertical_factor(unit: str) -> float:
    """Metres in one vertical unit, by its usual names ("m", "ft", "US survey foot", ...).

    Raises
    ------
    InputError
        If the name is not known.

    Examples
    --------
    >>> vertical_factor("ft")
    0.3048
    """
    name = unit if isinstance(unit, str) else ""
    factor = _FACTOR_OF.get(" ".join(name.replace("_", " ").lower().split()))
    if factor is None:
        raise InputError("vertical_unit", "one of m, km, dm, cm, mm, ft, us-ft", unit)
    return factor


def parse_crs(crs: Any) -> "CRS | None":
    """Return a `pyproj.CRS` from anything that names one; None stays None.

    Raises
    ------
    InputError
        If it is not understood, or has no horizontal axes in a known unit.
    """
    if crs is None:
        return None
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        parsed = CRS.from_user_input(crs)
    except (CRSError, TypeError, ValueError):
        raise InputError("crs", "a coordinate reference system that PROJ knows", crs) from None
    if parsed.is_geocentric or _horizontal(parsed).is_vertical:
        raise InputError("crs", "geographic, projected or local", parsed.name)
    _unit_factor(parsed)
    return parsed


def _horizontal(crs: "CRS") -> "CRS":
    """The part of a compound or bound reference system that says where a cell lies."""
    if crs.is_compound:
        return _horizontal(crs.sub_crs_list[0])
    if crs.is_bound and crs.source_crs is not None:
        return _horizontal(crs.source_crs)
    return crs


def _unit_factor(crs: "CRS") -> float:
    """Metres (projected) or radians (geographic) in one unit of the horizontal axes."""
    axes = crs.axis_info
    factor = axes[0].unit_conversion_factor if axes else math.nan
    if not (math.isfinite(factor) and factor > 0.0):
        name = axes[0].unit_name if axes else "unknown"
        raise InputError("crs unit", "a known unit of length or angle", name)
    if len(axes) > 1 and axes[1].unit_conversion_factor != factor:
        raise InputError("crs unit", "the same on both horizontal axes", axes[1].unit_name)
    return float(factor)


def body_radius(crs: "CRS | None") -> float | None:
    """Mean radius (2a + b)/3 of the body's ellipsoid [m]; None without an ellipsoid.

    Examples
    --------
    >>> round(body_radius(parse_crs("EPSG:4326")))
    6371009
    """
    if crs is None or crs.ellipsoid is None:
        return None
    ellipsoid = crs.ellipsoid
    return (2.0 * ellipsoid.semi_major_metre + ellipsoid.semi_minor_metre) / 3.0


def vertical_unit_of(crs: "CRS | None") -> str | None:
    """Name of the unit of a compound reference system's vertical axis; None without one."""
    if crs is None or len(crs.axis_info) < 3:
        return None
    return str(crs.axis_info[2].unit_name)


def _is_row_wise(crs: "CRS") -> bool:
    if crs.is_geographic:
        return True
    operation = crs.coordinate_operation
    name = operation.method_name if operation is not None else ""
    oblique = any(word in name for word in ("Transverse", "Oblique", "Hotine", "Space", "Cassini"))
    return ("Cylindrical" in name or "Mercator" in name) and not oblique


def shifted(transform: "Affine", columns: int, rows: int) -> "Affine":
    """The transform of the part that starts `columns` and `rows` further on."""
    c, f = _place(transform, columns, rows)
    return type(transform)(transform.a, transform.b, c, transform.d, transform.e, f)


def _place(transform: "Affine", column: float, row: float) -> tuple[float, float]:
    """CRS coordinates of a point given in columns and rows (no rotation)."""
    return transform.c + transform.a * column, transform.f + transform.e * row


def cell_size(
    crs: "CRS | None", transform: "Affine", shape: tuple[int, int]
) -> tuple[float, float]:
    """Ground size (dx, dy) of the raster's middle cell [m].

    Geographic and cylindrical grids: measured on the ellipsoid at the middle latitude. Other
    projections: the transform's own size in metres, unless the projection stretches the ground at
    the raster's centre by more than 1 %, when the ground's size is taken.

    Raises
    ------
    RasterError
        If a geographic raster reaches beyond 89.9 degrees of latitude.
    """
    dx, dy = abs(transform.a), abs(transform.e)
    if crs is None:
        return dx, dy
    crs = _horizontal(crs)
    grid = row_wise_grid(crs, transform, shape)
    if grid is not None:
        grid.check_latitudes(shape[0])
        return grid.cell_at_row((shape[0] - 1) / 2.0)
    factor = _unit_factor(crs)
    nominal = dx * factor, dy * factor
    ground = _GroundScale.of(crs)
    if ground is None:
        return nominal
    x, y = _place(transform, shape[1] / 2.0, shape[0] / 2.0)
    measured = ground.cell(x, y, dx, dy)
    if all(
        abs(m / n - 1.0) <= GROUND_SCALE_TOLERANCE for m, n in zip(measured, nominal, strict=True)
    ):
        return nominal
    return measured


def grid_convergence(crs: "CRS", transform: "Affine", shape: tuple[int, int]) -> float | None:
    """Azimuth of grid north at the raster's centre [degrees clockwise from true north].

    None at a pole, and for local systems that are not tied to a body.
    """
    crs = _horizontal(crs)
    if crs.is_geographic:
        return 0.0
    ground = _GroundScale.of(crs)
    if ground is None:
        return None
    x, y = _place(transform, shape[1] / 2.0, shape[0] / 2.0)
    step = abs(transform.e)
    lon, lat = ground.to_degrees.transform([x, x], [y - step, y + step])
    if not np.isfinite([*lon, *lat]).all() or max(map(abs, lat)) > MAX_LATITUDE:
        return None
    return float(ground.geod.inv(lon[0], lat[0], lon[1], lat[1])[0])


def _geod(crs: "CRS") -> "Geod":
    geod = crs.get_geod()
    assert geod is not None
    return geod


class _GroundScale:
    """Distances on the ellipsoid between points given in a projected system."""

    def __init__(self, crs: "CRS") -> None:
        from pyproj import Transformer

        self.to_degrees = Transformer.from_crs(crs, crs.geodetic_crs, always_xy=True)
        self.geod = _geod(crs)

    @classmethod
    def of(cls, crs: "CRS") -> "_GroundScale | None":
        """None for local systems that are not tied to a body."""
        if crs.geodetic_crs is None or crs.get_geod() is None:
            return None
        return cls(crs)

    def cell(self, x: float, y: float, dx: float, dy: float) -> tuple[float, float]:
        """Ground width and height [m] of the cell of size (dx, dy) [CRS units] at (x, y)."""
        xs = [x - dx / 2.0, x + dx / 2.0, x, x]
        ys = [y, y, y - dy / 2.0, y + dy / 2.0]
        lon, lat = self.to_degrees.transform(xs, ys)
        if not np.isfinite([*lon, *lat]).all():
            raise RasterError("transform", "inside the area of the projection", f"({x}, {y})")
        _, _, across = self.geod.inv(lon[0], lat[0], lon[1], lat[1])
        _, _, along = self.geod.inv(lon[2], lat[2], lon[3], lat[3])
        return float(across), float(along)


def row_wise_grid(
    crs: "CRS | None", transform: "Affine | None", shape: tuple[int, int]
) -> "RowWiseGrid | None":
    """The grid's row-wise geometry; None where the ground size does not hang on the row."""
    if crs is None or transform is None or not _is_row_wise(_horizontal(crs)):
        return None
    return RowWiseGrid(_horizontal(crs), transform, shape[1])


class RowWiseGrid:
    """A raster whose columns are meridians: ground size of a cell as a function of its latitude.

    Parameters
    ----------
    crs : pyproj.CRS
        Geographic, or a cylindrical projection in normal aspect.
    transform : Affine
        North-up geotransform.
    columns : int
        Width; a projected grid is measured along its middle column.
    """

    def __init__(self, crs: "CRS", transform: "Affine", columns: int) -> None:
        self.transform = transform
        self._unit = math.degrees(_unit_factor(crs)) if crs.is_geographic else 1.0
        self._geographic = crs.is_geographic
        self._geod = _geod(crs)
        self._x = transform.c + transform.a * columns / 2.0
        self._ground = None if crs.is_geographic else _GroundScale(crs)

    def latitudes(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Latitude [degrees] of rows counted at cell centres (0 = centre of the first row)."""
        y = self.transform.f + self.transform.e * (np.asarray(rows, dtype=np.float64) + 0.5)
        if self._ground is None:
            return np.asarray(y * self._unit)
        _, lat = self._ground.to_degrees.transform(np.full(y.shape, self._x), y)
        return np.asarray(lat, dtype=np.float64)

    def check_latitudes(self, rows: int) -> None:
        """Refuse a raster that holds a pole, where columns meet."""
        for edge in self.latitudes(np.array([-0.5, rows - 0.5])):
            if not abs(edge) <= MAX_LATITUDE:
                raise RasterError(
                    "latitude",
                    f"within +-{MAX_LATITUDE} degrees (take a polar projection, or a window)",
                    float(edge),
                )

    def cell_at(self, latitude: float) -> tuple[float, float]:
        """Ground size (dx, dy) [m] of a cell at a latitude [degrees]."""
        a, es = self._geod.a, self._geod.es
        phi = math.radians(latitude)
        if self._ground is None:
            w2 = 1.0 - es * math.sin(phi) ** 2
            meridian = a * (1.0 - es) / w2**1.5
            parallel = a / math.sqrt(w2) * math.cos(phi)
            radians = math.radians(self._unit)
            return (
                parallel * abs(self.transform.a) * radians,
                meridian * abs(self.transform.e) * radians,
            )
        lon, _ = self._ground.to_degrees.transform(self._x, self.transform.f)
        x, y = self._ground.to_degrees.transform(lon, latitude, direction="INVERSE")
        return self._ground.cell(x, y, abs(self.transform.a), abs(self.transform.e))

    def cell_at_row(self, row: float) -> tuple[float, float]:
        """Ground size (dx, dy) [m] of a cell in a row (0 = centre of the first row)."""
        return self.cell_at(float(self.latitudes(np.array([row]))[0]))

    def azimuth_error(self, cell: tuple[float, float], start: int, stop: int) -> float:
        """Largest azimuth error [radians] in rows start..stop when `cell` is taken for all."""
        ends = self.latitudes(np.array([start, stop - 1], dtype=np.float64))
        # The ratio of width to height has its extremes at the ends or on the equator.
        candidates = [float(ends[0]), float(ends[1])]
        if ends[0] * ends[1] < 0.0:
            candidates.append(0.0)
        return max(stretch_error(self.cell_at(lat), cell) for lat in candidates)

    def bands(self, start: int, stop: int, limit: float) -> list[Band]:
        """Cut rows start..stop so that each band's azimuth error stays below `limit` [radians].

        The cuts are a lattice in the logarithm of the cell's width over height. They hang on the
        latitude alone, so a window of a raster is cut where the raster is.
        """
        step = 4.0 * math.atanh(math.sin(limit))  # an error of +-limit about the band's middle
        ratio_equator = self._log_ratio(0.0)
        latitude = self.latitudes(np.arange(start, stop, dtype=np.float64))
        size = _log_ratios(self, latitude) - ratio_equator
        index = np.floor(size / step).astype(np.int64)
        cuts = np.flatnonzero(np.diff(index)) + 1
        edges = [0, *cuts.tolist(), stop - start]
        bands = []
        for low, high in pairwise(edges):
            middle = ratio_equator + (index[low] + 0.5) * step
            sign = 1.0 if latitude[low] + latitude[high - 1] >= 0.0 else -1.0
            bands.append(Band(start + low, start + high, self.cell_at(sign * self._solve(middle))))
        return bands

    def _log_ratio(self, latitude: float) -> float:
        dx, dy = self.cell_at(latitude)
        return math.log(dx / dy)

    def _solve(self, log_ratio: float) -> float:
        """Latitude >= 0 [degrees] whose cell has this log(dx/dy), by bisection."""
        low, high = 0.0, MAX_LATITUDE
        falling = self._log_ratio(high) < self._log_ratio(low)
        for _ in range(60):
            middle = 0.5 * (low + high)
            if (self._log_ratio(middle) > log_ratio) == falling:
                low = middle
            else:
                high = middle
        return 0.5 * (low + high)


def _log_ratios(grid: RowWiseGrid, latitude: NDArray[np.float64]) -> NDArray[np.float64]:
    """log(dx/dy) of every row."""
    cells = np.array([grid.cell_at(float(lat)) for lat in latitude])
    return np.asarray(np.log(cells[:, 0] / cells[:, 1]))


def stretch_error(true: tuple[float, float], taken: tuple[float, float]) -> float:
    """Largest azimuth error [radians] when cells of size `true` are taken to be `taken`.

    Examples
    --------
    >>> round(stretch_error((1.0, 2.0), (1.0, 1.0)), 6)
    0.339837
    """
    q = (true[0] / taken[0]) / (true[1] / taken[1])
    return math.asin(abs(q - 1.0) / (q + 1.0))
