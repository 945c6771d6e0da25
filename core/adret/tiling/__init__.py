"""Products of rasters larger than memory: cut into tiles, run anywhere, put together again.

The only part of Adret that knows that a raster can be cut. A tile sees its own cells and those in
range round them (`Terrain.tile`); lines, pools and blocks of the sweeps are anchored to the whole
raster's grid, so that tiles are the bytes of the whole at every size and in every order.
"""

from adret.tiling.batches import BatchReport, prepare, run_batch
from adret.tiling.jobs import Job, run_tile
from adret.tiling.plans import Plan, plan
from adret.tiling.surfaces import Surface

__all__ = ["BatchReport", "Job", "Plan", "Surface", "plan", "prepare", "run_batch", "run_tile"]
