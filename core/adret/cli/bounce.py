"""`adret bounce`."""

from adret.cli.options import command
from adret.cli.running import product_action
from adret.parameters import BounceParameters

__all__ = ["register"]

HELP = """Indirect light: what terrain reflects to the terrain that sees it, once or many times.

Examples:

\b
  adret bounce dem.tif indirect.tif --sun 315,35 --albedo 0.4
  adret bounce dem.tif snow.tif --sun 315,35 --sky uniform --albedo 0.8 --bounces converge
  adret bounce dem.tif lit.tif --environment sky.hdr --bounces 3 --layer radiance --preview lit.png
  adret bounce dem.tif glow.tif --emission lava.tif --albedo-map albedo.tif --bounces converge
"""

register = command("bounce", BounceParameters, HELP, product_action("bounce"))
