"""Every request is counted, timed, logged and, where it is asked for, traced."""

import logging
import time

from prometheus_client import CollectorRegistry, Histogram
from prometheus_client.process_collector import ProcessCollector
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from adret_service.logs import about
from adret_service.tracing import request_span

__all__ = ["Observe", "Requests"]

log = logging.getLogger("adret.access")

BUCKETS = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0, 60.0)
QUIET = ("/healthz", "/readyz", "/metrics")  # asked all the time: no log line unless refused


class Requests:
    """Counts and times of the requests of one process."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        ProcessCollector(registry=self.registry)
        self._seconds = Histogram(
            "adret_http_request_seconds",
            "Time until the head of the answer was sent.",
            ["method", "route", "status"],
            buckets=BUCKETS,
            registry=self.registry,
        )

    def seen(self, method: str, route: str, status: int, seconds: float) -> None:
        """Note one request."""
        self._seconds.labels(method, route, str(status)).observe(seconds)


class Observe:
    """Tells `requests`, the log and the trace of every request.

    Parameters
    ----------
    app : ASGIApp
        What comes next.
    requests : Requests
        Where requests are counted.
    """

    def __init__(self, app: ASGIApp, *, requests: Requests) -> None:
        self.app = app
        self.requests = requests

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        began = time.perf_counter()
        method = scope["method"]

        def ended(status: int) -> None:
            took, route = time.perf_counter() - began, route_of(scope)
            self.requests.seen(known_method(method), route, status, took)
            span.ends(route, status)
            level = logging.INFO if status >= 400 or route not in QUIET else logging.DEBUG
            fields = {
                "method": method,
                "route": route,
                "status": status,
                "seconds": round(took, 6),
            }
            text = "%s %s %d %.1f ms"
            shown = method, scope["path"], status, 1e3 * took
            log.log(level, text, *shown, extra={"fields": fields})

        async def noted(message: Message) -> None:
            await send(message)
            if message["type"] == "http.response.start":
                ended(message["status"])

        request_id = str(scope.get("request_id", ""))
        with about(request_id=request_id), request_span(Request(scope)) as span:
            try:
                await self.app(scope, receive, noted)
            except Exception:
                ended(500)  # whoever is outside of this answers so
                raise


def route_of(scope: Scope) -> str:
    """Return the template of the route, so that ids in paths make no new series."""
    return str(getattr(scope.get("route"), "path_format", "unknown"))


def known_method(method: str) -> str:
    """Return the method, or a word for what is none."""
    return method if method in ("GET", "HEAD", "POST", "PUT", "PATCH", "DELETE") else "other"
