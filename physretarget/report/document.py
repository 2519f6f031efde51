"""A report's JSON document in the words and rows of a page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from physretarget.replay.scene import Mark
from physretarget.report.words import TILES, duration, number, pretty, quantity

MAX_ROWS = 300
LEAST = 1e-4
"""What a large figure shows at least: below it :func:`number` writes powers of ten."""


def as_document(report: Any) -> Mapping[str, Any]:
    """The JSON form of a report, or the document itself."""
    document: Mapping[str, Any] = report if isinstance(report, Mapping) else report.to_dict()
    return document


def document_marks(document: Mapping[str, Any]) -> tuple[Mark, ...]:
    """The findings of a JSON report that have a place in time, in the document's order."""
    return tuple(
        Mark(
            code=f["code"],
            severity=f["severity"],
            message=f["message"],
            frame_first=f["frame_first"],
            frame_last=f["frame_first"] if f.get("frame_last") is None else f["frame_last"],
            frame=f.get("frame"),
        )
        for f in document["findings"]
        if f.get("frame_first") is not None
    )


def judgement(document: Mapping[str, Any] | None) -> dict[str, Any]:
    """What the template needs of a report, whether or not there is one."""
    if document is None:
        document = {"summary": None, "findings": [], "coverage": [], "measures": {}, "causes": []}
    findings, coverage = document["findings"], document["coverage"]
    return {
        "judged": document["summary"] is not None,
        "summary": document["summary"],
        "causes": document.get("causes", []),  # of reports before there were any
        "findings": [_finding_row(f) for f in findings[:MAX_ROWS]],
        "findings_hidden": max(len(findings) - MAX_ROWS, 0),
        "coverage": sorted(coverage, key=lambda c: (c["status"] == "checked", c["code"])),
        "covered": sum(c["status"] == "checked" for c in coverage),
        "measures": [
            {
                "name": name,
                "value": number(m["value"], 4),
                "unit": pretty(m["unit"]),
                "frame": m.get("frame"),
            }
            for name, m in document["measures"].items()
        ],
    }


def _finding_row(finding: Mapping[str, Any]) -> dict[str, Any]:
    first, last = finding.get("frame_first"), finding.get("frame_last")
    seconds, worst = finding.get("time_s"), finding.get("frame")
    value, unit = quantity(finding.get("value"), finding.get("unit") or "")
    limit, limit_unit = quantity(finding.get("limit"), finding.get("unit") or "")
    span = "" if first is None else f"frame {first}"
    if first is not None and last is not None and last != first:
        span = f"frames {first}–{last}"
    return {
        **{key: finding.get(key) or "" for key in ("code", "rule", "severity", "message", "body")},
        "frame_first": first if worst is None else worst,
        "frames": span,
        "when": "whole clip" if seconds is None else f"{seconds:.2f} s",
        "value": "" if finding.get("value") is None else f"{value} {unit}".strip(),
        "limit": "" if finding.get("limit") is None else f"{limit} {limit_unit}".strip(),
    }


def measure_tiles(document: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The measures that a reader wants first, as large figures."""
    tiles = []
    for name, label in TILES.items():
        measure = document["measures"].get(name)
        if measure is None or measure["value"] is None:
            continue
        value, unit = quantity(measure["value"], measure["unit"])
        tiles.append(
            {
                "label": label,
                "value": value if "e−" not in value else f"< {LEAST:f}".rstrip("0"),
                "unit": unit,
                "note": "",
                "good": None,
                "frame": measure.get("frame"),
            }
        )
    return tiles[:8]


def filter_note(document: Mapping[str, Any]) -> str:
    """The sentence that says which filter every figure depends on."""
    hz = document.get("settings", {}).get("lowpass_hz")
    if hz is None:
        return "Every figure is taken without a filter."
    return f"Every figure is taken after a low-pass of {number(float(hz))} Hz."


def document_sections(document: Mapping[str, Any] | None) -> dict[str, dict[str, object]]:
    """Clip, model, settings and tool: the facts at the foot of the page."""
    if document is None:
        return {}
    titles = {"clip": "Clip", "model": "Model", "settings": "Settings of the validation"}
    sections: dict[str, dict[str, object]] = {
        title: dict(document[key]) for key, title in titles.items() if key in document
    }
    return {**sections, "Tool": dict(document.get("tool", {}))}


def facts(sections: Mapping[str, Mapping[str, object]]) -> list[tuple[str, list[Any]]]:
    """Sections as readable pairs; empty ones are left out."""
    return [
        (name, [(key.replace("_", " "), _fact(key, value)) for key, value in pairs.items()])
        for name, pairs in sections.items()
        if pairs
    ]


def _fact(key: str, value: object) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{k} {_fact(k, v)}" for k, v in value.items()) or "–"
    if isinstance(value, list | tuple):
        return " · ".join(_fact(key, item) for item in value) or "–"
    if key == "duration_s" and isinstance(value, float):
        return duration(value)
    return number(value, 4)


def file_name(path: Any) -> str:
    """The last part of a path of either kind."""
    return str(path or "").replace("\\", "/").rsplit("/", 1)[-1]
