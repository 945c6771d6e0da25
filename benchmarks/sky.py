"""Sky view and shadows: run time against error for every method, knob and tool that is here.

    python benchmarks/sky.py

Truth: horizons by every crossing of a cell's own ray (`horizon_at`), towards 720 azimuths for the
sky views of random cells, towards the sun for the shadows of all cells that face it. Formulas of
the views are written here once more, in float64. Prior work is run as well: the march of each
cell, the sweep of P1 as published, and a march over a pyramid of heights. Times are CPU seconds of
all threads, the least of a few. Writes results/sky.json, results/sky.md and results/sky.png.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, get_args

os.environ.setdefault("NUMBA_NUM_THREADS", str(min(2, os.cpu_count() or 1)))

import numpy as np
import present
import sky_peers
import sky_present
from horizon import data_dir, sampled, write
from numpy.typing import NDArray
from pyramid import levels_of, pyramid_slopes

import adret
from adret.horizon import NEAR_DEFAULT
from adret.horizon_options import Method

RESULTS = Path(__file__).parent / "results"
EXAMPLE = Path(__file__).parents[1] / "examples" / "data" / "alpine_aletsch_dhm200_lv95_200m.tif"
TRUE_AZIMUTHS = 720
DIRECTIONS = 32
COUNTS = (4, 8, 16, 32, 64, 128)
NEARS = (0, 4, 8, 16, 32, 64, 128)
SPANS = (4, 16, 64)
COARSER = (1, 3, 9)
VIEWS = ("visible", "horizontal", "normal")
SUNS = ((250.3, 12.0), (130.0, 25.0), (305.0, 8.0))
MARGIN = 100  # RVT mirrors the raster at its edge: cells nearer to it are not compared
REPEATS = 3
Entry = dict[str, Any]
Array = NDArray[np.float64]
Views = dict[str, Array]


def views_of(horizon: Array, azimuths: Array, normals: Array) -> Views:
    """The three sky views of cells from horizons (K, cells) [radians] and normals (cells, 3)."""
    h = np.maximum(horizon, 0.0)
    east, north, up = normals.T
    along = np.sin(azimuths)[:, None] * east + np.cos(azimuths)[:, None] * north
    e = np.maximum(h, np.arctan2(-along, up))
    tilted = along * (np.pi / 2 - e - 0.5 * np.sin(2 * e)) + up * np.cos(e) ** 2
    found = {"visible": 1 - np.sin(h), "horizontal": np.cos(h) ** 2, "normal": tilted}
    return {name: np.mean(each, axis=0, dtype=np.float64) for name, each in found.items()}


def gap(found: Any, truth: Any) -> Entry:
    """Errors of a sky view [-]."""
    off = np.asarray(found, np.float64) - truth
    size = np.abs(off)
    return {
        "mean": float(np.nanmean(size)),
        "p99": float(np.nanquantile(size, 0.99)),
        "max": float(np.nanmax(size)),
        "bias": float(np.nanmean(off)),
    }


def timed(work: Callable[[], Any], repeats: int = REPEATS) -> tuple[float, Any]:
    """Least CPU seconds, and the result."""
    spent, found = [], None
    for _ in range(repeats):
        start = time.process_time()
        found = work()
        spent.append(time.process_time() - start)
    return min(spent), found


class Cells:
    """Random cells of a terrain, and their true sky views."""

    def __init__(self, terrain: adret.Terrain, count: int) -> None:
        self.terrain = terrain
        self.rows, self.columns = sampled(terrain, count)
        self.azimuths = adret.azimuth_set(TRUE_AZIMUTHS)
        at = (self.rows, self.columns)
        self.horizons = np.asarray(adret.horizon_at(terrain, *at, azimuths=self.azimuths), float)
        self.normals = normals_at(terrain, at)
        self.views = views_of(self.horizons, self.azimuths, self.normals)
        height, width = terrain.shape
        self.inner = (np.minimum(self.rows, height - 1 - self.rows) >= MARGIN) & (
            np.minimum(self.columns, width - 1 - self.columns) >= MARGIN
        )

    def of(self, layer: Any) -> Array:
        return np.asarray(layer, np.float64)[self.rows, self.columns]


def normals_at(terrain: adret.Terrain, at: tuple[Any, Any]) -> Array:
    """Normals of cells (cells, 3)."""
    return np.asarray(adret.surface_normals(terrain), np.float64)[:, at[0], at[1]].T


def own_views(cells: Cells) -> list[Entry]:
    """Every method and knob of ours, and the prior work, on two of the views."""
    terrain = cells.terrain
    runs: list[tuple[str, str, int, dict[str, Any]]] = [
        *(("sweep, azimuths", f"K={k}", k, {}) for k in COUNTS),
        *(("sweep, near", f"near={n}", DIRECTIONS, {"near": n}) for n in NEARS),
        ("hull (P1 as published)", "", DIRECTIONS, {"method": "hull"}),
        ("march", "", DIRECTIONS, {"method": "march"}),
    ]
    found = []
    for series, knob, count, options in runs:
        for view in ("visible", "normal"):

            def work(view: Any = view, count: int = count, options: Any = options) -> Any:
                return adret.sky_view_factor(terrain, view, count, **options)

            adret.sky_view_factor(terrain, view, 2, **options)
            spent, layer = timed(work)
            found.append(entry(series, knob, view, count, spent, terrain, layer, cells))
    levels = levels_of(terrain.heights)
    azimuths = adret.azimuth_set(DIRECTIONS)
    pyramid_slopes(levels, terrain.cell_size, 0.0, 4)
    at = (cells.rows, cells.columns)
    for span in SPANS:

        def march(span: int = span) -> Any:
            layers = (pyramid_slopes(levels, terrain.cell_size, a, span)[at] for a in azimuths)
            return np.arctan(np.stack(list(layers)))

        spent, horizons = timed(march, 1)
        for view in ("visible", "normal"):
            value = views_of(horizons, azimuths, cells.normals)[view]
            knob = f"{span} an octave"
            one = entry("pyramid", knob, view, DIRECTIONS, spent, terrain, None, cells, value)
            found.append(one)
    return found


def entry(
    series: str,
    knob: str,
    view: str,
    count: int,
    spent: float,
    terrain: adret.Terrain,
    layer: Any,
    cells: Cells,
    values: Any = None,
    inner: bool = False,
) -> Entry:
    """One line of a table; shown."""
    values = cells.of(layer) if values is None else values
    where = cells.inner if inner else slice(None)
    made = {
        "series": series,
        "knob": knob,
        "view": view,
        "azimuths": count,
        "us_a_cell": spent / terrain.heights.size * 1e6,
        **gap(values[where], cells.views[view][where]),
    }
    print(
        f"  {series:32s} {knob:14s} {view:10s} {made['us_a_cell']:10.3f} us {made['mean']:.5f}",
        flush=True,
    )
    return made


def peer(name: str, needs: str, dem: Path, folder: str) -> Any:
    """What another tool found, or why not."""
    reason = sky_peers.missing(needs)
    if reason:
        return reason
    out = f"{folder}/peer.npz"
    suns = ";".join(f"{a},{e}" for a, e in SUNS)
    command = [sys.executable, sky_peers.__file__, name, str(dem), out, str(DIRECTIONS), suns]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        return "failed: " + " ".join(done.stderr.strip().splitlines()[-1:])
    with np.load(out) as file:
        return {key: file[key] for key in file.files}


def found_by(
    tools: dict[str, Any], dem: Path, folder: str, left_out: list[Entry]
) -> Iterator[tuple[str, Any]]:
    """Name and result of each tool that is here; the others go to `left_out`, with the reason."""
    for name, (needs, _) in tools.items():
        result = peer(name, needs, dem, folder)
        if isinstance(result, str):
            print(f"  {name}: left out, {result}", flush=True)
            left_out.append({"series": name, "left_out": result})
        else:
            yield name, result


def peer_views(cells: Cells, dem: Path, folder: str) -> list[Entry]:
    """Other tools' sky views; one that tells no definition is held against the nearest of ours."""
    found = []
    for name, result in found_by(sky_peers.SKY, dem, folder, found):
        for said, layer in zip(result["views"], result["sky"], strict=True):
            values = cells.of(layer)
            view = str(said)
            if view not in VIEWS:
                view = min(VIEWS, key=lambda v: gap(values, cells.views[v])["mean"])
            count = int(result.get("azimuths", DIRECTIONS))
            spent = float(result["cpu_seconds"])
            terrain = cells.terrain
            inner = name.startswith("RVT")
            one = entry(name, "", view, count, spent, terrain, None, cells, values, inner)
            found.append(one | {"version": str(result["version"])})
    return found


