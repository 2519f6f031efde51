"""The bodies that are simulated: the shipped characters, the G1, and small ones of other kinds.

Every subject is built from one random generator: sizes, masses, friction and the softness of the
floor differ from build to build. The model that is simulated is the model that clips are judged
with, but for the floor, which the G1's file does not have.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from physretarget.demo import models_folder
from physretarget.mjcf import Character

SOFTNESS = ("0.02 1", "0.02 1", "0.01 1", "0.005 1", "0.04 1", "0.02 0.5")
"""MuJoCo's solref (time constant s, damping ratio); the first two are its default."""
IMPEDANCE = ("0.9 0.95 0.001", "0.9 0.95 0.001", "0.99 0.999 0.0005", "0.8 0.9 0.002")
"""MuJoCo's solimp: its default, a stiffer floor, one that gives way."""
STEPS = (3000, 6000)
"""Steps of the simulation per second: all frame rates divide them."""
WHIPPY = 12000
"""Steps for light links that whirl: with fewer, angular momentum is not kept."""


@dataclass(frozen=True, eq=False)
class Subject:
    """A character ready to be simulated.

    Attributes:
        name: of its kind.
        character: what clips are judged with.
        model: what MuJoCo simulates: the same model, with a floor.
        text: the character's MJCF.
        crouch: joint name → angle (rad) or length (m) of a deep crouch; empty where it has none.
        spin: names of joints that turn without end (wheels).
        radius: of what rolls (m); 0 where nothing does.
        steps: of the simulation, per second.
    """

    name: str
    character: Character
    model: mujoco.MjModel
    text: str
    crouch: Mapping[str, float] = field(default_factory=dict)
    spin: tuple[str, ...] = ()
    radius: float = 0.0
    steps: int = 3000


Made = tuple[str, dict[str, float]]
"""MJCF and the crouch of a small body."""
FLOOR = '<geom name="floor" type="plane" size="20 20 .1"/>'


def _text(
    name: str, rng: Generator, body: str, joint: str = "", *, contact: str = "", asset: str = ""
) -> str:
    """An MJCF file around a body that stands on z = 0; ``contact`` is said of all geoms."""
    friction, soft = rng.uniform(0.3, 1.2), rng.choice(SOFTNESS)
    integrator = rng.choice(("implicitfast", "Euler"))
    cone, dimensions = rng.choice(("pyramidal", "elliptic")), rng.choice((3, 3, 3, 4, 6))
    impedance, ratio = rng.choice(IMPEDANCE), rng.choice((1, 1, 10))
    twist, roll = rng.choice((0.005, 0.02)), rng.choice((0.0001, 0.002))
    contact = contact or f'condim="{dimensions}"'
    return f"""<mujoco model="{name}">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.002" integrator="{integrator}" cone="{cone}" impratio="{ratio}"/>
  {asset}
  <default>
    <geom friction="{friction:.3f} {twist} {roll}" solref="{soft}" solimp="{impedance}" {contact}/>
    <joint damping="0.05" armature="0.002" {joint}/>
  </default>
  <worldbody>{FLOOR}{body}</worldbody>
</mujoco>"""


def _legs(rng: Generator, rows: tuple[float, ...], length: float, width: float) -> str:
    """Pairs of legs of hip, knee and a round foot, at these x; ``length`` m of either link."""
    radius, density = 0.12 * length, rng.uniform(500, 1500)
    legs = []
    for row, x in enumerate(rows):
        for side, y in (("left", width), ("right", -width)):
            name = f"{side}_{row}"
            legs.append(f"""
    <body pos="{x} {y} 0"><joint name="{name}_splay" axis="1 0 0" range="-.6 .6"/>
      <joint name="{name}_hip" axis="0 1 0" range="-1.6 1.6"/>
      <geom type="capsule" fromto="0 0 {-radius} 0 0 {-length}" size="{radius}"
            density="{density}"/>
      <body pos="0 0 {-length}"><joint name="{name}_knee" axis="0 1 0" range="-2.5 0.05"/>
        <geom type="capsule" fromto="0 0 0 0 0 {-length}" size="{0.7 * radius}"
              density="{density}"/></body></body>""")
    return "".join(legs)


