"""An actor fitted to a skeleton's joints: bone lengths, floor, and the pose of every frame."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from physretarget.capture.actor import (
    PARENTS,
    SEGMENT,
    SEGMENTS,
    ActorMotion,
    ActorShape,
)
from physretarget.capture.calibration import Calibrated, calibrate, hinge
from physretarget.capture.gaps import repair
from physretarget.capture.measure import Measured, measure, unit
from physretarget.capture.recording import Floats, JointRecording
from physretarget.errors import InputError
from physretarget.kinematics import continuous, forward, matrix_to_quat

Bools = NDArray[np.bool_]

_LEG_SHARE = 0.245 + 0.246  # thigh + shank over stature (Winter 2009, fig. 4.1)
_STATURE = (0.5, 3.0)  # m: from a small child to a stylised giant
# Heights of joint centres over the floor while the foot stands, in shares of stature; outside
# these the file's floor or its foot is not what it seems.
_TOE_HEIGHT = (-0.012, 0.035)
_TOE_TYPICAL = 0.014
_ANKLE_HEIGHT = (0.02, 0.085)
_STOOD = 0.3  # s: feet that stand for less say little about the floor
_FLOOR = 0.01  # m: a floor this near to z = 0 is left where it is


def fit_joints(recording: JointRecording, *, mass: float | None = None) -> ActorMotion:
    """Fit the actor to a joint recording.

    Bone lengths are the medians of the measured ones, joint rotations those of the file's joints
    after one constant calibration per segment, and the floor is brought to z = 0. ``mass`` in kg;
    by default that of the reference actor, scaled by stature squared. Raises InputError if hips
    or legs are not recognised.
    """
    path = recording.source.path
    recording, notes = _without_rest_frame(recording)
    measured, valid, gap_notes = repair(measure(recording), path)
    notes = [*recording.notes, *notes, *gap_notes]
    calibrated = calibrate(measured)
    if _mirrored(measured, calibrated):
        measured, valid, _ = repair(measure(recording, swapped=True), path)
        calibrated = calibrate(measured)
        notes.append("left and right were exchanged: as labelled, knees and toes point backward")
    notes += [*measured.notes, *calibrated.notes]
    size = _stature(measured, path, recording.source.unit)
    floor, floor_note = _floor(measured, calibrated, size)
    notes += floor_note
    if mass is None:
        mass = _mass(size)
        notes.append(f"mass not given: taken as {mass:.0f} kg from a stature of {size:.2f} m")
    turn = _all_turns(calibrated)
    shape = _shape(measured, calibrated, turn, size, floor, mass, recording.source.name)
    root = measured.centre["pelvis"] - np.array([0.0, 0.0, floor])
    qpos = _pose(turn, root)
    return ActorMotion(
        shape=shape,
        time=recording.time,
        qpos=qpos,
        fps=recording.source.fps,
        valid=valid,
        marker_error_rms=_error(shape, qpos, measured, valid, floor),
        source=recording.source,
        notes=tuple(notes),
    )


def _without_rest_frame(recording: JointRecording) -> tuple[JointRecording, list[str]]:
    """Blank a first frame that holds the rest pose and is no part of the motion.

    Some exporters put it there; it is known by all joint rotations being equal and by a leap to
    the second frame: of most joints by more than 0.2 m, or of one by more than four times what
    any moves in the tenth of a second after.
    """
    if len(recording.time) < 3:
        return recording, []
    first = recording.rotation[0]
    after = max(2, 1 + round(0.1 * recording.source.fps))
    steps = np.linalg.norm(np.diff(recording.position[: after + 1], axis=0), axis=2)
    usual = float(np.nanmax(steps[1:], initial=0.0))
    leaps = np.median(steps[0]) > 0.2 or steps[0].max() > max(0.05, 4 * usual)
    if not (leaps and np.abs(first - first[0]).max() < 1e-6):
        return recording, []
    position = recording.position.copy()
    position[0] = np.nan
    note = "the first frame is the skeleton's rest pose, far from the second: not used"
    return replace(recording, position=position), [note]


def _mass(stature: float) -> float:
    """The reference actor's mass at another stature, by the body mass index."""
    reference = ActorShape.reference()
    return reference.mass * (stature / reference.height) ** 2


def _mirrored(measured: Measured, calibrated: Calibrated) -> bool:
    """Whether knees bend forward and toes point backward: left and right are mislabelled."""
    pelvis = calibrated.turn["pelvis"]
    knees, bent, toes = 0.0, 0.0, 0.0
    for side in ("left", "right"):
        leg = (f"{side}_thigh", f"{side}_shank", f"{side}_foot")
        angle, axis = hinge(measured, leg)
        weight = np.where(angle > np.radians(15), np.sin(angle), 0.0)
        knees += float(weight @ np.sum(axis * pelvis[:, :, 1], axis=1))
        bent += float(weight.sum())
        if leg[2] in measured.end:
            way = unit(measured.end[leg[2]] - measured.centre[leg[2]])
            shank = calibrated.turn[leg[1]]
            ahead = np.cross(pelvis[:, :, 1], shank[:, :, 2])
            toes += float(np.mean(np.sum(way * ahead, axis=1)))
    backward_toes = toes < -0.4
    return bool(backward_toes and (bent < 1.0 or knees < -0.3 * bent))


