"""The actor as a character: an MJCF model built from a capture's proportions.

One code path gives momentum, inertia and features for actor and character alike (Yamane 2010,
section 5.1, needs both).
"""

from __future__ import annotations

from dataclasses import replace
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from physretarget.capture.actor import CONTACT_POINTS, PARENTS, SEGMENTS, ActorShape
from physretarget.mjcf.anthropometry import SegmentInertia, segment_inertias
from physretarget.mjcf.character import Character
from physretarget.mjcf.mannequin import feature_points, geoms
from physretarget.mjcf.points import Points

__all__ = ["actor_character", "actor_xml"]

SHOE_FRICTION = 1.0  # a choice of ours: rubber soles on a dry floor


def actor_character(shape: ActorShape) -> Character:
    """The actor's model: bodies, joints and qpos laid out as in ``shape.tree()``.

    Its contact points are ``CONTACT_POINTS`` in that order, each tied to itself.

    Args:
        shape: The actor's proportions.

    Returns:
        The character.
    """
    actor = Character.from_xml(actor_xml(shape), name=shape.name)
    order = [actor.tied.index(point) for point in CONTACT_POINTS]
    contacts = Points(
        tuple(actor.contacts.names[i] for i in order),
        actor.contacts.body[order],
        actor.contacts.local[order],
    )
    return replace(actor, contacts=contacts, tied=CONTACT_POINTS)


def actor_xml(shape: ActorShape) -> str:
    """The actor's MJCF text; the same proportions give the same text.

    Args:
        shape: The actor's proportions.

    Returns:
        MJCF.
    """
    inertias = segment_inertias(shape)
    looks, features = geoms(shape), feature_points(shape)
    touching, where = shape.contact_points()
    sites: dict[str, list[str]] = {name: [] for name in SEGMENTS}
    for name, points in features.items():
        sites[name] += [_site(f"marker_{name}_{i + 1}", point) for i, point in enumerate(points)]
    for point, segment, local in zip(CONTACT_POINTS, touching, where, strict=True):
        sites[SEGMENTS[segment]].append(_site(f"contact_{point}", local))

    def body(index: int) -> list[str]:
        name = SEGMENTS[index]
        kind = "free" if index == 0 else "ball"
        lines = [
            f'<body name="{name}" pos="{_numbers(shape.offset[index])}">',
            f'  <joint name="{name}" type="{kind}"/>',
            "  " + _inertial(inertias[index]),
            *("  " + line for line in looks[name] + sites[name]),
        ]
        for child in range(len(SEGMENTS)):
            if PARENTS[child] == index:
                lines += ["  " + line for line in body(child)]
        return [*lines, "</body>"]

    bodies = "\n    ".join(body(0))
    ties = "\n    ".join(
        f'<text name="contact_{point}" data="{point}"/>' for point in CONTACT_POINTS
    )
    return _FRAME.format(name=quoteattr(shape.name), friction=SHOE_FRICTION, ties=ties, body=bodies)


# Body parts touch the floor but not each other: the looks overlap at every joint.
_FRAME = """<mujoco model={name}>
  <compiler angle="radian" autolimits="true"/>
  <statistic meansize="0.08" extent="2"/>
  <visual>
    <headlight diffuse="0.45 0.45 0.45" ambient="0.35 0.35 0.35" specular="0.1 0.1 0.1"/>
    <quality shadowsize="4096"/>
    <global offwidth="1280" offheight="1280"/>
  </visual>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1="0.93 0.94 0.95"
             rgb2="0.70 0.74 0.79" width="64" height="384"/>
    <texture name="floor" type="2d" builtin="checker" rgb1="0.80 0.81 0.83"
             rgb2="0.76 0.77 0.79" width="256" height="256"/>
    <material name="floor" texture="floor" texrepeat="1 1" texuniform="true" reflectance="0.05"/>
    <material name="body" rgba="0.84 0.72 0.60 1" specular="0.25" shininess="0.35"/>
    <material name="dark" rgba="0.25 0.21 0.20 1" specular="0.6" shininess="0.7"/>
  </asset>
  <default>
    <geom material="body" contype="1" conaffinity="0"/>
    <site size="0.008" group="4"/>
  </default>
  <custom>
    <numeric name="front" data="1 0 0"/>
    <numeric name="up" data="0 0 1"/>
    {ties}
  </custom>
  <worldbody>
    <light pos="1.5 1.5 4" dir="-0.3 -0.3 -1" directional="true" diffuse="0.5 0.5 0.5"/>
    <geom name="floor" type="plane" size="0 0 0.5" material="floor" contype="1" conaffinity="1"
          friction="{friction}"/>
    {body}
  </worldbody>
</mujoco>
"""


def _inertial(part: SegmentInertia) -> str:
    tensor = part.inertia
    order = (tensor[0, 0], tensor[1, 1], tensor[2, 2], tensor[0, 1], tensor[0, 2], tensor[1, 2])
    return (
        f'<inertial pos="{_numbers(part.com)}" mass="{float(part.mass)!r}" '
        f'fullinertia="{_numbers(np.array(order))}"/>'
    )


def _site(name: str, at: NDArray[np.float64]) -> str:
    return f'<site name="{name}" pos="{_numbers(at)}"/>'


def _numbers(values: NDArray[np.float64]) -> str:
    return " ".join(repr(float(value)) for value in values)