def _walker(name: str, rows: tuple[float, ...]) -> Callable[[Generator], Made]:
    def build(rng: Generator) -> Made:
        size = rng.uniform(0.5, 1.6)
        length, width = 0.2 * size, rng.uniform(0.09, 0.16) * size
        half = max(map(abs, rows)) * size + 0.05 * size
        places = tuple(x * size for x in rows)
        body = f"""<body name="trunk" pos="0 0 {2 * length}"><freejoint name="root"/>
    <geom type="box" size="{half} {0.7 * width} {0.05 * size}" density="{rng.uniform(400, 1200)}"/>
    {_legs(rng, places, length, width)}</body>"""
        joints = [f"{side}_{row}" for row in range(len(rows)) for side in ("left", "right")]
        bend = {f"{j}_hip": 0.9 for j in joints} | {f"{j}_knee": -1.8 for j in joints}
        strength = 40 * size**4 * rng.uniform(0.7, 1.5)
        return _text(name, rng, body, f'actuatorfrcrange="-{strength} {strength}"'), bend

    return build


def _wheels(rng: Generator) -> Made:
    size = rng.uniform(0.4, 1.5)
    radius, x, y = 0.08 * size, 0.2 * size, 0.17 * size
    shape = rng.choice(("cylinder", "capsule"))
    wheels = "".join(
        f"""<body pos="{i * x} {j * y} 0"><joint name="wheel_{i}_{j}" axis="0 1 0"/>
    <geom type="{shape}" fromto="0 {-0.02 * size} 0 0 {0.02 * size} 0" size="{radius}"
          density="800"/></body>"""
        for i in (-1, 1) for j in (-1, 1)
    )  # fmt: skip
    mast = rng.uniform(0.2, 0.5) * size
    body = f"""<body name="cart" pos="0 0 {radius}"><freejoint name="root"/>
    <geom type="box" size="{1.2 * x} {0.7 * y} {0.04 * size}" pos="0 0 {0.05 * size}"
          density="{rng.uniform(300, 900)}"/>{wheels}
    <body pos="0 0 {0.1 * size}"><joint name="mast_pitch" axis="0 1 0" range="-1.2 1.2"/>
      <joint name="mast_roll" axis="1 0 0" range="-1.2 1.2"/>
      <geom type="capsule" fromto="0 0 0 0 0 {mast}" size="{0.03 * size}" density="700"/>
    </body></body>"""
    return _text("wheels", rng, body), {}


def _arm(rng: Generator) -> Made:
    size = rng.uniform(0.5, 1.5)
    link, foot = 0.25 * size, rng.uniform(0.12, 0.2) * size
    base = rng.choice(("cylinder", "box"))
    extent = f"{foot} {0.03 * size}" if base == "cylinder" else f"{foot} {foot} {0.03 * size}"
    body = f"""<body name="base" pos="0 0 {0.03 * size}"><freejoint name="root"/>
    <geom type="{base}" size="{extent}" density="{rng.uniform(1500, 4000)}"/>
    <body pos="0 0 {0.04 * size}"><joint name="turn" axis="0 0 1"/>
      <joint name="shoulder" axis="0 1 0" range="-1.5 1.5"/>
      <geom type="capsule" fromto="0 0 {0.06 * size} 0 0 {link}" size="{0.035 * size}"/>
      <body pos="0 0 {link}"><joint name="elbow" axis="0 1 0" range="-2.6 2.6"/>
        <geom type="capsule" fromto="0 0 {0.06 * size} 0 0 {link}" size="{0.03 * size}"/>
        <body pos="0 0 {link}"><joint name="wrist" axis="1 0 0" range="-1.5 1.5"/>
          <geom type="box" size="{0.06 * size} {0.02 * size} {0.05 * size}" pos="0 0 {0.05 * size}"
                density="600"/></body></body></body></body>"""
    return _text("arm", rng, body), {"shoulder": -0.7, "elbow": 1.5}


