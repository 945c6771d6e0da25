"""Sets of sample points that methods fix once and turn or mirror from pixel to pixel."""

import math

import numpy as np
from numpy.typing import NDArray

from adret.errors import InputError

__all__ = [
    "SAMPLERS",
    "disk_samples",
    "rotations",
    "shell_samples",
    "square_samples",
]

SAMPLERS = ("cylindrical", "jittered", "latin", "poisson")
Samples = NDArray[np.float64]
FAILURES = 100
"""Darts in a row that may find no room before the distance shrinks."""
MAX_SAMPLES = 4096


def disk_samples(count: int, seed: int = 0, *, stratified: bool = False) -> Samples:
    """Poisson-disk points in the unit disk: every pair is kept apart.

    Parameters
    ----------
    count : int
        Number of points, 1 or more.
    seed : int
        0 or more; the same seed gives the same points.
    stratified : bool
        Move each point along its radius into a ring of its own; the rings have equal areas.

    Returns
    -------
    ndarray, shape (count, 2), float64

    Notes
    -----
    The points of ``square_samples("poisson")`` through the equal-area map from square to disk:
    each of them is uniform in the disk. Points kept apart in the disk itself crowd its rim.

    References
    ----------
    L. Szirmay-Kalos et al., "Volumetric Ambient Occlusion for Real-Time Rendering and Games",
    2010, "Exploiting the Distance to the Separating Surface". The map: P. Shirley and K. Chiu, "A
    Low Distortion Map Between Disk and Square", 1997.

    Examples
    --------
    >>> points = disk_samples(16)
    >>> points.shape, bool((np.hypot(*points.T) <= 1.0).all())
    ((16, 2), True)
    """
    x, y = square_samples("poisson", count, seed).T
    wide = np.abs(x) > np.abs(y)
    radius = np.where(wide, x, y)
    ratio = np.where(wide, y, x) / np.where(radius == 0.0, 1.0, radius)
    angle = np.where(wide, 0.25 * np.pi * ratio, 0.5 * np.pi - 0.25 * np.pi * ratio)
    length = np.abs(radius)
    if stratified:
        length = np.sqrt((np.argsort(np.argsort(length)) + 0.5) / length.size)
    length = np.copysign(length, radius)
    return np.stack([length * np.cos(angle), length * np.sin(angle)], axis=1)


def square_samples(sampler: str, count: int, seed: int = 0) -> Samples:
    """Points of one of the four samplers in the square [-1, 1]².

    Parameters
    ----------
    sampler : {"cylindrical", "jittered", "latin", "poisson"}
        Independent uniform points; one in each cell of a grid that is as square as `count` allows
        (points left over fall anywhere); one in each row and column of a grid of count x count
        cells; or points kept apart, the square being taken as a torus.
    count : int
    seed : int

    Returns
    -------
    ndarray, shape (count, 2), float64

    Raises
    ------
    InputError
        For another sampler, a count below 1 or a negative seed.

    References
    ----------
    O. Doronin et al., "Screen-Space Ambient Occlusion for Light Field Displays", 2017, section 6,
    "Generation of samples".

    Examples
    --------
    >>> points = square_samples("latin", 8)
    >>> sorted(np.floor((points[:, 0] + 1.0) * 4.0).astype(int).tolist())
    [0, 1, 2, 3, 4, 5, 6, 7]
    """
    if sampler not in SAMPLERS:
        raise InputError("sampler", f"one of {', '.join(SAMPLERS)}", sampler)
    n = _count(count)
    draw = np.random.default_rng(_seed(seed))
    if sampler == "jittered":
        rows = max(k for k in range(1, math.isqrt(n) + 1) if n % k == 0)
        if rows * rows * 4 < n:  # a prime: cells far from square are worse than points left over
            rows = math.isqrt(n)
        columns = n // rows
        i, j = np.divmod(np.arange(rows * columns), columns)
        unit = np.empty((n, 2))
        unit[: i.size, 0] = (j + draw.random(i.size)) / columns
        unit[: i.size, 1] = (i + draw.random(i.size)) / rows
        unit[i.size :] = draw.random((n - i.size, 2))
    elif sampler == "latin":
        unit = (np.stack([draw.permutation(n), draw.permutation(n)], axis=1)).astype(np.float64)
        unit = (unit + draw.random((n, 2))) / n
    elif sampler == "poisson":
        unit = _darts(n, draw)
    else:
        unit = draw.random((n, 2))
    return 2.0 * unit - 1.0


