"""`adret sky`."""

from adret.cli.options import command
from adret.cli.running import product_action
from adret.parameters import SkyViewParameters

__all__ = ["register"]

HELP = """Share of the sky that each cell sees, 0 to 1.

Examples:

\b
  adret sky dem.tif sky.tif
  adret sky dem.tif sky.tif --kind normal --directions 32 --preview sky.png

The definition used is in the file's tag ADRET_DEFINITION.
"""

register = command("sky", SkyViewParameters, HELP, product_action("sky-view"))
