"""Renderers of reports; none of them computes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from physretarget._lazy import attribute_getter

if TYPE_CHECKING:
    from physretarget.report.fix import write_fix_report
    from physretarget.report.formats import render
    from physretarget.report.html import render_html
    from physretarget.report.json import schema
    from physretarget.report.retarget import write_retarget_report
    from physretarget.report.simulation import render_simulation
    from physretarget.report.text import render_text

# Public name → (module, name there).
_WHERE = {
    "render": ("formats", "render"),
    "render_html": ("html", "render_html"),
    "render_simulation": ("simulation", "render_simulation"),
    "render_text": ("text", "render_text"),
    "schema": ("json", "schema"),
    "write_fix_report": ("fix", "write_fix_report"),
    "write_retarget_report": ("retarget", "write_retarget_report"),
}

__all__ = [
    "render",
    "render_html",
    "render_simulation",
    "render_text",
    "schema",
    "write_fix_report",
    "write_retarget_report",
]

__getattr__ = attribute_getter(__name__, _WHERE)
