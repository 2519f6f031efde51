"""A report for people at a terminal: the worst first, with the frame to look at."""

from __future__ import annotations

import io
from collections import Counter

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from physretarget.report.words import count
from physretarget.validation.report import Finding, Report

_STYLE = {"error": "bold red", "warning": "yellow"}
_VERDICT_STYLE = {"passed": "bold green", "failed": "bold red", "not judged": "bold yellow"}
_PLAUSIBLE = {"passed": "plausible", "failed": "not plausible", "not judged": "not judged"}


def render_text(report: Report, *, width: int = 110, color: bool = False, most: int = 5) -> str:
    """The report as text; ANSI colours only when asked for.

    At most ``most`` findings of one code and severity are listed, the others counted.

    Args:
        report: The report.
        width: Columns of the terminal.
        color: Use ANSI colours.
        most: Findings listed of one code and severity.

    Returns:
        The text.
    """
    out = io.StringIO()
    console = Console(
        file=out,
        width=width,
        force_jupyter=False,
        force_terminal=color,
        no_color=not color,
        highlight=False,
        color_system="standard" if color else None,
    )
    _verdict(console, report)
    _head(console, report)
    if report.findings:
        console.print(_findings(report, most))
    console.print(_measures(report))
    console.print(f"Derivatives: {report.settings.derivative}.")
    if report.literature:
        console.print(_literature(report))
    _coverage(console, report)
    _verdict(console, report)
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines()) + "\n"


def cause_line(report: Report) -> str:
    """The likeliest cause and its remedy, in one line."""
    cause = report.causes[0]
    return f"probable cause ({cause.code}): {cause.message}. {cause.remedy}."


def one_line(report: Report) -> str:
    """The verdict with the worst finding and its place in time, for after a clip was made."""
    text = (
        f"{_PLAUSIBLE[report.verdict]}, "
        f"{count(report.errors, 'error')} and {count(report.warnings, 'warning')}"
    )
    if report.causes:
        return f"{text}; {cause_line(report)}"
    if not report.findings:
        return f"{text}."
    worst = report.findings[0]
    place = "" if worst.time_s is None else f" at {worst.time_s:.2f} s"
    return f"{text}; the worst is {worst.code}{place}: {worst.message}."


def _head(console: Console, report: Report) -> None:
    clip, model, used = report.clip, report.model, report.settings
    console.print(
        f"{count(clip.frames, 'frame')}, {clip.duration_s:.2f} s, {clip.fps:.4g} frames/s"
    )
    console.print(
        f"{escape(model.path)}  {model.mass_kg:.4g} kg, CoM height {model.com_height_m:.3g} m"
    )
    filtered = "no filter" if used.lowpass_hz is None else f"low-pass {used.lowpass_hz:g} Hz"
    console.print(
        f"profile {used.profile}, {filtered}, contact within {used.contact_tolerance_m * 100:.2g} "
        f"cm of z = {used.floor_height_m:g} m ({used.contact}), friction {used.friction:g}"
    )
    for note in (*clip.notes, *model.notes):
        console.print(f"  note: {escape(note)}", style="dim")


def _findings(report: Report, most: int) -> Table:
    table = Table(title="Findings, worst first", title_justify="left", expand=True)
    for name, ratio in (("", 0), ("code", 0), ("frames", 0), ("look at", 0), ("what", 1)):
        table.add_column(name, ratio=ratio or None, no_wrap=ratio == 0)
    shown: Counter[tuple[str, str]] = Counter()
    for finding in report.findings:
        kind = (finding.code, finding.severity)
        shown[kind] += 1
        if shown[kind] > most:
            continue
        style = _STYLE[finding.severity]
        table.add_row(
            f"[{style}]{finding.severity}[/]", f"[{style}]{finding.code}[/]", _frames(finding),
            _look(finding), escape(finding.message),
        )  # fmt: skip
    for (code, severity), number in shown.items():
        if number > most:
            style = _STYLE[severity]
            table.add_row(
                f"[{style}]{severity}[/]", f"[{style}]{code}[/]", "", "",
                f"and {number - most} more of these",
            )  # fmt: skip
    return table


def _frames(finding: Finding) -> str:
    if finding.frame_first is None:
        return "all"
    if finding.frame_first == finding.frame_last:
        return str(finding.frame_first)
    return f"{finding.frame_first}-{finding.frame_last}"


def _look(finding: Finding) -> str:
    if finding.frame is None:
        return ""
    return f"{finding.frame}" + (f" ({finding.time_s:.2f} s)" if finding.time_s is not None else "")


def _measures(report: Report) -> Table:
    table = Table(title="Measures", title_justify="left")
    table.add_column("measure")
    table.add_column("value", justify="right")
    table.add_column("unit")
    table.add_column("worst frame", justify="right")
    for name, measure in report.measures.items():
        value = "not taken" if measure.value is None else f"{measure.value:.4g}"
        frame = "" if measure.frame is None else str(measure.frame)
        table.add_row(name, value, measure.unit, frame)
    return table


def _literature(report: Report) -> Table:
    table = Table(title="Other tools' definitions, for comparison only", title_justify="left")
    for name in ("number", "value", "unit", "beware"):
        table.add_column(name)
    for name, entry in report.literature.items():
        value = "not taken" if entry["value"] is None else f"{entry['value']:.4g}"
        table.add_row(name, value, entry["unit"], entry["caution"])
    return table


def _coverage(console: Console, report: Report) -> None:
    checked = sum(c.status == "checked" for c in report.coverage)
    console.print(f"Covered: {checked} of {len(report.coverage)} rules.")
    for entry in report.coverage:
        if entry.status == "not-covered":
            console.print(f"  not covered: {entry.code}, {escape(entry.reason)}")


def _verdict(console: Console, report: Report) -> None:
    accepted = f", {report.accepted} accepted by the baseline" if report.accepted else ""
    verdict = f"[{_VERDICT_STYLE[report.verdict]}]{report.verdict}[/]"
    console.print(
        f"[bold]{escape(report.clip.path)}[/] {verdict}: "
        f"{count(report.errors, 'error')}, {count(report.warnings, 'warning')}{accepted}"
    )
    if report.not_judged is not None:
        console.print(f"The forces of the floor were not judged: {escape(report.not_judged)}.")
    if report.causes:
        line = cause_line(report)
        console.print(escape(line[0].upper() + line[1:]), style="bold")
