"""What a rule is: a code, limits with their sources, and a check over an analysis."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from physretarget.kinematics import runs as runs
from physretarget.options.judging import Profile, Severity
from physretarget.validation.analysis import Analysis
from physretarget.validation.report import Cause, Finding

Limits = Mapping[str, float]
_SECTIONS = ("What it does", "Why it matters", "Threshold", "Example")
# Bad stretches closer than this are one finding, or a noisy clip would drown its reader.
MERGE_S = 0.1
MAX_FINDINGS = 10


@dataclass(frozen=True, kw_only=True)
class Limit:
    """A threshold with its unit and source; ``robot`` where that profile differs."""

    value: float
    unit: str
    source: str
    robot: float | None = None

    def under(self, profile: Profile) -> float:
        """The default under a profile.

        Args:
            profile: animation or robot.

        Returns:
            The value, in the limit's unit.
        """
        return self.robot if profile == "robot" and self.robot is not None else self.value


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What a check returns: findings, or the reason why nothing could be judged."""

    findings: tuple[Finding, ...] = ()
    not_covered: str | None = None
    causes: tuple[Cause, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Rule:
    """One thing that is judged.

    ``doc`` is the rule file's docstring: its first line is the summary, then the sections What
    it does, Why it matters, Threshold, Example. ``explains`` makes it a rule that says why others
    have found errors, or anything: it is asked where they have.
    """

    code: str
    name: str
    doc: str
    check: Callable[[Analysis, Limits, Rule], Verdict]
    limits: Mapping[str, Limit] = field(default_factory=lambda: MappingProxyType({}))
    explains: Literal["errors", "findings"] | None = None
    severity: Severity | None = None  # None: the check decides by two limits

    @property
    def family(self) -> str:
        """The three letters of the code."""
        return self.code[:3]

    @property
    def summary(self) -> str:
        """One sentence."""
        return inspect.cleandoc(self.doc).splitlines()[0]

    @property
    def sections(self) -> dict[str, str]:
        """The docstring's sections by title."""
        text = inspect.cleandoc(self.doc)
        titles = "|".join(_SECTIONS)
        parts = re.split(rf"^({titles})\n-+\n", text, flags=re.MULTILINE)
        return {t: b.strip() for t, b in zip(parts[1::2], parts[2::2], strict=True)}

    def finding(self, *, severity: Severity, message: str, **where: object) -> Finding:
        """A finding of this rule.

        Args:
            severity: error or warning.
            message: One sentence.
            where: Frames, time, body, value, limit and unit.

        Returns:
            The finding.
        """
        return Finding(
            code=self.code,
            rule=self.name,
            severity=severity,
            message=message,
            **where,  # type: ignore[arg-type]
        )


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
    rule: Rule,
    series: NDArray[np.float64],
    *,
    warning: float,
    error: float,
    message: str,
    unit: str,
    body: Callable[[int], str | None] | None = None,
    sign: float = 1.0,
    minimum_s: float = 0.0,
) -> Verdict:
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
    return Verdict(findings=tuple(_worst(found)))


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
