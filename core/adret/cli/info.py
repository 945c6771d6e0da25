"""`adret info`."""

import math
from typing import TYPE_CHECKING, Annotated, Any

import typer

from adret.cli.running import open_terrain

if TYPE_CHECKING:
    from adret.terrain import Terrain

__all__ = ["describe", "register"]

HELP = """What a raster holds and how Adret reads it.

Examples:

\b
  adret info dem.tif
  adret info dem.tif --json
  adret info heights.png --cell-size 2,2
"""


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("info", help=HELP)(info)


def info(
    source: Annotated[str, typer.Argument(metavar="IN", help="Elevation raster to read.")],
    json: Annotated[bool, typer.Option("--json", help="Write JSON instead of a table.")] = False,
    band: Annotated[str, typer.Option(metavar="N", help="Band that holds the heights.")] = "1",
    cell_size: Annotated[
        str | None,
        typer.Option(metavar="DX,DY", help="Metres a cell, for files that do not say it."),
    ] = None,
    vertical_unit: Annotated[
        str | None, typer.Option(metavar="UNIT", help="Unit of the heights: m, ft, us-ft, ...")
    ] = None,
) -> None:
    """Print what `describe` finds."""
    facts = describe(open_terrain(source, band, cell_size, vertical_unit))
    if json:
        from json import dumps

        print(dumps(facts, indent=2))
        return
    from rich.console import Console
    from rich.table import Table

    table = Table(title=source, show_header=False, title_justify="left")
    for name, value in facts.items():
        table.add_row(name.replace("_", " "), _shown(name, value))
    Console().print(table)


def describe(terrain: "Terrain") -> dict[str, Any]:
    """Facts about a terrain, by name; the unit closes the name where there is one.

    Examples
    --------
    >>> import numpy as np
    >>> from adret import Terrain
    >>> describe(Terrain(np.array([[1.0, 3.0], [np.nan, 2.0]]), (10, 20)))["nodata_share"]
    0.25
    """
    import numpy as np

    rows, columns = terrain.shape
    crs = terrain.crs
    limit = math.radians(0.5)
    heights = terrain.heights
    return {
        "rows": rows,
        "columns": columns,
        "cell_size_m": list(terrain.cell_size),
        "extent_m": [columns * terrain.cell_size[0], rows * terrain.cell_size[1]],
        "crs": None if crs is None else crs.name,
        "crs_code": None if crs is None else ":".join(crs.to_authority() or ()) or None,
        "geographic": bool(crs is not None and crs.is_geographic),
        "body_radius_m": terrain.body_radius,
        "grid_convergence_deg": terrain.grid_convergence_deg,
        "azimuth_error_deg": math.degrees(terrain.azimuth_error),
        "latitude_bands": len(terrain.latitude_bands(limit)),
        "vertical_unit": terrain.vertical_unit,
        "lowest_m": float(np.nanmin(heights)) + terrain.datum,
        "highest_m": float(np.nanmax(heights)) + terrain.datum,
        "datum_m": terrain.datum,
        "nodata_share": float(terrain.mask.mean()),
    }


def _shown(name: str, value: Any) -> str:
    if value is None:
        return "unknown"
    if isinstance(value, list):
        return " x ".join(f"{member:.6g}" for member in value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    if name == "nodata_share":
        return f"{100.0 * value:.2f} %"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
