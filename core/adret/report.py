"""What a run did and what it could skip."""

from collections.abc import Mapping
from contextvars import ContextVar
from dataclasses import dataclass, field

__all__ = ["RunReport", "last_run_report"]


@dataclass(frozen=True, slots=True, kw_only=True)
class RunReport:
    """Work done and work skipped by one run.

    Attributes
    ----------
    method : str
        Horizon method.
    near : int
        Radius of the exact near field [cells]; 0 for methods without one.
    azimuths_swept, azimuths_skipped : int
        Azimuths that were computed, and that the light or the sun did not need.
    cells, cells_skipped : int
        Receivers in the raster, and those left out because they are nodata.
    bands : int
        Latitude bands of a geographic raster; 1 for a projected one.
    seconds : float
        Wall time [s].
    expected_error_deg : float or None
        Mean error of the horizons to expect [degrees], where one was asked for.
    directions : int or None
        Number of azimuths that ``directions="auto"`` chose.
    change : float or None
        Mean of |change| when they were last doubled, as a share of the scale.
    skipped : mapping
        Receivers or azimuths left out because they cannot matter, by the names of `skips.SKIPS`.
    """

    method: str
    near: int
    azimuths_swept: int
    azimuths_skipped: int
    cells: int
    cells_skipped: int
    bands: int
    seconds: float
    expected_error_deg: float | None = None
    directions: int | None = None
    change: float | None = None
    skipped: Mapping[str, int] = field(default_factory=dict)


_last: ContextVar[RunReport | None] = ContextVar("adret_last_run_report", default=None)


def last_run_report() -> RunReport | None:
    """Return the report of this thread's (or task's) latest run; None before the first.

    Examples
    --------
    >>> import numpy as np, adret
    >>> _ = adret.sky_view_factor(adret.Terrain(np.zeros((4, 4)), (1, 1)), directions=8)
    >>> adret.last_run_report().azimuths_swept
    8
    """
    return _last.get()


def remember(report: RunReport) -> RunReport:
    """Store `report` as the latest run's and return it."""
    _last.set(report)
    return report