def _stature(measured: Measured, path: str, unit_name: str) -> float:
    """Body height (m) from the legs; InputError if no human's."""
    bones = []
    for side in ("left", "right"):
        chain = [measured.centre[f"{side}_{part}"] for part in ("thigh", "shank", "foot")]
        bones.append(sum(_distance(a, b) for a, b in pairwise(chain)))
    size = float(np.mean(bones)) / _LEG_SHARE
    if not _STATURE[0] <= size <= _STATURE[1]:
        raise InputError(
            f"Thigh and shank measure {np.mean(bones):.3g} m with the unit {unit_name}, "
            "which is no human's leg: tell the right unit.",
            path=path,
        )
    return size


def _distance(a: Floats, b: Floats) -> float:
    return float(np.median(np.linalg.norm(a - b, axis=1)))


# ------------------------------------------------------------------------------------ floor


def _standing_height(measured: Measured, stance: dict[str, Bools], which: str) -> float:
    """Height (m, file's floor) of ankles or toes while their foot stands; lower side counts."""
    heights = []
    for side in ("left", "right"):
        ankle = measured.centre[f"{side}_foot"]
        point = measured.end.get(f"{side}_foot", ankle) if which == "toe" else ankle
        standing = stance[side]
        if standing.any():
            heights.append(float(np.median(point[standing, 2])))
        else:
            heights.append(float(np.quantile(point[:, 2], 0.02)))
    return min(heights)


def _floor(
    measured: Measured, calibrated: Calibrated, size: float
) -> tuple[float, tuple[str, ...]]:
    """The floor's height in the file's world (m), and a sentence if it is not zero."""
    ankle = _standing_height(measured, calibrated.stance, "ankle")
    plausible = _ANKLE_HEIGHT[0] * size <= ankle <= _ANKLE_HEIGHT[1] * size
    stood = sum(np.count_nonzero(frames) for frames in calibrated.stance.values()) / measured.fps
    if stood < _STOOD and 0.0 <= ankle <= 0.1 * size:
        return 0.0, ("no foot stands long enough to check the floor: the file's is taken",)
    has_toes = all(f"{side}_foot" in measured.end for side in ("left", "right"))
    if has_toes:
        low = _standing_height(measured, calibrated.stance, "toe")
        if _TOE_HEIGHT[0] * size <= low <= _TOE_HEIGHT[1] * size:
            return 0.0, ()
        floor = low - _TOE_TYPICAL * size
    else:
        if plausible:
            return 0.0, ()
        floor = ankle - 0.039 * size
    if abs(floor) <= _FLOOR:
        return 0.0, ()
    return floor, (f"the floor was found at {floor:.3f} m and shifted to zero",)


# ------------------------------------------------------------------------------------ shape


def _all_turns(calibrated: Calibrated) -> Floats:
    """World rotations (T, 18, 3, 3); segments that the file doesn't move stay with the parent."""
    pelvis = calibrated.turn["pelvis"]
    turns = np.empty((len(pelvis), len(SEGMENTS), 3, 3))
    for i, (segment, parent) in enumerate(zip(SEGMENTS, PARENTS, strict=True)):
        moved = calibrated.turn.get(segment)
        turns[:, i] = moved if moved is not None else turns[:, parent]
    return turns


def _in(turn: Floats, vector: Floats) -> Floats:
    """Median of world vectors (T, 3) in the frames ``turn`` (T, 3, 3)."""
    return np.asarray(np.median(np.einsum("tji,tj->ti", turn, vector), axis=0))


def _shape(
    measured: Measured,
    calibrated: Calibrated,
    turn: Floats,
    size: float,
    floor: float,
    mass: float,
    name: str,
) -> ActorShape:
    """Bone offsets from the file; what it doesn't have from the reference at the same stature."""
    reference = ActorShape.reference(size, mass)
    offset, tip = reference.offset.copy(), reference.tip.copy()
    builder = _Offsets(measured, turn, offset)
    builder.trunk()
    for side in ("left", "right"):
        builder.limb(side, ("thigh", "shank", "foot"), "pelvis")
        builder.limb(side, ("clavicle", "upper_arm", "forearm", "hand"), "chest")
        builder.end(f"{side}_hand", tip)
    builder.end("head", tip)
    heel = reference.heel.copy()
    for i, side in enumerate(("left", "right")):
        _sole(measured, calibrated, turn, side, floor, size, tip, heel[i])
    return ActorShape.standing(name, mass, offset, tip, heel)


