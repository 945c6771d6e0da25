"""Runs the HTTP server, and its workers when it has that role."""

import contextlib
import gc

from adret_service.settings import Settings
from adret_service.supervisor import Supervisor
from adret_service.tracing import set_up_tracing
from adret_service.worker import set_up_logging

__all__ = ["serve"]


def serve(settings: Settings) -> None:
    """Serve until a signal comes."""
    set_up_logging(settings)
    set_up_tracing(settings, "api")
    with contextlib.ExitStack() as stack:
        if settings.role == "all":
            stack.enter_context(Supervisor(settings))

        # Imported while the workers start.
        import uvicorn

        from adret_service.app import create_app
        from adret_service.http1 import BoundedHttp
        from adret_service.offers import offered

        offered(echo=settings.enable_echo)  # not while the first order waits

        config = uvicorn.Config(
            create_app(settings),
            host=settings.host,
            port=settings.port,
            log_level=settings.log_level,
            log_config=None,
            http=BoundedHttp,
            access_log=False,  # `Observe` writes one that knows the request's id
            server_header=False,
            proxy_headers=False,
            limit_concurrency=1000,
            timeout_graceful_shutdown=5,
        )
        # What start-up made stays for good. Looking through it for garbage, as Python does every so
        # often, would hold every answer up for 50 to 300 ms.
        gc.collect()
        gc.freeze()
        uvicorn.Server(config).run()
