"""Health, metrics, tickets."""

from __future__ import annotations

from fastapi import APIRouter, Response
from prometheus_client import CONTENT_TYPE_LATEST

from physretarget._version import __version__
from physretarget.options import JOBS
from physretarget.sandbox.confine import available
from physretarget.service.access import GUARDED, Reader, ServiceOf
from physretarget.service.errors import responses
from physretarget.service.schemas import Health, OptionShown, QueueHealth, Ticket, TicketRequest

open_router = APIRouter(tags=["system"])
router = APIRouter(prefix="/api/v1", tags=["system"])


@open_router.get("/health", response_model=Health, responses=responses(400, 421))
async def health(service: ServiceOf) -> Health:
    """Whether the service is there; asks nothing that could be slow."""
    workers = service.supervisor.workers
    walls = available()
    return Health(
        status="ok" if workers == service.settings.workers and service.reachable else "degraded",
        version=__version__,
        queue=QueueHealth(
            queued=service.counts.get("queued", 0), running=service.counts.get("running", 0)
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
    url = f"{path}{between}ticket={service.tickets.make(path, caller.id)}"
    return Ticket(url=url, expires_in=service.tickets.seconds)
