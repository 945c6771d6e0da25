"""GDAL's settings for files that nobody vouches for, and checks of paths before GDAL sees them.

Every raster that Adret opens or writes goes through these. Sidecar files are ignored: an
``.aux.xml`` (GDAL's persistent auxiliary metadata), ``.ovr``, ``.msk`` or world file beside a
raster is never read.
"""

import contextlib
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from adret._values import file_path
from adret.errors import RasterError

__all__ = ["GDAL_OPTIONS", "PathLike", "atomic", "check_output", "sniff_driver"]

PathLike = str | os.PathLike[str]

GDAL_OPTIONS: dict[str, Any] = {
    "GDAL_DISABLE_READDIR_ON_OPEN": "EMPTY_DIR",
    "GDAL_PAM_ENABLED": "NO",
    "USE_RRD": "NO",
    "GDAL_VRT_ENABLE_PYTHON": "NO",
    "GDAL_GEOREF_SOURCES": "INTERNAL",
    "GDAL_TIFF_INTERNAL_MASK": "YES",
    "CPL_VSIL_CURL_ALLOWED_FILENAME": "/vsicurl/none",
    "PROJ_NETWORK": "OFF",
    "GDAL_CACHEMAX": 256,
}
"""GDAL's settings for every file that Adret opens or writes."""


def sniff_driver(path: PathLike, field: str = "path") -> tuple[str, str]:
    """Return the absolute path and the one GDAL driver that the file's first bytes allow.

    Raises
    ------
    RasterError
        If the file is missing, is no regular file, or is neither GeoTIFF, Arc/Info ASCII grid
        nor PNG (VRT and other texts that make GDAL open further files are refused here).
    """
    given = file_path(field, path)
    _refuse_virtual(given, field)
    absolute = os.path.abspath(given)
    try:
        status = os.stat(absolute)
        if not stat.S_ISREG(status.st_mode):
            raise RasterError(field, "a regular file", given)
        if status.st_size == 0:
            raise RasterError(field, "a raster file that is not empty", given)
        with open(absolute, "rb") as file:
            head = file.read(512)
    except FileNotFoundError:
        raise RasterError(field, "an existing file", given) from None
    except OSError as error:
        raise RasterError(field, f"a readable file ({error.strerror})", given) from None
    if head[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
        return absolute, "GTiff"
    if head.startswith(b"\x89PNG\r\n\x1a\n"):
        return absolute, "PNG"
    if head.lstrip()[:5].lower() in (b"ncols", b"nrows"):
        return absolute, "AAIGrid"
    raise RasterError(field, "a GeoTIFF, an Arc/Info ASCII grid or a PNG", given)


def check_output(
    path: PathLike,
    *,
    field: str = "out",
    overwrite: bool = False,
    inputs: tuple[PathLike, ...] = (),
) -> Path:
    """Return the absolute path of a file that may be written there.

    Parameters
    ----------
    path : path-like
        Where the file is to go.
    field : str
        Name in the message.
    overwrite : bool
        Whether a file that exists may be replaced.
    inputs : tuple of path-like
        Files that the output must not be.

    Raises
    ------
    RasterError
        If the folder is missing or not writable, if the file exists and `overwrite` is false, if
        it is no regular file (it would be replaced, not written to), or one of the inputs.
    """
    given = os.fspath(path)
    _refuse_virtual(given, field)
    absolute = Path(os.path.abspath(given))
    if any(
        os.path.exists(other) and absolute.exists() and os.path.samefile(other, absolute)
        for other in inputs
    ):
        raise RasterError(field, "another file than the input", given)
    if absolute.is_dir():
        raise RasterError(field, "a file name, not a folder", given)
    if absolute.exists() and not absolute.is_file():
        raise RasterError(field, "a regular file, not a device, pipe or socket", given)
    if not absolute.parent.is_dir():
        raise RasterError(field, "in a folder that exists", given)
    if not os.access(absolute.parent, os.W_OK | os.X_OK):
        raise RasterError(field, "in a folder that can be written", given)
    if absolute.exists() and not overwrite:
        raise RasterError(field, "a new file (or ask to overwrite)", given)
    return absolute


@contextlib.contextmanager
def atomic(path: PathLike) -> Iterator[Path]:
    """Give a path to write to; it becomes `path` when the block ends well, else nothing stays.

    The file is written in a private folder beside its destination, so that the last step is one
    rename and GDAL's own temporary files vanish with the folder.

    Examples
    --------
    >>> import tempfile
    >>> target = Path(tempfile.mkdtemp()) / "a.txt"
    >>> with atomic(target) as unfinished:
    ...     _ = unfinished.write_text("done")
    >>> target.read_text()
    'done'
    """
    target = Path(os.path.abspath(path))
    folder = Path(tempfile.mkdtemp(prefix=".adret-", dir=target.parent))
    try:
        unfinished = folder / target.name
        yield unfinished
        os.replace(unfinished, target)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _refuse_virtual(given: str, field: str) -> None:
    if "://" in given or "\0" in given or os.path.abspath(given).startswith("/vsi"):
        raise RasterError(field, "a plain file path (no URL, no /vsi path)", given)
