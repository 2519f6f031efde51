"""What a validation says: measures, findings, coverage. Renderers only read it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from physretarget.kinematics.runs import runs
from physretarget.options.judging import Severity, Verdict

SCHEMA = "physretarget/report/1"
Status = Literal["checked", "not-covered"]

# What can be required to have been judged, and the rule that says whether it was.
REQUIRABLE = {"dynamics": "DYN001", "contact": "CON001", "torques": "DYN008"}


@dataclass(frozen=True, kw_only=True)
class Measure:
    """A number about the clip; ``value`` is None where it could not be taken."""

    value: float | None
    unit: str
    frame: int | None = None


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A coded judgement about frames ``frame_first`` to ``frame_last`` (None: the whole clip).

    ``frame`` is the worst of them and ``time_s`` its time: where to look.
    """

    code: str
    rule: str
    severity: Severity
    message: str
    frame_first: int | None = None
    frame_last: int | None = None
    frame: int | None = None
    time_s: float | None = None
    body: str | None = None
    value: float | None = None
    limit: float | None = None
    unit: str = ""

    @property
    def excess(self) -> float:
        """How far beyond its limit, as a ratio, for sorting the worst first."""
        if self.value is None or not self.limit:
            return 1.0
        return abs(self.value / self.limit)


@dataclass(frozen=True, kw_only=True)
class Coverage:
    """Whether a rule could judge, and if not, why."""

    code: str
    status: Status
    reason: str = ""


@dataclass(frozen=True, kw_only=True)
class Cause:
    """Why the clip is probably as it is, and what to do; ``value`` is its size where it has one."""

    code: str
    message: str
    remedy: str
    value: float | None = None


@dataclass(frozen=True, kw_only=True)
class ClipFacts:
    """The clip as judged; ``first_line`` is the line of its first frame in a text file."""

    path: str
    sha256: str
    frames: int
    duration_s: float
    fps: float
    notes: tuple[str, ...] = ()
    first_line: int | None = None


@dataclass(frozen=True, kw_only=True)
class ModelFacts:
    """The model it was judged with."""

    path: str
    sha256: str
    mass_kg: float
    com_height_m: float
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class UsedSettings:
    """Everything that a figure depends on."""

    profile: str
    lowpass_hz: float | None
    derivative: str
    contact_tolerance_m: float
    friction: float
    floor_height_m: float
    contact: str


