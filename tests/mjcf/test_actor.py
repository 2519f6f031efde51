from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from physretarget.capture.actor import (
    CONTACT_POINTS,
    SEGMENT,
    SEGMENTS,
    ActorShape,
)
from physretarget.kinematics import forward, integrate, points
from physretarget.mjcf import Character, actor_character, actor_xml
from physretarget.mjcf.anthropometry import segment_inertias

SHAPES = [
    ActorShape.reference(),
    ActorShape.reference(height=1.2, mass=25.0),
    ActorShape.reference(height=1.95, mass=110.0),
]


def lopsided() -> ActorShape:
    """A skeleton as found in the wild: no clavicles, slanted limbs, nothing symmetric."""
    shape = ActorShape.reference()
    offset = shape.offset + np.random.default_rng(2).normal(scale=0.02, size=(18, 3))
    for side in ("left", "right"):
        offset[SEGMENT[f"{side}_upper_arm"]] = 0.0
    return ActorShape.standing("lopsided", 60.0, offset, shape.tip, shape.heel)


@pytest.fixture(params=range(4))
def shape(request: pytest.FixtureRequest) -> ActorShape:
    return [*SHAPES, lopsided()][request.param]


def test_layout_is_that_of_the_shape(shape: ActorShape, rng: np.random.Generator) -> None:
    actor = actor_character(shape)
    tree = shape.tree()
    assert actor.joint_names == SEGMENTS
    assert [actor.model.body(i + 1).name for i in range(18)] == list(SEGMENTS)
    for mine, theirs in zip(actor.tree.joints, tree.joints, strict=True):
        assert (mine.kind, mine.body, mine.qpos, mine.dof) == (
            theirs.kind,
            theirs.body,
            theirs.qpos,
            theirs.dof,
        )
    qpos = integrate(tree, np.tile(actor.reference_qpos, (10, 1)), rng.normal(size=(10, tree.nv)))
    ours, theirs_pose = forward(actor.tree, qpos), forward(tree, qpos)
    np.testing.assert_allclose(ours.position, theirs_pose.position, atol=1e-12)
    np.testing.assert_allclose(ours.rotation, theirs_pose.rotation, atol=1e-12)


def test_masses_and_inertias_are_a_human_body(shape: ActorShape) -> None:
    actor = actor_character(shape)
    model = actor.model
    assert actor.mass == pytest.approx(shape.mass, rel=1e-12)
    for part, name in zip(segment_inertias(shape), SEGMENTS, strict=True):
        body = model.body(name).id
        assert model.body_mass[body] == pytest.approx(part.mass)
        a, b, c = np.sort(np.linalg.eigvalsh(part.inertia))
        assert a > 0
        assert a + b >= c * (1 - 1e-9), f"no body has the inertia of {name}"
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, model.body_iquat[body])
        axes = turn.reshape(3, 3)
        compiled = axes @ np.diag(model.body_inertia[body]) @ axes.T
        np.testing.assert_allclose(compiled, part.inertia, atol=1e-9)


def test_a_mass_may_come_from_a_numpy_computation() -> None:
    shape = replace(ActorShape.reference(), mass=np.float64(589.0) / 9.81)
    assert actor_character(shape).mass == pytest.approx(589.0 / 9.81)


def test_reference_actor_against_measured_people() -> None:
    """Whole-body figures from the literature, independent of the table."""
    actor = actor_character(ActorShape.reference())
    # Centre of mass of standing men: 55 to 58 % of the height.
    assert 0.55 < actor.com_height / 1.75 < 0.58
    data = mujoco.MjData(actor.model)
    mujoco.mj_forward(actor.model, data)
    inertia = np.zeros((3, 3))
    for body in actor.bodies:
        axes = data.ximat[body].reshape(3, 3)
        arm = data.xipos[body] - data.subtree_com[1]
        inertia += axes @ np.diag(actor.model.body_inertia[body]) @ axes.T
        inertia += actor.model.body_mass[body] * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    # Santschi, DuBois and Omoto 1963, 66 men of 75 kg on average, standing with arms at their
    # sides: 13.0, 11.6 and 1.28 kg m². Ours is lighter, 70 kg.
    assert 9.5 < inertia[0, 0] < 13.0
    assert 9.0 < inertia[1, 1] < 12.5
    assert 0.7 < inertia[2, 2] < 1.4


def test_left_and_right_are_mirrored() -> None:
    parts = dict(zip(SEGMENTS, segment_inertias(ActorShape.reference()), strict=True))
    mirror = np.diag([1.0, -1.0, 1.0])
    for name, part in parts.items():
        if name.startswith("left_"):
            other = parts[name.replace("left", "right")]
            np.testing.assert_allclose(part.com, mirror @ other.com, atol=1e-12)
            np.testing.assert_allclose(part.inertia, mirror @ other.inertia @ mirror, atol=1e-12)


def test_trunk_keeps_its_centre_with_the_clavicles_cut_out() -> None:
    shape = ActorShape.reference()
    parts = segment_inertias(shape)
    chest = SEGMENT["chest"]
    girdle = [SEGMENT["left_clavicle"], SEGMENT["right_clavicle"]]
    mass = parts[chest].mass + sum(parts[i].mass for i in girdle)
    assert mass == pytest.approx(0.1596 * 70)
    moment = parts[chest].mass * parts[chest].com
    moment = moment + sum(parts[i].mass * (shape.offset[i] + parts[i].com) for i in girdle)
    np.testing.assert_allclose(moment / mass, (1 - 0.5066) * shape.tip[chest], atol=1e-12)


def test_contact_points_are_tied_to_themselves(shape: ActorShape) -> None:
    actor = actor_character(shape)
    assert actor.tied == CONTACT_POINTS
    assert actor.contacts.names == tuple(f"contact_{name}" for name in CONTACT_POINTS)
    segment, local = shape.contact_points()
    np.testing.assert_array_equal(actor.contacts.body, segment + 1)
    np.testing.assert_allclose(actor.contacts.local, local, atol=1e-12)
    pose = forward(actor.tree, actor.reference_qpos[None])
    feet = points(pose, actor.contacts.body, actor.contacts.local)[0, :4, 2]
    assert feet.min() == pytest.approx(0.0, abs=1e-9)


def test_feature_points_are_the_same_on_every_actor(shape: ActorShape) -> None:
    actor, reference = actor_character(shape), actor_character(ActorShape.reference())
    assert actor.markers.names == reference.markers.names
    assert len(actor.markers) == 31
    np.testing.assert_array_equal(actor.markers.body, reference.markers.body)


def test_looks_fit_the_body() -> None:
    actor = actor_character(ActorShape.reference())
    assert actor.height == pytest.approx(1.75, abs=0.01)
    assert actor.has_floor
    assert not actor.notes
    data = mujoco.MjData(actor.model)
    data.qpos[:] = actor.reference_qpos
    mujoco.mj_forward(actor.model, data)
    depth = data.contact.dist[: data.ncon]
    assert depth.size == 0 or depth.min() > -2e-3  # the soles stand on the floor, not in it
    assert all(data.contact.geom[: data.ncon].min(axis=1) == 0)  # and nothing else touches


def test_odd_names_and_same_bytes() -> None:
    shape = replace(ActorShape.reference(), name='a "b" <c>&')
    assert Character.from_xml(actor_xml(shape)).name == 'a "b" <c>&'
    assert actor_xml(shape) == actor_xml(shape)
    assert actor_character(shape).sha256 == actor_character(shape).sha256
