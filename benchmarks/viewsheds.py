"""Viewsheds: run time against error, one observer's and those of all cells, with other tools.

    python benchmarks/viewsheds.py [--observers 1] [--pairs 1400] [--out benchmarks/results]

One observer: Adret, GDAL in its four modes, GRASS and Embree, against lines of sight in whole
numbers on random pairs, and against Adret on all cells; outside a band of one cell, that is on
cells whose eight neighbours have the same verdict. All cells: total viewsheds of Adret,
WhiteboxTools and Embree against the areas of exact viewsheds. Times are CPU time of all threads,
the least of three of our own, one run of the others. Real rasters come from $ADRET_DATA or
../shared/data; without them only the example DEM is measured. Tools that are not there are counted
and said.
"""

import argparse
import json
import os
import resource
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

REPOSITORY = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(REPOSITORY / "tests")]

import numpy as np  # noqa: E402
import present  # noqa: E402
import rasterio  # noqa: E402
import ray_casting  # noqa: E402
import total_viewsheds  # noqa: E402
import viewshed_tables  # noqa: E402
from numpy.typing import NDArray  # noqa: E402

import adret  # noqa: E402
import sight_oracle  # noqa: E402
import sight_peers  # noqa: E402

EXAMPLE = REPOSITORY / "examples" / "data" / "alpine_aletsch_dhm200_lv95_200m.tif"
DEMS = (
    "alpine_bigtujunga_srtm1_utm11_30m",
    "lidar_slovenia_tm1_1m",
    "urban_toulouse_mnh_utm31_05m",
)
EYES = (1.625, 30.0)  # whole multiples of 2^-24 m, as the heights are
SCALE = 2.0**24
SIZES = (500, 1000, 2000, 4000)

Mask = NDArray[np.bool_]
Entry = dict[str, Any]
Cell = tuple[int, int]


def rasters() -> list[Path]:
    """Rasters to measure on."""
    folder = Path(os.environ.get("ADRET_DATA", REPOSITORY.parent / "shared" / "data")) / "dem"
    found = [folder / f"{name}.tif" for name in DEMS]
    return [EXAMPLE, *(path for path in found if path.exists())]


def inner(mask: Mask) -> Mask:
    """Cells whose eight neighbours have their own verdict."""
    padded = np.pad(mask, 1, mode="edge")
    same = np.ones_like(mask)
    rows, columns = mask.shape
    for i in range(3):
        for j in range(3):
            same &= padded[i : i + rows, j : j + columns] == mask
    return same


def own(terrain: adret.Terrain, place: Cell, eye: float) -> tuple[Mask, float]:
    """Our viewshed, and the least CPU time of three runs."""
    spent = []
    for _ in range(3):
        start = sight_peers.cpu_seconds()
        seen = adret.viewshed(terrain, place, observer_height=eye).visible
        spent.append(sight_peers.cpu_seconds() - start)
    return seen, min(spent)


# ---------------------------------------------------------------- one observer


