"""Two judged motions on one page that stands alone: both replays on one clock, what differs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any

from markupsafe import Markup

from physretarget._version import __version__
from physretarget.report.words import number, pretty
from physretarget.suite.clip_page import chart_looks
from physretarget.suite.environment import templates

_STYLES = (
    "assets/uPlot.min.css", "replay/assets/player.css", "report/templates/report.css",
    "suite/templates/suite.css",
)  # fmt: skip
_SCRIPTS = (
    "replay/assets/three.min.js", "replay/assets/clock.js", "replay/assets/stage.js",
    "replay/assets/player.js", "assets/uPlot.iife.min.js", "suite/templates/clip.js",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class PairSide:
    """One of the two: its name, its counts, and its artifacts "motion" and "model" as JSON texts.

    The texts may come from a process that is not trusted: they are embedded, never parsed here.
    """

    name: str
    errors: int
    warnings: int
    motion: str
    model: str


def pair_page(
    left: PairSide,
    right: PairSide,
    *,
    verdict: str,
    reason: str,
    measures: Sequence[Mapping[str, Any]],
    findings: Sequence[Mapping[str, Any]],
) -> str:
    """The page; ``measures`` have name, unit, left, right, better, change, ``findings`` code…"""
    sides = [_side(left, "left"), _side(right, "right")]
    return templates().get_template("pair.html.j2").render(
        version=__version__, left=sides[0], right=sides[1], verdict=verdict, reason=reason,
        findings=findings, measures=[_row(measure) for measure in measures],
        styles=[_asset(name) for name in _STYLES], scripts=[_asset(name) for name in _SCRIPTS],
        data={
            "baseline": "left", "now": "right", "names": ["left", "right"],
            "charts": chart_looks(),
        },
    )  # fmt: skip


def _side(side: PairSide, key: str) -> dict[str, Any]:
    return {
        "key": key, "label": key, "name": side.name, "errors": side.errors,
        "warnings": side.warnings, "motion": _embedded(side.motion),
        "model": _embedded(side.model),
    }  # fmt: skip


def _embedded(text: str) -> Markup:
    """JSON inside a script element: only its strings can hold a "<", and there it is escaped."""
    return Markup(text.replace("<", "\\u003c"))


def _asset(place: str) -> Markup:
    """A file of the package, to be inlined; our own, hence trusted."""
    return Markup(resources.files("physretarget").joinpath(place).read_text("utf-8"))


def _row(measure: Mapping[str, Any]) -> dict[str, Any]:
    unit = "" if measure["unit"] == "1" else pretty(measure["unit"])
    return {
        "name": measure["name"], "unit": unit, "better": measure["better"],
        "change": measure["change"] or "", "left": number(measure["left"], 4),
        "right": number(measure["right"], 4),
    }  # fmt: skip
