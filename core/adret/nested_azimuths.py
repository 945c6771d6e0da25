"""Azimuth sets that are doubled until the result hardly changes: ``directions="auto"``.

Sets of 8, 16, 32, ... azimuths are nested: each holds the one before, so only the azimuths between
are swept. The mean of |change| from one set to the next is measured over all cells. It is an
estimate of the error of the coarser one of the two; the finer one, which is returned, errs less.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adret._values import real
from adret.azimuths import azimuth_set
from adret.errors import InputError
from adret.report import RunReport, remember

__all__ = [
    "FIRST",
    "TOLERANCE",
    "Directions",
    "Settled",
    "automatic",
    "between",
    "report_of",
    "settled",
]

Directions = int | Literal["auto"]

FIRST = 8
LAST = 1024
TOLERANCE = 0.002
"""Mean of |change| that ends the doubling, as a share of the full scale."""


class Settled(NamedTuple):
    """The mean over the azimuths of the last set, how many those are, and the last change."""

    mean: NDArray[np.float64]
    directions: int
    change: float


def automatic(directions: Any, tolerance: float | None) -> float | None:
    """Tolerance of ``directions="auto"``; None where the number of azimuths is given.

    Raises
    ------
    InputError
        If `directions` is another word, or a tolerance is given with a number of azimuths or is
        not between 0 and 1.
    """
    if isinstance(directions, str):
        if directions != "auto":
            raise InputError("directions", "a whole number or 'auto'", directions)
        if tolerance is None:
            return TOLERANCE
        return real("tolerance", tolerance, "a share between 0 and 1", 0.0, 1.0)
    if tolerance is not None:
        raise InputError("tolerance", "left out unless directions is 'auto'", tolerance)
    return None


def between(count: int) -> NDArray[np.float64]:
    """The azimuths [radians] of the set of 2·`count` that are not in that of `count`."""
    return azimuth_set(2 * count)[1::2]


def settled(
    sums: Callable[[int, bool], NDArray[Any]],
    tolerance: float,
    scale: float | None,
    *,
    nested: bool = True,
) -> Settled:
    """Double the azimuths until the mean changes by no more than `tolerance`.

    Parameters
    ----------
    sums : callable
        sums(count, all): sum over the azimuths of the set of `count`, or, unless `all`, over those
        that the set of half as many has not.
    tolerance : float
        As a share of the scale.
    scale : float or None
        What the change is measured by; None for the mean itself.
    nested : bool
        False where `sums` always gives the sum over the whole set.

    Returns
    -------
    Settled
        After 1024 azimuths at most.
    """
    count = FIRST
    total = np.asarray(sums(count, True), np.float64)
    while True:
        finer = sums(2 * count, False) + (total if nested else 0.0)
        there = np.isfinite(finer)
        change = float(np.abs(finer / (2 * count) - total / count).mean(where=there))
        size = scale if scale is not None else float(finer.mean(where=there)) / (2 * count)
        total, count = finer, 2 * count
        change = change / size if size > 0.0 else change
        if change <= tolerance or count >= LAST:
            return Settled(total / count, count, change)


def report_of(reports: Sequence[RunReport], found: Settled) -> RunReport:
    """One report of the sweeps of all sets, kept as the latest run's."""
    names = {name for each in reports for name in each.skipped}
    return remember(
        replace(
            reports[-1],
            azimuths_swept=sum(each.azimuths_swept for each in reports),
            azimuths_skipped=sum(each.azimuths_skipped for each in reports),
            seconds=sum(each.seconds for each in reports),
            skipped={name: sum(each.skipped.get(name, 0) for each in reports) for name in names},
            directions=found.directions,
            change=found.change,
        )
    )
