"""What can be computed."""

from typing import Annotated, Any

from fastapi import APIRouter, Query

from adret_service.context import BaseUrl, ServiceDep
from adret_service.documents import Process, ProcessList
from adret_service.offers import offered
from adret_service.routes.execution import known_process
from adret_service.settings import Settings

router = APIRouter(tags=["processes"])

EXECUTE = "http://www.opengis.net/def/rel/ogc/1.0/execute"


@router.get(
    "/processes",
    operation_id="getProcesses",
    response_model=ProcessList,
    response_model_exclude_unset=True,
)
def list_processes(
    service: ServiceDep,
    base: BaseUrl,
    limit: Annotated[int, Query(ge=1, le=1000)] = 100,
    offset: Annotated[int, Query(ge=0, le=1_000_000)] = 0,
) -> dict[str, Any]:
    """List the processes."""
    found = list(offered(echo=service.settings.enable_echo).values())
    links = [_link("self", f"{base}/processes?limit={limit}&offset={offset}")]
    if offset + limit < len(found):
        links.append(_link("next", f"{base}/processes?limit={limit}&offset={offset + limit}"))
    return {
        "processes": [
            process.summary()
            | {
                "links": [
                    _link("self", f"{base}/processes/{process.id}"),
                    _link(EXECUTE, f"{base}/processes/{process.id}/execution"),
                ]
            }
            for process in found[offset : offset + limit]
        ],
        "links": links,
    }


@router.get(
    "/processes/{process_id}",
    operation_id="getProcessDescription",
    response_model=Process,
    response_model_exclude_unset=True,
)
def describe_process(process_id: str, service: ServiceDep, base: BaseUrl) -> dict[str, Any]:
    """Describe a process: its inputs as JSON Schema, its outputs, its limits."""
    process = known_process(service, process_id)
    href = f"{base}/processes/{process_id}"
    links = [
        _link("self", href),
        _link(EXECUTE, f"{href}/execution"),
        _link("estimate", f"{href}/estimate"),
    ]
    return process.summary() | {
        "inputs": process.inputs,
        "outputs": process.outputs,
        "additionalParameters": limits(service.settings),
        "links": links,
    }


def limits(settings: Settings) -> dict[str, Any]:
    """Return the limits of this service in the standard's form."""
    named = {
        "maxCells": settings.max_pixels,
        "maxSeconds": settings.job_timeout,
        "maxCellsToWaitFor": settings.sync_max_cells,
        "maxSecondsToWait": settings.sync_wait,
    }
    parameters = [{"name": name, "value": [value]} for name, value in named.items()]
    return {"title": "Limits", "role": "limits", "parameters": parameters}


def _link(rel: str, href: str) -> dict[str, str]:
    return {"rel": rel, "type": "application/json", "href": href}
