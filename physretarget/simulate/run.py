"""From a clip to its simulation."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget._version import __version__
from physretarget.clip import Clip
from physretarget.mapping.threads import one_thread
from physretarget.mjcf import Character
from physretarget.simulate.body import build_body
from physretarget.simulate.reference import Reference, build_reference
from physretarget.simulate.settings import SimulationSettings
from physretarget.simulate.simulation import Simulation, SimulationMeasures, options_text
from physretarget.simulate.track import Track, marker_errors, track

__all__ = ["simulate"]

Array = NDArray[np.float64]


@one_thread
def simulate(
    clip: Clip,
    character: Character,
    settings: SimulationSettings | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> Simulation:
    """Play a clip forward in MuJoCo, with contacts, by torques alone (or with assist).

    Args:
        clip: the motion; its root must be free.
        character: the model, with or without a floor.
        settings: see :class:`SimulationSettings`.
        progress: told the seconds survived and the seconds of the clip.

    Returns:
        The simulation as far as it came, with what reproduces it. Ctrl-C ends it early.

    Raises:
        UsageError: the character's root is not free.
        InputError: the clip is too short, or not this character's.
    """
    started = time.process_time()
    settings = settings or SimulationSettings()
    body = build_body(character, settings)
    reference = build_reference(clip, body, settings)
    played = track(reference, progress)
    return _simulation(clip, reference, played, time.process_time() - started)


def _simulation(clip: Clip, reference: Reference, played: Track, cpu: float) -> Simulation:
    body, settings, model = reference.body, reference.settings, reference.body.model
    pieces, nv = played.pieces, model.nv
    qpos = np.concatenate([reference.qpos[:1], *(piece.qpos for piece in pieces)])
    torque = np.concatenate([np.zeros((0, len(body.controls))), *(p.torque for p in pieces)])
    applied = np.zeros((len(qpos) - 1, nv))
    applied[:, body.controls] = np.repeat(torque, settings.steps_per_knot, axis=0)
    gains = [piece.gain for piece in pieces]
    limit = np.full(nv, np.inf)
    limit[body.controls] = body.high
    steps = settings.timestep * np.arange(len(qpos))
    errors = marker_errors(reference, qpos[1:], 0)
    notes = list(body.notes)
    if reference.lift:
        notes.append(f"the clip was raised by {reference.lift * 1e3:.0f} mm: so deep it stood")
    return Simulation(
        clip=replace(
            _empty(clip, character=body.character),
            qpos=qpos,
            time=clip.time[0] + steps,
            meta={**clip.meta, "simulation": _parameters(settings), "version": __version__},
            notes=tuple(notes),
        ),
        timestep=settings.timestep,
        qvel0=_first_speed(reference, played),
        qfrc_applied=applied,
        gain=np.concatenate([np.zeros((0, len(body.controls), 2 * nv), np.float32), *gains]),
        gain_time=np.asarray(settings.knot * np.arange(len(torque)), np.float64),
        controls=body.controls,
        torque_limit=limit,
        options=options_text(model),
        model_xml=body.xml,
        errors=np.concatenate([[0.0], errors]) * body.character.height,
        ending=played.ending,
        lift_m=reference.lift,
        measures=_measures(reference, qpos, torque, errors),
        notes=tuple(notes),
        cpu_s=cpu,
    )


def _first_speed(reference: Reference, played: Track) -> Array:
    """What it began with: the clip's, or within the doubt about that."""
    if not played.pieces:
        return np.asarray(reference.qvel[0])
    model = reference.body.model
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, played.pieces[0].before, mujoco.mjtState.mjSTATE_INTEGRATION)
    return np.asarray(data.qvel.copy(), np.float64)


def _parameters(settings: SimulationSettings) -> dict[str, object]:
    return {name: value for name, value in asdict(settings).items() if value is not None}


def _empty(clip: Clip, *, character: Character) -> Clip:
    """The clip without what belongs to its own frames."""
    return replace(
        clip,
        joint_names=character.joint_names,
        model_name=character.name,
        model_sha256=character.sha256,
        contact_points=(),
        contact_active=None,
        path=None,
        sha256=None,
        format="physretarget",
    )


def _measures(
    reference: Reference, qpos: Array, torque: Array, errors: Array
) -> SimulationMeasures:
    body, settings = reference.body, reference.settings
    character = body.character
    height, weight = character.height, character.weight
    root = int((~np.isfinite(body.high)).sum())
    assist, joints = torque[:, :root], torque[:, root:]
    share = float(np.sqrt(np.mean(errors**2))) if len(errors) else 0.0
    at_limit = (joints <= body.low[root:]) | (joints >= body.high[root:])
    excess = np.maximum(qpos - character.upper, character.lower - qpos)
    return SimulationMeasures(
        duration_s=reference.knots * settings.knot,
        survived_s=len(torque) * settings.knot,
        tracking_rms_m=share * height,
        tracking_share=share,
        assist_force_rms_bw=_rms(assist[:, :3]) / weight,
        assist_moment_rms_bwh=_rms(assist[:, 3:]) / (weight * character.com_height),
        torque_saturated_fraction=float(at_limit.mean()) if at_limit.size else 0.0,
        joint_limit_excess_max_rad=max(0.0, float(excess.max())),
    )


def _rms(vectors: Array) -> float:
    """Root-mean-square length of vectors (T, 3), 0 for none."""
    return float(np.sqrt((vectors**2).sum(axis=1).mean())) if vectors.size else 0.0
