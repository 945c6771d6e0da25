"""Normals of the surface that a depth buffer shows."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from adret._kernels.screen import normals as kernels
from adret.errors import InputError

if TYPE_CHECKING:
    from adret.screen.camera import Camera
    from adret.screen.depth import DepthBuffer

__all__ = ["rebuilt_normals", "turned_to_eye", "view_normals"]

LEAST_COSINE = 1e-3
"""n·v of a normal after it was bent towards the eye."""


def view_normals(buffer: "DepthBuffer") -> NDArray[np.float32]:
    """Unit normals of every pixel in view space, given or rebuilt from depth.

    Parameters
    ----------
    buffer : DepthBuffer

    Returns
    -------
    ndarray, shape (3, rows, columns), float32
        (right, up, back) [-], facing the eye; NaN at sky and holes. The guard band is included.

    Notes
    -----
    Rebuilt: on each axis the slope to the left or to the right (up or down) neighbour, whichever
    side has the smaller second difference in 1/z (perspective; in z otherwise), in which planes
    are linear. At the image's border, beside sky and beside holes the other side is taken; a pixel
    with no neighbour on an axis counts as degenerate and is taken to face the eye on that axis.

    Examples
    --------
    >>> import numpy as np
    >>> from adret import Camera, DepthBuffer
    >>> camera = Camera.orthographic(4, 4, extent=(4.0, 4.0))
    >>> falling_right = DepthBuffer(np.tile([5.0, 6.0, 7.0, 8.0], (4, 1)), camera)
    >>> view_normals(falling_right)[:, 1, 1].round(3)
    array([ 0.707, -0.   ,  0.707], dtype=float32)
    """
    return buffer.field.normal


def rebuilt_normals(
    depth: NDArray[np.float32], camera: "Camera"
) -> tuple[NDArray[np.float32], int]:
    """Normals from depth (NaN at sky and holes), and how many pixels are degenerate."""
    rows, columns = depth.shape
    w = np.full((rows + 4, columns + 4), np.nan)
    z = depth.astype(np.float64)
    w[2:-2, 2:-2] = 1.0 / z if camera.perspective_divide else z
    normals = np.empty((3, rows, columns), dtype=np.float32)
    degenerate = np.zeros(rows, dtype=np.int64)
    rays = np.array(camera.rays, dtype=np.float64)
    kernels.normals(depth, w, rays, camera.perspective_divide, normals, degenerate)
    return normals, int(degenerate.sum())


def turned_to_eye(
    given: NDArray[np.float32], depth: NDArray[np.float32], camera: "Camera"
) -> tuple[NDArray[np.float32], int, int]:
    """Given normals made unit and facing the eye.

    Returns
    -------
    (ndarray, int, int)
        Normals (NaN where the depth is, and where none was given: zero or NaN), how many
        were bent because they faced away, and how many were missing.
    """
    if given.shape != (3, *depth.shape):
        raise InputError("normals", f"of shape {(3, *depth.shape)}", given.shape)
    normal = given.astype(np.float64)
    if camera.handedness == "left":
        normal[2] = -normal[2]
    length = np.sqrt((normal**2).sum(axis=0))
    solid = np.isfinite(depth)
    with np.errstate(invalid="ignore", divide="ignore"):
        normal = np.where(length > 1e-12, normal / length, np.nan)
    normal[:, ~solid | ~np.isfinite(normal).all(axis=0)] = np.nan
    missing = int((solid & np.isnan(normal[0])).sum())
    rows, columns = np.mgrid[0 : depth.shape[0], 0 : depth.shape[1]]
    if camera.perspective_divide:
        to_eye = -camera.position(rows, columns, 1.0)
        to_eye /= np.sqrt((to_eye**2).sum(axis=0))
    else:
        to_eye = np.zeros_like(normal)
        to_eye[2] = 1.0
    cosine = (normal * to_eye).sum(axis=0)
    away = cosine < LEAST_COSINE
    # Off the eye's direction by as much as allowed, in the plane that they span.
    side = normal - cosine * to_eye
    reach = np.sqrt((side**2).sum(axis=0))
    with np.errstate(invalid="ignore", divide="ignore"):
        bent = LEAST_COSINE * to_eye + np.sqrt(1.0 - LEAST_COSINE**2) * np.where(
            reach > 1e-9, side / reach, 0.0
        )
        bent /= np.sqrt((bent**2).sum(axis=0))
    normal = np.where(away, bent, normal)
    return normal.astype(np.float32), int(away.sum()), missing
