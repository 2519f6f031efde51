"""Rules about a clip: a check over an analysis, and what checks share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from physretarget.options.judging import Severity
from physretarget.validation.analysis import Analysis
from physretarget.validation.report import Finding
from physretarget.validation.rule import Judgement, Limits, Rule

# Bad stretches closer than this are one finding, or a noisy clip would drown its reader.
MERGE_S = 0.1
MAX_FINDINGS = 10


@dataclass(frozen=True, kw_only=True)
class ClipRule(Rule):
    """A rule about a clip; ``check`` looks at an analysis under the limits that hold."""

    check: Callable[[Analysis, Limits, ClipRule], Judgement]


def intervals(bad: NDArray[np.bool_], fps: float) -> list[tuple[int, int]]:
    """First and last frame of each stretch of True, stretches within MERGE_S joined."""
    frames = np.flatnonzero(bad)
    if len(frames) == 0:
        return []
    reach = max(1, round(MERGE_S * fps))
    cuts = np.flatnonzero(np.diff(frames) > reach)
    firsts = np.r_[frames[0], frames[cuts + 1]]
    lasts = np.r_[frames[cuts], frames[-1]]
    return [(int(a), int(b)) for a, b in zip(firsts, lasts, strict=True)]


def exceeding(
    analysis: Analysis,
    rule: ClipRule,
    series: NDArray[np.float64],
    *,
    warning: float,
    error: float,
    message: str,
    unit: str,
    body: Callable[[int], str | None] | None = None,
    sign: float = 1.0,
    minimum_s: float = 0.0,
) -> Judgement:
    """Findings where ``series`` (T,) exceeds ``warning``; an error where it exceeds ``error``.

    NaN frames are not judged. ``message`` may use {value}, {limit}, {unit} and {body}.
    ``minimum_s`` drops stretches shorter than that. The worst MAX_FINDINGS are kept, the
    others counted in the last one's message.
    """
    with np.errstate(invalid="ignore"):
        bad = series > warning
    found: list[Finding] = []
    for first, last in intervals(bad, analysis.fps):
        if (last - first + 1) / max(analysis.fps, 1e-9) < minimum_s:
            continue
        worst = first + int(np.nanargmax(series[first : last + 1]))
        value = float(series[worst])
        severity: Severity = "error" if value > error else "warning"
        limit = error if severity == "error" else warning
        name = body(worst) if body else None
        text = message.format(
            value=f"{sign * value:.3g}", limit=f"{sign * limit:.3g}", unit=unit, body=name or ""
        )
        found.append(
            rule.finding(
                severity=severity, message=text, frame_first=analysis.clip_frame(first),
                frame_last=analysis.clip_frame(last), frame=analysis.clip_frame(worst),
                time_s=float(analysis.time[worst]), body=name, value=sign * value,
                limit=sign * limit, unit=unit,
            )
        )  # fmt: skip
    return Judgement(findings=tuple(_worst(found)))


def _worst(found: list[Finding]) -> list[Finding]:
    found.sort(key=lambda f: (f.severity != "error", -f.excess))
    kept, rest = found[:MAX_FINDINGS], found[MAX_FINDINGS:]
    if rest:
        more = f" And {len(rest)} more stretches like this."
        kept[-1] = replace(kept[-1], message=kept[-1].message + more)
    return kept


def most_severe(found: list[Finding]) -> tuple[Finding, ...]:
    """The worst MAX_FINDINGS, errors first."""
    return tuple(_worst(found))


def dof_names(analysis: Analysis) -> list[str]:
    """For every degree of freedom the name of its joint."""
    tree = analysis.character.tree
    names = [""] * tree.nv
    width = {"free": 6, "ball": 3, "hinge": 1, "slide": 1}
    for joint, name in zip(tree.joints, analysis.character.joint_names, strict=True):
        names[joint.dof : joint.dof + width[joint.kind]] = [name] * width[joint.kind]
    return names
