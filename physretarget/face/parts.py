"""Finished steps of a long measurement, kept so that a run cut short goes on where it was."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Any

from physretarget.files import write_file


@lru_cache(maxsize=1)
def source_hash() -> str:
    """SHA-256 of this room's source: other code, other numbers."""
    whole = hashlib.sha256()
    root = resources.files("physretarget.face")
    for place in (root, root / "formats"):
        for path in sorted(place.iterdir(), key=lambda p: p.name):
            drawn = path.name in ("reproduce_page.py", "report.py")  # flows into no number
            if path.name.endswith(".py") and not drawn:
                whole.update(path.name.encode() + path.read_bytes())
    return whole.hexdigest()


@dataclass(frozen=True)
class Parts:
    """Steps by name; inputs: all that they depend on besides the source. No folder: none kept."""

    folder: Path | None
    inputs: Any
    progress: Callable[[str], None] = field(default=lambda stage: None)

    def get(self, name: str, work: Callable[[], Any]) -> Any:
        """The step's finding (plain data), from an earlier run or made now."""
        self.progress(name)
        if self.folder is None:
            return work()
        text = json.dumps([name, self.inputs, source_hash()], sort_keys=True)
        path = self.folder / f"{hashlib.sha256(text.encode()).hexdigest()[:20]}.json"
        try:
            return json.loads(path.read_text("utf-8"))
        except (OSError, ValueError):
            pass  # missing, or torn by an interruption: done again
        made = work()
        self.folder.mkdir(parents=True, exist_ok=True)
        write_file(path, json.dumps(made).encode())
        return made
