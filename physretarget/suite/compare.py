"""Now against accepted: what is new, fixed, worse, better, missing, errored, or the same.

The comparison is always with the accepted baseline, never with yesterday: a slow drift adds up
until it leaves the tolerance. A difference counts where it exceeds the absolute tolerance plus
the relative one times the baseline's value, both in the direction that is worse for that measure.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

DIRECTIONS = Literal["lower", "higher", "one", "none"]
Verdict = Literal["errored", "worse", "missing", "fixed", "better", "new", "same"]
VERDICTS: tuple[Verdict, ...] = ("errored", "worse", "missing", "fixed", "better", "new", "same")


@dataclass(frozen=True, kw_only=True)
class Tolerance:
    """What is better, and how much is nothing.

    ``direction``: "lower" or "higher" is better, "one": the nearer to 1 the better, "none":
    told, never judged. ``absolute`` in the measure's unit, ``relative`` a share of the baseline.
    """

    direction: DIRECTIONS = "lower"
    absolute: float = 0.0
    relative: float = 0.05


# Absolute tolerances by unit: below what a viewer sees or a laboratory measures.
_BY_UNIT = {
    "BW": 0.02,  # 2 % of body weight: force plates agree to about 1 %
    "BW h": 0.01,
    "m": 0.002,  # 2 mm: marker noise
    "m/s": 0.02,
    "m/s^2": 0.2,
    "rad": 0.01,
    "rad/s": 0.2,
    "s": 0.04,  # about one frame of animation
    "1/s": 0.2,
    "1": 0.01,
}
# Measures that do not simply get worse upward.
_SPECIAL: dict[str, Tolerance] = {
    # A clip at rest or in cyclic motion needs one body weight on average.
    "required_force_vertical_mean_bw": Tolerance(direction="one", absolute=0.02, relative=0.0),
    "required_force_vertical_min_bw": Tolerance(direction="higher", absolute=0.05, relative=0.05),
    # How much of a clip is spent in the air is choreography, not quality.
    "flight_frames_fraction": Tolerance(direction="none"),
    # Peaks over single frames scatter more than means.
    "required_force_vertical_max_bw": Tolerance(absolute=0.05, relative=0.05),
    "root_acceleration_max_m_s2": Tolerance(absolute=0.5, relative=0.1),
    "jerk_dimensionless_max": Tolerance(absolute=0.0, relative=0.1),
    "joint_torque_ratio_max": Tolerance(absolute=0.05, relative=0.05),
}


def tolerance_of(name: str, unit: str) -> Tolerance:
    """The built-in tolerance of a measure: its own, or its unit's with lower being better."""
    return _SPECIAL.get(name) or Tolerance(absolute=_BY_UNIT.get(unit, 0.0))


@dataclass(frozen=True, kw_only=True)
class Change:
    """One measure or one kind of finding that differs; ``worse`` says in which way."""

    name: str
    before: float | None
    now: float | None
    unit: str
    worse: bool


@dataclass(frozen=True, kw_only=True)
class State:
    """What is remembered of a result: enough to compare.

    ``message`` says why it errored, or why the floor's forces were not judged.

    ``status`` is "ok" or "errored"; ``measures`` name → {value, unit}; ``findings`` code →
    {"errors", "warnings"}.
    """

    address: str
    status: Literal["ok", "errored"]
    message: str = ""
    measures: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    findings: Mapping[str, Mapping[str, int]] = field(default_factory=dict)

    @property
    def errors(self) -> int:
        """Findings of severity error."""
        return sum(f["errors"] for f in self.findings.values())

    @property
    def warnings(self) -> int:
        """Findings of severity warning."""
        return sum(f["warnings"] for f in self.findings.values())

    @property
    def judgement(self) -> str:
        """The report's verdict: passed, failed or not judged."""
        if self.errors:
            return "failed"
        return "not judged" if self.status != "ok" or self.message else "passed"

    @property
    def passed(self) -> bool:
        """Judged, without an error."""
        return self.judgement == "passed"


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """The verdict on one clip and what it rests on."""

    verdict: Verdict
    reason: str
    changes: tuple[Change, ...] = ()
    blocking: bool = False


