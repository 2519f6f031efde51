"""What jobs take: uploaded clips and captures, registered models."""

from __future__ import annotations

from typing import Any

from anyio import to_thread
from fastapi import APIRouter, Request, Response

from physretarget.service import schemas
from physretarget.service.access import GUARDED, Reader, ServiceOf, Submitter
from physretarget.service.builtin import NAMES
from physretarget.service.errors import ApiError, responses
from physretarget.service.forms import clip_form, form_body, model_form
from physretarget.service.routes_jobs import Cursor, Limit, Text
from physretarget.service.schemas import Clip, ClipPage, Model, ModelPage
from physretarget.service.service import Service
from physretarget.service.uploads import NAME_BYTES, Bounds, Form, received
from physretarget.suite.queue import new_id, now
from physretarget.suite.registry import ClipRecord, ModelRecord

router = APIRouter(prefix="/api/v1", tags=["library"])
_UPLOAD = (408, 413, 415, 422, 507, *GUARDED)


def _bounds(service: Service, *fields: str) -> Bounds:
    return Bounds(
        fields=frozenset(fields), files={"file": 1}, bytes=service.settings.limits.upload_bytes,
        idle=service.settings.upload_idle, rate=service.settings.upload_rate,
    )  # fmt: skip


# ---- clips and captures ------------------------------------------------------------------------


@router.post(
    "/clips",
    status_code=201,
    response_model=Clip,
    responses=responses(*_UPLOAD),
    openapi_extra=form_body(clip_form()),
)
async def add_clip(
    request: Request, response: Response, service: ServiceOf, caller: Submitter
) -> Clip:
    """Upload a clip or a capture, to be used by any number of jobs."""
    async with received(
        request, service.home.incoming, _bounds(service), reserve=service.settings.reserve
    ) as form:
        upload = form.file("file")
        if upload is None:
            raise ApiError(422, "A file is needed.", field="file")
        await service.checks.motion(upload)
        made = await to_thread.run_sync(service.add_clip, upload, caller.id)
    response.headers["Location"] = f"{service.settings.root_path}/api/v1/clips/{made.id}"
    return _shown_clip(made)


@router.get("/clips", response_model=ClipPage, responses=responses(422, *GUARDED))
def list_clips(
    service: ServiceOf, caller: Reader, q: Text = None, limit: Limit = 50, cursor: Cursor = None
) -> ClipPage:
    """Clips, newest first."""
    found = service.registry.clips(q=q, before=cursor, limit=limit + 1, owner=caller.owner)
    return ClipPage(
        items=[_shown_clip(clip) for clip in found[:limit]],
        next=found[limit - 1].id if len(found) > limit else None,
    )


@router.get("/clips/{id}", response_model=Clip, responses=responses(404, 422, *GUARDED))
def get_clip(id: schemas.Id, service: ServiceOf, caller: Reader) -> Clip:
    """One clip."""
    found = service.registry.clip(id, caller.owner)
    if found is None:
        raise ApiError(404, "There is no such clip.")
    return _shown_clip(found)


@router.delete("/clips/{id}", status_code=204, responses=responses(404, 422, *GUARDED))
def delete_clip(id: schemas.Id, service: ServiceOf, caller: Submitter) -> Response:
    """Delete a clip; jobs that were submitted with it are done all the same."""
    if not service.delete_clip(id, caller.owner):
        raise ApiError(404, "There is no such clip.")
    return Response(status_code=204)


@router.post("/clips/{id}/share", response_model=Clip, responses=responses(404, 422, *GUARDED))
def share_clip(id: schemas.Id, service: ServiceOf, caller: Submitter, shared: bool = True) -> Clip:
    """Let every token use a clip of yours, or no longer."""
    found = service.registry.clip(id, caller.owner)
    if found is None or not service.registry.share("clips", id, shared, caller.owner):
        raise ApiError(404, "There is no such clip of yours.")
    return _shown_clip(found)


def _shown_clip(clip: ClipRecord) -> Clip:
    return Clip(
        id=clip.id, name=clip.name, sha256=clip.sha256, bytes=clip.bytes, created=clip.created
    )


# ---- models ------------------------------------------------------------------------------------


