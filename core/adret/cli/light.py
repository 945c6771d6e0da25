"""`adret light`."""

from adret.cli.options import command
from adret.cli.running import product_action
from adret.parameters import LightParameters

__all__ = ["register"]

HELP = """Light from sun and sky on every cell: irradiance, or radiance with --albedo.

Examples:

\b
  adret light dem.tif lit.tif --sun 315,35
  adret light dem.tif lit.tif --sun 315,35 --sky uniform --sky-radiance 0.1
  adret light dem.tif lit.tif --environment sky.hdr --preview lit.png

An environment in colour gives three bands: red, green, blue.
"""

register = command("light", LightParameters, HELP, product_action("light"))
