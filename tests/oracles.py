"""Slow, obvious twins of the library's results: plain float64, sharing no code with adret.

Axes as everywhere: row 0 is north, [row, column], azimuth in radians clockwise from north, vectors
(east, north, up), NaN is nodata.  One function answers for one cell, in the words of the
definition, so that it can be read and believed.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

EARTH_RADIUS = 6_371_000.0
SNAP = 1e-9  # a crossing this close to a vertex [cells] is the vertex


# --- horizons ------------------------------------------------------------------------------------


def ray_crossings(
    heights: ArrayLike,
    cell_size: tuple[float, float],
    row: int,
    column: int,
    azimuth: float,
    max_distance: float = np.inf,
) -> tuple[Array, Array]:
    """Distances [m] and heights [m] where a cell's own ray crosses grid rows and grid columns.

    The height is interpolated linearly between the two vertices of the crossed grid edge.  A ray
    that passes through a vertex touches that vertex only.  Crossings outside the raster, beyond
    `max_distance`, or with nodata at a vertex they touch are left out.
    """
    z = np.asarray(heights, dtype=np.float64)
    rows, columns = z.shape
    dx, dy = cell_size
    east, north = np.sin(azimuth), np.cos(azimuth)
    columns_per_metre = 0.0 if abs(east) < 1e-12 else east / dx
    rows_per_metre = 0.0 if abs(north) < 1e-12 else -north / dy
    distances, crossed = [], []
    if columns_per_metre != 0.0:
        step = 1 if columns_per_metre > 0 else -1
        for j in range(column + step, columns if step > 0 else -1, step):
            d = (j - column) / columns_per_metre
            height = _between(z[:, j], row + d * rows_per_metre)
            distances.append(d)
            crossed.append(height)
    if rows_per_metre != 0.0:
        step = 1 if rows_per_metre > 0 else -1
        for i in range(row + step, rows if step > 0 else -1, step):
            d = (i - row) / rows_per_metre
            height = _between(z[i, :], column + d * columns_per_metre)
            distances.append(d)
            crossed.append(height)
    d, h = np.array(distances, dtype=np.float64), np.array(crossed, dtype=np.float64)
    keep = np.isfinite(h) & (d <= max_distance * (1.0 + 1e-12))
    order = np.argsort(d[keep], kind="stable")
    return d[keep][order], h[keep][order]


def _between(line: Array, position: float) -> float:
    """Height on a grid line at a fractional position; NaN outside it or touching nodata."""
    nearest = round(position)
    if abs(position - nearest) < SNAP:
        return float(line[nearest]) if 0 <= nearest < line.size else np.nan
    if not 0.0 < position < line.size - 1:
        return np.nan
    lower = int(np.floor(position))
    weight = position - lower
    return float((1.0 - weight) * line[lower] + weight * line[lower + 1])


def horizon(
    heights: ArrayLike,
    cell_size: tuple[float, float],
    row: int,
    column: int,
    azimuth: float,
    *,
    max_distance: float | None = None,
    radius: float | None = None,
    refraction: float = 0.0,
    observer_height: float = 0.0,
) -> tuple[float, float]:
    """Horizon elevation [rad] of one cell at one azimuth, and the distance [m] to it.

    (-pi/2, NaN) where nothing lies that way, (NaN, NaN) at a nodata receiver.
    """
    z = np.asarray(heights, dtype=np.float64)
    if np.isnan(z[row, column]):
        return np.nan, np.nan
    limit = np.inf if max_distance is None else max_distance
    d, h = ray_crossings(z, cell_size, row, column, azimuth, limit)
    if d.size == 0:
        return -np.pi / 2, np.nan
    drop = 0.0 if radius is None else (1.0 - refraction) * d * d / (2.0 * radius)
    slope = (h - z[row, column] - observer_height - drop) / d
    best = int(np.argmax(slope))
    return float(np.arctan(slope[best])), float(d[best])


def horizons(
    heights: ArrayLike,
    cell_size: tuple[float, float],
    cells: ArrayLike,
    azimuths: ArrayLike,
    **options: float | None,
) -> Array:
    """`horizon` of every (row, column) in `cells` at every azimuth: shape (K, cells) [rad]."""
    return np.array(
        [
            [horizon(heights, cell_size, int(r), int(c), float(a), **options)[0] for r, c in cells]
            for a in np.atleast_1d(azimuths)
        ]
    )


def horizon_cube(
    heights: ArrayLike,
    cell_size: tuple[float, float],
    azimuths: ArrayLike,
    **options: float | None,
) -> Array:
    """`horizon` of every cell at every azimuth: shape (K, rows, columns) [rad]."""
    shape = np.asarray(heights).shape
    cells = list(np.ndindex(shape))
    flat = horizons(heights, cell_size, cells, azimuths, **options)
    return flat.reshape(len(flat), *shape)


# --- normals and integrals over the sky ----------------------------------------------------------


def normal(
    heights: ArrayLike, cell_size: tuple[float, float], row: int, column: int
) -> tuple[float, float, float]:
    """Unit normal (east, north, up): central differences, one-sided where one neighbour lacks."""
    z = np.asarray(heights, dtype=np.float64)
    here = z[row, column]
    if np.isnan(here):
        return np.nan, np.nan, np.nan

    def derivative(before: float, after: float, step: float) -> float:
        if np.isnan(before) and np.isnan(after):
            return 0.0
        if np.isnan(before):
            return (after - here) / step
        if np.isnan(after):
            return (here - before) / step
        return (after - before) / (2.0 * step)

    def at(i: int, j: int) -> float:
        inside = 0 <= i < z.shape[0] and 0 <= j < z.shape[1]
        return float(z[i, j]) if inside else np.nan

    to_east = derivative(at(row, column - 1), at(row, column + 1), cell_size[0])
    to_north = derivative(at(row + 1, column), at(row - 1, column), cell_size[1])
    length = np.sqrt(to_east**2 + to_north**2 + 1.0)
    return -to_east / length, -to_north / length, 1.0 / length


def own_plane_horizon(unit_normal: ArrayLike, azimuths: ArrayLike) -> Array:
    """Elevation [rad] of the receiver's own tangent plane at each azimuth."""
    n = np.asarray(unit_normal, dtype=np.float64)
    a = np.asarray(azimuths, dtype=np.float64)
    return np.arctan2(-(n[0] * np.sin(a) + n[1] * np.cos(a)), n[2])


