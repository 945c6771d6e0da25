"""Ambient occlusion of a depth buffer by any of the methods."""

import math
import time
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from dataclasses import fields as fields_of
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adret.errors import InputError
from adret.screen.camera import Camera
from adret.screen.depth import DepthBuffer, DepthPrecisionWarning
from adret.screen.options import make_options
from adret.screen.positions import PositionsBuffer

if TYPE_CHECKING:
    from types import ModuleType

__all__ = ["METHODS", "AOResult", "Estimate", "ScreenReport", "ambient_occlusion"]

Progress = Callable[[int, int], None]

METHODS: dict[str, str] = {
    "crytek": "adret.screen.crytek",
    "hbao": "adret.screen.hbao",
    "lightfield": "adret.screen.lightfield",
    "vao": "adret.screen.vao",
    "raytraced": "adret.screen.raytraced",
}
"""Method -> module with `Options` and ``estimate(field, options, progress) -> Estimate``.

A module that uses a second layer says so by ``SECOND_LAYER = True``.
"""

STEPS_A_RADIUS = 20.0
"""A step of the stored depth may be this much smaller than the radius without a warning."""


class Estimate(NamedTuple):
    """What a method returns: arrays of the frame's shape.

    Values at sky and holes do not matter: they are set once, for all methods, afterwards.

    Attributes
    ----------
    occlusion : ndarray, shape (rows, columns), float32
        0 open, 1 closed.
    confidence : ndarray, shape (rows, columns), float32
        Share of the hemisphere (or of the samples) that was decided inside the image.
    bent_normal : ndarray, shape (3, rows, columns), float32, or None
        Mean open direction, unit, in view space.
    skipped : dict
        What was left out because it cannot matter: name -> count.
    measured : dict
        What else the method can say about its result, such as its noise: name -> number.
    """

    occlusion: NDArray[np.float32]
    confidence: NDArray[np.float32]
    bent_normal: NDArray[np.float32] | None
    skipped: dict[str, int]
    measured: dict[str, float] = {}  # noqa: RUF012


@dataclass(frozen=True, slots=True, kw_only=True)
class ScreenReport:
    """Work done and work skipped by one run.

    Attributes
    ----------
    method : str
    options : mapping
        Every option of the method with the value that it had.
    receivers : int
        Pixels in the frame that show a surface.
    skipped : mapping
        Pixels or directions that were left out because they cannot matter, by reason; ``sky``
        and ``holes`` are pixels of the frame.
    measured : mapping
        What else the method says about its result: ``noise`` of "raytraced".
    normals : mapping
        Pixels whose normal was ``degenerate``, ``bent`` or ``missing``.
    seconds : float
        Wall time [s].
    """

    method: str
    options: Mapping[str, Any]
    receivers: int
    skipped: Mapping[str, int]
    measured: Mapping[str, float]
    normals: Mapping[str, int]
    seconds: float


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class AOResult:
    """Ambient occlusion of the frame (the image without its guard band).

    Attributes
    ----------
    occlusion : ndarray, shape (rows, columns), float32
        0 open, 1 closed; 0 at sky, NaN at holes.
    confidence : ndarray, shape (rows, columns), float32
        Share of the hemisphere (or of the samples) that was decided inside the image; 0 at sky
        and holes. What left the image counts as open.
    bent_normal : ndarray, shape (3, rows, columns), float32, or None
        Mean open direction (right, up, back), unit; NaN at sky and holes. None for methods that
        do not define it.
    camera : Camera or None
        Of the whole image; None for images of positions.
    frame : (int, int, int, int)
        row0, row1, column0, column1 of the frame in the image.
    report : ScreenReport
    """

    occlusion: NDArray[np.float32]
    confidence: NDArray[np.float32]
    bent_normal: NDArray[np.float32] | None
    camera: Camera | None
    frame: tuple[int, int, int, int]
    report: ScreenReport

    def __repr__(self) -> str:
        """Size, method and mean."""
        rows, columns = self.occlusion.shape[-2:]
        method, mean = self.report.method, float(np.nanmean(self.occlusion))
        return f"AOResult({rows} x {columns}, {method}, mean occlusion {mean:.4f})"


