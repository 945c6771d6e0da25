"""What a run may leave out because it cannot change the result, and how to switch that off.

Every skip has a name here, a test that the result is the same bytes without it, and a count in
`RunReport.skipped`. The environment variable ``ADRET_SKIP`` set to ``none`` switches all of them
off; unset or ``all``, all are on.
"""

import os

from adret.errors import InputError

__all__ = ["SKIPS", "wanted"]

SKIPS: dict[str, str] = {
    "dark azimuths": "azimuths from which no light comes above any receiver's plane",
    "directions of empty receivers": "far-field directions of receivers that show no surface",
    "empty samples": "samples of swept lines where no line beside shows a surface",
    "ends of rays": "exact rays whose far end is too far away to rise above their horizon",
    "far edge": "receivers that not even the highest point of the raster's edge could raise",
    "far field": "receivers of azimuths whose far field cannot rise over the near horizon",
    "far fields of small radii": "far-field intervals where a radius is less than a pixel",
    "level ground": "receivers whose near field is level, in blocks: they see their own height",
    "nodata": "receivers without data, in blocks",
    "same azimuths": "azimuths given more than once",
}
"""Skip -> what is left out."""


def wanted(name: str) -> bool:
    """Whether a skip is on.

    Parameters
    ----------
    name : str
        One of `SKIPS`.

    Returns
    -------
    bool

    Raises
    ------
    InputError
        If ``ADRET_SKIP`` is neither "all" nor "none", or there is no such skip.

    Examples
    --------
    >>> wanted("far edge")
    True
    """
    if name not in SKIPS:
        raise InputError("skip", f"one of {', '.join(SKIPS)}", name)
    chosen = os.environ.get("ADRET_SKIP", "all")
    if chosen not in ("all", "none"):
        raise InputError("ADRET_SKIP", "all or none", chosen)
    return chosen == "all"
