"""A baseline: today's findings, accepted, so that only new ones fail.

A finding is recognised by its code and body, and by overlapping frames (a second apart at
most counts as overlap), in a clip of the same file name. One that has grown worse than
accepted, by more than 10 %, is new.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from physretarget.errors import InputError
from physretarget.files import write_file
from physretarget.validation.report import Finding, Report

SCHEMA = "physretarget/baseline/1"
_WORSE = 1.1
_NEAR_S = 1.0

Accepted = list[dict[str, Any]]


def save_baseline(reports: Iterable[Report], path: str | os.PathLike[str]) -> None:
    """Write the findings of these reports as accepted.

    Args:
        reports: Reports whose findings are accepted.
        path: The JSON file.
    """
    entries = [
        {
            "clip": Path(report.clip.path).name, "code": f.code, "body": f.body,
            "frame_first": f.frame_first, "frame_last": f.frame_last, "value": f.value,
            "severity": f.severity,
        }
        for report in reports
        for f in report.findings
    ]  # fmt: skip
    text = json.dumps({"schema": SCHEMA, "accepted": entries}, indent=1, sort_keys=True)
    write_file(path, (text + "\n").encode())


def load_baseline(path: str | os.PathLike[str]) -> Accepted:
    """Read a baseline file.

    Args:
        path: The JSON file.

    Returns:
        The accepted findings.
    """
    try:
        document = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}.", path=path) from error
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise InputError("is not a JSON baseline.", path=path) from error
    entries = document.get("accepted") if isinstance(document, dict) else None
    if not isinstance(entries, list) or document.get("schema") != SCHEMA:
        raise InputError(f"is no baseline: the schema must be '{SCHEMA}'.", path=path)
    for entry in entries:
        if not isinstance(entry, dict) or not {"clip", "code"} <= set(entry):
            raise InputError("an accepted finding needs 'clip' and 'code'.", path=path)
    return entries


def apply_baseline(report: Report, accepted: Accepted) -> Report:
    """The report without accepted findings; they are counted in ``Report.accepted``.

    Args:
        report: A new report.
        accepted: What ``load_baseline`` read.

    Returns:
        The report with what is new.
    """
    name = Path(report.clip.path).name
    mine = [entry for entry in accepted if entry["clip"] == name]
    near = round(_NEAR_S * report.clip.fps)
    kept = tuple(f for f in report.findings if not any(_covers(e, f, near) for e in mine))
    gone = len(report.findings) - len(kept)
    return replace(report, findings=kept, accepted=report.accepted + gone)


def _covers(entry: dict[str, Any], finding: Finding, near: int) -> bool:
    if entry["code"] != finding.code or entry.get("body") != finding.body:
        return False
    if entry.get("severity") == "warning" and finding.severity == "error":
        return False
    first, last = entry.get("frame_first"), entry.get("frame_last")
    if (
        isinstance(first, int)
        and isinstance(last, int)
        and (finding.frame_first is not None and finding.frame_last is not None)
    ):
        apart = finding.frame_first > last + near or finding.frame_last < first - near
        if apart:
            return False
    value = entry.get("value")
    if not isinstance(value, (int, float)) or finding.value is None:
        return True
    return bool(abs(finding.value) <= abs(value) * _WORSE)
