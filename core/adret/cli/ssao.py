"""`adret ssao`."""

from adret.cli.options import DEPTH, command
from adret.cli.running import product_action
from adret.parameters import SsaoParameters

__all__ = ["register"]

HELP = """Ambient occlusion of a depth buffer: 0 open, 1 closed.

Depths are .npy, .npz, .exr, .tif or 16-bit .png; the camera is a JSON file with width, height and
fx, fy, cx, cy (pixels), or fov_y_deg, or extent, or a matrix.

Examples:

\b
  adret ssao depth.exr ao.tif --camera camera.json --radius 0.5 --preview ao.png
  adret ssao depth.npz ao.tif --camera camera.json --method ffao --falloff timonen
  adret ssao depth.png ao.tif --camera camera.json --kind device --color view.png --preview lit.png
"""

register = command("ssao", SsaoParameters, HELP, product_action("ssao"), DEPTH)
