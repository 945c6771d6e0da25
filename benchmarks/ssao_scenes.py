"""Depth buffers for the ledger of screen-space occlusion: real ones, and two that are made here.

A `Case` is a buffer with its scales of length, and the pixels at which errors are taken, in three
strata: near the frame's edge, within some pixels of a depth edge, and the interior.
"""

import hashlib
import math
import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from adret import Camera, DepthBuffer

REPOSITORY = Path(__file__).resolve().parents[1]
REAL = (
    "sponza_atrium",
    "living_room_scan",
    "trees_and_chains",
    "bust_ground",
    "tokyo_street",
    "stereo_middlebury_motorcycle",
)
CREDITS = {
    "sponza_atrium": "Crytek Sponza (c) 2010 Frank Meinl, Crytek (CC BY 3.0)",
    "living_room_scan": "Meta Platforms (MIT)",
    "trees_and_chains": "ez-tree (MIT)",
    "bust_ground": "Infinite 3D Head Scan by Lee Perry-Smith (CC BY 3.0); Spot by K. Crane (CC0)",
    "tokyo_street": "Littlest Tokyo by Glen Fox (CC BY 4.0)",
    "stereo_middlebury_motorcycle": "D. Scharstein, Middlebury 2014 (CC0)",
}
EDGE_PIXELS = 8
BORDER_PIXELS = 32
STRATA = ("interior", "depth edge", "frame edge")
RADIUS_SHARE = 1.0 / 9.0
"""The radius of a case is this share of its frame's height, at its median depth."""


