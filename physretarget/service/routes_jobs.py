"""Jobs: submit, look, follow, cancel, delete."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from typing import Annotated

from anyio import to_thread
from fastapi import APIRouter, Header, Query, Request, Response, status
from fastapi.responses import StreamingResponse

from physretarget.service import schemas
from physretarget.service.access import GUARDED, Reader, ServiceOf, Submitter
from physretarget.service.errors import ApiError, responses
from physretarget.service.forms import form_body, job_form
from physretarget.service.schemas import Job, JobPage
from physretarget.service.service import Service
from physretarget.service.submission import (
    FIELDS,
    FILES,
    admit,
    draft,
    enqueue,
    same_or_conflict,
)
from physretarget.service.tokens import Caller
from physretarget.service.uploads import Bounds, received
from physretarget.suite.queue import JobRecord

router = APIRouter(prefix="/api/v1", tags=["jobs"])
_LOOK_S = 0.25
Limit = Annotated[int, Query(ge=1, le=200)]
Cursor = Annotated[str | None, Query(pattern=r"^[0-9a-z]{26}$")]
Text = Annotated[str | None, Query(max_length=200, pattern=r"^[^\x00-\x1f]*$")]
_Key = Annotated[
    str | None,
    Header(
        alias="Idempotency-Key", pattern=r"^[!-~]{1,200}$",
        description="The same key with the same content makes one job, however often it is sent.",
    ),
]  # fmt: skip


def job_of(service: Service, id: str, caller: Caller) -> JobRecord:
    """The job that the caller may read, or 404."""
    found = service.queue.get(id, caller.owner)
    if found is None:
        raise ApiError(404, "There is no such job.")
    return found


def shown(job: JobRecord, service: Service) -> Job:
    """A job as the API gives it."""
    place = f"{service.settings.root_path}/api/v1/jobs/{job.id}"
    return Job(
        id=job.id, kind=job.kind, status=job.status, progress=job.progress, stage=job.stage,  # type: ignore[arg-type]
        created=job.created, started=job.started, finished=job.finished,
        clip=schemas.JobClip(name=job.clip_name, sha256=job.clip_sha256),
        model=schemas.JobModel(id=job.model_id, name=job.model_name),
        options=dict(job.options),
        summary=schemas.Summary(**job.summary) if job.summary else None,
        error=schemas.JobError(**job.error) if job.error else None,
        attempts=job.attempts,
        links=schemas.Links(
            self=place, **{n: f"{place}/{n}" for n in ("events", "cancel", "report", "replay",
                                                        "clip")},
        ),
    )  # fmt: skip


@router.post(
    "/jobs",
    status_code=status.HTTP_202_ACCEPTED,
    response_model=Job,
    responses={
        202: {"headers": {"Location": {"schema": {"type": "string"}}}},
        **responses(404, 408, 409, 413, 415, 422, 507, *GUARDED),
    },
    openapi_extra=form_body(job_form()),
)
async def submit(
    request: Request, response: Response, service: ServiceOf, caller: Submitter, key: _Key = None
) -> Job:
    """Submit a clip to be judged, or a capture to be retargeted and judged."""
    bounds = Bounds(
        fields=FIELDS, files=FILES, bytes=service.settings.limits.upload_bytes,
        idle=service.settings.upload_idle, rate=service.settings.upload_rate,
    )  # fmt: skip
    idempotency = f"{caller.id}:{key}" if key else None
    async with received(
        request, service.home.incoming, bounds, reserve=service.settings.reserve
    ) as form:
        drafted = await to_thread.run_sync(draft, form, service, caller.owner)
        known = await to_thread.run_sync(service.queue.find, idempotency) if idempotency else None
        if known is None:
            admitted = await admit(drafted, form, service)
            job, _ = await to_thread.run_sync(
                enqueue, drafted, form, service, admitted, idempotency, caller
            )
        else:
            same_or_conflict(known, drafted)
            job = known
    made = shown(job, service)
    response.headers["Location"] = made.links.self
    return made


@router.get("/jobs", response_model=JobPage, responses=responses(422, *GUARDED))
def list_jobs(
    service: ServiceOf,
    caller: Reader,
    status: schemas.Status | None = None,
    kind: schemas.Kind | None = None,
    q: Text = None,
    model: Text = None,
    limit: Limit = 50,
    cursor: Cursor = None,
) -> JobPage:
    """Jobs, newest first."""
    found = service.queue.page(
        status=status,
        kind=kind,
        q=q,
        model=model,
        before=cursor,
        limit=limit + 1,
        owner=caller.owner,
    )
    return JobPage(
        items=[shown(job, service) for job in found[:limit]],
        next=found[limit - 1].id if len(found) > limit else None,
    )


@router.get("/jobs/{id}", response_model=Job, responses=responses(404, 422, *GUARDED))
def get_job(id: schemas.Id, service: ServiceOf, caller: Reader) -> Job:
    """One job."""
    return shown(job_of(service, id, caller), service)


@router.post("/jobs/{id}/cancel", response_model=Job, responses=responses(404, 409, 422, *GUARDED))
def cancel_job(id: schemas.Id, service: ServiceOf, caller: Submitter) -> Job:
    """Cancel a job: a queued one at once, a running one as soon as its process has ended."""
    job = service.queue.cancel(id, caller.owner)
    if job is None:
        raise ApiError(404, "There is no such job.")
    if job.status in ("done", "failed"):
        raise ApiError(409, f"The job is {job.status}.")
    if job.status == "running":
        service.supervisor.cancel(id)
    else:
        service.release(job)
    return shown(job, service)


@router.delete("/jobs/{id}", status_code=204, responses=responses(404, 409, 422, *GUARDED))
def delete_job(id: schemas.Id, service: ServiceOf, caller: Submitter) -> Response:
    """Delete a job that has ended, with its results."""
    if not service.delete_job(id, caller.owner):
        job = service.queue.get(id, caller.owner)
        if job is None or (caller.owner is not None and job.belongs_to != caller.owner):
            raise ApiError(404, "There is no such job of yours.")
        raise ApiError(409, f"The job is {job.status}; cancel it first.")
    return Response(status_code=204)


@router.post("/jobs/{id}/share", response_model=Job, responses=responses(404, 422, *GUARDED))
def share_job(id: schemas.Id, service: ServiceOf, caller: Submitter, shared: bool = True) -> Job:
    """Let every token read a job of yours and its results, or no longer."""
    job = service.queue.share(id, shared, caller.owner)
    if job is None:
        raise ApiError(404, "There is no such job of yours.")
    return shown(job, service)


@router.get(
    "/jobs/{id}/events",
    response_class=StreamingResponse,
    responses={
        200: {
            "description": "Server-sent events 'progress', 'done', 'failed', 'cancelled'; the "
            "data of each is the job.",
            "content": {"text/event-stream": {"schema": {}}},
        },
        **responses(404, 422, *GUARDED),
    },
)
async def follow(
    id: schemas.Id,
    service: ServiceOf,
    caller: Reader,
    last: Annotated[str | None, Header(alias="Last-Event-ID", max_length=40)] = None,
) -> StreamingResponse:
    """Follow a job until it ends; a comment now and then keeps the connection alive."""
    job = await to_thread.run_sync(job_of, service, id, caller)
    if service.streams >= service.settings.streams:
        raise ApiError(503, "Too many jobs are being followed.", headers={"Retry-After": "5"})
    seen = int(last) if last and last.isascii() and last.isdigit() else 0
    return StreamingResponse(
        _events(service, job, seen, caller),
        media_type="text/event-stream",
        headers={"Cache-Control": "no-store", "X-Accel-Buffering": "no"},
    )


async def _events(
    service: Service, job: JobRecord, seen: int, caller: Caller
) -> AsyncIterator[str]:
    service.streams += 1
    try:
        quiet = 0.0
        current: JobRecord | None = job
        while current is not None:
            if current.revision > seen or current.ended:
                name = current.status if current.ended else "progress"
                data = shown(current, service).model_dump_json()
                yield f"id: {current.revision}\nevent: {name}\ndata: {data}\n\n"
                seen, quiet = current.revision, 0.0
            if current.ended or service.stopping:
                return
            if await to_thread.run_sync(service.tokens.holds, caller.id) is None:
                return  # the token was revoked meanwhile
            await asyncio.sleep(_LOOK_S)
            quiet += _LOOK_S
            if quiet >= service.settings.stream_heartbeat:
                yield ": still there\n\n"
                quiet = 0.0
            current = await to_thread.run_sync(service.queue.get, job.id)
    finally:
        service.streams -= 1
