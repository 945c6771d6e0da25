"""Mitsuba's path tracer as a reference: indirect light of a terrain's cells, from its triangles.

The cells' centres are the vertices; the two triangles between four of them share the diagonal from
north-west to south-east, or the other one. Surfaces are one-sided, diffuse, and have the normals of
their faces: what the senders look like is left to Mitsuba. Rays leave each receiver a thousandth
of a cell above it, and are weighed by the cosine to the normal that the library gives the cell, so
that both answer the same question. Directions are drawn below a bound of the terrain's elevation in
each sector of azimuth: above it there is only sky, and fewer paths are wasted. Shares no code with
adret.
"""

import importlib.util
import subprocess
import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

VARIANTS = ("llvm_ad_rgb", "cuda_ad_rgb")
PROBE = """
import mitsuba
mitsuba.set_variant("{variant}")
import drjit
drjit.eval(drjit.maximum(drjit.arange(mitsuba.Float, 64), 3.0))
"""
LIFT = 1e-3  # cells
SECTORS = 64


def missing() -> str | None:
    """Why Mitsuba cannot run here, or None; else chooses its variant."""
    if importlib.util.find_spec("mitsuba") is None:
        return "mitsuba is not installed (pip install mitsuba)"
    for variant in VARIANTS:
        # An LLVM older than 17 lacks what Dr.Jit asks for, and ends the process.
        done = subprocess.run(
            [sys.executable, "-c", PROBE.format(variant=variant)], capture_output=True, check=False
        )
        if done.returncode == 0:
            import mitsuba

            mitsuba.set_variant(variant)
            return None
    return "mitsuba finds neither a GPU nor LLVM 17 or newer (DRJIT_LIBLLVM_PATH says where)"


