"""`adret viewshed`."""

from adret.cli.options import command
from adret.cli.running import product_action
from adret.parameters import ViewshedParameters

__all__ = ["register"]

HELP = """What one or many observers see, by exact lines of sight.

Examples:

\b
  adret viewshed dem.tif seen.tif --observer 120,85
  adret viewshed dem.tif seen.tif --at 2645000,1157000 --observer-height 12 --preview seen.png
  adret viewshed dem.tif count.tif --observer 120,85 --observer 40,210 --layer count
  adret viewshed dem.tif mast.tif --observer 120,85 --layer minimum-height --curvature

An observer is a cell (row,column from the north-western corner) or a place in the raster's
coordinates.
"""

register = command("viewshed", ViewshedParameters, HELP, product_action("viewshed"))
