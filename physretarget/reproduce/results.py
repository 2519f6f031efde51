"""What a run found."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from physretarget.reproduce.plan import Plan
from physretarget.reproduce.store import Piece


@dataclass
class Results:
    """All pieces of a run, by name."""

    plan: Plan
    out: Path
    takes: dict[str, Piece] = field(default_factory=dict)
    studies: dict[str, dict[str, Piece]] = field(default_factory=dict)
    seconds: float = 0.0

    @property
    def resumed(self) -> int:
        """Pieces that an earlier run had finished."""
        studies = [p for found in self.studies.values() for p in found.values()]
        return sum(p.resumed for p in (*self.takes.values(), *studies))

    @property
    def pieces(self) -> int:
        """All pieces of work."""
        return len(self.takes) + sum(len(found) for found in self.studies.values())