@dataclass(frozen=True, eq=False)
class _Offsets:
    """Fills joint offsets (18, 3) and tips in place from the measured centres."""

    measured: Measured
    turn: Floats
    offset: Floats

    def trunk(self) -> None:
        """Abdomen, chest and head; a joint that the file lacks stays on the way of the others."""
        centre, known = self.measured.centre, "pelvis"
        pending: list[str] = []
        for segment in ("abdomen", "chest", "head"):
            if segment not in centre:
                pending.append(segment)
                continue
            # Segments without a joint of their own move with ``known``: one rigid piece.
            way = _in(self.turn[:, SEGMENT[known]], centre[segment] - centre[known])
            pieces = [*pending, segment]
            shares = np.array([self.offset[SEGMENT[s], 2] for s in pieces])
            for piece, share in zip(pieces, shares / shares.sum(), strict=True):
                self.offset[SEGMENT[piece]] = share * way
            pending, known = [], segment

    def limb(self, side: str, parts: tuple[str, ...], root: str) -> None:
        """One arm or leg, from the trunk outward; a missing clavicle keeps the reference's."""
        centre = self.measured.centre
        carrier = next(
            (
                s
                for s in ((root, "abdomen", "pelvis") if root == "chest" else (root,))
                if s in centre
            ),
            "pelvis",
        )
        known, passed = carrier, self._between(carrier, root)
        for part in parts:
            segment = f"{side}_{part}"
            if segment not in centre:
                if part != "clavicle":
                    return
                passed = passed + self.offset[SEGMENT[segment]]
                continue
            parent = PARENTS[SEGMENT[segment]]
            way = _in(self.turn[:, parent], centre[segment] - centre[known])
            self.offset[SEGMENT[segment]] = way - passed
            known, passed = segment, np.zeros(3)

    def _between(self, carrier: str, root: str) -> Floats:
        """From the carrier's joint to the root segment's, which moves rigidly with it."""
        total, segment = np.zeros(3), SEGMENT[root]
        while SEGMENTS[segment] != carrier:
            total = total + self.offset[segment]
            segment = PARENTS[segment]
        return total

    def end(self, segment: str, tip: Floats) -> None:
        """The tip of a head or hand where the file marks it plausibly."""
        if segment in self.measured.end and segment in self.measured.centre:
            way = self.measured.end[segment] - self.measured.centre[segment]
            local = _in(self.turn[:, SEGMENT[segment]], way)
            usual = float(np.linalg.norm(tip[SEGMENT[segment]]))
            if 0.35 * usual <= np.linalg.norm(local) <= 1.5 * usual:
                tip[SEGMENT[segment]] = local


def _sole(
    measured: Measured,
    calibrated: Calibrated,
    turn: Floats,
    side: str,
    floor: float,
    size: float,
    tip: Floats,
    heel: Floats,
) -> None:
    """Ball of the toes and heel on the sole, in place; the sole touches the floor in stance."""
    foot = f"{side}_foot"
    ankle = measured.centre[foot][:, 2] - floor
    standing = calibrated.stance[side]
    height = float(np.median(ankle[standing])) if standing.any() else float(ankle.min())
    low, high = _ANKLE_HEIGHT
    if low * size <= height <= high * size:
        tip[SEGMENT[foot], 2] = heel[2] = -height
    if foot not in measured.end:
        return
    way = _in(turn[:, SEGMENT[foot]], measured.end[foot] - measured.centre[foot])
    if 0.04 * size <= way[0] <= 0.15 * size:
        heel[0] *= way[0] / tip[SEGMENT[foot], 0]
        tip[SEGMENT[foot], :2] = way[:2]


# ------------------------------------------------------------------------------------- pose


_CHUNK = 4096  # frames at a time, so that a long capture needs little beside its own numbers


def _pose(turn: Floats, root: Floats) -> Floats:
    """qpos (T, 75) from world rotations (T, 18, 3, 3) and the pelvis' path (T, 3)."""
    quats = np.empty((len(root), len(SEGMENTS), 4))
    for start in range(0, len(root), _CHUNK):
        world = turn[start : start + _CHUNK]
        local = world.copy()
        for i, parent in enumerate(PARENTS):
            if parent >= 0:
                local[:, i] = np.swapaxes(world[:, parent], 1, 2) @ world[:, i]
        quats[start : start + _CHUNK] = matrix_to_quat(local)
    return np.concatenate([root, continuous(quats).reshape(len(root), -1)], axis=1)


def _error(
    shape: ActorShape, qpos: Floats, measured: Measured, valid: Bools, floor: float
) -> float:
    """RMS distance (m) of the actor's joint centres from the file's, over valid frames."""
    total, count = 0.0, 0
    for start in range(0, len(qpos), _CHUNK):
        part = slice(start, start + _CHUNK)
        good = valid[part]
        position = forward(shape.tree(), qpos[part][good]).position
        for segment, centre in measured.centre.items():
            there = centre[part][good] - np.array([0.0, 0.0, floor])
            total += float(np.sum((position[:, SEGMENT[segment] + 1] - there) ** 2))
            count += len(there)
    return float(np.sqrt(total / count)) if count else float("nan")
