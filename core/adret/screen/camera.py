"""Cameras: from pixels and depth values to view space and back."""

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from adret.errors import InputError

__all__ = ["Camera", "ClipRange", "Handedness"]

ClipRange = Literal["0..1", "-1..1"]
Handedness = Literal["right", "left"]

MAX_SIDE = 32_768
SLACK = 1e-5
"""By how much a depth value may leave its range: the rounding of half-precision files."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """A camera without rotation or position: all is said in its own view space.

    View space is (right, up, back), right-handed, the eye at the origin. `depth` is the distance
    along the viewing axis [view units], not along the ray. Row 0 is at the top; the centre of the
    pixel (row, column) lies at (column + 0.5, row + 0.5) from the image's top left corner.
    Make one with `perspective`, `orthographic`, `from_matrix` or `from_json`.

    Attributes
    ----------
    width, height : int
        Pixels of the image, guard band included.
    rays : (float, float, float, float)
        ax, bx, ay, by: the pixel (row, column) looks along x = ax column + bx, y = ay row + by at
        depth 1 (perspective), or stands there (orthographic); ax > 0 > ay.
    perspective_divide : bool
        True for perspective, False for orthographic projection.
    near, far : float
        Clip planes [view units]; `far` may be infinite. Only depth values need them, and `far`
        says where the sky begins.
    reversed : bool
        Whether depth values are largest at the near plane.
    clip : str
        Range of depth values as stored, "0..1" or "-1..1". What OpenGL writes to a depth buffer is
        "0..1", though its clip space is "-1..1".
    handedness : str
        Of the renderer's view space: "right" looks along -z (OpenGL), "left" along +z (Direct3D).
        It turns the third component of given normals and the sign in `matrix`, and nothing else.

    Examples
    --------
    >>> camera = Camera.perspective(1920, 1080, fov_y_deg=60.0, near=0.1, reversed=True)
    >>> camera.to_linear([1.0, 0.01])
    array([ 0.1, 10. ])
    >>> camera.position(539.5, 959.5, 2.0)
    array([ 0.,  0., -2.])
    """

    width: int
    height: int
    rays: tuple[float, float, float, float]
    perspective_divide: bool
    near: float = 0.0
    far: float = math.inf
    reversed: bool = False
    clip: ClipRange = "0..1"
    handedness: Handedness = "right"

    def __post_init__(self) -> None:
        """Hold every value against its limits."""
        _check_sides(self.width, self.height)
        ax, _, ay, _ = self.rays
        if not all(math.isfinite(v) for v in self.rays) or not ax > 0.0 > ay:
            raise InputError("rays", "finite, ax > 0 > ay", self.rays)
        near, far = self.near, self.far
        if not (_number(near) and 0.0 <= near < math.inf):
            raise InputError("near", "a number of at least 0", near)
        if not (_number(far) and far > near):
            raise InputError("far", f"a number above near ({near:g})", far)
        if self.clip not in ("0..1", "-1..1"):
            raise InputError("clip", "one of 0..1, -1..1", self.clip)
        if self.handedness not in ("right", "left"):
            raise InputError("handedness", "one of right, left", self.handedness)
        if not isinstance(self.reversed, bool):
            raise InputError("reversed", "true or false", self.reversed)

    @classmethod
    def perspective(
        cls,
        width: int,
        height: int,
        *,
        fov_y_deg: float | None = None,
        fx: float | None = None,
        fy: float | None = None,
        cx: float | None = None,
        cy: float | None = None,
        near: float = 0.0,
        far: float = math.inf,
        reversed: bool = False,
        clip: ClipRange = "0..1",
        handedness: Handedness = "right",
    ) -> Self:
        """A perspective camera from its opening angle or from its focal lengths.

        Parameters
        ----------
        width, height : int
            Pixels of the image.
        fov_y_deg : float, optional
            Opening angle of the whole image from top to bottom [degrees], 0 to 180, both out.
        fx, fy : float, optional
            Focal lengths [pixels], instead of `fov_y_deg`; one stands for both.
        cx, cy : float, optional
            Principal point [pixels from the image's top left corner]; default the middle. Where
            pixel centres are whole numbers (OpenCV, ROS), add 0.5 to both.
        near, far, reversed, clip, handedness
            See the class. `near` above 0 is needed for device depth only.

        Raises
        ------
        InputError
            For a value out of range, and for both or neither of angle and focal length.
        """
        if (fov_y_deg is None) == (fx is None and fy is None):
            raise InputError("fov_y_deg", "given, or else fx and fy", fov_y_deg)
        _check_sides(width, height)
        if fov_y_deg is not None:
            if not (_number(fov_y_deg) and 0.0 < fov_y_deg < 180.0):
                raise InputError("fov_y_deg", "above 0 and below 180 degrees", fov_y_deg)
            fy = 0.5 * height / math.tan(0.5 * math.radians(fov_y_deg))
        fx, fy = _first(fx, fy), _first(fy, fx)
        for name, focal in (("fx", fx), ("fy", fy)):
            if not (_number(focal) and 0.0 < focal < math.inf):
                raise InputError(name, "a number above 0 pixels", focal)
        cx, cy = _first(cx, 0.5 * width), _first(cy, 0.5 * height)
        for name, centre in (("cx", cx), ("cy", cy)):
            if not (_number(centre) and math.isfinite(centre)):
                raise InputError(name, "a finite number of pixels", centre)
        return cls(
            width=width,
            height=height,
            rays=(1.0 / fx, (0.5 - cx) / fx, -1.0 / fy, (cy - 0.5) / fy),
            perspective_divide=True,
            near=near,
            far=far,
            reversed=reversed,
            clip=clip,
            handedness=handedness,
        )

    @classmethod
    def orthographic(
        cls,
        width: int,
        height: int,
        *,
        extent: tuple[float, float],
        near: float = 0.0,
        far: float = math.inf,
        reversed: bool = False,
        clip: ClipRange = "0..1",
        handedness: Handedness = "right",
    ) -> Self:
        """An orthographic camera: `extent` is the image's width and height [view units].

        Device depth needs a finite `far`.
        """
        try:
            across, down = (float(side) for side in extent)
        except (TypeError, ValueError):
            raise InputError("extent", "a pair of numbers (width, height)", extent) from None
        if not (0.0 < across < math.inf and 0.0 < down < math.inf):
            raise InputError("extent", "two numbers above 0", extent)
        _check_sides(width, height)
        ax, ay = across / width, -down / height
        return cls(
            width=width,
            height=height,
            rays=(ax, 0.5 * ax - 0.5 * across, ay, 0.5 * ay + 0.5 * down),
            perspective_divide=False,
            near=near,
            far=far,
            reversed=reversed,
            clip=clip,
            handedness=handedness,
        )

    @classmethod
    def from_matrix(
        cls,
        matrix: ArrayLike,
        width: int,
        height: int,
        *,
        matrix_clip: ClipRange = "-1..1",
        clip: ClipRange = "0..1",
    ) -> Self:
        """A camera from the 4 x 4 projection matrix that multiplies column vectors (x, y, z, 1).

        Parameters
        ----------
        matrix : array_like, shape (4, 4)
            From view space to clip space, y up; perspective (last row 0 0 ±1 0) or orthographic
            (last row 0 0 0 1). Row-vector matrices (Direct3D's as written) must be transposed.
        width, height : int
            Pixels of the image.
        matrix_clip : str
            Range of z/w that the matrix makes.
        clip : str
            Range of the depth values as stored; see the class.

        Returns
        -------
        Camera
            Near, far, direction and handedness as the matrix has them; both planes are taken to
            lie before the eye.

        Raises
        ------
        InputError
            If the matrix is singular, has shear, or clips by oblique planes.
        """
        from adret.screen.matrices import camera_numbers

        if matrix_clip not in ("0..1", "-1..1"):
            raise InputError("matrix_clip", "one of 0..1, -1..1", matrix_clip)
        _check_sides(width, height)
        return cls(
            width=width,
            height=height,
            clip=clip,
            **camera_numbers(matrix, width, height, zero_to_one=matrix_clip == "0..1"),
        )

    @classmethod
    def from_json(cls, path: str | os.PathLike[str]) -> Self:
        """A camera from a JSON file; `from_mapping` lists the members that it may have."""
        from adret.screen.camera_files import read_json

        return cls.from_mapping(read_json(path))

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> Self:
        """A camera from the members of a camera file.

        Parameters
        ----------
        values : mapping
            ``projection`` ("perspective" by default, or "orthographic"), ``width``, ``height``;
            ``fov_y_deg``, or ``fx``, ``fy``, ``cx``, ``cy`` (also with ``_px`` behind them), or
            ``extent``; ``near``, ``far`` (or ``clip_near``, ``clip_far``), ``reversed``, ``clip``,
            ``handedness``; ``pixel_centre``: when it starts with "integer", pixel centres are
            whole numbers; or ``matrix`` with ``matrix_clip``. Beside ``fx_px``, ``near`` and
            ``far`` are the least and largest depth in the file and are not used.
            Other members are ignored.

        Examples
        --------
        >>> Camera.from_mapping({"width": 64, "height": 48, "fov_y_deg": 90}).near
        0.0
        """
        from adret.screen.camera_files import camera_arguments

        maker, arguments = camera_arguments(values)
        made: Self = getattr(cls, maker)(**arguments)
        return made

    def position(self, row: ArrayLike, column: ArrayLike, depth: ArrayLike) -> NDArray[np.float64]:
        """Points (right, up, back) [view units] of pixels at a depth; shape (3, ...), float64."""
        z = np.asarray(depth, dtype=np.float64)
        ax, bx, ay, by = self.rays
        x = ax * np.asarray(column, dtype=np.float64) + bx
        y = ay * np.asarray(row, dtype=np.float64) + by
        if self.perspective_divide:
            x, y = x * z, y * z
        return np.stack(np.broadcast_arrays(x, y, -z))

    def ray_lengths(self) -> NDArray[np.float64]:
        """Distance along the ray for each unit of depth, shape (height, width), float64."""
        if not self.perspective_divide:
            return np.ones((self.height, self.width))
        ax, bx, ay, by = self.rays
        x = ax * np.arange(self.width) + bx
        y = ay * np.arange(self.height) + by
        return np.sqrt(1.0 + x[None, :] ** 2 + y[:, None] ** 2)

    def to_linear(self, device_depth: ArrayLike) -> NDArray[np.float64]:
        """Depth [view units] from depth values as stored, float64; inf at an infinite far plane.

        Raises
        ------
        InputError
            If a finite value leaves the range of `clip` by more than 1e-5, or if `near` is 0
            (perspective) or `far` infinite (orthographic).
        """
        near, far = self.planes()
        d = np.asarray(device_depth, dtype=np.float64)
        low = -1.0 if self.clip == "-1..1" else 0.0
        outside = (d < low - SLACK) | (d > 1.0 + SLACK)
        if outside.any():
            first = float(d[outside].flat[0])
            raise InputError("depth", f"between {low:g} and 1 (device depth)", first)
        d = (np.clip(d, low, 1.0) - low) / (1.0 - low)
        d = d if self.reversed else 1.0 - d  # now 1 at the near plane, 0 at the far one
        if not self.perspective_divide:
            return far - d * (far - near)
        with np.errstate(divide="ignore"):
            if math.isinf(far):
                return near / d
            # far / (1 + d (far - near) / near): exact at both planes.
            return far / (1.0 + d * ((far - near) / near))

    def to_device(self, depth: ArrayLike) -> NDArray[np.float64]:
        """Depth values as stored, float64, from depth [view units]; the inverse of `to_linear`."""
        near, far = self.planes()
        z = np.asarray(depth, dtype=np.float64)
        with np.errstate(divide="ignore"):
            if not self.perspective_divide:
                d = (far - z) / (far - near)
            elif math.isinf(far):
                d = near / z
            else:
                d = near * (far / z - 1.0) / (far - near)
        d = d if self.reversed else 1.0 - d
        return 2.0 * d - 1.0 if self.clip == "-1..1" else d

    def depth_step(
        self,
        depth: ArrayLike,
        *,
        dtype: DTypeLike | None = None,
        bits: int | None = None,
        device: bool = True,
    ) -> NDArray[np.float64]:
        """Distance between neighbouring depths that a buffer can hold [view units], float64.

        Parameters
        ----------
        depth : array_like
            Depth [view units], above 0.
        dtype : optional
            Type of the stored numbers: float16, float32, float64.
        bits : int, optional
            Bits of stored whole numbers, 1 to 64, instead: the range of depth values in equal
            steps.
        device : bool
            Whether depth values are stored; else linear depth, which needs `dtype`.

        Examples
        --------
        >>> standard = Camera.perspective(2, 2, fov_y_deg=60, near=0.1, far=1000)
        >>> reverse = Camera.perspective(2, 2, fov_y_deg=60, near=0.1, far=1000, reversed=True)
        >>> float(standard.depth_step(900.0, bits=24).round(2))
        0.48
        >>> float(reverse.depth_step(900.0, dtype="f4").round(7))
        7.4e-06
        """
        from adret.screen.precision import depth_step

        return depth_step(self, depth, dtype=dtype, bits=bits, device=device)

    def matrix(self) -> NDArray[np.float64]:
        """The 4 x 4 projection matrix for column vectors whose z/w has the range of `clip`."""
        from adret.screen.matrices import camera_matrix

        return camera_matrix(self)

    def planes(self) -> tuple[float, float]:
        """The clip planes, checked to be such that depth values mean something."""
        if self.perspective_divide and not self.near > 0.0:
            raise InputError("near", "above 0 where depth values are read", self.near)
        if not self.perspective_divide and math.isinf(self.far):
            raise InputError("far", "finite where orthographic depth values are read", self.far)
        return self.near, self.far


def _number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and value == value


def _check_sides(width: object, height: object) -> None:
    for name, side in (("width", width), ("height", height)):
        if isinstance(side, bool) or not isinstance(side, int) or not 1 <= side <= MAX_SIDE:
            raise InputError(name, f"a whole number between 1 and {MAX_SIDE}", side)


def _first(value: Any, otherwise: Any) -> Any:
    return otherwise if value is None else value