def _ball(rng: Generator) -> Made:
    radius = rng.uniform(0.05, 0.3)
    inner = 0.3 * radius
    body = f"""<body name="ball" pos="0 0 {radius}"><freejoint name="root"/>
    <geom type="sphere" size="{radius}" density="{rng.uniform(100, 1200)}"/>
    <body name="heart" pos="0 0 {-0.2 * radius}">
      <joint name="beat" type="slide" axis="0 0 1" range="{-inner} {2 * inner}"/>
      <geom type="sphere" size="{inner}" density="{rng.uniform(4000, 9000)}"
            contype="0" conaffinity="0"/></body></body>"""
    return _text("ball", rng, body), {"beat": -0.9 * inner}


def _bird(rng: Generator) -> Made:
    size = rng.uniform(0.5, 1.5)
    link, density = 0.16 * size, rng.uniform(400, 1200)
    foot = rng.choice(
        (
            f'<geom type="box" size="{0.07 * size} {0.04 * size} {0.012 * size}" '
            f'pos="{0.01 * size} 0 {-0.01 * size}" density="900"/>',
            f'<geom type="capsule" fromto="{-0.05 * size} 0 0 {0.07 * size} 0 0" '
            f'size="{0.015 * size}" density="900"/>',
        )
    )
    legs = "".join(
        f"""<body pos="0 {y * size} 0"><joint name="{side}_splay" axis="1 0 0" range="-.5 .5"/>
    <joint name="{side}_hip" axis="0 1 0" range="-1.5 1.5"/>
    <geom type="capsule" fromto="0 0 0 0 0 {-0.8 * link}" size="{0.02 * size}" density="{density}"/>
    <body pos="0 0 {-link}"><joint name="{side}_knee" axis="0 1 0" range="-.1 2.4"/>
      <geom type="capsule" fromto="0 0 0 0 0 {-0.8 * link}" size="{0.015 * size}"
            density="{density}"/>
      <body pos="0 0 {-link}"><joint name="{side}_ankle" axis="0 1 0" range="-1.3 1.3"/>
        {foot}</body></body></body>"""
        for side, y in (("left", 0.07), ("right", -0.07))
    )
    body = f"""<body name="trunk" pos="0 0 {2 * link}"><freejoint name="root"/>
    <geom type="ellipsoid" size="{0.12 * size} {0.09 * size} {0.08 * size}"
          pos="0 0 {0.06 * size}" density="{rng.uniform(200, 600)}"/>{legs}
    <body pos="{0.08 * size} 0 {0.1 * size}"><joint name="neck" axis="0 1 0" range="-1.2 1.2"/>
      <geom type="capsule" fromto="0 0 0 {0.03 * size} 0 {0.12 * size}" size="{0.02 * size}"
            density="500"/></body></body>"""
    bend = {"hip": -0.7, "knee": 1.4, "ankle": -0.7}
    strength = 6 * size**4 * rng.uniform(0.7, 1.5)
    return _text("bird", rng, body, f'actuatorfrcrange="-{strength} {strength}"'), {
        f"{side}_{j}": a for side in ("left", "right") for j, a in bend.items()
    }


def _box(rng: Generator) -> Made:
    x, y, z = rng.uniform(0.05, 0.25, 3)
    body = f"""<body name="box" pos="0 0 {z}"><freejoint name="root"/>
    <geom type="box" size="{x} {y} {z}" density="{rng.uniform(200, 1500)}"/>
    <body pos="0 0 {z + 0.02}"><joint name="lid" axis="0 1 0" range="-1.4 1.4"/>
      <geom type="capsule" fromto="0 0 0 0 0 {1.5 * z}" size="{0.15 * min(x, y)}"/></body></body>"""
    return _text("box", rng, body), {}


def _snake(rng: Generator) -> Made:
    radius, length = rng.uniform(0.02, 0.05), rng.uniform(0.1, 0.2)
    links = 6
    inner = ""
    for i in reversed(range(1, links)):
        inner = f"""<body pos="{-length} 0 0">
      <joint name="yaw_{i}" axis="0 0 1" range="-1.2 1.2" pos="{length / 2} 0 0"/>
      <joint name="pitch_{i}" axis="0 1 0" range="-.8 .8" pos="{length / 2} 0 0"/>
      <geom type="capsule" fromto="{-length / 2 + radius} 0 0 {length / 2 - radius} 0 0"
            size="{radius}"/>{inner}</body>"""
    body = f"""<body name="head" pos="0 0 {radius}"><freejoint name="root"/>
    <geom type="capsule" fromto="{-length / 2 + radius} 0 0 {length / 2 - radius} 0 0"
          size="{radius}"/>{inner}</body>"""
    return _text("snake", rng, body), {}


