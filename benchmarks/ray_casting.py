"""Viewsheds by Embree: one ray from the eye to each cell, over triangles.

Needs `embreex`. "two" cuts each square between four cells along a diagonal, as is usual. "four"
cuts it along both, and sinks the middle below its corners: no line then meets the triangles but on
the squares' sides, which are the surface that Adret means.
"""

import importlib.metadata
import importlib.util
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

import adret

SHORT = 1e-4  # the share of a ray that is not followed, so that it does not meet its own target


def missing() -> str | None:
    """Why rays cannot be cast here, or None."""
    return None if importlib.util.find_spec("embreex") else "embreex is not installed"


def version() -> str:
    """Version of the binding."""
    return importlib.metadata.version("embreex")


class Scene:
    """Triangles of a terrain without nodata.

    Attributes
    ----------
    build_seconds : float
        CPU time to build what is searched.
    """

    def __init__(self, terrain: adret.Terrain, triangles: str) -> None:
        from embreex import rtcore_scene
        from embreex.mesh_construction import TriangleMesh

        z = terrain.heights.astype(np.float64)
        self.shape = terrain.shape
        rows, columns = np.indices(self.shape)
        dx, dy = terrain.cell_size
        self.points = np.stack([columns * dx, -rows * dy, z], axis=-1).reshape(-1, 3)
        index = np.arange(z.size).reshape(self.shape)
        corners = (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1])
        a, b, c, d = (corner.ravel() for corner in corners)
        points = self.points
        if triangles == "two":
            cut = [(a, d, b), (b, d, c)]
        else:
            lowest = np.minimum.reduce([points[i, 2] for i in (a, b, c, d)]) - max(dx, dy)
            middle = 0.5 * (points[a] + points[c])
            middle[:, 2] = lowest
            m = z.size + np.arange(len(middle))
            points = np.concatenate([points, middle])
            cut = [(a, b, m), (b, c, m), (c, d, m), (d, a, m)]
        self.middle = points.mean(axis=0)
        faces = np.concatenate([np.stack(each, axis=-1) for each in cut]).astype(np.int32)
        start = time.process_time()
        self.scene = rtcore_scene.EmbreeScene()
        self.mesh = TriangleMesh(self.scene, (points - self.middle).astype(np.float32), faces)
        self._occluded(self.points[0], self.points[1:2])  # the first search builds
        self.build_seconds = time.process_time() - start

    def _occluded(self, eye: Any, targets: Any) -> NDArray[np.bool_]:
        way = np.asarray(targets - eye, dtype=np.float32)
        start = np.broadcast_to(eye - self.middle, way.shape).astype(np.float32)
        reach = np.full(len(way), 1.0 - SHORT, np.float32)
        return np.asarray(self.scene.run(start, way, dists=reach, query="OCCLUDED")) != -1

    def seen(self, place: tuple[int, int], eye: float) -> tuple[NDArray[np.bool_], float]:
        """What is seen from `eye` metres above a cell, and the rays' CPU time."""
        start = time.process_time()
        at = place[0] * self.shape[1] + place[1]
        hidden = self._occluded(self.points[at] + [0.0, 0.0, eye], self.points)
        seen = ~hidden.reshape(self.shape)
        seen[place] = True
        return seen, time.process_time() - start
