"""Results say what they hold in a line."""

import numpy as np

import adret


def test_results_print_types_and_shapes_not_numbers() -> None:
    terrain = adret.Terrain(np.random.default_rng(1).random((9, 11)), (2.0, 2.0))
    sun = adret.Sun(200.0, 30.0)
    light = adret.direct_light(terrain, sun)
    shown = {
        repr(adret.horizon_map(terrain, 8)): "HorizonMap(elevation=float32 (8, 9, 11), azimuth=",
        repr(light): "Light(irradiance=float32 (9, 11), ",
        repr(adret.indirect_light(terrain, sun, 0.3, directions=8)): "Light(irradiance=",
        repr(adret.shadow(terrain, sun)): "Shadow(",
        repr(adret.intervisibility(terrain, directions=8)): "Intervisibility(offsets=",
        repr(adret.viewshed(terrain, (4, 5))): "Viewshed(visible=bool (9, 11), ",
        repr(adret.viewshed(terrain, [(row, 3) for row in range(9)])): "Viewshed(visible=",
        repr(adret.line_of_sight(terrain, (0, 0), (8, 10))): "LineOfSight(",
    }
    for text, start in shown.items():
        assert text.startswith(start), text
        assert "array(" not in text
        assert "\n" not in text
        assert len(text) < 1200, text