def _turtle(rng: Generator) -> Made:
    """Nothing but convex meshes: a shell and four paddles that end in points."""
    size, density = rng.uniform(0.5, 1.5), rng.uniform(300, 1500)
    cloud = rng.normal(size=(40, 3))
    cloud /= np.linalg.norm(cloud, axis=1, keepdims=True)
    shell = cloud * [0.25 * size, 0.18 * size, 0.09 * size]
    paddle = rng.uniform(-1, 1, (10, 3)) * [0.04 * size, 0.025 * size, 0.015 * size]
    paddle = np.concatenate([paddle - [0, 0, 0.04 * size], [[0.01 * size, 0, -0.16 * size]]])

    def mesh(name: str, points: NDArray[np.float64]) -> str:
        inner = " ".join(f"{v:.5f}" for v in points.ravel())
        return f'<mesh name="{name}" vertex="{inner}"/>'

    limbs = "".join(
        f"""<body name="paddle_{i}_{j}" pos="{i * 0.15 * size} {j * 0.12 * size} 0">
      <joint name="swing_{i}_{j}" axis="0 1 0" range="-1 1"/>
      <joint name="splay_{i}_{j}" axis="1 0 0" range="-.8 .8"/>
      <geom type="mesh" mesh="paddle" density="{density}"/></body>"""
        for i in (-1, 1) for j in (-1, 1)
    )  # fmt: skip
    body = f"""<body name="shell" pos="0 0 {0.16 * size}"><freejoint name="root"/>
    <geom type="mesh" mesh="shell" density="{density}"/>{limbs}
    <body name="head" pos="{0.25 * size} 0 0"><joint name="neck" axis="0 1 0" range="-.9 .9"/>
      <geom type="mesh" mesh="paddle" density="{density}" euler="0 1.57 0"/></body></body>"""
    asset = f"<asset>{mesh('shell', shell)}{mesh('paddle', paddle)}</asset>"
    strength = 25 * size**4 * rng.uniform(0.7, 1.5)
    limit = f'actuatorfrcrange="-{strength} {strength}"'
    return _text("turtle", rng, body, limit, asset=asset), {}


def _rover(rng: Generator) -> Made:
    """Six cylinder wheels, the rear four on rockers."""
    size = rng.uniform(0.4, 1.5)
    radius, x, y = 0.07 * size, 0.22 * size, 0.18 * size
    wide = rng.uniform(0.01, 0.04) * size

    def wheel(name: str, at: float, side: float) -> str:
        return f"""<body pos="{at} {side} 0"><joint name="wheel_{name}" axis="0 1 0"/>
    <geom type="cylinder" fromto="0 {-wide} 0 0 {wide} 0" size="{radius}" density="900"/></body>"""

    sides = "".join(
        f"""{wheel(f"front_{j}", x, j * y)}
    <body pos="{-0.5 * x} {j * 0.7 * y} 0"><joint name="rocker_{j}" axis="0 1 0" range="-.4 .4"/>
      <geom type="capsule" fromto="{-0.5 * x} 0 0 {0.5 * x} 0 0" size="{0.015 * size}"/>
      {wheel(f"middle_{j}", 0.5 * x, j * 0.3 * y)}{wheel(f"rear_{j}", -0.5 * x, j * 0.3 * y)}
    </body>"""
        for j in (-1, 1)
    )
    body = f"""<body name="rover" pos="0 0 {radius}"><freejoint name="root"/>
    <geom type="box" size="{x} {0.6 * y} {0.03 * size}" pos="0 0 {0.06 * size}"
          density="{rng.uniform(300, 1200)}"/>{sides}</body>"""
    return _text("rover", rng, body), {}


