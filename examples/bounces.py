"""Bounced light on the Aletsch mountains: pictures of one, two and all bounces, and of lava.

Writes PNGs to a folder (default docs/images).
"""

import heapq
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

import adret

EXAMPLES = Path(__file__).resolve().parent
DEM = EXAMPLES / "data" / "alpine_aletsch_dhm200_lv95_200m.tif"
Picture = NDArray[np.float32]
Panel = tuple[str, NDArray[np.uint8]]

SNOW_LINE = 2600.0
SUN = adret.Sun(azimuth_deg=135.0, elevation_deg=20.0, irradiance=1000.0)
MOON = adret.Sun(azimuth_deg=300.0, elevation_deg=35.0, irradiance=0.35)
LAVA = np.array([9.0, 2.2, 0.25])  # radiance, red, green and blue
CRATERS = ((38, 42), (62, 78), (84, 40))


def albedo_of(terrain: adret.Terrain) -> NDArray[np.float64]:
    """Dark valleys, bright snow, a soft line between them."""
    snow = np.clip((terrain.elevations() - SNOW_LINE) / 300.0 + 0.5, 0.0, 1.0)
    return np.asarray(0.15 + 0.65 * snow)


def picture(values: Picture, brightest: float) -> NDArray[np.uint8]:
    """Values with a display's gamma; colours too bright for it keep their hue."""
    level = np.nan_to_num(values) / brightest
    if level.ndim == 3:
        level = level / np.maximum(level.max(axis=2, keepdims=True), 1.0)
    return np.asarray(np.clip(level, 0.0, 1.0) ** (1.0 / 2.2) * 255.0 + 0.5, dtype=np.uint8)


def sheet(rows: list[list[Panel]], path: Path, gap: int = 6) -> None:
    """Save rows of pictures of one size, each with its name under it."""
    height, width = rows[0][0][1].shape[:2]
    font = ImageFont.load_default(13)
    step = height + 20 + gap
    size = len(rows[0]) * (width + gap) - gap, len(rows) * step - gap
    page = Image.new("RGB", size, "white")
    draw = ImageDraw.Draw(page)
    for i, row in enumerate(rows):
        for j, (name, panel) in enumerate(row):
            left, top = j * (width + gap), i * step
            page.paste(Image.fromarray(panel).convert("RGB"), (left, top))
            draw.text((left + 2, top + height + 2), name, fill="black", font=font)
    page.save(path, optimize=True)
    print(path, f"{path.stat().st_size / 1024:.0f} KB")


def bounces(folder: Path) -> None:
    """Snow mountains under a low sun: the indirect light alone, then all light."""
    terrain = adret.Terrain.open(DEM, window=((30, 270), (60, 300)))
    albedo = albedo_of(terrain)
    steps = [
        adret.indirect_light(terrain, SUN, albedo, bounces=count, directions=64)
        for count in (1, 2, "converge")
    ]
    for light in steps:
        mean = float(np.nanmean(light.irradiance))
        print(f"{light.bounces} bounces: mean {mean:.2f} W/m2, residual {light.residual:.1e}")
    one, two, every = (light.irradiance for light in steps)
    brightest = float(np.nanquantile(every, 0.998))
    sheet(
        [
            [
                ("one bounce", picture(one, brightest)),
                ("two bounces", picture(two, brightest)),
                (f"converged, {steps[2].bounces} bounces", picture(every, brightest)),
            ],
            [
                ("the first", picture(one, brightest)),
                ("the second, 10 times as bright", picture(two - one, brightest / 10.0)),
                ("all others, 100 times as bright", picture(every - two, brightest / 100.0)),
            ],
        ],
        folder / "bounces-indirect.png",
    )
    direct = adret.direct_light(terrain, SUN).irradiance
    brightest = float(np.nanquantile(direct, 0.97))
    names = ("direct light alone", "with one bounce", "with all bounces")
    all_light = (direct, direct + one, direct + every)
    panels = [
        (name, picture(light, brightest)) for name, light in zip(names, all_light, strict=True)
    ]
    sheet([panels], folder / "bounces-all-light.png")


def stream(terrain: adret.Terrain, row: int, column: int) -> list[tuple[int, int]]:
    """Cells that something fluid passes until it leaves: always the lowest dry neighbour."""
    rows, columns = terrain.shape
    wet: set[tuple[int, int]] = set()
    shore = [(0.0, row, column)]
    while shore:
        _, row, column = heapq.heappop(shore)
        if not (0 < row < rows - 1 and 0 < column < columns - 1):
            break
        if (row, column) in wet:
            continue
        wet.add((row, column))
        for r in (row - 1, row, row + 1):
            for c in (column - 1, column, column + 1):
                heapq.heappush(shore, (float(terrain.heights[r, c]), r, c))
    return sorted(wet)


def lava(folder: Path, finer: int = 3) -> None:
    """The same mountains as a volcano, by moonlight: streams of glowing lava."""
    coarse = adret.Terrain.open(DEM, window=((80, 200), (150, 270)))
    size = tuple(finer * n for n in reversed(coarse.shape))
    smooth = Image.fromarray(coarse.elevations().astype(np.float32))
    dx, dy = coarse.cell_size
    terrain = adret.Terrain(
        np.asarray(smooth.resize(size, Image.Resampling.BICUBIC)), (dx / finer, dy / finer)
    )
    emission = np.zeros((*terrain.shape, 3))
    for row, column in CRATERS:
        for r, c in stream(terrain, finer * row, finer * column):
            emission[r - 1 : r + 2, c - 1 : c + 2] = LAVA
    albedo = np.array([0.30, 0.28, 0.27])
    moon = np.array([0.55, 0.7, 1.0]) * albedo / np.pi
    by_moon = adret.direct_light(terrain, MOON).irradiance[..., None] * moon
    glow = adret.indirect_light(
        terrain,
        None,
        albedo,
        radiance=by_moon,
        emission=emission,
        bounces="converge",
        directions=128,
    )
    print(f"lava: {glow.bounces} bounces, residual {glow.residual:.1e}")
    dark = by_moon + emission
    panels = [
        ("lava by moonlight, no bounce", picture(dark, 0.3)),
        ("with the light that it throws", picture(dark + glow.radiance(albedo), 0.3)),
    ]
    sheet([panels], folder / "bounces-lava.png")


def main(folder: Path) -> None:
    """Write all pictures."""
    folder.mkdir(parents=True, exist_ok=True)
    bounces(folder)
    lava(folder)


if __name__ == "__main__":
    default = EXAMPLES.parent / "docs" / "images"
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else default)
