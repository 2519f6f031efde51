"""Two finished jobs side by side: measures, findings, and both motions on one clock."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from physretarget.service.errors import ApiError
from physretarget.service.schemas import (
    Compared,
    ComparedFinding,
    ComparedMeasure,
    Side,
    Summary,
)
from physretarget.suite.compare import State, compare, tolerance_of
from physretarget.suite.queue import JobRecord

Sides = Sequence[tuple[JobRecord, Path]]
_REPORT_BYTES = 64 * 2**20


def compared(sides: Sides) -> Compared:
    """The right job against the left one."""
    documents = [_document(folder) for _, folder in sides]
    left, right = (
        _state(job, document) for (job, _), document in zip(sides, documents, strict=True)
    )
    verdict = compare(right, left)
    changes = {change.name: change.worse for change in verdict.changes}
    return Compared(
        left=_side(sides[0][0]),
        right=_side(sides[1][0]),
        verdict=verdict.verdict,
        reason=verdict.reason,
        measures=_measures(left.measures, right.measures, changes),
        findings=_findings(left.findings, right.findings),
    )


def side_by_side(sides: Sides) -> str:
    """One page with both replays."""
    raise ApiError(503, "Not there yet.")


def _side(job: JobRecord) -> Side:
    return Side(job=job.id, name=job.clip_name, summary=Summary(**(job.summary or {})))


def _document(folder: Path) -> Mapping[str, Any]:
    place = folder / "report.json"
    if place.stat().st_size > _REPORT_BYTES:
        raise ApiError(409, "The report is too large to be compared.")
    document: Mapping[str, Any] = json.loads(place.read_bytes())
    return document


def _state(job: JobRecord, document: Mapping[str, Any]) -> State:
    findings: dict[str, dict[str, int]] = {}
    for finding in document["findings"]:
        count = findings.setdefault(finding["code"], {"errors": 0, "warnings": 0})
        count["errors" if finding["severity"] == "error" else "warnings"] += 1
    return State(address=job.id, status="ok", measures=document["measures"], findings=findings)


def _measures(
    left: Mapping[str, Mapping[str, Any]],
    right: Mapping[str, Mapping[str, Any]],
    changes: Mapping[str, bool],
) -> list[ComparedMeasure]:
    rows = []
    for name in {**left, **right}:
        unit = str((right.get(name) or left[name])["unit"])
        worse = changes.get(name)
        rows.append(
            ComparedMeasure(
                name=name, unit=unit,
                left=left.get(name, {}).get("value"), right=right.get(name, {}).get("value"),
                better=tolerance_of(name, unit).direction,
                change=None if worse is None else "worse" if worse else "better",
            )
        )  # fmt: skip
    return rows


def _findings(
    left: Mapping[str, Mapping[str, int]], right: Mapping[str, Mapping[str, int]]
) -> list[ComparedFinding]:
    return [
        ComparedFinding(
            code=code, left=sum(left.get(code, {}).values()),
            right=sum(right.get(code, {}).values()),
            change="new" if code not in left else "fixed" if code not in right else "both",
        )
        for code in sorted({*left, *right})
    ]  # fmt: skip
