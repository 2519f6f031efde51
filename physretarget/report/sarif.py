"""Reports as SARIF 2.1.0 (OASIS), for viewers that know the format.

A finding's place is the clip's file. Where a frame is a line of that file (csv) its lines are the
region; everywhere else it is line 1, and frames stand in the message and the properties.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import PurePath
from types import MappingProxyType
from typing import Any
from urllib.parse import quote

from physretarget._version import __version__
from physretarget.validation.codes import RULES
from physretarget.validation.report import Finding, Report
from physretarget.validation.rule import Rule

_SCHEMA = (
    "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json"
)


def render_sarif(
    reports: Report | Sequence[Report], *, unread: Mapping[str, str] = MappingProxyType({})
) -> str:
    """One run with all rules and the findings of all clips.

    ``unread`` are clips that could not be judged, and why: the run was no success then.

    One and not one per clip: GitHub's code scanning refuses a file whose runs share tool and
    category, and would show runs of distinct categories as so many separate analyses.
    """
    many = [reports] if isinstance(reports, Report) else list(reports)
    artifacts: list[dict[str, Any]] = []  # without repetition: a clip may be named twice
    places: list[int] = []
    for artifact in map(_artifact, many):
        if artifact not in artifacts:
            artifacts.append(artifact)
        places.append(artifacts.index(artifact))
    run = {
        "tool": {
            "driver": {
                "name": "physretarget",
                "version": __version__,
                "semanticVersion": __version__,
                "rules": [_rule(rule) for rule in RULES],
            }
        },
        "artifacts": artifacts,
        "invocations": [
            {
                "executionSuccessful": not unread,
                "toolExecutionNotifications": [
                    *(_broken(path, why) for path, why in unread.items()),
                    *(n for r in many for n in _gaps(r)),
                ],
            }
        ],
        "results": [
            _result(f, r, i) for i, r in zip(places, many, strict=True) for f in r.findings
        ],
    }
    document = {"$schema": _SCHEMA, "version": "2.1.0", "runs": [run]}
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _artifact(report: Report) -> dict[str, Any]:
    location: dict[str, Any] = {
        "location": {"uri": _uri(report.clip.path)},
        "properties": {
            "verdict": report.verdict,
            "notJudged": report.not_judged or "",
            "causes": [
                {"code": c.code, "message": c.message, "remedy": c.remedy, "value": c.value}
                for c in report.causes
            ],
        },
    }
    if not report.clip.sha256:
        return location
    return {**location, "hashes": {"sha-256": report.clip.sha256}}


def _rule(rule: Rule) -> dict[str, Any]:
    sections = rule.sections
    text = "\n\n".join(f"{title}: {' '.join(body.split())}" for title, body in sections.items())
    return {
        "id": rule.code,
        "name": "".join(part.capitalize() for part in rule.name.split("-")),
        "shortDescription": {"text": rule.summary},
        "fullDescription": {"text": " ".join(sections["What it does"].split())},
        "help": {"text": text},
        "properties": {"family": rule.family},
    }


def _result(finding: Finding, report: Report, index: int) -> dict[str, Any]:
    message = finding.message
    if finding.frame_first is not None:
        message += f" [frames {finding.frame_first}-{finding.frame_last}, look at {finding.frame}]"
    physical: dict[str, Any] = {"artifactLocation": {"uri": _uri(report.clip.path), "index": index}}
    physical["region"] = _region(finding, report.clip.first_line)
    location: dict[str, Any] = {"physicalLocation": physical}
    if finding.body:
        location["logicalLocations"] = [{"name": finding.body, "kind": "object"}]
    return {
        "ruleId": finding.code,
        "ruleIndex": next(i for i, rule in enumerate(RULES) if rule.code == finding.code),
        "level": finding.severity,
        "message": {"text": message},
        "locations": [location],
        "properties": {
            "frameFirst": finding.frame_first,
            "frameLast": finding.frame_last,
            "frame": finding.frame,
            "timeSeconds": finding.time_s,
            "value": finding.value,
            "limit": finding.limit,
            "unit": finding.unit,
        },
    }


def _region(finding: Finding, top: int | None) -> dict[str, int]:
    """The lines of the frames; the first line where frames are no lines.

    Code scanning shows no result without a line.
    """
    if finding.frame_first is None or top is None:
        return {"startLine": 1}
    last = finding.frame_last if finding.frame_last is not None else finding.frame_first
    return {"startLine": top + finding.frame_first, "endLine": top + last}


def _broken(path: str, why: str) -> dict[str, Any]:
    return {
        "level": "error",
        "message": {"text": why},
        "locations": [
            {
                "physicalLocation": {
                    "artifactLocation": {"uri": _uri(path)},
                    "region": {"startLine": 1},
                }
            }
        ],
    }


def _gaps(report: Report) -> list[dict[str, Any]]:
    return [
        {
            "level": "note",
            "message": {"text": f"{report.clip.path}: {c.code} not covered, {c.reason}"},
            "associatedRule": {"id": c.code},
        }
        for c in report.coverage
        if c.status == "not-covered"
    ]


def _uri(path: str) -> str:
    """A relative reference, or a file URI: a reference must not begin with a slash."""
    pure = PurePath(path)
    return pure.as_uri() if pure.is_absolute() else quote(pure.as_posix(), safe="/:")
