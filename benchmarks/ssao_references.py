"""Ray-traced references of the ledger, kept on disk; and the same by Embree, for its time.

A reference costs minutes, so it is kept in benchmarks/references/ (ignored by git) under a digest
of the buffer, the pixels, the options and the code that made it.
"""

import hashlib
import math
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from ssao_scenes import Case

from adret._kernels.jit import source_digest
from adret.screen import make_falloff
from adret.screen.crytek import published_kernel
from adret.screen.falloffs import Falloff
from adret.screen.raytraced import Options, RaySample, trace_several

FOLDER = Path(__file__).resolve().parent / "references"
Entry = dict[str, Any]


def cube_falloff(radius: float) -> Any:
    """1 - (d/R)³, the occlusion that a containment test of volumetric membership stands for."""
    return lambda d: np.maximum(0.0, 1.0 - (np.minimum(d, radius) / radius) ** 3)


def falloffs_of(case: Case) -> dict[str, Any]:
    """The falloffs that rays are cast for together, by name."""
    return {
        "none": make_falloff("none"),
        "hard": make_falloff("hard", case.radius),
        "quadratic": make_falloff("quadratic", case.radius),
        "timonen": make_falloff("timonen", math.inf, case.timonen),
        "cubic": make_falloff(cube_falloff(case.radius), case.radius),
    }


class References:
    """The truth at a case's pixels: looked up, or made and kept."""

    def __init__(self, case: Case, rays: int) -> None:
        self.case = case
        self.rays = rays
        self._passes: dict[tuple[str, bool], dict[str, RaySample]] = {}

    def get(self, weight: str, falloff: str = "none", *, thin: bool = False) -> RaySample:
        """Occlusion by a weight of directions and a falloff, in G_inf or (thin) in G_t."""
        if (weight, thin) not in self._passes:
            self._passes[weight, thin] = self._directions(weight, thin)
        return self._passes[weight, thin][falloff]

    def volumetric(self) -> RaySample:
        """Solid share of the tangent sphere whose diameter is the case's radius."""
        return self._volume("volumetric", "volumetric", (1.0,), self.rays)

    def hemisphere(self) -> RaySample:
        """Solid share of the hemisphere, by the cosine."""
        return self._volume("hemisphere", "hemisphere", (1.0,), self.rays)

    def ball(self, samples: int) -> RaySample:
        """Solid share of the spheres on which Crytek's kernel of `samples` lies."""
        lengths = np.unique(np.linalg.norm(published_kernel(samples), axis=1).round(12))
        return self._volume(f"kernel {samples}", "shell", tuple(lengths.tolist()), 2048)

    def shell(self, inner: float) -> RaySample:
        """Solid share of the shell from `inner` to 1 radius, by ten spheres of equal volume."""
        share = (np.arange(10) + 0.5) / 10.0
        lengths = (inner**3 + share * (1.0 - inner**3)) ** (1.0 / 3.0)
        return self._volume(f"shell {inner:g}", "shell", tuple(lengths.tolist()), 2048)

    def _volume(self, name: str, weight: Any, lengths: tuple[float, ...], points: int) -> RaySample:
        """Mean over spheres whose radii are shares of the case's."""

        def make() -> dict[str, RaySample]:
            found = [
                self._trace(
                    Options(weight=weight, radius=length * self.case.radius, rays=points),
                    [make_falloff("none")],
                )[0]
                for length in lengths
            ]
            halves = np.mean([each.halves for each in found], axis=0)
            known = np.min([each.confidence for each in found], axis=0)
            return {"none": RaySample(halves, known, None, sum(each.rays for each in found))}

        known = (weight, lengths, points, self.case.radius)
        return self._kept(name, "screen.filled_spheres", known, make)["none"]

    def _directions(self, weight: Any, thin: bool) -> dict[str, RaySample]:
        thickness = self.case.thickness if thin else math.inf
        options = Options(weight=weight, rays=self.rays, thickness=thickness)
        falloffs = falloffs_of(self.case)

        def make() -> dict[str, RaySample]:
            return dict(zip(falloffs, self._trace(options, list(falloffs.values())), strict=True))

        known = (asdict(options), tuple(falloffs), self.case.radius, self.case.timonen)
        name = f"{weight} {'thin' if thin else 'endless'}"
        return self._kept(name, "screen.raytraced", known, make)

    def _trace(self, options: Options, falloffs: list[Falloff]) -> list[RaySample]:
        rows, columns = self.case.sample
        row0, _, column0, _ = self.case.buffer.frame
        field = self.case.buffer.field
        return trace_several(field, rows + row0, columns + column0, options, falloffs)

    def _kept(
        self, name: str, module: str, known: Any, make: Callable[[], dict[str, RaySample]]
    ) -> dict[str, RaySample]:
        """What is kept of a pass, or else what `make` gives, then kept."""
        key = hashlib.sha256(repr((self.case.digest, known)).encode())
        key.update(source_digest(module).encode())
        stem = f"{self.case.name}-{name}".replace(" ", "-")
        path = FOLDER / f"{stem}-{key.hexdigest()[:12]}.npz"
        if path.is_file():
            with np.load(path) as kept:
                names = [each for each in kept.files if each not in ("confidence", "rays", "cpu")]
                return self._judged(
                    {
                        each: RaySample(kept[each], kept["confidence"], None, int(kept["rays"]))
                        for each in names
                    }
                )
        start = time.process_time()
        found = make()
        spent = time.process_time() - start
        first = next(iter(found.values()))
        print(
            f"  reference {self.case.name}, {name}: {first.rays} rays, {spent:.0f} s of CPU, "
            f"noise {first.noise:.5f}",
            flush=True,
        )
        FOLDER.mkdir(exist_ok=True)
        np.savez_compressed(
            path,
            confidence=first.confidence,
            rays=first.rays,
            cpu=spent,
            **{each: sample.halves for each, sample in found.items()},  # type: ignore[arg-type]
        )
        return self._judged(found)

    def _judged(self, found: dict[str, RaySample]) -> dict[str, RaySample]:
        part = self.case.part
        return {
            name: RaySample(each.halves[:, part], each.confidence[part], None, each.rays)
            for name, each in found.items()
        }


