"""`adret horizon`."""

from adret.cli.options import command
from adret.cli.running import product_action
from adret.parameters import HorizonParameters

__all__ = ["register"]

HELP = """Elevation of the horizon for every cell and azimuth [degrees], one band an azimuth.

Examples:

\b
  adret horizon dem.tif horizon.tif
  adret horizon dem.tif horizon.tif --directions 32 --near 32
  adret horizon dem.tif horizon.tif --azimuths 90,180,270 --dtype float32
  adret horizon dem.tif horizon.tif --curvature --refraction 0.13

No terrain in a direction gives -90.
"""

register = command("horizon", HorizonParameters, HELP, product_action("horizon"))
