"""Azimuths side by side: the bytes of one thread, and no thread that outlives its run."""

import threading
from collections import Counter
from collections.abc import Iterator

import numpy as np
import pytest

import adret
from adret import sweepers
from adret._kernels import jit
from adret.horizon_options import HorizonOptions


@pytest.fixture
def two_threads() -> Iterator[None]:
    before = jit.threads()
    if before < 2:
        pytest.skip("needs a machine with two processors")
    jit.threads(2)
    yield
    jit.threads(before)


def hills(rows: int = 60, columns: int = 80) -> adret.Terrain:
    draw = np.random.default_rng(3)
    z = 40.0 * draw.random((rows, columns)).cumsum(axis=0)
    z[20:24, 30:33] = np.nan
    return adret.Terrain(z, (30.0, 20.0))


def engines(terrain: adret.Terrain, count: int, **options: object) -> int:
    made = sweepers.Sweepers(terrain, HorizonOptions(**options), count)  # type: ignore[arg-type]
    return len(made._engines)


def test_maps_views_and_reports_are_those_of_one_thread(two_threads):
    terrain = hills()
    azimuths = np.r_[adret.azimuth_set(17), 1.0, 1.0, 0.0]
    found = {}
    for count in (2, 1):
        jit.threads(count)
        each = adret.horizon_map(terrain, azimuths=azimuths, distance=True, near=4)
        view = adret.sky_view_factor(terrain, "normal", 33, near=4)
        light = adret.direct_light(terrain, adret.UniformSky(), 16, near=4)
        report = each.report
        found[count] = (
            each.elevation.tobytes(),
            each.distance.tobytes(),
            view.tobytes(),
            light.irradiance.tobytes(),
            report.skipped,
            report.azimuths_swept,
        )
    assert found[1] == found[2]
    assert found[1][4]["same azimuths"] == 2


def test_threads_have_azimuths_of_their_own_where_they_fit(two_threads, monkeypatch):
    terrain = hills()
    assert engines(terrain, 16) == 2
    assert engines(terrain, 3) == 2  # 1.5 of 2 threads are busy
    assert engines(terrain, 1) == 1
    assert engines(terrain, 16, method="exact") == 1
    assert sweepers.own_bytes(terrain.heights.size, 2) == 2 * 16 * 60 * 80
    assert sweepers.own_bytes(terrain.heights.size, 1) == 0
    assert sweepers.own_bytes(terrain.heights.size, 2, bands=7) == 2 * 24 * 60 * 80
    monkeypatch.setattr(sweepers, "MEMORY", 16 * 60 * 80 - 1)
    assert engines(terrain, 16) == 1
    assert sweepers.own_bytes(terrain.heights.size, 2) == 0


def test_a_run_that_is_ended_early_leaves_no_thread(two_threads):
    def stop(done: int, total: int) -> None:
        if done == 3:
            raise adret.Cancelled

    with pytest.raises(adret.Cancelled):
        adret.horizon_map(hills(), 32, progress=stop)
    assert not [t for t in threading.enumerate() if t.name.startswith("adret-sweep")]


def test_what_goes_wrong_in_a_thread_is_told(two_threads):
    made = sweepers.Sweepers(hills(), HorizonOptions(), 4)

    def fill(engine: object, number: int, layer: np.ndarray) -> None:
        if number == 2:
            raise MemoryError("no room")
        layer[:] = number

    found = made.layers([0, 1, 2, 3], fill)
    assert [float(next(found)[1][0, 0]) for _ in range(2)] == [0.0, 1.0]
    with pytest.raises(MemoryError, match="no room"):
        next(found)


def test_what_was_left_out_is_counted_when_no_thread_sweeps_any_more(two_threads, monkeypatch):
    sweeping = []

    def left_out(self: sweepers.Sweepers) -> Counter[str]:
        names = [thread.name for thread in threading.enumerate()]
        sweeping.extend(name for name in names if name.startswith("adret-sweep"))
        return Counter(read=1)

    monkeypatch.setattr(sweepers.Sweepers, "left_out", property(left_out))
    assert adret.horizon_map(hills(), 16, near=4).report.skipped == {"read": 1}
    assert not sweeping
