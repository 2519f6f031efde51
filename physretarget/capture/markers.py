"""From optical markers to an actor's motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from physretarget.capture.actor import SEGMENT, ActorMotion, ActorShape
from physretarget.capture.marker_feet import on_floor, with_feet
from physretarget.capture.marker_fit import estimate_height, fit_model, resized
from physretarget.capture.marker_gaps import leaps_blanked, short_gaps_filled
from physretarget.capture.marker_model import (
    Bools,
    Floats,
    Ints,
    MarkerModel,
    first_poses,
    fit_poses,
)
from physretarget.capture.marker_worn import LIMBS, worn
from physretarget.capture.recording import MarkerRecording
from physretarget.errors import InputError
from physretarget.kinematics import continuous, slerp

_LEAST_ERROR = 0.012  # m; smaller errors are never suspicious
_ROBUST_ROUNDS = 3


@dataclass(frozen=True, kw_only=True)
class MarkerSettings:
    """How markers are fitted.

    ``longest_gap``: seconds of a gap that are interpolated; ``fit_frames``: frames that shape
    and marker seats are solved on; ``coarse``: rate (Hz) at which poses are found on their
    own, before the frames between start from them; ``outlier``: metres beyond which a marker
    is taken for a wrong one and left out of that frame; ``fewest``: labels that must be known.
    """

    longest_gap: float = 0.2
    fit_frames: int = 60
    coarse: float = 15.0
    outlier: float = 0.12
    fewest: int = 8


def fit_markers(
    recording: MarkerRecording,
    *,
    mass: float | None = None,
    settings: MarkerSettings | None = None,
) -> ActorMotion:
    """Fit an actor to a marker recording and give its motion, standing on z = 0.

    ``mass`` in kg; by default that of the reference actor, scaled by height squared. Frames
    in which trunk or a limb shows too few markers are not ``valid``; their pose is
    interpolated. Raises InputError where the labels are of no known marker set.
    """
    told = settings or MarkerSettings()
    fps = recording.source.fps
    notes = list(recording.notes)
    model, columns = worn(recording, told.fewest, notes)
    position = leaps_blanked(recording.position[:, columns], fps, notes)
    position = short_gaps_filled(position, told.longest_gap * fps, notes)
    valid = _supported(model, position)
    if not valid.any():
        raise InputError("no frame shows enough markers for a pose", path=recording.source.path)
    height = estimate_height(model, position)
    chosen = _spread(position, valid, told.fit_frames)
    expected = resized(model, height)
    model = fit_model(expected, position[chosen])
    qpos, residual = _all_poses(model, position, valid, fps, told, notes)
    qpos = _bridged(qpos, valid)
    shape, qpos = on_floor(with_feet(model, expected.local[:, 0]), qpos, valid, fps, notes)
    shape = _named(shape, recording, mass, notes)
    if not valid.all():
        notes.append(
            f"{int((~valid).sum())} of {len(valid)} frames show too few markers and are excluded"
        )
    used = residual[valid]
    return ActorMotion(
        shape=shape,
        time=recording.time,
        qpos=qpos,
        fps=fps,
        valid=valid,
        marker_error_rms=float(np.sqrt(np.nanmean(used**2))),
        source=recording.source,
        notes=tuple(notes),
    )


def _supported(model: MarkerModel, position: Floats) -> Bools:
    """(T,) frames that show three markers of the trunk and two of every marked limb."""
    seen = np.asarray(np.isfinite(position).all(axis=-1))
    valid = np.ones(len(position), dtype=bool)
    for limb, parts in LIMBS.items():
        on = np.isin(model.segment, [SEGMENT[part] for part in parts])
        if limb == "trunk" and on.sum() < 4:  # hips and shoulders as video has them
            on |= np.isin(model.segment, [SEGMENT["left_clavicle"], SEGMENT["right_clavicle"]])
        needed = 3 if limb == "trunk" else min(2, int(on.sum()))
        valid &= seen[:, on].sum(axis=1) >= needed
    return valid


def _spread(position: Floats, valid: Bools, count: int) -> Ints:
    """Frames evenly spread over the valid ones, preferring those that show most markers."""
    frames = np.flatnonzero(valid)
    shown = np.isfinite(position[frames]).all(axis=-1).sum(axis=1)
    parts = np.array_split(np.arange(len(frames)), min(count, len(frames)))
    return np.array([frames[part[np.argmax(shown[part])]] for part in parts], dtype=np.int64)


def _all_poses(
    model: MarkerModel,
    position: Floats,
    valid: Bools,
    fps: float,
    told: MarkerSettings,
    notes: list[str],
) -> tuple[Floats, Floats]:
    """Poses (T, 75) and marker errors (T, K): a coarse set first, the frames between from it."""
    frames = np.flatnonzero(valid)
    step = max(1, round(fps / told.coarse))
    coarse = np.unique(np.concatenate([frames[::step], frames[-1:]]))
    some = fit_poses(model, position[coarse], first_poses(model, position[coarse]))
    start = _interpolated(coarse, some.qpos, len(position))
    qpos = start.copy()
    found = fit_poses(model, position[frames], start[frames], prior=start[frames])
    qpos[frames] = found.qpos
    residual = np.full(position.shape[:2], np.nan)
    residual[frames] = found.residual
    usual = np.maximum(1.4826 * np.nanmedian(residual, axis=0), _LEAST_ERROR)
    doubtful = np.flatnonzero((residual > 4 * usual).any(axis=1))
    for _ in range(_ROBUST_ROUNDS if len(doubtful) else 0):
        # Geman and McClure's weights: a marker far off its usual error loses its say.
        trust = 1 / (1 + (np.nan_to_num(residual[doubtful]) / (3 * usual)) ** 2) ** 2
        better = fit_poses(
            model,
            position[doubtful],
            qpos[doubtful],
            weight=model.weight * trust,
            prior=start[doubtful],
        )
        qpos[doubtful], residual[doubtful] = better.qpos, better.residual
    wrong = residual > told.outlier
    if wrong.any():
        residual[wrong] = np.nan
        notes.append(
            f"{int(wrong.sum())} marker positions more than {100 * told.outlier:.0f} cm from the "
            f"fitted actor were taken for wrong ones, in {int(wrong.any(axis=1).sum())} frames"
        )
    return qpos, residual


def _interpolated(known: Ints, qpos: Floats, count: int) -> Floats:
    """qpos (count, 75) from poses at frames ``known``, held before the first and after the last."""
    frames = np.arange(count)
    if len(known) < 2:
        return np.repeat(qpos, count, axis=0)
    before = np.clip(np.searchsorted(known, frames, side="right") - 1, 0, len(known) - 2)
    length = known[before + 1] - known[before]
    share = np.clip((frames - known[before]) / length, 0.0, 1.0)
    first, second = qpos[before], qpos[before + 1]
    place = first[:, :3] + share[:, None] * (second[:, :3] - first[:, :3])
    turns = slerp(
        first[:, 3:].reshape(count, 18, 4),
        second[:, 3:].reshape(count, 18, 4),
        np.tile(share[:, None], 18),
    )
    return np.concatenate([place, turns.reshape(count, 72)], axis=1)


def _bridged(qpos: Floats, valid: Bools) -> Floats:
    """Poses with invalid frames interpolated and quaternions free of sign flips."""
    if not valid.all():
        known = np.flatnonzero(valid)
        between = _interpolated(known, qpos[known], len(qpos))
        qpos = np.where(valid[:, None], qpos, between)
    turns = continuous(qpos[:, 3:].reshape(len(qpos), 18, 4))
    return np.concatenate([qpos[:, :3], turns.reshape(len(qpos), 72)], axis=1)


def _named(
    shape: ActorShape, recording: MarkerRecording, mass: float | None, notes: list[str]
) -> ActorShape:
    reference = ActorShape.reference()
    kilograms = reference.mass * (shape.height / reference.height) ** 2 if mass is None else mass
    if mass is None:
        notes.append(
            f"mass not given: taken as {kilograms:.0f} kg from a height of {shape.height:.2f} m"
        )
    return ActorShape(recording.source.name, kilograms, shape.offset, shape.tip, shape.heel)
