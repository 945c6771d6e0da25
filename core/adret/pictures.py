"""Reading colour pictures: PNG and JPEG, and pictures of radiance."""

import os
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from adret.environment_files import read_radiance
from adret.errors import RasterError

__all__ = ["read_picture"]

MAX_PIXELS = 1 << 26


def read_picture(path: str | os.PathLike[str], field: str = "picture") -> NDArray[np.float32]:
    """Read a picture as linear red, green and blue.

    Parameters
    ----------
    path : path-like
        An 8-bit .png or .jpg, taken as sRGB, or an .exr or .hdr; the format is told from the
        file's first bytes.
    field : str
        Name in the message.

    Returns
    -------
    ndarray, shape (rows, columns, 3), float32
        sRGB pictures go from 0 to 1; a grey one has three equal bands.

    Raises
    ------
    RasterError
        If the file is missing, of another kind, truncated, or larger than 2^26 pixels.
    """
    file = Path(path)
    try:
        with file.open("rb") as stream:
            start = stream.read(8)
    except OSError as error:
        limit = f"a file that can be read ({error.strerror})"
        raise RasterError(field, limit, os.fspath(path)) from None
    except ValueError:  # a NUL in the name
        raise RasterError(field, "the path of a file", os.fspath(path)) from None
    if start.startswith((b"\x89PNG", b"\xff\xd8\xff")):
        return linear(_decoded(file, field))
    try:
        radiance = read_radiance(file)
    except RasterError as error:
        raise RasterError(
            field, error.limit.replace("a .hdr", "a .png, .jpg, .hdr"), file.name
        ) from None
    return np.broadcast_to(radiance, (*radiance.shape[:2], 3)).astype(np.float32)


def linear(srgb: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Undo the transfer curve of sRGB (IEC 61966-2-1): 0..255 to 0..1."""
    value = np.arange(256) / 255.0
    curve = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    return curve.astype(np.float32)[srgb]


def _decoded(file: Path, field: str) -> NDArray[np.uint8]:
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(file, formats=("PNG", "JPEG")) as image:
                if image.width * image.height > MAX_PIXELS:
                    size = f"{image.width} x {image.height}"
                    raise RasterError(field, f"at most {MAX_PIXELS} pixels", size)
                return np.asarray(image.convert("RGB"))
    except (OSError, ValueError, SyntaxError, UnidentifiedImageError, Image.DecompressionBombError):
        raise RasterError(field, "a picture that can be decoded", file.name) from None
