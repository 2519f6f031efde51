from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physretarget.capture import load
from physretarget.capture.actor import PARENTS, SEGMENT, SEGMENTS, ActorMotion, ActorShape
from physretarget.capture.directions import swing
from physretarget.capture.joints import fit_joints
from physretarget.capture.recording import JointRecording, Source
from physretarget.errors import InputError
from physretarget.kinematics import forward

FPS, FRAMES = 60.0, 180


def walking(shape: ActorShape, seed: int = 0) -> np.ndarray:
    """qpos (T, 75) of somebody who walks on the spot, swings the arms and looks about."""
    t = np.arange(FRAMES) / FPS
    phase = 2 * np.pi * t
    turns = {name: np.zeros((FRAMES, 3)) for name in SEGMENTS}
    for side, sign in (("left", 1.0), ("right", -1.0)):
        lift = np.clip(np.sin(phase) * sign, 0, None)
        turns[f"{side}_thigh"][:, 1] = -0.8 * lift
        turns[f"{side}_shank"][:, 1] = 1.2 * lift
        turns[f"{side}_foot"][:, 1] = -0.4 * lift
        turns[f"{side}_upper_arm"][:, 1] = 0.5 * sign * np.sin(phase)
        turns[f"{side}_upper_arm"][:, 0] = 0.2 * sign
        turns[f"{side}_forearm"][:, 1] = -0.6 - 0.3 * sign * np.sin(phase)
    turns["chest"][:, 2] = 0.15 * np.sin(phase)
    turns["chest"][:, 1] = 0.05
    turns["head"][:, 2] = 0.3 * np.sin(phase / 2)
    turns["pelvis"][:, 2] = 0.7 + 0.1 * np.sin(phase)
    qpos = np.zeros((FRAMES, 75))
    qpos[:, :3] = [1.0, -2.0, shape.offset[0, 2]]
    qpos[:, 1] += 0.02 * np.sin(phase)
    for i, name in enumerate(SEGMENTS):
        quat = Rotation.from_rotvec(turns[name]).as_quat(scalar_first=True)
        qpos[:, 3 + 4 * i : 7 + 4 * i] = quat
    return qpos


def recorded(
    shape: ActorShape,
    qpos: np.ndarray,
    twist: list[np.ndarray],
    *,
    rename: dict[str, str] | None = None,
) -> JointRecording:
    """The motion as a skeleton whose joint i has the local axes ``twist[i]`` of its own."""
    pose = forward(shape.tree(), qpos)
    position = pose.position[:, 1:]
    rotation = pose.rotation[:, 1:] @ np.array(twist)
    names = [{"pelvis": "hips", "head": "neck"}.get(name, name) for name in SEGMENTS]
    parents = list(PARENTS)
    for side in ("left", "right"):  # toes, which the actor has as the feet's tips
        i = SEGMENT[f"{side}_foot"]
        toe = position[:, i] + pose.rotation[:, i + 1] @ shape.tip[i]
        position = np.concatenate([position, toe[:, None]], axis=1)
        rotation = np.concatenate([rotation, rotation[:, i : i + 1]], axis=1)
        names.append(f"{side}_toe")
        parents.append(i)
    names = [(rename or {}).get(name, name) for name in names]
    return JointRecording(
        source=Source(
            path="made.bvh", sha256="0" * 64, format="bvh", unit="m", up="z", fps=FPS, frames=FRAMES
        ),
        names=tuple(names),
        parents=tuple(parents),
        time=np.arange(len(qpos)) / FPS,
        position=position,
        rotation=rotation,
    )


def twists(kind: str) -> list[np.ndarray]:
    rng = np.random.default_rng(3)
    if kind == "standing":
        return [np.eye(3)] * len(SEGMENTS)
    if kind == "axes":  # every joint's x axis along its bone, as Maya likes it
        return [Rotation.from_euler("y", 90, degrees=True).as_matrix()] * len(SEGMENTS)
    return list(Rotation.random(len(SEGMENTS), rng=rng).as_matrix())


