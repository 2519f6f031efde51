"""A report as Markdown, for a pull request."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePath

from physretarget.report.words import count
from physretarget.validation.report import Finding, Report

_VERDICT_MARK = {"passed": "✅", "failed": "❌", "not judged": "❔"}
_MARK = {"error": "❌", "warning": "⚠️"}
_SHOWN = 20
_HEADLINES = (
    "required_force_vertical_min_bw", "required_force_vertical_max_bw",
    "unexplained_force_rms_bw", "unexplained_moment_rms_bwh", "pull_frames_fraction",
    "skate_speed_max_m_s", "penetration_max_m", "float_time_s",
)  # fmt: skip


def render_markdown(reports: Report | Sequence[Report]) -> str:
    """One section per clip; a table of clips first where there are several."""
    many = [reports] if isinstance(reports, Report) else list(reports)
    lines: list[str] = []
    if len(many) > 1:
        lines += ["| clip | verdict | errors | warnings |", "|---|---|---:|---:|"]
        lines += [
            f"| {_cell(r.clip.path)} | {r.verdict} | {r.errors} | {r.warnings} |" for r in many
        ]
        lines.append("")
    for report in many:
        lines += _section(report)
    return "\n".join(lines)


def _section(report: Report) -> list[str]:
    used = report.settings
    filtered = "no filter" if used.lowpass_hz is None else f"low-pass {used.lowpass_hz:g} Hz"
    verdict = f"{_VERDICT_MARK[report.verdict]} {report.verdict}"
    clip, model = PurePath(report.clip.path).name, PurePath(report.model.path).name
    lines = [
        f"### {verdict}: `{clip}` on `{model}`",
        "",
        f"{count(report.errors, 'error')}, {count(report.warnings, 'warning')}"
        + (f", {report.accepted} accepted" if report.accepted else "")
        + f" · profile {used.profile}, {filtered}, contact within "
        f"{used.contact_tolerance_m * 100:.2g} cm, friction {used.friction:g}",
        "",
    ]
    if report.not_judged is not None:
        lines += [f"The forces of the floor were not judged: {report.not_judged}.", ""]
    if report.causes:
        lines += [f"**Probable cause** ({c.code}): {c.message}. {c.remedy}." for c in report.causes]
        lines.append("")
    if report.findings:
        lines += ["| | code | frames | look at | what |", "|---|---|---|---|---|"]
        lines += [_row(f) for f in report.findings[:_SHOWN]]
        if len(report.findings) > _SHOWN:
            lines += ["", f"… and {len(report.findings) - _SHOWN} more."]
        lines.append("")
    lines += ["| measure | value | unit | frame |", "|---|---:|---|---:|"]
    for name in _HEADLINES:
        measure = report.measures.get(name)
        if measure is not None:
            value = "not taken" if measure.value is None else f"{measure.value:.3g}"
            frame = "" if measure.frame is None else measure.frame
            lines.append(f"| {name} | {value} | {measure.unit} | {frame} |")
    missing = [c for c in report.coverage if c.status == "not-covered"]
    lines += [
        "",
        f"Covered: {len(report.coverage) - len(missing)} of {len(report.coverage)} rules.",
    ]
    lines += [f"- not covered: {c.code}, {_cell(c.reason)}" for c in missing]
    return [*lines, ""]


def _row(finding: Finding) -> str:
    frames = "all" if finding.frame_first is None else f"{finding.frame_first}-{finding.frame_last}"
    look = "" if finding.frame is None else str(finding.frame)
    message = _cell(finding.message)
    return f"| {_MARK[finding.severity]} | {finding.code} | {frames} | {look} | {message} |"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")