def shades(terrain: adret.Terrain, dem: Path, folder: str) -> list[Entry]:
    """Cast shadows of cells that face the sun: share of wrong verdicts, time a cell and sun."""
    east, north, up = np.asarray(adret.surface_normals(terrain), np.float64)
    truth, facing, height = [], [], []
    for azimuth, elevation in SUNS:
        a, e = np.radians([azimuth, elevation])
        exact = adret.horizon_map(terrain, azimuths=[a], method="exact").elevation[0]
        truth.append(exact >= e)
        height.append(np.abs(np.maximum(exact, 0.0) - e))
        facing.append(up * np.tan(e) + east * np.sin(a) + north * np.cos(a) > 0.0)
    levels = levels_of(terrain.heights)

    def verdicts(series: str, knob: str, spent: float, shade: Any, **more: Any) -> Entry:
        wrong = [(np.asarray(s) != t) & f for s, t, f in zip(shade, truth, facing, strict=False)]
        off = np.concatenate([h[w] for h, w in zip(height, wrong, strict=False)])
        made = {
            "series": series,
            "knob": knob,
            "ns_a_cell": spent / len(wrong) / terrain.heights.size * 1e9,
            "wrong": float(sum(w.sum() for w in wrong))
            / float(sum(f.sum() for f in facing[: len(wrong)])),
            "off_deg": float(np.degrees(off.max())) if off.size else 0.0,
            "suns": len(wrong),
            **more,
        }
        print(
            f"  {series:32s} {knob:14s} {made['ns_a_cell']:10.1f} ns {made['wrong']:.6f}",
            flush=True,
        )
        return made

    def ours(**options: Any) -> tuple[float, list[Any]]:
        def work() -> Any:
            return [adret.shadow(terrain, adret.Sun(a, e), **options).code == 2 for a, e in SUNS]

        work()
        return timed(work)

    found = [verdicts("sweep, near", f"near={n}", *ours(near=n)) for n in NEARS]
    for method, series in (("hull", "hull (P1 as published)"), ("march", "march")):
        assert method in get_args(Method)
        found.append(verdicts(series, "", *ours(method=method)))
    found.append(verdicts("exact", "", *ours(method="exact")))
    for span in SPANS:

        def march(span: int = span) -> Any:
            return [
                np.arctan(pyramid_slopes(levels, terrain.cell_size, np.radians(a), span))
                >= np.radians(e)
                for a, e in SUNS
            ]

        found.append(verdicts("pyramid", f"{span} an octave", *timed(march, 1)))
    for name, result in found_by(sky_peers.SHADE, dem, folder, found):
        spent, version = float(result["cpu_seconds"]), str(result["version"])
        found.append(verdicts(name, "", spent, result["shade"], version=version))
    return found


