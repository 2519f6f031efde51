"""Inverse kinematics: mapped features → poses of the character.

The mapper predicts where the virtual markers are in the local frame; here the joints are
found that bring them there, as weighted least squares within the joint limits (Yamane
2010, section 4.1 and 5.2 use the same for contacts). All frames are solved at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.errors import InputError
from physretarget.features import local_frame
from physretarget.kinematics import PointTargets
from physretarget.mjcf import Character

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class IkSettings:
    """How the markers are followed.

    iterations: the most Levenberg–Marquardt steps per frame. tolerance: a frame is done when
    its step is below this (rad or m). prior: how much a joint that no marker determines is
    held to the start pose, in m² per rad² of the sum of squared marker distances.
    """

    iterations: int = 25
    tolerance: float = 1e-4
    prior: float = 1e-6


@dataclass(frozen=True, eq=False)
class IkResult:
    """Poses that follow the features.

    ``qpos`` (T, nq) with root x = y = 0 and heading 0; ``residual_rms`` (T,) m, root mean
    square distance of the markers to where the features put them.
    """

    qpos: Floats
    residual_rms: Floats


def solve(
    character: Character,
    features: Floats,
    *,
    start: Floats | None = None,
    settings: IkSettings | None = None,
) -> IkResult:
    """Find the pose of every frame of ``features``.

    Args:
        character: whose ``markers`` the features describe.
        features: (T, 3K) stacked marker coordinates in the local frame, m.
        start: (T, nq) or (nq,) where to begin, e.g. the nearest key pose; the reference pose
            if None.
        settings: defaults if None.

    Raises:
        InputError: the features have another width than the markers, or are not finite.
    """
    settings = settings or IkSettings()
    features = np.atleast_2d(np.asarray(features, dtype=np.float64))
    target = _targets(character, features)
    begin = np.array(
        np.broadcast_to(
            character.reference_qpos if start is None else start,
            (len(features), character.tree.nq),
        )
    )
    locked = np.zeros(character.tree.nv, dtype=bool)
    if character.has_root:
        # In the local frame the root stands over the origin (its height and tilt are free).
        begin[:, character.root_qpos : character.root_qpos + 2] = 0.0
        locked[character.root_dof : character.root_dof + 2] = True
    markers = PointTargets(character.markers.body, character.markers.local, target)
    found = kinematics.solve(
        character.tree,
        begin,
        [markers],
        lower=character.lower,
        upper=character.upper,
        locked=locked,
        prior_weight=settings.prior,
        iterations=settings.iterations,
        tolerance=settings.tolerance,
    )
    qpos = facing_forward(character, found.qpos)
    rms = np.sqrt(np.mean(found.residual**2, axis=1))
    return IkResult(continuous_qpos(character, qpos), rms)


def _targets(character: Character, features: Floats) -> Floats:
    markers = len(character.markers.names)
    if features.shape[1] != 3 * markers:
        raise InputError(
            f"the features have {features.shape[1]} columns; {character.name} has {markers} "
            f"markers and needs {3 * markers}."
        )
    broken = ~np.isfinite(features).all(axis=1)
    if broken.any():
        raise InputError("the features are not finite.", frame=int(np.argmax(broken)))
    return features.reshape(len(features), markers, 3)


def facing_forward(character: Character, qpos: Floats) -> Floats:
    """Turn the root about the vertical until the heading is zero; features stay as they are.

    Features have heading zero by construction, but predicted ones are no exact pose and
    the best fit may face a fraction of a degree aside.
    """
    if not character.has_root:
        return qpos
    pose = kinematics.forward(character.tree, qpos)
    body = character.root_body
    frame = local_frame(
        pose.position[:, body], pose.rotation[:, body], character.front, character.up
    )
    half = -0.5 * frame.yaw
    turn = np.zeros((len(qpos), 4))
    turn[:, 0], turn[:, 3] = np.cos(half), np.sin(half)
    turned = qpos.copy()
    quat = slice(character.root_qpos + 3, character.root_qpos + 7)
    turned[:, quat] = kinematics.quat_multiply(turn, qpos[:, quat])
    return turned


def continuous_qpos(character: Character, qpos: Floats) -> Floats:
    """The same poses with quaternion signs that do not flip from frame to frame."""
    smooth = qpos.copy()
    for joint in character.tree.joints:
        if joint.kind in ("free", "ball"):
            first = joint.qpos + (3 if joint.kind == "free" else 0)
            part = slice(first, first + 4)
            smooth[:, part] = kinematics.continuous(qpos[:, part])
    return smooth
