"""The four kinds of height field on which paper P2 measures, and its random one; always the same.

The paper shows pictures of its fields (figure 7), not their recipes; these come near its numbers of
visible points and horizons (tables 1 and 2). What is visible stays so when all heights are
multiplied by a number.  Shares no code with adret.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def fractal_terrain(size: int = 1024, seed: int = 1) -> Array:
    """Each doubling adds points between the others, moved by half as much as the ones before."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(-1.0, 1.0, (5, 5))
    reach = 0.5
    while z.shape[0] - 1 < size:
        n = 2 * z.shape[0] - 1
        finer = np.empty((n, n))
        finer[::2, ::2] = z
        finer[1::2, ::2] = 0.5 * (z[1:] + z[:-1])
        finer[:, 1::2] = 0.5 * (finer[:, 2::2] + finer[:, :-1:2])
        moved = rng.uniform(-reach, reach, (n, n))
        moved[::2, ::2] = 0.0
        z = finer + moved
        reach *= 0.5
    return z[:size, :size]


def random_heights(size: int = 1024, seed: int = 2) -> Array:
    """A height of its own for every cell, from one finite range."""
    return np.random.default_rng(seed).uniform(0.0, 1.0, (size, size))


def brick_surface(size: int = 1024, seed: int = 3) -> Array:
    """Courses of bricks between mortar grooves, each with a tilt, a height and a worn face."""
    rng = np.random.default_rng(seed)
    i, j = np.mgrid[0:size, 0:size].astype(np.float64)
    length, course = 64.0, 32.0
    row = np.floor(i / course).astype(int)
    along = j + 0.5 * length * (row % 2)
    column = np.floor(along / length).astype(int)
    bricks = (int(row.max()) + 1, int(column.max()) + 1)
    lift = rng.uniform(-1.0, 1.0, bricks)[row, column]
    tilt_x, tilt_y = rng.uniform(-1.0, 1.0, (2, *bricks))[:, row, column]
    x = along / length % 1.0 - 0.5
    y = i / course % 1.0 - 0.5
    to_edge = np.minimum((0.5 - abs(x)) * length, (0.5 - abs(y)) * course)
    wave = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None, :])
    wave[0, 0] = np.inf
    noise = np.fft.rfft2(rng.normal(size=(size, size)))
    face = np.fft.irfft2(noise / wave**2.5 * (wave > 1.0 / 64.0), s=(size, size))
    face = lift + tilt_x * x + tilt_y * y + face / face.std()
    mortar = np.clip((3.0 - to_edge) / 2.0, 0.0, 1.0)
    return face * (1.0 - mortar) - 6.0 * mortar


def sine_grid(size: int = 1024, period: float = 64.0) -> Array:
    """Equal domes on a square grid."""
    wave = np.sin(np.arange(size) * (2.0 * np.pi / period))
    return wave[:, None] + wave[None, :]


def blocks(size: int = 1024, width: int = 8, seed: int = 4) -> Array:
    """Square blocks of random heights with flat tops."""
    count = -(-size // width)
    tops = np.random.default_rng(seed).uniform(0.0, 1.0, (count, count))
    return np.kron(tops, np.ones((width, width)))[:size, :size]


KINDS: dict[str, Callable[[int], Array]] = {
    "fractal terrain": fractal_terrain,
    "brick surface": brick_surface,
    "sine grid": sine_grid,
    "blocks": blocks,
}
