"""Parameters of ambient occlusion in screen space."""

from dataclasses import dataclass, fields
from typing import Any, Literal

from adret.parameters.specification import Parameters, option

__all__ = ["SsaoParameters"]


@dataclass(frozen=True, kw_only=True)
class SsaoParameters(Parameters):
    """Parameters of ambient occlusion; those that a method does not know are refused by it."""

    method: Literal["exact", "ffao", "lsao", "hbao", "vao", "crytek", "lightfield", "raytraced"] = (
        option(
            "exact",
            "exact: whole slices, integrated; ffao, lsao: far field and line sweeps, whose work "
            "does not grow with the radius; hbao, vao, crytek, lightfield: samples round a pixel; "
            "raytraced: the slow reference.",
        )
    )
    radius: float | None = option(
        None,
        "Distance from which on occluders do not count; default: the method's, for most of them "
        "without end.",
        unit="view units",
        above=0.0,
    )
    falloff: Literal["none", "hard", "quadratic", "timonen"] | None = option(
        None,
        "Weight of an occluder at distance d: none 1; hard 1 within the radius R; quadratic "
        "1 - (d/R)²; timonen r/(r + d²).",
    )
    falloff_scale: float | None = option(
        None, "r of the falloff timonen.", unit="view units squared", above=0.0
    )
    thickness: float | None = option(
        None,
        "How far the surface reaches back along the view ray; default: without end.",
        unit="view units",
        above=0.0,
    )
    directions: int | None = option(
        None, "Directions (or slices) round every pixel.", minimum=1, maximum=7200
    )
    steps: int | None = option(None, "Steps of a direction.", minimum=1, maximum=65536)
    samples: int | None = option(None, "Samples of a pixel.", minimum=1, maximum=65536)
    rays: int | None = option(None, "Rays of a pixel.", minimum=1, maximum=65536)
    angle_bias_deg: float | None = option(
        None,
        "Elevation above the surface below which nothing counts.",
        unit="deg",
        minimum=0.0,
        maximum=90.0,
    )
    seed: int | None = option(None, "Seed of the noise.", minimum=0, maximum=2**31)
    power: float = option(1.0, "Exponent of the visibility.", above=0.0, maximum=999.0)
    intensity: float = option(
        1.0, "Factor of the occlusion, before the power.", above=0.0, maximum=999.0
    )
    half_res: bool = option(
        False, "Compute every second pixel of every second row, and fill in the rest by depth."
    )
    denoise: Literal["box", "bilateral", "gaussian"] | None = option(
        None,
        "Filter against noise: box 4 x 4 of equal depth; bilateral 15 x 15 by depth; gaussian "
        "5 x 5 whatever the depth.",
    )
    depth_tolerance: float | None = option(
        None,
        "Difference of depth across which filters do not reach; default: by the radius.",
        unit="view units",
        above=0.0,
    )
    layer: Literal["occlusion", "visibility", "confidence", "bent-normal"] = option(
        "occlusion",
        "occlusion: 0 open, 1 closed; visibility: 1 less that; confidence: share of the "
        "hemisphere that was decided inside the image; bent-normal: mean open direction, three "
        "bands (right, up, back).",
    )

    color: str | None = option(
        None,
        "Picture of the same view (.png, .jpg, .exr, .hdr): the preview shows it shaded.",
        form="path",
    )

    def options(self) -> dict[str, Any]:
        """What was chosen, as `ambient_occlusion` takes it."""
        shared = ("layer", "color")
        chosen = {each.name: getattr(self, each.name) for each in fields(self)}
        return {k: v for k, v in chosen.items() if k not in shared and v is not None}
