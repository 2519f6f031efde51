"""Which limb of a character acts for which of the actor's: as chosen, or by its tree's shape.

What stands where the actor's feet stand are its legs, what stands where its hands stand its arms.
Of the other limbs those that reach out to a side are the arm of that side (claws, flippers, wings);
a tail behind and a head before act for none. Who wants it otherwise says so in the key pose file.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from physretarget.errors import InputError
from physretarget.ground.undersides import solids
from physretarget.keyposes.face import face_of
from physretarget.keyposes.layout import layout_of
from physretarget.keyposes.pairs import actor_character_of_reference
from physretarget.kinematics import Pose, forward
from physretarget.mjcf import Character

__all__ = [
    "ACTOR_LIMBS",
    "Choice",
    "Limb",
    "check_choice",
    "limb_names",
    "limb_targets",
    "limbs_of",
]

Array = NDArray[np.float64]
# What was chosen: a limb of the actor, and the body at which the character's limb begins that acts
# for it, "" where none shall. What is not named goes by the shape.
Choice = tuple[tuple[str, str], ...]

# The actor's segments at which a limb begins, and at whose end it ends.
ACTOR_LIMBS = {
    "left_arm": ("left_upper_arm", "left_hand"),
    "right_arm": ("right_upper_arm", "right_hand"),
    "left_leg": ("left_thigh", "left_foot"),
    "right_leg": ("right_thigh", "right_foot"),
}
# What ends nearer to the middle than this share of the height is on no side.
_MIDDLE = 0.08
# What ends this far below the root, as a share of the height, is a leg: of people it is half.
_HANGS = 0.35


@dataclass(frozen=True, eq=False)
class Limb:
    """A limb of a character.

    Attributes:
        name: the actor's limb that it acts for, "" if none.
        first, last: bodies at which it begins and ends.
        tip: (3,) its far end in the frame of ``last``, m.
        rest: (3,) from the beginning to the tip with all joints at zero, front +x, m.
    """

    name: str
    first: int
    last: int
    tip: Array
    rest: Array


def limb_targets(
    character: Character, actor_qpos: Array, pose: Pose, choice: Choice = ()
) -> list[tuple[Limb, Array]]:
    """Where the tip (3,) of each limb should be, in ``pose`` of the character and the actor's pose.

    The limb turns from its rest as the actor's turns from hanging, and folds as much.
    """
    now, hanging = _actor_vectors(actor_qpos), _actor_rest()
    found = []
    for limb in limbs_of(character, choice):
        way, rest = now[limb.name], hanging[limb.name]
        stretch = float(np.linalg.norm(way) / np.linalg.norm(rest))
        turned = _turn(rest, way) @ limb.rest
        found.append((limb, pose.position[0, limb.first] + stretch * turned))
    return found


def _turn(first: Array, second: Array) -> Array:
    """(3, 3) the smallest rotation that takes one direction to another."""
    a, b = first / np.linalg.norm(first), second / np.linalg.norm(second)
    axis, cos = np.cross(a, b), float(a @ b)
    if cos < -1 + 1e-9:  # straight up from hanging: forwards, as arms are raised
        return np.diag([-1.0, 1.0, -1.0])
    skew = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turn: Array = np.eye(3) + skew + skew @ skew / (1 + cos)
    return turn


@lru_cache(maxsize=1)
def _actor_rest() -> dict[str, Array]:
    """Limbs of the actor at its zero pose, arms and legs hanging."""
    actor = actor_character_of_reference()
    zero = np.zeros(actor.tree.nq)
    for joint in actor.tree.joints:
        zero[joint.qpos + (3 if joint.kind == "free" else 0)] = 1.0
    return _actor_vectors(zero)


def _actor_vectors(qpos: Array) -> dict[str, Array]:
    """(3,) from the beginning to the end of each of the actor's limbs, m."""
    actor = actor_character_of_reference()
    pose = forward(actor.tree, qpos[None])
    body = {actor.model.body(b).name: b for b in range(actor.model.nbody)}
    found = {}
    for name, (first, last) in ACTOR_LIMBS.items():
        found[name] = pose.position[0, body[last]] - pose.position[0, body[first]]
    return found


def limb_names(character: Character) -> list[str]:
    """Names of the bodies at which a limb begins; a limb of a body without a name is left out."""
    names = [str(character.model.body(first).name) for first, _ in _chains(character)]
    return list(dict.fromkeys(name for name in names if name))


