"""Are the key poses sound?"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget.features import local_frame
from physretarget.keyposes.pairs import actor_character_of_reference, training_pairs
from physretarget.keyposes.pose import KeyPose, KeyPoseSet
from physretarget.kinematics import forward, points
from physretarget.mjcf import Character
from physretarget.mjcf.reference import lowest_and_highest

__all__ = ["CheckSettings", "Remark", "check"]

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class CheckSettings:
    """Tolerances of :func:`check`.

    All are choices of ours: below them nothing shows in an animation of a character that is
    half a metre tall, and files keep 0.01 mm and 0.001 degrees.
    """

    planted_height: float = 0.003  # m, of a planted contact point above or below the floor
    penetration: float = 0.003  # m, of any geometry below the floor
    limit: float = 1e-3  # rad or m beyond a joint limit
    heading: float = 0.01  # rad
    same: float = 0.01  # m, RMS over features below which two poses count as one
    # Two poses contradict each other where the character's differ by so many times as much as the
    # actor's, each over its height, and by more than that share of the character's height. Over
    # all pairs of our characters' key poses the median is 0.8 to 1.2 times.
    stretch: float = 5.0
    apart: float = 0.2
    listed: int = 10  # contradictions named, the worst first


@dataclass(frozen=True)
class Remark:
    """One thing that :func:`check` found; ``pose`` is None where it concerns the whole set."""

    pose: str | None
    severity: Literal["error", "warning"]
    message: str


def check(
    keyposes: KeyPoseSet, character: Character, *, settings: CheckSettings | None = None
) -> tuple[Remark, ...]:
    """What is wrong with key poses: limits, floor, planted points, headings, duplicates.

    An error makes the pose unusable for learning as it stands; a warning deserves a look.

    Args:
        keyposes: The key poses.
        character: The character that was posed.
        settings: Tolerances, the defaults if None.

    Returns:
        One remark for everything that is wrong.
    """
    settings = settings or CheckSettings()
    remarks = [Remark(None, "warning", text) for text in keyposes.remarks]
    for pose in keyposes.poses:
        remarks += [Remark(pose.name, "error", text) for text in _errors(pose, character, settings)]
    remarks += _duplicates(keyposes, character, settings)
    return (*remarks, *_contradictions(keyposes, character, settings))


def _errors(pose: KeyPose, character: Character, settings: CheckSettings) -> list[str]:
    return [
        *_limits(pose, character, settings),
        *_headings(pose, character, settings),
        *_floor(pose, character, settings),
        *_planted(pose, character, settings),
    ]


def _limits(pose: KeyPose, character: Character, settings: CheckSettings) -> list[str]:
    found = []
    for name, joint in zip(character.joint_names, character.tree.joints, strict=True):
        low, high = character.lower[joint.qpos], character.upper[joint.qpos]
        value = pose.qpos[joint.qpos]
        if low - settings.limit <= value <= high + settings.limit:
            continue
        scale, unit = (1.0, "m") if joint.kind == "slide" else (180 / np.pi, "degrees")
        found.append(
            f"{name} is {value * scale:.4g} {unit}, allowed is "
            f"{low * scale:.4g} to {high * scale:.4g}"
        )
    return found


def _headings(pose: KeyPose, character: Character, settings: CheckSettings) -> list[str]:
    found = []
    actor = actor_character_of_reference()
    for who, model, qpos in (
        ("the actor", actor, pose.actor_qpos),
        ("the character", character, pose.qpos),
    ):
        at = forward(model.tree, qpos[None])
        root = model.root_body
        frame = local_frame(at.position[:, root], at.rotation[:, root], model.front, model.up)
        if np.hypot(*frame.origin[0, :2]) > 1e-6:
            found.append(f"{who} stands at x, y = {frame.origin[0, :2].tolist()}, not at zero")
        yaw = float(np.angle(np.exp(1j * frame.yaw[0])))
        if abs(yaw) > settings.heading:
            found.append(f"{who} has a heading of {np.degrees(yaw):.2f} degrees, not zero")
    return found


def _floor(pose: KeyPose, character: Character, settings: CheckSettings) -> list[str]:
    data = mujoco.MjData(character.model)
    data.qpos[:] = pose.qpos
    mujoco.mj_kinematics(character.model, data)
    low, _ = lowest_and_highest(character.model, data, character.bodies)
    depth = character.floor_height - low
    if depth <= settings.penetration:
        return []
    return [f"the character reaches {depth * 1000:.1f} mm into the floor"]


def _planted(pose: KeyPose, character: Character, settings: CheckSettings) -> list[str]:
    found = []
    at = forward(character.tree, pose.qpos[None])
    contacts = character.contacts
    height = points(at, contacts.body, contacts.local)[0, :, 2] - character.floor_height
    for name, tie, above in zip(contacts.names, character.tied, height, strict=True):
        if tie in pose.planted and abs(above) > settings.planted_height:
            found.append(f"{name} is planted but {above * 1000:+.1f} mm off the floor")
    return found


def _duplicates(
    keyposes: KeyPoseSet, character: Character, settings: CheckSettings
) -> list[Remark]:
    """Pairs of one actor pose: contradictory where the character's poses differ."""
    if len(keyposes) < 2:
        return []
    y, z = training_pairs(keyposes, character)
    found = []
    for i, j in combinations(range(len(keyposes)), 2):
        if _rms(y[i] - y[j]) > settings.same:
            continue
        first, second = keyposes.poses[i].name, keyposes.poses[j].name
        apart = _rms(z[i] - z[j])
        if apart > settings.same:
            text = (
                f"the actor stands as in {first!r}, but the character {apart * 100:.1f} cm (RMS) "
                "apart from it"
            )
            found.append(Remark(second, "error", text))
        else:
            found.append(Remark(second, "warning", f"adds nothing to {first!r}"))
    return found


def _contradictions(
    keyposes: KeyPoseSet, character: Character, settings: CheckSettings
) -> list[Remark]:
    """Neighbouring poses of the actor that ask for far apart poses of the character.

    Between them the map has to leap. Duplicates are told apart from these.
    """
    if len(keyposes) < 2:
        return []
    y, z = training_pairs(keyposes, character)
    actor = actor_character_of_reference()
    first, second = np.triu_indices(len(keyposes), 1)
    near = np.sqrt(3.0 * np.mean((y[first] - y[second]) ** 2, axis=1))
    far = np.sqrt(3.0 * np.mean((z[first] - z[second]) ** 2, axis=1)) / character.height
    stretch = far * actor.height / np.maximum(near, 1e-9)
    found = (near > settings.same) & (stretch > settings.stretch) & (far > settings.apart)
    worst = np.flatnonzero(found)[np.argsort(-stretch[found], kind="stable")]
    names = [pose.name for pose in keyposes.poses]
    remarks = [
        Remark(
            names[second[k]],
            "warning",
            f"the actor stands {near[k] * 1000:.0f} mm from where it stands in "
            f"{names[first[k]]!r} (RMS), but the character {far[k]:.0%} of its height away from "
            "its pose there: between the two the map leaps",
        )
        for k in worst[: settings.listed]
    ]
    if len(worst) > settings.listed:
        more = f"{len(worst) - settings.listed} more pairs of poses contradict each other so"
        remarks.append(Remark(None, "warning", more))
    return remarks


def _rms(difference: Array) -> float:
    """Root mean square distance of stacked points."""
    return float(np.sqrt(np.mean(np.sum(difference.reshape(-1, 3) ** 2, axis=1))))
