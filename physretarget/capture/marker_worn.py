"""Which known markers a recording shows, and where the reference actor wears them."""

from __future__ import annotations

import numpy as np

from physretarget.capture.actor import PARENTS, SEGMENTS, ActorShape
from physretarget.capture.marker_model import Floats, Ints, MarkerModel
from physretarget.capture.marker_sets import (
    CLUSTER,
    KNOWN_SETS,
    SKIN,
    Landmark,
    exchanged,
    meanings,
    subjects,
)
from physretarget.capture.recording import MarkerRecording
from physretarget.errors import InputError

__all__ = ["LIMBS", "landmarks_of", "worn"]

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


def landmarks_of(recording: MarkerRecording) -> tuple[Landmark | None, ...]:
    """What each label of a recording stands for, None if unknown or of no use."""
    return _landmarks(recording, [])


def _landmarks(recording: MarkerRecording, notes: list[str]) -> tuple[Landmark | None, ...]:
    """What each label stands for, None if unknown or of no use: one subject, each label once."""
    possible = meanings(recording.labels)
    landmarks = tuple(marks[0] if marks else None for marks in possible)
    landmarks = _one_subject(recording.labels, landmarks, notes)
    landmarks = _first_of_each(recording.labels, landmarks, notes)
    landmarks = _by_distance(recording, landmarks, possible, notes)
    if _walks_backward(landmarks, recording.position):
        landmarks = exchanged(landmarks)
        notes.append("left and right were exchanged: as labelled, the toes point backward")
    return landmarks


def _by_distance(
    recording: MarkerRecording,
    landmarks: tuple[Landmark | None, ...],
    possible: tuple[tuple[Landmark, ...], ...],
    notes: list[str],
) -> tuple[Landmark | None, ...]:
    """Landmarks with labels that may mean several put where their distances to others fit.

    The others are those with one meaning, on the same segment or a neighbouring one; the body's
    size is the median of their distances against the reference actor's.
    """
    unsure = [i for i, mark in enumerate(landmarks) if mark and len(possible[i]) > 1]
    if not unsure:
        return landmarks
    some = recording.position[:: max(1, len(recording.position) // 100)]
    sure = [i for i, mark in enumerate(landmarks) if mark and i not in unsure]
    size = _size(some, [(i, mark) for i in sure if (mark := landmarks[i])])
    chosen = list(landmarks)
    for i in unsure:
        misses = [_miss(some, i, mark, sure, landmarks, size) for mark in possible[i]]
        if not np.isfinite(misses).any():
            continue
        mark = possible[i][int(np.argmin(misses))]
        if mark is not landmarks[i]:
            notes.append(f"{recording.labels[i]} is taken for the {mark.name}: it sits there")
        chosen[i] = mark
    return tuple(chosen)


def _size(some: Floats, known: list[tuple[int, Landmark]]) -> float:
    """Height over the reference actor's, by distances on one segment; 1 where none is long."""
    ratios = []
    for at, (i, first) in enumerate(known):
        for j, second in known[:at]:
            usual = float(np.linalg.norm(first.local - second.local))
            if first.segment == second.segment and usual > 0.12:
                ratios.append(_distance(some, i, j) / usual)
    good = [ratio for ratio in ratios if np.isfinite(ratio)]
    return float(np.median(good)) if good else 1.0


def _miss(
    some: Floats,
    label: int,
    mark: Landmark,
    sure: list[int],
    landmarks: tuple[Landmark | None, ...],
    size: float,
) -> float:
    """m by which a label's distances to markers on and next to a segment are off, if it sits there.

    Across a joint the two markers' distances from that joint bound how far apart they can be.
    """
    offset = ActorShape.reference().offset
    off = []
    for j in sure:
        other = landmarks[j]
        if other is None:
            continue
        if other.segment == mark.segment:
            low = high = float(np.linalg.norm(mark.local - other.local))
        elif PARENTS[other.segment] == mark.segment or PARENTS[mark.segment] == other.segment:
            child, parent = (
                (other, mark) if PARENTS[other.segment] == mark.segment else (mark, other)
            )
            near = float(np.linalg.norm(child.local))
            far = float(np.linalg.norm(parent.local - offset[child.segment]))
            low, high = abs(far - near), far + near
        else:
            continue
        found = _distance(some, label, j)
        off.append(max(low * size - found, found - high * size, 0.0))
    return float(np.nanmean(off)) if off else float("inf")


def _distance(some: Floats, i: int, j: int) -> float:
    """m between two markers in the frames that show both, the median; NaN where none does."""
    apart = np.linalg.norm(some[:, i] - some[:, j], axis=1)
    apart = apart[np.isfinite(apart)]
    return float(np.median(apart)) if len(apart) else float("nan")


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