def angles(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Degrees between rotations (T, n, 3, 3)."""
    cosine = (np.einsum("tnij,tnij->tn", a, b) - 1) / 2
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


@pytest.mark.parametrize("kind", ["standing", "axes", "any"])
def test_a_known_motion_comes_back_whatever_the_joints_axes(kind: str) -> None:
    shape = ActorShape.reference(1.8)
    qpos = walking(shape)
    got = fit_joints(recorded(shape, qpos, twists(kind)))
    assert got.marker_error_rms is not None
    assert got.marker_error_rms < 0.005
    want, have = (forward(s.tree(), q) for s, q in ((shape, qpos), (got.shape, got.qpos)))
    error = angles(want.rotation[:, 1:], have.rotation[:, 1:]).max(axis=0)
    limits = {"standing": 6.0, "axes": 12.0, "any": 25.0}
    worst = dict(zip(SEGMENTS, error.round(1), strict=True))
    assert error.max() < limits[kind], worst
    for part in ("thigh", "shank"):  # hinges tell the twist whatever the frames are
        assert worst[f"left_{part}"] < 6.0
    np.testing.assert_allclose(got.shape.leg_length, shape.leg_length, atol=0.02)
    np.testing.assert_allclose(
        got.shape.offset[1:] @ [0, 0, 1], shape.offset[1:] @ [0, 0, 1], atol=0.06
    )


def test_exchanged_sides_are_noticed_and_stated() -> None:
    shape = ActorShape.reference()
    swap = {}
    for name in [*SEGMENTS, "left_toe", "right_toe"]:
        other = name.replace("left", "#").replace("right", "left").replace("#", "right")
        swap[name] = other
    motion = recorded(shape, walking(shape), twists("standing"), rename=swap)
    got = fit_joints(motion)
    assert any("left and right were exchanged" in note for note in got.notes)
    right = fit_joints(recorded(shape, walking(shape), twists("standing")))
    np.testing.assert_allclose(got.qpos[:, :7], right.qpos[:, :7], atol=1e-6)


def test_a_floor_that_is_elsewhere_is_shifted_and_stated() -> None:
    shape = ActorShape.reference()
    motion = recorded(shape, walking(shape), twists("standing"))
    lifted = replace(motion, position=motion.position + np.array([0, 0, 0.35]))
    low, high = fit_joints(motion), fit_joints(lifted)
    assert not any("floor" in note for note in low.notes)
    assert any("floor" in note for note in high.notes)
    # Where nothing tells, the balls of the feet are taken 1.4 % of stature above the floor.
    np.testing.assert_allclose(high.qpos[:, 2], low.qpos[:, 2], atol=0.026)


@pytest.mark.parametrize(
    ("lost", "words"),
    [
        (["left_thigh", "left_shank"], "left thigh"),
        (["right_thigh", "right_shank", "right_foot", "right_toe"], "right thigh"),
    ],
)
def test_missing_legs_are_named(lost: list[str], words: str) -> None:
    shape = ActorShape.reference()
    rename = {name: f"thing {i}" for i, name in enumerate(lost)}
    with pytest.raises(InputError, match=words):
        fit_joints(recorded(shape, walking(shape), twists("standing"), rename=rename))


def test_missing_arms_and_head_are_neutral_and_noted() -> None:
    shape = ActorShape.reference()
    rename = {n: f"thing {i}" for i, n in enumerate(SEGMENTS) if "arm" in n or "hand" in n}
    rename |= {"left_clavicle": "p", "right_clavicle": "q", "neck": "r"}
    got = fit_joints(recorded(shape, walking(shape), twists("standing"), rename=rename))
    assert any("left upper arm" in note for note in got.notes)
    assert any("head" in note for note in got.notes)
    assert np.isfinite(got.qpos).all()
    at = 3 + 4 * SEGMENT["left_upper_arm"]
    np.testing.assert_allclose(got.qpos[:, at : at + 4], np.tile([1.0, 0, 0, 0], (FRAMES, 1)))


def test_short_gaps_are_bridged_and_long_ones_not_trusted() -> None:
    shape = ActorShape.reference()
    motion = recorded(shape, walking(shape), twists("standing"))
    position = motion.position.copy()
    position[40:44, 5] = np.nan  # 4 frames of 60 Hz: 67 ms
    position[100:112] = np.nan  # 200 ms
    whole, got = fit_joints(motion), fit_joints(replace(motion, position=position))
    assert np.isfinite(got.qpos).all()
    np.testing.assert_array_equal(np.flatnonzero(~got.valid), np.arange(100, 112))
    assert any("interpolated: 40-43" in note for note in got.notes)
    assert any("not valid: 100-111" in note for note in got.notes)
    near = slice(30, 60)
    np.testing.assert_allclose(got.qpos[near, :3], whole.qpos[near, :3], atol=0.01)


def test_without_any_number_there_is_no_motion() -> None:
    shape = ActorShape.reference()
    motion = recorded(shape, walking(shape), twists("standing"))
    with pytest.raises(InputError, match="No frame"):
        fit_joints(replace(motion, position=np.full_like(motion.position, np.nan)))


def test_a_rest_pose_in_the_first_frame_is_not_used() -> None:
    shape = ActorShape.reference()
    qpos = walking(shape)
    qpos[0] = 0.0
    qpos[0, 3::4] = 1.0
    got = fit_joints(recorded(shape, qpos, twists("standing")))
    assert any("rest pose, far" in note for note in got.notes)
    np.testing.assert_array_equal(np.flatnonzero(~got.valid), [0])
    np.testing.assert_allclose(got.qpos[0], got.qpos[1], atol=1e-9)


def test_a_rest_frame_on_the_spot_is_not_the_motion() -> None:
    shape = ActorShape.reference()
    qpos = walking(shape)
    qpos[:, :3] = qpos[0, :3]
    arms_out = qpos.copy()
    arms_out[0, 3:] = 0.0
    arms_out[0, 3::4] = 1.0
    arms_out[1:, 3 + 4 * SEGMENT["left_upper_arm"] :][:, :4] = [0.5**0.5, 0.5**0.5, 0, 0]
    got = fit_joints(recorded(shape, arms_out, twists("standing")))
    np.testing.assert_array_equal(np.flatnonzero(~got.valid), [0])


def test_mass_is_told_or_follows_from_stature() -> None:
    shape = ActorShape.reference(1.6)
    motion = recorded(shape, walking(shape), twists("standing"))
    assert fit_joints(motion, mass=50.0).shape.mass == 50.0
    guessed = fit_joints(motion)
    np.testing.assert_allclose(guessed.shape.mass, 70 * (1.6 / 1.75) ** 2, rtol=0.03)
    assert any("mass not given" in note for note in guessed.notes)


def test_one_frame_is_a_pose() -> None:
    shape = ActorShape.reference()
    motion = recorded(shape, walking(shape)[:1], twists("standing"))
    got = fit_joints(motion)
    assert got.qpos.shape == (1, 75)
    assert np.isfinite(got.qpos).all()


def test_swing_is_the_smallest_rotation() -> None:
    rng = np.random.default_rng(0)
    a, b = (v / np.linalg.norm(v, axis=1)[:, None] for v in rng.normal(size=(2, 50, 3)))
    b[0], b[1] = a[0], -a[1]
    turn = swing(a, b)
    np.testing.assert_allclose(np.einsum("tij,tj->ti", turn, a), b, atol=1e-9)
    cosine = (np.trace(turn, axis1=1, axis2=2) - 1) / 2
    np.testing.assert_allclose(cosine, np.sum(a * b, axis=1), atol=1e-9)


# --------------------------------------------------------------------------------- real files


def flexion(motion: ActorMotion, segment: str, axis: int = 1) -> np.ndarray:
    at = 3 + 4 * SEGMENT[segment]
    quat = motion.qpos[:, at : at + 4]
    return np.degrees(Rotation.from_quat(quat, scalar_first=True).as_rotvec()[:, axis])


def check_human(motion: ActorMotion) -> None:
    """What must hold of every human who stands and walks."""
    pose = forward(motion.shape.tree(), motion.qpos)
    place, turn = pose.position[:, 1:], pose.rotation[:, 1:]
    assert np.isfinite(motion.qpos).all()
    assert motion.marker_error_rms is not None
    assert motion.marker_error_rms < 0.02
    speed = np.linalg.norm(np.diff(place, axis=0), axis=2) * motion.fps
    assert speed.max() < 15.0
    quats = motion.qpos[:, 3:].reshape(len(motion.qpos), 18, 4)
    assert np.sum(quats[1:] * quats[:-1], axis=2).min() > 0.8  # no flips
    for side in ("left", "right"):
        bend = flexion(motion, f"{side}_shank")
        assert bend.min() > -20  # knees bend backward only
        assert np.quantile(bend, 0.95) >= -10
        elbow = flexion(motion, f"{side}_forearm")
        assert elbow.max() < 20  # elbows forward only
    # The toes point where the knees point, and the head faces where the chest does.
    facing = np.sum(turn[:, SEGMENT["head"], :, 0] * turn[:, SEGMENT["chest"], :, 0], axis=1)
    assert np.median(facing) > 0.5
    left = place[:, SEGMENT["left_shank"]] - place[:, SEGMENT["right_shank"]]
    assert np.median(np.sum(left * turn[:, 0, :, 1], axis=1)) > 0
    lowest = []
    for i, side in enumerate(("left", "right")):
        k = SEGMENT[f"{side}_foot"]
        for local in (motion.shape.tip[k], motion.shape.heel[i]):
            lowest.append((place[:, k] + turn[:, k] @ local)[:, 2])
    low = np.min(lowest, axis=0)
    assert abs(np.quantile(low, 0.2)) < 0.03  # feet near z = 0


@pytest.mark.data
def test_every_real_skeleton_gives_a_human(data: Path) -> None:
    for path in [*sorted((data / "bvh").glob("*/*.bvh")), data / "bvh" / "cmu" / "11_01.amc"]:
        motion = load(path)
        try:
            check_human(motion)
        except AssertionError as error:
            raise AssertionError(f"{path.name}: {error}") from error
        assert 1.2 < motion.shape.height < 1.9


@pytest.mark.data
def test_the_sad_bow_bows(data: Path) -> None:
    motion = load(data / "bvh" / "bandai" / "dataset-1_bow_sad_001.bvh")
    turn = forward(motion.shape.tree(), motion.qpos).rotation[:, 1:]
    lean = np.degrees(np.arcsin(-turn[:, SEGMENT["chest"], 2, 0]))  # nose down is positive
    assert lean.max() > 30
    assert abs(lean[0]) < 15
    assert 0.25 < np.argmax(lean) / len(lean) < 0.75


@pytest.mark.data
def test_runners_move_where_they_face_and_step_in_turn(data: Path) -> None:
    for name in ("run_angry", "walk_normal"):
        motion = load(data / "bvh" / "bandai" / f"dataset-1_{name}_001.bvh")
        pose = forward(motion.shape.tree(), motion.qpos)
        velocity = np.gradient(motion.qpos[:, :3], 1 / motion.fps, axis=0)
        ahead = np.sum(velocity * pose.rotation[:, 1, :, 0], axis=1)
        assert np.median(ahead) > 0.4
        left, right = (flexion(motion, f"{side}_thigh") for side in ("left", "right"))
        assert np.corrcoef(left, right)[0, 1] < 0


def test_a_floor_that_nobody_stands_on_is_the_file_s() -> None:
    shape = ActorShape.reference()
    motion = recorded(shape, walking(shape), twists("standing"))
    drift = np.linspace(0, 12.0, FRAMES)[:, None, None] * np.array([1.0, 0, 0])  # a gliding walk
    got = fit_joints(replace(motion, position=motion.position + drift))
    assert any("no foot stands" in note for note in got.notes)
    np.testing.assert_allclose(got.qpos[:, 2], motion.position[:, 0, 2], atol=1e-6)
