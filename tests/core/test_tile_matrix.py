"""Every tile size, worker count, executor, range and product: the bytes of the untiled files."""

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import adret
import raster_files
from adret import products
from adret.tiling import Job, Surface, prepare, run_batch
from adret.tiling.executors import TileExecutor, open_executor

pytestmark = pytest.mark.slow

RASTERS = {
    "voids": "alpine_exploradores_aster_utm18s_30m_voids.tif",
    "geographic": "geo_grenoble_copdem_epsg4326_decimated.tif",
    "lunar": "moon_gld100_eqc_118m_4096.tif",
}
SHAPE = (230, 250)
SIZES = (32, 50, 64, 100, 128, 229)
RANGES = (None, 2500.0)
CHOSEN: dict[str, dict[str, Any]] = {
    "horizon": {"directions": 6},
    "sky-view": {"directions": 36, "kind": "normal", "curvature": True},
    "openness": {"directions": 6, "sign": -1},
    "shadow": {"sun_deg": (250.0, 12.0)},
    "light": {"directions": 6, "sky": "overcast", "sun_deg": (250.0, 12.0)},
}
RUNNERS = [(name, workers) for name in ("local", "dask") for workers in (1, 2, 3)]


@pytest.fixture(scope="module", params=RUNNERS, ids=lambda each: f"{each[0]}-{each[1]}")
def executor(request: pytest.FixtureRequest) -> Iterator[TileExecutor]:
    """Workers that stay for all rasters and sizes."""
    name, workers = request.param
    if name == "dask":
        pytest.importorskip("distributed", reason="the extra adret[dask] is not here")
    opened = open_executor(name, workers=workers, threads=1, scheduler=None)
    yield opened
    opened.close()


@pytest.fixture(scope="module")
def wanted(data_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[Any, Any]:
    """Parts of the rasters, and digests of the files that the products' own commands write."""
    folder = tmp_path_factory.mktemp("whole")
    found: dict[Any, Any] = {}
    for raster, name in RASTERS.items():
        part = raster_files.crop(data_dir / "dem" / name, folder / f"{raster}.tif", *SHAPE)
        found[raster] = part
        terrain = adret.Terrain.open(part)
        for reach in RANGES:
            for product, parameters in chosen(reach).items():
                out = folder / "whole.tif"
                products.run(products.PRODUCTS[product], terrain, parameters, out)
                found[raster, reach, product] = digest(out)
    return found


def chosen(reach: float | None) -> dict[str, Any]:
    return {
        name: products.PRODUCTS[name].parameters(**given, max_distance=reach)
        for name, given in CHOSEN.items()
    }


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("reach", RANGES)
@pytest.mark.parametrize("raster", list(RASTERS))
def test_five_products_are_the_files_of_their_commands(
    raster: str,
    reach: float | None,
    size: int,
    executor: TileExecutor,
    wanted: dict[Any, Any],
    tmp_path: Path,
) -> None:
    job = Job(Surface.open([wanted[raster]]), chosen(reach), size)
    prepare(job, tmp_path / "out")
    assert not run_batch(job, tmp_path / "out", executor).failed
    for product in CHOSEN:
        assert digest(tmp_path / "out" / f"{product}.tif") == wanted[raster, reach, product]
