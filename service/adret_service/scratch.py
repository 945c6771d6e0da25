"""How much work in progress lies on the scratch disk."""

import os
from pathlib import Path

__all__ = ["scratch_bytes"]


def scratch_bytes(folder: Path) -> int:
    """Return the bytes of all files below a folder; what vanishes meanwhile counts as nothing.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as place:
    ...     _ = (Path(place) / "a").write_bytes(b"123")
    ...     scratch_bytes(Path(place))
    3
    """
    total = 0
    for where, _, names in os.walk(folder):
        for name in names:
            try:
                total += os.lstat(os.path.join(where, name)).st_size
            except OSError:
                continue
    return total
