"""Ambient occlusion far away, tiny, huge and steep: against long double, and against itself."""

import itertools
import math
import warnings

import numpy as np
import pytest
import stress_references as references
from numpy.typing import NDArray

import adret
from adret.screen import METHODS
from adret.screen.samples import rotations, shell_samples

Array = NDArray[np.float64]
SHAPE = (13, 15)
UNIT = 2.0**-24
ROUNDINGS = 8.0
"""Of the largest depth, as a share of a pixel: what exact slices may be off by."""
CASES = [
    (1e-6, 1.0, 1.0),
    (1e-3, 1e-3, 1e3),
    (1.0, 1.0, 1.0),
    (1.0, 1e5, 1e3),
    (1e3, 1.0, 1.0),
    (1e6, 1e-3, 10.0),
]
"""Relief [pixels]; a pixel [view units]; the eye's distance [the larger of pixel and relief]."""
EVERY = list(itertools.product((1e-6, 1e-3, 1.0, 1e3, 1e6), (1e-3, 1.0, 1e5), (1.0, 1e3, 1e5)))
CHOSEN = [CASES, pytest.param(EVERY, marks=pytest.mark.slow)]
IDS = ["some", "all"]
Cases = list[tuple[float, float, float]]
SOME_FIELDS = ("rough", "plane", "cliff", "towers")
FIELDS = [
    name if name in SOME_FIELDS else pytest.param(name, marks=pytest.mark.slow)
    for name in references.fields()
]
METHOD_NAMES = [  # casting rays compiles longest, and has tests of its own
    pytest.param(name, marks=pytest.mark.slow) if name == "raytraced" else name for name in METHODS
]


def orthographic(shape: tuple[int, int], size: float) -> adret.Camera:
    rows, columns = shape
    return adret.Camera.orthographic(columns, rows, extent=(columns * size, rows * size))


def occlusion(buffer: adret.DepthBuffer, method: str, **options: object) -> Array:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", adret.screen.DepthPrecisionWarning)
        found = adret.ambient_occlusion(buffer, method=method, **options)
    return found.occlusion.astype(np.float64)


def patch_slope(z: Array, size: float, azimuth: float) -> Array:
    """Slope at the pixel's own centre of the bilinear patch that lies in a direction."""
    padded = np.pad(z, 1, constant_values=np.nan)
    rows, columns = z.shape
    down, right = -math.cos(azimuth), math.sin(azimuth)
    below = padded[1 + int(np.sign(down)) :][:rows, 1:-1] - z
    beside = padded[1:-1, 1 + int(np.sign(right)) :][:, :columns] - z
    return (abs(right) * beside + abs(down) * below) / size


def exact_error(name: str, relief: float, size: float, distance: float) -> tuple[float, float]:
    """Largest error of exact slices, and of a depth's last place in slope."""
    high = relief * size
    z = -references.fields(*SHAPE)[name] * high + 2.0 * high + distance * max(high, size)
    held = z.astype(np.float32).astype(np.float64)
    cell, k = (size, size), 8
    east, north = references.plane_slopes(-held, cell)
    normal = np.stack([-east, -north, np.ones_like(east)]).astype(np.float64)
    normal /= np.sqrt((normal**2).sum(axis=0))
    buffer = adret.DepthBuffer(held, orthographic(SHAPE, size), normals=normal)
    got = occlusion(buffer, "exact", directions=k, near=4096, growth=0.0)
    angles = 2.0 * math.pi * (np.arange(k) + 0.5) / k
    azimuths = np.pi / 2 + angles  # of the image: from right to down
    closed, whole = np.zeros(SHAPE, np.longdouble), np.zeros(SHAPE, np.longdouble)
    for azimuth, slope in zip(azimuths, references.slopes(-held, cell, azimuths), strict=True):
        plane = east * math.sin(azimuth) + north * math.cos(azimuth)
        whole += references.moment(plane, plane)
        slope = np.fmax(slope, patch_slope(-held, size, azimuth))
        closed += references.moment(plane, plane) - references.moment(np.fmax(slope, plane), plane)
    return float(np.abs(got - closed / whole).max()), UNIT * float(held.max()) / size


@pytest.mark.parametrize("cases", CHOSEN, ids=IDS)
@pytest.mark.parametrize("name", FIELDS)
def test_exact_slices_are_off_by_roundings_alone(name: str, cases: Cases) -> None:
    for case in cases:
        error, slope = exact_error(name, *case)
        assert error <= 2e-6 + ROUNDINGS * slope, case