def compare(
    now: State | None,
    baseline: State | None,
    tolerances: Mapping[str, Mapping[str, Any]] | None = None,
) -> Comparison:
    """Judge a clip's result now against the accepted one.

    Only what was accepted can block: a clip without a baseline is new (or errored) and never
    does, so that a young baseline blocks nobody. ``tolerances`` gives fields of
    :class:`Tolerance` by measure, over the built-in ones.
    """
    if now is None and baseline is None:
        raise ValueError("there is neither a result nor a baseline to compare")
    if now is None:
        return Comparison(
            verdict="missing", reason="was accepted and is gone from the suite", blocking=True
        )
    if now.status == "errored":
        known_bad = baseline is None or baseline.status == "errored"
        return Comparison(verdict="errored", reason=now.message, blocking=not known_bad)
    if baseline is None:
        reason = {
            "passed": "passes", "failed": f"fails with {_count(now.errors, 'error')}",
            "not judged": f"is not judged: {now.message}",
        }[now.judgement]  # fmt: skip
        return Comparison(verdict="new", reason=f"no baseline yet; {reason}")
    if baseline.address == now.address:
        return Comparison(verdict="same", reason="unchanged")
    if baseline.status == "errored":
        return Comparison(verdict="fixed", reason="could not be judged before")
    changes = (*_finding_changes(now, baseline), *_measure_changes(now, baseline, tolerances or {}))
    return _verdict(now, baseline, changes)


def _verdict(now: State, baseline: State, changes: tuple[Change, ...]) -> Comparison:
    worse = [c for c in changes if c.worse]
    better = [c for c in changes if not c.worse]
    if baseline.passed and not now.passed:
        codes = ", ".join(c for c, f in now.findings.items() if f["errors"])
        told = f"fails now: {codes}" if codes else f"is not judged now: {now.message}"
        return Comparison(
            verdict="worse", reason=f"passed before, {told}", changes=changes, blocking=True
        )
    if now.passed and not baseline.passed:
        before = f"failed before with {_count(baseline.errors, 'error')}"
        if baseline.judgement == "not judged":
            before = "was not judged before"
        reason = f"{before}, passes now"
        return Comparison(verdict="fixed", reason=reason, changes=changes)
    if worse:
        return Comparison(verdict="worse", reason=_told(worse), changes=changes, blocking=True)
    if better:
        return Comparison(verdict="better", reason=_told(better), changes=changes)
    return Comparison(verdict="same", reason="within tolerance", changes=changes)


def _finding_changes(now: State, baseline: State) -> tuple[Change, ...]:
    """Codes that gained or lost errors altogether; a mere count may change by splitting."""
    found = []
    for code in sorted({*now.findings, *baseline.findings}):
        before = baseline.findings.get(code, {}).get("errors", 0)
        after = now.findings.get(code, {}).get("errors", 0)
        if bool(before) != bool(after):
            found.append(
                Change(name=code, before=before, now=after, unit="errors", worse=after > before)
            )
    return tuple(found)


def _measure_changes(
    now: State, baseline: State, tolerances: Mapping[str, Mapping[str, Any]]
) -> tuple[Change, ...]:
    found = []
    for name in sorted({*now.measures} & {*baseline.measures}):
        unit = str(now.measures[name]["unit"])
        before, after = baseline.measures[name]["value"], now.measures[name]["value"]
        if before is None or after is None:
            continue
        tolerance = replace(tolerance_of(name, unit), **tolerances.get(name, {}))
        step = badness(after, tolerance) - badness(before, tolerance)
        if abs(step) > tolerance.absolute + tolerance.relative * abs(before):
            found.append(Change(name=name, before=before, now=after, unit=unit, worse=step > 0))
    found.sort(key=lambda c: (not c.worse, -_share(c)))
    return tuple(found)


def badness(value: float, tolerance: Tolerance) -> float:
    """The measure turned so that more is worse."""
    if tolerance.direction == "lower":
        return value
    if tolerance.direction == "higher":
        return -value
    return abs(value - 1.0) if tolerance.direction == "one" else 0.0


def _share(change: Change) -> float:
    before, now = change.before or 0.0, change.now or 0.0
    return abs(now - before) / max(abs(before), 1e-9)


def _told(changes: list[Change]) -> str:
    first = changes[0]
    more = f", and {len(changes) - 1} more" if len(changes) > 1 else ""
    unit = "" if first.unit == "1" else f" {first.unit}"
    return f"{first.name} {first.before:.4g} → {first.now:.4g}{unit}{more}"


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
