"""How steep the surface of a depth image is from pixel to pixel, apart from its steps."""

import numpy as np
from numpy.typing import NDArray

__all__ = ["steepness"]

Floats = NDArray[np.float64]


def steepness(depth: NDArray[np.float32], perspective: bool) -> NDArray[np.float32]:
    """Change of depth a pixel along the surface, rows and columns together.

    Parameters
    ----------
    depth : ndarray, shape (rows, columns), float32
        NaN at sky and holes.
    perspective : bool
        Whether 1/z is linear over a plane, or z.

    Returns
    -------
    ndarray, shape (rows, columns), float32
        Along each axis the smaller one of the changes to both neighbours, if they go the same way,
        else 0: a step does not count. Where one neighbour is missing, the change that a plane
        through the two pixels on the other side would have stands for it. 0 at sky and holes.

    Examples
    --------
    >>> ramp_and_step = np.array([[1.0, 2.0, 3.0, 9.0, 9.0]], dtype=np.float32)
    >>> steepness(ramp_and_step, False)
    array([[1., 1., 1., 0., 0.]], dtype=float32)
    """
    z = depth.astype(np.float64)
    total = _along_rows(z, perspective) + _along_rows(z.T, perspective).T
    return np.where(np.isnan(total), 0.0, total).astype(np.float32)


def _along_rows(z: Floats, perspective: bool) -> Floats:
    """The smaller change along each row."""
    padded = np.pad(z, ((0, 0), (2, 2)), constant_values=np.nan)
    far_left, left, right, far_right = (padded[:, k : k + z.shape[1]] for k in (0, 1, 3, 4))
    before = z - left
    after = right - z
    before_alone = _smaller(before, _continued(far_left, left, perspective) - left)
    after_alone = _smaller(after, right - _continued(far_right, right, perspective))
    both = _smaller(before, after)
    alone = np.where(np.isnan(before), after_alone, before_alone)
    found = np.where(np.isnan(before) | np.isnan(after), alone, both)
    return np.where(np.isnan(found), 0.0, found)


def _continued(a: Floats, b: Floats, perspective: bool) -> Floats:
    """Depth that a plane through two neighbouring pixels has at the next one."""
    if not perspective:
        return 2.0 * b - a
    with np.errstate(divide="ignore"):
        nearness = 2.0 / b - 1.0 / a
        return np.where(nearness <= 0.0, np.inf, 1.0 / nearness)


def _smaller(a: Floats, b: Floats) -> Floats:
    """The smaller size of two changes; 0 where they go different ways."""
    found = np.where(np.sign(a) == np.sign(b), np.minimum(np.abs(a), np.abs(b)), 0.0)
    return np.where(np.isnan(a) | np.isnan(b), np.nan, found)