def _marble(rng: Generator) -> Made:
    """A ball with rolling and torsional friction to speak of, and a weight in it off centre."""
    radius = rng.uniform(0.04, 0.25)
    body = f"""<body name="marble" pos="0 0 {radius}"><freejoint name="root"/>
    <geom type="sphere" size="{radius}" density="{rng.uniform(300, 2500)}"/>
    <body name="weight"><joint name="tilt" axis="0 1 0" range="-2 2"/>
      <joint name="lean" axis="1 0 0" range="-2 2"/>
      <geom type="sphere" size="{0.2 * radius}" pos="0 0 {-0.6 * radius}" density="8000"
            contype="0" conaffinity="0"/></body></body>"""
    rough, twist, roll = rng.uniform(0.3, 1.2), rng.uniform(0.05, 0.4), rng.uniform(0.005, 0.1)
    rubs = f'condim="6" friction="{rough:.3f} {twist * radius:.4f} {roll * radius:.5f}"'
    return _text("marble", rng, body.replace("<geom", f"<geom {rubs}")), {}


def _person(rng: Generator) -> Made:
    """A body with arms, a head, ball joints in hips and shoulders, and feet that are boxes."""
    size, density = rng.uniform(0.5, 1.2), rng.uniform(600, 1200)
    thigh, shin, arm = 0.42 * size, 0.42 * size, 0.28 * size

    def leg(side: str, y: float) -> str:
        return f"""<body pos="0 {y * 0.1 * size} 0"><joint name="{side}_hip" type="ball"
        range="0 1.6"/><geom type="capsule" fromto="0 0 {-0.07 * size} 0 0 {-0.9 * thigh}"
        size="{0.06 * size}"/>
    <body pos="0 0 {-thigh}"><joint name="{side}_knee" axis="0 1 0" range="-.05 2.4"/>
      <geom type="capsule" fromto="0 0 {-0.07 * size} 0 0 {-0.8 * shin}" size="{0.045 * size}"/>
      <body pos="0 0 {-shin}"><joint name="{side}_pitch" axis="0 1 0" range="-.9 .9"/>
        <joint name="{side}_roll" axis="1 0 0" range="-.4 .4"/>
        <geom type="box" size="{0.12 * size} {0.05 * size} {0.02 * size}"
              pos="{0.05 * size} 0 {-0.04 * size}"/></body></body></body>"""

    def hand(side: str, y: float) -> str:
        return f"""<body pos="0 {y * 0.2 * size} {0.45 * size}"><joint name="{side}_shoulder"
        type="ball" range="0 2"/><geom type="capsule" fromto="0 0 {-0.04 * size} 0 0 {-0.9 * arm}"
        size="{0.035 * size}"/><body pos="0 0 {-arm}">
      <joint name="{side}_elbow" axis="0 1 0" range="-2.4 .05"/>
      <geom type="capsule" fromto="0 0 {-0.04 * size} 0 0 {-arm}" size="{0.03 * size}"/>
    </body></body>"""

    body = f"""<body name="pelvis" pos="0 0 {thigh + shin + 0.06 * size}"><freejoint name="root"/>
    <geom type="box" size="{0.08 * size} {0.13 * size} {0.06 * size}"/>
    {leg("left", 1)}{leg("right", -1)}
    <body pos="0 0 {0.1 * size}"><joint name="waist" axis="0 1 0" range="-.5 1"/>
      <geom type="capsule" fromto="0 0 {0.08 * size} 0 0 {0.35 * size}" size="{0.11 * size}"/>
      {hand("left", 1)}{hand("right", -1)}
      <body pos="0 0 {0.5 * size}"><joint name="neck" axis="0 1 0" range="-.6 .6"/>
        <geom type="sphere" size="{0.1 * size}" pos="0 0 {0.1 * size}"/></body></body></body>"""
    body = body.replace("<geom", f'<geom density="{density:.0f}"')
    strength = 60 * size**4 * rng.uniform(0.7, 1.5)
    limit = f'actuatorfrcrange="-{strength} {strength}"'
    bend = {"knee": 1.2, "pitch": -0.6}
    return _text("person", rng, body, limit, contact='condim="3"'), {
        f"{side}_{j}": a for side in ("left", "right") for j, a in bend.items()
    }


