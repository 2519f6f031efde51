"""From a retargeting to its page: picks what the page shows, computes no physics of its own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from physretarget.clip import npz_bytes, write_file
from physretarget.mapping import SharedGPLVM
from physretarget.mapping.latent import latent_map
from physretarget.pipeline import Retargeted
from physretarget.replay.clip import report_forces
from physretarget.report.json import render_json
from physretarget.report.retarget_data import (
    ForceCurves,
    LatentMap,
    MomentumCurves,
    RetargetReport,
    StageMotion,
)
from physretarget.report.retarget_html import render_retarget_html
from physretarget.report.retarget_numbers import key_numbers
from physretarget.trained import TrainedMapper
from physretarget.validation import Report, validate

Array = NDArray[np.float64]

_STAGE_NOTES = {
    "mapped": "poses from the key poses, on the spot",
    "placed": "travel and turn from the actor's momentum",
    "contacted": "feet planted where the actor's are",
    "physical": "height of the root made to obey gravity and contact",
    "balanced": "the whole body moved to where the floor can bear it",
    "simulated": "played forward by MuJoCo, by torques of the joints",
}


def write_retarget_report(
    result: Retargeted, mapper: TrainedMapper, report: Report, folder: str | Path
) -> Path:
    """Write ``report.html``, ``report.json``, ``stages.npz`` and the clip into a folder.

    Args:
        result: What ``retarget`` gave.
        mapper: The mapper that was used.
        report: The verdict on its clip.
        folder: The folder, made if it is not there.

    Returns:
        The page.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    stages: dict[str, NDArray[np.generic]] = {
        f"qpos_{name}": qpos for name, qpos in result.stages().items()
    }
    stages |= {"time": result.motion.time, "actor_qpos": result.motion.qpos}
    write_file(folder / "stages.npz", npz_bytes(stages))
    result.clip.save(folder / "clip.npz")
    write_file(folder / "report.json", render_json(report).encode())
    page = folder / "report.html"
    data = retarget_data(result, mapper, report)
    write_file(page, render_retarget_html(data, painted=True).encode())
    return page


def retarget_data(result: Retargeted, mapper: TrainedMapper, report: Report) -> RetargetReport:
    """Everything that the page of one retargeting shows."""
    source = result.motion.source
    contacted = result.contacted
    return RetargetReport(
        title=f"{Path(source.name).stem} → {result.character.name}",
        capture=source.name,
        time=result.motion.time,
        actor=result.actor,
        actor_qpos=result.motion.qpos,
        character=result.character,
        character_name=result.character.name,
        stages=tuple(
            StageMotion(
                label=name,
                qpos=qpos,
                note=_STAGE_NOTES[name],
                acting=acting,
                errors=_errors(result, report, qpos),
            )
            for (name, qpos), acting in zip(result.stages().items(), result.acting, strict=True)
        ),
        contact_active=contacted.active if contacted else None,
        actor_contact_active=_actor_contacts(result),
        forces=report_forces(report, result.clip.frames),
        momentum=_momentum(result),
        force=_forces(result),
        latent=_latent(result, mapper),
        pose_variance=_standard_deviation(result),
        numbers=key_numbers(result),
        report=report,
        notes=result.notes,
        sections=_sections(result, mapper),
    )


def _errors(result: Retargeted, report: Report, qpos: Array) -> int:
    """Of a stage's clip, by the validator that judged the last one."""
    if np.array_equal(qpos, result.clip.qpos):
        return report.errors
    return validate(replace(result.clip, qpos=qpos), result.character).errors


def _actor_contacts(result: Retargeted) -> NDArray[np.bool_] | None:
    if result.phases is None:
        return None
    return np.stack([result.phases.of(name) for name in result.actor.tied], axis=1)


def _momentum(result: Retargeted) -> tuple[MomentumCurves, ...]:
    placed = result.placed
    if placed is None:
        return ()
    return (
        MomentumCurves(axis="forward", target=placed.target[:, 0], achieved=placed.achieved[:, 0]),
        MomentumCurves(
            axis="about the vertical",
            target=placed.target_angular[:, 2],
            achieved=placed.achieved_angular[:, 2],
            unit="kg m²/s",
        ),
    )


def _forces(result: Retargeted) -> ForceCurves | None:
    physical, weight = result.physical, result.character.weight
    if physical is None:
        return None
    return ForceCurves(
        required_before=physical.required_before[:, 2] / weight,
        contact_before=physical.contact_before[:, 2] / weight,
        required_after=physical.required_after[:, 2] / weight,
        contact_after=physical.contact_after[:, 2] / weight,
        displacement=physical.displacement,
    )


def _latent(result: Retargeted, mapper: TrainedMapper) -> tuple[LatentMap, ...]:
    model, latent = mapper.mapper, result.mapped.latent
    if not isinstance(model, SharedGPLVM) or latent is None:
        return ()
    found = latent_map(model, latent)
    return (
        LatentMap(
            label=f"{model.latent.shape[1]} latent dimensions",
            trajectory=found.trajectory,
            key_poses=found.keys,
            own=np.array([s == result.motion.source.name for s in mapper.sources]),
            names=mapper.names,
            variance=found.variance,
            extent=(
                float(found.grid_x[0]),
                float(found.grid_x[-1]),
                float(found.grid_y[0]),
                float(found.grid_y[-1]),
            ),
        ),
    )


def _standard_deviation(result: Retargeted) -> Array | None:
    """Of each coordinate of the mapped features (T,), m; None where the mapper knows none."""
    variance = result.mapped.variance
    return None if np.isnan(variance).all() else np.sqrt(variance)


def _sections(result: Retargeted, mapper: TrainedMapper) -> dict[str, dict[str, object]]:
    meta = result.clip.meta
    return {
        "Inputs": {
            "capture": result.motion.source.name,
            "capture sha256": result.motion.source.sha256,
            "capture format": result.motion.source.format,
            "character": result.character.name,
            "character sha256": result.character.sha256,
            "key poses": len(mapper.names),
        },
        "Parameters": {
            **meta["settings"],
            "mapper": mapper.mapper.name,
            "version": meta["tool"]["version"],
        },
    }