@dataclass(frozen=True)
class Case:
    """A buffer with the lengths and the pixels of its ledger."""

    name: str
    buffer: DepthBuffer
    pixels: int
    seed: int = 0
    rows: int | None = None
    """Rows in the middle of the frame that methods are run and judged on; None for all of them."""

    @cached_property
    def pixel_size(self) -> float:
        """Width of a pixel at the median depth [view units]."""
        ax = self.buffer.camera.rays[0]
        if not self.buffer.camera.perspective_divide:
            return ax
        return ax * float(np.nanmedian(self.buffer.depth))

    @cached_property
    def radius(self) -> float:
        """Radius for methods that need one [view units], rounded to two digits."""
        row0, row1, _, _ = self.buffer.frame
        return _rounded(RADIUS_SHARE * (row1 - row0) * self.pixel_size)

    @cached_property
    def thickness(self) -> float:
        """Thickness of G_t [view units]: a quarter of the radius."""
        return _rounded(0.25 * self.radius)

    @cached_property
    def timonen(self) -> float:
        """The r of r/(r + d²) [view units squared]: 1/2 at a quarter of the radius."""
        return _rounded((0.25 * self.radius) ** 2)

    @cached_property
    def strata(self) -> NDArray[np.int64]:
        """Stratum of every pixel of the frame, an index into STRATA; -1 at sky and holes."""
        row0, row1, column0, column1 = self.buffer.frame
        stratum = np.where(depth_edges(self.buffer), 1, 0)[row0:row1, column0:column1]
        border = np.ones(stratum.shape, dtype=bool)
        border[BORDER_PIXELS:-BORDER_PIXELS, BORDER_PIXELS:-BORDER_PIXELS] = False
        stratum[border] = 2
        stratum[np.isnan(self.buffer.depth[row0:row1, column0:column1])] = -1
        return stratum

    @cached_property
    def sample(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Rows and columns, in the frame, of random receivers."""
        rows, columns = np.nonzero(self.strata >= 0)
        rng = np.random.default_rng(self.seed)
        chosen = np.sort(rng.permutation(len(rows))[: self.pixels])
        return rows[chosen], columns[chosen]

    @cached_property
    def part(self) -> NDArray[np.bool_]:
        """Which of the sampled pixels are judged."""
        row0, row1, _, _ = self.frame
        above = row0 - self.buffer.frame[0]
        rows = self.sample[0]
        return (rows >= above) & (rows < above + row1 - row0)

    @property
    def frame(self) -> tuple[int, int, int, int]:
        """row0, row1, column0, column1 of what methods are run on."""
        row0, row1, column0, column1 = self.buffer.frame
        spare = 0 if self.rows is None else max(row1 - row0 - self.rows, 0)
        return row0 + spare // 2, row1 - (spare - spare // 2), column0, column1

    @cached_property
    def shown(self) -> DepthBuffer:
        """The buffer with that frame."""
        if self.rows is None:
            return self.buffer
        height, width = self.buffer.shape
        row0, row1, column0, column1 = self.frame
        return DepthBuffer(
            np.where(np.isnan(self.buffer.depth), np.inf, self.buffer.depth),
            self.buffer.camera,
            guard_band=(row0, width - column1, height - row1, column0),
            normals=self.buffer.field.normal,
        )

    def at_judged(self, image: NDArray[np.float32]) -> NDArray[np.float64]:
        """Values of a result at the judged pixels."""
        rows, columns = self.sample
        above = self.frame[0] - self.buffer.frame[0]
        found: NDArray[np.float64] = image[rows[self.part] - above, columns[self.part]].astype(
            np.float64
        )
        return found

    @cached_property
    def digest(self) -> str:
        """Digest of the buffer and of the pixels (12 hex digits)."""
        found = hashlib.sha256(self.buffer.depth.tobytes())
        found.update(self.buffer.field.normal.tobytes())
        found.update(repr((self.buffer.camera, self.buffer.frame)).encode())
        for axis in self.sample:
            found.update(axis.tobytes())
        return found.hexdigest()[:12]


def _rounded(value: float) -> float:
    digits = 1 - math.floor(math.log10(value))
    return round(value, digits)


def depth_edges(buffer: DepthBuffer) -> NDArray[np.bool_]:
    """Pixels within EDGE_PIXELS (a square) of a step in depth, of sky or of a hole.

    A step is where 1/z (or z) departs from a straight line over three pixels by more than 1 %.
    """
    z = buffer.depth.astype(np.float64)
    w = 1.0 / z if buffer.camera.perspective_divide else z
    scale = np.abs(w) if buffer.camera.perspective_divide else np.full_like(w, np.nanmedian(w))
    edge = np.isnan(w)
    with np.errstate(invalid="ignore"):
        bend = np.abs(w[:, 2:] - 2.0 * w[:, 1:-1] + w[:, :-2]) > 0.01 * scale[:, 1:-1]
        edge[:, 1:-1] |= bend
        bend = np.abs(w[2:] - 2.0 * w[1:-1] + w[:-2]) > 0.01 * scale[1:-1]
        edge[1:-1] |= bend
    for axis in (0, 1):
        count = np.cumsum(np.insert(edge.astype(np.int64), 0, 0, axis=axis), axis=axis)
        size = edge.shape[axis]
        low = np.maximum(np.arange(size) - EDGE_PIXELS, 0)
        high = np.minimum(np.arange(size) + EDGE_PIXELS + 1, size)
        edge = count.take(high, axis=axis) > count.take(low, axis=axis)
    return edge


def data_dir() -> Path | None:
    """Folder of real depth buffers: that of $ADRET_DATA, else ../shared/data; else None."""
    folder = Path(os.environ.get("ADRET_DATA", REPOSITORY.parent / "shared" / "data")) / "depth"
    return folder if folder.is_dir() else None


def real_case(name: str, pixels: int) -> Case | None:
    """A real buffer with its camera; None where the data are not here."""
    folder = data_dir()
    if folder is None or not (folder / f"{name}.json").is_file():
        return None
    camera = folder / f"{name}.json"
    file = next(p for p in sorted(folder.glob(f"{name}.*")) if p.suffix != ".json")
    options = {} if "guard" in camera.read_text() else {"guard_band": 0}
    buffer = DepthBuffer.open(file, camera, **options)
    if not any(buffer.guard_band):  # a sensor's image has none: its own border becomes one
        band = min(buffer.shape) // 12
        buffer = DepthBuffer.open(file, camera, guard_band=band)
    return Case(name, buffer, pixels)


# --- Made scenes -----------------------------------------------------------------------------


def _first(t: NDArray[np.float64], best: NDArray[np.float64]) -> None:
    np.minimum(best, np.where(t > 0.0, t, np.inf), out=best)


def _cast(
    origin: NDArray[np.float64], ray: NDArray[np.float64], seed: int, count: int
) -> NDArray[np.float64]:
    """Distance to a floor with boxes and balls on it; z is up."""
    rng = np.random.default_rng(seed)
    best = np.full(ray.shape[1:], np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        _first(-origin[2] / ray[2], best)
        for _ in range(count):
            x, y = rng.uniform(-9.0, 9.0, 2)
            if rng.random() < 0.5:
                half = rng.uniform(0.15, 1.1, 2)
                low = np.array([x - half[0], y - half[1], 0.0])
                high = np.array([x + half[0], y + half[1], rng.uniform(0.2, 2.5)])
                near = np.full(best.shape, -np.inf)
                far = np.full(best.shape, np.inf)
                for k in range(3):
                    one, two = (low[k] - origin[k]) / ray[k], (high[k] - origin[k]) / ray[k]
                    near = np.maximum(near, np.minimum(one, two))
                    far = np.minimum(far, np.maximum(one, two))
                _first(np.where(near < far, near, np.inf), best)
            else:
                size = rng.uniform(0.2, 0.9)
                middle = np.array([x, y, rng.uniform(0.4, 1.0) * size])
                a = b = c = 0.0
                for k in range(3):
                    away = origin[k] - middle[k]
                    a, b, c = a + ray[k] * ray[k], b + ray[k] * away, c + away * away
                square = b * b - a * (c - size * size)
                _first(np.where(square > 0.0, (-b - np.sqrt(square)) / a, np.inf), best)
    return best


def made(
    projection: str, width: int, height: int, guard_band: int = 0, seed: int = 3, count: int = 48
) -> DepthBuffer:
    """Boxes and balls on a floor: seen obliquely in perspective, or from above as a relief."""
    wide, high = width + 2 * guard_band, height + 2 * guard_band
    down = math.radians(35.0)
    back = np.array([0.0, -math.cos(down), math.sin(down)])
    if projection == "perspective":
        focal = 0.5 * height / math.tan(math.radians(25.0))
        camera = Camera.perspective(wide, high, fx=focal)
        up = np.array([0.0, math.sin(down), math.cos(down)])
        eye = 11.0 * back + np.array([0.0, 0.5, 0.3])
    else:
        extent = 12.0 / height
        camera = Camera.orthographic(wide, high, extent=(wide * extent, high * extent))
        back, up = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
        eye = np.array([0.0, 0.0, 10.0])
    right = np.array([1.0, 0.0, 0.0])
    depth = np.empty((high, wide), dtype=np.float32)
    for top in range(0, high, 64):  # in bands, for memory
        rows = np.arange(top, min(top + 64, high))[:, None]
        x, y, _ = camera.position(rows, np.arange(wide)[None, :], 1.0)
        if camera.perspective_divide:
            ray = right[:, None, None] * x + up[:, None, None] * y - back[:, None, None]
            origin = eye[:, None, None]
        else:
            ray = np.broadcast_to(-back[:, None, None], (3, *x.shape))
            origin = eye[:, None, None] + right[:, None, None] * x + up[:, None, None] * y
        depth[top : top + 64] = _cast(np.broadcast_to(origin, ray.shape), ray, seed, count)
    return DepthBuffer(depth, camera, guard_band=guard_band)


def made_case(projection: str, width: int, height: int, guard_band: int, pixels: int) -> Case:
    """A made buffer as a case."""
    name = "made blocks" if projection == "perspective" else "made relief"
    return Case(name, made(projection, width, height, guard_band), pixels)
