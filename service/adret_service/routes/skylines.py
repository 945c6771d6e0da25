"""The horizon of a place on a dataset, at once: as JSON, or in the form that PVGIS prints."""

import json
from typing import Annotated, Any, Literal

from anyio.to_thread import run_sync
from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import JSONResponse

from adret_service.context import ServiceDep, Tenant
from adret_service.documents import Skyline
from adret_service.problems import FieldError, invalid
from adret_service.routes.datasets import found_dataset

router = APIRouter(tags=["views"])

NEEDED = ("crs", "transform", "rows", "columns", "cell_size", "datum")
ANSWERS: dict[int | str, dict[str, Any]] = {
    200: {"model": Skyline, "content": {"text/csv": {}}, "description": "The horizon."}
}
META = {
    "A": {"description": "Azimuth (0 = S, 90 = W, -90 = E)", "units": "degree"},
    "H_hor": {"description": "Horizon height", "units": "degree"},
    "azimuth_deg": {"description": "Azimuth from true north, clockwise", "units": "degree"},
    "elevation_deg": {
        "description": "Horizon height, negative below the horizontal, -90 without terrain",
        "units": "degree",
    },
    "reach_m": {"description": "How far was looked, null for the whole raster", "units": "m"},
}


@router.get(
    "/datasets/{dataset_id}/horizon",
    operation_id="getDatasetHorizon",
    responses=ANSWERS,
    response_class=JSONResponse,
)
async def get_horizon(
    dataset_id: str,
    request: Request,
    service: ServiceDep,
    tenant: Tenant,
    lat: Annotated[float, Query(ge=-90, le=90, allow_inf_nan=False, description="Latitude [°].")],
    lon: Annotated[
        float, Query(ge=-180, le=180, allow_inf_nan=False, description="Longitude [°].")
    ],
    azimuths: Annotated[int, Query(ge=1, le=3600, description="Equally spaced directions.")] = 48,
    height: Annotated[
        float,
        Query(ge=0, le=100_000, allow_inf_nan=False, description="Of the eye above ground [m]."),
    ] = 0.0,
    curvature: Annotated[
        bool, Query(description="Take the body's curvature and the air's refraction into account.")
    ] = False,
    outputformat: Annotated[
        Literal["json", "csv"] | None, Query(description="Default: what Accept asks for.")
    ] = None,
) -> Response:
    """Return the exact horizon of the cell at a place: azimuth and height in degrees.

    The JSON and CSV forms hold what PVGIS prints for `printhorizon`: azimuths A from south,
    positive to the west, and heights H_hor of at least 0. The JSON form has azimuths from true
    north and unclipped heights besides, and the list that PVGIS takes as `userhorizon`.
    """
    dataset = await run_sync(found_dataset, service, dataset_id, tenant)
    kind = dataset.info.get("kind", "terrain")
    if kind != "terrain":
        raise invalid(FieldError("dataset", "of kind terrain", f"one of kind {kind}"))
    found = await service.viewers.ask(
        "horizon",
        dataset.key,
        sticky=True,
        info={name: dataset.info[name] for name in NEEDED},
        place={
            "lat": lat,
            "lon": lon,
            "azimuths": azimuths,
            "height": height,
            "curvature": curvature,
        },
    )
    seen = json.loads(found.body)
    accepted = request.headers.get("accept", "")
    if outputformat is None and "text/csv" in accepted and "json" not in accepted:
        outputformat = "csv"
    headers = {"Cache-Control": "private, max-age=3600", "Vary": "Accept"}
    profile = pvgis_profile(seen)
    if outputformat == "csv":
        return Response(pvgis_text(lat, lon, profile), headers=headers, media_type="text/csv")
    location = {"latitude": lat, "longitude": lon, "elevation": seen["elevation"]}
    body = {
        "inputs": {
            "location": location,
            "height": height,
            "curvature": curvature,
            "azimuths": azimuths,
        },
        "meta": META,
        "outputs": {
            "horizon_profile": profile,
            "azimuth_deg": seen["azimuth_deg"],
            "elevation_deg": seen["elevation_deg"],
            "userhorizon": ",".join(f"{max(h, 0.0):g}" for h in seen["elevation_deg"]),
            "cell": seen["cell"],
            "reach_m": seen["reach_m"],
        },
    }
    return JSONResponse(body, headers=headers)


def pvgis_profile(seen: dict[str, Any]) -> list[dict[str, float]]:
    """Return azimuths from south, north first and last, with heights that are not negative."""
    azimuths = [*seen["azimuth_deg"], 360.0]
    heights = [*seen["elevation_deg"], seen["elevation_deg"][0]]
    return [
        {"A": round(azimuth - 180.0, 6), "H_hor": round(max(height, 0.0), 4)}
        for azimuth, height in zip(azimuths, heights, strict=True)
    ]


def pvgis_text(lat: float, lon: float, profile: list[dict[str, float]]) -> str:
    """Return the profile as a table of tab-separated columns with its legend."""
    lines = [
        f"Latitude (decimal degrees):\t{lat:.6f}",
        f"Longitude (decimal degrees):\t{lon:.6f}",
        "",
        "A\tH_hor",
        *(f"{row['A']:g}\t{row['H_hor']:g}" for row in profile),
        "",
        *(
            f"{name}: {META[name]['description']} ({META[name]['units']})"
            for name in ("A", "H_hor")
        ),
    ]
    return "\r\n".join(lines) + "\r\n"