def sky_integral(
    elevation: ArrayLike,
    azimuths: ArrayLike,
    integrand: Callable[[Array, Array], Array],
    nodes: int = 48,
) -> float:
    """Integral of `integrand`(azimuth, elevation) over the solid angle above the horizon.

    Gauss-Legendre in elevation from the horizon to the zenith, equal weights in azimuth.
    """
    e0 = np.asarray(elevation, dtype=np.float64)
    a = np.asarray(azimuths, dtype=np.float64)
    x, w = np.polynomial.legendre.leggauss(nodes)
    half = (np.pi / 2 - e0)[:, None] / 2
    e = e0[:, None] + half * (x[None, :] + 1.0)
    values = integrand(np.broadcast_to(a[:, None], e.shape), e) * np.cos(e)
    return float(np.sum(values * w * half) * 2.0 * np.pi / a.size)


def sky_view(
    elevation: ArrayLike,
    azimuths: ArrayLike,
    kind: str,
    unit_normal: ArrayLike = (0.0, 0.0, 1.0),
    clip: bool = True,
) -> float:
    """Sky-view factor of one cell by quadrature of its definition."""
    h = np.asarray(elevation, dtype=np.float64)
    a = np.asarray(azimuths, dtype=np.float64)
    if np.isnan(h).any():
        return np.nan
    floor = 0.0 if clip else -np.pi / 2
    if kind == "visible":
        return sky_integral(np.maximum(h, floor), a, lambda _, e: np.ones_like(e)) / (2 * np.pi)
    if kind == "horizontal":
        return sky_integral(np.maximum(h, floor), a, lambda _, e: np.sin(e)) / np.pi
    n = np.asarray(unit_normal, dtype=np.float64)
    above = np.maximum(np.maximum(h, own_plane_horizon(n, a)), floor)
    return sky_integral(above, a, lambda p, e: cosine(n, p, e)) / np.pi


def cosine(n: Array, azimuth: ArrayLike, elevation: ArrayLike) -> Array:
    """Cosine between a unit normal and the direction (azimuth, elevation)."""
    a, e = np.asarray(azimuth, dtype=np.float64), np.asarray(elevation, dtype=np.float64)
    return (n[0] * np.sin(a) + n[1] * np.cos(a)) * np.cos(e) + n[2] * np.sin(e)


def openness(elevation: ArrayLike) -> float:
    """Positive openness [degrees] of one cell from its horizons."""
    return float(np.mean(90.0 - np.degrees(np.asarray(elevation, dtype=np.float64))))


# --- light ---------------------------------------------------------------------------------------


def overcast_irradiance(
    elevation: ArrayLike, azimuths: ArrayLike, unit_normal: ArrayLike = (0.0, 0.0, 1.0)
) -> float:
    """Irradiance under L = (1 + 2 sin e)/3 on a plane with this normal, above this horizon."""
    n = np.asarray(unit_normal, dtype=np.float64)
    a = np.asarray(azimuths, dtype=np.float64)
    above = np.maximum(np.maximum(elevation, own_plane_horizon(n, a)), 0.0)
    return sky_integral(above, a, lambda p, e: cosine(n, p, e) * (1.0 + 2.0 * np.sin(e)) / 3.0)


