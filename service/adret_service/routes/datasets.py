"""Uploads become datasets; datasets are looked at and deleted."""

from typing import Annotated, Any

import anyio
from fastapi import APIRouter, Query, Request, Response

from adret_service.context import BaseUrl, Service, ServiceDep, Tenant
from adret_service.datasets import Dataset, public
from adret_service.documents import DatasetDocument, DatasetList
from adret_service.ids import is_id
from adret_service.ingest import ReadOptions
from adret_service.paging import Before, Limit, page_links
from adret_service.problems import Problem, missing
from adret_service.receiving import receive
from adret_service.scratch import scratch_bytes
from adret_service.storage import UPLOAD

router = APIRouter(tags=["datasets"])

UPLOAD_BODY = {
    "requestBody": {
        "required": True,
        "content": {
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "required": ["file"],
                    "properties": {
                        "file": {"type": "string", "contentMediaType": "application/octet-stream"}
                    },
                }
            },
            "application/octet-stream": {"schema": {}},
            "image/tiff": {"schema": {}},
        },
    }
}


@router.post(
    "/uploads",
    status_code=201,
    operation_id="upload",
    response_model=DatasetDocument,
    response_model_exclude_unset=True,
    openapi_extra=UPLOAD_BODY,
)
async def upload(
    request: Request,
    response: Response,
    service: ServiceDep,
    tenant: Tenant,
    base: BaseUrl,
    options: Annotated[ReadOptions, Query()],
) -> dict[str, Any]:
    """Take an elevation raster: GeoTIFF, Arc/Info ASCII grid or PNG; answers with its dataset.

    Send it as the multipart field `file`, or as the raw body with a `Content-Disposition` header
    that carries a `filename`. An equal upload gives the same dataset again.
    """
    require_room(service)
    settings = service.settings
    with service.ingest.folder() as folder:
        received = await receive(
            request, folder / UPLOAD, settings.max_upload_bytes, settings.upload_idle
        )
        dataset = await anyio.to_thread.run_sync(service.ingest.register, tenant, received, options)
    body = described(dataset, base)
    response.headers["Location"] = body["links"][0]["href"]
    return body


@router.get(
    "/datasets",
    operation_id="getDatasets",
    response_model=DatasetList,
    response_model_exclude_unset=True,
)
def list_datasets(
    service: ServiceDep, tenant: Tenant, base: BaseUrl, limit: Limit = 100, before: Before = None
) -> dict[str, Any]:
    """List datasets, newest first."""
    found = service.catalogue.list(tenant, limit=limit + 1, before=before)
    return {
        "datasets": [described(dataset, base) for dataset in found[:limit]],
        "links": page_links(f"{base}/datasets", limit, [d.id for d in found]),
    }


@router.get(
    "/datasets/{dataset_id}",
    operation_id="getDataset",
    response_model=DatasetDocument,
    response_model_exclude_unset=True,
)
def get_dataset(
    dataset_id: str, service: ServiceDep, tenant: Tenant, base: BaseUrl
) -> dict[str, Any]:
    """Describe one dataset."""
    return described(found_dataset(service, dataset_id, tenant), base)


@router.delete("/datasets/{dataset_id}", status_code=204, operation_id="deleteDataset")
def delete_dataset(dataset_id: str, service: ServiceDep, tenant: Tenant) -> None:
    """Delete a dataset that no unfinished job reads."""
    found_dataset(service, dataset_id, tenant)
    if not service.catalogue.delete(dataset_id, tenant):
        raise Problem(409, "an unfinished job reads this dataset")


def found_dataset(service: Service, dataset_id: str, tenant: str) -> Dataset:
    """Return the dataset or answer 404."""
    dataset = service.catalogue.get(dataset_id, tenant) if is_id(dataset_id) else None
    if dataset is None:
        raise missing("dataset", dataset_id)
    return dataset


def require_room(service: Service) -> None:
    """Answer 507 when the disk is almost full."""
    free = service.storage.free_bytes()
    if free < service.settings.min_free_bytes:
        detail = f"free space: must be {service.settings.min_free_bytes}, got {free}"
        raise Problem(507, detail)
    most = service.settings.scratch_max_bytes
    used = scratch_bytes(service.settings.scratch_dir, fresh=1.0)
    if used > most:
        detail = f"work in progress: must be at most {most} bytes, got {used}"
        raise Problem(507, detail, headers={"Retry-After": "30"})


def described(dataset: Dataset, base: str) -> dict[str, Any]:
    """Return the public form of a dataset with its links."""
    href = f"{base}/datasets/{dataset.id}"
    links = [
        ("self", "application/json", ""),
        ("tilejson", "application/json", "/tilejson.json"),
        ("preview", "image/png", "/preview.png"),
        ("map", "text/html", "/map.html"),
    ]
    return public(dataset) | {
        "links": [{"rel": rel, "type": media, "href": href + path} for rel, media, path in links]
    }
