"""From the rotations of a file's joints to those of the actor's segments.

Rest poses are not to be trusted: some skeletons rest with every bone along one axis. What can
be trusted is where the joints are. So per segment one constant rotation ``A`` is found with
``R_segment(t) = R_joint(t) @ A`` (columns of A: the segment's forward, left and up in the file's
joint frame):

* limbs: the long axis from joint to joint, exactly; the twist from the hinge of knee or elbow
  where it bends, else such that the mean twist against the parent is zero;
* trunk: left from the hip joints or the shoulders, up from the rest pose if that is a standing
  human, else from the links of the spine;
* head: faces where the chest faces, on average, along an axis of its own joint frame;
* feet: level while they stand (:mod:`physretarget.capture.feet`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget.capture.directions import frame, in_frames, mean_direction, mean_rotation, swing
from physretarget.capture.feet import foot_axes, stands
from physretarget.capture.measure import Measured, unit
from physretarget.capture.recording import Floats

_DOWN = np.array([0.0, 0.0, -1.0])
_LEFT = np.array([0.0, 1.0, 0.0])
_UP = np.array([0.0, 0.0, 1.0])
_BENT = np.radians(20.0)  # a knee or elbow bent more than this shows its hinge axis
_SNAP = np.cos(np.radians(30.0))


@dataclass(frozen=True, eq=False)
class Calibrated:
    """World rotations (T, 3, 3) of the segments that the file moves, and what was assumed."""

    turn: dict[str, Floats]
    stance: dict[str, NDArray[np.bool_]]  # "left", "right": frames in which that foot stands
    notes: tuple[str, ...]


def standing_rest(measured: Measured) -> Floats | None:
    """The trunk's axes (columns) in the rest pose, if that is a human standing upright."""
    rest, up = measured.rest, measured.up
    left = unit(rest["left_thigh"] - rest["right_thigh"])
    top = rest.get("head", rest.get("chest", rest.get("abdomen")))
    if top is None or unit(top - rest["pelvis"]) @ up < np.cos(np.radians(25)):
        return None
    if abs(left @ up) > np.sin(np.radians(15)):
        return None
    axes = frame(left, up)
    for side in ("left", "right"):
        for a, b in (("thigh", "shank"), ("shank", "foot")):
            bone = unit(rest[f"{side}_{b}"] - rest[f"{side}_{a}"])
            if -bone @ up < np.cos(np.radians(40)):
                return None
        toe = measured.rest_end.get(f"{side}_foot")
        if toe is not None and (toe - rest[f"{side}_foot"]) @ axes[:, 0] < 0:
            return None
    if "left_upper_arm" in rest and "right_upper_arm" in rest:
        across = unit(rest["left_upper_arm"] - rest["right_upper_arm"])
        if across @ axes[:, 1] < np.cos(np.radians(25)):
            return None
    return axes


def calibrate(measured: Measured) -> Calibrated:
    """World rotations of every segment whose joint the file turns."""
    rest = standing_rest(measured)
    notes = []
    if rest is None:
        notes.append(
            "the file's rest pose is no standing human: "
            "the trunk's upright is taken from the links of its spine"
        )
    turn = _trunk(measured, rest)
    stance = {side: stands(measured, side) for side in ("left", "right")}
    for side in ("left", "right"):
        _leg(measured, turn, side, rest, stance[side])
        _arm(measured, turn, side, rest)
    if "head" in measured.turn:
        turn["head"] = measured.turn["head"] @ _head(measured, turn, rest)
    return Calibrated(turn, stance, tuple(notes))


# ------------------------------------------------------------------------------------ trunk


def _trunk(measured: Measured, rest: Floats | None) -> dict[str, Floats]:
    """Pelvis, abdomen, chest."""
    turn: dict[str, Floats] = {}
    hips = measured.centre["left_thigh"] - measured.centre["right_thigh"]
    top = next((s for s in ("head", "chest", "abdomen") if s in measured.centre), None)
    for segment in ("pelvis", "chest", "abdomen"):
        if segment not in measured.turn:
            continue
        joint = measured.turn[segment]
        if rest is not None:
            turn[segment] = joint @ rest
        elif segment == "abdomen":
            turn[segment] = joint @ _between(measured, turn, joint)
        else:
            across = hips if segment == "pelvis" else _shoulders(measured, hips)
            left = mean_direction(in_frames(joint, unit(across)))
            turn[segment] = joint @ frame(left, _link(measured, segment, top, left))
    if "abdomen" in turn and "chest" in measured.centre:
        turn["abdomen"] = _aim(measured, turn["abdomen"], "abdomen", "chest")
    return turn


