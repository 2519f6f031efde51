"""The clip is played at another speed than it was recorded at.

What it does
------------
Fits a parabola to the centre of mass in every flight of at least 8 frames: it must fall at g.
Without flights, where the clip has errors, compares for frame rates from an eighth to eight times
the given one how far the floor would have to press outside what touches. And takes the steps of a
walk: whoever strides out far steps quickly, since a leg is a pendulum.

Why it matters
--------------
120 frames/s that are called 30 make a slow motion: it hardly needs forces, and passes whatever it
is. 30 that are called 120 make a body that nothing can hold.

Threshold
---------
Error where flights agree on a rate more than a quarter off; where another rate leaves less than
0.35 of what presses outside, and that was more than 0.15 heights of the centre of mass, and the
rate is at least 1.6 times slower; or where steps of 0.4 to 1.2 leg lengths come more rarely than
0.2 times per sqrt(leg / g): people stride at 0.55, and at 0.36 when they dawdle with short steps.

Example
-------
A capture of 120 frames/s read with --fps 30.
"""

from __future__ import annotations

from physretarget.validation.analysis import Analysis
from physretarget.validation.clip_rule import ClipRule
from physretarget.validation.report import Cause
from physretarget.validation.rule import Judgement, Limit, Limits
from physretarget.validation.timing import LEISURE, cadence, timing

_RATES = (24.0, 25.0, 30.0, 50.0, 60.0, 100.0, 120.0, 200.0, 240.0, 250.0, 500.0)
_NEAR = 0.12  # a rate as near as that to one in use is that one
_SHORTEST, _LONGEST = 0.4, 1.2  # leg lengths of a walker's step


def check(analysis: Analysis, limits: Limits, rule: ClipRule) -> Judgement:
    """The clip is played at another speed than it was recorded at."""
    if analysis.frames < 14:
        return Judgement(not_covered="needs at least 14 frames")
    if not analysis.character.has_root:
        return Judgement(not_covered=analysis.no_forces_because)
    if not analysis.has_geometry:
        return Judgement(not_covered="the model has no geometry that could stand on the floor")
    factor, why = _factor(analysis, limits)
    if factor is None:
        return Judgement()
    true = analysis.fps * factor
    nearest = min(_RATES, key=lambda rate: abs(rate / true - 1))
    rate = nearest if abs(nearest / true - 1) < _NEAR else round(true, 1)
    message = f"the clip runs at {analysis.fps:.4g} frames/s, and {why} ask for about {rate:.4g}"
    remedy = f"Read it with --fps {rate:.4g}, or correct its times"
    return Judgement(
        findings=(rule.finding(
            severity="error", message=f"{message}. {remedy}", value=analysis.fps, limit=rate,
            unit="1/s",
        ),),
        causes=(Cause(code=rule.code, message=message, remedy=remedy, value=rate),),
    )  # fmt: skip


def _factor(analysis: Analysis, limits: Limits) -> tuple[float | None, str]:
    """How many times too slow the clip is, None where it is not, and what says so."""
    seen = analysis.evidence
    told = timing(analysis.character, analysis.poses, analysis.frames, analysis.fps)
    if told is not None and told.flights:
        off = max(told.factor, 1 / told.factor) > limits["flight"]
        return (told.factor if off else None), "its flights"
    own = analysis.continuity.noise_step < 1.5 / analysis.fps
    noise = float(analysis.continuity.noise_position[own].max(initial=0.0))
    stands = abs(seen.offset) < limits["offset"] * seen.height and noise < limits["noise"]
    if stands and told is not None and told.factor <= limits["slower"]:
        given, best = (outside / seen.height for outside in told.outside)
        if given > limits["outside"] and best < limits["left"] * given:
            return told.factor, "its forces"
    walk = cadence(analysis.character, analysis.evidence, analysis.probe)
    if walk is not None and _SHORTEST <= walk.length <= _LONGEST and walk.rate < limits["cadence"]:
        return walk.length / walk.rate / LEISURE, "its steps"
    return None, ""


RULE = ClipRule(
    code="DAT012",
    name="frame-rate",
    doc=__doc__ or "",
    check=check,
    limits={
        "flight": Limit(value=1.25, unit="1", source="ours: simulated flights agree within 3 %"),
        "slower": Limit(value=0.625, unit="1", source="ours: nearer rates are told by nothing"),
        "outside": Limit(value=0.15, unit="1", source="ours: generated walks reach 0.149"),
        "left": Limit(value=0.35, unit="1", source="ours: walks that are right keep 0.6 and more"),
        "noise": Limit(value=0.002, unit="m", source="noise looks like force: an error of KIN003"),
        "cadence": Limit(value=0.2, unit="1", source="ours: half of a dawdle"),
        "offset": Limit(value=0.1, unit="1", source="ours: elsewhere nothing bears"),
    },
)
