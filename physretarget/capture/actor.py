"""The canonical human that every capture is fitted to: segments, proportions, motion.

Zero pose: standing upright on z = 0, arms hanging, facing +x with the left side at +y. In it
ALL segment frames are parallel to the world, so that a joint rotation means the same on every
actor and poses can be carried from one to another.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from physretarget.capture.recording import Source
from physretarget.errors import UsageError
from physretarget.kinematics import (
    Joint,
    Tree,
    continuous,
    slerp,
)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

SEGMENTS = (
    "pelvis",
    "abdomen",
    "chest",
    "head",
    "left_clavicle",
    "left_upper_arm",
    "left_forearm",
    "left_hand",
    "right_clavicle",
    "right_upper_arm",
    "right_forearm",
    "right_hand",
    "left_thigh",
    "left_shank",
    "left_foot",
    "right_thigh",
    "right_shank",
    "right_foot",
)
SEGMENT = {name: i for i, name in enumerate(SEGMENTS)}
_PARENT_NAMES = {
    "abdomen": "pelvis",
    "chest": "abdomen",
    "head": "chest",
    "left_clavicle": "chest",
    "left_upper_arm": "left_clavicle",
    "left_forearm": "left_upper_arm",
    "left_hand": "left_forearm",
    "left_thigh": "pelvis",
    "left_shank": "left_thigh",
    "left_foot": "left_shank",
}
# Parent segment of each segment; -1 for the pelvis, which hangs from the world.
PARENTS = tuple(
    -1
    if name == "pelvis"
    else SEGMENT[
        _PARENT_NAMES.get(name)
        or _PARENT_NAMES[name.replace("right", "left")].replace("left", "right")
    ]
    for name in SEGMENTS
)
# The segment whose joint ends each segment; None where the segment ends in a tip.
NEXT = {
    "pelvis": "abdomen",
    "abdomen": "chest",
    "chest": "head",
    **{
        f"{side}_{a}": f"{side}_{b}"
        for side in ("left", "right")
        for a, b in (
            ("clavicle", "upper_arm"),
            ("upper_arm", "forearm"),
            ("forearm", "hand"),
            ("thigh", "shank"),
            ("shank", "foot"),
        )
    },
}
NQ, NV = 7 + 4 * 17, 6 + 3 * 17

REFERENCE_ACTOR = "1"
CONTACT_POINTS = (
    "left_heel",
    "left_toe",
    "right_heel",
    "right_toe",
    "left_hand",
    "right_hand",
    "left_knee",
    "right_knee",
    "pelvis",
    "head",
)


@dataclass(frozen=True, eq=False)
class ActorShape:
    """The proportions of one actor, in metres and kilograms.

    ``offset`` (18, 3): each segment's joint centre in its parent's frame; that of the pelvis,
    midway between the hips, is its place in the world, so that the soles are at z = 0.
    ``tip`` (18, 3): the end of each segment in its own frame: top of the head, finger tips,
    ball of the toes on the sole, otherwise the next joint. ``heel`` (2, 3): left and right
    heel on the sole, in the feet's frames. ``name`` says whose proportions they are.
    """

    name: str
    mass: float
    offset: Floats
    tip: Floats
    heel: Floats

    @staticmethod
    def standing(name: str, mass: float, offset: Floats, tip: Floats, heel: Floats) -> ActorShape:
        """A shape whose pelvis height and inner tips follow from the other measures.

        Fills ``offset[0]`` and the tips that are the next joint.
        """
        offset, tip = np.array(offset, dtype=np.float64), np.array(tip, dtype=np.float64)
        for segment, following in NEXT.items():
            tip[SEGMENT[segment]] = offset[SEGMENT[following]]
        lowest = [
            sum(offset[SEGMENT[f"{side}_{part}"], 2] for part in ("thigh", "shank", "foot"))
            + min(tip[SEGMENT[f"{side}_foot"], 2], heel[i, 2])
            for i, side in enumerate(("left", "right"))
        ]
        offset[0] = (0.0, 0.0, -min(lowest))
        return ActorShape(name, float(mass), offset, tip, np.array(heel, dtype=np.float64))

    @staticmethod
    def reference(height: float = 1.75, mass: float = 70.0) -> ActorShape:
        """The reference actor (version :data:`REFERENCE_ACTOR`), or one of another size."""
        return _reference(height, mass)

    @property
    def leg_length(self) -> float:
        """Hip joint to floor in the zero pose, mean of both sides."""
        hips = [SEGMENT["left_thigh"], SEGMENT["right_thigh"]]
        return float(self.offset[0, 2] + self.offset[hips, 2].mean())

    @property
    def height(self) -> float:
        """Floor to the top of the head in the zero pose."""
        chain = [SEGMENT[s] for s in ("pelvis", "abdomen", "chest", "head")]
        return float(self.offset[chain, 2].sum() + self.tip[SEGMENT["head"], 2])

    @cached_property
    def _tree(self) -> Tree:
        axis, zero = np.array([0.0, 0.0, 1.0]), np.zeros(3)
        joints = [Joint("free", 1, 0, 0, axis, zero)] + [
            Joint("ball", body, 7 + 4 * (body - 2), 6 + 3 * (body - 2), axis, zero)
            for body in range(2, 19)
        ]
        return Tree(
            parent=np.array([0, *(p + 1 for p in PARENTS)], dtype=np.int64),
            offset=np.concatenate([np.zeros((1, 3)), self.offset]),
            rotation=np.tile([1.0, 0.0, 0.0, 0.0], (19, 1)),
            joints=tuple(joints),
        )

    def tree(self) -> Tree:
        """The articulated tree: body ``i + 1`` is segment ``i``; nq = 75, nv = 57."""
        return self._tree

    def contact_points(self) -> tuple[Ints, Floats]:
        """Segment (10,) and local position (10, 3) of each of :data:`CONTACT_POINTS`."""
        size = self.height / 1.75
        segment, local = [], []
        for i, side in enumerate(("left", "right")):
            foot = SEGMENT[f"{side}_foot"]
            segment += [foot, foot]
            local += [self.heel[i], self.tip[foot]]
        for side in ("left", "right"):
            hand = SEGMENT[f"{side}_hand"]
            segment.append(hand)
            local.append(0.6 * self.tip[hand])  # the palm's far end, below the knuckles
        for side in ("left", "right"):
            segment.append(SEGMENT[f"{side}_shank"])
            local.append(np.array([0.055, 0.0, 0.0]) * size)  # front of the kneecap
        segment += [SEGMENT["pelvis"], SEGMENT["head"]]
        # The seat: ischial tuberosities, below and behind the hip joints, with soft tissue.
        local += [np.array([-0.06, 0.0, -0.10]) * size, self.tip[SEGMENT["head"]]]
        return np.array(segment, dtype=np.int64), np.array(local)


@dataclass(frozen=True, kw_only=True, eq=False)
class ActorMotion:
    """An actor's motion over T frames at a uniform rate.

    ``qpos`` (T, 75) of ``shape.tree()``; ``valid`` (T,) is False where the capture could not
    support a pose (what stands there is interpolated and must not be trusted);
    ``marker_error_rms`` in metres, None where no markers were fitted; ``notes`` state in one
    sentence each what was guessed or repaired, ``doubts`` are those of them after which the motion
    is not to be trusted unseen.
    """

    shape: ActorShape
    time: Floats
    qpos: Floats
    fps: float
    valid: Bools
    marker_error_rms: float | None
    source: Source
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()

    def on(self, shape: ActorShape) -> ActorMotion:
        """The same motion on another actor.

        Joint rotations are carried over; the root's path is scaled by the ratio of leg
        lengths, so that crouch, step and jump keep their meaning.

        Args:
            shape: Proportions of the other actor.

        Returns:
            The motion on that actor, same frames and time.
        """
        qpos = self.qpos.copy()
        qpos[:, :3] *= shape.leg_length / self.shape.leg_length
        return replace(self, shape=shape, qpos=qpos)

    def cut(self, first: int, last: int) -> ActorMotion:
        """Frames ``first`` to ``last`` inclusive; time starts at 0 again.

        Args:
            first: First frame kept.
            last: Last frame kept.

        Returns:
            The part, its time from 0 s.
        """
        frames = slice(first, last + 1)
        return replace(
            self,
            time=self.time[frames] - self.time[first],
            qpos=self.qpos[frames],
            valid=self.valid[frames],
        )

    def resampled(self, fps: float) -> ActorMotion:
        """The same motion at another rate: positions linearly, rotations along great arcs.

        Args:
            fps: Frames per second of the result.

        Returns:
            The motion at that rate, same start.
        """
        if not (np.isfinite(fps) and fps > 0):
            raise UsageError(f"A frame rate must be a positive number, not {fps}.")
        if len(self.time) < 2 or fps == self.fps:
            return self
        count = int(np.floor((len(self.time) - 1) * fps / self.fps + 1e-6)) + 1
        time = np.arange(count) / fps
        return replace(self.played(time), time=time, fps=fps)

    def played(self, clock: Floats) -> ActorMotion:
        """The motion as it is at the times ``clock`` (N,) s, which become its frames.

        Args:
            clock: (N,) times in s, within the motion.

        Returns:
            N frames, one at each time.
        """
        count, time = len(clock), np.arange(len(clock)) / self.fps
        at = np.clip(clock * self.fps, 0, len(self.time) - 1)
        before = np.minimum(at.astype(np.int64), len(self.time) - 2)
        share = at - before
        start, end = self.qpos[before], self.qpos[before + 1]
        quats = [q[:, 3:].reshape(count, 18, 4) for q in (start, end)]
        turns = continuous(slerp(quats[0], quats[1], np.tile(share[:, None], 18)))
        place = start[:, :3] + share[:, None] * (end[:, :3] - start[:, :3])
        # A new frame is as good as the old frames that it is made of.
        valid = (self.valid[before] | (share > 1 - 1e-6)) & (
            self.valid[before + 1] | (share < 1e-6)
        )
        moved = np.concatenate([place, turns.reshape(count, 72)], axis=1)
        return replace(self, time=time, qpos=moved, valid=valid)


def _reference(height: float, mass: float) -> ActorShape:
    """Proportions of a standing adult, as shares of the height.

    Leg heights (ankle 0.039, knee 0.285, hip 0.530) and foot length (0.152) from Drillis and
    Contini 1966, as in Winter, Biomechanics and Motor Control of Human Movement, 4th ed.,
    fig. 4.1. Trunk, arm and hand lengths between joint centres from de Leva, J. Biomech. 29
    (1996), table 4 (males, 1.741 m), the trunk and head fitted into the remaining 0.470. The
    abdomen bends at the omphalion and the chest at the xiphion, where de Leva cuts the trunk.
    Depths (x) and the widths of hips and shoulders are joint centres of an average adult;
    a fit replaces them by the capture's own.
    """
    h = height
    trunk = 0.470 * h / 846.2  # de Leva's mid-hip to vertex, millimetres
    arm = h / 1741.0
    offset, tip = np.zeros((18, 3)), np.zeros((18, 3))
    offset[SEGMENT["abdomen"]] = (-0.010 * h, 0.0, 145.7 * trunk)
    offset[SEGMENT["chest"]] = (0.0, 0.0, 215.5 * trunk)
    offset[SEGMENT["head"]] = (0.0, 0.0, 242.1 * trunk)
    tip[SEGMENT["head"]] = (0.015 * h, 0.0, 242.9 * trunk)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for part, place in (
            ("clavicle", (0.020 * h, sign * 0.012 * h, 165.0 * trunk)),
            ("upper_arm", (-0.012 * h, sign * 0.093 * h, -5.0 * trunk)),
            ("forearm", (0.0, 0.0, -281.7 * arm)),
            ("hand", (0.0, 0.0, -268.9 * arm)),
            ("thigh", (0.0, sign * 0.050 * h, 0.0)),
            ("shank", (0.0, 0.0, -0.245 * h)),
            ("foot", (0.0, 0.0, -0.246 * h)),
        ):
            offset[SEGMENT[f"{side}_{part}"]] = place
        tip[SEGMENT[f"{side}_hand"]] = (0.0, 0.0, -187.9 * arm)
        # Heel a fifth of the foot behind the ankle, ball of the toes at 73 % of its length.
        tip[SEGMENT[f"{side}_foot"]] = (0.53 * 0.152 * h, 0.0, -0.039 * h)
    heel = np.tile([-0.20 * 0.152 * h, 0.0, -0.039 * h], (2, 1))
    return ActorShape.standing(f"reference {REFERENCE_ACTOR}", mass, offset, tip, heel)
