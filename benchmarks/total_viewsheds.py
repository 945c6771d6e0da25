"""Total viewsheds, the ground that each cell sees: run time against error, with other tools.

Run by `viewsheds.py`. The truth is the area of exact viewsheds from some random cells.
"""

import importlib.metadata
import importlib.util
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
import ray_casting
from numpy.typing import NDArray
from rasterio.windows import Window

import adret

SIDE = 140  # cells of a raster's square window
SAMPLE = 100  # cells whose area is measured by an exact viewshed

Entry = dict[str, Any]


def cut(dem: Path, folder: Path) -> tuple[adret.Terrain, Path]:
    """A square window of a raster, as a file of its own too."""
    with rasterio.open(dem) as source:
        top, left = (source.height - SIDE) // 2, (source.width - SIDE) // 2
        window = Window(left, top, SIDE, SIDE)
        path = folder / f"{dem.stem}.tif"
        with rasterio.open(
            path,
            "w",
            driver="GTiff",
            height=SIDE,
            width=SIDE,
            count=1,
            dtype="float32",
            crs=source.crs,
            transform=source.window_transform(window),
        ) as made:
            made.write(source.read(1, window=window).astype(np.float32), 1)
    return adret.Terrain.open(path), path


def own_totals(terrain: adret.Terrain, eye: float) -> Iterator[Entry]:
    """`total_viewshed` by number of azimuths, and by the crossings of a cell's own ray."""
    choices: list[tuple[int, int | None]] = [(k, None) for k in (8, 16, 32, 64, 128, 256)]
    choices += [(64, near) for near in (0, 8, 32, 128)]
    for directions, near in choices:
        adret.total_viewshed(terrain, 2, observer_height=eye, near=near)
        start = time.process_time()
        area = adret.total_viewshed(terrain, directions, observer_height=eye, near=near)
        yield {
            "name": f"Adret, {directions} azimuths" + ("" if near is None else f", near={near}"),
            "directions": directions,
            "near": near,
            "default_near": near is None,
            "cpu_seconds": time.process_time() - start,
            "area": area,
        }


def whitebox_totals(path: Path, eye: float, square: float) -> Iterator[Entry]:
    """WhiteboxTools `visibility_index`: the share of all cells, of every so many, that see a cell.

    Its stations stand `eye` above their ground and look at the ground of all cells.
    """
    if importlib.util.find_spec("whitebox_workflows") is None:
        yield {"name": "WhiteboxTools", "left_out": "whitebox-workflows is not installed"}
        return
    import whitebox_workflows

    environment = whitebox_workflows.WbEnvironment()
    environment.verbose = False
    raster = environment.read_raster(str(path))
    for factor in (8, 4, 2, 1):
        start = time.process_time()
        share = environment.visibility_index(raster, station_height=eye, resolution_factor=factor)
        spent = time.process_time() - start
        out = path.with_name("share.tif")
        environment.write_raster(share, str(out))
        with rasterio.open(out) as file:
            area = (file.read(1).astype(np.float64) * SIDE * SIDE - 1.0) * square
        yield {
            "name": f"WhiteboxTools, factor {factor}",
            "cpu_seconds": spent,
            "area": area,
            "version": importlib.metadata.version("whitebox-workflows"),
            "passive": True,
        }


def compared(dem: Path, eye: float) -> Entry:
    """Total viewsheds by every tool against the areas of exact viewsheds of some cells."""
    with tempfile.TemporaryDirectory() as folder:
        terrain, path = cut(dem, Path(folder))
        square = terrain.cell_size[0] * terrain.cell_size[1]
        cells = np.random.default_rng(2).integers(0, SIDE, (SAMPLE, 2))
        places = [(int(row), int(column)) for row, column in cells]

        def area(**heights: float) -> NDArray[np.float64]:
            seen = [adret.viewshed(terrain, place, **heights).visible.sum() for place in places]
            return (np.array(seen) - 1) * square

        passive = area(observer_height=0.0, target_height=eye)
        start = time.process_time()
        exact = area(observer_height=eye)
        every = SIDE * SIDE / SAMPLE
        spent = (time.process_time() - start) * every
        found: list[Entry] = [{"name": "Adret, exact viewsheds", "cpu_seconds": spent}]
        found[0]["sampled"] = exact
        found += [*own_totals(terrain, eye), *whitebox_totals(path, eye, square)]
        if reason := ray_casting.missing():
            found.append({"name": "Embree, two triangles", "left_out": reason})
        else:
            for triangles in ("two", "four"):
                scene = ray_casting.Scene(terrain, triangles)
                seen, seconds = zip(*(scene.seen(place, eye) for place in places), strict=True)
                entry = {"name": f"Embree, {triangles} triangles"}
                entry["cpu_seconds"] = scene.build_seconds + sum(seconds) * every
                entry["sampled"] = (np.array([mask.sum() for mask in seen]) - 1) * square
                found.append(entry)
    for entry in found:
        if "left_out" in entry:
            print(f"  {entry['name']}: left out, {entry['left_out']}", flush=True)
            continue
        layer = entry.pop("area", None)
        got = entry.pop("sampled") if layer is None else layer[tuple(cells.T)]
        want = passive if "passive" in entry else exact
        entry["us"] = entry["cpu_seconds"] / SIDE**2 * 1e6
        entry["mean"] = float(np.abs(got - want).mean() / want.mean())
        entry["bias"] = float((got - want).mean() / want.mean())
        entry["largest"] = float(np.abs(got - want).max() / want.mean())
        print(
            f"  {entry['name']:34s} {entry['us']:9.2f} us a cell  error mean {entry['mean']:.2%} "
            f"bias {entry['bias']:+.2%}",
            flush=True,
        )
    return {"raster": dem.stem, "side": SIDE, "sample": SAMPLE, "eye": eye, "entries": found}
