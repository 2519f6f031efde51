"""Two finished jobs side by side: measures, findings, and both motions on one clock."""

from __future__ import annotations

import json
import zlib
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
_REPORT_BYTES = 8 * 2**20
_MOTION_BYTES = 64 * 2**20


def compared(sides: Sides) -> Compared:
    """The right job against the left one."""
    left, right = (_state(job, folder) for job, folder in sides)
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
    # Only here: the page's words bring MuJoCo along, which the server needs for nothing else.
    from physretarget.suite.pair_page import PairSide, pair_page

    told = compared(sides)
    left, right = (PairSide(**_shown(job, folder)) for job, folder in sides)
    return pair_page(
        left,
        right,
        verdict=told.verdict,
        reason=told.reason,
        measures=[measure.model_dump() for measure in told.measures],
        findings=[finding.model_dump() for finding in told.findings],
    )


def _shown(job: JobRecord, folder: Path) -> dict[str, Any]:
    summary = job.summary or {}
    return {
        "name": job.clip_name, "errors": summary.get("errors", 0),
        "warnings": summary.get("warnings", 0), "motion": _inflated(folder / "motion.z"),
        "model": _inflated(folder / "model.z"),
    }  # fmt: skip


def _inflated(place: Path) -> str:
    """A compressed text that a job left, up to a size."""
    inflater = zlib.decompressobj()
    try:
        content = inflater.decompress(place.read_bytes(), _MOTION_BYTES)
        if inflater.unconsumed_tail:
            raise ApiError(409, "The motion is too long to be shown side by side.")
        return content.decode("utf-8")
    except (OSError, zlib.error, UnicodeDecodeError) as error:
        raise ApiError(409, "The job left no usable motion.") from error


def _side(job: JobRecord) -> Side:
    return Side(job=job.id, name=job.clip_name, summary=Summary(**(job.summary or {})))


def _state(job: JobRecord, folder: Path) -> State:
    """What a job's report says; written by a process that is not trusted, so taken with care."""
    place = folder / "report.json"
    try:
        if place.stat().st_size > _REPORT_BYTES:
            raise ApiError(409, "The report is too large to be compared.")
        document = json.loads(place.read_bytes())
        findings: dict[str, dict[str, int]] = {}
        for finding in document["findings"]:
            count = findings.setdefault(str(finding["code"]), {"errors": 0, "warnings": 0})
            count["errors" if finding["severity"] == "error" else "warnings"] += 1
        measures = {
            str(name): {
                "value": None if m["value"] is None else float(m["value"]), "unit": str(m["unit"]),
            }
            for name, m in document["measures"].items()
        }  # fmt: skip
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise ApiError(409, "The job left no usable report.") from error
    return State(address=job.id, status="ok", measures=measures, findings=findings)


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
