"""From a clip and a character to a report."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from physretarget._version import __version__
from physretarget.clip import Motion
from physretarget.errors import InputError
from physretarget.mjcf import Character
from physretarget.validation import states
from physretarget.validation.analysis import Analysis, Progress, analyse
from physretarget.validation.causes import likeliest
from physretarget.validation.clip_rule import ClipRule
from physretarget.validation.codes import RULES
from physretarget.validation.config import Settings
from physretarget.validation.floating import with_free_root
from physretarget.validation.grid import MEASURED_HZ
from physretarget.validation.literature import literature
from physretarget.validation.measures import measures
from physretarget.validation.model_rule import ModelRule
from physretarget.validation.report import (
    Cause,
    ClipFacts,
    ContactForces,
    Coverage,
    Finding,
    Measure,
    ModelFacts,
    Report,
    Status,
    UsedSettings,
)
from physretarget.validation.rule import Judgement, Rule
from physretarget.validation.series import FrameSeries, Timelines
from physretarget.validation.simulated import play, simulated_measures

DERIVATIVE = "central differences, second order"
MEASURED = f"; measures at {MEASURED_HZ:g} frames/s, findings at every frame"


def validate(
    clip: Motion,
    character: Character,
    *,
    settings: Settings | None = None,
    progress: Progress | None = None,
) -> Report:
    """Judge a clip; one from :func:`physretarget.clip.open_clip` may be of any length.

    ``progress`` is told how many frames of how many are done. Raises InputError where the clip
    does not fit the model, UsageError where settings make no sense. What cannot be judged is in
    the report's coverage, never an exception.

    Args:
        clip: The motion to judge.
        character: Whose motion it is.
        settings: Profile, filter and thresholds; the defaults if None.
        progress: Called with frames done and frames in all.

    Returns:
        Findings, measures, causes, coverage and the verdict.
    """
    settings = settings or Settings()
    chosen = settings.chosen(RULES)
    if clip.nq != character.tree.nq:
        raise InputError(
            f"the clip has {clip.nq} coordinates per frame, "
            f"model '{character.name}' has nq = {character.tree.nq}.",
            path=clip.path,
        )
    clip, character, stands = with_free_root(clip, character, stands=settings.stands)
    analysis = analyse(clip, character, settings, progress, stands=stands)
    if settings.simulate:
        analysis = replace(analysis, played=play(clip, character, settings.lowpass_hz))
    findings: list[Finding] = []
    causes: list[Cause] = []
    coverage: dict[str, Coverage] = {}
    # Those that explain what others have found come last.
    for rule in sorted(chosen, key=lambda rule: rule.explains is not None):
        judgement = Judgement()
        if isinstance(rule, ModelRule):
            judgement = rule.check(character)
        elif isinstance(rule, ClipRule) and _asked(rule, findings):
            judgement = rule.check(analysis, settings.limits_of(rule), rule)
        reason = judgement.not_covered
        status: Status = "checked" if reason is None else "not-covered"
        coverage[rule.code] = Coverage(code=rule.code, status=status, reason=reason or "")
        told = settings.severity.get(rule.code)
        findings += (replace(f, severity=told) if told else f for f in judgement.findings)
        causes += judgement.causes
    findings.sort(key=_worst_first)
    return Report(
        tool={"name": "physretarget", "version": __version__},
        clip=_clip_facts(analysis),
        model=_model_facts(character),
        settings=_used(analysis),
        measures=measures(analysis) | _simulated(analysis),
        findings=tuple(findings),
        coverage=tuple(coverage[rule.code] for rule in chosen),
        causes=likeliest(causes),
        literature=literature(analysis) if settings.also_literature else {},
        series=_timelines(analysis.series),
        forces=_forces(analysis),
    )


def judge_model(character: Character) -> tuple[Finding, ...]:
    """Findings about a model alone, whatever it will be made to do.

    Args:
        character: The model.

    Returns:
        Findings of the MDL rules.
    """
    rules = (rule for rule in RULES if isinstance(rule, ModelRule))
    return tuple(finding for rule in rules for finding in rule.check(character).findings)


def validate_many(
    clips: Sequence[Motion],
    character: Character,
    *,
    settings: Settings | None = None,
    workers: int = 1,
) -> Iterator[Report]:
    """Judge several clips of one character, in order; ``workers`` threads share the work.

    Args:
        clips: The motions.
        character: Whose motions they are.
        settings: As for ``validate``.
        workers: Threads.

    Returns:
        One report per clip, in order.
    """
    if workers <= 1:
        for clip in clips:
            yield validate(clip, character, settings=settings)
        return
    with ThreadPoolExecutor(workers) as pool:
        yield from pool.map(lambda clip: validate(clip, character, settings=settings), clips)


def _simulated(analysis: Analysis) -> dict[str, Measure]:
    return simulated_measures(analysis.played) if analysis.played else {}


def _asked(rule: Rule, findings: Sequence[Finding]) -> bool:
    """Whether there is anything that a rule could explain."""
    if rule.explains is None:
        return True
    wrong = [f for f in findings if not f.code.startswith("MDL")]
    return any(f.severity == "error" or rule.explains == "findings" for f in wrong)


def _worst_first(finding: Finding) -> tuple[bool, bool, float, str, int]:
    """Errors before warnings, and of these what is wrong with the data: the rest may follow."""
    error = finding.severity == "error"
    data = error and finding.code.startswith("DAT")
    return not error, not data, -finding.excess, finding.code, finding.frame or 0


def _clip_facts(analysis: Analysis) -> ClipFacts:
    clip = analysis.clip
    line = clip.meta.get("first_line")
    return ClipFacts(
        path=clip.path or clip.name, sha256=clip.sha256 or "", frames=clip.frames,
        duration_s=clip.duration, fps=clip.fps, notes=(*clip.notes, *_elsewhere(analysis)),
        first_line=line if isinstance(line, int) else None,
    )  # fmt: skip


def _elsewhere(analysis: Analysis) -> tuple[str, ...]:
    unknown = int((~states.known(analysis)).sum())
    if unknown == 0:
        return ()
    return (
        f"Frames in or near which the character touches {states.foreign_names(analysis)} are not "
        f"judged by its forces: {unknown} of {analysis.frames}.",
    )


def _model_facts(character: Character) -> ModelFacts:
    return ModelFacts(
        path=str(character.path) if character.path else character.name,
        sha256=character.sha256, mass_kg=character.mass, com_height_m=character.com_height,
        notes=character.notes,
    )  # fmt: skip


def _used(analysis: Analysis) -> UsedSettings:
    return UsedSettings(
        profile=analysis.settings.profile,
        lowpass_hz=analysis.settings.lowpass_hz,
        derivative=DERIVATIVE + (MEASURED if analysis.coarse else ""),
        contact_tolerance_m=analysis.tolerance,
        friction=analysis.friction,
        floor_height_m=analysis.character.floor_height,
        contact=analysis.work.points.source,
    )


def _forces(analysis: Analysis) -> ContactForces | None:
    arrows = analysis.series.arrows
    if arrows is None:
        return None
    return ContactForces(
        Timelines({"origin": lambda: arrows.origin, "vector": lambda: arrows.force})
    )


def _timelines(series: FrameSeries) -> Timelines:
    """The per-frame arrays that pages show, by the names they have there."""
    made: dict[str, Callable[[], NDArray[np.generic]]] = {}
    if residual := series.residual:
        made["unexplained_force_bw"] = lambda: residual.force
        made["unexplained_moment_bwh"] = lambda: residual.moment
    if floor := series.floor:
        made["lowest_point_m"] = lambda: floor.lowest
    if skate := series.skate:
        made["skate_speed_m_s"] = lambda: skate.speed
    if residual:
        made["cop_outside_m"] = lambda: residual.cop_outside
    if torque := series.torque:
        made["joint_torque_ratio"] = lambda: torque.share
    if fastest := series.joint_speed:
        made["joint_speed_rad_s"] = lambda: fastest.speed
    if overlap := series.overlap:
        made["self_penetration_m"] = lambda: overlap.depth
    if jerk := series.jerk:
        made["jerk_dimensionless"] = lambda: jerk.worst
    if required := series.required:
        made["required_force_vertical_bw"] = lambda: required.force[:, 2]
    if bearing := series.bearing:
        made["contact_force_vertical_bw"] = lambda: bearing.force[:, 2]
    return Timelines(made)
