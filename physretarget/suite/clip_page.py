"""The page of one clip: what changed, findings, measures beside the baseline's, timelines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

from markupsafe import Markup

from physretarget._version import __version__
from physretarget.report.words import GROUPS, look, number, pretty, quantity
from physretarget.suite.compare import State, tolerance_of
from physretarget.suite.environment import templates
from physretarget.suite.records import Accepted, Entry

Track = Sequence[tuple[int, str | None]]
# Series that clip pages draw, in this order.
_SERIES = (
    "required_force_vertical_bw", "contact_force_vertical_bw", "unexplained_force_bw",
    "unexplained_moment_bwh", "lowest_point_m", "skate_speed_m_s", "cop_outside_m",
    "joint_speed_rad_s", "joint_torque_ratio", "self_penetration_m", "jerk_dimensionless",
)  # fmt: skip


def clip_page(
    entry: Entry,
    steps: Track,
    accepted: Accepted | None,
    documents: Mapping[str, Mapping[str, Any]],
    states: Mapping[str, State],
    made: str,
) -> str:
    """The page; ``made`` is where a retargeted clip lies, seen from the page."""
    now, before = documents.get(entry.address or ""), documents.get(entry.baseline or "")
    shown: Mapping[str, Any] = now or before or {}
    same = entry.address == entry.baseline
    data = {
        "now": entry.address if now else None,
        "baseline": entry.baseline if before and not same else None,
        "charts": chart_looks(),
    }
    return templates().get_template("clip.html.j2").render(
        version=__version__, entry=entry, accepted=accepted, name=entry.clip.split("/", 1)[-1],
        data=data,
        changes=[_change_row(change) for change in entry.changes],
        measures=_measure_rows(now, before, entry, steps, states),
        findings=[_finding_row(f) for f in shown.get("findings", ())],
        gone=_gone(now, before), coverage=[
            c for c in shown.get("coverage", ()) if c["status"] != "checked"
        ],
        checked=sum(c["status"] == "checked" for c in shown.get("coverage", ())),
        document=shown, made=made if entry.kind == "retarget" and now else None,
    )  # fmt: skip


@cache
def chart_looks() -> dict[str, Any]:
    """How each series is drawn, by name; the page draws those that its motion has."""
    looks: dict[str, Any] = {}
    for name in _SERIES:
        style = look(name)
        if style is not None:
            looks[name] = {
                "title": GROUPS.get(style.group, style.label), "label": style.label,
                "unit": style.unit, "group": style.group, "ink": style.ink,
            }  # fmt: skip
    return looks


def _change_row(change: Mapping[str, Any]) -> dict[str, Any]:
    unit = "" if change["unit"] == "1" else pretty(change["unit"])
    return {
        "name": change["name"], "unit": unit, "worse": change["worse"],
        "before": number(change["before"], 4), "now": number(change["now"], 4),
    }  # fmt: skip


def _measure_rows(
    now: Mapping[str, Any] | None,
    before: Mapping[str, Any] | None,
    entry: Entry,
    steps: Track,
    states: Mapping[str, State],
) -> list[dict[str, Any]]:
    changed = {change["name"]: change["worse"] for change in entry.changes}
    shown = (now or before or {"measures": {}})["measures"]
    rows = []
    for name, measure in shown.items():
        old = before["measures"].get(name, {}).get("value") if before else None
        value = measure["value"] if now else None
        tolerance = tolerance_of(name, measure["unit"])
        trail = [
            states[a].measures.get(name, {}).get("value") for _, a in steps if a and a in states
        ]
        rows.append(
            {
                "name": name, "unit": "" if measure["unit"] == "1" else pretty(measure["unit"]),
                "now": number(value, 4), "before": number(old, 4),
                "step": _step(value, old), "frame": measure.get("frame") if now else None,
                "state": "" if name not in changed else "worse" if changed[name] else "better",
                "direction": tolerance.direction, "trend": sparkline(trail),
            }
        )  # fmt: skip
    return rows


def _step(now: float | None, before: float | None) -> str:
    if now is None or before is None or _alike(now, before):
        return ""
    return f"{'+' if now > before else ''}{number(float(f'{now - before:.3g}'))}"


def _alike(a: float, b: float) -> bool:
    """Equal as far as anybody could read: rounding must not look like news."""
    return abs(a - b) <= 1e-4 * max(abs(a), abs(b))


def sparkline(values: Sequence[float | None]) -> Markup:
    """A small line of the values; nothing where nothing changed."""
    known = [v for v in values if v is not None]
    if len(known) < 2 or _alike(min(known), max(known)):
        return Markup("")
    low, span = min(known), max(known) - min(known)
    places = [
        (2 + 76 * i / (len(known) - 1), 16 - 14 * (value - low) / span)
        for i, value in enumerate(known)
    ]
    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
    x, y = places[-1]
    return Markup(
        '<svg class="spark" viewBox="0 0 80 18" role="img" aria-label="{} earlier values">'
        '<polyline points="{}"/><circle cx="{:.1f}" cy="{:.1f}" r="2"/></svg>'
    ).format(len(known) - 1, line, x, y)


def _finding_row(finding: Mapping[str, Any]) -> dict[str, Any]:
    value, unit = quantity(finding.get("value"), finding.get("unit") or "")
    first, seconds = finding.get("frame_first"), finding.get("time_s")
    worst = finding.get("frame")
    return {
        **{key: finding.get(key) or "" for key in ("code", "rule", "severity", "message", "body")},
        "frame": first if worst is None else worst,
        "when": "whole clip" if seconds is None else f"{seconds:.2f} s",
        "value": "" if finding.get("value") is None else f"{value} {unit}".strip(),
    }


def _gone(now: Mapping[str, Any] | None, before: Mapping[str, Any] | None) -> list[str]:
    """Codes that the baseline has and the clip no longer has."""
    if now is None or before is None:
        return []
    mine = {f["code"] for f in now["findings"]}
    return sorted({f["code"] for f in before["findings"]} - mine)