def _coin(rng: Generator) -> Made:
    """A disc on its edge, with a hand that turns on it: rims and edges."""
    radius, half = rng.uniform(0.06, 0.3), rng.uniform(0.01, 0.04)
    body = f"""<body name="coin" pos="0 0 {radius}"><freejoint name="root"/>
    <geom type="cylinder" size="{radius} {half}" quat=".7071 .7071 0 0"
          density="{rng.uniform(300, 2500)}"/>
    <body name="hand" pos="0 {1.6 * half} 0"><joint name="turn" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 {0.6 * radius} 0 0" size="{0.3 * half}"/></body></body>"""
    return _text("coin", rng, body), {}


SMALL: Mapping[str, Callable[[Generator], Made]] = {
    "four legs": _walker("four_legs", (-0.22, 0.22)),
    "six legs": _walker("six_legs", (-0.3, 0.0, 0.3)),
    "wheels": _wheels,
    "arm": _arm,
    "ball": _ball,
    "bird": _bird,
    "box": _box,
    "snake": _snake,
    "turtle": _turtle,
    "rover": _rover,
    "marble": _marble,
    "person": _person,
    "coin": _coin,
}
SHIPPED: Mapping[str, Mapping[str, float]] = {
    "lamp": {"base_pitch": -0.5, "elbow_pitch": 2.2, "head_pitch": -1.0},
    "penguin": {f"{s}_{j}": a for s in ("left", "right") for j, a in
                {"hip_pitch": -1.1, "knee": 1.9, "ankle_pitch": -0.8}.items()},
    "squirrel": {f"{s}_{j}": a for s in ("left", "right") for j, a in
                 {"hip_pitch": -1.2, "knee": 2.0, "ankle_pitch": -0.8}.items()},
}  # fmt: skip
G1_CROUCH = {f"{s}_{j}_joint": a for s in ("left", "right") for j, a in
             {"hip_pitch": -0.7, "knee": 1.3, "ankle_pitch": -0.6}.items()}  # fmt: skip
NAMES = (*SHIPPED, "g1", *SMALL)
_PLAIN = 'friction="1 0.005 0.0001"'


def build(name: str, rng: Generator, g1: Path | None = None) -> Subject:
    """A subject of this kind.

    Args:
        name: one of ``NAMES``.
        rng: draws size, mass, friction and softness.
        g1: the G1's MJCF file; needed for "g1" only.
    """
    if name == "g1":
        if g1 is None:
            raise FileNotFoundError("the G1's MJCF file is not here")
        spec = mujoco.MjSpec.from_file(str(g1))
        floor = spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE)
        floor.size = [20, 20, 0.1]
        text = g1.read_text(encoding="utf-8")
        return Subject(name, Character.load(g1), spec.compile(), text, G1_CROUCH)
    if name in SHIPPED:
        text = (models_folder() / f"{name}.xml").read_text(encoding="utf-8")
        friction, soft = rng.uniform(0.4, 1.2), rng.choice(SOFTNESS)
        given = f'friction="{friction:.3f} 0.005 0.0001" solref="{soft}"'
        text = text.replace(_PLAIN, given)
        character = Character.from_xml(text, name=name)
        return Subject(name, character, character.model, text, SHIPPED[name])
    text, crouch = SMALL[name](rng)
    character = Character.from_xml(text, name=name.replace(" ", "_"))
    names = character.joint_names
    spin = tuple(n for n in names if n.startswith("wheel"))
    round_ones = ("wheels", "ball", "rover", "marble", "coin")
    radius = float(character.reference_qpos[2]) if name in round_ones else 0.0
    steps = WHIPPY if name == "snake" else int(rng.choice(STEPS))
    return Subject(name, character, character.model, text, crouch, spin, radius, steps)


def g1_file() -> Path | None:
    """The G1's file among the data, where that is here."""
    folder = os.environ.get("PHYSRETARGET_DATA")
    beside = Path(__file__).resolve().parents[3] / "shared" / "data"
    file = (Path(folder) if folder else beside) / "robot" / "g1_no_mesh_box_feet.xml"
    return file if file.is_file() else None


def generator(*keys: int | str) -> Generator:
    """A random generator that depends on these keys alone."""
    words = [k if isinstance(k, int) else int.from_bytes(k.encode(), "little") for k in keys]
    return np.random.default_rng(words)
