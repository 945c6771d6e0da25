"""What a raster looks like: map tiles, pictures, statistics and values, of datasets and results."""

import hashlib
import json
import math
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Annotated, Any, Literal
from urllib.parse import urlencode

from anyio.to_thread import run_sync
from fastapi import APIRouter, Depends, Path, Query, Request, Response

import adret
from adret_service.context import BaseUrl, ServiceDep, Tenant
from adret_service.documents import PointValues, TileGrid
from adret_service.ids import is_id
from adret_service.maps import PAGE, SECURITY
from adret_service.problems import FieldError, Problem, invalid, missing
from adret_service.routes.frequent import known_job
from adret_service.status import artefacts_of
from adret_service.viewers import View

router = APIRouter(tags=["views"])

AGE = 3600  # seconds that a client may keep a view without asking
MAX_ZOOM = 24
NUMBER = r"-?[0-9]{1,12}(\.[0-9]{1,12})?([eE][-+]?[0-9]{1,2})?"
PICTURE: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "The picture, or its numbers.",
        "content": {"image/png": {}, "image/webp": {}, "application/x-npy": {}},
    },
    204: {"description": "Nothing but nodata there."},
    304: {"description": "The client has it already."},
}
HTML: dict[int | str, dict[str, Any]] = {200: {"content": {"text/html": {}}}}

Form = Literal["png", "webp", "npy"]
Zoom = Annotated[int, Path(ge=0, le=MAX_ZOOM)]
Index = Annotated[int, Path(ge=0, lt=2**MAX_ZOOM)]
Bands = Annotated[
    list[Annotated[int, Query(ge=1, le=65535)]],
    Query(alias="bidx", max_length=16, description="Band numbers from 1; repeat for several."),
]
Rescale = Annotated[
    list[Annotated[str, Query(pattern=f"^{NUMBER},{NUMBER}$")]],
    Query(
        max_length=16,
        description="Values shown as black and white, as low,high; repeat for several bands. "
        "Default: the 2nd and 98th percentile of the raster, and for codes all of them.",
    ),
]
Colormap = Annotated[
    str | None, Query(pattern="^[a-z0-9_]{1,40}$", description="Like viridis or rdylbu_r.")
]


@dataclass(frozen=True, slots=True)
class Raster:
    """A raster in the store; `path` is where its views are."""

    key: str
    path: str


async def raster_of_dataset(dataset_id: str, service: ServiceDep, tenant: Tenant) -> Raster:
    """Return a dataset's raster or answer 404."""
    found = await service.datasets.get(dataset_id) if is_id(dataset_id) else None
    if found is None or found.tenant != tenant:
        raise missing("dataset", dataset_id)
    return Raster(found.key, f"/datasets/{dataset_id}")


async def raster_of_job(job_id: str, service: ServiceDep, tenant: Tenant) -> Raster:
    """Return a finished job's raster or answer why there is none."""
    job = await known_job(service, job_id, tenant)
    result = (await run_sync(artefacts_of, service.storage, job)).get("result")
    if result is None:
        raise Problem(404, "this job has made no raster")
    return Raster(result.key, f"/jobs/{job_id}")


