"""The HTTP application, built by one call."""

import contextlib
import logging
from collections.abc import AsyncIterator
from urllib.parse import urlsplit

import anyio
from fastapi import FastAPI
from starlette.middleware.trustedhost import TrustedHostMiddleware

import adret
from adret_service import documents, problems
from adret_service.auth import KeyFile
from adret_service.context import Service
from adret_service.database import open_database
from adret_service.datasets import DatasetCatalogue
from adret_service.engine.durable import DurableEngine
from adret_service.engine.liveness import Lease, sweep_scratch
from adret_service.engine.port import JobEngine
from adret_service.ingest import Ingest
from adret_service.lookup import Lookup
from adret_service.middleware import BodyLimit, RequestId, SameOrigin
from adret_service.observing import Observe, Requests
from adret_service.queue_length import QueueLength
from adret_service.rates import Buckets, Rate
from adret_service.resuming import Partials
from adret_service.routes import (
    datasets,
    estimates,
    events,
    execution,
    frequent,
    health,
    jobs,
    landing,
    processes,
    results,
    skylines,
    tus,
    views,
)
from adret_service.settings import Settings
from adret_service.storage import open_storage
from adret_service.tokens import token_maker
from adret_service.upkeep import Upkeep
from adret_service.viewers import Viewers

__all__ = ["create_app"]

log = logging.getLogger("adret.service")

LOCAL_HOSTS = ["localhost", "127.0.0.1", "[::1]", "::1"]


def create_app(settings: Settings, engine: JobEngine | None = None) -> FastAPI:
    """Build the application; connections open when it starts and close when it stops.

    Parameters
    ----------
    settings : Settings
        Settings of the service.
    engine : JobEngine, optional
        Replaces the durable engine, for tests.

    Examples
    --------
    >>> create_app(Settings()).title
    'Adret'
    """

    @contextlib.asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        with contextlib.ExitStack() as stack:
            app.state.service = await anyio.to_thread.run_sync(
                open_service, settings, engine, stack
            )
            yield

    app = FastAPI(
        title="Adret",
        version=adret.__version__,
        description="Horizons, sky view, shadows and light from elevation models.",
        openapi_url="/api",
        docs_url="/docs",
        redoc_url=None,
        lifespan=lifespan,
        separate_input_output_schemas=False,
        responses={"default": {"model": documents.Problem, "description": "Refused, and why."}},
    )
    for router in (
        landing,
        processes,
        execution,
        estimates,
        jobs,
        results,
        events,
        datasets,
        tus,
        views,
        skylines,
        health,
    ):
        app.include_router(router.router)
    app.router.routes[:0] = [*frequent.ROUTES, execution.ORDINARY]
    problems.install(app)
    app.add_middleware(BodyLimit, limit=settings.max_body_bytes, exempt="/uploads")
    app.add_middleware(SameOrigin)
    if settings.auth == "none" and not settings.allow_insecure_bind:
        app.add_middleware(TrustedHostMiddleware, allowed_hosts=allowed_hosts(settings))
    app.state.requests = Requests()
    app.add_middleware(Observe, requests=app.state.requests)
    app.add_middleware(RequestId)
    return app


def allowed_hosts(settings: Settings) -> list[str]:
    """Names a request may call this server by: a web page elsewhere cannot rebind to it."""
    own = urlsplit(settings.base_url).hostname
    return [*LOCAL_HOSTS, settings.host, *([own] if own else [])]


def open_service(
    settings: Settings, engine: JobEngine | None, stack: contextlib.ExitStack
) -> Service:
    """Open what the routes share; `stack` closes it."""
    settings.data_dir.mkdir(parents=True, exist_ok=True, mode=0o700)
    settings.scratch_dir.mkdir(parents=True, exist_ok=True, mode=0o700)
    settings.locks_dir.mkdir(parents=True, exist_ok=True, mode=0o700)
    sweep_scratch(settings.locks_dir, settings.scratch_dir)
    lease = stack.enter_context(Lease(settings.locks_dir, settings.scratch_dir, "api"))
    storage = open_storage(settings)
    database = open_database(settings)
    stack.callback(database.dispose)
    catalogue = DatasetCatalogue(database, storage)
    swept = catalogue.sweep()
    if swept:
        log.info("removed %d unfinished entries of the store", swept)
    if engine is None:
        engine = DurableEngine(settings, database)
        stack.callback(engine.close)
        stack.enter_context(Upkeep(settings, engine, catalogue))
    ingest = Ingest(settings, catalogue, lease.scratch)
    ingest.decoder.start()
    stack.callback(ingest.decoder.close)
    viewers = Viewers(settings, storage, lease.scratch / "views")
    stack.callback(viewers.close)
    partials = Partials(settings.data_dir / "partial", settings.upload_ttl)
    partials.sweep()
    looking = (
        Lookup(engine.look),
        Lookup(catalogue.look),
        QueueLength(engine.waiting),
    )
    shared = (settings, engine, catalogue, storage, ingest, viewers, partials, *looking)
    if settings.auth == "none":
        return Service(*shared)
    rates = {
        "api": settings.rate_api,
        "submit": settings.rate_submit,
        "tiles": settings.rate_tiles,
    }
    buckets = {name: Buckets(Rate.parse(text)) for name, text in rates.items()}
    keys = KeyFile(settings.keys_file)
    tokens = token_maker(settings)
    return Service(*shared, keys, buckets, tokens)
