"""`adret visibility`."""

from adret.cli.options import command
from adret.cli.running import product_action
from adret.parameters import VisibilityParameters

__all__ = ["register"]

HELP = """How much every cell sees of the terrain: area, distance, number of samples.

Examples:

\b
  adret visibility dem.tif area.tif
  adret visibility dem.tif far.tif --measure max-sight-distance --curvature --refraction 0.13
  adret visibility dem.tif area.tif --max-distance 10000 --directions 64 --preview area.png
"""

register = command("visibility", VisibilityParameters, HELP, product_action("visibility"))
