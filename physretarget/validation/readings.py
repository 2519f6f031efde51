"""Other ways in which a clip's numbers may have been meant, and which of them makes sense.

Each reading is a correction of the poses as they were read. The likeliest is the one after which
the clip looks like a body on a floor (:mod:`physretarget.validation.evidence`) where it does not as
it is: that it explains what is wrong is the proof, no name and no convention."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from physretarget.ground.undersides import bearing_solids
from physretarget.kinematics import Tree, quat_conjugate, quat_multiply
from physretarget.kinematics.order import breadth_first
from physretarget.mjcf import Character
from physretarget.validation.evidence import Evidence, Floats, evidence

# A reading must halve what is wrong, and by more than what a body that stands well has anyway: 3 cm
# of slip and stray for each metre of height.
BETTER = 0.5
# Nor may it leave more than this: what stands nowhere in any reading tells nothing.
STILL_GOOD = 0.6
NOISE = 0.03
# A root lower than this share of the character's height says nothing of units; in a clip that is
# read rightly it is so many times as high as in the reference pose, lying or jumping.
_LOW_ROOT, _LOWEST_ROOT, _HIGHEST_ROOT = 0.1, 0.08, 2.0


@dataclass(frozen=True, eq=False)
class Reading:
    """One correction: the kind of mistake, what was meant, what to do, and how to correct it."""

    kind: str
    meant: str
    remedy: str
    correct: Callable[[Floats], Floats]


@dataclass(frozen=True, eq=False)
class Better:
    """A reading that explains the clip, with the evidence after it, and before."""

    reading: Reading
    after: Evidence
    before: Evidence


def better_reading(character: Character, qpos: Floats, step: float) -> Better | None:
    """The reading by which these poses make sense, None where they do as they are or by none."""
    before = evidence(character, qpos, step)
    # A constant height is the simpler explanation: what it would mend is no proof.
    limit = min(BETTER * before.badness - NOISE, before.restless - NOISE / 2, STILL_GOOD)
    best: Better | None = None
    if limit <= 0:
        return None
    solids = bearing_solids(character)
    # What is wrong enough for a whole clip already in the quarter in its middle need not be read.
    middle = slice(3 * len(qpos) // 8, 5 * len(qpos) // 8)
    for reading in readings(character):
        corrected = reading.correct(qpos)
        if reading.kind == "unit" and not _at_its_height(character, corrected):
            continue
        if evidence(character, corrected[middle], step, solids).bound(len(qpos)) >= limit:
            continue
        after = evidence(character, corrected, step, solids)
        if after.badness < limit:
            best, limit = Better(reading, after, before), after.badness
    return best


def _at_its_height(character: Character, qpos: Floats) -> bool:
    """Whether the root is about as high above the floor as the body carries it.

    Shrunk to a point any path looks well: of a root that lies on the floor no unit can be told.
    """
    usual = float(character.reference_qpos[character.root_qpos + 2]) - character.floor_height
    if usual < _LOW_ROOT * character.height:
        return False
    height = float(np.median(qpos[:, character.root_qpos + 2])) - character.floor_height
    return _LOWEST_ROOT < height / usual < _HIGHEST_ROOT


def readings(character: Character) -> Iterator[Reading]:
    """All that is thought of."""
    root = character.root_qpos
    yield from _joint_orders(character.tree)
    if not character.has_root:
        return
    yield from _quaternions(root)
    yield from _up_axes(root)
    yield from _units(root)


def _joint_orders(tree: Tree) -> Iterator[Reading]:
    order = breadth_first(tree)
    if (order == np.arange(tree.nq)).all():
        return
    remedy = "Read it with --joint-order {}, or name the joints in the file"
    yield Reading(
        "joints", "its joints are in breadth-first order, not in the model's",
        remedy.format("breadth-first"), lambda q: q[:, order],
    )  # fmt: skip
    back = np.argsort(order)
    yield Reading(
        "joints", "its joints are in the model's order and were taken for breadth-first ones",
        remedy.format("model"), lambda q: q[:, back],
    )  # fmt: skip


def _quaternions(root: int) -> Iterator[Reading]:
    quat = slice(root + 3, root + 7)

    def changed(how: Callable[[Floats], Floats]) -> Callable[[Floats], Floats]:
        def correct(qpos: Floats) -> Floats:
            corrected = qpos.copy()
            corrected[:, quat] = how(qpos[:, quat])
            return corrected

        return correct

    yield Reading(
        "quaternion", "the root's quaternions are in the order xyzw and were read as wxyz",
        "Read it with --quat xyzw", changed(lambda q: np.roll(q, 1, axis=1)),
    )  # fmt: skip
    yield Reading(
        "quaternion", "the root's quaternions are in the order wxyz and were read as xyzw",
        "Read it with --quat wxyz", changed(lambda q: np.roll(q, -1, axis=1)),
    )  # fmt: skip
    yield Reading(
        "quaternion", "the root's quaternions turn the world into the body, not the body into the "
        "world", "Conjugate them: negate x, y and z", changed(quat_conjugate),
    )  # fmt: skip


_UP = {"y": (1, 0, 0, 90), "-y": (1, 0, 0, -90), "x": (0, 1, 0, -90), "-x": (0, 1, 0, 90),
       "-z": (1, 0, 0, 180)}  # fmt: skip


def _up_axes(root: int) -> Iterator[Reading]:
    for name, (*axis, degrees) in _UP.items():
        turn = Rotation.from_rotvec(np.deg2rad(degrees) * np.array(axis, dtype=np.float64))
        quat = turn.as_quat(scalar_first=True)
        for frames in ("world", "body"):
            yield Reading(
                "up", f"{name} points up in it, not z" + (
                    "" if frames == "world" else ", in the world and in the root's own frame"
                ),
                f"Turn the root by {degrees} degrees about {'xyz'[axis.index(1)]}, so that z is up",
                _turned(root, turn, quat, both=frames == "body"),
            )  # fmt: skip


def _turned(root: int, turn: Rotation, quat: Floats, *, both: bool) -> Callable[[Floats], Floats]:
    def correct(qpos: Floats) -> Floats:
        corrected = qpos.copy()
        corrected[:, root : root + 3] = turn.apply(qpos[:, root : root + 3])
        turned = quat_multiply(quat, qpos[:, root + 3 : root + 7])
        if both:
            turned = quat_multiply(turned, quat_conjugate(quat))
        corrected[:, root + 3 : root + 7] = turned
        return corrected

    return correct


# What was meant by a number that was taken for metres, and by one that was taken for another unit.
_UNITS = {
    0.01: ("in centimetres", "Read it with --unit cm"),
    0.001: ("in millimetres", "Read it with --unit mm"),
    0.0254: ("in inches", "Read it with --unit inch"),
    0.3048: ("in feet", "Read it with --unit 0.3048"),
    100.0: ("in metres and was read as centimetres", "Read it with --unit m"),
    1000.0: ("in metres and was read as millimetres", "Read it with --unit m"),
    39.3701: ("in metres and was read as inches", "Read it with --unit m"),
}


def _units(root: int) -> Iterator[Reading]:
    for scale, (meant, remedy) in _UNITS.items():
        yield Reading("unit", f"the root's position is {meant}", remedy, _scaled(root, scale))


def _scaled(root: int, scale: float) -> Callable[[Floats], Floats]:
    def correct(qpos: Floats) -> Floats:
        corrected = qpos.copy()
        corrected[:, root : root + 3] *= scale
        return corrected

    return correct
