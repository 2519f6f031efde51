from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from physretarget.capture.actor import (
    CONTACT_POINTS,
    NQ,
    NV,
    PARENTS,
    SEGMENT,
    SEGMENTS,
    ActorMotion,
    ActorShape,
)
from physretarget.capture.recording import Source
from physretarget.errors import UsageError
from physretarget.kinematics import forward, integrate, points, quat_to_rotvec

REFERENCE = ActorShape.reference()
SOURCE = Source(path="x.c3d", sha256="", format="c3d", unit="m", up="z", fps=100, frames=3)


def motion(frames: int = 101, fps: float = 100.0) -> ActorMotion:
    tree = REFERENCE.tree()
    time = np.arange(frames) / fps
    swing = np.sin(2 * np.pi * 0.7 * time)[:, None] * np.linspace(-0.8, 0.8, NV)
    return ActorMotion(
        shape=REFERENCE, time=time, source=SOURCE,
        qpos=integrate(tree, np.tile(tree.neutral(), (frames, 1)), swing),
        fps=fps, valid=np.ones(frames, dtype=bool), marker_error_rms=None,
    )  # fmt: skip


def test_layout():
    tree = REFERENCE.tree()
    assert (tree.nq, tree.nv, tree.nb) == (NQ, NV, 19) == (75, 57, 19)
    assert len(SEGMENTS) == 18
    assert all(parent < i for i, parent in enumerate(PARENTS))
    assert PARENTS[SEGMENT["right_foot"]] == SEGMENT["right_shank"]
    assert PARENTS[SEGMENT["right_clavicle"]] == SEGMENT["chest"]


def test_reference_stands_on_the_floor_and_has_its_height():
    tree = REFERENCE.tree()
    pose = forward(tree, tree.neutral()[None])
    segment, local = REFERENCE.contact_points()
    at = dict(zip(CONTACT_POINTS, points(pose, segment + 1, local)[0], strict=True))
    for name in ("left_heel", "right_heel", "left_toe", "right_toe"):
        assert at[name][2] == pytest.approx(0, abs=1e-12)
    assert at["left_toe"][0] > at["left_heel"][0] + 0.15
    assert at["left_heel"][1] > 0 > at["right_heel"][1]
    assert at["head"][2] == pytest.approx(1.75) == REFERENCE.height
    assert REFERENCE.leg_length == pytest.approx(0.530 * 1.75)
    shoulder = pose.position[0, SEGMENT["left_upper_arm"] + 1]
    assert shoulder[2] == pytest.approx(0.818 * 1.75, abs=0.02)  # Winter's figure


def test_reference_is_symmetric():
    for name in SEGMENTS:
        if name.startswith("left"):
            left, right = SEGMENT[name], SEGMENT[name.replace("left", "right")]
            np.testing.assert_allclose(
                REFERENCE.offset[left] * [1, -1, 1], REFERENCE.offset[right], atol=1e-12
            )


def test_on_another_actor_keeps_rotations_and_scales_the_path():
    small = ActorShape.reference(height=1.40, mass=40)
    moved = motion().on(small)
    np.testing.assert_array_equal(moved.qpos[:, 3:], motion().qpos[:, 3:])
    np.testing.assert_allclose(moved.qpos[:, :3], motion().qpos[:, :3] * 0.8)
    back = moved.on(REFERENCE)
    np.testing.assert_allclose(back.qpos, motion().qpos, atol=1e-12)


@pytest.mark.parametrize("fps", [30.0, 60.0, 120.0, 250.0])
def test_resampled_follows_the_motion(fps):
    slow = motion().resampled(fps)
    assert slow.fps == fps
    np.testing.assert_allclose(np.diff(slow.time), 1 / fps)
    assert slow.time[-1] == pytest.approx(1.0, abs=1 / fps)
    truth = np.sin(2 * np.pi * 0.7 * slow.time) * 0.8
    np.testing.assert_allclose(quat_to_rotvec(slow.qpos[:, -4:])[:, 2], truth, atol=2e-3)


def test_resampled_does_not_trust_what_lies_beside_an_invalid_frame():
    valid = np.ones(101, dtype=bool)
    valid[50] = False
    slow = replace(motion(), valid=valid).resampled(50.0)
    assert not slow.valid[25]
    assert slow.valid.sum() == len(slow.valid) - 1
    fast = replace(motion(), valid=valid).resampled(200.0)
    assert list(np.flatnonzero(~fast.valid)) == [99, 100, 101]


@pytest.mark.parametrize("fps", [0.0, -30.0, float("nan")])
def test_a_senseless_rate_is_an_error(fps):
    with pytest.raises(UsageError, match="positive"):
        motion().resampled(fps)
