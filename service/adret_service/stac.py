"""A result as a STAC item: where it lies, what made it, and where its files are."""

from collections.abc import Mapping
from typing import Any

from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError, ProjError

from adret_service.datasets import Dataset, timestamp
from adret_service.engine.port import JobRecord
from adret_service.processes import Process
from adret_service.results import reference
from adret_service.storage import Artefact

__all__ = ["item"]

EXTENSIONS = {
    "projection": "https://stac-extensions.github.io/projection/v2.0.0/schema.json",
    "processing": "https://stac-extensions.github.io/processing/v1.2.0/schema.json",
    "file": "https://stac-extensions.github.io/file/v2.1.0/schema.json",
}
ROLES = {"result": ["data"], "preview": ["overview", "thumbnail"]}
EDGE = 21  # points on each edge that are carried over to longitude and latitude
SHA256 = "1220"  # what a multihash begins with: SHA-256, 32 bytes


def item(
    job: JobRecord,
    process: Process,
    dataset: Dataset | None,
    artefacts: Mapping[str, Artefact],
    base: str,
) -> dict[str, Any]:
    """Return the STAC 1.1 item of a successful job.

    A raster without a CRS lies nowhere on Earth: its geometry is null, as the specification asks.

    Parameters
    ----------
    job : JobRecord
        A successful job.
    process : Process
        What was computed.
    dataset : Dataset or None
        What it was computed from, if that is still there.
    artefacts : mapping of str to Artefact
        Its outputs.
    base : str
        Absolute URL of the service.
    """
    href = f"{base}/jobs/{job.id}"
    made = timestamp(job.finished)
    properties: dict[str, Any] = {
        "title": process.title,
        "description": process.description,
        "datetime": made,
        "created": made,
        "processing:software": {"adret": process.version},
        "processing:expression": {"format": f"adret {process.id}", "expression": dict(job.inputs)},
        "processing:lineage": f"{process.title} of dataset {job.dataset}, job {job.id}",
    }
    info: Mapping[str, Any] = {} if dataset is None else dataset.info
    place = _place(info)
    if place is not None:
        properties |= place["properties"]
    links = [
        {"rel": "self", "type": "application/geo+json", "href": f"{href}/stac"},
        {"rel": "root", "type": "application/json", "href": f"{base}/"},
        {"rel": "via", "type": "application/json", "href": href, "title": "the job"},
    ]
    if dataset is not None:
        source = f"{base}/datasets/{dataset.id}"
        links.append({"rel": "derived_from", "type": "application/json", "href": source})
    found: dict[str, Any] = {
        "type": "Feature",
        "stac_version": "1.1.0",
        "stac_extensions": list(EXTENSIONS.values()),
        "id": job.id,
        "geometry": None if place is None else place["geometry"],
        "properties": properties,
        "links": links,
        "assets": {
            name: _asset(job, process, name, artefact, base) for name, artefact in artefacts.items()
        },
    }
    if place is not None:
        found["bbox"] = place["bbox"]
    return found


def _asset(
    job: JobRecord, process: Process, name: str, artefact: Artefact, base: str
) -> dict[str, Any]:
    described = process.outputs.get(name, {})
    return {
        "href": reference(job, name, artefact, base)["href"],
        "type": artefact.media_type,
        "title": described.get("title", name),
        "description": described.get("description", name),
        "roles": ROLES.get(name, ["data"]),
        "file:size": artefact.size,
        "file:checksum": SHA256 + artefact.sha256,
    }


def _place(info: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return bounding box, outline and projection of a raster; None if it lies nowhere."""
    crs, transform = info.get("crs"), info.get("transform")
    if not crs or not transform:
        return None
    rows, columns = int(info["rows"]), int(info["columns"])
    a, b, c, d, e, f = (float(value) for value in transform[:6])
    edge = [k / (EDGE - 1) for k in range(EDGE)]
    outline = [(t, 0.0) for t in edge] + [(1.0, t) for t in edge[1:]]
    outline += [(1.0 - t, 1.0) for t in edge[1:]] + [(0.0, 1.0 - t) for t in edge[1:]]
    cells = [(u * columns, v * rows) for u, v in outline]
    try:
        to_degrees = Transformer.from_crs(CRS.from_user_input(crs), "OGC:CRS84", always_xy=True)
        x, y = to_degrees.transform(
            [a * u + b * v + c for u, v in cells],
            [d * u + e * v + f for u, v in cells],
            errcheck=True,
        )
    except (CRSError, ProjError):
        return None  # another body, or no place on this one
    ring = [[round(float(p), 8), round(float(q), 8)] for p, q in zip(x, y, strict=True)]
    ring.reverse()  # counter-clockwise, as GeoJSON's outlines are
    lon, lat = [p for p, _ in ring], [q for _, q in ring]
    epsg = info.get("epsg")
    projection = {
        "proj:code": f"EPSG:{epsg}" if epsg else None,
        "proj:wkt2": crs,
        "proj:shape": [rows, columns],
        "proj:transform": [a, b, c, d, e, f, 0.0, 0.0, 1.0],
    }
    return {
        "bbox": [min(lon), min(lat), max(lon), max(lat)],
        "geometry": {"type": "Polygon", "coordinates": [ring]},
        "properties": projection,
    }
