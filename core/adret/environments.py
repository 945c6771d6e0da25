"""Environment maps: pictures of the light that comes from all around."""

import os
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adret._values import file_path, real, whole
from adret.environment_files import read_radiance
from adret.errors import InputError, RasterError
from adret.slices import LightSlice, NormalTableSlice, TableSlice

__all__ = ["Environment"]

MIN_ELEVATION_STEPS = 512
MAX_NORMAL_ANGLES = 1024
FACES = ("px", "nx", "py", "ny", "pz", "nz")
FACE_ENDINGS = (".hdr", ".exr", ".npy")
# Resampling a cube map: samples a side in each pixel of the new picture.
CUBE_SAMPLES = 4


class Environment:
    """Light from a picture of radiance over the whole sphere, one or three bands.

    Parameters
    ----------
    radiance : array_like, shape (rows, columns[, 1 or 3])
        Equirectangular radiance [any unit U]; irradiance then comes in U sr. Finite; the small
        negative values that lossy compression leaves are kept.
    rotation_deg : float, optional
        Turns the picture clockwise, seen from above [degrees].
    normal_angles : int, optional
        Light by paper P1's own table L_p(normal angle, horizon angle) with this many normal
        angles from -90° to 90°, 3 to 1024; with an odd number an upright normal is exact. Default
        is the moments form, which needs no normal angles and has no such error.

    Raises
    ------
    InputError
        If a shape, a number or a value is not usable.

    Notes
    -----
    Row 0 holds the zenith and the last row the nadir. In the y-up frame of the picture
    (east = x, up = y, north = -z) the column position is u = atan2(z, x)/(2π) + 1/2: the left edge
    looks west, columns run clockwise over north (u = 1/4), east (1/2) and south (3/4).

    A slice of the sky holds every pixel of its swath of azimuths, pixels at its borders by the
    share that lies inside. Its horizon is taken at the azimuth of its light (the mean direction of
    what comes from above the horizontal), so that a sun in the picture casts its shadow where it
    should; in even light that is the middle of the swath. Walls that face the horizon are then lit
    within 0.25 % at 64 azimuths in five measured maps; with swaths about fixed azimuths a wall that
    faces a low sun was off by 3.7 %.

    The moments A(e) and B(e) are exact at the borders of the map's rows (at least 512 steps from
    nadir to zenith) and linear in between. Light from below the horizontal counts where a cell can
    see it: over a cliff, or on a slope that looks down.

    Between tabulated normals, paper P1 interpolates linearly. Done in the angle, the mean error
    against 256 normal angles is 1.6 % with 8 and 0.35 % with 16 (Alps at 200 m, 32 azimuths, a hall
    with daylight windows), because the cosine bends too much. Here the normal itself is
    interpolated, as the sum of the two beside it: 0.09 % and 0.014 %; the paper has 0.16 % and
    0.03 %. Only the cut at the cell's own plane stays approximate; maps with a sun have 0.2 % and
    0.04 % (high sun) to 1.6 % and 0.18 % (a low sun with half of the light). The moments form is
    within 0.001 % of the table's limit, and three times quicker.

    Examples
    --------
    >>> import numpy as np, adret
    >>> white = adret.Environment(np.ones((8, 16)))
    >>> flat = adret.Terrain(np.zeros((3, 3)), (1.0, 1.0))
    >>> round(float(adret.direct_light(flat, white).irradiance[1, 1]), 4)
    3.1416
    """

    def __init__(
        self,
        radiance: ArrayLike,
        *,
        rotation_deg: float = 0.0,
        normal_angles: int | None = None,
    ) -> None:
        picture = _checked_picture(radiance)
        rotation = real("rotation_deg", rotation_deg, "a finite number")
        if normal_angles is not None:
            limit = f"a whole number from 3 to {MAX_NORMAL_ANGLES}"
            normal_angles = whole("normal_angles", normal_angles, limit, 3, MAX_NORMAL_ANGLES)
        self._picture = picture
        self._rotation = float(np.radians(np.fmod(rotation, 360.0)))
        self._normal_angles = normal_angles

    @classmethod
    def open(
        cls,
        path: str | os.PathLike[str],
        *,
        rotation_deg: float = 0.0,
        normal_angles: int | None = None,
    ) -> Self:
        """Read an equirectangular .hdr, .exr or .npy file, or a folder with a cube map.

        Parameters
        ----------
        path : path-like
            A file, or a folder with the six square faces px, nx, py, ny, pz, nz (.hdr, .exr or
            .npy) in OpenGL orientation.
        rotation_deg, normal_angles
            As for `Environment`.

        Returns
        -------
        Environment

        Raises
        ------
        RasterError
            If a file is missing, of another kind, damaged or too large.

        Notes
        -----
        A cube map is resampled to an equirectangular picture of four times its side, 4 x 4
        samples a pixel.

        Examples
        --------
        >>> import numpy as np, pathlib, tempfile
        >>> folder = tempfile.TemporaryDirectory()
        >>> file = pathlib.Path(folder.name, "grey.npy")
        >>> np.save(file, np.full((16, 32, 3), 0.5, dtype=np.float32))
        >>> Environment.open(file).bands
        3
        >>> folder.cleanup()
        """
        place = Path(file_path("environment", path))
        picture = _read_cube(place) if place.is_dir() else read_radiance(place)
        if not np.isfinite(picture).all():
            raise RasterError("environment", "finite radiance in every pixel", place.name)
        return cls(picture, rotation_deg=rotation_deg, normal_angles=normal_angles)

    @property
    def bands(self) -> int:
        """1, or 3 for red, green, blue."""
        return int(self._picture.shape[2])

    @property
    def radiance(self) -> NDArray[np.float32]:
        """The equirectangular picture (rows, columns, bands), as read, before the rotation."""
        return self._picture

    def slices(self, directions: int) -> list[LightSlice]:
        """Cut the picture into `directions` equal swaths of azimuth, the first one about north."""
        rows = len(self._picture)
        split = -(-MIN_ELEVATION_STEPS // rows)
        steps = rows * split
        entries = np.linspace(-np.pi / 2.0, np.pi / 2.0, steps + 1)
        # Integrals of cos² and of sin cos between neighbouring entries.
        horizontal = np.diff(entries + np.sin(entries) * np.cos(entries)) / 2.0
        vertical = np.diff(np.sin(entries) ** 2) / 2.0
        swaths, aside = self._swaths(directions, horizontal.reshape(rows, split).sum(axis=1))
        azimuths = 2.0 * np.pi / directions * np.arange(directions) + aside
        slices: list[LightSlice] = []
        for swath, azimuth in zip(swaths, azimuths.tolist(), strict=True):
            radiance = np.repeat(swath, split, axis=1)
            moments = TableSlice(
                azimuth % (2.0 * np.pi),
                -np.pi / 2.0,
                np.pi / steps,
                _sum_from_above(radiance * horizontal),
                _sum_from_above(radiance * vertical),
            )
            if self._normal_angles is None:
                slices.append(moments)
            else:
                slices.append(NormalTableSlice(moments, self._normal_angles))
        return slices

    def _swaths(
        self, directions: int, weight: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Integral of radiance over each swath's azimuths, and where in the swath its light is.

        Returns (directions, bands, rows), rows from the nadir up [radiance · rad], and the azimuth
        of the light above the horizontal off the swath's middle, (directions,) [radians]; `weight`
        is that of the rows in the second.
        """
        rows, columns, bands = self._picture.shape
        width = 2.0 * np.pi / columns
        swath = 2.0 * np.pi / directions
        borders = (np.arange(directions + 1) - 0.5) * swath
        # Azimuth = 2π u - π/2 + rotation.
        position = (borders + np.pi / 2.0 - self._rotation) / width
        # Cut the pixels at the borders: each fragment lies in one pixel and in one swath.
        pixels = np.arange(np.floor(position[0]) + 1.0, position[-1])
        edges = np.sort(np.concatenate([position, pixels]))
        pixel = np.floor((edges[:-1] + edges[1:]) / 2.0).astype(np.int64) % columns
        starts = np.searchsorted(edges, position[:-1])
        middle = np.repeat((position[:-1] + position[1:]) / 2.0, np.diff(starts, append=len(pixel)))
        size = np.diff(edges) * width
        offset = ((edges[:-1] + edges[1:]) / 2.0 - middle) * width
        inside = np.stack([size, size * np.sin(offset), size * np.cos(offset)], axis=1)

        swaths = np.empty((directions, bands, rows))
        sine, cosine = np.zeros(directions), np.zeros(directions)
        for row in range(rows):
            up = rows - 1 - row
            light = self._picture[row, pixel].astype(np.float64)
            swaths[:, :, up] = np.add.reduceat(light * inside[:, :1], starts, axis=0)
            if row < rows / 2:
                both = np.add.reduceat(light.sum(axis=1)[:, None] * inside[:, 1:], starts, axis=0)
                sine += weight[up] * both[:, 0]
                cosine += weight[up] * both[:, 1]
        aside = np.arctan2(sine, cosine)
        return swaths, np.clip(aside, -swath / 2.0, swath / 2.0)


def _sum_from_above(steps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sums from each entry to the zenith, with the zenith's 0 at the end."""
    bands, count = steps.shape
    total = np.zeros((bands, count + 1))
    total[:, :-1] = np.cumsum(steps[:, ::-1], axis=1)[:, ::-1]
    return total


def _checked_picture(radiance: Any) -> NDArray[np.float32]:
    picture = np.asarray(radiance)
    if picture.dtype.kind not in "iuf":
        raise InputError("radiance", "real numbers", str(picture.dtype))
    if picture.ndim == 2:
        picture = picture[:, :, None]
    if picture.ndim != 3 or picture.shape[2] not in (1, 3) or 0 in picture.shape:
        raise InputError("radiance", "of shape (rows, columns[, 1 or 3])", picture.shape)
    copy = np.array(picture, dtype=np.float32, order="C")
    if not np.isfinite(copy).all():
        raise InputError("radiance", "finite", copy[~np.isfinite(copy)][0])
    copy.setflags(write=False)
    return copy


def _read_cube(folder: Path) -> NDArray[np.float32]:
    faces = []
    for name in FACES:
        found = [f for f in (folder / (name + e) for e in FACE_ENDINGS) if f.is_file()]
        if len(found) != 1:
            limit = f"one of {', '.join(name + e for e in FACE_ENDINGS)} in the folder"
            raise RasterError("environment", limit, [f.name for f in found])
        faces.append(read_radiance(found[0]))
    side = faces[0].shape[0]
    for name, face in zip(FACES, faces, strict=True):
        if face.shape != (side, side, faces[0].shape[2]):
            raise RasterError(f"environment face {name}", "square and as the first", face.shape)
    return _unfold(np.stack(faces))


def _unfold(faces: NDArray[np.float32]) -> NDArray[np.float32]:
    """Equirectangular picture (2 side, 4 side, bands) of cube faces (6, side, side, bands)."""
    side, bands = faces.shape[1], faces.shape[3]
    rows, columns, n = 2 * side, 4 * side, CUBE_SAMPLES
    around = 2.0 * np.pi * ((np.arange(columns * n) + 0.5) / (columns * n) - 0.5)
    along, across = np.cos(around), np.sin(around)
    picture = np.zeros((rows, columns, bands), dtype=np.float32)
    for row in range(rows):
        polar = (row + (np.arange(n) + 0.5) / n) * (np.pi / rows)
        weight = np.sin(polar) / np.sin(polar).sum()
        for angle, share in zip(polar, weight, strict=True):
            x, z = np.sin(angle) * along, np.sin(angle) * across
            seen = _look_up(faces, x, np.full_like(x, np.cos(angle)), z)
            mean = seen.reshape(columns, n, bands).mean(axis=1)
            picture[row] += (share * mean).astype(np.float32)
    return picture


def _look_up(
    faces: NDArray[np.float32],
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    z: NDArray[np.float64],
) -> NDArray[np.float32]:
    """Pixel of the cube in each direction (x, y up, z)."""
    side = faces.shape[1]
    size = np.abs(np.stack([x, y, z]))
    axis = size.argmax(axis=0)
    negative = np.choose(axis, [x < 0.0, y < 0.0, z < 0.0])
    length = size.max(axis=0)
    # Right and down on each face: px (-z, -y), nx (z, -y), py (x, z), ny (x, -z), pz (x, -y), ...
    right = np.choose(2 * axis + negative, [-z, z, x, x, x, -x]) / length
    down = np.choose(2 * axis + negative, [-y, -y, z, -z, -y, -y]) / length
    column = np.minimum(((right + 1.0) * 0.5 * side).astype(np.int64), side - 1)
    row = np.minimum(((down + 1.0) * 0.5 * side).astype(np.int64), side - 1)
    return np.asarray(faces[2 * axis + negative, row, column])