class ContactForces:
    """The contact forces that were found, to be drawn: of every frame the four largest."""

    def __init__(self, arrays: Mapping[str, NDArray[np.float32]]) -> None:
        self._arrays = arrays

    @property
    def origin(self) -> NDArray[np.float32]:
        """(T, 4, 3) m."""
        return self._arrays["origin"]

    @property
    def vector(self) -> NDArray[np.float32]:
        """(T, 4, 3) BW."""
        return self._arrays["vector"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Report:
    """The whole verdict on one clip.

    ``series`` are per-frame arrays (T,) for timelines, ``forces`` the contact forces for a
    replay; both stay out of the JSON, and are read when asked for, every time anew.
    ``accepted`` counts findings that a baseline took out. ``causes`` say what probably lies behind
    the findings, the likeliest first.
    """

    tool: Mapping[str, str]
    clip: ClipFacts
    model: ModelFacts
    settings: UsedSettings
    measures: Mapping[str, Measure]
    findings: tuple[Finding, ...]
    coverage: tuple[Coverage, ...]
    literature: Mapping[str, Any] = field(default_factory=dict)
    series: Mapping[str, NDArray[np.floating[Any]]] = field(default_factory=dict)
    forces: ContactForces | None = None
    accepted: int = 0
    causes: tuple[Cause, ...] = ()

    @property
    def errors(self) -> int:
        """Findings of severity error."""
        return sum(f.severity == "error" for f in self.findings)

    @property
    def warnings(self) -> int:
        """Findings of severity warning."""
        return sum(f.severity == "warning" for f in self.findings)

    @property
    def verdict(self) -> Verdict:
        """Failed with errors; without any, passed only where the floor's forces were judged."""
        if self.errors:
            return "failed"
        return "passed" if self.not_judged is None else "not judged"

    @property
    def passed(self) -> bool:
        """Whether the verdict is "passed"."""
        return self.verdict == "passed"

    @property
    def not_judged(self) -> str | None:
        """Why the forces that the floor would have to supply were not judged, None where they were.

        Rules that were not selected are not missed.
        """
        return self._gap("dynamics") if self._coverage_of("dynamics") is not None else None

    def clean_ranges(self, shortest_s: float = 1.0) -> list[tuple[float, float]]:
        """The stretches without an error, begin and end in seconds from the first frame, in order.

        An error about the whole clip leaves none. A stretch shorter than ``shortest_s`` is of no
        use to anybody who cuts it out, and is left out.

        Args:
            shortest_s: Shorter stretches are left out, s.

        Returns:
            Begin and end of each stretch, s.
        """
        bad = np.zeros(self.clip.frames, dtype=bool)
        for finding in self.findings:
            if finding.severity != "error":
                continue
            if finding.frame_first is None:
                return []
            last = finding.frame_first if finding.frame_last is None else finding.frame_last
            bad[finding.frame_first : last + 1] = True
        step = self.clip.duration_s / max(1, self.clip.frames - 1)
        ranges = [(first * step, last * step) for first, last in runs(~bad)]
        return [(begin, end) for begin, end in ranges if end - begin >= shortest_s]

    def unmet(self, required: Iterable[str]) -> dict[str, str]:
        """Of what is required to be judged (dynamics, contact, torques) what was not, and why.

        Args:
            required: Any of dynamics, contact and torques.

        Returns:
            What was not judged → the reason.
        """
        gaps = {name: self._gap(name) for name in required}
        return {name: reason for name, reason in gaps.items() if reason is not None}

    def _coverage_of(self, what: str) -> Coverage | None:
        return next((c for c in self.coverage if c.code == REQUIRABLE[what]), None)

    def _gap(self, what: str) -> str | None:
        entry = self._coverage_of(what)
        if entry is None:
            return f"rule {REQUIRABLE[what]} was not selected"
        return None if entry.status == "checked" else entry.reason

    def fails(self, fail_on: Severity = "error", require: Iterable[str] = ()) -> bool:
        """Whether findings at or above this severity exist, or what is required was not judged.

        Args:
            fail_on: Severity that counts: error or warning.
            require: Any of dynamics, contact and torques.

        Returns:
            Whether the exit code is 1.
        """
        found = self.errors > 0 or (fail_on == "warning" and self.warnings > 0)
        return found or bool(self.unmet(require))

    def to_dict(self) -> dict[str, Any]:
        """The JSON document, floats rounded to seven digits so that it reads."""
        document: dict[str, Any] = {
            "schema": SCHEMA,
            "tool": dict(self.tool),
            "clip": {
                "path": self.clip.path,
                "sha256": self.clip.sha256,
                "frames": self.clip.frames,
                "duration_s": _rounded(self.clip.duration_s),
                "fps": _rounded(self.clip.fps),
                "notes": list(self.clip.notes),
            },
            "model": {
                "path": self.model.path,
                "sha256": self.model.sha256,
                "mass_kg": _rounded(self.model.mass_kg),
                "com_height_m": _rounded(self.model.com_height_m),
                "notes": list(self.model.notes),
            },
            "settings": {
                "profile": self.settings.profile,
                "lowpass_hz": self.settings.lowpass_hz,
                "derivative": self.settings.derivative,
                "contact_tolerance_m": _rounded(self.settings.contact_tolerance_m),
                "friction": _rounded(self.settings.friction),
                "floor_height_m": _rounded(self.settings.floor_height_m),
                "contact": self.settings.contact,
            },
            "measures": {
                name: {"value": _rounded(m.value), "unit": m.unit, "frame": m.frame}
                for name, m in self.measures.items()
            },
            "findings": [_finding(f) for f in self.findings],
            "coverage": [
                {"code": c.code, "status": c.status, "reason": c.reason} for c in self.coverage
            ],
            "causes": [
                {
                    "code": c.code,
                    "message": c.message,
                    "remedy": c.remedy,
                    "value": _rounded(c.value),
                }
                for c in self.causes
            ],
            "summary": {
                "errors": self.errors,
                "warnings": self.warnings,
                "passed": self.passed,
                "verdict": self.verdict,
                "reason": self.not_judged or "",
                "accepted": self.accepted,
            },
        }
        if self.literature:
            document["literature"] = {
                name: {k: _rounded(v) if isinstance(v, float) else v for k, v in entry.items()}
                for name, entry in self.literature.items()
            }
        return document


def _finding(finding: Finding) -> dict[str, Any]:
    return {
        "code": finding.code,
        "rule": finding.rule,
        "severity": finding.severity,
        "message": finding.message,
        "frame_first": finding.frame_first,
        "frame_last": finding.frame_last,
        "frame": finding.frame,
        "time_s": _rounded(finding.time_s),
        "body": finding.body,
        "value": _rounded(finding.value),
        "limit": _rounded(finding.limit),
        "unit": finding.unit,
    }


def _rounded(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.7g}")
