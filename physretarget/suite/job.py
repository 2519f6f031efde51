"""One piece of work as plain data, the same for this machine or another.

Light on purpose: a night in which nothing changed needs no solver, so none is imported.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal


@dataclass(frozen=True, kw_only=True)
class Job:
    """Judge one clip, or retarget one capture and judge what comes out.

    ``inputs`` maps "clip", and every option that is a file (model, config, keyposes000…), to the
    file's place relative to ``root``; ``options`` are the others, by name; ``files`` maps every
    file needed, assets included, to its SHA-256. ``address`` is the hash of all of it.
    """

    clip_id: str
    address: str
    kind: Literal["validate", "retarget"]
    case: str
    tags: tuple[str, ...]
    owner: str
    root: str
    inputs: Mapping[str, str]
    files: Mapping[str, str]
    options: Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What a job gave: ``status`` errored has a ``message``, ok has the rest.

    The message of a clip that is ok says why the floor's forces were not judged, if they were not.

    ``document`` is the report's JSON form. ``artifacts``: "motion" (tracks and timelines for the
    replay), "model/<sha256>" (shapes, shared by clips), "clip" (retargeted clips) as compressed
    bytes. ``transient``: the failure may not repeat, so that it must not be kept.
    """

    address: str
    status: Literal["ok", "errored"]
    message: str = ""
    document: Mapping[str, Any] | None = None
    artifacts: Mapping[str, bytes] = field(default_factory=dict)
    seconds: float = 0.0
    transient: bool = False
