"""From optical markers to an actor's motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from physretarget.capture.actor import (
    SEGMENT,
    SEGMENTS,
    ActorMotion,
    ActorShape,
)
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
from physretarget.capture.marker_sets import (
    CLUSTER,
    KNOWN_SETS,
    SKIN,
    Landmark,
    exchanged,
    recognise,
    subjects,
)
from physretarget.capture.recording import MarkerRecording
from physretarget.errors import InputError
from physretarget.kinematics import continuous, slerp

_LEAST_ERROR = 0.012  # m; smaller errors are never suspicious
_ROBUST_ROUNDS = 3
_LIMBS = {
    "trunk": ("pelvis", "chest"),
    **{
        f"{side} {limb}": tuple(f"{side}_{part}" for part in parts)
        for side in ("left", "right")
        for limb, parts in (
            ("arm", ("upper_arm", "forearm", "hand")),
            ("leg", ("thigh", "shank", "foot")),
        )
    },
}

_MARKED = {"chest": ("chest", "left_clavicle", "right_clavicle"), "head": ("head",), **_LIMBS}


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
    model, columns = _worn(recording, told, notes)
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


def _worn(
    recording: MarkerRecording, told: MarkerSettings, notes: list[str]
) -> tuple[MarkerModel, Ints]:
    """The reference actor with the recording's known markers, and their columns."""
    landmarks = _one_subject(recording.labels, recognise(recording.labels), notes)
    landmarks = _first_of_each(recording.labels, landmarks, notes)
    if _walks_backward(landmarks, recording.position):
        landmarks = exchanged(landmarks)
        notes.append("left and right were exchanged: as labelled, the toes point backward")
    seen = np.isfinite(recording.position).all(axis=-1).mean(axis=0) > 0.02
    columns = np.array(
        [i for i, mark in enumerate(landmarks) if mark is not None and seen[i]], dtype=np.int64
    )
    marked = {recording.labels[i] for i, mark in enumerate(landmarks) if mark}
    unknown = [label for label in recording.labels if label not in marked]
    known = [mark for i in columns if (mark := landmarks[i]) is not None]
    on = [SEGMENTS[mark.segment] for mark in known]
    if len(known) < told.fewest or not _trunk_marked(on):
        listed = ", ".join(unknown[:40]) + (" …" if len(unknown) > 40 else "")
        raise InputError(
            f"only {len(known)} labels are known ({on.count('pelvis')} on the pelvis, "
            f"{on.count('chest')} on the chest; three on one of them, or both hips and both "
            f"shoulders, and {told.fewest} in all are needed); unknown: {listed or 'none'}; "
            f"known sets: {KNOWN_SETS}",
            path=recording.source.path,
        )
    if unknown:
        listed = ", ".join(unknown[:20]) + (" …" if len(unknown) > 20 else "")
        notes.append(f"{len(unknown)} labels are not known and were left out: {listed}")
    bare = [limb for limb, parts in _MARKED.items() if not set(parts) & set(on)]
    if bare:
        notes.append(f"no markers on {', '.join(bare)}: held at rest")
    spread = np.array([mark.spread for mark in known])
    weight = np.where(spread >= CLUSTER, 0.5, np.where(spread >= SKIN, 0.7, 1.0))
    model = MarkerModel(
        shape=ActorShape.reference(),
        segment=np.array([mark.segment for mark in known], dtype=np.int64),
        local=np.array([mark.local for mark in known]),
        spread=spread,
        weight=weight,
    )
    return model, columns


def _walks_backward(landmarks: tuple[Landmark | None, ...], position: Floats) -> bool:
    """Whether toes point away from where the hips face: left and right are mislabelled."""
    some = position[:: max(1, len(position) // 300)]

    def mean(chosen: list[int]) -> Floats:
        seen = np.asarray(np.isfinite(some[:, chosen]).all(axis=-1))
        total = np.where(seen[..., None], some[:, chosen], 0.0).sum(axis=1)
        count = seen.sum(axis=1)
        middle: Floats = total / np.where(count > 0, count, np.nan)[:, None]
        return middle

    def on(segment: str, name: str, low: float, high: float) -> list[int]:
        return [
            i
            for i, mark in enumerate(landmarks)
            if mark is not None
            and SEGMENTS[mark.segment].endswith(segment)
            and mark.name.startswith(name)
            and low < mark.local[0] < high
        ]

    sides = [on("pelvis", side, -1, 1) or on("thigh", side, -1, 1) for side in ("left", "right")]
    feet = [
        (on("foot", side, 0.05, 1), on("foot", side, -1, 0) or on("shank", side, -1, 1))
        for side in ("left", "right")
    ]
    feet = [(toe, heel) for toe, heel in feet if toe and heel]
    trunk = [on(segment, "", -1, 1) for segment in ("chest", "pelvis", "shank")]
    trunk = [markers for markers in trunk if markers]
    if not all(sides) or not feet or len(trunk) < 2:
        return False
    ahead = np.cross(mean(sides[0]) - mean(sides[1]), mean(trunk[0]) - mean(trunk[1]))
    shares = []
    for toe, heel in feet:
        foot = mean(toe) - mean(heel)
        size = np.linalg.norm(foot, axis=1) * np.linalg.norm(ahead, axis=1)
        cosine = np.sum(foot * ahead, axis=1) / np.where(size > 1e-9, size, np.nan)
        if np.isfinite(cosine).any():
            shares.append(float(np.nanmedian(cosine)))
    return bool(shares) and max(shares) < -0.5


def _trunk_marked(on: list[str]) -> bool:
    """Whether segments ``on`` which markers sit say how the trunk is turned."""
    girdle = {"left_clavicle", "right_clavicle"} <= set(on)
    return max(on.count("pelvis"), on.count("chest")) >= 3 or (girdle and on.count("pelvis") >= 2)


def _one_subject(
    labels: tuple[str, ...], landmarks: tuple[Landmark | None, ...], notes: list[str]
) -> tuple[Landmark | None, ...]:
    """The landmarks of one subject alone, that with the most known labels (the first of equals).

    Several people in one file are told apart by the prefix of their labels (``anna:LFHD``).
    """
    prefixes = subjects(labels)
    known = [p for p, mark in zip(prefixes, landmarks, strict=True) if mark is not None]
    names = [mark.name for mark in landmarks if mark is not None]
    people = sorted(set(known), key=lambda p: (-known.count(p), prefixes.index(p)))
    if len(people) < 2 or len(set(names)) == len(names):
        return landmarks
    notes.append(
        f"{len(people)} subjects are in the file: {people[0] or 'the one without a name'} was "
        f"taken, {', '.join(s or 'one without a name' for s in people[1:])} left out"
    )
    return tuple(
        mark if prefix == people[0] else None
        for prefix, mark in zip(prefixes, landmarks, strict=True)
    )


def _first_of_each(
    labels: tuple[str, ...], landmarks: tuple[Landmark | None, ...], notes: list[str]
) -> tuple[Landmark | None, ...]:
    """The landmarks without those of a label that stood before: a second body, or a remnant."""
    again = {i for i, label in enumerate(labels) if landmarks[i] and label in labels[:i]}
    if again:
        notes.append(f"{len(again)} labels stand in the file again: the first of each was taken")
    return tuple(None if i in again else mark for i, mark in enumerate(landmarks))


def _supported(model: MarkerModel, position: Floats) -> Bools:
    """(T,) frames that show three markers of the trunk and two of every marked limb."""
    seen = np.asarray(np.isfinite(position).all(axis=-1))
    valid = np.ones(len(position), dtype=bool)
    for limb, parts in _LIMBS.items():
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