def by_azimuths(cells: Cells) -> list[Entry]:
    """What the number of azimuths alone costs: exact horizons, fewer of them."""
    found = []
    for count in (4, 8, 16, 24, 36, 72, 144):
        step = TRUE_AZIMUTHS // count
        some = slice(0, None, step)
        fewer = views_of(cells.horizons[some], cells.azimuths[some], cells.normals)
        found.append({"azimuths": count, **{v: gap(fewer[v], cells.views[v]) for v in VIEWS}})
    return found


def by_resolution(terrain: adret.Terrain, count: int) -> list[Entry]:
    """Coarser rasters: the method's error on them, and that of the coarser ground itself."""
    rng = np.random.default_rng(5)
    widest = max(COARSER)
    rows, columns = (n // widest * widest for n in terrain.shape)
    part = terrain.window((0, rows), (0, columns))
    heights = np.asarray(part.elevations(), float)
    picked = rng.choice(rows // widest * (columns // widest), count, replace=False)
    coarse_row, coarse_column = np.divmod(picked, columns // widest)
    azimuths = adret.azimuth_set(DIRECTIONS)
    finest: Views | None = None
    found = []
    for factor in COARSER:
        shape = (rows // factor, factor, columns // factor, factor)
        dx, dy = part.cell_size
        ground = adret.Terrain(heights.reshape(shape).mean((1, 3)), (dx * factor, dy * factor))
        # Odd factors: the middle of the widest cell is a cell's centre at every resolution.
        each = widest // factor
        at = (coarse_row * each + each // 2, coarse_column * each + each // 2)
        truth = np.degrees(adret.horizon_at(ground, *at, azimuths=azimuths))
        swept = np.degrees(adret.horizon_map(ground, azimuths=azimuths).elevation[:, at[0], at[1]])
        there = truth > -89.99
        normals = normals_at(ground, at)
        exact = views_of(np.radians(truth), azimuths, normals)
        sweep = views_of(np.radians(swept), azimuths, normals)
        finest = finest or exact
        found.append(
            {
                "cell_m": dx * factor,
                "shape": [rows // factor, columns // factor],
                "horizon_deg": float(np.mean(np.abs(swept - truth)[there])),
                "method": {v: gap(sweep[v], exact[v])["mean"] for v in VIEWS},
                "ground": {v: gap(exact[v], finest[v])["mean"] for v in VIEWS},
            }
        )
        print(f"  {found[-1]}", flush=True)
    return found


def main() -> None:
    """Measure, write, print where."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=2500, help="random cells compared")
    parser.add_argument("--side", type=int, default=300, help="cells on a side of the raster")
    parser.add_argument("--no-peers", action="store_true")
    parser.add_argument("--out", type=Path, default=RESULTS)
    options = parser.parse_args()
    if options.no_peers:
        sky_peers.SKY.clear()
        sky_peers.SHADE.clear()
    data = data_dir()
    if data:
        whole = adret.Terrain.open(data / "dem" / "alpine_bigtujunga_srtm1_utm11_30m.tif")
        name, corner = "Big Tujunga, 30 m", (150, 400)
    else:
        whole, name, corner = adret.Terrain.open(EXAMPLE), "Aletsch, 200 m", (0, 0)
    side = min(options.side, *whole.shape)
    terrain = whole.window((corner[0], corner[0] + side), (corner[1], corner[1] + side))
    print(f"{name}: {terrain.shape[1]} x {terrain.shape[0]} cells")
    results: Entry = {"about": present.about(), "default_near": NEAR_DEFAULT}
    results |= {"raster": name, "shape": terrain.shape, "cells": options.cells, "suns": SUNS}
    cells = Cells(terrain, options.cells)
    with tempfile.TemporaryDirectory() as folder:
        dem = Path(folder) / "dem.tif"
        write(terrain, dem)
        results["views"] = own_views(cells) + peer_views(cells, dem, folder)
        results["shadows"] = shades(terrain, dem, folder)
    results["azimuths"] = by_azimuths(cells)
    results["resolution"] = by_resolution(whole, min(options.cells, 1000))
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "sky.json").write_text(json.dumps(results, indent=1) + "\n")
    (options.out / "sky.md").write_text(sky_present.table(results))
    sky_present.plot(results, options.out / "sky.png")
    print(f"written: {options.out}/sky.json, sky.md, sky.png")


if __name__ == "__main__":
    main()
