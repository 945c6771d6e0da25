"""Orders: the body of an execution, as OGC API - Processes 1.0 has it."""

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from adret_service.outbound import Outbound
from adret_service.problems import FieldError, invalid
from adret_service.processes import Process

__all__ = ["Execute", "checked_request"]


class Part(BaseModel):
    """Base: nothing in it is passed over in silence."""

    model_config = ConfigDict(extra="forbid")


class Format(Part):
    """How an output is encoded; each has one encoding, and naming another is refused."""

    mediaType: str | None = Field(default=None, max_length=200)
    encoding: str | None = Field(default=None, max_length=40)
    schema_: Any = Field(default=None, alias="schema")


class Wanted(Part):
    """One output that is wanted, and how."""

    format: Format | None = None
    transmissionMode: Literal["value", "reference"] | None = Field(
        default=None,
        description="Default: in a document, files by reference and JSON by value; raw, by value.",
    )


class Subscriber(Part):
    """Addresses that are told what becomes of the job."""

    successUri: str | None = Field(
        default=None, max_length=2000, description="Gets the results document."
    )
    inProgressUri: str | None = Field(
        default=None, max_length=2000, description="Gets the status, while the job runs."
    )
    failedUri: str | None = Field(
        default=None, max_length=2000, description="Gets the status, if the job fails."
    )


class Execute(Part):
    """An order: the inputs of a process, and how its outputs are wanted."""

    inputs: dict[str, Any] = Field(default_factory=dict)
    outputs: dict[str, Wanted] | None = Field(
        default=None, description="Outputs that are wanted; left out: all."
    )
    response: Literal["document", "raw"] = Field(
        default="document",
        description="document: one JSON object; raw: the outputs themselves.",
    )
    subscriber: Subscriber | None = None


def checked_request(order: Execute, process: Process, outbound: Outbound) -> dict[str, Any]:
    """Return what a job keeps of how it was ordered.

    Raises
    ------
    Problem
        400 that names every refused output and address at once.
    """
    errors = []
    for name, wanted in (order.outputs or {}).items():
        described = process.outputs.get(name)
        if described is None:
            limit = f"left out: the outputs are {', '.join(process.outputs)}"
            errors.append(FieldError(f"outputs.{name}", limit, name))
            continue
        media = described["schema"].get("contentMediaType", "application/json")
        asked = wanted.format and wanted.format.mediaType
        if asked and essence(asked) != essence(media):
            errors.append(FieldError(f"outputs.{name}.format.mediaType", media, asked))
    request: dict[str, Any] = {"response": order.response}
    if order.outputs is not None:
        request["outputs"] = {k: v.transmissionMode for k, v in order.outputs.items()}
    if order.subscriber is not None:
        addresses = order.subscriber.model_dump(exclude_none=True)
        for name, address in addresses.items():
            refusal = outbound.refusal(address)
            if refusal is not None:
                errors.append(FieldError(f"subscriber.{name}", refusal, address))
        request["subscriber"] = addresses
    if errors:
        raise invalid(*errors)
    return request


def essence(media_type: str) -> str:
    """Return a media type without its parameters."""
    return media_type.split(";", 1)[0].strip().lower()
