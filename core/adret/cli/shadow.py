"""`adret shadow`."""

from adret.cli.options import command
from adret.cli.running import product_action
from adret.parameters import ShadowParameters

__all__ = ["register"]

HELP = """Ground that is lit, self-shadowed or in cast shadow for one position of the sun.

Examples:

\b
  adret shadow dem.tif shadow.tif --sun 135,12
  adret shadow dem.tif lit.tif --sun 315,35 --layer lit --preview lit.png

Codes: 0 lit, 1 self-shadowed, 2 cast shadow, 3 nodata.
"""

register = command("shadow", ShadowParameters, HELP, product_action("shadow"))
