"""One take: through all stages, judged, its page written, its figures kept."""

from __future__ import annotations

import time as clock
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from physretarget import capture, kinematics
from physretarget.keyposes import load_keyposes
from physretarget.mjcf import Character
from physretarget.pipeline import Retargeted, retarget
from physretarget.report.retarget import write_retarget_report
from physretarget.reproduce.plan import Take, keypose_files
from physretarget.reproduce.store import Piece, key_of, load, save
from physretarget.trained import TrainedMapper, learn
from physretarget.validation import Report, validate

Array = NDArray[np.float64]
STRIP = 8
"""Pictures in a row of a film strip."""
PENETRATION_LIMIT, SKATE_LIMIT = 0.01, 0.05
"""A clip may sink by 1 cm, and its planted points slide at 5 cm/s, not more (m, m/s)."""


@lru_cache(maxsize=4)
def learned(models: Path, character: str) -> TrainedMapper:
    """The shared GPLVM of a character from all its key poses."""
    model = Character.load(models / f"{character}.xml")
    return learn(model, load_keyposes(keypose_files(models, character), model))


def do_take(take: Take, models: Path, out: Path) -> Piece:
    """Retarget, judge and report one take, or find it done."""
    folder = out / "takes" / take.name
    character = [models / f"{take.character}.xml", *keypose_files(models, take.character)]
    key = key_of("take", take.name, take.capture, *character)
    done = load(folder, key)
    if done is not None and (folder / "report.html").is_file():
        return done
    mapper = learned(models, take.character)
    began = clock.perf_counter()
    motion = capture.load(take.capture)
    result = retarget(motion, mapper)
    made = clock.perf_counter()
    report = validate(result.clip, mapper.character)
    judged = clock.perf_counter()
    write_retarget_report(result, mapper, report, folder)
    facts = {
        "take": take.name,
        "character": take.character,
        "style": take.style,
        "action": take.action,
        "capture": take.capture.name,
        "capture_sha256": motion.source.sha256,
        "key_poses": sum(name == take.capture.name for name in mapper.sources),
        "all_key_poses": len(mapper.names),
        "duration": result.clip.duration,
        "frames": result.clip.frames,
        "seconds": {
            **result.seconds,
            "validate": judged - made,
            "page": clock.perf_counter() - judged,
        },
        "computing": made - began,
        "notes": list(result.notes),
        **_figures_of(result, report),
    }
    arrays = _arrays_of(result)
    save(folder, key, facts, arrays)
    return Piece(facts, arrays)


def _figures_of(result: Retargeted, report: Report) -> dict[str, Any]:
    placed, contacted, physical = result.placed, result.contacted, result.physical
    assert placed is not None
    assert contacted is not None
    assert physical is not None
    weight = result.character.weight
    sink, skate = planted(result.character, result.clip.qpos, contacted.active, result.motion.time)
    codes: dict[str, dict[str, Any]] = {}
    for finding in report.findings:
        at = codes.setdefault(
            finding.code,
            {
                "rule": finding.rule,
                "severity": finding.severity,
                "count": 0,
                "worst": finding.message,
                "time": finding.time_s,
                "excess": 0.0,
            },
        )
        at["count"] += 1
        if finding.excess > at["excess"]:
            at.update(worst=finding.message, time=finding.time_s, excess=finding.excess)
    return {
        "weight": weight,
        "height": result.character.height,
        "momentum_error": placed.error,
        "slide_mm": 1000 * contacted.slide_max_m,
        "mismatch_before": physical.mismatch_before / weight,
        "mismatch_after": physical.mismatch_after / weight,
        "pull_before": physical.pull_before / weight,
        "pull_after": physical.pull_after / weight,
        "bound": _finite(physical.bound_rms / weight),
        "displacement": float(np.abs(physical.displacement).max()),
        "ballistic_before": _finite(physical.ballistic_vertical_before),
        "ballistic_after": _finite(physical.ballistic_vertical_after),
        "status": physical.status,
        "sink": sink,
        "skate": skate,
        "codes": codes,
        "errors": report.errors,
        "warnings": report.warnings,
        "measures": {
            name: None if measure.value is None else float(measure.value)
            for name, measure in report.measures.items()
        },
    }


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def planted(
    character: Character, qpos: Array, active: NDArray[np.bool_], time: Array
) -> tuple[float, float]:
    """Deepest contact point below the floor (m), fastest slide of a planted point (m/s).

    A point is planted in a step between frames when it stands in both of them.
    """
    if not character.contacts.names:
        return 0.0, 0.0
    pose = kinematics.forward(character.tree, qpos)
    at = kinematics.points(pose, character.contacts.body, character.contacts.local)
    sink = float(np.maximum(character.floor_height - at[..., 2], 0.0).max())
    speed = np.linalg.norm(np.diff(at[..., :2], axis=0), axis=2) / np.diff(time)[:, None]
    held = active[1:] & active[:-1]
    return sink, float(speed[held].max()) if held.any() else 0.0


def _arrays_of(result: Retargeted) -> dict[str, Array]:
    placed, physical = result.placed, result.physical
    assert placed is not None
    assert physical is not None
    weight = result.character.weight
    time = result.motion.time
    part = (np.arange(STRIP) + 0.5) / STRIP
    picked = np.rint(part * (len(time) - 1)).astype(int)
    return {
        "time": time,
        "momentum_target": placed.target[:, 0],
        "momentum_achieved": placed.achieved[:, 0],
        "required_before": physical.required_before[:, 2] / weight,
        "contact_before": physical.contact_before[:, 2] / weight,
        "required_after": physical.required_after[:, 2] / weight,
        "contact_after": physical.contact_after[:, 2] / weight,
        "displacement": physical.displacement,
        "qpos": result.clip.qpos,
        "actor": result.reference.qpos,
        "strip_time": time[picked],
        "strip_qpos": result.clip.qpos[picked],
        "strip_actor": result.reference.qpos[picked],
    }
