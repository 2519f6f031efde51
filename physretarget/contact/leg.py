"""What a leg can do for its foot, and how far the trunk may come to its help.

A foot has six degrees of freedom, and a leg commands as many of them as its joints allow: three
of a crab's pointed one, four of a bird's whose leg only bends and spreads. Such a foot is held
at its place, and turns and rolls there as the leg has it. Asked to hold all six it would turn the
trunk instead.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.contact.foot import Foot
from physretarget.contact.settings import ContactSettings
from physretarget.contact.sole import Sole
from physretarget.mjcf import Character

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SAMPLES = 8
"""Poses in which a leg is tried: in a single one it may be straight."""
SOLE_SLACK = 0.003
"""So deep may an edge of a rolled sole be in the floor (m), as a rounded toe is that rolls."""
PLACES, FARTHEST, FEW = 4096, 1.2, 20
"""Poses in which a leg's reach is tried, how far each joint is moved in them (rad), and how many on
the floor say nothing."""
SHARE = 0.7
"""A leg's stride is as long as this share of all places on the floor that it reaches is near."""
WEAKEST = 0.03
"""A direction counts as commanded if the leg's joints move the foot along it by this share of how
they move it along the strongest one."""


def commands_foot(character: Character, sole: Sole) -> bool:
    """Whether the joints from the trunk to a body hold its contact points wherever they shall be.

    A single point has three degrees of freedom, a sole six.
    """
    tree = character.tree
    chain = tree.carries[:, sole.body].copy()
    chain[character.root_body] = False
    dofs = chain[tree.dof_body] & ~_trunk_dofs(character)
    local = sole.local if len(sole.local) == 1 else _rigid(sole)
    need = 3 if len(sole.local) == 1 else 6
    if sole.body == character.root_body or dofs.sum() < need:
        return sole.body == character.root_body
    rng = np.random.default_rng(0)
    step = 0.3 * rng.standard_normal((SAMPLES, tree.nv))
    qpos = kinematics.integrate(tree, np.tile(character.reference_qpos, (SAMPLES, 1)), step)
    qpos = np.clip(qpos, character.lower, character.upper)
    pose = kinematics.forward(tree, qpos)
    body = np.full(len(local), sole.body)
    moves = kinematics.jacobian(tree, pose, qpos, body, local).reshape(SAMPLES, -1, tree.nv)
    size = np.linalg.svd(moves[..., dofs], compute_uv=False)
    rank: Ints = np.sum(size > WEAKEST * size[:, :1], axis=1)
    return bool(rank.max() >= need)


def _rigid(sole: Sole) -> Floats:
    """(4, 3) points of a body that tell its place and its rotation apart from any other."""
    return np.concatenate([sole.centre[None], sole.centre + sole.radius * np.eye(3)])


def _trunk_dofs(character: Character) -> NDArray[np.bool_]:
    trunk = np.zeros(character.tree.nv, dtype=bool)
    if character.has_root:
        trunk[character.root_dof : character.root_dof + 6] = True
    return trunk


def yielding(character: Character, feet: list[Foot]) -> list[Foot]:
    """The feet that their legs cannot hold in all degrees of freedom."""
    return [foot for foot in feet if not commands_foot(character, foot.sole)]


def as_the_leg_has_it(character: Character, foot: Foot, qpos: Floats) -> Foot:
    """The foot on a path that turns and rolls as in the poses ``qpos`` (T, nq).

    Its centre keeps its place; its lowest point is as low as the path's.
    """
    sole, track = foot.sole, foot.track
    if len(sole.local) < 2:
        return foot
    rotation = kinematics.forward(character.tree, qpos).rotation[:, sole.body]
    centre = track.centre.copy()
    centre[:, 2] += _lowest(sole, track.rotation, 0.0) - _lowest(sole, rotation, SOLE_SLACK)
    points = centre[:, None] + np.einsum("tij,nj->tni", rotation, sole.local - sole.centre)
    target = np.where(np.isfinite(track.target), points, np.nan)
    return replace(foot, track=replace(track, centre=centre, rotation=rotation, target=target))


