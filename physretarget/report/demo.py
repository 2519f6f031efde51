"""The first page of the demo: one card a capture, each leading to its report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from physretarget._version import __version__
from physretarget.clip import write_file
from physretarget.report.page import templates


@dataclass(frozen=True, kw_only=True)
class Card:
    """One capture: its title, its page, a sentence and a few figures in words."""

    title: str
    page: Path
    sentence: str
    facts: tuple[tuple[str, str], ...]


def write_index(cards: Sequence[Card], folder: Path) -> Path:
    """Write ``index.html``, with links relative to the folder; returns its path."""
    page = folder / "index.html"
    shown = [(card, card.page.relative_to(folder).as_posix()) for card in cards]
    text = templates().get_template("index.html.j2").render(cards=shown, version=__version__)
    write_file(page, text.encode())
    return page