def ambient_occlusion(
    buffer: DepthBuffer | PositionsBuffer,
    *,
    method: str = "exact",
    power: float = 1.0,
    intensity: float = 1.0,
    progress: Progress | None = None,
    **options: Any,
) -> AOResult:
    """Ambient occlusion at every pixel of a depth buffer: 0 open, 1 closed.

    Parameters
    ----------
    buffer : DepthBuffer or PositionsBuffer
        Images of positions are for the method "lightfield" alone; of several views, results have
        an axis of views in front.
    method : str
        One of `METHODS`.
    power : float
        Exponent of the visibility: 1 - (1 - occlusion)^power. Default 1: nothing is changed.
    intensity : float
        Factor of the occlusion, before the power; the product is clipped to 0..1.
    progress : callable, optional
        Called as progress(done, total); it may raise `Cancelled`.
    **options
        The method's own, such as radius, falloff, thickness, directions, steps, seed.

    Returns
    -------
    AOResult
        float32, of the frame's shape; 0 at sky, NaN at holes.

    Raises
    ------
    InputError
        For an unknown method, an option that the method does not know (those that it knows are
        listed), or a value out of range.

    Warns
    -----
    DepthPrecisionWarning
        If one step of the stored depth is more than a twentieth of the radius.

    Notes
    -----
    Occlusion is (1/π) ∫ V(ω) W(d) (n·ω) dω over the hemisphere about the normal, for methods that
    weigh by the cosine, where V is 1 if the surface is hit in direction ω, at distance d.

    Examples
    --------
    >>> import numpy as np
    >>> from adret import Camera, DepthBuffer, ambient_occlusion
    >>> wall = DepthBuffer(np.full((8, 8), 3.0), Camera.perspective(8, 8, fov_y_deg=60.0))
    >>> ambient_occlusion(wall, method="raytraced", rays=64).occlusion.max()
    np.float32(0.0)
    """
    if not isinstance(buffer, DepthBuffer | PositionsBuffer):
        raise InputError("buffer", "a DepthBuffer or a PositionsBuffer", type(buffer).__name__)
    module = method_module(method)
    _check_number("power", power)
    _check_number("intensity", intensity)
    if isinstance(buffer, PositionsBuffer):
        if method != "lightfield":
            raise InputError("method", "'lightfield' for images of positions", method)
        result: AOResult = module.estimate_positions(
            buffer,
            make_options(module.Options, method, options),
            power=power,
            intensity=intensity,
            progress=progress,
        )
        return result
    if buffer.second_layer is not None and not getattr(module, "SECOND_LAYER", False):
        raise InputError("second_layer", f"None for the method {method!r}", "given")
    chosen = make_options(module.Options, method, options)
    _warn_of_coarse_depth(buffer, getattr(chosen, "radius", math.inf))
    start = time.perf_counter()
    estimate: Estimate = module.estimate(buffer.field, chosen, progress)
    row0, row1, column0, column1 = buffer.frame
    frame = (slice(row0, row1), slice(column0, column1))
    sky, holes = buffer.sky[frame], buffer.holes[frame]
    occlusion = strengthened(estimate.occlusion, power, intensity)
    occlusion[sky] = 0.0
    occlusion[holes] = np.nan
    confidence = np.array(estimate.confidence, dtype=np.float32)
    confidence[sky | holes] = 0.0
    bent = estimate.bent_normal
    if bent is not None:
        bent = np.where(sky | holes, np.float32(np.nan), bent)
    report = ScreenReport(
        method=method,
        options={each.name: getattr(chosen, each.name) for each in fields_of(chosen)},
        receivers=int((~sky & ~holes).sum()),
        skipped={**estimate.skipped, "sky": int(sky.sum()), "holes": int(holes.sum())},
        measured=dict(estimate.measured),
        normals=buffer.normal_counts,
        seconds=time.perf_counter() - start,
    )
    return AOResult(
        occlusion=occlusion,
        confidence=confidence,
        bent_normal=bent,
        camera=buffer.camera,
        frame=buffer.frame,
        report=report,
    )


def method_module(method: object) -> "ModuleType":
    """The module of a method."""
    if not isinstance(method, str) or method not in METHODS:
        raise InputError("method", f"one of {', '.join(METHODS)}", method)
    return import_module(METHODS[method])


def strengthened(
    occlusion: NDArray[np.float32], power: float, intensity: float
) -> NDArray[np.float32]:
    """1 - (1 - min(1, intensity A))^power, a new array, clipped to 0..1; keeps NaN."""
    result: NDArray[np.float32] = np.clip(np.float32(intensity) * occlusion, 0.0, 1.0)
    if power != 1.0:
        result = 1.0 - (1.0 - result) ** np.float32(power)
    return np.array(result, dtype=np.float32)


def _check_number(name: str, value: object) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < 1e3:
        raise InputError(name, "a number above 0 and below 1000", value)


def _warn_of_coarse_depth(buffer: DepthBuffer, radius: float) -> None:
    if math.isinf(radius):
        return
    step = buffer.depth_step()
    row0, row1, column0, column1 = buffer.frame
    step = step[row0:row1, column0:column1]
    coarse = step > radius / STEPS_A_RADIUS
    if coarse.any():
        worst = np.nanargmax(step)
        depth = buffer.depth[row0:row1, column0:column1].flat[worst]
        warnings.warn(
            f"depth: one step of the stored values is {step.flat[worst]:.3g} at depth {depth:.3g}, "
            f"more than a twentieth of the radius {radius:.3g} "
            f"({100.0 * coarse.mean():.2g} % of the pixels)",
            DepthPrecisionWarning,
            stacklevel=3,
        )
