"""What an order would cost: cells, passes, bytes and seconds, and how wrong that may be.

The time is that of one core, by a line for each process: so many nanoseconds a cell and pass, and
so many more for each cell that a pass looks ahead; see ``benchmarks/service/estimates.py``. That of
ambient occlusion goes by method, pixel and sample; see ``benchmarks/service/screen_estimates.py``.
Where the service has run a few jobs of the process, their times correct the line, and their scatter
is the error that is told.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

from adret_service.engine.port import JobRecord

__all__ = ["Cost", "cost", "seconds"]

# (process, method): nanoseconds a cell and pass, and a cell, pass and cell of reach; one core.
SPEEDS: dict[tuple[str, str], tuple[float, float]] = {
    ("horizon", "sweep"): (18.0, 0.0),
    ("horizon", "hull"): (47.0, 0.0),
    ("horizon", "march"): (6.0, 0.36),
    ("horizon", "exact"): (0.0, 8.7),
    ("bounce", ""): (135.0, 0.46),
    ("viewshed", ""): (5.0, 0.45),
    ("visibility", "rays"): (0.0, 0.5),
    ("visibility", "tree"): (240.0, 0.0),
    ("visibility", "march"): (122.0, 2.4),
}
# Ambient occlusion, method by method: nanoseconds a pixel of the frame, and for each sample of it.
SCREEN_SPEEDS = {
    "exact": (200.0, 350.0),
    "ffao": (400.0, 160.0),
    "lsao": (350.0, 45.0),
    "hbao": (680.0, 11.0),
    "vao": (350.0, 50.0),
    "crytek": (430.0, 24.0),
    "lightfield": (400.0, 18.0),
    "raytraced": (370.0, 1200.0),
}
SCREEN_SAMPLES = {
    "exact": 32,
    "ffao": 16,
    "lsao": 16,
    "hbao": 36,
    "vao": 8,
    "crytek": 16,
    "lightfield": 8,
    "raytraced": 256,
}  # where the order does not say
BEHIND = 16.0  # an exact slice of a surface that has a thickness, by one of a surface without
BENDING = {("exact", "timonen"): 1.4, ("ffao", "timonen"): 1.65}  # what a falloff costs
FILTERS = {"box": 40.0, "gaussian": 60.0, "bilateral": 110.0}  # nanoseconds a pixel
FILL = 150.0  # nanoseconds a pixel to fill in what half_res has left out
HALVED = 0.25  # of the pixels, with half_res
LIKE_HORIZON = ("sky-view", "openness", "shadow", "light")
STORED = 70.0  # nanoseconds to store a number of one of many bands
PICTURED = 370.0  # nanoseconds a cell for the raster of one band and its picture
START = 0.015  # seconds to begin and to end a job
FACTOR = 3.0  # for other machines, and busy ones; on the benchmark's own core it was 1.4
ENOUGH = 5  # jobs from which on their times count more than the line
COMPRESSED = 0.6  # stored bytes a byte of a number, about
AUTO = 64  # azimuths that a choice of their number comes to on rough ground


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """What an order asks of one core.

    Attributes
    ----------
    cells : int
        Of the dataset.
    passes : int
        Azimuths, observers or samples, each over all cells.
    reach : float
        Cells that a pass looks ahead, at most.
    bands : int
        Layers of the result.
    result_bytes : int
        Of the result as it is stored, about.
    memory_bytes : int
        Of the process that computes, about.
    core_seconds : float
        By the line, on one core.
    """

    cells: int
    passes: int
    reach: float
    bands: int
    result_bytes: int
    memory_bytes: int
    core_seconds: float


def cost(process: str, inputs: Mapping[str, Any], info: Mapping[str, Any]) -> Cost:
    """Return what an order costs.

    Parameters
    ----------
    process : str
    inputs : mapping
        Checked, with all defaults.
    info : mapping
        Of the dataset: rows, columns, cell_size; of a depth buffer guard_band, sky_pixels and
        hole_pixels.

    Examples
    --------
    >>> info = {"rows": 100, "columns": 100, "cell_size": [10.0, 10.0]}
    >>> cost("horizon", {"directions": 16, "method": "sweep"}, info).passes
    16
    """
    rows, columns = int(info["rows"]), int(info["columns"])
    cells = rows * columns
    passes = _passes(process, inputs)
    reach = 0.4 * max(rows, columns)
    if inputs.get("max_distance") and info.get("cell_size"):
        reach = min(reach, float(inputs["max_distance"]) / min(info["cell_size"]))
    bands = passes if process == "horizon" else 1
    item = 2 if process == "horizon" and inputs.get("dtype") == "uint16" else 4
    name = "horizon" if process in LIKE_HORIZON else process
    method = str(inputs.get("method") or "") if name in ("horizon", "visibility") else ""
    near, far = SPEEDS.get((name, method), (100.0, 1.0))
    stored = PICTURED + (bands * STORED if bands > 1 else 0.0)
    work = cells * (passes * (near + far * reach) + stored)
    if process == "ssao":
        work = _screen_work(inputs, info, passes)
    return Cost(
        cells=cells,
        passes=passes,
        reach=reach,
        bands=bands,
        result_bytes=round(cells * bands * item * COMPRESSED * 4 / 3),
        memory_bytes=round((400 << 20) + cells * (24 + 4 * min(bands, 64))),
        core_seconds=START + 1e-9 * work,
    )


def _passes(process: str, inputs: Mapping[str, Any]) -> int:
    if process == "viewshed":
        observers = (inputs.get("observer") or []) or (inputs.get("at") or [])
        return max(len(observers), 1)
    if process == "ssao":
        return _samples(inputs)
    azimuths = inputs.get("azimuths_deg")
    passes = len(azimuths) if azimuths else _count(inputs.get("directions"))
    if process == "shadow":
        return 1
    if process == "bounce":
        bounces = inputs.get("bounces", 1)
        return passes * (1 + (bounces if isinstance(bounces, int) else 8))
    if process == "light" and inputs.get("sky", "none") == "none":
        return 1
    return passes + (inputs.get("sun_deg") is not None)


def _samples(inputs: Mapping[str, Any]) -> int:
    """Directions, samples or rays of a pixel of ambient occlusion."""
    method = str(inputs.get("method") or "exact")
    if method == "hbao":
        return int(inputs.get("directions") or 6) * int(inputs.get("steps") or 6)
    given = inputs.get("directions") or inputs.get("samples") or inputs.get("rays")
    return int(given or SCREEN_SAMPLES[method])


def _screen_work(inputs: Mapping[str, Any], info: Mapping[str, Any], samples: int) -> float:
    """Nanoseconds of ambient occlusion; half of what sky and holes might save is saved."""
    method = str(inputs.get("method") or "exact")
    rows, columns = int(info["rows"]), int(info["columns"])
    top, bottom, left, right = info.get("guard_band") or (0, 0, 0, 0)
    frame = max(rows - top - bottom, 1) * max(columns - left - right, 1)
    nothing = int(info.get("sky_pixels", 0)) + int(info.get("hole_pixels", 0))
    lines = method in ("ffao", "lsao")  # these sweep the sky, too
    busy = 1.0 if lines else 1.0 - 0.5 * nothing / max(rows * columns, 1)
    base, each = SCREEN_SPEEDS[method]
    each *= BENDING.get((method, str(inputs.get("falloff"))), 1.0)
    if method == "exact" and inputs.get("thickness"):
        each *= BEHIND
    pixel = busy * each * samples
    if inputs.get("half_res"):
        pixel = HALVED * pixel + FILL
    return frame * (base + pixel + FILTERS.get(str(inputs.get("denoise")), 0.0))


def _count(directions: Any) -> int:
    """Azimuths to expect."""
    return AUTO if directions == "auto" else int(directions or 1)


def seconds(core_seconds: float, threads: int, earlier: Sequence[JobRecord]) -> dict[str, Any]:
    """Return the expected time of a job, its range, and what that rests on.

    Parameters
    ----------
    core_seconds : float
        By the line.
    threads : int
        Kernel threads of a job.
    earlier : sequence of JobRecord
        Successful jobs of the same process on this service.

    Examples
    --------
    >>> seconds(3.0, 2, ())
    {'expected': 1.5, 'low': 0.5, 'high': 4.5, 'basis': 'built-in line', 'jobs': 0}
    """
    line = core_seconds / threads
    ratios = sorted(
        (job.finished - job.started) / float(job.request["line"])
        for job in earlier
        if job.started is not None
        and job.finished is not None
        and job.revivals == 0
        and float(job.request.get("line", 0.0)) > 0.0
    )
    if len(ratios) < ENOUGH:
        low, middle, high, basis = 1 / FACTOR, 1.0, FACTOR, "built-in line"
    else:
        tenth = len(ratios) // 10
        low, middle, high = ratios[tenth], median(ratios), ratios[-1 - tenth]
        basis = "jobs of this service: median, and all but a fifth of them"
    return {
        "expected": round(line * middle, 3),
        "low": round(line * low, 3),
        "high": round(line * high, 3),
        "basis": basis,
        "jobs": len(ratios),
    }
