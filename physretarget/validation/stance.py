"""What stances say: how far the legs carry the root, and how the soles lie."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from physretarget import kinematics
from physretarget.ground.undersides import Solid, bearing_solids
from physretarget.mjcf import Character
from physretarget.validation.evidence import Evidence, Floats

# What is this near to where the clip stands stands, in CoM heights.
_NEAR = 0.03
# Slower than this share of a fall from the CoM's height a root hardly moves, or a sole stands.
_MOVES, _STANDS = 0.03, 0.05
_FEWEST = 20
# The fit of the factor: what it leaves, of the root's speed, and how far it may lie from 1.
_LEFT, _FURTHEST = 0.15, 3.0
_ROUNDS = 30
# A sole: points within 5 mm of a body's lowest, at least so wide in heights of the character.
_FLAT_M, _WIDE = 0.005, 0.02
_FEWEST_STANCES = 10
# A root below this share of its height in the reference pose belongs to a body that lies or sits:
# its feet rest as they fall.
_LIES = 0.5


def root_scale(seen: Evidence) -> float | None:
    """By how much the root travels too far for its legs; None where they do not tell.

    While a point stands, z v + w = 0 with the root's velocity v and the point's velocity w about
    it: z, found by least absolute residuals, is one over the factor.
    """
    level = np.abs(seen.lowest - seen.offset) < _NEAR * seen.height
    v = seen.carry[:, 0] + 1j * seen.carry[:, 1]
    w = seen.slip[:, 0] + 1j * seen.slip[:, 1] - v
    moves = np.abs(v) / seen.step > _MOVES * np.sqrt(9.81 * seen.height)
    chosen = level[:-1] & level[1:] & moves
    if chosen.sum() < _FEWEST or np.abs(v[chosen]).sum() < seen.height:
        return None
    v, w = v[chosen], w[chosen]
    z = complex(np.median((-w / v).real), np.median((-w / v).imag))
    for _ in range(_ROUNDS):
        weight = 1 / np.maximum(np.abs(z * v + w), 1e-3 * seen.height)
        z = complex(-(weight * np.conj(v) * w).sum() / (weight * np.abs(v) ** 2).sum())
    left = float(np.median(np.abs(z * v + w)) / np.median(np.abs(v)))
    before = float(np.median(np.abs(v + w)) / np.median(np.abs(v)))
    straight = abs(z.imag) < _LEFT * abs(z)
    agreed = straight and left <= min(_LEFT, 0.7 * before)
    if not agreed or not 1 / _FURTHEST < z.real < _FURTHEST:
        return None
    return 1 / z.real


@dataclass(frozen=True, eq=False)
class Tilt:
    """How a sole stands: ``turn`` (3,) rad from the floor, in its body's axes turned level; the
    median over its stances, ``spread`` rad about it."""

    body: int
    turn: Floats
    spread: float


def sole_tilts(character: Character, seen: Evidence, qpos: Floats) -> list[Tilt] | None:
    """Of each sole that stands often enough; None where the model has no sole."""
    soles = _soles(character)
    if not soles:
        return None
    pose = kinematics.forward(character.tree, qpos)
    slow = np.linalg.norm(seen.slip, axis=1) < _STANDS * seen.step * np.sqrt(9.81 * seen.height)
    level = np.abs(seen.lowest - seen.offset)[:-1] < _NEAR * seen.height
    level &= _upright(character, pose, seen)[:-1]
    found = []
    for body, normal in soles.items():
        stands = slow & level & (seen.body[:-1] == body)
        if stands.sum() < _FEWEST_STANCES:
            continue
        up = pose.rotation[:-1][stands][:, body, 2]
        turns = -np.cross(normal, up)
        middle = np.median(turns, axis=0)
        apart = float(np.median(np.linalg.norm(turns - middle, axis=1)))
        found.append(Tilt(body, middle, apart))
    return found


def _upright(character: Character, pose: kinematics.Pose, seen: Evidence) -> NDArray[np.bool_]:
    """(n,) whether the root is as high as that of a body on its feet."""
    if not character.has_root:
        return np.ones(len(pose.position), dtype=bool)
    height = pose.position[:, character.root_body, 2] - character.floor_height
    usual = float(character.reference_qpos[character.root_qpos + 2]) - character.floor_height
    upright: NDArray[np.bool_] = height - seen.offset > _LIES * usual
    return upright


def _soles(character: Character) -> dict[int, Floats]:
    """Of bodies that stand flat in the reference pose the sole's normal, body frame."""
    pose = kinematics.forward(character.tree, character.reference_qpos[None])
    places: dict[int, list[Floats]] = {}
    for solid in bearing_solids(character):
        places.setdefault(solid.body, []).append(_underside(solid, pose))
    floor = min((float(p[:, 2].min()) for every in places.values() for p in every), default=0.0)
    found = {}
    for body, every in places.items():
        points = np.concatenate(every)
        lowest = float(points[:, 2].min())
        low = points[points[:, 2] < lowest + _FLAT_M, :2]
        near = lowest < floor + _NEAR * max(character.height, 1e-3)
        if near and _width(low) > _WIDE * character.height:
            found[body] = pose.rotation[0, body].T @ np.array([0.0, 0.0, 1.0])
    return found


def _underside(solid: Solid, pose: kinematics.Pose) -> Floats:
    """(n, 3) the lowest points of a geom in the world, with a rim where it lies on a disc."""
    turn, place = pose.rotation[0, solid.body], pose.position[0, solid.body]
    points: Floats = place + solid.undersides(turn[2]) @ turn.T
    upright = np.abs(turn[2] @ solid.frame)
    if solid.axes.max() > 0 and solid.axes.min() == 0:
        flat = int(solid.axes.argmin())
        if upright[flat] > 1 - 1e-3:
            angle = np.arange(8) * np.pi / 4
            rim = solid.axes.max() * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
            points = (points[:, None] + rim).reshape(-1, 3)
    return points


def _width(points: Floats) -> float:
    """m across points (n, 2) in their narrowest direction."""
    if len(points) < 3:
        return 0.0
    spread = points - points.mean(axis=0)
    own = spread @ np.linalg.svd(spread, full_matrices=False)[2].T
    return float(np.ptp(own, axis=0).min())