def contained(depth: Array, camera: adret.Camera, radius: float) -> tuple[Array, Array]:
    """Least and largest share of a shell's samples behind the surface, as rounding is taken."""
    rows, columns = depth.shape
    perspective = camera.perspective_divide
    ax, bx, ay, by = camera.rays
    near = (1.0 / depth).astype(np.float32).astype(float) if perspective else -depth
    row, column = np.mgrid[0:rows, 0:columns].astype(np.float64)
    scale = depth if perspective else np.ones_like(depth)
    here = np.stack([scale * (ax * column + bx), scale * (ay * row + by), -depth])
    turns = rotations(16, 0)[(row % 4 * 4 + column % 4).astype(int)]
    least, most = np.zeros(depth.shape), np.zeros(depth.shape)
    for sample in shell_samples("poisson", 8, 0):
        x, y, z = here + radius * np.moveaxis(turns @ sample, 2, 0)
        with np.errstate(divide="ignore"):
            own = np.where(z < 0.0, -1.0 / z, -np.inf) if perspective else z
        divide = -z if perspective else 1.0
        with np.errstate(divide="ignore", invalid="ignore"):
            c, r = (x / divide - bx) / ax, (y / divide - by) / ay
        beside = ~((r >= -0.5) & (c >= -0.5) & (r < rows - 0.5) & (c < columns - 0.5))
        beside |= np.isinf(own)
        r, c = np.where(beside, 0.0, r), np.where(beside, 0.0, c)
        i = np.clip(np.floor(r).astype(int), 0, rows - 2)
        j = np.clip(np.floor(c).astype(int), 0, columns - 2)
        v, u = r - i, c - j
        surface = (1 - v) * ((1 - u) * near[i, j] + u * near[i, j + 1])
        surface += v * ((1 - u) * near[i + 1, j] + u * near[i + 1, j + 1])
        little = 2.0**-22 * np.abs(surface)
        least += np.where(beside, 0.5, surface - own > 1.01 * little)
        most += np.where(beside, 0.5, surface - own > 0.99 * little)
    return least / 8.0, most / 8.0


@pytest.mark.parametrize("cases", CHOSEN, ids=IDS)
@pytest.mark.parametrize("perspective", [False, True])
@pytest.mark.parametrize("name", FIELDS)
def test_the_light_field_method_counts_what_lies_behind_the_surface(
    name: str, perspective: bool, cases: Cases
) -> None:
    for relief, size, distance in cases:
        high = relief * size
        z = -references.fields(*SHAPE)[name] * high + 2.0 * high
        z = (z + distance * max(high, size)).astype(np.float32).astype(np.float64)
        camera = orthographic(SHAPE, size)
        if perspective:
            camera = adret.Camera.perspective(*SHAPE[::-1], fov_y_deg=50.0)
        radius = 3.0 * max(size, high)
        got = occlusion(adret.DepthBuffer(z, camera), "lightfield", radius=radius)
        least, most = contained(z, camera, radius)
        assert (got >= least - 1e-6).all(), (relief, size, distance)
        assert (got <= most + 1e-6).all(), (relief, size, distance)


def ground(shape: tuple[int, int] = (20, 24)) -> Array:
    z = np.random.default_rng(2).standard_normal(shape).cumsum(0).cumsum(1)
    return 12.0 + np.round(z / np.ptp(z) * 256.0) / 32.0


def options(method: str, size: float) -> dict[str, object]:
    chosen: dict[str, object] = {"radius": 6.0 * size}
    if method == "raytraced":
        chosen["rays"] = 64
    if method == "lsao":
        chosen["falloff"] = "quadratic"
    return chosen


def change(method: str, distance: float, size: float) -> float:
    """Mean change against pixels of 1, seen from nearby."""
    z = ground()
    near = occlusion(
        adret.DepthBuffer(z, orthographic(z.shape, 1.0)), method, **options(method, 1.0)
    )
    far = occlusion(
        adret.DepthBuffer((z + distance) * size, orthographic(z.shape, size)),
        method,
        **options(method, size),
    )
    return float(np.abs(far - near).mean())


@pytest.mark.parametrize("size", [3.7, pytest.param(1e-3, marks=pytest.mark.slow)])
@pytest.mark.parametrize("method", METHOD_NAMES)
def test_distance_and_unit_change_little(method: str, size: float) -> None:
    """Steps and samples on a tie may fall to the other side: single pixels, by a sample or two."""
    for distance, mean in ((0.0, 2e-3), (1e3, 2e-3), (1e5, 0.015)):
        assert change(method, distance, size) <= mean, distance
