"""What the ledger of screen-space occlusion runs: methods, their settings, and their own truths."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from ssao_references import References
from ssao_scenes import Case

from adret.screen.raytraced import RaySample

Truth = Callable[[References], RaySample]


@dataclass(frozen=True)
class Run:
    """One setting of a method.

    `truth` is the reference of the integral that the method claims; `ideal` is ambient occlusion
    by rays with the same falloff, where that is something else. None for `truth`: the method
    claims what no ray computes, and is held against its own limit, `limit`, instead.
    """

    method: str
    label: str
    options: dict[str, Any]
    claims: str
    truth: Truth | None
    ideal: Truth | None = None
    limit: dict[str, Any] | None = None
    series: str = ""
    samples: int = 0
    volume: bool = False
    """Whether what lies beside the image counts otherwise than open: then only pixels are judged
    whose sphere lies inside it."""


def directions(weight: str, falloff: str = "none", thin: bool = False) -> Truth:
    """The reference by rays."""
    return lambda references: references.get(weight, falloff, thin=thin)


COSINE = directions("cosine")
QUADRATIC = directions("cosine", "quadratic")
TIMONEN = directions("cosine", "timonen")


def runs_of(case: Case, quick: bool) -> Iterator[Run]:
    """Everything that the ledger holds of a case."""
    yield from _exact(case, quick)
    yield from _far_field(case, quick)
    yield from _line_sweeps(case, quick)
    yield from _horizons(case, quick)
    yield from _volumes(case, quick)
    yield from _plain_rays(quick)


def _exact(case: Case, quick: bool) -> Iterator[Run]:
    claim = "cosine, G_inf, W = 1"
    for k in (8, 32) if quick else (4, 8, 16, 32, 128):
        yield Run("exact", f"K={k}", {"directions": k}, claim, COSINE, series="exact", samples=k)
    for k, tile in ((8, 4),) if quick else ((4, 4), (8, 4), (16, 2), (32, 2), (32, 3)):
        yield Run(
            "exact",
            f"K={k}, gathered {tile}x{tile}",
            {"directions": k, "tile": tile, "gather": True},
            claim,
            COSINE,
            series="exact, gathered" if tile != 3 else "",
            samples=k,
        )
    k = 32
    timonen = {"falloff": "timonen", "falloff_scale": case.timonen}
    radius = {"falloff": "quadratic", "radius": case.radius}
    yield Run(
        "exact",
        f"K={k}, timonen",
        {"directions": k, **timonen},
        "cosine, G_inf, r/(r + d²)",
        TIMONEN,
    )
    yield Run(
        "exact",
        f"K={k}, quadratic",
        {"directions": k, **radius},
        "cosine, G_inf, 1 - (d/R)²",
        QUADRATIC,
    )
    yield Run(
        "exact",
        f"K={k}, uniform",
        {"directions": k, "weight": "uniform"},
        "uniform, G_inf, W = 1",
        directions("uniform"),
    )
    k = 8
    yield Run(
        "exact",
        f"K={k}, thin",
        {"directions": k, "thickness": case.thickness},
        "cosine, G_t, W = 1",
        directions("cosine", "none", thin=True),
    )


def _far_field(case: Case, quick: bool) -> Iterator[Run]:
    claim = "cosine, G_inf, W = 1"
    for k in (16,) if quick else (8, 16, 32):
        yield Run(
            "ffao",
            f"K={k}x2",
            {"directions": k},
            claim,
            COSINE,
            series="ffao",
            samples=2 * k,
        )
    yield Run(
        "ffao",
        "K=16x2, mipmaps",
        {"directions": 16, "points": "mipmaps"},
        claim,
        COSINE,
        samples=32,
    )
    if not quick:
        yield Run(
            "ffao",
            "K=16x2, lines",
            {"directions": 16, "points": "lines"},
            claim,
            COSINE,
            samples=32,
        )
        yield Run(
            "ffao",
            "K=18x2, separation 3x3",
            {"directions": 18, "separation": True},
            claim,
            COSINE,
            samples=36,
        )
        yield Run(
            "ffao",
            "K=16x2, peaks as published",
            {"directions": 16, "peaks": "receiver angles"},
            claim,
            COSINE,
            samples=32,
        )
    yield Run(
        "ffao",
        "K=16x2, timonen",
        {"directions": 16, "falloff": "timonen", "falloff_scale": case.timonen},
        "cosine, G_inf, r/(r + d²)",
        TIMONEN,
        samples=32,
    )
    yield Run(
        "ffao",
        "K=16x2, thin",
        {"directions": 16, "points": "lines", "thickness": case.thickness},
        "cosine, G_t, W = 1",
        directions("cosine", "none", thin=True),
        samples=32,
    )


def _line_sweeps(case: Case, quick: bool) -> Iterator[Run]:
    claim = "largest occluder of each direction, r/(r + d²)"
    base = {"falloff": "timonen", "falloff_scale": case.timonen}
    limit = {**base, "directions": 64 if quick else 128}
    settings = [("dense K=8", {"directions": 8}), ("dense K=16", {"directions": 16})]
    sparse = {"directions": 8, "line_spacing": 2.12, "step": 2.83}
    settings += [("sparse K=8", sparse)]
    if not quick:
        settings += [
            ("dense K=32", {"directions": 32}),
            ("dense K=16, receiver's tangent", {"directions": 16, "tangent": "receiver"}),
            ("dense K=16, mixed tangents", {"directions": 16, "tangent": "mixed"}),
        ]
    for label, options in settings:
        yield Run(
            "lsao",
            label,
            {**base, **options},
            claim,
            None,
            TIMONEN,
            limit,
            series="lsao" if label.startswith("dense K") and "," not in label else "",
            samples=options["directions"],
        )


def _horizons(case: Case, quick: bool) -> Iterator[Run]:
    base = {"falloff": "quadratic", "radius": case.radius}
    limit = {**base, "directions": 32 if quick else 96, "spacing": 1.0, "jitter": False}
    ideal = directions("uniform", "quadratic")
    for n in (6,) if quick else (6, 8, 16):
        yield Run(
            "hbao",
            f"{n}x{n}",
            {**base, "directions": n, "steps": n},
            "horizons of samples, uniform, 1 - (d/R)²",
            None,
            ideal,
            limit,
            series="hbao",
            samples=n * n,
        )
    if not quick:
        yield Run(
            "hbao",
            "8x8, bilateral filter",
            {**base, "directions": 8, "steps": 8, "denoise": "bilateral"},
            "horizons of samples, uniform, 1 - (d/R)²",
            None,
            ideal,
            limit,
            samples=64,
        )
        yield Run(
            "hbao",
            "rays 6x6x3",
            {**base, "form": "rays", "directions": 6, "steps": 6, "rays": 3},
            "marched rays, uniform, 1 - (d/R)²",
            ideal,
            samples=108,
        )


def _volumes(case: Case, quick: bool) -> Iterator[Run]:
    radius = {"radius": case.radius}
    claim = "share of the tangent sphere"
    for n in (4, 16) if quick else (4, 8, 16, 32):
        for kind in ("weighted", "analytic"):
            if kind == "analytic" and n > 8:
                continue
            for filter_ in (None, "box"):
                yield Run(
                    "vao",
                    f"{n} {kind}" + (", box filter" if filter_ else ""),
                    {**radius, "samples": n, "normalisation": kind, "denoise": filter_},
                    claim,
                    References.volumetric,
                    directions("cosine", "cubic"),
                    series="vao" if kind == "weighted" and filter_ else "",
                    samples=n,
                )
    for n in (32,) if quick else (8, 32):
        yield Run(
            "vao",
            f"{n} containment, box filter",
            {**radius, "samples": n, "estimator": "containment", "denoise": "box"},
            "share of the hemisphere by the cosine",
            References.hemisphere,
            directions("cosine", "cubic"),
            samples=n,
        )
    for n in (16,) if quick else (8, 16, 24):
        yield Run(
            "crytek",
            f"{n}, box filter",
            {**radius, "samples": n, "range_check": "none", "denoise": "box"},
            "share of the kernel's spheres",
            lambda references, n=n: references.ball(n),
            samples=n,
            volume=True,
        )
    for n in (8,) if quick else (8, 32):
        yield Run(
            "lightfield",
            f"{n} poisson, box filter",
            {**radius, "samples": n, "denoise": "box"},
            "share of the shell 0.8 R to R",
            lambda references: references.shell(0.8),
            samples=n,
            volume=True,
        )


def _plain_rays(quick: bool) -> Iterator[Run]:
    for n in (32,):
        yield Run(
            "raytraced",
            f"{n} rays",
            {"rays": n, "seed": 1},
            "cosine, G_inf, W = 1",
            COSINE,
            series="raytraced",
            samples=n,
        )


def speed_runs(case_radius: float, *, slow: bool) -> list[tuple[str, str, dict[str, Any]]]:
    """Name, method and options of what is timed on a whole frame; the slow ones if asked for."""
    far = {"falloff": "timonen", "falloff_scale": (0.25 * case_radius) ** 2}
    near = {"falloff": "quadratic", "radius": case_radius}
    many = [("exact K=32", "exact", {"directions": 32})] if slow else []
    return [
        *many,
        ("exact K=8", "exact", {"directions": 8}),
        ("exact K=8, gathered 4x4", "exact", {"directions": 8, "tile": 4, "gather": True}),
        ("lsao dense K=8", "lsao", {"directions": 8, **far}),
        (
            "lsao sparse K=8",
            "lsao",
            {"directions": 8, "step": 2.83, "line_spacing": 2.12, **far},
        ),
        ("ffao K=8x2", "ffao", {"directions": 8}),
        ("ffao K=8x2, far field only", "ffao", {"directions": 8, "near_field": False}),
        ("ffao K=9x2, separation", "ffao", {"directions": 9, "separation": True}),
        (
            "ffao K=9x2, separation, far field only",
            "ffao",
            {"directions": 9, "separation": True, "near_field": False},
        ),
        ("hbao 6x6", "hbao", {"directions": 6, "steps": 6, **near}),
        ("hbao 16x16", "hbao", {"directions": 16, "steps": 16, **near}),
        ("vao 8", "vao", {"samples": 8, "radius": case_radius}),
        ("crytek 16", "crytek", {"samples": 16, "radius": case_radius}),
        ("lightfield 8", "lightfield", {"samples": 8, "radius": case_radius}),
    ]


def scaling_runs(radius: float) -> list[tuple[str, str, dict[str, Any]]]:
    """As `speed_runs`, for a radius [view units] that grows."""
    falloff = {"falloff": "hard" if math.isfinite(radius) else "none", "radius": radius}
    runs: list[tuple[str, str, dict[str, Any]]] = [
        ("exact K=8", "exact", {"directions": 8, **falloff}),
        ("lsao dense K=8", "lsao", {"directions": 8, **falloff}),
        (
            "lsao sparse K=8",
            "lsao",
            {"directions": 8, "step": 2.83, "line_spacing": 2.12, **falloff},
        ),
        ("ffao K=8x2", "ffao", {"directions": 8, **falloff}),
    ]
    if math.isfinite(radius):
        runs.append(
            ("hbao K=8, a sample each 4 px", "hbao", {"directions": 8, "spacing": 4.0, **falloff})
        )
    return runs
