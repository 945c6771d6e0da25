"""Traces by OpenTelemetry, where a setting names a collector; nothing is imported where none does.

A request is a span, and the job it orders is another one in the same trace, in whichever process
and however much later it runs: the order keeps the W3C ``traceparent``.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from starlette.requests import Request

import adret
from adret_service.settings import Settings

__all__ = ["job_span", "request_span", "set_up_tracing", "traceparent"]


class Span:
    """A span of a request; this one goes nowhere."""

    def ends(self, route: str, status: int) -> None:
        """Say what became of the request."""


class _Recorded(Span):
    def __init__(self, span: Any) -> None:
        self._span = span

    def ends(self, route: str, status: int) -> None:
        self._span.update_name(f"{self._span.attributes['http.request.method']} {route}")
        self._span.set_attribute("http.route", route)
        self._span.set_attribute("http.response.status_code", status)


_tracer: Any = None


def set_up_tracing(settings: Settings, role: str) -> None:
    """Send spans of this process to the collector that the settings name, if they name one.

    Raises
    ------
    RuntimeError
        If a collector is named and the packages of ``adret[otel]`` are not installed.
    """
    global _tracer
    if not settings.otel_endpoint:
        return
    try:
        from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
        from opentelemetry.sdk.resources import Resource
        from opentelemetry.sdk.trace import TracerProvider
        from opentelemetry.sdk.trace.export import BatchSpanProcessor
    except ImportError as error:
        raise RuntimeError(
            'otel_endpoint: needs the packages of "adret[otel]" to be installed'
        ) from error
    about = {"service.name": f"adret-{role}", "service.version": adret.__version__}
    provider = TracerProvider(resource=Resource.create(about))
    exporter = OTLPSpanExporter(f"{settings.otel_endpoint.rstrip('/')}/v1/traces")
    provider.add_span_processor(BatchSpanProcessor(exporter, schedule_delay_millis=1000))
    _tracer = provider.get_tracer("adret_service")


@contextmanager
def request_span(request: Request) -> Iterator[Span]:
    """Yield the span of a request, a child of the caller's if it sent one."""
    if _tracer is None:
        yield Span()
        return
    from opentelemetry.trace import SpanKind

    attributes = {"http.request.method": request.method, "url.path": request.url.path}
    with _tracer.start_as_current_span(
        request.method,
        context=_context(request.headers.get("traceparent", "")),
        kind=SpanKind.SERVER,
        attributes=attributes,
    ) as span:
        yield _Recorded(span)


@contextmanager
def job_span(job_id: str, process: str, parent: str) -> Iterator[None]:
    """Trace the run of a job, as a child of the request that ordered it."""
    if _tracer is None:
        yield
        return
    attributes = {"adret.job": job_id, "adret.process": process}
    with _tracer.start_as_current_span(
        f"job {process}", context=_context(parent), attributes=attributes
    ):
        yield


def traceparent() -> str:
    """Return the current span's ``traceparent``, empty where nothing is traced."""
    if _tracer is None:
        return ""
    from opentelemetry.trace.propagation.tracecontext import TraceContextTextMapPropagator

    carrier: dict[str, str] = {}
    TraceContextTextMapPropagator().inject(carrier)
    return carrier.get("traceparent", "")


def _context(parent: str) -> Any:
    from opentelemetry.trace.propagation.tracecontext import TraceContextTextMapPropagator

    return TraceContextTextMapPropagator().extract({"traceparent": parent} if parent else {})
