"""From a job's row to the task of a child process."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from physretarget.sandbox.limits import Limits
from physretarget.service.builtin import builtins
from physretarget.service.home import Home
from physretarget.suite.queue import JobRecord


@dataclass(frozen=True, kw_only=True)
class Task:
    """What :func:`physretarget.sandbox.child.run` is called with."""

    name: str
    request: Mapping[str, Any]
    inputs: tuple[Path, ...]


def prepare(job: JobRecord, home: Home, work: Path, limits: Limits) -> Task:
    """Lay out a job's inputs under the names that its client gave them.

    Readers go by a file's suffix, and blobs have none: so the child sees links, which it could
    not make itself, and may read what they point to, nothing else.
    """
    inputs = job.inputs
    read: list[Path] = []
    named = work / "inputs"
    named.mkdir()

    def link(entry: Mapping[str, str], role: str) -> str:
        blob = home.blob(entry["sha256"])
        read.append(blob)
        place = named / role / entry["name"]
        place.parent.mkdir(exist_ok=True)
        place.symlink_to(blob)
        return str(place)

    model = _model(inputs["model"], home)
    read.append(model.parent if inputs["model"].get("builtin") else _root(inputs["model"], home))
    request: dict[str, Any] = {
        "model": str(model), "options": dict(job.options), "clip_frames": limits.clip_frames,
        "clip_name": job.clip_name, "model_name": job.model_name,
    }  # fmt: skip
    if job.kind == "validate":
        request["clip"] = link(inputs["clip"], "clip")
        return Task(name="physretarget.service.tasks:validate", request=request, inputs=tuple(read))
    request["capture"] = link(inputs["clip"], "capture")
    if inputs.get("skeleton"):
        request["skeleton"] = link(inputs["skeleton"], "skeleton")
    request["keyposes"] = [
        link(entry, f"keyposes{n}") for n, entry in enumerate(inputs["keyposes"])
    ] or [str(builtins()[inputs["model"]["builtin"]].keyposes)]
    return Task(name="physretarget.service.tasks:retarget", request=request, inputs=tuple(read))


def _model(model: Mapping[str, Any], home: Home) -> Path:
    if model.get("builtin"):
        return builtins()[model["builtin"]].path
    return _root(model, home) / str(model["main"])


def _root(model: Mapping[str, Any], home: Home) -> Path:
    return home.models / str(model["folder"])