class PathTracer:
    """A terrain under an environment.

    Parameters
    ----------
    heights : (rows, columns) float [m]
    cell_size : (dx, dy) [m]
    normals : (3, rows, columns)
        Of the receivers: east, north, up.
    picture : (h, w, 3)
        Equirectangular radiance; the left edge looks west, columns run clockwise over north.
    albedo : float
    rows, columns : (P,) int
        Receivers.
    rising : bool
        Whether the triangles share the diagonal from south-west to north-east instead.
    """

    def __init__(
        self,
        heights: NDArray[np.floating[Any]],
        cell_size: tuple[float, float],
        normals: NDArray[np.floating[Any]],
        picture: NDArray[np.floating[Any]],
        albedo: float,
        rows: NDArray[np.integer[Any]],
        columns: NDArray[np.integer[Any]],
        *,
        rising: bool = False,
    ) -> None:
        import mitsuba as mi

        n, m = heights.shape
        i, j = np.mgrid[0:n, 0:m]
        # Mitsuba's environment has y up: east = x, up = y, north = -z.
        points = np.stack([j * cell_size[0], heights, i * cell_size[1]], axis=-1)
        nw = (i * m + j)[:-1, :-1].ravel()
        ne, sw, se = nw + 1, nw + m, nw + m + 1
        faces = [nw, sw, ne, ne, sw, se] if rising else [nw, sw, se, nw, se, ne]
        settings = mi.Properties()
        settings["bsdf"] = mi.load_dict(
            {"type": "diffuse", "reflectance": {"type": "rgb", "value": [albedo] * 3}}
        )
        mesh = mi.Mesh("terrain", n * m, 2 * len(nw), props=settings)
        parameters = mi.traverse(mesh)
        parameters["vertex_positions"] = points.astype(np.float32).ravel()
        parameters["faces"] = np.stack(faces, axis=-1).astype(np.uint32).ravel()
        parameters.update()
        # Its columns run clockwise from north; ours from west.
        turned = np.roll(picture, -picture.shape[1] // 4, axis=1).astype(np.float32)
        self._scene = mi.load_dict(
            {
                "type": "scene",
                "terrain": mesh,
                "sky": {"type": "envmap", "bitmap": mi.Bitmap(np.ascontiguousarray(turned))},
            }
        )
        own = normals[:, rows, columns].astype(np.float64)
        self._normals = np.stack([own[0], own[2], -own[1]])
        self._origins = points[rows, columns].T + LIFT * min(cell_size) * self._normals
        self._tops = sector_tops(np.asarray(heights, np.float64), cell_size, rows, columns)

    def indirect(self, depth: int, samples: int, seed: int) -> NDArray[np.float64]:
        """Irradiance (P, 3) by paths of at most `depth` segments, without the direct light.

        A path of depth 2 is sky, ground, receiver: one bounce.
        """
        import drjit as dr
        import mitsuba as mi

        integrator = mi.load_dict(
            {"type": "path", "max_depth": depth, "rr_depth": 1000, "hide_emitters": True}
        )
        cells = self._origins.shape[1]
        batch = max(1, min(samples, 4_000_000 // cells))
        origins, normals = mi.Point3f(self._origins), mi.Normal3f(self._normals)
        tops = mi.Float(self._tops.ravel())
        total = np.zeros((3, cells))
        drawn = 0
        while drawn < samples:
            sampler = mi.load_dict({"type": "independent"})
            sampler.seed(seed * 1_000_003 + drawn, cells * batch)
            which = dr.arange(mi.UInt32, cells * batch) % cells
            origin = dr.gather(mi.Point3f, origins, which)
            normal = dr.gather(mi.Normal3f, normals, which)
            u = sampler.next_2d()
            azimuth = 2.0 * np.pi * u.x
            sector = dr.minimum(mi.UInt32(u.x * SECTORS), SECTORS - 1)
            sine, cosine = dr.sincos(azimuth)
            plane = dr.atan(-(normal.x * sine - normal.z * cosine) / normal.y)
            top = dr.gather(mi.Float, tops, which * SECTORS + sector)
            span = dr.maximum(top - plane, 0.0)
            up, along = dr.sincos(plane + u.y * span)
            towards = mi.Vector3f(along * sine, up, -along * cosine)
            weight = 2.0 * np.pi * span * along * dr.maximum(dr.dot(normal, towards), 0.0)
            light, _, _ = integrator.sample(
                self._scene, sampler, mi.RayDifferential3f(origin, towards), active=weight > 0.0
            )
            sums = dr.zeros(mi.Color3f, cells)
            dr.scatter_reduce(dr.ReduceOp.Add, sums, weight * mi.Color3f(light), which)
            total += np.array(sums).reshape(3, -1)
            drawn += batch
        return np.asarray((total / drawn).T)


def sector_tops(
    heights: NDArray[np.float64],
    cell_size: tuple[float, float],
    rows: NDArray[np.integer[Any]],
    columns: NDArray[np.integer[Any]],
) -> NDArray[np.float64]:
    """Elevation (P, SECTORS) that no terrain of a sector of azimuth rises above [radians]."""

    def corners(layer: NDArray[Any]) -> NDArray[np.float64]:
        quads = [layer[:-1, :-1], layer[:-1, 1:], layer[1:, :-1], layer[1:, 1:]]
        return np.stack(quads).reshape(4, -1).astype(np.float64)

    def least(side: NDArray[np.float64]) -> NDArray[np.float64]:
        across = (side.min(axis=0) <= 0.0) & (side.max(axis=0) >= 0.0)
        return np.where(across, 0.0, abs(side).min(axis=0))

    dx, dy = cell_size
    i, j = np.mgrid[0 : heights.shape[0], 0 : heights.shape[1]]
    easts, norths, ups = corners(j * dx), corners(-i * dy), corners(heights)
    tops = np.full((len(rows), SECTORS), -np.pi / 2.0)
    for row, column, top in zip(rows, columns, tops, strict=True):
        east, north = easts - column * dx, norths + row * dy
        rise = (ups - heights[row, column]).max(axis=0)
        # A facet of the receiver's own is as steep everywhere as at the edge across from it, and
        # no edge across is nearer than the diagonal.
        near = np.maximum(np.hypot(least(east), least(north)), dx * dy / np.hypot(dx, dy))
        far = np.hypot(abs(east).max(axis=0), abs(north).max(axis=0))
        slope = np.arctan(rise / np.where(rise > 0.0, near, far))
        middle = np.arctan2(east.mean(axis=0), north.mean(axis=0))
        aside = np.mod(np.arctan2(east, north) - middle + np.pi, 2.0 * np.pi) - np.pi
        aside[np.hypot(east, north) < 0.5 * min(dx, dy)] = 0.0  # the receiver itself
        first, last = (
            np.floor((middle + side) / (2.0 * np.pi) * SECTORS).astype(np.int64)
            for side in (aside.min(axis=0), aside.max(axis=0))
        )
        for more in range(int((last - first).max()) + 1):
            inside = first + more <= last
            np.maximum.at(top, (first[inside] + more) % SECTORS, slope[inside])
    return np.minimum(tops + 1e-3, np.pi / 2.0)


def finer(z: NDArray[np.float64], times: int) -> NDArray[np.float64]:
    """The same triangles, sampled `times` as densely."""
    n, m = z.shape
    i, j = np.arange((n - 1) * times + 1) / times, np.arange((m - 1) * times + 1) / times
    row, column = np.minimum(i.astype(int), n - 2), np.minimum(j.astype(int), m - 2)
    u, v = (i - row)[:, None], (j - column)[None, :]
    a, b = z[np.ix_(row, column)], z[np.ix_(row, column + 1)]
    c, d = z[np.ix_(row + 1, column)], z[np.ix_(row + 1, column + 1)]
    below, above = a + u * (c - a) + v * (d - c), a + v * (b - a) + u * (d - b)
    return np.where(u >= v, below, above)
