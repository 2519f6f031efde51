"""What a service's health depends on, looked at so that nothing slow is asked."""

from __future__ import annotations

import shutil
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

__all__ = ["Trouble", "free_bytes", "troubles"]

# The database is looked at every second: after this many without an answer it is told of.
DATABASE_S = 4.0


@dataclass(frozen=True)
class Trouble:
    """Why the service cannot take or do work."""

    what: Literal["disk", "database", "workers"]
    message: str


def free_bytes(folder: Path) -> int:
    """Free disk where a folder lies; none where that cannot be said."""
    try:
        return shutil.disk_usage(folder).free
    except OSError:
        return 0


def troubles(
    *, free: int, reserve: int, looked: float, reachable: bool, alive: int, wanted: int
) -> list[Trouble]:
    """What is wrong now.

    Args:
        free, reserve: bytes of free disk, and how many are kept.
        looked: ``time.monotonic()`` of the last good look at the database.
        reachable: whether the last look was one.
        alive, wanted: worker threads.
    """
    found = []
    if free < reserve:
        found.append(Trouble("disk", f"{free >> 20} MB are free, {reserve >> 20} MB are kept."))
    age = time.monotonic() - looked
    if not reachable or age > DATABASE_S:
        found.append(Trouble("database", f"it has not answered for {age:.0f} s."))
    if alive < wanted:
        found.append(Trouble("workers", f"{alive} of {wanted} are alive."))
    return found
