"""What jobs give: reports, replays, clips, and two of them compared."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Query
from fastapi.responses import FileResponse, HTMLResponse, Response

from physretarget.errors import InputError
from physretarget.files import write_file
from physretarget.service import schemas
from physretarget.service.access import GUARDED, Reader, ServiceOf, Viewer
from physretarget.service.comparison import compared, side_by_side
from physretarget.service.errors import ApiError, responses
from physretarget.service.routes_jobs import job_of
from physretarget.service.schemas import Compared
from physretarget.service.service import Service
from physretarget.service.tokens import Caller
from physretarget.suite.queue import JobRecord

router = APIRouter(prefix="/api/v1", tags=["results"])

FORMATS: dict[str, tuple[str, str]] = {
    "json": ("report.json", "application/json"),
    "html": ("report.html", "text/html"),
    "sarif": ("report.sarif", "application/sarif+json"),
    "junit": ("report.junit.xml", "application/xml"),
    "markdown": ("report.md", "text/markdown"),
    "text": ("report.txt", "text/plain"),
}
# A report is a page of its own that may run its own scripts and reach nothing: without
# allow-same-origin it cannot even see the page that shows it.
PAGE_POLICY = (
    "sandbox allow-scripts allow-downloads; default-src 'none'; script-src 'unsafe-inline'; "
    "style-src 'unsafe-inline'; img-src data: blob:; font-src data:; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'self'"
)

_PAGE: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "A page that needs nothing else.",
        "content": {"text/html": {"schema": {"type": "string"}}},
    }
}


def finished(service: Service, id: str, caller: Caller) -> tuple[JobRecord, Path]:
    """A job that is done and the folder of its results; 404 or 409 otherwise."""
    job = job_of(service, id, caller)
    if job.status != "done" or job.result is None:
        raise ApiError(409, f"The job is {job.status}: there are no results.")
    return job, service.home.job(id) / job.result


def _file(place: Path, media: str, name: str | None = None) -> FileResponse:
    if not place.is_file():
        raise ApiError(404, "The job has no such result.")
    headers = {"Cache-Control": "private, no-cache"}
    if media == "text/html":
        headers["Content-Security-Policy"] = PAGE_POLICY
    return FileResponse(place, media_type=media, headers=headers, filename=name)


@router.get(
    "/jobs/{id}/report",
    response_class=FileResponse,
    responses={
        200: {
            "description": "The report in the format asked for.",
            "content": {
                media: {"schema": {} if "json" in media else {"type": "string"}}
                for _, media in FORMATS.values()
            },
        },
        **responses(404, 409, 422, *GUARDED),
    },
)
def report(
    id: schemas.Id, service: ServiceOf, caller: Viewer, format: schemas.Format = "json"
) -> FileResponse:
    """The report of a finished job."""
    _, folder = finished(service, id, caller)
    name, media = FORMATS[format]
    return _file(folder / name, media)


@router.get(
    "/jobs/{id}/replay",
    response_class=FileResponse,
    responses={**_PAGE, **responses(404, 409, 422, *GUARDED)},
)
def replay(id: schemas.Id, service: ServiceOf, caller: Viewer) -> FileResponse:
    """The motion in 3D, as a page that needs nothing else."""
    _, folder = finished(service, id, caller)
    return _file(folder / "replay.html", "text/html")


@router.get(
    "/jobs/{id}/clip",
    response_class=FileResponse,
    responses={
        200: {
            "description": "The clip that a retargeting made, as npz.",
            "content": {
                "application/octet-stream": {"schema": {"type": "string", "format": "binary"}}
            },
        },
        **responses(404, 409, 422, *GUARDED),
    },
)
def clip(id: schemas.Id, service: ServiceOf, caller: Viewer) -> FileResponse:
    """The clip that a retargeting made."""
    job, folder = finished(service, id, caller)
    name = f"{Path(job.clip_name).stem or 'clip'}.npz"
    return _file(folder / "clip.npz", "application/octet-stream", name)


_Job = Annotated[str, Query(pattern=r"^[0-9a-z]{26}$")]


@router.get("/compare", response_model=Compared, responses=responses(404, 409, 422, *GUARDED))
def compare(service: ServiceOf, caller: Reader, left: _Job, right: _Job) -> Compared:
    """Two jobs' measures and findings side by side: is right better or worse than left?"""
    return compared(_sides(service, left, right, caller))


@router.get(
    "/compare/replay",
    response_class=FileResponse,
    responses={**_PAGE, **responses(404, 409, 422, *GUARDED)},
)
def compare_replay(service: ServiceOf, caller: Viewer, left: _Job, right: _Job) -> Response:
    """Both motions in 3D on one clock, as a page that needs nothing else."""
    sides = _sides(service, left, right, caller)
    # It lies with the right job's results and goes with them.
    place = sides[1][1] / f"compared-{left}.html"
    # One at a time: a page of two long clips takes many times its size while it is made.
    with service.comparing:
        if not place.is_file():
            page = side_by_side(sides).encode()
            try:
                write_file(place, page)
            except InputError:  # no room on the disk
                return HTMLResponse(page, headers={"Content-Security-Policy": PAGE_POLICY})
    return _file(place, "text/html")


def _sides(
    service: Service, left: str, right: str, caller: Caller
) -> Sequence[tuple[JobRecord, Path]]:
    return [finished(service, left, caller), finished(service, right, caller)]