def _shoulders(measured: Measured, otherwise: Floats) -> Floats:
    for part in ("clavicle", "upper_arm"):
        if all(f"{side}_{part}" in measured.centre for side in ("left", "right")):
            way = measured.centre[f"left_{part}"] - measured.centre[f"right_{part}"]
            if np.median(np.linalg.norm(way, axis=1)) > 0.03:
                return way
    return otherwise


def _link(measured: Measured, segment: str, top: str | None, left: Floats) -> Floats:
    """Up in the segment's joint frame: along the trunk's links as they are at rest."""
    if top is None or top == segment:
        world = np.tile(_UP, (len(measured.turn[segment]), 1))
        return mean_direction(in_frames(measured.turn[segment], world))
    way = measured.centre[top] - measured.centre[segment]
    mean = mean_direction(in_frames(measured.turn[segment], unit(way)))
    straight = unit(measured.rest[top] - measured.rest[segment])
    if abs(straight @ left) < np.sin(np.radians(20)) and straight @ mean > np.cos(np.radians(40)):
        return straight
    return mean  # the rest pose bends this skeleton's spine: trust the clip's mean instead


def _between(measured: Measured, turn: dict[str, Floats], joint: Floats) -> Floats:
    """The abdomen's axes in its joint frame: on average halfway between pelvis and chest."""
    up = unit(measured.rest.get("chest", measured.rest["pelvis"]) - measured.rest["abdomen"])
    left = turn["pelvis"][:, :, 1] + (turn["chest"][:, :, 1] if "chest" in turn else 0.0)
    local = mean_direction(in_frames(joint, unit(left)))
    if "chest" not in measured.rest:
        return frame(local, mean_direction(in_frames(joint, turn["pelvis"][:, :, 2])))
    return frame(local, up)


def _aim(measured: Measured, turn: Floats, segment: str, following: str) -> Floats:
    """Swing a segment so that it points to its next joint in every frame."""
    way = unit(measured.centre[following] - measured.centre[segment])
    local = mean_direction(in_frames(turn, way))
    return np.asarray(swing(turn @ local, way) @ turn)


def _head(measured: Measured, turn: dict[str, Floats], rest: Floats | None) -> Floats:
    """The head's axes in its joint frame."""
    if rest is not None:
        return rest
    joint = measured.turn["head"]
    body = turn.get("chest", turn.get("abdomen", turn["pelvis"]))
    up = mean_direction(in_frames(joint, body[:, :, 2]))
    forward = mean_direction(in_frames(joint, body[:, :, 0]))
    if _built_along_axes(measured):
        # Such frames follow the anatomy: a head held aside through a clip stays aside.
        up, forward = _snap(up), _snap(forward)
    return frame(np.cross(up, forward), up)


def _built_along_axes(measured: Measured) -> bool:
    """Whether bones lie along coordinate axes of their joints' frames, as in most rigs."""
    for side in ("left", "right"):
        for a, b in (("thigh", "shank"), ("shank", "foot")):
            bone = unit(measured.rest[f"{side}_{b}"] - measured.rest[f"{side}_{a}"])
            if np.abs(bone).max() < np.cos(np.radians(8)):
                return False
    return True


def _limbs_straight(measured: Measured) -> bool:
    """Whether arms and legs are straight at rest, so that their frames fit end to end."""
    limbs = (("upper_arm", "forearm", "hand"), ("thigh", "shank", "foot"))
    for side in ("left", "right"):
        for parts in limbs:
            if any(f"{side}_{part}" not in measured.rest for part in parts):
                continue
            a, b, c = (measured.rest[f"{side}_{part}"] for part in parts)
            if unit(b - a) @ unit(c - b) < np.cos(np.radians(45)):
                return False
    return True


def _snap(direction: Floats) -> Floats:
    """The nearest coordinate axis if it is within 30 degrees, else the direction itself."""
    axis = int(np.argmax(np.abs(direction)))
    if abs(direction[axis]) < _SNAP:
        return direction
    return np.asarray(np.sign(direction[axis]) * np.eye(3)[axis])


# ------------------------------------------------------------------------------------ limbs


def _zero_twist(parent: Floats, joint: Floats, way: Floats) -> Floats:
    """The child's left in its joint frame, such that its mean twist against ``parent`` is 0."""
    start = parent @ _DOWN
    left = np.einsum("tij,tj->ti", swing(start, way), parent @ _LEFT)
    # Near a half turn the smallest rotation is anybody's guess: those frames don't count.
    weight = np.clip((1 + np.sum(start * way, axis=1)) / 2, 1e-6, None) ** 2
    return mean_direction(in_frames(joint, left), weight)


