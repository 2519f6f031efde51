"""Health, metrics, tickets."""

from __future__ import annotations

import time

from fastapi import APIRouter, Response
from prometheus_client import CONTENT_TYPE_LATEST

from physretarget._version import __version__
from physretarget.options import JOBS
from physretarget.sandbox.confine import available
from physretarget.service.access import GUARDED, Reader, ServiceOf
from physretarget.service.errors import responses
from physretarget.service.schemas import (
    DiskHealth,
    Health,
    Live,
    OptionShown,
    QueueHealth,
    Ticket,
    TicketRequest,
    TroubleShown,
)

open_router = APIRouter(tags=["system"])
router = APIRouter(prefix="/api/v1", tags=["system"])


@open_router.get("/health/live", response_model=Live, responses=responses(400, 421))
async def live() -> Live:
    """Whether the process answers: if not, start it anew."""
    return Live(status="ok", version=__version__)


@open_router.get(
    "/health/ready",
    response_model=Health,
    responses={
        503: {"model": Health, "description": "Send work elsewhere."},
        **responses(400, 421),
    },
)
async def ready(service: ServiceOf, response: Response) -> Health:
    """Whether work is taken and done: if not, 503 and why."""
    found = await health(service)
    if found.troubles:
        response.status_code = 503
    return found


@open_router.get("/health", response_model=Health, responses=responses(400, 421))
async def health(service: ServiceOf) -> Health:
    """What the service is doing, and what is wrong; asks nothing that could be slow."""
    workers = service.supervisor.workers
    walls = available()
    found = service.troubles()
    return Health(
        status="degraded" if found else "ok",
        troubles=[TroubleShown(what=each.what, message=each.message) for each in found],
        disk=DiskHealth(free_bytes=service.free, reserve_bytes=service.settings.reserve),
        database_age_s=round(time.monotonic() - service.looked, 1),
        version=__version__,
        queue=QueueHealth(
            queued=service.counts.get("queued", 0),
            running=service.counts.get("running", 0),
            oldest=service.oldest,
        ),
        workers=workers,
        sandbox={"landlock": walls.landlock > 0, "seccomp": walls.seccomp},
        tokens=service.locked,
    )


@open_router.get(
    "/metrics",
    response_class=Response,
    responses={
        200: {
            "description": "Metrics in Prometheus' text format.",
            "content": {"text/plain": {"schema": {"type": "string"}}},
        },
        **responses(*GUARDED),
    },
)
def metrics(service: ServiceOf, caller: Reader) -> Response:
    """Prometheus metrics."""
    for status, count in service.counts.items():
        service.metrics.jobs.labels(status).set(count)
    service.metrics.workers.set(service.supervisor.workers)
    return Response(service.metrics.text(), media_type=CONTENT_TYPE_LATEST)


@router.get("/options", response_model=dict[str, list[OptionShown]], responses=responses(*GUARDED))
def list_options(caller: Reader) -> dict[str, list[OptionShown]]:
    """The options of each kind of job: what they are, what they may be, and their defaults."""
    return {
        kind: [OptionShown(**each.to_dict()) for each in schema.api]
        for kind, schema in JOBS.items()
    }


@router.post("/tickets", response_model=Ticket, responses=responses(422, *GUARDED))
def make_ticket(wanted: TicketRequest, service: ServiceOf, caller: Reader) -> Ticket:
    """A URL of a report, replay or clip that opens without the Authorization header.

    Frames, links and downloads of a browser cannot send one.
    """
    path = wanted.path
    between = "&" if "?" in path else "?"
    url = (
        f"{service.settings.root_path}{path}{between}ticket={service.tickets.make(path, caller.id)}"
    )
    return Ticket(url=url, expires_in=service.tickets.seconds)
