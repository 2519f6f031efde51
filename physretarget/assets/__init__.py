"""Third-party page parts that several reports inline; where they come from is in README.md."""

from __future__ import annotations

from functools import cache
from importlib import resources


@cache
def text(name: str) -> str:
    """Text of a file in this folder."""
    return (resources.files(__name__) / name).read_text("utf-8")
