"""`adret openness`."""

from adret.cli.options import command
from adret.cli.running import product_action
from adret.parameters import OpennessParameters

__all__ = ["register"]

HELP = """Openness: mean angle between the vertical and the horizon [degrees].

Examples:

\b
  adret openness dem.tif openness.tif
  adret openness dem.tif negative.tif --sign -1 --max-distance 2000
"""

register = command("openness", OpennessParameters, HELP, product_action("openness"))
