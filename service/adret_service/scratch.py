"""How much work in progress lies on the scratch disk."""

import os
import time
from pathlib import Path

__all__ = ["scratch_bytes"]

_seen: dict[Path, tuple[float, int]] = {}


def scratch_bytes(folder: Path, *, fresh: float = 0.0) -> int:
    """Return the bytes of all files below a folder; what vanishes meanwhile counts as nothing.

    Parameters
    ----------
    folder : Path
        Where to look.
    fresh : float
        Seconds for which an earlier answer will do.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as place:
    ...     _ = (Path(place) / "a").write_bytes(b"123")
    ...     scratch_bytes(Path(place))
    3
    """
    at, known = _seen.get(folder, (-1e9, 0))
    if time.monotonic() - at < fresh:
        return known
    total = 0
    for where, _, names in os.walk(folder):
        for name in names:
            try:
                total += os.lstat(os.path.join(where, name)).st_size
            except OSError:
                continue
    _seen[folder] = time.monotonic(), total
    return total
