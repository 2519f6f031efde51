"""From a form to a job: what is told is looked up, what is missing or too much is refused."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from physretarget.service.builtin import NAMES
from physretarget.service.errors import ApiError
from physretarget.service.home import remove
from physretarget.service.options import read_options
from physretarget.service.service import Service
from physretarget.service.tokens import Caller
from physretarget.service.uploads import Form
from physretarget.suite.queue import JobRecord, NewJob, new_id

FIELDS = frozenset({"kind", "options", "clip_id", "model", "capture_id", "character"})
FILES: Mapping[str, int] = {
    "clip": 1, "model_file": 1, "capture": 1, "skeleton": 1, "keyposes": 16,
}  # fmt: skip
_ALLOWED = {
    "validate": {"kind", "options", "clip_id", "model", "clip", "model_file"},
    "retarget": {
        "kind", "options", "capture_id", "character", "capture", "skeleton", "keyposes",
    },
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Draft:
    """A job as told: everything but a model's files, which have to be checked first."""

    kind: str
    options: Mapping[str, Any]
    clip_name: str
    clip_sha256: str
    model: Mapping[str, Any] | None  # as a worker takes it; None: model_file is still to be done
    model_id: str | None
    model_name: str
    inputs: Mapping[str, Any]
    fingerprint: str


def draft(form: Form, service: Service, owner: str | None = None) -> Draft:
    """Look up what a form tells, among what ``owner`` (None: anybody) may read.

    Raises:
        ApiError: 404 a clip or model that is not there, 422 whatever is wrong otherwise.
    """
    kind = form.fields.get("kind") or "validate"
    if kind not in _ALLOWED:
        raise ApiError(422, "The kind is validate or retarget.", field="kind")
    for name in {*form.fields, *form.files} - _ALLOWED[kind]:
        raise ApiError(422, f"A job of kind {kind} takes no {name}.", field=name)
    options = read_options(kind, form.fields.get("options"))
    role = "clip" if kind == "validate" else "capture"
    clip = _clip(form, service, role, owner)
    model, model_id, model_name, model_content = _model(form, service, kind, owner)
    inputs: dict[str, Any] = {"clip": clip}
    if kind == "retarget":
        inputs |= _retarget_inputs(form, clip, model or {})
    content = [kind, options, clip, model_content, inputs]
    digest = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    return Draft(
        kind=kind, options=options, clip_name=clip["name"], clip_sha256=clip["sha256"],
        model=model, model_id=model_id, model_name=model_name, inputs=inputs, fingerprint=digest,
    )  # fmt: skip


def _clip(form: Form, service: Service, role: str, owner: str | None) -> dict[str, str]:
    upload, id = form.file(role), form.fields.get(f"{role}_id")
    if (upload is None) == (id is None):
        raise ApiError(422, f"One of {role} and {role}_id is needed.", field=role)
    if upload is not None:
        return {"name": upload.name, "sha256": upload.sha256}
    found = service.registry.clip(_storable(id or ""), owner)
    if found is None:
        raise ApiError(404, "There is no such clip.", field=f"{role}_id")
    return {"name": found.name, "sha256": found.sha256}


def _model(
    form: Form, service: Service, kind: str, owner: str | None
) -> tuple[dict[str, Any] | None, str | None, str, str]:
    """The model for a worker, its id, its name, and what it is for the fingerprint."""
    field = "model" if kind == "validate" else "character"
    upload, id = form.file("model_file"), form.fields.get(field)
    if (upload is None) == (id is None):
        either = "One of model and model_file is needed." if kind == "validate" else (
            "A character is needed."
        )  # fmt: skip
        raise ApiError(422, either, field=field)
    if upload is not None:
        return None, None, upload.name, upload.sha256
    assert id is not None
    if id in NAMES:
        return {"builtin": id}, id, f"{id}.xml", id
    found = service.registry.model(_storable(id), owner)
    if found is None:
        raise ApiError(404, "There is no such model.", field=field)
    return {"folder": found.id, "main": found.main}, found.id, found.name, found.id


def _retarget_inputs(
    form: Form, clip: Mapping[str, str], model: Mapping[str, Any]
) -> dict[str, Any]:
    poses = [{"name": u.name, "sha256": u.sha256} for u in form.files.get("keyposes", ())]
    if not poses and not model.get("builtin"):
        raise ApiError(422, "A character that is not built in needs key poses.", field="keyposes")
    skeleton = form.file("skeleton")
    if skeleton is None and clip["name"].lower().endswith(".amc"):
        raise ApiError(422, "An AMC capture needs its ASF file.", field="skeleton")
    named = {"name": skeleton.name, "sha256": skeleton.sha256} if skeleton else None
    return {"keyposes": poses, "skeleton": named}


def _storable(text: str) -> str:
    """An id as told; anything longer or stranger than an id is none."""
    return text if text.isascii() and text.isalnum() and len(text) <= 32 else ""


async def admit(drafted: Draft, form: Form, service: Service) -> tuple[dict[str, Any], Path] | None:
    """Have what was uploaded looked at, and put a model's files in place, if there is one.

    Returns the model for a worker, and its folder.

    Raises:
        ApiError: 422 something is refused, 503 too many uploads wait.
    """
    motion = form.file("clip") or form.file("capture")
    if motion is not None:
        await service.checks.motion(
            motion, skeleton=form.file("skeleton"), fps=drafted.options.get("fps"),
            quat=drafted.options.get("quat"),
        )  # fmt: skip
    upload = form.file("model_file")
    if upload is None:
        return None
    facts, files = await service.checks.model(upload.path, upload.name, "")
    place = service.home.models / new_id()
    files.rename(place)
    return {"folder": place.name, "main": str(facts["main"]), "once": True}, place


def enqueue(
    drafted: Draft,
    form: Form,
    service: Service,
    admitted: tuple[dict[str, Any], Path] | None,
    idempotency: str | None,
    caller: Caller,
) -> tuple[JobRecord, bool]:
    """Queue the job; what was put in place for one that was there already goes away.

    Raises:
        ApiError: 409 the idempotency key has made another job.
    """
    if admitted is not None:
        drafted = replace(drafted, model=admitted[0])
    uploads = [u for name in ("clip", "capture", "skeleton", "keyposes")
               for u in form.files.get(name, ())]  # fmt: skip
    new = NewJob(
        kind=drafted.kind, clip_name=drafted.clip_name, clip_sha256=drafted.clip_sha256,
        model_id=drafted.model_id, model_name=drafted.model_name, options=drafted.options,
        inputs={
            **drafted.inputs, "model": drafted.model, "blobs": sorted(set(_blobs(drafted.inputs))),
        },
        fingerprint=drafted.fingerprint, idempotency=idempotency, belongs_to=caller.id,
    )  # fmt: skip
    made = False
    try:
        job, made = service.submit(new, uploads)
    finally:
        if not made and admitted is not None:
            remove(admitted[1])
    if not made:
        service.discard(u.sha256 for u in uploads)
        same_or_conflict(job, drafted)
    return job, made


def same_or_conflict(job: JobRecord, drafted: Draft) -> None:
    """Refuse an idempotency key that has made a job of other content."""
    if job.fingerprint != drafted.fingerprint:
        raise ApiError(
            409, "The idempotency key was used for another job.", field="Idempotency-Key"
        )


def _blobs(inputs: Mapping[str, Any]) -> Iterator[str]:
    yield inputs["clip"]["sha256"]
    for entry in (*inputs.get("keyposes", ()), inputs.get("skeleton")):
        if entry:
            yield entry["sha256"]
