"""The JSON documents that the service sends, as the OpenAPI document describes them."""

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

__all__ = [
    "DatasetDocument",
    "DatasetList",
    "Estimate",
    "Link",
    "PointValues",
    "Problem",
    "Process",
    "ProcessList",
    "Refused",
    "ResultReference",
    "Results",
    "Skyline",
    "StacItem",
    "StatusInfo",
    "StatusList",
    "TileGrid",
    "UploadState",
]

Status = Literal["accepted", "running", "successful", "failed", "dismissed"]
Json = str | float | int | bool | None


class Document(BaseModel):
    """Base: documents may grow."""

    model_config = ConfigDict(extra="allow")


class Link(Document):
    """A link to another document."""

    href: str
    rel: str
    type: str | None = None
    title: str | None = None


class Refused(Document):
    """A value that was refused."""

    field: str
    limit: str = Field(description="What it must be, read after 'must be'.")
    value: Json = Field(description="What was given, shortened.")


class Problem(Document):
    """An error: RFC 9457, valid as an OGC exception."""

    type: str
    title: str
    status: int
    detail: str
    instance: str
    errors: list[Refused]
    request_id: str


class StatusInfo(Document):
    """A job: version 1.0 and the draft of 2.0 of OGC API - Processes in one."""

    jobID: str
    id: str
    processID: str
    type: Literal["process"]
    processingEntityType: Literal["process"]
    status: Status
    message: str
    progress: int = Field(ge=0, le=100, description="Percent.")
    created: str
    updated: str
    started: str | None = None
    finished: str | None = None
    inputs: dict[str, Any]
    exception: dict[str, Any] | None = Field(default=None, description="Why it failed.")
    links: list[Link]


class StatusList(Document):
    """A page of jobs."""

    jobs: list[StatusInfo]
    links: list[Link]


class ResultReference(Document):
    """One output, by reference."""

    href: str
    type: str
    length: int = Field(description="Bytes.")
    sha256: str


class Results(Document):
    """Outputs by name: each a link (`ResultReference`), or a value."""

    result: ResultReference | dict[str, Any] | None = None
    preview: ResultReference | dict[str, Any] | None = None


class StacItem(Document):
    """A STAC item."""

    type: Literal["Feature"]
    stac_version: str
    id: str
    geometry: dict[str, Any] | None
    properties: dict[str, Any]
    links: list[Link]
    assets: dict[str, Any]
    bbox: list[float] | None = None


class Seconds(Document):
    """A time that is foreseen, and how far it may be off."""

    expected: float
    low: float
    high: float
    basis: str


class Estimate(Document):
    """What an order would cost."""

    process: str
    cells: int
    passes: int = Field(description="Azimuths, observers or samples, each over all cells.")
    seconds: Seconds
    accepted: bool = Field(description="Whether the order would be taken now.")
    reason: str | None = None
    bands: int | None = None
    result_bytes: int | None = Field(default=None, description="About.")
    memory_bytes: int | None = Field(default=None, description="About.")


class LogLine(Document):
    """One thing that happened to a job."""

    id: int
    at: str
    level: str
    message: str
    status: str | None = None
    progress: int | None = None


class LogPage(Document):
    """What happened to a job, oldest first; `next` is where more will be."""

    logs: list[LogLine]
    links: list[Link]


class DatasetDocument(Document):
    """An elevation model in the service, heights in metres; or a depth buffer with its camera."""

    id: str
    name: str
    sha256: str = Field(description="Digest of the upload, and of how it was to be read.")
    size: int = Field(description="Bytes uploaded.")
    created: str
    kind: Literal["terrain", "depth"] = "terrain"
    rows: int
    columns: int
    links: list[Link]
    cell_size: list[float] | None = Field(
        default=None, description="Ground width and height of a cell [m]."
    )
    crs: str | None = Field(default=None, description="WKT.")
    crs_name: str | None = None
    epsg: int | None = None
    transform: list[float] | None = Field(
        default=None,
        description="a, b, c, d, e, f: x = a column + b row + c, y = d column + e row + f.",
    )
    lowest: float | None = None
    highest: float | None = None
    nodata_cells: int | None = None
    camera: dict[str, Any] | None = Field(default=None, description="Of a depth buffer.")
    guard_band: list[int] | None = Field(
        default=None, description="Pixels at top, right, bottom, left that only occlude."
    )
    nearest: float | None = Field(default=None, description="Least depth [view units].")
    farthest: float | None = Field(default=None, description="Largest depth [view units].")
    sky_pixels: int | None = None
    hole_pixels: int | None = None


class DatasetList(Document):
    """A page of datasets."""

    datasets: list[DatasetDocument]
    links: list[Link]


class UploadState(Document):
    """An upload in pieces: how far it is, and the dataset that became of it."""

    id: str
    offset: int = Field(description="Bytes that have come.")
    length: int
    dataset: str | None = None
    links: list[Link] | None = None


class TileGrid(Document):
    """TileJSON 3.0, and which bands there are."""

    tilejson: str
    name: str
    scheme: Literal["xyz"]
    tiles: list[str]
    map: str = Field(description="A page that shows them.")
    minzoom: int
    maxzoom: int = Field(description="At which a pixel is about a cell.")
    bounds: list[float] = Field(description="West, south, east, north [degrees, or cells].")
    center: list[float]
    grid: Literal["WebMercatorQuad", "cells"] = Field(
        description="cells: the raster has no place on the Earth and is cut along its own cells."
    )
    bands: list[str]
    unit: str | None


class PointValues(Document):
    """The values of a raster at a place."""

    coordinates: list[float] = Field(description="Longitude, latitude [degrees].")
    values: list[float | None]
    band_names: list[str]
    band_descriptions: list[str]
    unit: str | None


class Skyline(Document):
    """A horizon, as PVGIS prints it, and more exactly besides."""

    inputs: dict[str, Any]
    outputs: dict[str, Any]
    meta: dict[str, Any]


class Process(Document):
    """What can be computed."""

    id: str
    title: str
    description: str
    version: str
    jobControlOptions: list[str]
    outputTransmission: list[str]
    links: list[Link]
    inputs: dict[str, Any] | None = Field(default=None, description="By name, with JSON Schemas.")
    outputs: dict[str, Any] | None = None


class ProcessList(Document):
    """A page of processes."""

    processes: list[Process]
    links: list[Link]