@router.post(
    "/models",
    status_code=201,
    response_model=Model,
    responses=responses(*_UPLOAD),
    openapi_extra=form_body(model_form()),
)
async def add_model(
    request: Request, response: Response, service: ServiceOf, caller: Submitter
) -> Model:
    """Register a model; what could reach outside, or take too much, is refused."""
    async with received(
        request,
        service.home.incoming,
        _bounds(service, "main", "name"),
        reserve=service.settings.reserve,
    ) as form:
        upload = form.file("file")
        if upload is None:
            raise ApiError(422, "A file is needed.", field="file")
        name = _name(form, upload.name)
        facts, files = await service.checks.model(
            upload.path, upload.name, form.fields.get("main", "")
        )
        made = ModelRecord(
            id=new_id(), name=name, sha256=facts["sha256"], main=facts["main"],
            facts={k: facts[k] for k in ("mass_kg", "bodies", "joints", "findings")},
            created=now(), belongs_to=caller.id,
        )  # fmt: skip
        files.rename(service.home.models / made.id)
        await to_thread.run_sync(service.registry.add_model, made)
    response.headers["Location"] = f"{service.settings.root_path}/api/v1/models/{made.id}"
    return _shown_model(made)


def _name(form: Form, filename: str) -> str:
    name = form.fields.get("name", "").strip() or filename
    if len(name.encode()) > NAME_BYTES or not name.isprintable():
        raise ApiError(422, f"A name has up to {NAME_BYTES} bytes of printable characters.",
                       field="name")  # fmt: skip
    if name in NAMES:
        raise ApiError(422, f"{name} is a built-in model's name.", field="name")
    return name


@router.get("/models", response_model=ModelPage, responses=responses(422, *GUARDED))
async def list_models(
    service: ServiceOf, caller: Reader, q: Text = None, limit: Limit = 50, cursor: Cursor = None
) -> ModelPage:
    """Models: on the first page the built-in ones first, then newest first."""
    built: list[Model] = []
    if cursor is None:
        facts = await service.builtin_facts()
        built = [_builtin(n, f) for n, f in facts.items() if not q or q.lower() in n]
    found = await to_thread.run_sync(
        lambda: service.registry.models(q=q, before=cursor, limit=limit + 1, owner=caller.owner)
    )
    return ModelPage(
        items=[*built, *(_shown_model(model) for model in found[:limit])],
        next=found[limit - 1].id if len(found) > limit else None,
    )


@router.get("/models/{id}", response_model=Model, responses=responses(404, 422, *GUARDED))
async def get_model(id: str, service: ServiceOf, caller: Reader) -> Model:
    """One model."""
    if id in NAMES:
        return _builtin(id, (await service.builtin_facts())[id])
    found = (
        await to_thread.run_sync(service.registry.model, id, caller.owner) if _is_id(id) else None
    )
    if found is None:
        raise ApiError(404, "There is no such model.")
    return _shown_model(found)


@router.delete("/models/{id}", status_code=204, responses=responses(404, 409, 422, *GUARDED))
def delete_model(id: str, service: ServiceOf, caller: Submitter) -> Response:
    """Delete a model; jobs that were submitted with it are done all the same."""
    if id in NAMES:
        raise ApiError(409, "The built-in models stay.")
    if not _is_id(id) or not service.delete_model(id, caller.owner):
        raise ApiError(404, "There is no such model.")
    return Response(status_code=204)


@router.post(
    "/models/{id}/share", response_model=Model, responses=responses(404, 409, 422, *GUARDED)
)
def share_model(id: str, service: ServiceOf, caller: Submitter, shared: bool = True) -> Model:
    """Let every token use a model of yours, or no longer."""
    if id in NAMES:
        raise ApiError(409, "The built-in models are everybody's.")
    if not _is_id(id):
        raise ApiError(404, "There is no such model of yours.")
    found = service.registry.model(id, caller.owner)
    if found is None or not service.registry.share("models", id, shared, caller.owner):
        raise ApiError(404, "There is no such model of yours.")
    return _shown_model(found)


def _is_id(text: str) -> bool:
    return len(text) == 26 and text.isascii() and text.isalnum()


def _shown_model(model: ModelRecord) -> Model:
    return Model(
        id=model.id, name=model.name, sha256=model.sha256, builtin=False, created=model.created,
        **model.facts,
    )  # fmt: skip


def _builtin(name: str, facts: dict[str, Any]) -> Model:
    kept = {k: facts[k] for k in ("sha256", "mass_kg", "bodies", "joints", "findings")}
    return Model(id=name, name=name, builtin=True, created=None, **kept)