def _lowest(sole: Sole, rotation: Floats, slack: float) -> Floats:
    """(T,) height over the centre of the lowest point; the underside may be ``slack`` m deeper."""
    heights = np.einsum("tj,nj->tn", rotation[:, 2], sole.local - sole.centre)
    under = np.einsum("tj,nj->tn", rotation[:, 2], sole.under - sole.centre) + slack
    low: Floats = np.concatenate([heights, under], axis=1).min(axis=1)
    return low


def within_budget(
    character: Character, qpos: Floats, wanted: Floats, settings: ContactSettings
) -> tuple[Floats, bool]:
    """Poses whose trunk is no farther from where it was wanted than the settings allow.

    Also whether any had to be changed: feet are off then.
    """
    if not character.has_root:
        return qpos, False
    tree, at = character.tree, character.root_dof
    off = kinematics.difference(tree, wanted, qpos)[:, at : at + 6]
    upright = kinematics.forward(tree, wanted).rotation[:, character.root_body]
    axis = np.einsum("tji,j->ti", upright, np.array([0.0, 0.0, 1.0]))  # vertical, in the body
    twist = np.sum(axis * off[:, 3:], axis=1, keepdims=True) * axis
    allowed = np.zeros_like(off)
    height = settings.trunk_height * character.height
    allowed[:, :2] = off[:, :2]
    allowed[:, 2] = np.clip(off[:, 2], -height, height)
    allowed[:, 3:] = _shortened(twist, settings.trunk_yaw)
    allowed[:, 3:] += _shortened(off[:, 3:] - twist, settings.trunk_tilt)
    beyond = np.flatnonzero(np.abs(allowed - off).max(axis=1) > 1e-9)
    if not len(beyond):
        return qpos, False
    back = np.zeros((len(beyond), tree.nv))
    back[:, at : at + 6] = allowed[beyond]
    kept, trunk = qpos.copy(), slice(character.root_qpos, character.root_qpos + 7)
    kept[beyond, trunk] = kinematics.integrate(tree, wanted[beyond], back)[:, trunk]
    return kept, True


def _shortened(vector: Floats, longest: float) -> Floats:
    """Vectors (T, 3) no longer than that."""
    length = np.linalg.norm(vector, axis=1, keepdims=True)
    short: Floats = vector * np.minimum(1.0, longest / np.maximum(length, 1e-9))
    return short


def stride_limit(character: Character, sole: Sole, settings: ContactSettings) -> float:
    """How far from its place under the trunk a leg's foot may get while it stands, m.

    Of all places on the floor that the leg's joints reach, the trunk as high as its budget allows,
    ``SHARE`` are no farther from where the foot is in the reference pose. Infinite if the body is
    no foot on a leg, or one that reaches the floor nowhere else.
    """
    tree = character.tree
    chain = tree.carries[:, sole.body].copy()
    chain[character.root_body] = False
    dofs = chain[tree.dof_body] & ~_trunk_dofs(character)
    if sole.body == character.root_body or not character.has_root or not dofs.any():
        return float(np.inf)
    rng = np.random.default_rng(0)
    step = np.where(dofs, rng.uniform(-FARTHEST, FARTHEST, (PLACES, tree.nv)), 0.0)
    qpos = kinematics.integrate(tree, np.tile(character.reference_qpos, (PLACES, 1)), step)
    possible = ((qpos >= character.lower - 1e-9) & (qpos <= character.upper + 1e-9)).all(axis=1)
    qpos = np.concatenate([character.reference_qpos[None], qpos[possible]])
    pose = kinematics.forward(tree, qpos)
    off = kinematics.points(pose, np.array([sole.body]), sole.centre[None])[:, 0]
    off = off[1:] - off[0]
    floor = np.abs(off[:, 2]) <= settings.trunk_height * character.height
    if floor.sum() < FEW:
        return float(np.inf)
    return float(np.quantile(np.linalg.norm(off[floor, :2], axis=1), SHARE))
