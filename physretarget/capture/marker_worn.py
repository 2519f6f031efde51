"""Which known markers a recording shows, and where the reference actor wears them."""

from __future__ import annotations

import numpy as np

from physretarget.capture.actor import SEGMENTS, ActorShape
from physretarget.capture.marker_model import Floats, Ints, MarkerModel
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

__all__ = ["LIMBS", "worn"]

LIMBS = {
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
"""Parts of the actor that markers must show, and their segments."""
_MARKED = {"chest": ("chest", "left_clavicle", "right_clavicle"), "head": ("head",), **LIMBS}


def worn(recording: MarkerRecording, fewest: int, notes: list[str]) -> tuple[MarkerModel, Ints]:
    """The reference actor with the recording's known markers, and their columns.

    Raises:
        InputError: fewer than ``fewest`` labels are known, or none tell how the trunk is turned.
    """
    landmarks = _landmarks(recording, notes)
    seen = np.isfinite(recording.position).all(axis=-1).mean(axis=0) > 0.02
    columns = np.array(
        [i for i, mark in enumerate(landmarks) if mark is not None and seen[i]], dtype=np.int64
    )
    marked = {recording.labels[i] for i, mark in enumerate(landmarks) if mark}
    unknown = [label for label in recording.labels if label not in marked]
    known = [mark for i in columns if (mark := landmarks[i]) is not None]
    on = [SEGMENTS[mark.segment] for mark in known]
    if len(known) < fewest or not _trunk_marked(on):
        listed = ", ".join(unknown[:40]) + (" …" if len(unknown) > 40 else "")
        raise InputError(
            f"only {len(known)} labels are known ({on.count('pelvis')} on the pelvis, "
            f"{on.count('chest')} on the chest; three on one of them, or both hips and both "
            f"shoulders, and {fewest} in all are needed); unknown: {listed or 'none'}; "
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


def _landmarks(recording: MarkerRecording, notes: list[str]) -> tuple[Landmark | None, ...]:
    """What each label stands for, None if unknown or of no use: one subject, each label once."""
    landmarks = _one_subject(recording.labels, recognise(recording.labels), notes)
    landmarks = _first_of_each(recording.labels, landmarks, notes)
    if _walks_backward(landmarks, recording.position):
        landmarks = exchanged(landmarks)
        notes.append("left and right were exchanged: as labelled, the toes point backward")
    return landmarks


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
