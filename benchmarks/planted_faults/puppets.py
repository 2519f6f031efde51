"""Motions whose physics is known on paper: statues that lean, and a six-legged walker.

The walker's feet are planted exactly (two links per leg, solved in closed form), its trunk moves
as told, and with three feet on the floor nothing it does is against physics until a fault is
planted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from physretarget.demo import models_folder
from physretarget.mjcf import Character

Array = NDArray[np.float64]

LINK, RADIUS, FRICTION = 0.2, 0.02, 0.6
ROWS, WIDTH = (-0.35, 0.0, 0.35), 0.22
STRIDE_TIME, DUTY, LIFT = 0.9, 0.6, 0.05


def _six_legs() -> str:
    legs = "".join(
        f"""<body pos="{x} {y} 0"><joint name="{side}_{row}_hip" axis="0 1 0" range="-1.6 1.6"/>
    <geom type="capsule" fromto="0 0 0 0 0 {-LINK}" size="{RADIUS}" mass="0.15" contype="0"
          conaffinity="0"/>
    <body pos="0 0 {-LINK}"><joint name="{side}_{row}_knee" axis="0 1 0" range="-2.7 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 {-LINK}" size="{0.7 * RADIUS}" mass="0.1"
            contype="0" conaffinity="0"/>
      <geom type="sphere" pos="0 0 {-LINK}" size="{RADIUS}" mass="0.02"/></body></body>"""
        for row, x in enumerate(ROWS)
        for side, y in (("left", WIDTH), ("right", -WIDTH))
    )
    return f"""<mujoco model="six_legged_puppet"><compiler angle="radian" autolimits="true"/>
  <default><geom friction="{FRICTION} 0.005 0.0001"/>
    <joint damping="0.05" armature="0.001" actuatorfrcrange="-60 60"/></default>
  <worldbody><geom name="floor" type="plane" size="20 20 .1"/>
    <body name="trunk" pos="0 0 0.34"><freejoint name="root"/>
      <geom type="box" size="0.45 0.12 0.05" mass="14"/>{legs}</body></worldbody></mujoco>"""


BIPED = """<mujoco model="statue"><compiler angle="radian" autolimits="true"/>
  <worldbody><geom name="floor" type="plane" size="20 20 .1"/>
    <body name="trunk" pos="0 0 0.65"><freejoint name="root"/>
      <geom type="box" size="0.08 0.13 0.2" pos="0 0 0.22" mass="20"/>
      {legs}</body></worldbody></mujoco>""".replace(
    "{legs}",
    "".join(
        f"""<body pos="0 {y} 0"><joint name="{side}_hip" axis="0 1 0" range="-2 2"/>
      <geom type="capsule" fromto="0 0 -.05 0 0 -.55" size=".04" mass="5"/>
      <body pos="0 0 -.6"><joint name="{side}_ankle" axis="0 1 0" range="-1.2 1.2"/>
        <geom type="box" size=".11 .05 .02" pos="0.04 0 -.03" mass="1"/></body></body>"""
        for side, y in (("left", 0.1), ("right", -0.1))
    ),
)


@cache
def six_legs() -> Character:
    return Character.from_xml(_six_legs(), name="six_legged_puppet")


@cache
def biped() -> Character:
    return Character.from_xml(BIPED, name="statue")


@cache
def lamp() -> Character:
    return Character.load(models_folder() / "lamp.xml")


def posed(trunk: Array, feet: Array) -> Array:
    """Poses of the six-legged puppet, trunk level.

    Args:
        trunk: (T, 3) position (m).
        feet: (T, 6, 3) centres of the feet (m), row by row, left before right.
    """
    qpos = np.zeros((len(trunk), 7 + 12))
    qpos[:, :3], qpos[:, 3] = trunk, 1.0
    hips = np.array([[x, y, 0] for x in ROWS for y in (WIDTH, -WIDTH)])
    for leg, hip in enumerate(hips):
        way = feet[:, leg] - trunk - hip
        reach = np.hypot(way[:, 0], way[:, 2])
        if reach.max() > 2 * LINK:
            raise ValueError("a foot is out of the leg's reach")
        knee = -2 * np.arccos(reach / (2 * LINK))
        qpos[:, 7 + 2 * leg] = np.arctan2(-way[:, 0], -way[:, 2]) - knee / 2
        qpos[:, 8 + 2 * leg] = knee
    return qpos


def standing_feet(time: Array) -> Array:
    feet = np.array([[x, y, RADIUS] for x in ROWS for y in (WIDTH, -WIDTH)])
    return np.broadcast_to(feet, (len(time), 6, 3)).copy()


def walk(time: Array, speed: float = 0.3, height: float = 0.33) -> Array:
    """Two tripods in turn, the trunk at constant speed; feet touch down without impact."""
    trunk = np.stack([speed * time, 0 * time, 0 * time + height], axis=1)
    feet = standing_feet(time)
    for leg in range(6):
        row, side = divmod(leg, 2)
        cycles = time / STRIDE_TIME + (0.5 if (row + side) % 2 else 0.0) + 0.25
        phase, turn = cycles % 1.0, np.floor(cycles)
        swing = np.clip((phase - DUTY) / (1 - DUTY), 0, 1)
        # Quintic forwards, and upwards with no speed and no acceleration at either end.
        forward = swing**3 * (10 - 15 * swing + 6 * swing**2)
        up = 64 * (swing * (1 - swing)) ** 3
        stride = speed * STRIDE_TIME
        middle = turn + DUTY / 2 - (0.5 if (row + side) % 2 else 0.0) - 0.25
        feet[:, leg, 0] += stride * (middle + forward)
        feet[:, leg, 2] += LIFT * up
    return posed(trunk, feet)


def crouching(time: Array, fall: float, depth: float = 0.07) -> Array:
    """Feet planted, the trunk sinks and rises: the floor would have to pull by ``fall`` BW.

    The greatest downward acceleration is (1 + ``fall``) g of the whole; feet and shanks, which
    stay or nearly so, are a tenth of it.
    """
    pace = np.sqrt(2 * 9.81 * (1 + fall) / depth)
    trunk = np.stack([0 * time, 0 * time, 0.36 - depth * (1 - np.cos(pace * time)) / 2], axis=1)
    return posed(trunk, standing_feet(time))


def swaying(time: Array, demand: float, pace: float = 9.0) -> Array:
    """Feet planted, the trunk to and fro: it takes ``demand`` times the friction there is."""
    swing = demand * FRICTION * 9.81 / pace**2
    trunk = np.stack([swing * np.sin(pace * time), 0 * time, 0 * time + 0.3], axis=1)
    return posed(trunk, standing_feet(time))


@dataclass(frozen=True, eq=False)
class Statue:
    """A body that can lean with its feet flat.

    Attributes:
        character: which.
        pose: lean (rad) → (nq,) pose.
    """

    character: Character
    pose: Callable[[float], Array]

    @property
    def toe(self) -> float:
        """The foremost point of the floor that upright feet touch (m along x), by MuJoCo."""
        model = _with_floor(self.character)
        data = mujoco.MjData(model)
        data.qpos[:] = self.pose(0.0)
        data.qpos[2] -= 5e-4
        mujoco.mj_forward(model, data)
        return max(float(c.pos[0]) for c in data.contact if 0 in model.geom_bodyid[c.geom].tolist())

    def past_toe(self, lean: float) -> float:
        """How far the centre of mass is beyond the toe (m)."""
        data = mujoco.MjData(self.character.model)
        data.qpos[:] = self.pose(lean)
        mujoco.mj_kinematics(self.character.model, data)
        mujoco.mj_comPos(self.character.model, data)
        return float(data.subtree_com[self.character.root_body, 0]) - self.toe

    def lean_for(self, past: float) -> float | None:
        """The lean (rad) that puts the centre of mass so far beyond the toe (m), if any."""
        low, high = 0.0, 1.2
        if self.past_toe(high) < past:
            return None
        for _ in range(40):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.past_toe(middle) < past else (low, middle)
        return high


def _with_floor(character: Character) -> mujoco.MjModel:
    if character.has_floor:
        return character.model
    spec = mujoco.MjSpec.from_file(str(character.path))
    floor = spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE)
    floor.size = [20, 20, 0.1]
    model: mujoco.MjModel = spec.compile()
    return model


def ankle_statue(character: Character, upright: Array, ankles: tuple[str, str]) -> Statue:
    """Leans about its ankles, whose axes point to the left; the feet stay where they are."""
    model = character.model
    data = mujoco.MjData(model)
    data.qpos[:] = upright
    mujoco.mj_kinematics(model, data)
    pivot = data.xanchor[[model.joint(n).id for n in ankles]].mean(axis=0)

    def pose(lean: float) -> Array:
        qpos = upright.copy()
        turn, both = np.array([np.cos(lean / 2), 0, np.sin(lean / 2), 0]), np.zeros(4)
        mujoco.mju_mulQuat(both, turn, upright[3:7])
        out = np.zeros(3)
        mujoco.mju_rotVecQuat(out, upright[:3] - pivot, turn)
        qpos[:3], qpos[3:7] = pivot + out, both
        for name in ankles:
            qpos[model.joint(name).qposadr[0]] -= lean
        return qpos

    return Statue(character, pose)


def biped_statue() -> Statue:
    character = biped()
    return ankle_statue(character, character.reference_qpos.copy(), ("left_ankle", "right_ankle"))


def lamp_statue() -> Statue:
    """The lamp with a straight arm, which leans on a base that stays flat."""
    character = lamp()
    upright = character.model.qpos0.copy()
    upright[7:] = 0.0

    def pose(lean: float) -> Array:
        qpos: Array = upright.copy()
        qpos[character.model.joint("base_pitch").qposadr[0]] = lean
        return qpos

    return Statue(character, pose)


def g1_statue(character: Character) -> Statue:
    """The G1 upright with straight legs, its soles on the floor."""
    upright = character.model.qpos0.copy()
    upright[2] -= g1_clearance(character, upright[None])[0]
    return ankle_statue(character, upright, ("left_ankle_pitch_joint", "right_ankle_pitch_joint"))


def g1_clearance(character: Character, qpos: Array) -> Array:
    """(T,) height of the lower sole above the floor (m), negative in it."""
    model = _with_floor(character)
    data = mujoco.MjData(model)
    floor, ends = model.geom("floor").id, np.zeros(6)
    feet = [model.geom(f"{side}_foot_collision").id for side in ("left", "right")]
    heights = []
    for pose in qpos:
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        heights.append(min(mujoco.mj_geomDistance(model, data, floor, f, 5.0, ends) for f in feet))
    return np.array(heights)