def shell_samples(sampler: str, count: int, seed: int = 0, inner: float = 0.8) -> Samples:
    """Points that are uniform in the shell between the radii `inner` and 1.

    Parameters
    ----------
    sampler, count, seed
        As for `square_samples`: the square's sides become height and longitude.
    inner : float
        Smaller radius, 0 to 1.

    Returns
    -------
    ndarray, shape (count, 3), float64

    Notes
    -----
    z = ξ₁, φ = πξ₂ on the unit sphere, times the cube root of a number between inner³ and 1; these
    numbers are stratified too.

    References
    ----------
    Doronin et al. 2017, algorithms 3 and 4.

    Examples
    --------
    >>> radii = np.linalg.norm(shell_samples("poisson", 32), axis=1)
    >>> bool(((radii > 0.799) & (radii < 1.001)).all())
    True
    """
    if not 0.0 <= inner <= 1.0:
        raise InputError("inner", "between 0 and 1", inner)
    square = square_samples(sampler, count, seed)
    draw = np.random.default_rng(_seed(seed) + 1)
    z, angle = square[:, 0], np.pi * square[:, 1]
    across = np.sqrt(1.0 - z * z)
    strata = (draw.permutation(count) + draw.random(count)) / count
    radius = np.cbrt(inner**3 + strata * (1.0 - inner**3))
    return np.stack([across * np.cos(angle), across * np.sin(angle), z], axis=1) * radius[:, None]


def rotations(count: int, seed: int = 0) -> Samples:
    """Random rotations of space, uniformly distributed.

    Parameters
    ----------
    count : int
    seed : int

    Returns
    -------
    ndarray, shape (count, 3, 3), float64

    Examples
    --------
    >>> r = rotations(3)
    >>> bool(np.allclose(r @ r.transpose(0, 2, 1), np.eye(3)))
    True
    """
    draw = np.random.default_rng(_seed(seed))
    u, v, t = draw.random((3, _count(count)))
    near, far = np.sqrt(1.0 - u), np.sqrt(u)
    w, x = near * np.sin(2.0 * np.pi * v), near * np.cos(2.0 * np.pi * v)
    y, z = far * np.sin(2.0 * np.pi * t), far * np.cos(2.0 * np.pi * t)
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], axis=1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=1),
        ],
        axis=1,
    )


def _darts(count: int, draw: np.random.Generator) -> Samples:
    """Points of the unit torus no two of which are nearer than a distance.

    It starts at 0.85 of a hexagonal packing's, and shrinks whenever darts find no room.
    """
    distance = 0.85 * math.sqrt(math.sqrt(4.0 / 3.0) / count)
    points = np.empty((count, 2))
    placed = failures = 0
    while placed < count:
        point = draw.random(2)
        away = np.abs(points[:placed] - point)
        away = np.minimum(away, 1.0 - away)
        if (away * away).sum(axis=1).min(initial=math.inf) >= distance * distance:
            points[placed] = point
            placed += 1
            failures = 0
            continue
        failures += 1
        if failures == FAILURES:
            distance *= 0.96
            failures = 0
    return points


def _count(count: int) -> int:
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= MAX_SAMPLES:
        raise InputError("samples", f"a whole number from 1 to {MAX_SAMPLES}", count)
    return count


def _seed(seed: int) -> int:
    if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
        raise InputError("seed", "a whole number of 0 or more", seed)
    return seed