def embree(case: Case, counts: tuple[int, ...], seed: int = 5) -> list[Entry]:
    """Occlusion (W = 1, cosine) of the case's pixels by Embree on the depth mesh.

    Returns, for each number of rays, the occlusion and the CPU time [s] a pixel: of casting alone,
    and with the making of rays.
    """
    import trimesh
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    field = case.buffer.field
    height, width = field.depth.shape
    places = case.buffer.camera.position(*np.mgrid[0:height, 0:width], field.depth)
    places = places.reshape(3, -1).T
    corner = (np.arange(height - 1)[:, None] * width + np.arange(width - 1)).ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + width, corner + 1], axis=1),
            np.stack([corner + 1, corner + width, corner + width + 1], axis=1),
        ]
    )
    faces = faces[~np.isnan(places[faces, 2]).any(axis=1)]
    mesh = trimesh.Trimesh(np.nan_to_num(places), faces, process=False)
    start = time.process_time()
    intersector = RayMeshIntersector(mesh)
    intersector.intersects_any(np.zeros((1, 3)), np.array([[0.0, 0.0, -1.0]]))
    built = time.process_time() - start
    rng = np.random.default_rng(seed)
    row0, _, column0, _ = case.buffer.frame
    rows, columns = case.sample[0][case.part] + row0, case.sample[1][case.part] + column0
    normal = field.normal[:, rows, columns].astype(np.float64).T
    eye = case.buffer.camera.position(rows, columns, field.depth[rows, columns]).T
    # Embree computes in float32: what is much nearer than this to its own triangle hits it.
    start_points = eye + 1e-2 * case.pixel_size * normal
    helper = np.where(np.abs(normal[:, :1]) > 0.9, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]])
    side = np.cross(normal, helper)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(normal, side)
    found = []
    for count in counts:
        hits = np.zeros(len(rows))
        cast = made = 0.0
        around = max(1, round(math.sqrt(count)))
        strata = max(1, count // around)
        step = max(1, 1_000_000 // (strata * around))
        for first in range(0, len(rows), step):
            part = slice(first, first + step)
            at = time.process_time()
            n = len(rows[part])
            u = (np.arange(strata)[None, :, None] + rng.random((n, strata, around))) / strata
            v = (np.arange(around)[None, None, :] + rng.random((n, strata, around))) / around
            out, up = np.sqrt(u).reshape(n, -1, 1), np.sqrt(1.0 - u).reshape(n, -1, 1)
            angle = 2.0 * np.pi * v.reshape(n, -1, 1)
            ray = out * np.cos(angle) * side[part, None] + up * normal[part, None]
            ray += out * np.sin(angle) * other[part, None]
            ray = ray.reshape(-1, 3)
            begin = np.repeat(start_points[part], strata * around, axis=0)
            middle = time.process_time()
            hit = intersector.intersects_any(begin, ray)
            cast += time.process_time() - middle
            made += middle - at
            hits[part] = hit.reshape(n, -1).mean(axis=1)
        rays = strata * around
        found.append(
            {
                "rays": rays,
                "occlusion": hits,
                "cast_seconds_a_pixel": cast / len(rows),
                "seconds_a_pixel": (cast + made) / len(rows),
                "ns_a_ray": cast / len(rows) / rays * 1e9,
                "build_seconds": built,
            }
        )
    return found


def figures(off: NDArray[np.float64], halves: NDArray[np.float64] | None = None) -> Entry:
    """Error figures of method minus reference.

    `halves` are the differences to the reference's two halves, whose noises have nothing in common:
    the mean of their product is the mean square error without the reference's noise. The other
    figures contain that noise, which can only enlarge e_A.
    """
    size = np.abs(off)
    square = float((off**2).mean() if halves is None else (halves[0] * halves[1]).mean())
    return {
        "pixels": int(off.size),
        "e_A": float(size.mean()),
        "e_5": float((size < 0.05).mean()),
        "rmse": math.sqrt(max(square, 0.0)),
        "max": float(size.max()),
        "bias": float(off.mean()),
        "p99": float(np.quantile(size, 0.99)),
    }
