"""Light the Aletsch mountains through the `adret` command: what `make demo` shows.

Writes GeoTIFFs and pictures to a folder (default demo-output) and prints where they are.
"""

import sys
import time
from pathlib import Path

from adret.cli import main as adret

DATA = Path(__file__).resolve().parent / "data"
DEM = DATA / "alpine_aletsch_dhm200_lv95_200m.tif"
SKY = DATA / "sky_512.exr"

STEPS = {
    "horizon": ("horizon map, 64 azimuths", ["horizon", "--directions", "64"]),
    "sky_view": ("sky view", ["sky", "--kind", "visible"]),
    "shadow": ("cast shadow, sun in the south-east 15 degrees high", ["shadow", "--sun", "135,15"]),
    "lit": (
        "lit by a sun in the north-west and a dim even sky",
        ["light", "--sun", "315,35", "--sky", "uniform", "--sky-radiance", "0.06"],
    ),
    "lit_by_sky": ("lit by a photographed sky", ["light", "--environment", str(SKY)]),
}


def main(folder: Path) -> int:
    """Run every step; stop at the first that fails."""
    folder.mkdir(parents=True, exist_ok=True)
    adret(["info", str(DEM)])
    print()
    for name, (title, (command, *options)) in STEPS.items():
        raster, picture = folder / f"{name}.tif", folder / f"{name}.png"
        start = time.perf_counter()
        code = adret(
            [command, str(DEM), str(raster), *options, "--preview", str(picture), "--overwrite"]
        )
        if code != 0:
            return code
        seconds = time.perf_counter() - start
        print(f"{title} ({seconds:.1f} s)\n  {raster.resolve()}\n  {picture.resolve()}", flush=True)
    print("\nElevation data (c) swisstopo; sky by Poly Haven (CC0).")
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1] if len(sys.argv) > 1 else "demo-output")))
