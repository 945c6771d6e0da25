"""Other tools' indirect light on the same triangles: rays cast by Embree, Mitsuba's path tracer."""

import importlib.metadata
import importlib.util
import os
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

REPOSITORY = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(REPOSITORY / "tests")]

import numpy as np  # noqa: E402
from numpy.typing import NDArray  # noqa: E402

import adret  # noqa: E402
import path_tracer  # noqa: E402

ALBEDO = 0.6
RAYS_AT_ONCE = 1 << 17
EXAMPLES = REPOSITORY / "examples" / "data"
ALETSCH = EXAMPLES / "alpine_aletsch_dhm200_lv95_200m.tif"
JACKSBORO = EXAMPLES / "jacksboro_fault_epsg4326.tif"
SKY = EXAMPLES / "sky_512.exr"
Entry = dict[str, Any]
Array = NDArray[np.float64]


def timed(work: Callable[[], Any]) -> tuple[Any, float]:
    """Result and CPU time [s] of all threads."""
    start = time.process_time()
    result = work()
    return result, time.process_time() - start


def off(got: Any, want: Any) -> Entry:
    """Errors as shares of the mean of what they are measured against."""
    known = np.isfinite(want)
    error = (np.asarray(got, np.float64) - want)[known]
    mean = float(np.asarray(want)[known].mean())
    return {
        "mean": float(abs(error).mean()) / mean,
        "p99": float(np.quantile(abs(error), 0.99)) / mean,
        "most": float(abs(error).max()) / mean,
        "bias": float(error.mean()) / mean,
    }


def show(title: str, entry: Entry) -> None:
    """One line to the terminal."""
    figures = {k: f"{v:.4g}" if isinstance(v, float) else v for k, v in entry.items()}
    print(f"  {title}", *(f"{k}={v}" for k, v in figures.items() if not isinstance(v, dict)))
    sys.stdout.flush()


