"""What a history keeps of runs, and of what was accepted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One clip in one run: where its result is, what it was compared with, the verdict."""

    clip: str
    address: str | None
    baseline: str | None
    case_name: str
    kind: str
    tags: tuple[str, ...]
    owner: str
    verdict: str
    reason: str
    blocking: bool
    changes: tuple[Mapping[str, Any], ...] = ()


@dataclass(frozen=True, kw_only=True)
class Run:
    """A run that finished; ``done``: jobs that were really done, ``counts``: clips by verdict."""

    id: int
    suite: str
    started: str
    finished: str
    seconds: float
    version: str
    done: int
    counts: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Accepted:
    """A clip's baseline in force; ``address`` None: it was accepted that the clip is gone."""

    address: str | None
    note: str
    accepted: str
    run: int
