"""Viewsheds tile by tile: every observer in range of a tile looks at it, over what lies between.

The verdict on a target is that of its own line of sight, which never leaves the smallest window
that holds both ends: a halo of the range round the tile.
"""

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from adret.errors import InputError
from adret.parameters import ViewshedParameters
from adret.tiling.tasks import Tile, around, core, halo, tiled_product

if TYPE_CHECKING:
    from adret.grids import RasterGrid
    from adret.products import Result
    from adret.terrain import Terrain
    from adret.tiling.jobs import Job
    from adret.tiling.surfaces import Surface

__all__ = ["check_observers", "observers", "result"]

Cell = tuple[int, int]


def observers(grid: "RasterGrid", parameters: ViewshedParameters) -> list[tuple[str, Cell]]:
    """Cells of the whole raster that look, in the order in which they are numbered.

    Returns
    -------
    list of (str, (int, int))
        The option that named the cell, its row and column.

    Raises
    ------
    InputError
        If one lies outside the raster.
    """
    rows, columns = grid.shape
    found: list[tuple[str, Cell]] = []
    for row, column in parameters.observer or ():
        if row >= rows or column >= columns:
            limit = f"a cell between (0, 0) and ({rows - 1}, {columns - 1})"
            raise InputError("observer", limit, (row, column))
        found.append(("observer", (row, column)))
    for x, y in parameters.at or ():
        if grid.transform is None:
            raise InputError("at", "left out where the raster has no geotransform", (x, y))
        across = (x - grid.transform.c) / grid.transform.a
        down = (y - grid.transform.f) / grid.transform.e
        if not (0.0 <= down < rows and 0.0 <= across < columns):
            raise InputError("at", "inside the raster", (x, y))
        found.append(("at", (math.floor(down), math.floor(across))))
    return found


def check_observers(surface: "Surface", parameters: ViewshedParameters) -> None:
    """Refuse observers that are outside or on nodata.

    Raises
    ------
    InputError
        Naming the first.
    """
    for field, (row, column) in observers(surface.grid, parameters):
        if np.isnan(surface.heights((row, row + 1), (column, column + 1))[0, 0]):
            raise InputError(field, "a cell that is not nodata", (row, column))


def result(job: "Job", parameters: ViewshedParameters, tile: Tile) -> tuple["Result", "Terrain"]:
    """What a tile's file holds: its part of the layers, with the names and tags of the whole."""
    from adret.products import sights

    places = [place for _, place in observers(job.surface.grid, parameters)]
    terrain = job.surface.tile(tile.rows, tile.columns, halo(job, parameters, tile))
    seen = around(terrain)
    first, shape = seen.origin, seen.shape
    local = {
        number: (row - first[0], column - first[1])
        for number, (row, column) in enumerate(places)
        if 0 <= row - first[0] < shape[0] and 0 <= column - first[1] < shape[1]
    }
    found = sights.unseen(terrain, parameters, places)
    if not local:
        return found, terrain
    own = replace(parameters, observer=tuple(local.values()), at=None)
    part = tiled_product("viewshed").compute(seen, own, None)
    if parameters.layer != "seen-by":
        return replace(found, layers=np.asarray(part.layers)[core(terrain)]), terrain
    layers = np.array(found.layers)
    for number, (_, layer) in zip(local, part.layers, strict=True):
        layers[number] = layer[core(terrain)]
    return replace(found, layers=layers), terrain
