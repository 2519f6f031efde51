from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from physretarget.keyposes.face import face_of
from physretarget.kinematics import forward, points
from physretarget.mjcf import Character

MODELS = Path(__file__).parents[1] / "models"
NAMES = ("lamp", "penguin", "squirrel")
# height of the geometry in the reference pose (m), mass (kg): what models/README.md says
SIZE = {"lamp": (0.5, 0.6, 3.7), "penguin": (0.5, 0.65, 7.2), "squirrel": (0.4, 0.55, 2.7)}


@pytest.fixture(params=NAMES)
def character(request: pytest.FixtureRequest) -> Character:
    return Character.load(MODELS / f"{request.param}.xml")


def test_sizes(character: Character) -> None:
    low, high, mass = SIZE[character.name]
    assert low < character.height < high
    assert character.mass == pytest.approx(mass, abs=0.1)


def test_nothing_had_to_be_assumed(character: Character) -> None:
    assert character.notes == ()
    assert character.has_root
    assert character.has_floor
    assert character.friction == 1.0
    np.testing.assert_allclose(character.front, [1, 0, 0])
    np.testing.assert_allclose(character.up, [0, 0, 1])


def test_every_hinge_is_limited_and_the_reference_pose_is_within(character: Character) -> None:
    hinges = [joint.qpos for joint in character.tree.joints if joint.kind == "hinge"]
    assert np.isfinite(character.lower[hinges]).all()
    assert np.isfinite(character.upper[hinges]).all()
    assert (character.reference_qpos >= character.lower).all()
    assert (character.reference_qpos <= character.upper).all()


def test_three_well_spread_markers_on_every_moving_body(character: Character) -> None:
    """IK needs them: the triangle of each body must be no sliver."""
    for body in character.bodies:
        of_body = character.markers.local[character.markers.body == body]
        assert len(of_body) == 3, character.model.body(body).name
        a, b = of_body[1] - of_body[0], of_body[2] - of_body[0]
        area = np.linalg.norm(np.cross(a, b)) / 2
        longest = max(np.linalg.norm(a), np.linalg.norm(b), np.linalg.norm(a - b))
        assert area > 0.1 * longest**2
        assert longest > 0.05


def test_feet_stand_flat_in_the_reference_pose(character: Character) -> None:
    pose = forward(character.tree, character.reference_qpos[None])
    place = points(pose, character.contacts.body, character.contacts.local)[0]
    feet = [i for i, tie in enumerate(character.tied) if tie and ("toe" in tie or "heel" in tie)]
    np.testing.assert_allclose(place[feet, 2], 0.0, atol=5e-4)


def test_centre_of_mass_is_over_the_feet(character: Character) -> None:
    data = mujoco.MjData(character.model)
    data.qpos[:] = character.reference_qpos
    mujoco.mj_forward(character.model, data)
    pose = forward(character.tree, character.reference_qpos[None])
    feet = [i for i, tie in enumerate(character.tied) if tie and ("toe" in tie or "heel" in tie)]
    place = points(pose, character.contacts.body, character.contacts.local)[0, feet]
    com = data.subtree_com[character.root_body]
    assert (com[:2] > place[:, :2].min(axis=0)).all()
    assert (com[:2] < place[:, :2].max(axis=0)).all()


def test_left_is_left(character: Character) -> None:
    """A point tied to the actor's left is on the character's left, toes are before heels."""
    pose = forward(character.tree, character.reference_qpos[None])
    place = points(pose, character.contacts.body, character.contacts.local)[0]
    where = dict(zip(character.tied, place, strict=True))
    for tie, at in where.items():
        assert tie is not None
        assert (at[1] > 0) == tie.startswith("left")
    for side in ("left", "right"):
        assert where[f"{side}_toe"][0] > where[f"{side}_heel"][0] + 0.05


def test_the_squirrel_has_hands_to_stand_on() -> None:
    assert {"left_hand", "right_hand"} <= set(Character.load(MODELS / "squirrel.xml").tied)


def test_the_face_looks_ahead(character: Character) -> None:
    face = face_of(character)
    assert face is not None
    body, _, direction = face
    pose = forward(character.tree, character.reference_qpos[None])
    ahead = pose.rotation[0, body] @ direction
    assert ahead[0] > 0.95
    assert abs(ahead[1]) < 1e-6


def test_inertias_obey_the_triangle_inequality(character: Character) -> None:
    for body in character.bodies:
        a, b, c = sorted(character.model.body_inertia[body])
        assert a > 0
        assert a + b >= c * (1 - 1e-9)


def test_stands_on_its_feet_without_touching_itself(character: Character) -> None:
    model, data = character.model, mujoco.MjData(character.model)
    data.qpos[:] = character.reference_qpos
    data.qpos[2] -= 1e-4  # so that what stands touches
    mujoco.mj_forward(model, data)
    floor = model.geom("floor").id
    pairs = [set(map(int, contact.geom)) for contact in data.contact]
    assert pairs
    assert all(floor in pair for pair in pairs)
