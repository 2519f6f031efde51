"""The lowest point of every geom, against MuJoCo's own collision with a plane."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from physretarget import kinematics
from physretarget.ground.contacts import find_contacts
from physretarget.ground.undersides import lowest_heights, solids, undersides
from physretarget.mjcf import Character

SHAPES = {
    "sphere": 'type="sphere" size=".07"',
    "capsule": 'type="capsule" size=".03 .1"',
    "cylinder": 'type="cylinder" size=".06 .09"',
    "ellipsoid": 'type="ellipsoid" size=".03 .07 .12"',
    "box": 'type="box" size=".05 .02 .11"',
    "mesh": 'type="mesh" mesh="wedge"',
}
XML = """<mujoco><asset><mesh name="wedge"
 vertex="0 0 0  .1 0 0  0 .08 0  0 0 .12  .05 .05 .05"/></asset><worldbody>
<geom name="floor" type="plane" size="5 5 .1" margin="9"/>
<body name="thing" pos="0 0 1"><freejoint/>
<geom name="it" {shape} pos=".02 -.03 .05" euler="20 -30 40" margin="9" mass="1"/>
</body></worldbody></mujoco>"""


@pytest.mark.parametrize("shape", sorted(SHAPES))
def test_lowest_points_are_those_of_mujocos_collision(shape: str) -> None:
    character = Character.from_xml(XML.format(shape=SHAPES[shape]), name=shape)
    rng = np.random.default_rng(0)
    qpos = np.zeros((40, 7))
    qpos[:, :3] = rng.uniform(0.0, 1.0, (40, 3))
    qpos[:, 3:] = rng.normal(size=(40, 4))
    qpos[:, 3:] /= np.linalg.norm(qpos[:, 3:], axis=1, keepdims=True)
    pose = kinematics.forward(character.tree, qpos)
    every = solids(character)
    assert [s.name for s in every] == ["it"]
    found = lowest_heights(every, pose)[:, 0]
    data = mujoco.MjData(character.model)
    for height, one in zip(found, qpos, strict=True):
        data.qpos[:] = one
        mujoco.mj_kinematics(character.model, data)
        mujoco.mj_collision(character.model, data)
        assert height == pytest.approx(min(c.dist for c in data.contact), abs=1e-6)


def test_undersides_are_the_points_of_those_heights() -> None:
    character = Character.from_xml(XML.format(shape=SHAPES["capsule"]), name="capsule")
    (solid,) = solids(character)
    qpos = np.array([[0.1, 0.2, 0.9, 0.5, -0.5, 0.1, 0.7]])
    qpos[:, 3:] /= np.linalg.norm(qpos[:, 3:])
    pose = kinematics.forward(character.tree, qpos)
    under = solid.undersides(pose.rotation[0, solid.body, 2])
    bodies = np.full(len(under), solid.body)
    world = kinematics.points(pose, bodies, under)[0]
    np.testing.assert_allclose(world[:, 2], solid.heights(pose)[0], atol=1e-12)


def test_only_the_bodies_asked_for_and_no_planes() -> None:
    character = Character.from_xml(XML.format(shape=SHAPES["box"]), name="box")
    assert solids(character, [0]) == ()
    pose = kinematics.forward(character.tree, character.reference_qpos[None])
    assert lowest_heights((), pose).shape == (1, 0)


@pytest.mark.parametrize("shape", ["sphere", "capsule", "box", "mesh"])
def test_contacts_lie_where_mujoco_has_them_in_a_soft_floor(shape: str) -> None:
    character = Character.from_xml(
        XML.format(shape=SHAPES[shape]).replace(' margin="9"', ""), name=shape
    )
    rng = np.random.default_rng(1)
    qpos = np.zeros((30, 7))
    qpos[:, 3:] = rng.normal(size=(30, 4))
    qpos[:, 3:] /= np.linalg.norm(qpos[:, 3:], axis=1, keepdims=True)
    low = lowest_heights(solids(character), kinematics.forward(character.tree, qpos))[:, 0]
    qpos[:, 2] -= low + rng.uniform(0.0005, 0.02, 30)
    pose = kinematics.forward(character.tree, qpos)
    contacts = find_contacts(undersides(character), pose, 0.0, 0.001)
    data = mujoco.MjData(character.model)
    for t, one in enumerate(qpos):
        data.qpos[:] = one
        mujoco.mj_kinematics(character.model, data)
        mujoco.mj_collision(character.model, data)
        ours = contacts.position[t, contacts.mask[t]]
        for contact in data.contact:
            assert np.linalg.norm(ours - contact.pos, axis=1).min() < 1e-5
