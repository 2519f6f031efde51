"""The page of a mended clip: before and after side by side, by rule, by acting, in pictures."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from physretarget.acting import measure_acting
from physretarget.clip import Clip, write_file
from physretarget.mend import Fixed
from physretarget.mjcf import Character
from physretarget.replay.clip import report_forces
from physretarget.replay.figures import figure
from physretarget.replay.scene import Scene
from physretarget.report.document import (
    as_document,
    document_marks,
    document_sections,
    facts,
    judgement,
)
from physretarget.report.json import render_json
from physretarget.report.page import finding_plots, render_page
from physretarget.report.retarget_data import StageMotion
from physretarget.report.retarget_html import STRIP_COLUMNS, acting_rows
from physretarget.report.stills import Row, stills
from physretarget.validation import Report

__all__ = ["render_fix_html", "write_fix_report"]

NAMES = ("before", "after")
TINTS = ((0.75, 0.48, 0.40), (0.42, 0.52, 0.70))
_NOTES = ("the clip as given", "mended")


def write_fix_report(
    before: Clip, done: Fixed, character: Character, reports: tuple[Report, Report], folder: Path
) -> Path:
    """Write ``report.html`` and the judgements before and after into a folder; the page's path.

    Args:
        before: The clip as given.
        done: What ``fix`` gave.
        character: Whose clip it is.
        reports: The verdicts before and after.
        folder: The folder, made if it is not there.

    Returns:
        The page.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name, report in zip(NAMES, reports, strict=True):
        write_file(folder / f"{name}.json", render_json(report).encode())
    page = folder / "report.html"
    write_file(page, render_fix_html(before, done, character, reports).encode())
    return page


def render_fix_html(
    before: Clip,
    done: Fixed,
    character: Character,
    reports: tuple[Report, Report],
    *,
    painted: bool = True,
) -> str:
    """The page. ``reports`` judge the clip before and after.

    ``painted``: the film strip is there before the browser has drawn it, where OpenGL works.
    """
    clips = (before, done.clip)
    documents = [as_document(report) for report in reports]
    marks = document_marks(documents[1])
    offset = 0.75 * character.height
    figures = tuple(
        figure(
            character,
            clip.qpos,
            name=name,
            offset=(0.0, side * offset, 0.0),
            tint=tint,
            forces=report_forces(report, clip.frames),
        )
        for name, clip, side, tint, report in zip(
            NAMES, clips, (1, -1), TINTS, reports, strict=True
        )
    )
    scene = Scene(title=before.name, time=before.time, figures=figures, marks=marks, layout="split")
    findings = finding_plots(marks)
    judged = judgement(documents[1])
    return render_page(
        "fix.html.j2",
        scene,
        plots=[*findings],
        strip=_strip(scene, painted=painted),
        context={
            "title": f"{before.name}, mended",
            "model_name": character.name,
            "summaries": [document["summary"] for document in documents],
            "rules": rule_rows(reports),
            "deeds": _deeds(character, clips, reports),
            "moved": f"{100 * done.moved_rms_m:.1f} cm",
            "posed": f"{100 * done.posed_rms_m:.1f} cm",
            "notes": done.notes,
            "finding_plots": findings,
            "sections": facts(document_sections(documents[1])),
            **judged,
        },
    )


def rule_rows(reports: tuple[Report, Report]) -> list[dict[str, Any]]:
    """Errors and warnings of every rule that has some, before and after; most errors first."""
    counts = [
        {
            severity: Counter(f.code for f in report.findings if f.severity == severity)
            for severity in ("error", "warning")
        }
        for report in reports
    ]
    codes = {code for each in counts for kind in each.values() for code in kind}
    rows = [
        {
            "code": code,
            "errors": [each["error"][code] for each in counts],
            "warnings": [each["warning"][code] for each in counts],
        }
        for code in codes
    ]
    return sorted(rows, key=lambda row: (-max(row["errors"]), str(row["code"])))


def _deeds(
    character: Character, clips: tuple[Clip, Clip], reports: tuple[Report, Report]
) -> list[dict[str, str]]:
    stages = {name: clip.qpos for name, clip in zip(NAMES, clips, strict=True)}
    acting = measure_acting(character, stages, clips[0].time)
    return acting_rows(
        tuple(
            StageMotion(label=name, qpos=clip.qpos, acting=acted, errors=report.errors)
            for name, clip, acted, report in zip(NAMES, clips, acting, reports, strict=True)
        )
    )


def _strip(scene: Scene, *, painted: bool) -> dict[str, Any]:
    time = scene.time
    part = (np.arange(STRIP_COLUMNS) + 0.5) / STRIP_COLUMNS
    times = time[0] + part * (time[-1] - time[0])
    frames = np.abs(time[:, None] - times).argmin(axis=0)
    pictures: tuple[str, ...] = ("", "")
    if painted:
        pictures = stills(
            [
                Row(look=name, figure=each, frames=frames)
                for name, each in zip(NAMES, scene.figures, strict=True)
            ]
        )
    rows = [
        {"figure": k, "label": name, "note": note, "still": still}
        for k, (name, note, still) in enumerate(zip(NAMES, _NOTES, pictures, strict=True))
    ]
    return {"rows": rows, "times": [float(t) for t in times]}