def add_views(path: str, name: str, find: Callable[..., Awaitable[Raster]]) -> None:
    """Add all views of one kind of raster below `path`."""
    Found = Annotated[Raster, Depends(find)]

    @router.get(
        f"{path}/tiles/{{z}}/{{x}}/{{y}}.{{format}}",
        operation_id=f"get{name}Tile",
        responses=PICTURE,
        response_class=Response,
    )
    async def get_tile(
        raster: Found,
        request: Request,
        service: ServiceDep,
        z: Zoom,
        x: Index,
        y: Index,
        format: Form,
        bidx: Bands = [],  # noqa: B006 - FastAPI copies it
        rescale: Rescale = [],  # noqa: B006
        colormap_name: Colormap = None,
        tilesize: Literal["256", "512"] = "256",
    ) -> Response:
        """Return one tile: PNG, WebP or float32 numbers; 204 where all of it is nodata.

        Tiles are those of the web's Mercator grid, or of the raster's own cells where it has no
        place on the Earth.
        """
        style = style_of(format, bidx, rescale, colormap_name, int(tilesize))
        order = {"z": z, "x": x, "y": y, "style": style}
        return await shown(request, service, raster, "tile", **order)

    @router.get(
        f"{path}/preview.png",
        operation_id=f"get{name}Preview",
        responses=PICTURE,
        response_class=Response,
    )
    async def get_preview(
        raster: Found,
        request: Request,
        service: ServiceDep,
        bidx: Bands = [],  # noqa: B006
        rescale: Rescale = [],  # noqa: B006
        colormap_name: Colormap = None,
        max_size: Annotated[int, Query(ge=1, le=2048, description="Pixels a side.")] = 1024,
    ) -> Response:
        """Return a picture of the whole raster in its own cells."""
        style = style_of("png", bidx, rescale, colormap_name, max_size)
        return await shown(request, service, raster, "preview", style=style)

    @router.get(f"{path}/tilejson.json", operation_id=f"get{name}TileJson", response_model=TileGrid)
    async def get_tilejson(
        raster: Found, request: Request, service: ServiceDep, tenant: Tenant, base: BaseUrl
    ) -> dict[str, Any]:
        """Say where tiles are and what they show, as TileJSON 3.0; keeps the query for them.

        Where keys are asked for, the tiles' address carries a token: maps can send no header.
        """
        found = await service.viewers.ask("tilegrid", raster.key)
        grid = dict(json.loads(found.body))
        kept = [(k, v) for k, v in request.query_params.multi_items() if k != "token"]
        token = request.query_params.get("token")
        if service.tokens is not None:
            kept.append(("token", token or service.tokens.make(tenant, raster.path)))
        query = f"?{urlencode(kept)}" if kept else ""
        return grid | {
            "tilejson": "3.0.0",
            "name": raster.path.strip("/"),
            "scheme": "xyz",
            "tiles": [f"{base}{raster.path}/tiles/{{z}}/{{x}}/{{y}}.png{query}"],
            "map": f"{base}{raster.path}/map.html{query}",
        }

    @router.get(
        f"{path}/map.html",
        operation_id=f"get{name}Map",
        responses=HTML,
        response_class=Response,
    )
    async def get_map(raster: Found) -> Response:
        """Return a page that shows the tiles; it asks this service alone."""
        headers = {"Content-Security-Policy": SECURITY, "Cache-Control": "private, max-age=60"}
        return Response(PAGE, headers=headers, media_type="text/html")

    @router.get(f"{path}/statistics", operation_id=f"get{name}Statistics")
    async def get_statistics(
        raster: Found,
        service: ServiceDep,
        bidx: Bands = [],  # noqa: B006
    ) -> dict[str, Any]:
        """Return statistics of the bands, from at most 1024 x 1024 evenly spaced cells."""
        found = await service.viewers.ask("statistics", raster.key, bands=bidx)
        return dict(json.loads(found.body))

    @router.get(f"{path}/point", operation_id=f"get{name}Point", response_model=PointValues)
    async def get_point(
        raster: Found,
        service: ServiceDep,
        lon: Annotated[float, Query(ge=-180, le=180, allow_inf_nan=False)],
        lat: Annotated[float, Query(ge=-90, le=90, allow_inf_nan=False)],
        bidx: Bands = [],  # noqa: B006
    ) -> dict[str, Any]:
        """Return the values of the cell at a place; null where there is no data."""
        found = await service.viewers.ask("point", raster.key, lon=lon, lat=lat, bands=bidx)
        return dict(json.loads(found.body))


def style_of(
    form: str, bands: list[int], rescale: list[str], colormap: str | None, side: int
) -> dict[str, Any]:
    """Return what a picture is to look like.

    Raises
    ------
    Problem
        400 for a range that is none.
    """
    ranges = []
    for text in rescale:
        low, high = map(float, text.split(","))
        if not low < high or not math.isfinite(high - low):
            raise invalid(FieldError("rescale", "low,high with low below high", text))
        ranges.append([low, high])
    return {
        "form": form,
        "bands": bands,
        "rescale": ranges,
        "colormap": colormap,
        "side": side,
    }


async def shown(
    request: Request, service: ServiceDep, raster: Raster, work: str, **order: Any
) -> Response:
    """Answer with a view: its entity tag is known before it is made."""
    named = json.dumps([adret.__version__, raster.key, work, order], sort_keys=True)
    etag = f'"{hashlib.sha256(named.encode()).hexdigest()[:32]}"'
    headers = {
        "ETag": etag,
        "Cache-Control": f"private, max-age={AGE}",
        "X-Content-Type-Options": "nosniff",
    }
    known = request.headers.get("if-none-match", "").replace("W/", "")
    if etag in (tag.strip() for tag in known.split(",")):
        return Response(status_code=304, headers=headers)
    view: View = await service.viewers.ask(work, raster.key, **order)
    if not view.body:
        return Response(status_code=204, headers=headers)
    return Response(view.body, headers=headers, media_type=view.media_type)


add_views("/datasets/{dataset_id}", "Dataset", raster_of_dataset)
add_views("/jobs/{job_id}", "Job", raster_of_job)
