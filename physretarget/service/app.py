"""The application: routes, errors and envelope around one service."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

from anyio import to_thread
from fastapi import FastAPI

from physretarget._version import __version__
from physretarget.service import (
    errors,
    pages,
    routes_jobs,
    routes_library,
    routes_results,
    routes_system,
)
from physretarget.service.access import Rates
from physretarget.service.below import Below
from physretarget.service.middleware import Envelope
from physretarget.service.service import Service

_COUNT_S = 1.0


def create_app(service: Service) -> FastAPI:
    """The application of a service; its lifespan starts and stops the workers."""

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        await to_thread.run_sync(service.start)
        counting = asyncio.create_task(_count(service))
        try:
            yield
        finally:
            counting.cancel()
            with suppress(asyncio.CancelledError):
                await counting
            await to_thread.run_sync(service.stop)

    app = FastAPI(
        title="physretarget",
        version=__version__,
        summary="Clips judged by physics, captures retargeted to characters.",
        docs_url=None,
        redoc_url=None,
        lifespan=lifespan,
        separate_input_output_schemas=False,
    )
    app.state.service = service
    app.state.rates = Rates(service.settings.rate, service.settings.burst)
    strangers = service.settings.stranger_rate
    app.state.strangers = Rates(strangers, max(1, int(strangers)))
    app.include_router(routes_system.open_router)
    for module in (routes_jobs, routes_results, routes_library, routes_system):
        app.include_router(module.router)
    pages.install(app)
    errors.install(app)
    app.add_middleware(Below, root=service.settings.root_path)
    app.add_middleware(Envelope, hosts=service.settings.hosts, metrics=service.metrics)
    return app


async def _count(service: Service) -> None:
    """Keep at hand how many jobs there are: health must not wait for the database."""
    while True:
        # A database that does not answer must not keep the service from ending.
        await to_thread.run_sync(service.look, abandon_on_cancel=True)
        await asyncio.sleep(_COUNT_S)