def environment_irradiance(
    radiance: ArrayLike,
    azimuth: ArrayLike,
    elevation: ArrayLike,
    solid_angle: ArrayLike,
    horizon_at: Callable[[Array], Array],
    unit_normal: ArrayLike,
) -> Array:
    """Irradiance by direct summation over the pixels of an environment.

    `azimuth`, `elevation` and `solid_angle` belong to the pixels (any shape); `radiance` may have a
    last axis of bands; `horizon_at` gives the horizon elevation for azimuths.
    """
    n = np.asarray(unit_normal, dtype=np.float64)
    pixels = np.asarray(radiance, dtype=np.float64)
    a, e = np.asarray(azimuth, dtype=np.float64), np.asarray(elevation, dtype=np.float64)
    seen = np.maximum(cosine(n, a, e), 0.0) * (e > horizon_at(a)) * np.asarray(solid_angle)
    extra = pixels.ndim - seen.ndim
    return np.sum(pixels * seen.reshape(seen.shape + (1,) * extra), axis=tuple(range(seen.ndim)))


def sun_vector(azimuth: float, elevation: float) -> Array:
    """Unit vector (east, north, up) towards the sun."""
    return np.array(
        [
            np.cos(elevation) * np.sin(azimuth),
            np.cos(elevation) * np.cos(azimuth),
            np.sin(elevation),
        ]
    )


def disc_share(above_horizon: float, disc_radius: float, strips: int = 20_000) -> float:
    """Share of a disc above a straight edge; `above_horizon` is centre minus edge [rad]."""
    y = (np.arange(strips) + 0.5) / strips * 2.0 - 1.0
    chord = np.sqrt(1.0 - y * y)
    return float(np.sum(chord * (y > -above_horizon / disc_radius)) / np.sum(chord))


# --- a ray tracer that nobody here wrote ---------------------------------------------------------


def fence_mesh(heights: ArrayLike, cell_size: tuple[float, float]) -> tuple[Array, Array]:
    """Vertical fences along every grid row and column, up to the surface.

    A ray from above meets the fences exactly where it dips below the surface at a grid line, so the
    horizon over the fences is the horizon over the crossings.  Returns (vertices, triangles).
    """
    z = np.asarray(heights, dtype=np.float64)
    rows, columns = z.shape
    i, j = np.mgrid[0:rows, 0:columns]
    top = np.stack([j * cell_size[0], -i * cell_size[1], z], axis=-1).reshape(-1, 3)
    bottom = top.copy()
    bottom[:, 2] = z.min() - 10.0 * max(np.ptp(z), 1.0)
    index = np.arange(rows * columns).reshape(rows, columns)
    starts = np.concatenate([index[:, :-1].ravel(), index[:-1, :].ravel()])
    ends = np.concatenate([index[:, 1:].ravel(), index[1:, :].ravel()])
    below = rows * columns
    first = np.stack([starts, ends, ends + below], axis=-1)
    second = np.stack([starts, ends + below, starts + below], axis=-1)
    return np.concatenate([top, bottom]), np.concatenate([first, second])


def surface_mesh(heights: ArrayLike, cell_size: tuple[float, float]) -> tuple[Array, Array]:
    """The surface itself, two triangles a quad.  Returns (vertices, triangles)."""
    z = np.asarray(heights, dtype=np.float64)
    rows, columns = z.shape
    i, j = np.mgrid[0:rows, 0:columns]
    vertices = np.stack([j * cell_size[0], -i * cell_size[1], z], axis=-1).reshape(-1, 3)
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b = index[:-1, :-1].ravel(), index[:-1, 1:].ravel()
    c, d = index[1:, :-1].ravel(), index[1:, 1:].ravel()
    return vertices, np.concatenate([np.stack([a, c, b], -1), np.stack([b, c, d], -1)])


def rays_hit(
    mesh: tuple[Array, Array],
    heights: ArrayLike,
    cell_size: tuple[float, float],
    cells: ArrayLike,
    azimuths: ArrayLike,
    elevations: ArrayLike,
    start: float = 1e-3,
) -> NDArray[np.bool_]:
    """Whether the ray from each cell towards (azimuth, elevation) meets the mesh, by Embree.

    Needs `trimesh` and `embreex`; one cell, azimuth and elevation a ray.  A ray starts `start`
    cells from its own vertex, where nothing lies yet: the first crossing is at least a cell away.
    """
    import trimesh
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    z = np.asarray(heights, dtype=np.float64)
    at = np.asarray(cells)
    origin = np.stack(
        [at[:, 1] * cell_size[0], -at[:, 0] * cell_size[1], z[at[:, 0], at[:, 1]]], axis=-1
    )
    a, e = np.asarray(azimuths, dtype=np.float64), np.asarray(elevations, dtype=np.float64)
    direction = np.stack([np.cos(e) * np.sin(a), np.cos(e) * np.cos(a), np.sin(e)], axis=-1)
    origin = origin + direction * start * min(cell_size)
    tracer = RayMeshIntersector(trimesh.Trimesh(*mesh, process=False))
    return np.asarray(tracer.intersects_any(origin, direction))