def check_choice(character: Character, actor: object, mine: object) -> None:
    """That a limb of the character can be chosen for one of the actor's.

    Raises:
        InputError: the actor has no such limb, or no limb of the character begins there.
    """
    if actor not in ACTOR_LIMBS:
        raise InputError(f"{actor!r} is no limb of the actor: {', '.join(ACTOR_LIMBS)}")
    names = limb_names(character)
    if mine != "" and mine not in names:
        begin = f"they begin at {', '.join(names)}" if names else "it has none with a name"
        raise InputError(
            f'{actor} is {mine!r}, where no limb of {character.name!r} begins: {begin}; "" is none'
        )


@lru_cache(maxsize=32)
def limbs_of(character: Character, choice: Choice = ()) -> tuple[Limb, ...]:
    """The limbs that act for one of the actor's; at most one for each."""
    chosen, pose = dict(choice), _zero(character)
    found: dict[str, Limb] = {}
    for first, last in _chains(character):
        limb = _limb(character, pose, first, last)
        if limb is None:
            continue
        body = character.model.body(first).name
        wanted = [name for name, begins in chosen.items() if begins and begins == body]
        # A limb that was chosen for one of the actor's acts for no other by its shape.
        acts = wanted or [name for name in [limb.name] if name and name not in chosen]
        for name in acts:
            before = found.get(name)
            # Of several the longest acts, and what stands before what hangs.
            if before is None or np.linalg.norm(limb.rest) > np.linalg.norm(before.rest):
                found[name] = replace(limb, name=name)
    return tuple(found[name] for name in ACTOR_LIMBS if name in found)


def _zero(character: Character) -> Pose:
    """All joints at zero, the front along x."""
    qpos = np.zeros(character.tree.nq)
    for joint in character.tree.joints:
        if joint.kind == "free":
            turn = layout_of(character).aligned.as_quat(scalar_first=True)
            qpos[joint.qpos + 3 : joint.qpos + 7] = turn
        elif joint.kind == "ball":
            qpos[joint.qpos] = 1.0
    return forward(character.tree, qpos[None])


def _chains(character: Character) -> list[tuple[int, int]]:
    """First and last body of every unbranched chain that ends in a leaf, with joints in it."""
    model, bodies = character.model, character.bodies.tolist()
    children: dict[int, list[int]] = {body: [] for body in bodies}
    for body in bodies:
        if (parent := int(model.body_parentid[body])) in children:
            children[parent].append(body)
    found = []
    for leaf in bodies:
        if children[leaf]:
            continue
        first, moves = leaf, int(model.body_jntnum[leaf])
        while (parent := int(model.body_parentid[first])) != character.root_body:
            if parent not in children or len(children[parent]) > 1:
                break
            first, moves = parent, moves + int(model.body_jntnum[parent])
        if moves and leaf != character.root_body:
            found.append((first, leaf))
    return found


def _limb(character: Character, pose: Pose, first: int, last: int) -> Limb | None:
    tip = _tip(character, pose, first, last)
    end = pose.position[0, last] + pose.rotation[0, last] @ tip
    rest = end - pose.position[0, first]
    if np.linalg.norm(rest) < 1e-6:
        return None
    name = _acts_for(character, first, last, end - pose.position[0, character.root_body])
    return Limb(name, first, last, tip, rest)


def _tip(character: Character, pose: Pose, first: int, last: int) -> Array:
    """(3,) the point of the last body that is farthest from where the limb begins."""
    mine = [solid.points for solid in solids(character, [last])]
    candidates = np.concatenate([*mine, np.zeros((1, 3))])
    world = pose.position[0, last] + candidates @ pose.rotation[0, last].T
    away = np.linalg.norm(world - pose.position[0, first], axis=1)
    tip: Array = candidates[int(np.argmax(away))]
    return tip


def _acts_for(character: Character, first: int, last: int, end: Array) -> str:
    """Which of the actor's limbs its shape says, "" if none."""
    model, chain, body = character.model, set(), last
    while body != int(model.body_parentid[first]):
        chain.add(body)
        body = int(model.body_parentid[body])
    contacts = character.contacts
    ties = {t for b, t in zip(contacts.body.tolist(), character.tied, strict=True) if b in chain}
    ties.discard(None)
    if ties:
        tie = str(sorted(str(t) for t in ties)[0])
        return f"{tie.split('_')[0]}_{'arm' if 'hand' in tie else 'leg'}"
    face = face_of(character)
    middle = abs(end[1]) < _MIDDLE * character.height
    if middle or (face is not None and face[0] in chain):
        return ""
    # Without named contacts: what hangs down to where the floor would be stands on it.
    leg = -end[2] > _HANGS * character.height
    return f"{'left' if end[1] > 0 else 'right'}_{'leg' if leg else 'arm'}"
