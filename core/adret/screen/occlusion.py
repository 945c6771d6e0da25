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
from adret.screen.field import Field
from adret.screen.halved import DENOISERS, Denoiser, Halved, denoised, halved, restored
from adret.screen.options import make_options
from adret.screen.positions import PositionsBuffer

if TYPE_CHECKING:
    from types import ModuleType

__all__ = ["METHODS", "AOResult", "Estimate", "ScreenReport", "ambient_occlusion"]

Progress = Callable[[int, int], None]

METHODS: dict[str, str] = {
    "exact": "adret.screen.exact",
    "crytek": "adret.screen.crytek",
    "hbao": "adret.screen.hbao",
    "ffao": "adret.screen.ffao",
    "lightfield": "adret.screen.lightfield",
    "lsao": "adret.screen.lsao",
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
    half_res: bool = False,
    denoise: Denoiser | None = None,
    depth_tolerance: float | None = None,
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
    half_res : bool
        Estimate every second row and column, then upsample along the edges of depth (see
        `denoise.joint_bilateral_upsample`).
    denoise : {"box", "bilateral", "gaussian"}, optional
        Filter of the estimate, before it is upsampled: 4 x 4 pixels of like depth, which suits
        methods whose samples repeat in such tiles; 15 x 15 pixels weighted by depth, once for each
        sample of the buffer at edges; or 5 x 5 pixels whatever their depth. See `denoise`.
    depth_tolerance : float, optional
        Difference in depth that filters and upsampling take for an edge [view units]. Default:
        half the radius.
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
    if not isinstance(half_res, bool):
        raise InputError("half_res", "true or false", half_res)
    if denoise is not None and denoise not in DENOISERS:
        raise InputError("denoise", f"one of {', '.join(DENOISERS)}, or None", denoise)
    if isinstance(buffer, PositionsBuffer):
        if method != "lightfield":
            raise InputError("method", "'lightfield' for images of positions", method)
        if half_res or denoise is not None:
            name = "half_res" if half_res else "denoise"
            raise InputError(name, "left out for images of positions", half_res or denoise)
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
    field = buffer.field
    low = halved(field) if half_res else None
    estimate: Estimate = module.estimate(field if low is None else low.field, chosen, progress)
    if low is not None or denoise is not None:
        tolerance = _depth_tolerance(depth_tolerance, chosen)
        samples = None if half_res else buffer.samples
        estimate = _finished(estimate, field, low, denoise, tolerance, samples)
    row0, row1, column0, column1 = buffer.frame
    frame = (slice(row0, row1), slice(column0, column1))
    sky, holes = buffer.sky[frame], buffer.holes[frame]
    empty = sky | holes
    without = int(np.count_nonzero(empty))
    occlusion = strengthened(estimate.occlusion, power, intensity)
    confidence = np.array(estimate.confidence, dtype=np.float32)
    bent = estimate.bent_normal
    if without:
        occlusion[sky] = 0.0
        occlusion[holes] = np.nan
        confidence[empty] = 0.0
        if bent is not None:
            bent = np.where(empty, np.float32(np.nan), bent)
    report = ScreenReport(
        method=method,
        options={each.name: getattr(chosen, each.name) for each in fields_of(chosen)},
        receivers=empty.size - without,
        skipped={
            **estimate.skipped,
            "sky": int(np.count_nonzero(sky)),
            "holes": int(np.count_nonzero(holes)),
        },
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
    result: NDArray[np.float32] = np.multiply(occlusion, np.float32(intensity), dtype=np.float32)
    np.clip(result, 0.0, 1.0, out=result)
    if power != 1.0:
        result = np.asarray(1.0 - (1.0 - result) ** np.float32(power), dtype=np.float32)
    return result


def _finished(
    estimate: Estimate,
    field: Field,
    low: Halved | None,
    denoise: Denoiser | None,
    tolerance: float,
    samples: NDArray[np.float32] | None,
) -> Estimate:
    """The estimate filtered, and at the whole resolution."""
    occlusion, confidence, bent = estimate.occlusion, estimate.confidence, estimate.bent_normal
    if denoise is not None:
        here = field if low is None else low.field
        occlusion = denoised(occlusion, here, denoise, tolerance, samples)
    if low is not None:
        # A pixel with nothing like it about is open, and nothing is known of it.
        occlusion = np.nan_to_num(restored(occlusion, low, field, tolerance))
        confidence = np.nan_to_num(restored(confidence, low, field, tolerance))
        if bent is not None:
            bent = np.stack([restored(each, low, field, tolerance) for each in bent])
            with np.errstate(invalid="ignore"):
                bent = bent / np.sqrt((bent * bent).sum(axis=0))
    return estimate._replace(occlusion=occlusion, confidence=confidence, bent_normal=bent)


def _depth_tolerance(given: object, options: Any) -> float:
    if given is None:
        radius = getattr(options, "radius", math.inf)
        if math.isinf(radius) or getattr(options, "radius_in", "view") != "view":
            limit = "given to filter or upsample, where the radius is no finite length"
            raise InputError("depth_tolerance", limit, given)
        return 0.5 * float(radius)
    if isinstance(given, bool) or not isinstance(given, int | float) or not 0.0 < given < math.inf:
        raise InputError("depth_tolerance", "a number above 0", given)
    return float(given)


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
            f"({coarse.mean():.2%} of the pixels)",
            DepthPrecisionWarning,
            stacklevel=3,
        )
