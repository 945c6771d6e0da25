"""Automatic azimuths on real ground of three kinds: within the tolerance asked, against 512."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import adret

GROUNDS = {
    "alpine": ("alpine_bigtujunga_srtm1_utm11_30m.tif", (300, 420), (200, 340)),
    "urban": ("urban_toulouse_mnh_utm31_05m.tif", (100, 220), (100, 220)),
    "lunar": ("moon_gld100_eqc_118m_4096.tif", (1500, 1620), (1500, 1620)),
}


def ground(data_dir: Path, kind: str) -> adret.Terrain:
    name, rows, columns = GROUNDS[kind]
    path = data_dir / "dem" / name
    if not path.exists():
        pytest.skip(f"no {name} among the data")
    return adret.Terrain.open(path, window=(rows, columns))


def product(terrain: adret.Terrain, name: str, **how: object) -> NDArray[np.float32]:
    if name == "sky view":
        return adret.sky_view_factor(terrain, "normal", near=16, **how)  # type: ignore[arg-type]
    light = adret.direct_light(terrain, adret.OvercastSky(), near=16, **how)  # type: ignore[arg-type]
    return light.irradiance


@pytest.mark.slow
@pytest.mark.parametrize("kind", GROUNDS)
@pytest.mark.parametrize("name", ["sky view", "light"])
def test_the_error_on_real_ground_is_within_what_was_asked(
    name: str, kind: str, data_dir: Path
) -> None:
    terrain = ground(data_dir, kind)
    truth = product(terrain, name, directions=512)
    scale = 1.0 if name == "sky view" else float(np.nanmean(truth))
    for tolerance in (0.02, 0.002):
        found = product(terrain, name, directions="auto", tolerance=tolerance)
        error = float(np.nanmean(np.abs(found - truth))) / scale
        report = adret.last_run_report()
        assert report is not None
        assert error <= tolerance, tolerance
