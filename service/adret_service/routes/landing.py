"""The landing page and the conformance declaration."""

from typing import Any

from fastapi import APIRouter

from adret_service.context import BaseUrl

router = APIRouter(tags=["landing"])

OGC = "http://www.opengis.net/spec/ogcapi-processes-1/1.0/conf/"
CLASSES = ("core", "json", "ogc-process-description", "job-list", "dismiss", "callback")
CONFORMS_TO = [OGC + name for name in CLASSES]
REL = "http://www.opengis.net/def/rel/ogc/1.0/"


@router.get("/", operation_id="getLandingPage")
def landing(base: BaseUrl) -> dict[str, Any]:
    """Say what this is and where its parts are."""
    links = [
        ("self", "application/json", "/", "this document"),
        ("service-desc", "application/vnd.oai.openapi+json;version=3.1", "/api", "the API"),
        ("service-doc", "text/html", "/docs", "the API, to read"),
        (REL + "conformance", "application/json", "/conformance", "conformance classes"),
        (REL + "processes", "application/json", "/processes", "what can be computed"),
        (REL + "job-list", "application/json", "/jobs", "jobs"),
    ]
    return {
        "title": "Adret",
        "description": "How light falls on a height field: bring an elevation model, get it lit.",
        "links": [
            {"rel": rel, "type": media, "href": base + path, "title": title}
            for rel, media, path, title in links
        ],
    }


@router.get("/conformance", operation_id="getConformanceClasses")
def conformance() -> dict[str, list[str]]:
    """List the conformance classes that the service aims at; no suite has certified it."""
    return {"conformsTo": CONFORMS_TO}