def hinge(measured: Measured, segments: tuple[str, str, str]) -> tuple[Floats, Floats]:
    """Bend angle (T,) and axis (T, 3) of the joint between two bones, from three centres."""
    a, b, c = (measured.centre[s] for s in segments)
    upper, lower = unit(b - a), unit(c - b)
    axis = np.cross(upper, lower)
    angle = np.arctan2(np.linalg.norm(axis, axis=1), np.sum(upper * lower, axis=1))
    return angle, unit(axis)


def _hinge_left(
    measured: Measured, joint: Floats, segments: tuple[str, str, str], sign: float
) -> Floats | None:
    """Left in the joint frame from the hinge, if it bends often and about one axis."""
    angle, axis = hinge(measured, segments)
    weight = np.where(angle > _BENT, np.sin(angle), 0.0)
    if np.count_nonzero(weight) < max(5, 0.1 * len(weight)):
        return None
    local = sign * in_frames(joint, axis)
    if np.linalg.norm(weight @ local) < 0.85 * weight.sum():
        return None
    return mean_direction(local, weight)


def _rest_left(measured: Measured, segment: str, following: str, axes: Floats) -> Floats:
    """Left in the joint frame from a standing rest pose: swung with the bone from hanging."""
    bone = unit(measured.rest[following] - measured.rest[segment])
    hanging = -axes[:, 2]
    return np.asarray(swing(hanging[None], bone[None])[0] @ axes[:, 1])


def _bone(measured: Measured, segment: str, following: str, left: Floats) -> Floats:
    """World rotations of a limb segment: down exactly along the bone, left as told."""
    joint = measured.turn[segment]
    way = unit(measured.centre[following] - measured.centre[segment])
    local = mean_direction(in_frames(joint, way))
    turn = joint @ frame(left, -local)
    return np.asarray(swing(turn @ _DOWN, way) @ turn)


def _leg(
    measured: Measured,
    turn: dict[str, Floats],
    side: str,
    rest: Floats | None,
    stance: NDArray[np.bool_],
) -> None:
    thigh, shank, foot = (f"{side}_{part}" for part in ("thigh", "shank", "foot"))
    for segment, following, parent in ((thigh, shank, "pelvis"), (shank, foot, thigh)):
        joint = measured.turn[segment]
        left = _hinge_left(measured, joint, (thigh, shank, foot), 1.0)
        way = unit(measured.centre[following] - measured.centre[segment])
        loose = _zero_twist(turn[parent], joint, way)
        if left is None or left @ loose < 0.3:  # no hinge, or one that no knee has
            left = loose if rest is None else _rest_left(measured, segment, following, rest)
        turn[segment] = _bone(measured, segment, following, left)
    if foot in measured.turn:
        turn[foot] = measured.turn[foot] @ foot_axes(measured, turn[shank], side, rest, stance)


def _arm(measured: Measured, turn: dict[str, Floats], side: str, rest: Floats | None) -> None:
    clavicle, upper, fore, hand = (
        f"{side}_{part}" for part in ("clavicle", "upper_arm", "forearm", "hand")
    )
    body = turn.get("chest", turn.get("abdomen", turn["pelvis"]))
    if clavicle in measured.turn:
        joint = measured.turn[clavicle]
        mean = mean_rotation(np.swapaxes(joint, 1, 2) @ body)
        turn[clavicle] = joint @ (mean if rest is None else rest)
    if fore not in measured.centre or upper not in measured.turn:
        return
    way = unit(measured.centre[fore] - measured.centre[upper])
    left = None
    if hand in measured.centre:
        left = _hinge_left(measured, measured.turn[upper], (upper, fore, hand), -1.0)
    if left is None and rest is not None:
        left = _rest_left(measured, upper, fore, rest)
    if left is None:
        left = _zero_twist(body, measured.turn[upper], way)
    turn[upper] = _bone(measured, upper, fore, left)
    if hand not in measured.centre or fore not in measured.turn:
        return
    turn[fore] = _bone(measured, fore, hand, _forearm_left(measured, turn, side, left))
    if hand in measured.turn:
        # A hand's own axis is seldom marked: straight on average, which is how hands hang.
        relative = np.swapaxes(measured.turn[hand], 1, 2) @ turn[fore]
        turn[hand] = measured.turn[hand] @ mean_rotation(relative)


def _forearm_left(
    measured: Measured, turn: dict[str, Floats], side: str, upper_left: Floats
) -> Floats:
    """The forearm's left: that of the upper arm with the elbow straightened at rest."""
    upper, fore, hand = (f"{side}_{part}" for part in ("upper_arm", "forearm", "hand"))
    first = unit(measured.rest[fore] - measured.rest[upper])
    second = unit(measured.rest[hand] - measured.rest[fore])
    if _limbs_straight(measured):
        return np.asarray(swing(first[None], second[None])[0] @ upper_left)
    way = unit(measured.centre[hand] - measured.centre[fore])
    return _zero_twist(turn[upper], measured.turn[fore], way)
