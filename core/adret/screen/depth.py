"""Depth buffers: checked once, masked, and turned into what the methods take."""

import os
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from adret.errors import InputError
from adret.screen.camera import Camera
from adret.screen.field import Field

if TYPE_CHECKING:
    from adret.terrain import Terrain

__all__ = ["DepthBuffer", "DepthKind", "DepthPrecisionWarning"]

DepthKind = Literal["linear", "distance", "device"]
KINDS = ("linear", "distance", "device")
MAX_PIXELS = 1 << 27
GuardBand = int | tuple[int, int, int, int]


class DepthPrecisionWarning(UserWarning):
    """The steps of the stored depth are too coarse for the radius that was asked for."""


class DepthBuffer:
    """Depths of an image with the camera that saw them.

    Parameters
    ----------
    depth : array_like, shape (rows, columns) or (samples, rows, columns), real
        Depth of every pixel. Of several samples a pixel the first one is estimated; the
        others are kept in `samples`. The array is copied, never changed.
    camera : Camera
        Its `width` and `height` are columns and rows.
    kind : str
        "linear" along the viewing axis [view units]; "distance" along the ray [view units];
        "device" as stored by a renderer (see `Camera`), whole numbers being shares of their
        type's largest.
    scale : float
        View units in one unit of `depth`, for "linear" and "distance".
    guard_band : int or (int, int, int, int)
        Pixels, or (top, right, bottom, left), that occlude but do not receive.
    normals : array_like, shape (3, rows, columns), optional
        Normals in view space (right, up, back), or (right, up, forward) for a left-handed
        camera. Those that face away are bent until they just face the eye; zeros and NaN are
        rebuilt. Default: rebuilt from depth (see `view_normals`).
    sky : array_like, shape (rows, columns), bool, optional
        Pixels that show no surface, besides those that depth itself shows.
    hole : float, optional
        Stored value that means "no measurement", besides NaN (0 for most RGB-D sensors).
    second_layer : array_like, shape (rows, columns), optional
        Depth of the next surface behind the first, stored the same way; sky where there is none.

    Raises
    ------
    InputError
        If shapes do not fit each other, a value is out of range, or nothing is left to receive.

    Notes
    -----
    *Sky*: plus infinity, at or behind the far plane, zero or negative, or masked by `sky`. It
    neither receives nor occludes: occlusion 0, confidence 0. *Hole*: NaN or `hole`. It is unknown,
    neither receives nor occludes, and its occlusion is NaN.
    Between pixel centres the surface is bilinear in 1/z (perspective) or in z (orthographic).

    Examples
    --------
    >>> import numpy as np
    >>> from adret import Camera
    >>> camera = Camera.perspective(3, 2, fov_y_deg=60.0)
    >>> buffer = DepthBuffer([[1.0, 2.0, np.inf], [1.5, np.nan, -1.0]], camera)
    >>> int(buffer.sky.sum()), int(buffer.holes.sum())
    (2, 1)
    """

    def __init__(
        self,
        depth: ArrayLike,
        camera: Camera,
        *,
        kind: DepthKind = "linear",
        scale: float = 1.0,
        guard_band: GuardBand = 0,
        normals: ArrayLike | None = None,
        sky: ArrayLike | None = None,
        hole: float | None = None,
        second_layer: ArrayLike | None = None,
    ) -> None:
        if not isinstance(camera, Camera):
            raise InputError("camera", "a Camera", type(camera).__name__)
        if kind not in KINDS:
            raise InputError("kind", f"one of {', '.join(KINDS)}", kind)
        if not (isinstance(scale, int | float) and 0.0 < scale < np.inf):
            raise InputError("scale", "a number above 0", scale)
        self._camera = camera
        self._kind: DepthKind = kind
        self._scale = float(scale)
        stored = _real("depth", depth)
        if stored.ndim not in (2, 3) or stored.shape[-2:] != (camera.height, camera.width):
            limit = f"of shape ([samples, ]{camera.height}, {camera.width}), as the camera has it"
            raise InputError("depth", limit, stored.shape)
        if stored.ndim == 3 and not 1 <= len(stored) <= 64:
            raise InputError("depth", "1 to 64 samples a pixel", len(stored))
        self._dtype = stored.dtype
        samples = stored if stored.ndim == 3 else stored[None]
        masked = np.zeros(self.shape, dtype=bool)
        if sky is not None:
            masked = np.asarray(sky)
            if masked.dtype != np.bool_ or masked.shape != self.shape:
                limit = f"bool of shape {self.shape}"
                raise InputError("sky", limit, f"{masked.dtype} of shape {masked.shape}")
        linear, skies, holes = zip(*(self._linear(each, hole) for each in samples), strict=True)
        self._sky = _frozen(skies[0] | (masked & ~holes[0]))
        self._holes = _frozen(holes[0])
        self._depth = _frozen(np.where(self._sky, np.float32(np.nan), linear[0]))
        self._samples = None
        if stored.ndim == 3:
            self._samples = _frozen(np.stack([*linear]))
            self._samples.setflags(write=True)
            self._samples[0] = self._depth
            self._samples.setflags(write=False)
        self._second = None
        if second_layer is not None:
            behind = _real("second_layer", second_layer)
            if behind.shape != self.shape:
                raise InputError("second_layer", f"of shape {self.shape}", behind.shape)
            self._second = _frozen(self._linear(behind, hole)[0])
            if (self._second < self._depth).any():
                at = np.argwhere(self._second < self._depth)[0]
                raise InputError("second_layer", "behind the first", f"before it at {tuple(at)}")
        self._guard_band = _checked_band(guard_band, self.shape)
        self._given = None if normals is None else _real("normals", normals)
        if self._given is not None and self._given.shape != (3, *self.shape):
            raise InputError("normals", f"of shape {(3, *self.shape)}", self._given.shape)

    @classmethod
    def open(
        cls,
        path: str | os.PathLike[str],
        camera: "Camera | str | os.PathLike[str]",
        **options: Any,
    ) -> Self:
        """Read a depth buffer from a file.

        Parameters
        ----------
        path : path-like
            .npy, .npz (the member "depth", or the only one), .tif, .exr (half or single precision;
            the channel "Z", "depth" or "Y", or the only one) or a 16-bit .png; told by content.
        camera : Camera or path-like
            The camera, or a JSON file of it (`Camera.from_mapping` lists its members). From that
            file also come, where it has them, `kind`, `scale`, `hole` and `guard_band` (or
            ``guard_band_px``, or ``frame`` with x0, y0, width and height).
        **options
            As for `DepthBuffer`; they go before what the file says.

        Raises
        ------
        RasterError
            If the file is missing, unknown, truncated or too large; an 8-bit image has too few
            steps for depth.
        """
        from adret.screen.depth_files import described, read_depth

        if isinstance(camera, Camera):
            return cls(read_depth(path), camera, **options)
        found, said = described(camera)
        return cls(read_depth(path), found, **{**said, **options})

    @classmethod
    def from_terrain(cls, terrain: "Terrain", *, guard_band: GuardBand = 0) -> Self:
        """A terrain seen from straight above: right is east, up is north, back is up.

        The eye is one cell above the highest point; view units are metres, nodata are holes.

        Examples
        --------
        >>> import numpy as np, adret
        >>> hill = adret.Terrain(np.array([[0.0, 1.0], [5.0, 2.0]]), (10.0, 10.0))
        >>> adret.DepthBuffer.from_terrain(hill).depth
        array([[15., 14.],
               [10., 13.]], dtype=float32)
        """
        dx, dy = terrain.cell_size
        rows, columns = terrain.shape
        heights = terrain.heights.astype(np.float64)
        camera = Camera.orthographic(columns, rows, extent=(columns * dx, rows * dy))
        return cls(np.nanmax(heights) + max(dx, dy) - heights, camera, guard_band=guard_band)

    @property
    def camera(self) -> Camera:
        """The camera."""
        return self._camera

    @property
    def kind(self) -> DepthKind:
        """How depth was stored."""
        return self._kind

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns, guard band included."""
        return self._camera.height, self._camera.width

    @property
    def depth(self) -> NDArray[np.float32]:
        """Depth along the viewing axis [view units], (rows, columns); NaN at sky and holes."""
        return self._depth

    @property
    def samples(self) -> NDArray[np.float32] | None:
        """Depth of every sample, (samples, rows, columns), as `depth`; None for one a pixel."""
        return self._samples

    @property
    def second_layer(self) -> NDArray[np.float32] | None:
        """Depth of the second layer as `depth`, NaN where there is none; or None."""
        return self._second

    @property
    def sky(self) -> NDArray[np.bool_]:
        """Where no surface is seen."""
        return self._sky

    @property
    def holes(self) -> NDArray[np.bool_]:
        """Where nothing was measured."""
        return self._holes

    @property
    def guard_band(self) -> tuple[int, int, int, int]:
        """Pixels at (top, right, bottom, left) that do not receive."""
        return self._guard_band

    @property
    def frame(self) -> tuple[int, int, int, int]:
        """row0, row1, column0, column1 of the receivers."""
        top, right, bottom, left = self._guard_band
        return top, self.shape[0] - bottom, left, self.shape[1] - right

    @cached_property
    def field(self) -> Field:
        """What the methods take."""
        return Field(
            depth=self._depth,
            normal=self._normals_and_counts[0],
            rays=np.array(self._camera.rays, dtype=np.float64),
            perspective=self._camera.perspective_divide,
            frame=self.frame,
            second=np.zeros((0, 0), dtype=np.float32) if self._second is None else self._second,
        )

    @property
    def normal_counts(self) -> dict[str, int]:
        """Normals that are ``degenerate`` (no neighbour on an axis), ``bent``, ``missing``."""
        return dict(self._normals_and_counts[1])

    def depth_step(self) -> NDArray[np.float64]:
        """Distance between neighbouring depths that the stored type can hold, (rows, columns).

        NaN at sky and holes, float64 [view units].
        """
        kind = self._dtype
        if self._kind == "device":
            if kind.kind == "f":
                return self._camera.depth_step(self._depth, dtype=kind)
            return self._camera.depth_step(self._depth, bits=8 * kind.itemsize)
        if kind.kind != "f":
            return np.where(np.isnan(self._depth), np.nan, self._scale)
        step = self._camera.depth_step(self._depth / self._scale, dtype=kind, device=False)
        return step * self._scale

    @cached_property
    def _normals_and_counts(self) -> tuple[NDArray[np.float32], dict[str, int]]:
        from adret.screen.normals import rebuilt_normals, turned_to_eye  # loads Numba

        rebuilt, degenerate = rebuilt_normals(self._depth, self._camera)
        counts = {"degenerate": degenerate, "bent": 0, "missing": 0}
        if self._given is not None:
            given, counts["bent"], counts["missing"] = turned_to_eye(
                self._given, self._depth, self._camera
            )
            counts["degenerate"] = 0
            rebuilt = np.where(np.isnan(given), rebuilt, given)
        return _frozen(rebuilt), counts

    def _linear(
        self, stored: NDArray[Any], hole: float | None
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_], NDArray[np.bool_]]:
        """Depth (NaN at sky and holes), sky and holes of one stored layer."""
        holes = np.isnan(stored) if stored.dtype.kind == "f" else np.zeros(stored.shape, bool)
        if hole is not None:
            holes |= stored == hole
        values = np.where(holes, np.nan, stored.astype(np.float64))
        if self._kind == "device":
            if stored.dtype.kind != "f":
                largest = float(np.iinfo(stored.dtype).max)
                values = values / largest
                if self._camera.clip == "-1..1":
                    values = 2.0 * values - 1.0
            linear = self._camera.to_linear(values)
        else:
            linear = values * self._scale
            if self._kind == "distance":
                linear = linear / self._camera.ray_lengths()
        with np.errstate(over="ignore"):
            single = linear.astype(np.float32)
        sky = ~holes & ~((single > 0.0) & (linear < self._camera.far) & np.isfinite(single))
        single[sky] = np.nan
        return single, sky, holes


def _frozen(array: NDArray[Any]) -> NDArray[Any]:
    array = np.ascontiguousarray(array)
    array.setflags(write=False)
    return array


def _real(field: str, values: ArrayLike) -> NDArray[Any]:
    try:
        array = np.asarray(values)
    except (TypeError, ValueError):
        raise InputError(field, "an array of real numbers", type(values).__name__) from None
    if array.dtype.kind not in "iuf":
        raise InputError(field, "an array of real numbers", str(array.dtype))
    if isinstance(values, np.ma.MaskedArray):
        array = np.ma.filled(values.astype(np.result_type(array, np.float32)), np.nan)
    if array.size > 64 * MAX_PIXELS:
        raise InputError(field, f"at most {64 * MAX_PIXELS} numbers", array.size)
    return array


def _checked_band(band: Any, shape: tuple[int, int]) -> tuple[int, int, int, int]:
    sides: Sequence[Any] = [band] * 4 if isinstance(band, int) else band
    limit = "pixels, or (top, right, bottom, left), that leave at least one receiver"
    try:
        top, right, bottom, left = sides
    except (TypeError, ValueError):
        raise InputError("guard_band", limit, band) from None
    whole = all(isinstance(v, int) and not isinstance(v, bool) and v >= 0 for v in sides)
    if not whole or top + bottom >= shape[0] or left + right >= shape[1]:
        raise InputError("guard_band", limit, band)
    return int(top), int(right), int(bottom), int(left)