class Views:
    """Some observers on one raster, and what each tool sees from there."""

    def __init__(self, dem: Path, observers: int, pairs: int, seed: int) -> None:
        self.dem = dem
        self.terrain = adret.Terrain.open(dem)
        assert not self.terrain.mask.any()
        rng = np.random.default_rng(seed)
        rows, columns = self.terrain.shape
        self.views: list[tuple[Cell, float]] = [
            ((int(rng.integers(9, rows - 9)), int(rng.integers(9, columns - 9))), eye)
            for eye in EYES * observers
        ]
        adret.viewshed(self.terrain, (0, 0), max_distance=min(self.terrain.cell_size) * 3)
        self.own = [own(self.terrain, place, eye) for place, eye in self.views]
        self.pairs = [
            self._pairs(place, eye, seen, pairs, rng)
            for (place, eye), (seen, _) in zip(self.views, self.own, strict=True)
        ]

    def _pairs(
        self, place: Cell, eye: float, seen: Mask, count: int, rng: np.random.Generator
    ) -> tuple[NDArray[np.int64], Mask]:
        """Random targets, half of them seen, and the verdict of exact arithmetic on each."""
        scaled = self.terrain.heights.astype(np.float64) * SCALE
        whole = scaled.astype(np.int64)
        assert (whole == scaled).all()
        aims = np.argwhere(seen)
        targets = np.concatenate(
            [
                np.stack([rng.integers(0, n, count - count // 2) for n in seen.shape], axis=1),
                aims[rng.integers(0, len(aims), count // 2)],
            ]
        )
        targets = targets[(targets != place).any(axis=1)]
        start = int(whole[place] + eye * SCALE)
        verdicts = [
            sight_oracle.seen_in_whole_numbers(whole, place, target, start, int(whole[target]))
            for target in map(tuple, targets.tolist())
        ]
        return targets, np.array(verdicts)

    def judged(self, name: str, masks: list[Mask], seconds: list[float], **more: Any) -> Entry:
        """One tool's errors on the pairs and on all cells, and its mean CPU time."""
        sums = np.zeros(6)
        for seen, (exact, _), (targets, verdict) in zip(masks, self.own, self.pairs, strict=True):
            clear = inner(exact)
            at = tuple(targets.T)
            wrong = seen[at] != verdict
            sums += [
                *(len(wrong), wrong.sum(), clear[at].sum(), wrong[clear[at]].sum()),
                *((seen & ~exact)[clear].mean(), (exact & ~seen)[clear].mean()),
            ]
        views = len(masks)
        entry = {
            "name": name,
            "pairs": int(sums[0]),
            "pairs_wrong": int(sums[1]),
            "pairs_outside": int(sums[2]),
            "pairs_wrong_outside": int(sums[3]),
            "sees_more": sums[4] / views,
            "sees_less": sums[5] / views,
            "least_agreement": min(
                float((seen == exact)[inner(exact)].mean())
                for seen, (exact, _) in zip(masks, self.own, strict=True)
            ),
            "cpu_seconds": float(np.mean(seconds)),
            "ns": float(np.mean(seconds)) / self.terrain.mask.size * 1e9,
            **more,
        }
        print(
            f"  {name:28s} {entry['ns']:7.0f} ns a cell  wrong pairs {entry['pairs_wrong']} of "
            f"{entry['pairs']}, outside the band {entry['pairs_wrong_outside']} of "
            f"{entry['pairs_outside']}; all cells: more {entry['sees_more']:.4%} less "
            f"{entry['sees_less']:.4%}",
            flush=True,
        )
        return entry

    def map_place(self, place: Cell) -> tuple[float, float]:
        """Coordinates of a cell's centre."""
        transform = self.terrain.transform
        assert transform is not None
        return (
            transform.c + transform.a * (place[1] + 0.5),
            transform.f + transform.e * (place[0] + 0.5),
        )

    def tools(self) -> Iterator[Entry]:
        """Every tool that is there, and why the others are not."""
        seen, seconds = zip(*self.own, strict=True)
        yield self.judged("Adret", list(seen), list(seconds))
        if reason := sight_peers.missing("gdal"):
            yield {"name": "GDAL viewshed", "left_out": reason}
        else:
            for mode in ("edge", "diagonal", "max", "min"):
                found = [
                    sight_peers.gdal(self.dem, *self.map_place(place), eye, mode=mode)
                    for place, eye in self.views
                ]
                masks, seconds = zip(*found, strict=True)
                more = self._explained_gdal(masks) if mode == "edge" else {}
                more["version"] = rasterio.__gdal_version__
                yield self.judged(f"GDAL viewshed, {mode}", list(masks), list(seconds), **more)
        if reason := sight_peers.missing("grass"):
            yield {"name": "GRASS r.viewshed", "left_out": reason}
        else:
            views = [(*self.map_place(place), eye, 0.0) for place, eye in self.views]
            masks, seconds = sight_peers.grass(self.dem, views)
            yield self.judged("GRASS r.viewshed", masks, seconds, **self._explained_grass(masks))
        yield from self._rays()

    def _rays(self) -> Iterator[Entry]:
        for triangles in ("two", "four"):
            name = f"Embree, {triangles} triangles"
            if reason := ray_casting.missing():
                yield {"name": name, "left_out": reason}
                continue
            scene = ray_casting.Scene(self.terrain, triangles)
            masks, seconds = zip(*(scene.seen(*view) for view in self.views), strict=True)
            yield self.judged(
                name,
                list(masks),
                list(seconds),
                build_seconds=scene.build_seconds,
                version=ray_casting.version(),
            )

    def _explained_gdal(self, masks: tuple[Mask, ...]) -> Entry:
        """Cells that differ from the exact verdict, and those whose verdict the rule gives."""
        differing = given = 0
        z = self.terrain.elevations()
        for (place, eye), (exact, _), seen in zip(self.views, self.own, masks, strict=True):
            off = seen != exact
            rule = sight_peers.gdal_rule(z, place, z[place] + eye)
            differing += int(off.sum())
            given += int((rule == seen)[off].sum())
        return {"differing": differing, "of_rule": given}

    def _explained_grass(self, masks: list[Mask], most: int = 500) -> Entry:
        """The same for GRASS, on a random choice of the cells that differ."""
        differing = given = 0
        z = self.terrain.elevations()
        rng = np.random.default_rng(5)
        for (place, eye), (exact, _), seen in zip(self.views, self.own, masks, strict=True):
            cells = rng.permutation(np.argwhere(seen != exact))[:most]
            high = float(np.float32(np.float32(z[place]) + np.float32(eye)))
            rule = sight_peers.grass_rule(z, place, map(tuple, cells), high, self.terrain.cell_size)
            differing += len(cells)
            given += int((seen[tuple(cells.T)] == rule).sum())
        return {"differing": differing, "of_rule": given}


def growth() -> list[Entry]:
    """Time of one observer in the middle, by the raster's side: fractal ground."""
    rows = []
    rng = np.random.default_rng(1)
    for side in SIZES:
        spectrum = rng.normal(size=(side, side)) + 1j * rng.normal(size=(side, side))
        frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(side), np.fft.fftfreq(side)))
        frequency[0, 0] = np.inf
        ground = np.fft.ifft2(spectrum / frequency**2.0).real
        terrain = adret.Terrain(300.0 * ground / ground.std(), (30.0, 30.0))
        seen, spent = own(terrain, (side // 2, side // 2), 10.0)
        rows.append({"side": side, "ns": spent / side**2 * 1e9, "seen": float(seen.mean())})
        print(f"  {side:5d} cells a side  {rows[-1]['ns']:6.0f} ns a cell", flush=True)
    return rows


def main() -> None:
    """Measure, write, print where."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--observers", type=int, default=1, help="a raster and eye height")
    parser.add_argument("--pairs", type=int, default=1400, help="an observer")
    parser.add_argument("--out", type=Path, default=REPOSITORY / "benchmarks" / "results")
    options = parser.parse_args()
    start = time.perf_counter()
    results: Entry = {"about": present.about(), "views": []}
    for seed, dem in enumerate(rasters()):
        print(dem.stem, flush=True)
        views = Views(dem, options.observers, options.pairs, seed)
        entries = list(views.tools())
        results["views"].append(
            {
                "raster": dem.stem,
                "shape": list(views.terrain.shape),
                "observers": len(views.views),
                "seen": float(np.mean([seen.mean() for seen, _ in views.own])),
                "entries": entries,
            }
        )
    results["totals"] = [total_viewsheds.compared(dem, eye=20.0) for dem in rasters()[:2]]
    results["growth"] = growth()
    results["seconds"] = time.perf_counter() - start
    ended = sight_peers.cpu_seconds(resource.RUSAGE_CHILDREN)
    results["cpu_seconds"] = sight_peers.cpu_seconds() + ended
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "viewsheds.json").write_text(json.dumps(results, indent=1) + "\n")
    (options.out / "viewsheds.md").write_text(viewshed_tables.table(results))
    viewshed_tables.plot(results, options.out / "viewsheds.png")
    for suffix in ("json", "md", "png"):
        print(options.out / f"viewsheds.{suffix}")


if __name__ == "__main__":
    main()