class RayCaster:
    """Embree's rays against the triangles: light of cells from random directions of the sky.

    Directions of a Kronecker sequence, weighed by the cosine; radiance is interpolated between the
    corners of the triangle that a ray meets.
    """

    def __init__(self, terrain: adret.Terrain, *, rising: bool = False) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        n, m = terrain.shape
        i, j = np.mgrid[0:n, 0:m]
        dx, dy = terrain.cell_size
        corners = np.stack([j * dx, -i * dy, terrain.heights], axis=-1).reshape(-1, 3) / dx
        nw = (i * m + j)[:-1, :-1].ravel()
        ne, sw, se = nw + 1, nw + m, nw + m + 1
        faces = [(nw, sw, ne), (ne, sw, se)] if rising else [(nw, sw, se), (nw, se, ne)]
        self._faces = np.concatenate([np.stack(face, axis=-1) for face in faces])
        self._corners = corners
        self._normals = adret.surface_normals(terrain).reshape(3, -1).T.astype(np.float64)
        self._columns = m
        self._scene = EmbreeScene(robust=True)
        TriangleMesh(self._scene, corners[self._faces].astype(np.float32))

    def __call__(
        self, radiance: NDArray[Any], row: NDArray[Any], column: NDArray[Any], rays: int
    ) -> Array:
        """Irradiance (cells, bands) from radiance (rows, columns, bands)."""
        sent = radiance.reshape(self._faces.max() + 1, -1).astype(np.float64)
        k = np.arange(rays)
        u, azimuth = (k * 0.7548776662466927) % 1.0, (k * 0.5698402909980532) % 1.0 * 2.0 * np.pi
        flat = np.stack(
            [np.sqrt(u) * np.cos(azimuth), np.sqrt(u) * np.sin(azimuth), np.sqrt(1.0 - u)], axis=-1
        )
        out = np.empty((len(row), sent.shape[1]))
        at = row * self._columns + column
        batch = max(1, RAYS_AT_ONCE // rays)
        for first in range(0, len(at), batch):
            up = self._normals[at[first : first + batch]]
            side = np.cross(up, [0.0, 1.0, 0.0])
            side /= np.linalg.norm(side, axis=1, keepdims=True)
            frames = np.stack([side, np.cross(up, side), up], axis=1)
            towards = (flat @ frames).reshape(-1, 3)
            start = self._corners[at[first : first + batch]] + path_tracer.LIFT * up
            met = self._scene.run(
                np.repeat(start, rays, axis=0).astype(np.float32),
                towards.astype(np.float32),
                query="INTERSECT",
                output=1,
            )
            hit = met["primID"] >= 0
            face = self._faces[met["primID"][hit]]
            v, w = met["u"][hit, None], met["v"][hit, None]
            light = np.zeros((len(hit), sent.shape[1]))
            light[hit] = (
                (1.0 - v - w) * sent[face[:, 0]] + v * sent[face[:, 1]] + w * sent[face[:, 2]]
            )
            out[first : first + batch] = np.pi * light.reshape(len(up), rays, -1).mean(axis=1)
        return out


def rasters(side: int) -> list[tuple[str, adret.Terrain]]:
    """Crops that the tools are compared on."""
    window = ((100, 100 + side), (100, 100 + side))
    folder = Path(os.environ.get("ADRET_DATA", REPOSITORY.parent / "shared" / "data")) / "dem"
    paths = {
        "Jacksboro, 79 x 93 m": JACKSBORO,
        "Big Tujunga, 30 m": folder / "alpine_bigtujunga_srtm1_utm11_30m.tif",
        "Aletsch, 200 m": ALETSCH,
    }
    return [
        (name, adret.Terrain.open(path, window=window))
        for name, path in paths.items()
        if path.is_file()
    ]


def no_embree() -> str | None:
    """Why Embree cannot run here, or None."""
    found = importlib.util.find_spec("embreex")
    return None if found else "embreex is not installed (pip install embreex)"


def one_gather(terrain: adret.Terrain, cells: int, rays: int) -> Entry:
    """One bounce from the same radiance of every cell: Adret, and rays cast by Embree."""
    sky = adret.Environment.open(SKY)
    radiance = adret.direct_light(terrain, sky).radiance(ALBEDO)
    row, column = np.random.default_rng(1).integers(1, terrain.shape[0] - 1, (2, cells))
    caster = RayCaster(terrain)
    truth = caster(radiance, row, column, rays)
    other = RayCaster(terrain, rising=True)(radiance, row, column, rays)
    entries = []
    for directions in (8, 16, 32, 64, 128):
        light, cpu = timed(
            lambda directions=directions: adret.indirect_light(
                terrain, None, ALBEDO, radiance=radiance, directions=directions
            )
        )
        entry = {"tool": "adret", "directions": directions, "us": cpu * 1e6 / terrain.mask.size}
        entries.append(entry | off(light.irradiance[row, column], truth))
        show("gather", entries[-1])
    for count in (64, 256, 1024, 4096):
        light, cpu = timed(lambda count=count: caster(radiance, row, column, count))
        entry = {"tool": "embreex", "rays": count, "us": cpu * 1e6 / cells}
        entries.append(entry | off(light, truth))
        show("gather", entries[-1])
    return {"entries": entries, "other_diagonal": off(other, truth), "rays": rays, "cells": cells}


def paths(terrain: adret.Terrain, cells: int, samples: int, depths: Sequence[int]) -> list[Entry]:
    """All indirect light under the sky: Adret, and Mitsuba's path tracer."""
    sky = adret.Environment.open(SKY)
    row, column = np.random.default_rng(1).integers(1, terrain.shape[0] - 1, (2, cells))
    normals = adret.surface_normals(terrain)
    tracer = path_tracer.PathTracer(
        terrain.heights, terrain.cell_size, normals, sky.radiance, ALBEDO, row, column
    )
    entries = []
    for depth in depths:
        halves, traced = timed(
            lambda depth=depth: [tracer.indirect(depth, samples, seed) for seed in (1, 2)]
        )
        mean = (halves[0] + halves[1]) / 2.0
        noise = off(halves[0], halves[1])["mean"] / 2.0
        for directions in (16, 64):
            light, cpu = timed(
                lambda depth=depth, directions=directions: adret.indirect_light(
                    terrain, sky, ALBEDO, bounces=depth - 1, directions=directions
                )
            )
            error = off(light.irradiance[row, column], mean)
            entries.append(
                {
                    "depth": depth,
                    "directions": directions,
                    "us": cpu * 1e6 / terrain.mask.size,
                    "mitsuba_us": traced * 1e6 / cells,
                    "paths": 2 * samples,
                    "noise": noise,
                    "beyond_noise": float(np.sqrt(max(error["mean"] ** 2 - noise**2, 0.0))),
                    **error,
                }
            )
            show("mitsuba", entries[-1])
    return entries


def tools(quick: bool) -> Entry:
    """Every tool on every crop."""
    cells, side = (60, 60) if quick else (300, 120)
    missing = {"embreex": no_embree(), "mitsuba": path_tracer.missing()}
    found: Entry = {
        "sky": SKY.name,
        "left_out": {name: reason for name, reason in missing.items() if reason},
        "versions": {
            n: importlib.metadata.version(n) for n, reason in missing.items() if not reason
        },
        "rasters": [],
    }
    for name, reason in found["left_out"].items():
        print(f"  {name}: left out, {reason}", flush=True)
    for name, terrain in rasters(side):
        print(f"{name}, {side} x {side}", flush=True)
        entry: Entry = {"name": name, "side": side, "cells": cells}
        if missing["embreex"] is None:
            entry["gather"] = one_gather(terrain, cells, 2048 if quick else 16384)
        if missing["mitsuba"] is None:
            depths = (2,) if name.startswith("Aletsch") else (2, 3, 5)
            entry["paths"] = paths(terrain, cells, 500 if quick else 7000, depths)
        found["rasters"].append(entry)
    return found
