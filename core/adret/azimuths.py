"""Sets of azimuths, in radians clockwise from north."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adret.errors import InputError

__all__ = ["MAX_DIRECTIONS", "azimuth_set"]

MAX_DIRECTIONS = 7200


def azimuth_set(directions: int = 64, azimuths: ArrayLike | None = None) -> NDArray[np.float64]:
    """Equally spaced azimuths from north, or the given ones folded into [0, 2π).

    Parameters
    ----------
    directions : int
        Number of azimuths K, 1 to 7200; ignored when `azimuths` is given.
    azimuths : array_like, shape (K,), optional
        Azimuths [radians clockwise from north] to use as they are.

    Returns
    -------
    ndarray, shape (K,), float64
        Azimuths [radians], in [0, 2π).

    Raises
    ------
    InputError
        If the count is out of range or an azimuth is not finite.

    Examples
    --------
    >>> azimuth_set(4)
    array([0.        , 1.57079633, 3.14159265, 4.71238898])
    """
    if azimuths is None:
        limit = f"a whole number from 1 to {MAX_DIRECTIONS}"
        if isinstance(directions, bool) or not isinstance(directions, int | np.integer):
            raise InputError("directions", limit, directions)
        if not 1 <= directions <= MAX_DIRECTIONS:
            raise InputError("directions", limit, int(directions))
        return np.arange(directions, dtype=np.float64) * (2.0 * np.pi / int(directions))
    try:
        given = np.atleast_1d(np.asarray(azimuths, dtype=np.float64))
    except (TypeError, ValueError, OverflowError):
        raise InputError("azimuths", "a list of real numbers", azimuths) from None
    if given.ndim != 1 or not 1 <= given.size <= MAX_DIRECTIONS:
        raise InputError(
            "azimuths", f"a list of 1 to {MAX_DIRECTIONS} numbers", f"shape {given.shape}"
        )
    if not np.isfinite(given).all():
        raise InputError("azimuths", "finite numbers", float(given[~np.isfinite(given)][0]))
    folded = np.mod(given, 2.0 * np.pi)
    folded[folded >= 2.0 * np.pi] = 0.0
    return folded
